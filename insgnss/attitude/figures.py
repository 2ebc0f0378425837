"""Pictures of the angular discriminator: Fig. 3 to 9 of Dneprov and Korogodin (2015).

matplotlib is loaded when a picture is asked for.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from insgnss.attitude.angular_discriminators import (
    angular_discriminator,
    discriminator_curve,
    pair_discriminator,
    pair_slopes,
    slopes,
)
from insgnss.attitude.aperture import Apertures
from insgnss.attitude.baselines import (
    AntennaArray,
    Sky,
    angle_index,
    attitude_matrices,
    phase_differences,
    phases_by_euler,
)
from insgnss.attitude.correlator_bank import draw_correlators
from insgnss.results.matplotlib_figure import PAPER_COLOURS, new_figure
from insgnss.tables import Float64
from insgnss.tracking.admissible import seeded

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_POINTS: Final = 400
PLANAR_ANGLES_DEG: Final = (90.0, 60.0, 45.0, 30.0, 10.0)


def planar_case(length_m: float, wavelength_m: float) -> tuple[AntennaArray, Sky]:
    """Return the paper's plane problem: a baseline along the body's x axis and one satellite in the north."""
    return AntennaArray(np.array([[0.0, 0.0, 0.0], [length_m, 0.0, 0.0]])), Sky(
        np.array([[1.0, 0.0, 0.0]]), np.array([wavelength_m])
    )


def planar_figure(length_m: float = 1.5, wavelength_m: float = 0.19) -> Figure:
    """Return figure 3: S-curves of pitch for angles between the baseline and the line of sight, with their slopes."""
    array, sky = planar_case(length_m, wavelength_m)
    figure = new_figure(8.0, 5.0)
    axes = figure.add_subplot()
    x = np.radians(np.linspace(-12.0, 12.0, _POINTS))
    for colour, angle in zip(PAPER_COLOURS, PLANAR_ANGLES_DEG, strict=True):
        rpy = np.radians([0.0, angle, 0.0])
        curve = discriminator_curve("pitch", x, rpy, array, sky)
        slope = float(slopes(rpy, array, sky)[1])
        axes.plot(np.degrees(x), curve, color=colour, label=f"{angle:g} deg")
        axes.plot(np.degrees(x), slope * x, color=colour, lw=0.8, ls="--")
    highest = 2.0 * math.pi / wavelength_m * length_m
    axes.set_ylim(-1.2 * highest, 1.2 * highest)
    axes.set_xlabel("pitch off by, deg")
    axes.set_ylabel("mean output over S_psi, 1/rad")
    axes.legend(title="baseline to line of sight", fontsize=8)
    axes.grid(alpha=0.3)
    return figure


def simulated_figure(
    rpy: Float64, array: AntennaArray, sky: Sky, a: float, looks: int = 200, seed: int = 1
) -> Figure:
    """Return figure 4: the S-curves of roll, pitch and yaw from simulated correlators on those of the formulas."""
    figure = new_figure(9.0, 3.5)
    x = np.radians(np.linspace(-15.0, 15.0, 61))
    ratios = np.full((len(array.positions_b), len(sky.los_n)), a)
    for place, angle in enumerate(("roll", "pitch", "yaw"), 1):
        axes = figure.add_subplot(1, 3, place)
        exact = discriminator_curve(angle, x, rpy, array, sky, pair_slopes(ratios))
        drawn = simulated_curve(angle, x, rpy, array, sky, ratios, looks, seed)
        axes.plot(np.degrees(x), exact, color=PAPER_COLOURS[0], label="(28)-(30)")
        axes.plot(np.degrees(x), drawn, ".", color=PAPER_COLOURS[1], ms=3, label=f"{looks} looks")
        axes.set_xlabel(f"{angle} off by, deg")
        axes.grid(alpha=0.3)
    figure.axes[0].set_ylabel("mean output, 1/rad")
    figure.axes[0].legend(fontsize=8)
    return figure


def simulated_curve(
    angle: str,
    offsets_rad: Float64,
    rpy: Float64,
    array: AntennaArray,
    sky: Sky,
    a: Float64,
    looks: int,
    seed: int,
) -> Float64:
    """Return the mean output of the discriminator over simulated correlators with ratios a (M, N), (n,)."""
    axis = angle_index(angle)
    estimate = np.asarray(rpy, np.float64)
    truth = estimate + offsets_rad[:, None] * np.eye(3)[axis]
    psi = phase_differences(attitude_matrices(truth), array, sky)
    Z = draw_correlators(np.broadcast_to(psi, (looks, *psi.shape)), a, seeded(seed, axis))
    u = pair_discriminator(Z, phase_differences(attitude_matrices(estimate), array, sky))
    return np.asarray(
        np.mean(angular_discriminator(u, phases_by_euler(estimate, array, sky)), axis=0)[:, axis]
    )


def curves_figure(samples: Sequence[tuple[str, Apertures]]) -> Figure:
    """Return figures 5 and 7: S-curves over their slopes; darker where more attitudes pass."""
    figure = new_figure(5.0 * len(samples), 4.0)
    x = np.linspace(-0.5, 0.5, 201)
    for place, (name, sample) in enumerate(samples, 1):
        axes = figure.add_subplot(1, len(samples), place)
        curves = sample.curves(x)
        highest = float(np.nanquantile(np.abs(curves), 0.99))
        shown = np.isfinite(curves)
        at = np.broadcast_to(np.degrees(x), curves.shape)
        axes.hist2d(
            at[shown],
            np.degrees(curves[shown]),
            bins=(len(x), 150),
            range=((-28.0, 28.0), (-math.degrees(highest), math.degrees(highest))),
            cmap="Greys",
            norm="log",
        )
        axes.set_title(name)
        axes.set_xlabel(f"{sample.angle} off by, deg")
        axes.set_ylabel("output over slope, deg")
    return figure


def slope_figure(samples: Sequence[tuple[str, Apertures]]) -> Figure:
    """Return figures 6 and 8: the aperture over the slope, one point for each attitude."""
    figure = new_figure(5.0 * len(samples), 4.0)
    for place, (name, sample) in enumerate(samples, 1):
        axes = figure.add_subplot(1, len(samples), place)
        axes.plot(sample.slope, np.degrees(sample.width), ".", ms=1.5, color=PAPER_COLOURS[0], alpha=0.4)
        axes.set_title(name)
        axes.set_xlabel("slope over S_psi, 1/rad²")
        axes.set_ylabel("aperture, deg")
        axes.grid(alpha=0.3)
    return figure


def histogram_figure(samples: Sequence[tuple[str, Apertures]]) -> Figure:
    """Return figure 9: how the aperture is spread over the attitudes, with the interval that holds 95 % of them."""
    figure = new_figure(8.0, 4.5)
    axes = figure.add_subplot()
    for colour, (name, sample) in zip(PAPER_COLOURS, samples, strict=False):
        low, high = np.degrees(sample.interval())
        width = np.degrees(sample.width)
        label = f"{name}: 95 % in {low:.1f}...{high:.1f} deg"
        axes.hist(width[np.isfinite(width)], bins=120, color=colour, alpha=0.6, label=label)
        axes.axvline(high, color=colour, lw=0.8)
    axes.set_xlabel("aperture, deg")
    axes.set_ylabel("attitudes")
    axes.legend(fontsize=8)
    return figure
