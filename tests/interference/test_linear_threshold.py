"""The linear theory of receivers against numbers computed independently of this project, and against closed forms."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import pytest
from scipy import linalg

from insgnss.antenna.obstruction import directions
from insgnss.errors import ConfigError
from insgnss.interference import (
    PhaseLoop,
    PhaseModel,
    UnknownAcceleration,
    channel_model,
    discriminator,
    noise_bandwidth,
    one_stage_model,
    one_stage_velocity_mps,
    phase_covariance,
    phase_rms_rad,
    phase_threshold,
    receiver_models,
    third_order_gains,
    two_stage_velocity_mps,
)
from insgnss.interference.discriminators import equivalent_noise
from insgnss.interference.linear_threshold import noise_bandwidth_at
from insgnss.interference.margin import ratio
from insgnss.interference.phase_models import FREQUENCY, VELOCITY
from insgnss.interference.riccati import error_sources, steady_covariance
from insgnss.interference.third_order import third_order_threshold_noise
from insgnss.tables import Float64

CARRIER_HZ: Final = 1.6e9
SKY: Final = directions([20, 65, 110, 155, 200, 245, 290, 335], [12, 40, 20, 65, 15, 35, 70, 25])
NAMES: Final = ("two_stage", "two_stage_ins", "one_stage", "one_stage_ins")
FIVE_G: Final = 49.03
INS_ERROR: Final = UnknownAcceleration(0.06, 100.0, 0.1, 1e-3)

# Computed with a separate program (Riccati equations in discrete time). alpha [1/s], S_osc, T_s, and for each receiver
# J/S [dB] and 3-D velocity at 40 dBHz [m/s]; bandwidths of the channels at the threshold [Hz]
TABLE: Final = [
    (0.3, 100.0, 1e-3, (30.31, 34.86, 32.51, 38.37), (0.2640, 0.03702, 0.2226, 0.004677), (29.54, 5.72)),
    (0.3, 1.0, 1e-3, (30.33, 38.44, 32.67, 40.00), (0.2640, 0.00759, 0.2134, 0.004667), (29.47, 1.46)),
    (0.3, 100.0, 1e-2, (31.84, 37.73, 34.66, 42.19), (0.2611, 0.03682, 0.2203, 0.004637), (29.54, 5.72)),
    (0.1, 10.0, 1e-3, (31.01, 36.83, 33.22, 39.29), (0.2010, 0.01594, 0.1647, 0.004676), (23.75, 2.72)),
    (0.03, 1000.0, 1e-3, (31.38, 32.70, 33.08, 37.16), (0.1595, 0.08750, 0.1406, 0.004678), (20.47, 12.28)),
]
# Phase rms [rad] and velocity [m/s] of the first row over C/N0
GRID: Final = {
    20: ((1.077, 0.5216, 0.7961, 0.3160), (1.282, 0.0829, 1.047, 0.0191)),
    25: ((0.4696, 0.2467, 0.3487, 0.1451), (0.781, 0.0642, 0.6412, 0.0120)),
    30: ((0.2322, 0.1306, 0.1731, 0.0752), (0.512, 0.0518, 0.4239, 0.0082)),
    35: ((0.1292, 0.0770, 0.0966, 0.0436), (0.361, 0.0433, 0.3010, 0.0060)),
    40: ((0.0769, 0.0482, 0.0577, 0.0270), (0.264, 0.0370, 0.2226, 0.0047)),
    45: ((0.0470, 0.0309, 0.0354, 0.0171), (0.197, 0.0319, 0.1675, 0.0037)),
}


def loop_of(accumulation_s: float) -> PhaseLoop:
    return PhaseLoop(discriminator("IQ", 0.076), 1.022e6, accumulation_s)


def models_of(alpha: float, drift: float) -> dict[str, PhaseModel]:
    return receiver_models(UnknownAcceleration(FIVE_G, 1.0 / alpha), INS_ERROR, drift, CARRIER_HZ, SKY)


def velocity(name: str, model: PhaseModel, loop: PhaseLoop, cn0_dbhz: float) -> float:
    if name.startswith("one"):
        return one_stage_velocity_mps(model, loop, cn0_dbhz)
    return two_stage_velocity_mps(model, loop, cn0_dbhz, SKY, CARRIER_HZ)


@pytest.mark.parametrize(("alpha", "drift", "T", "js", "velocities", "bandwidths"), TABLE)
def test_thresholds_and_velocities_are_those_of_an_independent_program(
    alpha: float, drift: float, T: float, js: tuple[float, ...], velocities: tuple[float, ...],
    bandwidths: tuple[float, ...],
) -> None:  # fmt: skip
    models, loop = models_of(alpha, drift), loop_of(T)
    found = {name: phase_threshold(models[name], loop) for name in NAMES}

    # the numbers are rounded in their fourth digit
    np.testing.assert_allclose([found[name].js_db for name in NAMES], js, atol=0.006)
    np.testing.assert_allclose(
        [velocity(name, models[name], loop, 40.0) for name in NAMES], velocities, rtol=4e-4
    )
    np.testing.assert_allclose([found[name].bandwidth_hz for name in NAMES[:2]], bandwidths, atol=0.007)


@pytest.mark.parametrize("cn0_dbhz", GRID)
def test_phase_and_velocity_over_cn0_are_those_of_an_independent_program(cn0_dbhz: int) -> None:
    models, loop = models_of(0.3, 100.0), loop_of(1e-3)
    phases, velocities = GRID[cn0_dbhz]

    for name, phase, wanted in zip(NAMES, phases, velocities, strict=True):
        assert float(phase_rms_rad(models[name], loop, cn0_dbhz).max()) == pytest.approx(
            phase, rel=1e-3, abs=6e-5
        )
        assert velocity(name, models[name], loop, cn0_dbhz) == pytest.approx(wanted, rel=3e-3, abs=6e-5)


@pytest.mark.parametrize(
    ("drift", "wanted"), [(100.0, (37.73, 37.73, 37.70, 36.31)), (0.02, (43.48, 43.43, 41.66, 36.76))]
)
def test_white_ins_errors_below_1_mps2_matter_only_beside_a_good_oscillator(
    drift: float, wanted: tuple[float, ...]
) -> None:
    errors = [UnknownAcceleration(0.06, 100.0, white, 1e-3) for white in (0.01, 0.1, 1.0, 10.0)]
    found = [phase_threshold(channel_model(e, drift, CARRIER_HZ), loop_of(1e-2)).js_db for e in errors]

    np.testing.assert_allclose(found, wanted, atol=0.006)


def test_thresholds_at_the_simulated_setting_are_those_of_an_independent_program() -> None:
    models, loop = models_of(0.1, 100.0), loop_of(5e-3)

    found = [phase_threshold(models[name], loop).cn0_dbhz for name in NAMES]

    np.testing.assert_allclose(found, (27.70, 23.02, 25.14, 18.92), atol=0.006)


@pytest.mark.parametrize("walk", [0.0, 0.02])
def test_channel_without_white_errors_is_the_third_order_loop_in_closed_form(walk: float) -> None:
    drift, sigma, time_s, loop = 77.0, 30.0, 2.0, loop_of(1e-2)
    model = channel_model(UnknownAcceleration(sigma, time_s), drift, CARRIER_HZ, walk)
    S_n = float(equivalent_noise(loop.discriminator, ratio(-35.0), 1e-2))
    rms = loop.discriminator.threshold_rms_rad

    K1 = float(third_order_gains(drift, S_n, sigma, time_s, CARRIER_HZ, walk).K1)
    noise = float(third_order_threshold_noise(drift, rms, sigma, time_s, CARRIER_HZ, walk))
    threshold = ratio(-phase_threshold(model, loop).cn0_dbhz)

    assert phase_rms_rad(model, loop, 35.0)[0] ** 2 == pytest.approx(0.5 * S_n * K1, rel=1e-10)
    assert float(equivalent_noise(loop.discriminator, threshold, 1e-2)) == pytest.approx(noise, rel=1e-7)


def test_channel_without_acceleration_is_the_second_order_loop_of_the_paper() -> None:
    loop, S = loop_of(1e-3), 100.0
    model = channel_model(UnknownAcceleration(0.0, 1.0), S, CARRIER_HZ)
    S_n = equivalent_noise(loop.discriminator, ratio(-35.0), 1e-3)

    assert noise_bandwidth_at(model, loop, 35.0) == pytest.approx(float(noise_bandwidth(S, S_n)), rel=1e-9)


def test_sources_add_up_to_the_covariance() -> None:
    model = models_of(0.3, 100.0)["one_stage"]
    parts = error_sources(model.A, model.motion, model.oscillator, model.H, 1e-4)
    P = steady_covariance(model.A, model.Q, model.H, 1e-4)

    sigma = np.sqrt(np.diag(P))
    np.testing.assert_allclose(sum(parts) / np.outer(sigma, sigma), P / np.outer(sigma, sigma), atol=1e-8)


def test_doubling_solves_what_the_schur_method_solves() -> None:
    model = models_of(0.3, 100.0)["two_stage"]
    scale = np.array([1.0, 30.0, 900.0])
    A, Q, H = model.A / scale[:, None] * scale, model.Q / np.outer(scale, scale), model.H * scale
    schur = linalg.solve_continuous_are(A.T, H.T, Q, np.array([[2e-4]]))

    np.testing.assert_allclose(steady_covariance(A, Q, H, 2e-4), schur, rtol=1e-9)


@pytest.mark.parametrize("cn0_dbhz", [-10.0, 0.0, 60.0, 90.0])
@pytest.mark.parametrize(
    ("sigma", "time_s", "drift"), [(0.003, 3000.0, 0.01), (0.1, 80.0, 8e4), (300.0, 0.05, 1e-3)]
)
def test_covariance_solves_its_equation_at_the_ends_of_all_ranges(
    sigma: float, time_s: float, drift: float, cn0_dbhz: float
) -> None:
    model, loop = one_stage_model(UnknownAcceleration(sigma, time_s), drift, CARRIER_HZ, SKY), loop_of(1e-2)
    P = phase_covariance(model, loop, cn0_dbhz)
    r = 0.5 * float(equivalent_noise(loop.discriminator, ratio(-cn0_dbhz), 1e-2))
    left = model.A @ P + P @ model.A.T + model.Q - P @ model.H.T @ model.H @ P / r

    sigmas = np.sqrt(np.diag(P))
    assert np.all(np.linalg.eigvalsh(P / np.outer(sigmas, sigmas)) > 0.0)
    assert np.max(np.abs(left) / np.outer(sigmas, sigmas)) < 1e-7


def test_two_stage_velocity_is_least_squares_of_channels_with_common_errors() -> None:
    """The covariance of all channels together: noise apart, acceleration and oscillator in common."""
    model, loop, k = (
        models_of(0.3, 100.0)["two_stage"],
        loop_of(1e-3),
        2.0 * math.pi * CARRIER_HZ / 299792458.0,
    )
    noise = 0.5 * float(equivalent_noise(loop.discriminator, ratio(-40.0), 1e-3))
    n, a, o = (
        X[FREQUENCY, FREQUENCY]
        for X in error_sources(model.A, model.motion, model.oscillator, model.H, noise)
    )
    joint = n * np.eye(8) + a * SKY @ SKY.T + o * np.ones((8, 8))
    G = np.linalg.pinv(k * np.column_stack([-SKY, np.ones(8)]))

    wanted = math.sqrt(np.trace((G @ joint @ G.T)[:3, :3]))
    assert two_stage_velocity_mps(model, loop, 40.0, SKY, CARRIER_HZ) == pytest.approx(wanted, rel=1e-9)


def test_one_stage_does_not_depend_on_the_axes_and_gains_from_satellites() -> None:
    loop, turn = loop_of(1e-3), linalg.expm(np.cross(np.eye(3), [0.3, -0.5, 1.1]))
    whole = one_stage_model(INS_ERROR, 1.0, CARRIER_HZ, SKY)
    turned = one_stage_model(INS_ERROR, 1.0, CARRIER_HZ, SKY @ turn.T)
    fewer = one_stage_model(INS_ERROR, 1.0, CARRIER_HZ, SKY[:5])

    rms = [phase_threshold(model, loop).cn0_dbhz for model in (whole, turned, fewer)]
    assert rms[1] == pytest.approx(rms[0], abs=1e-6)
    assert rms[2] > rms[0] + 0.1
    block = phase_covariance(turned, loop, 40.0)[VELOCITY, VELOCITY]
    wanted = turn @ phase_covariance(whole, loop, 40.0)[VELOCITY, VELOCITY] @ turn.T
    np.testing.assert_allclose(block, wanted, atol=1e-9 * np.trace(wanted))


def plane_of(count: int) -> Float64:
    """Return directions on a cone about the vertical, which does not part height and clock."""
    return directions(np.linspace(0.0, 300.0, count), 30.0)


@pytest.mark.parametrize(
    ("key", "call"),
    [
        ("cn0_dbhz", lambda: phase_rms_rad(models_of(0.3, 1.0)["two_stage"], loop_of(1e-3), -10.5)),
        ("cn0_dbhz", lambda: phase_rms_rad(models_of(0.3, 1.0)["two_stage"], loop_of(1e-3), math.nan)),
        ("directions", lambda: one_stage_model(INS_ERROR, 1.0, CARRIER_HZ, SKY[:3])),
        ("directions", lambda: one_stage_model(INS_ERROR, 1.0, CARRIER_HZ, plane_of(6))),
        ("directions", lambda: one_stage_model(INS_ERROR, 1.0, CARRIER_HZ, 2.0 * SKY)),
        ("directions", lambda: one_stage_model(INS_ERROR, 1.0, CARRIER_HZ, SKY[:, :2])),
        ("model", lambda: velocity("one_stage", models_of(0.3, 1.0)["two_stage"], loop_of(1e-3), 40.0)),
        ("model", lambda: velocity("two_stage", models_of(0.3, 1.0)["one_stage"], loop_of(1e-3), 40.0)),
        ("drift", lambda: channel_model(INS_ERROR, 0.0, CARRIER_HZ)),
        ("sigma_mps2", lambda: UnknownAcceleration(-1.0, 1.0)),
        ("time_s", lambda: UnknownAcceleration(1.0, 0.0)),
        ("white_mps2", lambda: UnknownAcceleration(1.0, 1.0, math.inf)),
        ("A", lambda: PhaseModel(np.eye(3), np.eye(3), np.eye(2), np.eye(1, 3))),
        ("Q", lambda: PhaseModel(np.eye(3), math.nan * np.eye(3), np.eye(3), np.eye(1, 3))),
        ("H", lambda: steady_covariance(np.zeros((2, 2)), np.eye(2), np.eye(1, 2), 1.0)),
    ],
)  # fmt: skip
def test_bad_input_is_refused_with_its_key(key: str, call: object) -> None:
    with pytest.raises(ConfigError) as refused:
        call()  # type: ignore[operator]

    assert refused.value.key == key
    assert refused.value.advice


def test_receiver_that_cannot_lose_lock_is_refused() -> None:
    model = channel_model(UnknownAcceleration(0.0, 1.0), 1e-12, CARRIER_HZ)

    with pytest.raises(ConfigError, match="no threshold"):
        phase_threshold(model, loop_of(1.0))
