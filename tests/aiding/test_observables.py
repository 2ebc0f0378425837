"""The predicted observables against finite differences of the true range, and what must matter in them."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from insgnss.aiding.table import AidingTable, compute_aiding
from insgnss.aiding.trace import TraceSamples
from insgnss.constants import C_MPS, NS_PER_S, WGS84_OMEGA_RADPS
from insgnss.gnss.line_of_sight import line_of_sight
from insgnss.gnss.signals import wavelength_m
from insgnss.simulation.constellation import satellite_states
from insgnss.simulation.trajectory import Trajectory
from tests.aiding.exact import (
    LEVER_B,
    ExactRun,
    angular_acceleration,
    correlated_covariance,
    derivative,
    exact_run,
    grid,
    one_covariance,
    setup,
    sky_arcs,
    spinning,
    true_derivatives,
    true_range,
    turning,
    with_clock,
)
from tests.runs.scenes import START_NS, WEEK, paper_sky

TURNING_S = grid(np.array([3.1234, 11.7771, 14.0313, 20.5557, 33.3333, 47.1119]))
SPINNING_S = grid(np.array([1.0037, 1.0111, 1.0179, 1.0533, 2.2041, 3.3089]))
NOTHING = (0.0, 0.0, 0.0)


def aided(run: ExactRun, lever_b: tuple[float, float, float] = LEVER_B, **changes: object) -> AidingTable:
    """Return the aiding of an exact run."""
    covariances = one_covariance(run, correlated_covariance())
    return compute_aiding(setup(lever_b, **changes), sky_arcs(), run.trace, run.imu, covariances)


def by_satellite(table: AidingTable, values: np.ndarray) -> np.ndarray:
    """Return values of a table with all satellites as (n, s)."""
    return values.reshape(len(table.t_ns), len(table.sv_names))


@pytest.mark.parametrize(
    ("motion", "t_s"),
    [(turning(), TURNING_S), (spinning(), SPINNING_S)],
    ids=["turning", "spinning at 1000 deg/s"],
)
def test_exact_state_gives_the_derivatives_of_the_true_range(motion: Trajectory, t_s: np.ndarray) -> None:
    table = aided(exact_run(motion, t_s))
    rate, acceleration, jerk = true_derivatives(motion, t_s, LEVER_B)

    # the pieces hold the orbits to 1e-8 m/s; the rest is rounding, of the acceleration to 32 bits
    np.testing.assert_allclose(by_satellite(table, table.values.range_rate), rate, atol=1e-7, rtol=0.0)
    np.testing.assert_allclose(
        by_satellite(table, table.values.acceleration), acceleration, atol=2e-5, rtol=1.2e-7
    )
    # w'' x l is left out: up to 0.3 m/s^3 at the ends of the turns; the differences leave 2e-3 m/s^3 of rounding and
    # h^2 w^5 l / 4, 1e-3 of the spin's jerk
    third = np.linalg.norm(derivative(partial(angular_acceleration, motion), t_s, 2.0**-10), axis=1)
    left_out = np.linalg.norm(LEVER_B) * third[:, None]
    error = np.abs(by_satellite(table, table.values.jerk) - jerk)
    assert (error <= left_out + 5e-3 + 1e-3 * np.abs(jerk).max()).all()


def test_jerk_of_the_imu_itself_is_that_of_the_true_range() -> None:
    table = aided(exact_run(turning(), TURNING_S), NOTHING)
    _, _, jerk = true_derivatives(turning(), TURNING_S, NOTHING)

    # rounding of the differences, 2e-3 m/s^3
    np.testing.assert_allclose(by_satellite(table, table.values.jerk), jerk, atol=1e-2, rtol=0.0)
    assert np.abs(jerk).max() > 0.5


def test_pseudorange_is_the_true_range_and_both_clocks() -> None:
    run = with_clock(exact_run(turning(), TURNING_S), 90_000.0, 50.0)
    table = aided(run)
    rho = true_range(turning(), TURNING_S, LEVER_B)
    sent_s = (TURNING_S[:, None] - rho / C_MPS).astype(np.float64)
    clock = satellite_clocks(sent_s)

    predicted = by_satellite(table, table.values.pseudorange)
    # the clock's cubic is within 1e-8 m, the sum of numbers of 2e7 m rounds at 4e-9 m
    np.testing.assert_allclose(predicted, (rho + 90_000.0 - clock).astype(np.float64), atol=5e-7, rtol=0.0)


def satellite_clocks(sent_s: np.ndarray) -> np.ndarray:
    """Return satellite clock less group delay [m] by the simulation's own code."""
    eph = paper_sky().ephemerides
    return C_MPS * (satellite_states(eph, START_NS, sent_s).clock_s - eph.group_delay_s[:, 0])


def test_range_rate_is_that_of_the_filters_measurement_model() -> None:
    run = exact_run(turning(), TURNING_S[:1])
    table = aided(run, NOTHING)
    rho = true_range(turning(), TURNING_S[:1], NOTHING)
    sat = satellite_states(paper_sky().ephemerides, START_NS, (TURNING_S[0] - rho / C_MPS).astype(np.float64))
    states = np.concatenate([sat.r_e[0], sat.v_e[0]], axis=1)
    u, g = np.zeros(3), np.zeros(3)
    expected = [
        line_of_sight(states, k, run.trace.r_e[0], run.trace.v_e[0], u, g)[1] for k in range(len(states))
    ]

    np.testing.assert_allclose(table.values.range_rate, expected, atol=1e-8, rtol=0.0)


def test_doppler_has_the_sign_of_rinex_and_the_clocks_as_asked() -> None:
    run = with_clock(exact_run(turning(), TURNING_S), 0.0, 50.0)
    inside = aided(run).columns(WEEK)
    outside = aided(run, receiver_clock=False).columns(WEEK)
    wavelength = wavelength_m("G", "C1C")

    np.testing.assert_allclose(inside["range_rate_mps"], outside["range_rate_mps"], rtol=0.0, atol=0.0)
    # a clock that gains 50 m/s makes ranges grow: Doppler falls by 263 Hz
    np.testing.assert_allclose(inside["doppler_hz"] - outside["doppler_hz"], -50.0 / wavelength, atol=1e-9)
    closing = inside["range_rate_mps"] < -100.0
    assert closing.any()
    assert (outside["doppler_hz"][closing] > 0.0).all()
    np.testing.assert_allclose(
        inside["doppler_rate_hz_per_s"], -inside["range_acceleration_mps2"] / wavelength, rtol=2e-7
    )
    np.testing.assert_allclose(
        inside["code_delay_rate_s_per_s"], -wavelength * inside["doppler_hz"] / C_MPS, rtol=1e-12
    )


def test_lever_arm_terms_matter_at_high_roll_rate() -> None:
    run = exact_run(spinning(), SPINNING_S)
    with_lever, without = aided(run), aided(run, NOTHING)
    rate = np.abs(with_lever.values.range_rate - without.values.range_rate).max()
    acceleration = np.abs(with_lever.values.acceleration - without.values.acceleration).max()
    w, arm = np.radians(1000.0), np.hypot(LEVER_B[1], LEVER_B[2])

    # omega x l: 20.4 m/s, omega x (omega x l): 356 m/s^2, seen along lines of sight up to 60 deg off
    assert 0.5 * w * arm < rate <= 1.01 * w * arm
    assert 0.5 * w * w * arm < acceleration <= 1.01 * w * w * arm


def test_angular_acceleration_matters_when_the_roll_begins() -> None:
    run = exact_run(turning(), TURNING_S)
    flat = ExactRun(run.trace, run.imu._replace(w_ib_b=np.repeat(run.imu.w_ib_b[2::3], 3, axis=0)))

    difference = np.abs(aided(run).values.acceleration - aided(flat).values.acceleration)

    # at the ends of a turn the roll rate changes by some 0.1 rad/s^2: 0.1 m/s^2 at 1 m
    assert difference.max() > 0.01


def test_zero_lever_arm_reduces_to_the_motion_of_the_imu() -> None:
    run = exact_run(spinning(), SPINNING_S)
    still = ExactRun(run.trace, run.imu._replace(w_ib_b=np.zeros_like(run.imu.w_ib_b)))
    turning_body, still_body = aided(run, NOTHING), aided(still, NOTHING)

    np.testing.assert_array_equal(turning_body.values.range_rate, still_body.values.range_rate)
    np.testing.assert_array_equal(turning_body.values.acceleration, still_body.values.acceleration)


def test_zero_rotation_reduces_to_a_shifted_imu() -> None:
    run = exact_run(turning(), TURNING_S)
    still = run.imu._replace(w_ib_b=np.zeros_like(run.imu.w_ib_b))
    shift = run.trace.C_eb @ np.array(LEVER_B)
    # a body that does not turn in inertial space: its antenna has the IMU's inertial velocity
    moved_v = run.trace.v_e - WGS84_OMEGA_RADPS * np.column_stack(
        [-shift[:, 1], shift[:, 0], 0.0 * shift[:, 0]]
    )
    moved = run.trace._replace(r_e=run.trace.r_e + shift, v_e=moved_v)
    lever = aided(ExactRun(run.trace, still))
    none = aided(ExactRun(moved, still), NOTHING)

    np.testing.assert_allclose(lever.values.range_rate, none.values.range_rate, atol=1e-9, rtol=0.0)
    # gravity's gradient over 1.4 m
    np.testing.assert_allclose(lever.values.acceleration, none.values.acceleration, atol=1e-5, rtol=0.0)


def sampled_errors(lever_b: tuple[float, float, float], slope_samples: int) -> tuple[float, float]:
    """Return the worst error of acceleration and rate that perfect samples at 200 Hz leave in a turn's beginning."""
    edges = 11.0 + 0.005 * np.arange(1001)
    increments = turning().increments(edges)
    t_ns = START_NS + np.rint(edges[1:] * NS_PER_S).astype(np.int64)
    imu = TraceSamples(t_ns, increments.mean_rate(), increments.mean_specific_force())
    k = np.arange(20, 1000, 10)
    exact = exact_run(turning(), edges[1:][k])
    truth = aided(exact, lever_b).values
    sampled = ExactRun(exact.trace._replace(sample=k), imu)
    found = aided(sampled, lever_b, slope_samples=slope_samples).values
    acceleration = np.abs(found.acceleration - truth.acceleration).max()
    return float(acceleration), float(np.abs(found.range_rate - truth.range_rate).max())


def test_samples_are_carried_to_the_end_of_their_interval() -> None:
    acceleration, rate = sampled_errors(NOTHING, 1)

    # a mean is half an interval old: 2.5 ms of 1.3 m/s^3 would be 3e-3 m/s^2; what is left is the curvature
    assert acceleration < 1e-4
    assert rate == 0.0


def test_slope_of_more_samples_is_older_in_proportion() -> None:
    errors = np.array([sampled_errors(LEVER_B, n)[0] for n in (1, 2, 10)])

    # the angular acceleration of (D + dt) / 2 ago, (n + 1) / 2 intervals, times the lever arm
    np.testing.assert_allclose(errors / errors[0], [1.0, 1.5, 5.5], rtol=0.02)


def test_a_gap_in_the_samples_gives_no_slope_across_it() -> None:
    run = exact_run(turning(), TURNING_S[:1])
    t_ns = run.imu.t_ns.copy()
    t_ns[:2] -= NS_PER_S
    gap = aided(ExactRun(run.trace, run.imu._replace(t_ns=t_ns)))
    whole = aided(run)

    assert np.isfinite(gap.values.acceleration).all()
    # the jerk is that of the turning alone; its sigma says so
    assert (gap.sigma[:, 3] == np.float32(5.0)).all()
    assert (whole.sigma[:, 3] != np.float32(5.0)).all()


def test_values_hold_at_the_time_of_use() -> None:
    t_s = np.array([14.0313, 20.5557])
    lag = 0.02
    table = aided(exact_run(turning(), t_s), latency_s=lag)
    now = aided(exact_run(turning(), t_s + lag)).columns(WEEK)
    used = table.columns(WEEK)

    np.testing.assert_allclose(used["time_s"], now["time_s"], atol=1e-6)
    assert (used["age_s"] == lag).all()
    # left over: half the jerk, up to 10 m/s^3, times the square of the latency
    np.testing.assert_allclose(used["range_rate_mps"], now["range_rate_mps"], atol=0.5 * 10.0 * lag**2)
    np.testing.assert_allclose(
        used["pseudorange_m"] - now["pseudorange_m"], 0.0, atol=10.0 * lag**3 / 6.0 + 1e-6
    )
