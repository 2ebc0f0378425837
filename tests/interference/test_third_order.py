"""The third-order loop against the Riccati equation, against the loop simulator, and against the second order."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import linalg

from insgnss.errors import ConfigError
from insgnss.gnss.signals import L1_HZ
from insgnss.interference import PhaseLoop, discriminator, margin_db, margin_in_motion_db
from insgnss.interference.discriminators import equivalent_noise, inverse_cn0
from insgnss.interference.drift import per_mps
from insgnss.interference.margin import db
from insgnss.interference.optimal_loop import error_variance, gains, threshold_noise
from insgnss.interference.steady_acceleration import (
    density_at_threshold,
    equivalent_density,
    threshold_in_motion,
)
from insgnss.interference.third_order import third_order_gains, third_order_threshold_noise
from insgnss.tables import Float64
from insgnss.tracking.channels import ChannelDesign, ChannelSimulation, scene
from insgnss.tracking.lock_and_cn0 import slip_time_s
from insgnss.tracking.loop_filters import LoopFilter, digital_filter, filter_from_continuous
from insgnss.tracking.phase_motion import wandering_phase

G, CARRIER_HZ = 9.80665, 1.6e9
RMS = 0.076 * math.pi
CHANNELS = 200


def riccati(S: float, S_n: float, sigma: float, time_s: float, S_f: float = 0.0) -> tuple[Float64, float]:
    """Return gains and variance of the steady Kalman filter, by the Schur method."""
    k, m = per_mps(CARRIER_HZ), 1.0 / time_s
    scale = np.diag([1.0, 1e-2, 1e-4])  # states of one size
    F = scale @ np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -m]]) @ np.linalg.inv(scale)
    Q = scale @ np.diag([0.5 * S_f, 0.5 * S, 2.0 * m * (k * sigma) ** 2]) @ scale
    P = linalg.solve_continuous_are(F.T, np.eye(3)[:, :1], Q, np.array([[0.5 * S_n]]))
    return np.linalg.inv(scale) @ P[:, 0] / (0.5 * S_n), float(P[0, 0])


@pytest.mark.parametrize(
    ("S", "sigma", "time_s", "S_f"),
    [
        (100.0, 5.0 * G, 1.0 / 0.3, 0.0),
        (77.0, 1.0, 5.0, 0.0),
        (0.2, 30.0, 60.0, 0.0),
        (100.0, 10.0, 0.05, 0.0),
        (77.0, 3.0, 5.0, 0.02),
    ],
)
def test_gains_and_threshold_are_those_of_the_riccati_equation(
    S: float, sigma: float, time_s: float, S_f: float
) -> None:
    S_n = float(third_order_threshold_noise(S, RMS, sigma, time_s, CARRIER_HZ, S_f))
    wanted, variance = riccati(S, S_n, sigma, time_s, S_f)

    assert variance == pytest.approx(RMS**2, rel=1e-7)
    found = third_order_gains(S, S_n, sigma, time_s, CARRIER_HZ, S_f)
    assert [float(K) for K in found] == pytest.approx(list(wanted), rel=1e-6)


def test_without_acceleration_it_is_the_second_order_loop() -> None:
    S, S_n = np.array([0.1, 77.0, 3167.0]), 2e-3
    second, third = gains(S, S_n), third_order_gains(S, S_n, 0.0, 5.0, CARRIER_HZ)
    assert third.K1 == pytest.approx(second.K1, rel=1e-9)
    assert third.K2 == pytest.approx(second.K2, rel=1e-9)
    assert np.allclose(third.K3 / third.K1**3, 0.0, atol=1e-9)
    assert third_order_threshold_noise(S, RMS, 0.0, 5.0, CARRIER_HZ) == pytest.approx(
        threshold_noise(S, RMS), rel=1e-12
    )
    walk = threshold_noise(S, RMS, 0.02)
    assert third_order_threshold_noise(S, RMS, 0.0, 5.0, CARRIER_HZ, 0.02) == pytest.approx(walk, rel=1e-9)
    found = threshold_in_motion(S, 0.0, 5.0, CARRIER_HZ, RMS)
    assert (found.order == 2).all() and found.density == pytest.approx(S, rel=1e-9)


def test_better_order_is_taken_and_its_drift_has_its_threshold() -> None:
    sigma = np.array([0.0, 0.01, 1.0, 30.0])
    for walk in (0.0, 0.02):
        found = threshold_in_motion(77.0, sigma, 5.0, L1_HZ, RMS, walk)
        S = density_at_threshold(77.0, sigma, 5.0, L1_HZ, RMS)
        assert (found.noise >= threshold_noise(S, RMS, walk) * (1.0 - 1e-12)).all()
        assert found.order.tolist() == [2, 3, 3, 3]
        assert error_variance(found.density, found.noise, walk) == pytest.approx(RMS**2, rel=1e-9)


def test_turn_of_five_g_costs_the_third_order_less() -> None:
    """Computed independently, from the Riccati equation: 27.43 and 30.31 dB."""
    loop = PhaseLoop(discriminator("IQ", 0.076), 1.022e6, 0.001)
    S = density_at_threshold(100.0, 5.0 * G, 1.0 / 0.3, CARRIER_HZ, RMS)

    assert float(margin_db(S, loop)) == pytest.approx(27.43, abs=0.005)
    better = margin_in_motion_db(100.0, 5.0 * G, 1.0 / 0.3, CARRIER_HZ, loop)
    assert float(better) == pytest.approx(30.31, abs=0.005)
    noisy = margin_in_motion_db(100.0, 5.0 * G, 1.0 / 0.3, CARRIER_HZ, loop, 32.0)
    assert float(noisy) == pytest.approx(
        float(db(10.0 ** (0.1 * float(better)) - 1.022e6 * 10.0**-3.2)), abs=1e-9
    )


def lasting_phase(
    sigma: float, time_s: float, count: int, step_s: float, rng: np.random.Generator
) -> Float64:
    """Return the phases (count + 1, CHANNELS) of a Gauss-Markov acceleration that begins at zero [rad]."""
    kept = math.exp(-step_s / time_s)
    a = np.zeros((count + 1, CHANNELS))
    drawn = sigma * math.sqrt(1.0 - kept * kept) * rng.standard_normal((count, CHANNELS))
    for k in range(count):
        a[k + 1] = kept * a[k] + drawn[k]
    v = np.zeros_like(a)
    v[1:] = np.cumsum(0.5 * step_s * (a[1:] + a[:-1]), axis=0)
    way = np.zeros_like(a)
    way[1:] = np.cumsum(step_s * v[:-1] + step_s**2 * (a[:-1] / 3.0 + a[1:] / 6.0), axis=0)
    return -per_mps(L1_HZ) * way


def share_that_slips(loop: LoopFilter, phase: Float64, cn0_dbhz: float) -> float:
    """Return the share of simulated channels whose phase error passes the aperture."""
    design = ChannelDesign(loop, digital_filter(1, 1.0, loop.step_s), cn0_dbhz, "iq")
    history = ChannelSimulation(design, scene(phase, cn0_dbhz)).run(seed=3)
    return float(np.isfinite(slip_time_s(history.phase_error_rad, loop.step_s, math.pi)).mean())


def test_simulated_loop_of_third_order_keeps_what_the_second_loses() -> None:
    """2 g that last for 5 s at 28 dBHz, between both thresholds (30.1 and 27.0 dBHz), for 10 s.

    The simulation knows nothing of the linear theory. 0.985 and 0.235 of 200 channels slip, each within 0.10 by
    chance (99.9 %).
    """
    S, sigma, time_s, step_s, cn0 = 100.0, 2.0 * G, 5.0, 0.004, 28.0
    kind = discriminator("IQ")
    S_n = float(equivalent_noise(kind, 10.0 ** (-0.1 * cn0), step_s))
    count, rng = round(10.0 / step_s), np.random.default_rng(1)
    phase = wandering_phase(S, count, CHANNELS, step_s, rng) + lasting_phase(
        sigma, time_s, count, step_s, rng
    )
    total = S
    for _ in range(200):  # the density that the second order is optimal for, at this noise
        total = S + float(equivalent_density(sigma, time_s, L1_HZ, gains(total, S_n)))
    second = np.array([float(K) for K in gains(total, S_n)])
    third = np.array([float(K) for K in third_order_gains(S, S_n, sigma, time_s, L1_HZ)])

    assert share_that_slips(filter_from_continuous(second, step_s), phase, cn0) > 0.85
    assert share_that_slips(filter_from_continuous(third, step_s), phase, cn0) < 0.35
    rms = kind.threshold_rms_rad
    S_2 = density_at_threshold(S, sigma, time_s, L1_HZ, rms)
    limits = [
        -float(db(inverse_cn0(kind, noise, step_s)))
        for noise in (
            threshold_noise(S_2, rms),
            third_order_threshold_noise(S, rms, sigma, time_s, L1_HZ),
        )
    ]
    assert limits[1] < cn0 < limits[0]


def test_numbers_that_make_no_sense_are_refused() -> None:
    with pytest.raises(ConfigError, match="time_s"):
        third_order_threshold_noise(77.0, RMS, 1.0, 0.0, L1_HZ)
    with pytest.raises(ConfigError, match="sigma"):
        third_order_gains(77.0, 1e-3, math.inf, 5.0, L1_HZ)
    with pytest.raises(ConfigError, match="drift"):
        third_order_gains(0.0, 1e-3, 1.0, 5.0, L1_HZ)
