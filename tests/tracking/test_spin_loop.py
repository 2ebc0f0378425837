"""The spin angle as a state: found from an unknown start, by a signal that is made in three dimensions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from insgnss.constants import C_MPS
from insgnss.errors import ConfigError
from insgnss.tracking.spin import Spin
from insgnss.tracking.spin_loop import ANGLE, SPIN_RATE, SpinBank, SpinLoop, dipole_gain

F0, T = 1575.42e6, 1e-3
AXIS = np.array([0.36, 0.48, 0.8])


def in_space(psi: np.ndarray, theta: float, radius_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return phase of the path [rad] and complex gain of a side antenna, from vectors (n, 3)."""
    across = np.cross(AXIS, [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    k = math.cos(theta) * AXIS + math.sin(theta) * across  # to the satellite
    tangent = np.cross(AXIS, across)
    outwards = np.cos(psi)[:, None] * across + np.sin(psi)[:, None] * tangent
    y = np.cross(AXIS, outwards)
    D = AXIS - k * (AXIS @ k) + np.cross(k, y)
    first = AXIS - k * (AXIS @ k) + np.cross(k, tangent)  # at psi = 0
    first /= np.linalg.norm(first)
    other = np.cross(first, k)  # the wave's own sense is the other one
    path = 2.0 * math.pi * F0 / C_MPS * radius_m * (outwards @ k)
    return path, (D @ first - 1j * (D @ other)) / (1.0 + math.sin(theta))


@pytest.mark.parametrize("theta_deg", [5.0, 40.0, 90.0, 130.0])
def test_gain_and_wind_up_are_those_of_crossed_dipoles_in_space(theta_deg: float) -> None:
    psi, theta = np.linspace(-3.0, 3.0, 25), math.radians(theta_deg)
    path, gain = in_space(psi, theta, 0.08)

    assert np.abs(dipole_gain(psi, theta)) == pytest.approx(np.abs(gain), abs=1e-12)
    same = dipole_gain(psi, theta) * np.conj(gain)
    assert same.imag == pytest.approx(0.0, abs=1e-12) and (same.real > -1e-12).all()
    assert path == pytest.approx(Spin(0.08, 1.0, F0, theta_rad=theta).amplitude_rad * np.cos(psi), abs=1e-12)


def flown(
    theta_deg: float, rate_hz: float, cn0_dbhz: float, seed: int, seconds: float = 2.0
) -> tuple[SpinBank, np.ndarray]:
    """Return the bank after a flight from an unknown angle, and its errors of angle and rate."""
    rng, n, theta = np.random.default_rng(seed), round(seconds / T), math.radians(theta_deg)
    drift_density, a = 1.0, 2.0 * 10.0 ** (0.1 * cn0_dbhz) * T
    psi = rng.uniform(-math.pi, math.pi) + 2.0 * math.pi * rate_hz * T * np.arange(n)
    path, gain = in_space(psi, theta, 0.08)
    doppler = 2.0 * math.pi * 1.5 * rng.standard_normal()
    doppler += np.cumsum(math.sqrt(0.5 * drift_density * T) * rng.standard_normal(n))
    phase = rng.uniform(-math.pi, math.pi) + T * np.cumsum(doppler) + path
    noise = math.sqrt(a) * (rng.standard_normal(n) + 1j * rng.standard_normal(n))
    Z = a * gain * np.exp(1j * phase) + noise

    loop = SpinLoop(Spin(0.08, 1.0, F0, theta_rad=theta), cn0_dbhz, T, drift_density, 1e-3)
    bank = loop.start(complex(Z[0]), (0.7 * rate_hz, 1.3 * rate_hz), 1.5)
    for k in range(1, n):
        bank = loop.step(bank, complex(Z[k]))
    error = bank.state[0, [ANGLE, SPIN_RATE]] - [psi[-1], 2.0 * math.pi * rate_hz]
    error[0] = math.remainder(error[0], 2.0 * math.pi)
    return bank, error


@pytest.mark.parametrize(
    ("theta_deg", "rate_hz", "cn0_dbhz"), [(90.0, 15.0, 45.0), (50.0, 8.0, 42.0), (120.0, 4.0, 40.0)]
)
def test_angle_and_rate_are_found_from_an_unknown_start(
    theta_deg: float, rate_hz: float, cn0_dbhz: float
) -> None:
    runs, nees = 8, []
    for seed in range(runs):
        bank, error = flown(theta_deg, rate_hz, cn0_dbhz, 60 + seed)
        P = bank.covariance[0][np.ix_([ANGLE, SPIN_RATE], [ANGLE, SPIN_RATE])]
        nees.append(error @ np.linalg.solve(P, error))
        assert abs(error[0]) < math.radians(5.0)
        assert bank.rate_hz == pytest.approx(rate_hz, rel=0.01)
        assert math.cos(bank.angle_rad - bank.state[0, ANGLE]) == pytest.approx(1.0)
    low, high = stats.chi2.interval(0.999, 2 * runs)

    assert low < sum(nees) < high


@pytest.mark.parametrize("rates", [(20.0, 10.0), (0.0, 10.0), (10.0, 21.0), (math.nan, 10.0)])
def test_rates_that_are_none_are_refused(rates: tuple[float, float]) -> None:
    loop = SpinLoop(Spin(0.08, 1.0, F0), 45.0, T, 1.0)
    with pytest.raises(ConfigError):
        loop.start(1.0 + 0.0j, rates, 1.0)


def test_correlator_that_is_not_a_number_is_refused() -> None:
    loop = SpinLoop(Spin(0.08, 1.0, F0), 45.0, T, 1.0)
    bank, nothing = loop.start(60.0 + 1.0j, (5.0, 10.0), 1.0), complex(math.nan, 0.0)
    for take in (lambda: loop.step(bank, nothing), lambda: loop.start(nothing, (5.0, 10.0), 1.0)):
        with pytest.raises(ConfigError, match="not a number"):
            take()
