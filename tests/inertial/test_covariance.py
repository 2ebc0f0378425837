"""The predicted covariance against van Loan's discretisation and the textbook's clock, and what its step costs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from filterpy.common import van_loan_discretization

from insgnss.config.flight import ImuGrade, Oscillator
from insgnss.constants import NS_PER_S, WGS84_GM_M3PS2
from insgnss.filter.prediction import (
    FORCE_DEPARTURE_TIME_S,
    ImuSamples,
    carry,
    new_scratch,
    predict_covariance,
)
from insgnss.filter.state import BA, BG, CLOCK, DR, DRIFT, DV, OFFSETS, PSI, Bank
from insgnss.inertial.clock_model import clock_model
from insgnss.inertial.sensor_model import sensor_model
from insgnss.simulation import sample_trajectories
from tests.inertial.filter_state import NOTHING_UNKNOWN, bank_at, parameters
from tests.inertial.strapdown import EARTH, even_edges, skew

TACTICAL = ImuGrade(
    gyro_bias_deg_per_h=1.0,
    gyro_bias_instability_deg_per_h=0.3,
    gyro_correlation_time_s=1000.0,
    gyro_arw_deg_per_sqrt_h=0.1,
    accel_bias_mg=1.0,
    accel_bias_instability_mg=0.1,
    accel_correlation_time_s=1000.0,
    accel_vrw_mps_per_sqrt_h=0.06,
)
TCXO = Oscillator(h0_s=2e-19, h_minus2_per_s=2e-20)
PLACE_E = np.array([2.8e6, 1.6e6, 5.5e6])
FORCE_E = np.array([8.0, -3.0, 12.0])
C_EB = np.array([[-0.48, -0.64, 0.6], [0.36, 0.48, 0.8], [-0.8, 0.6, 0.0]])
SIGMA = np.concatenate([np.repeat([3.0, 0.2, 0.01, 0.01, 5e-6], 3), [30.0, 1.0]])


def three(start: int) -> slice:
    """Return the slice of a vector in the error state."""
    return slice(start, start + 3)


def predict(bank: Bank, par: Any, seconds: float, step_s: float) -> np.ndarray:
    """Return the covariance after ``seconds`` in steps, at a place, attitude and specific force that stay."""
    m, P, scratch = bank.state[0], bank.P[0], new_scratch(bank.P.shape[1])
    for _ in range(round(seconds / step_s)):
        m.sum_dt, m.sum_dv, m.sum_C = step_s, FORCE_E * step_s, C_EB * step_s
        m.sum_gyro_q, m.sum_accel_q = par.gyro_density * step_s, par.accel_density * step_s
        predict_covariance(m, P, par, scratch)
    return P


def van_loan(seconds: float, P: np.ndarray) -> np.ndarray:
    """Return the covariance after ``seconds`` of the error equations, written here block by block."""
    sensor, clock = sensor_model(TACTICAL), clock_model(TCXO)
    size = float(np.linalg.norm(PLACE_E))
    u = PLACE_E / size
    F = np.zeros((OFFSETS, OFFSETS))
    F[three(DR), three(DV)] = np.eye(3)
    F[three(DV), three(DR)] = -WGS84_GM_M3PS2 / size**3 * (np.eye(3) - 3.0 * np.outer(u, u))
    F[three(DV), three(DV)] = -2.0 * skew(EARTH)
    F[three(DV), three(PSI)] = -skew(FORCE_E)
    F[three(DV), three(BA)] = F[three(PSI), three(BG)] = -C_EB
    F[three(PSI), three(PSI)] = -skew(EARTH)
    F[three(BA), three(BA)] = -np.eye(3) / sensor.accel_bias.time_s
    F[three(BG), three(BG)] = -np.eye(3) / sensor.gyro_bias.time_s
    F[CLOCK, DRIFT] = 1.0
    density = np.zeros(OFFSETS)
    density[three(DV)], density[three(PSI)] = sensor.accel_density, sensor.gyro_density
    density[three(BA)], density[three(BG)] = sensor.accel_bias.density, sensor.gyro_bias.density
    density[CLOCK], density[DRIFT] = clock.bias_density, clock.drift_density
    Phi, Q = van_loan_discretization(F, np.diag(np.sqrt(density)), seconds)
    return np.asarray(Phi @ P @ Phi.T + Q)


@pytest.mark.parametrize(
    ("sigma", "share"),
    [
        (SIGMA, 1e-6),  # reached 7.5e-7, and 7e-8 in each sigma
        (np.zeros(OFFSETS), 3e-4),  # noise alone: its trapezoid leaves (20 ms / 1 s)^2 / 2
    ],
)
def test_covariance_after_a_second_in_steps_of_20_ms_is_van_loans(sigma: np.ndarray, share: float) -> None:
    par = parameters(TACTICAL, TCXO)
    P = predict(bank_at(C_EB, PLACE_E, np.zeros(3), sigma), par, 1.0, 0.02)

    expected = van_loan(1.0, np.diag(sigma**2))

    # each element as a share of the product of its sigmas
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.max(np.abs(P - expected) / scale) < share


@pytest.mark.parametrize("seconds", [0.1, 1.0, 60.0])
def test_clock_covariance_is_the_textbooks(seconds: float) -> None:
    model = clock_model(TCXO)
    bank = bank_at(C_EB, PLACE_E, np.zeros(3), np.zeros(OFFSETS))
    P = predict(bank, parameters(TACTICAL, TCXO), seconds, 0.02)[CLOCK:, CLOCK:]

    # [S_f t + S_g t^3 / 3, S_g t^2 / 2; S_g t]   [Brown & Hwang 2012, 9.3]
    s_f, s_g, t = model.bias_density, model.drift_density, seconds
    expected = np.array([[s_f * t + s_g * t**3 / 3.0, s_g * t**2 / 2.0], [s_g * t**2 / 2.0, s_g * t]])
    # the trapezoid rule adds S_g t step^2 / 6 to the bias and nothing elsewhere
    expected[0, 0] += s_g * t * 0.02**2 / 6.0
    assert pytest.approx(expected, rel=1e-10, abs=0.0) == P


def test_bias_covariance_stays_what_the_gauss_markov_process_keeps_up() -> None:
    model = sensor_model(TACTICAL)
    sigma = np.zeros(OFFSETS)
    sigma[three(BA)], sigma[three(BG)] = model.accel_bias.sigma, model.gyro_bias.sigma

    P = predict(bank_at(C_EB, PLACE_E, np.zeros(3), sigma), parameters(TACTICAL), 600.0, 0.02)

    assert np.sqrt(np.diag(P)[BA:CLOCK]) == pytest.approx(sigma[BA:CLOCK], rel=1e-9, abs=0.0)


def test_covariance_stays_symmetric_bit_for_bit_and_positive() -> None:
    P = predict(
        bank_at(C_EB, PLACE_E, np.zeros(3), np.append(SIGMA, 20.0)), parameters(TACTICAL, TCXO), 60.0, 0.02
    )

    assert np.array_equal(P, P.T)
    scale = np.sqrt(np.diag(P))
    assert np.linalg.eigvalsh(P / np.outer(scale, scale)).min() > 0.0


def test_covariance_of_no_time_is_what_it_was() -> None:
    bank = bank_at(C_EB, PLACE_E, np.zeros(3), SIGMA)
    predict_covariance(bank.state[0], bank.P[0], parameters(TACTICAL), new_scratch(OFFSETS))

    assert bank.P[0].tolist() == np.diag(SIGMA**2).tolist()


# --- what a longer step of the covariance costs ---------------------------------------------------------------------


@pytest.fixture(scope="module")
def one_minute_of_turns() -> tuple[np.ndarray, ...]:
    """Return samples at 200 Hz and the start of an aircraft's turns of 35 deg of bank."""
    trajectory, edges = sample_trajectories.airborne_turns(60.0), even_edges(60.0, 200.0)
    increments, start = trajectory.increments(edges), trajectory.motion(edges[:1])
    t_ns = np.rint(edges * NS_PER_S).astype(np.int64)
    w, f = increments.mean_rate(), increments.mean_specific_force()
    return (
        t_ns,
        np.concatenate([w[:1], w]),
        np.concatenate([f[:1], f]),
        start.C_eb[0],
        start.r_e[0],
        start.v_e[0],
    )


def carried(log: tuple[np.ndarray, ...], covariance_step_s: float) -> Bank:
    """Return the filter after a minute without measurements, from a state with biases of 1 mg and 10 deg/h."""
    t_ns, w, f, C_eb, r_e, v_e = log
    par = parameters(TACTICAL, TCXO, covariance_step=covariance_step_s)
    bank = bank_at(C_eb, r_e, v_e, SIGMA)
    m = bank.state[0]
    m.b_a[:], m.b_g[:] = 1e-2, 5e-5
    imu = ImuSamples(t_ns, w + 5e-5, f + 1e-2, NOTHING_UNKNOWN)
    carry(m, bank.P[0], 0, 1, int(t_ns[-1]), imu, par, new_scratch(OFFSETS))
    return bank


@pytest.mark.parametrize(
    ("step_s", "sigma_share", "position_m"),
    [
        (0.02, 1e-6, 2e-5),  # reached 8e-7 and 14 um
        (0.05, 3e-6, 6e-5),  # reached 2.3e-6 and 41 um
    ],
)
def test_longer_step_of_the_covariance_changes_neither_sigmas_nor_state(
    one_minute_of_turns: tuple[np.ndarray, ...], step_s: float, sigma_share: float, position_m: float
) -> None:
    fine, coarse = carried(one_minute_of_turns, 0.005), carried(one_minute_of_turns, step_s)

    sigmas = [np.sqrt(np.diag(bank.P[0])) for bank in (fine, coarse)]
    assert sigmas[1] == pytest.approx(sigmas[0], rel=sigma_share, abs=0.0)
    # the state feels the step only where a bias fades: at once for 20 ms instead of four times for 5 ms
    assert np.linalg.norm(coarse.state[0].r_e - fine.state[0].r_e) < position_m
    assert np.linalg.norm(fine.state[0].r_e - one_minute_of_turns[4]) > 1000.0


@pytest.mark.parametrize(("step_s", "sigma_share"), [(0.02, 1e-6), (0.05, 5e-6)])
def test_longer_step_of_the_covariance_costs_little_in_a_roll_of_300_deg_per_s(
    step_s: float, sigma_share: float
) -> None:
    t_ns = np.arange(2001) * 5_000_000
    w = np.tile(np.radians([300.0, 20.0, -10.0]), (2001, 1))
    f = np.column_stack([5.0 + 0.0 * t_ns, 30.0 * np.sin(3e-9 * t_ns), -20.0 * np.cos(2e-9 * t_ns)])
    log = (t_ns, w, f, C_EB, PLACE_E, np.zeros(3))

    fine, coarse = (np.sqrt(np.diag(carried(log, step).P[0])) for step in (0.005, step_s))

    # 6 and 15 deg of roll in a step
    assert coarse == pytest.approx(fine, rel=sigma_share, abs=0.0)


# --- what the samples bring in --------------------------------------------------------------------------------------


def constant(t_ns: np.ndarray, w_b: np.ndarray, f_b: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return a log of constant rates and forces, and a start."""
    w, f = np.tile(w_b, (len(t_ns), 1)), np.tile(f_b, (len(t_ns), 1))
    return t_ns, w, f, C_EB, PLACE_E, np.array([100.0, -50.0, 20.0])


def over(log: tuple[np.ndarray, ...], par: Any, bank: Bank, unknown: np.ndarray = NOTHING_UNKNOWN) -> Bank:
    """Return the filter carried over a log, sums cleared."""
    t_ns, w, f = log[:3]
    carry(
        bank.state[0],
        bank.P[0],
        0,
        1,
        int(t_ns[-1]),
        ImuSamples(t_ns, w, f, unknown),
        par,
        new_scratch(OFFSETS),
    )
    predict_covariance(bank.state[0], bank.P[0], par, new_scratch(OFFSETS))
    return bank


def test_sensor_noise_comes_in_with_its_density_and_the_scale_factors_share() -> None:
    log = constant(np.arange(101) * 1_000_000, np.array([0.3, 0.0, -0.4]), np.array([0.0, 30.0, -40.0]))
    par = parameters(TACTICAL, gyro_scale_density=2e-7, accel_scale_density=3e-6)

    bank = bank_at(*log[3:], np.zeros(OFFSETS))
    bank.state[0].f_mean[:] = [0.0, 0.0, -10.0]

    P = over(log, par, bank).P[0]

    # 0.1 s; |w| = 0.5 rad/s, 30 m/s^2 along y and z more than usual; by way of the attitude 1e-4 of it
    attitude = (par.gyro_density + 2e-7 * 0.25) * 0.1
    apart2 = 2.0 * 30.0**2 * np.mean((1.0 - 0.001 / FORCE_DEPARTURE_TIME_S) ** (2 * np.arange(100)))
    velocity = (par.accel_density + 3e-6 * apart2) * 0.1
    assert np.diag(P)[three(PSI)] == pytest.approx(attitude, rel=1e-3, abs=0.0)
    assert np.diag(P)[three(DV)] == pytest.approx(velocity, rel=1e-3, abs=0.0)


def test_steady_force_brings_no_scale_factor_with_it_as_that_is_in_the_bias() -> None:
    log = constant(np.arange(101) * 1_000_000, np.zeros(3), np.array([0.0, 30.0, -40.0]))
    steady, exact = (
        over(log, parameters(TACTICAL, accel_scale_density=scale), bank_at(*log[3:], np.zeros(OFFSETS)))
        for scale in (3e-6, 0.0)
    )

    assert steady.P.tolist() == exact.P.tolist()
    assert steady.state[0].f_mean.tolist() == [0.0, 30.0, -40.0]


def test_sigma_grows_by_the_density_of_the_motion_that_a_sample_does_not_show() -> None:
    t_ns = np.array([0, 10, 20, 1020, 1030]) * 1_000_000
    log = constant(t_ns, np.zeros(3), np.zeros(3))
    unknown = np.zeros((5, 2))
    unknown[3] = np.radians(20.0) ** 2, 3.0**2

    bank = over(log, parameters(TACTICAL), bank_at(*log[3:], np.zeros(OFFSETS)), unknown)

    # over one second, in free fall: sensor noise is a thousandth
    sigma = np.sqrt(np.diag(bank.P[0]))
    assert sigma[three(DV)] == pytest.approx(3.0, rel=1e-3)
    assert sigma[three(PSI)] == pytest.approx(np.radians(20.0), rel=1e-3)
    # of white noise the position gets 1 / sqrt(3) of velocity times time, and moves on for 10 ms; in steps of an eighth
    # of a second the trapezoid rule adds 1 / (2 * 8^2) of it
    assert sigma[three(DR)] == pytest.approx(3.0 * np.sqrt(1.0 / 3.0 + 0.01 + 0.01**2), rel=1e-2)


def test_known_biases_are_taken_out_of_both_samples_of_an_interval(
    one_minute_of_turns: tuple[np.ndarray, ...],
) -> None:
    t_ns, w, f, *start = one_minute_of_turns
    par = parameters(TACTICAL, accel_bias_time=np.inf, gyro_bias_time=np.inf)
    clean, biased = bank_at(*start, SIGMA), bank_at(*start, SIGMA)
    b_a, b_g = np.array([0.5, -0.3, 0.2]), np.array([0.02, 0.01, -0.03])
    biased.state[0].b_a[:], biased.state[0].b_g[:] = b_a, b_g

    over((t_ns, w, f), par, clean)
    over((t_ns, w + b_g, f + b_a), par, biased)

    # rounding of 50 m/s^2 and 1 rad/s for a minute; a bias left in one of the two samples makes 1 m
    assert biased.state[0].r_e == pytest.approx(clean.state[0].r_e, abs=1e-6)
    assert biased.state[0].C_eb == pytest.approx(clean.state[0].C_eb, abs=1e-12)


@pytest.mark.parametrize(("failed", "kept"), [((1, 0), (BA, BA + 1, BA + 2)), ((0, 1), (BG, BG + 1, BG + 2))])
def test_biases_of_a_sensor_that_has_failed_do_not_return_to_zero(
    one_minute_of_turns: tuple[np.ndarray, ...], failed: tuple[int, int], kept: tuple[int, ...]
) -> None:
    """They are those of a sensor with the same density and an endless correlation time, to the bit."""
    t_ns, w, f, *start = one_minute_of_turns
    par = parameters(TACTICAL)
    endless = {"accel_bias_time": np.inf} if failed[0] else {"gyro_bias_time": np.inf}
    gone, other = bank_at(*start, SIGMA), bank_at(*start, SIGMA)
    for bank in (gone, other):
        bank.state[0].b_a[:], bank.state[0].b_g[:] = [0.5, -0.3, 0.2], [0.02, 0.01, -0.03]
    gone.state[0].failed[:] = failed
    before = np.concatenate([gone.state[0].b_a, gone.state[0].b_g])

    over((t_ns, w, f), par, gone)
    over((t_ns, w, f), parameters(TACTICAL, **endless), other)

    after = np.concatenate([gone.state[0].b_a, gone.state[0].b_g])
    assert set(np.flatnonzero(after == before) + BA) == set(kept)
    np.testing.assert_array_equal(gone.P, other.P)
    np.testing.assert_array_equal(gone.state[0].r_e, other.state[0].r_e)
