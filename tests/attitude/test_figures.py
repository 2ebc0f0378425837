"""The pictures show what they say: number of curves, and data from the functions that the other tests hold."""

from __future__ import annotations

import numpy as np

from insgnss.attitude.angular_discriminators import discriminator_curve, pair_slopes
from insgnss.attitude.aperture import apertures, random_attitudes
from insgnss.attitude.baselines import triangle
from insgnss.attitude.figures import (
    curves_figure,
    histogram_figure,
    planar_figure,
    simulated_curve,
    simulated_figure,
    slope_figure,
)
from tests.attitude.arrays import eight

RPY = np.radians([10.0, -5.0, 30.0])


def test_planar_figure_shows_five_curves_with_their_slopes() -> None:
    axes = planar_figure().axes[0]

    assert len(axes.lines) == 10
    assert "pitch" in axes.get_xlabel()


def test_simulated_curve_lies_on_the_formula() -> None:
    x, looks = np.radians(np.linspace(-15.0, 15.0, 21)), 300
    a = np.full((3, 8), 40.0)
    exact = discriminator_curve("yaw", x, RPY, triangle(1.0), eight(), pair_slopes(a))
    drawn = simulated_curve("yaw", x, RPY, triangle(1.0), eight(), a, looks, 3)

    # at most every pair adds (2 pi l / lambda)^2 (a^3 2 + 2 a^2): 16 pairs, correlated in twos
    sd = np.sqrt(16 * 2 * (2 * np.pi / 0.19) ** 2 * (2 * 40.0**3 + 2 * 40.0**2) / looks)
    assert np.abs(drawn - exact).max() < 4.0 * sd
    assert np.abs(exact).max() > 10.0 * sd
    assert len(simulated_figure(RPY, triangle(1.0), eight(), 40.0, looks=20).axes) == 3


def test_pictures_of_a_sample_carry_its_numbers() -> None:
    rpy = random_attitudes(300, np.random.default_rng(1))
    samples = [(f"{edge:g} m", apertures(rpy, triangle(edge), eight())) for edge in (1.0, 2.0)]

    assert len(curves_figure(samples).axes) == 2
    points = slope_figure(samples).axes[0].lines[0]
    assert np.allclose(points.get_ydata(), np.degrees(samples[0][1].width))
    legend = histogram_figure(samples).axes[0].get_legend()
    assert (
        legend is not None and f"{np.degrees(samples[0][1].interval()[1]):.1f}" in legend.texts[0].get_text()
    )
