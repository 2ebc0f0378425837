"""Discriminators: apertures, table 1, and their noise and slope against sums over the plane of I and Q."""

from __future__ import annotations

import math

import numpy as np
import pytest

from insgnss.errors import ConfigError, ModelError
from insgnss.interference.discriminators import (
    DISCRIMINATORS,
    ENGINEERING_RATIO,
    Discriminator,
    discriminator,
    equivalent_noise,
    inverse_cn0,
    true_noise,
    true_slope,
)

OUTPUTS = {
    "Q": lambda i, q: 0.0 * i + q,
    "atan(Q/I)": lambda i, q: np.arctan(q / i),
    "sign(I)Q": lambda i, q: np.sign(i) * q,
    "IQ": lambda i, q: i * q,
}
HALF_WIDTH, POINTS = 8.0, 2001  # midpoints in sigmas: the jump at I = 0 costs 4e-3 sigma at most


def moments(name: str, qt: float, error: float) -> tuple[float, float]:
    """Return mean and mean square of a discriminator's output, by a sum over the plane of I and Q."""
    s = math.sqrt(0.5 / qt)
    step = 2.0 * HALF_WIDTH / POINTS
    x = (np.arange(POINTS) + 0.5) * step - HALF_WIDTH
    weight = np.exp(-0.5 * x * x) * step / math.sqrt(2.0 * math.pi)
    i, q = math.cos(error) + s * x, math.sin(error) + s * x
    u = OUTPUTS[name](i[:, None], q[None, :])
    return float(weight @ u @ weight), float(weight @ (u * u) @ weight)


@pytest.mark.parametrize("kind", DISCRIMINATORS, ids=lambda kind: kind.name)
@pytest.mark.parametrize("qt", [0.8, 4.7])
def test_slope_and_noise_are_those_of_the_plane_of_sums(kind: Discriminator, qt: float) -> None:
    d = 1e-2
    slope = (moments(kind.name, qt, d)[0] - moments(kind.name, qt, -d)[0]) / (2.0 * d)
    variance = moments(kind.name, qt, 0.0)[1]

    # the S-curve's third derivative over 0.01 rad, and the step across I = 0: some 1e-3
    assert float(true_slope(kind, qt)) == pytest.approx(slope, rel=3e-3)
    T = 0.01
    assert float(true_noise(kind, T / qt, T)) == pytest.approx(2.0 * T * variance / slope**2, rel=6e-3)


def test_iq_has_the_equivalent_noise_of_equation_20_and_q_that_of_19() -> None:
    x = np.array([1e-4, 1e-3, 1e-2])
    for name in ("Q", "IQ"):
        kind = discriminator(name)
        assert true_noise(kind, x, 0.01) == pytest.approx(equivalent_noise(kind, x, 0.01), rel=1e-12)


def test_atan_in_noise_has_more_noise_than_equation_20() -> None:
    kind = discriminator("atan")
    more = float(true_noise(kind, 0.01 / 1.55, 0.01) / equivalent_noise(kind, 0.01 / 1.55, 0.01))
    assert more == pytest.approx(1.3, abs=0.1)


def test_strong_signals_have_the_noise_of_an_ideal_phase_meter() -> None:
    # 1e6 times the noise in T: the squaring loss is 5e-7
    for kind in DISCRIMINATORS:
        assert float(true_noise(kind, 1e-8, 0.01)) == pytest.approx(1e-8, rel=2e-6)


@pytest.mark.parametrize("kind", DISCRIMINATORS, ids=lambda kind: kind.name)
def test_inverse_undoes_the_equivalent_noise_over_nine_decades(kind: Discriminator) -> None:
    x = np.logspace(-8.0, 1.0, 19)
    assert inverse_cn0(kind, equivalent_noise(kind, x, 0.01), 0.01) == pytest.approx(x, rel=1e-12)


def test_table_1_of_the_paper_is_kept_and_may_be_replaced() -> None:
    printed = {"Q": 0.076, "atan(Q/I)": 0.067, "sign(I)Q": 0.076, "IQ": 0.078}
    degrees = {"Q": 360.0, "atan(Q/I)": 180.0, "sign(I)Q": 180.0, "IQ": 180.0}

    assert {d.name: d.threshold_ratio for d in DISCRIMINATORS} == printed
    assert {d.name: math.degrees(d.aperture_rad) for d in DISCRIMINATORS} == pytest.approx(degrees)
    assert {d.name: d.type for d in DISCRIMINATORS} == {"Q": 1, "atan(Q/I)": 2, "sign(I)Q": 2, "IQ": 2}
    assert discriminator("iq", ENGINEERING_RATIO).threshold_rms_rad == pytest.approx(0.076 * math.pi)


def test_unknown_discriminator_names_the_nearest() -> None:
    with pytest.raises(ModelError) as caught:
        discriminator("sign(Q)I")
    assert "sign(I)Q" in caught.value.advice


@pytest.mark.parametrize(
    ("aperture", "ratio", "key"),
    [(180.0, 0.076, "aperture_rad"), (0.0, 0.076, "aperture_rad"), (math.pi, 7.6, "threshold_ratio")],
)
def test_impossible_discriminators_are_refused(aperture: float, ratio: float, key: str) -> None:
    with pytest.raises(ConfigError) as caught:
        Discriminator("mine", aperture, ratio)
    assert caught.value.key == key and caught.value.advice


def test_accumulation_of_zero_is_refused_for_type_2_alone() -> None:
    assert float(equivalent_noise(discriminator("Q"), 1e-3, 0.0)) == 1e-3
    with pytest.raises(ConfigError, match="accumulation_s"):
        equivalent_noise(discriminator("IQ"), 1e-3, 0.0)
