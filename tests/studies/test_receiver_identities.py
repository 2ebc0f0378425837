"""One stage against a scalar Kalman loop, and against a dense filter that takes all observations at once."""

from __future__ import annotations

import copy

import numpy as np
import pytest

from insgnss.filter.rows.replica_offset import COLUMNS
from insgnss.filter.state import BA, CLOCK, DR, DRIFT, DV, OFFSETS, copy_bank, new_bank
from insgnss.filter.update.closed_loop import close_loop
from insgnss.gnss.line_of_sight import line_of_sight
from insgnss.simulation.closed_loop_sky import told_motion
from insgnss.simulation.oscillator import clock_densities
from insgnss.studies.receiver.imu import UnknownMotion
from insgnss.studies.receiver.interval_noise import disturbed_states
from insgnss.studies.receiver.loop import lead_filter, run_receiver
from insgnss.studies.receiver.runs import channel_room, new_found
from insgnss.studies.receiver.variants import (
    STARTS,
    VARIANTS,
    TrueStart,
    feeling_nothing,
    filter_room,
    oscillator_of,
    receiver_of,
    without_ins,
)
from insgnss.studies.receiver.workspace import AidingInputs, FilterRoom, ReceiverDesign, SignalArrivals
from insgnss.tracking.vector_loop import (
    N_SEEN,
    RANGE_VARIANCE,
    RATE_VARIANCE,
    SEEN_RANGE,
    SEEN_RATE,
    channels_of,
    levels_of,
    noise_count,
    observe_channels,
)
from tests.studies.test_receiver_study import LOW, setting

T, COUNT, CARRIER_HZ, DRIFT_DENSITY = 5e-3, 400, 1.6e9, 100.0
USER = np.array([2.8e6, 1.6e6, 5.5e6])
TOWARDS = np.array([0.3, -0.5, 0.8]) / np.sqrt(0.98)
ANY = (1e9, 1e9, 0)  # nothing is ever lost
UNKNOWN = UnknownMotion(5.0, 3.0)


def one_satellite() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a satellite that stands above a user who stands, so far away that its direction stays."""
    satellites = np.zeros((COUNT, 1, 6))
    satellites[:, :, :3] = USER + 1e8 * TOWARDS
    distance, rate = line_of_sight(satellites[0], 0, USER, np.zeros(3), np.zeros(3), np.zeros(3))
    return satellites, np.full((COUNT, 1), distance), np.full((COUNT, 1), rate)


def kalman_loop(receiver: ReceiverDesign, drift_density: float) -> ReceiverDesign:
    """Return a channel's own filter with the steps of the navigation filter.

    Equation: F = [1 T T^2/2; 0 1 T; 0 0 exp(-T / tau)], W = F Q/2 F^T + Q/2, Q = diag(0, S, 2 sigma^2 / tau) T
    """
    F = np.array([[1.0, T, 0.5 * T * T], [0.0, 1.0, T], [0.0, 0.0, np.exp(-T / UNKNOWN.time_s)]])
    Q = T * np.diag([0.0, drift_density, 2.0 * UNKNOWN.sigma**2 / UNKNOWN.time_s])
    return receiver._replace(F=F, walk=np.ascontiguousarray(0.5 * (F @ Q @ F.T + Q)))


def along(f: FilterRoom, satellite: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return range, rate and acceleration along the line of sight, (3,), and their covariance."""
    m, u, g = f.state[0], np.zeros(3), np.zeros(3)
    distance, rate = line_of_sight(satellite, 0, m.r_e, m.v_e, u, g)
    H = np.zeros((3, OFFSETS))
    H[0, DR : DR + 3], H[0, CLOCK] = -u, 1.0
    H[1, DR : DR + 3], H[1, DV : DV + 3], H[1, DRIFT] = g, -u, 1.0
    H[2, BA : BA + 3] = u  # the bias of an inertial system that feels nothing is minus the acceleration
    return np.array([distance + m.clock[0], rate + m.clock[1], u @ m.b_a]), H @ f.P @ H.T


@pytest.mark.parametrize("tracking", ["coherent", "noncoherent"])
def test_one_stage_with_one_satellite_and_no_ins_is_a_scalar_kalman_loop(tracking: str) -> None:
    rng = np.random.default_rng(31)
    satellites, ranges, rates = one_satellite()
    channels, oscillator = (
        channels_of(tracking, T, CARRIER_HZ, 1.022e6),
        oscillator_of(DRIFT_DENSITY, CARRIER_HZ),
    )
    at, start = TrueStart(USER, np.zeros(3), np.eye(3), 0.0, 0.0, np.zeros(3)), STARTS[tracking]
    f = filter_room(without_ins(UNKNOWN), oscillator, start, at, rng, False)
    density = clock_densities(oscillator)[1]
    one, alone = (
        receiver_of(VARIANTS[name], T, 20, density, UNKNOWN, ANY, 1, 0) for name in ("one_stage", "scalar")
    )
    alone = kalman_loop(alone, density)
    rooms = [channel_room(each, ranges[0], rates[:2], start, rng, T) for each in (one, alone)]
    rooms[1].x[0], rooms[1].P[0] = along(f, satellites[0])
    level = np.full((COUNT, 1), levels_of(35.0))
    told = AidingInputs(satellites, *vars(feeling_nothing(USER, COUNT)).values(), level, np.zeros((COUNT, 2)))
    noise = rng.standard_normal((COUNT, 1, noise_count(channels)))
    arriving = SignalArrivals(ranges, rates, level, np.zeros((COUNT, 1)))
    for receiver, room in zip((one, alone), rooms, strict=True):
        found = new_found(receiver, COUNT, 1, COUNT)
        run_receiver(receiver, channels, arriving, told, f, room, noise, found)
    estimate, P = along(f, satellites[0])

    # ranges of 1e8 m are rounded to 1.5e-8 m; the Earth's turn and the gradient of gravity, which a scalar loop does
    # not know, come in with the square of (7e-5 rad/s) x (2 s) and with 2e-6 m/s^2 per metre
    tolerance_m = {"coherent": 2e-7, "noncoherent": 2e-5}[tracking]
    assert estimate[0] == pytest.approx(rooms[1].x[0, 0], abs=tolerance_m)
    assert estimate[1] == pytest.approx(
        rooms[1].x[0, 1], abs=10.0 * tolerance_m
    )  # within a tenth of a second
    assert P[:2, :2] == pytest.approx(rooms[1].P[0, :2, :2], rel=1e-6)
    assert np.diag(P)[:2] == pytest.approx(np.diag(rooms[1].P[0])[:2], rel=1e-7)


@pytest.mark.parametrize("tracking", ["coherent", "noncoherent"])
def test_one_stage_is_a_filter_that_takes_all_its_observations_at_once(tracking: str) -> None:
    of, count, rng = setting(tracking, True, DRIFT_DENSITY), 120, np.random.default_rng(32)
    truth, channels, step_s = of.truth, of.channels, of.truth.step_s
    assert of.inertial is not None
    motion = told_motion(of.inertial, truth, LOW, rng, 0.0)
    begin = TrueStart(truth.r_e[0], truth.v_e[0], truth.C_eb[0], 3.0, -2.0, np.zeros(3))
    f = filter_room(LOW, oscillator_of(DRIFT_DENSITY, CARRIER_HZ), STARTS[tracking], begin, rng, True)
    bank = new_bank(1, 0)._replace(state=f.state, P=f.P[None])
    dense = copy.deepcopy(f)._replace(state=copy_bank(bank).state)
    receiver = receiver_of(VARIANTS["one_stage"], step_s, 20, 1.0, None, ANY, 1, 0)
    ranges, rates = truth.ranges[:count] + 3.0, truth.rates[:count] - 2.0
    m = ranges.shape[1]
    level = np.full((count, m), levels_of(38.0))
    exact = np.zeros((count, 6))  # replicas as the filter predicts them
    told = AidingInputs(
        truth.satellites[:count],
        motion.rate_b[:count],
        motion.force_b[:count],
        exact,
        level,
        np.zeros((count, 2)),
    )
    noise = rng.standard_normal((count, m, noise_count(channels)))
    room = channel_room(receiver, ranges[0], rates[:2], STARTS[tracking], rng, step_s)
    arriving = SignalArrivals(ranges, rates, level, np.zeros((count, m)))
    run_receiver(receiver, channels, arriving, told, f, room, noise, new_found(receiver, count, m, count))
    for k in range(count):
        if k:
            lead_filter(dense, told.rate_b[k], told.force_b[k], step_s, np.zeros(2))
        take_at_once(dense, channels, truth.satellites[k], ranges[k], rates[k], level[k], noise[k])
    a, b = f.state[0], dense.state[0]

    assert a.r_e == pytest.approx(b.r_e, abs=1e-7)  # 6e6 m are rounded to 1e-9 m, 120 times
    # ranges of 2.5e7 m are rounded to 4e-9 m, which over 5 ms are 7e-7 m/s of a phase's rate
    assert a.v_e == pytest.approx(b.v_e, abs=2e-7)
    assert a.C_eb == pytest.approx(b.C_eb, abs=5e-8)  # and over forces of 50 m/s^2 and a second, angles
    assert a.clock == pytest.approx(b.clock, abs=1e-7)
    scale = np.sqrt(np.outer(np.diag(f.P), np.diag(f.P)))
    assert np.abs((f.P - dense.P) / scale).max() < 1e-7


def take_at_once(f: FilterRoom, channels, satellites, ranges, rates, level, noise) -> None:  # type: ignore[no-untyped-def]
    """Update a filter by one matrix equation: K = P H^T (H P H^T + R)^-1, P <- (I - K H) P (I - K H)^T + K R K^T."""
    m, state, rows, offsets, variances = len(ranges), f.state[0], [], np.zeros((len(ranges), 3)), []
    for c in range(m):
        u, g = np.zeros(3), np.zeros(3)
        distance, rate = line_of_sight(satellites, c, state.r_e, state.v_e, u, g)
        offsets[c, :2] = ranges[c] - distance - state.clock[0], rates[c] - rate - state.clock[1]
        of_range, of_rate = np.zeros((2, OFFSETS))
        of_range[DR : DR + 3], of_range[CLOCK] = -u, 1.0
        of_rate[DR : DR + 3], of_rate[DV : DV + 3], of_rate[DRIFT] = g, -u, 1.0
        rows.append((of_range, of_rate))
        variances.append(channels.table[level[c], [RANGE_VARIANCE, RATE_VARIANCE]])
    seen = np.zeros((m, N_SEEN))
    observe_channels(channels, level, level, offsets, noise, seen)
    used = np.ravel(variances) > 0.0
    H, R = np.reshape(rows, (-1, OFFSETS))[used], np.diag(np.ravel(variances)[used])
    z = seen[:, [SEEN_RANGE, SEEN_RATE]].ravel()[used]
    K = np.linalg.solve(H @ f.P @ H.T + R, H @ f.P).T
    left = np.eye(OFFSETS) - K @ H
    f.P[:] = left @ f.P @ left.T + K @ R @ K.T
    f.P[:] = 0.5 * (f.P + f.P.T)
    close_loop(state, K @ z, OFFSETS)


def covariances(tracking: str, interval: int, count: int, accelerates: bool) -> list[np.ndarray]:
    """Return P of position, velocity and clock of one stage and of two with the interval's message, in order.

    Seven satellites whose directions stay; motion and clock have no noise, attitude and biases no error. Where the
    vehicle ``accelerates`` channels follow an acceleration too, and P has that of the vehicle: (11, 11), else (8, 8).
    """
    of = setting(tracking, True, DRIFT_DENSITY)
    sight = of.truth.directions(slice(0, 1))[0][:7]
    satellites = np.zeros((count, 7, 6))
    satellites[:, :, :3] = USER + 1e9 * sight
    lines = [line_of_sight(satellites[0], c, USER, np.zeros(3), np.zeros(3), np.zeros(3)) for c in range(7)]
    ranges, rates = (np.tile([line[i] for line in lines], (count, 1)) for i in (0, 1))
    steady = UnknownMotion(1e-12, 1e9)
    grade, oscillator = without_ins(steady), oscillator_of(0.0, CARRIER_HZ)
    start, level = STARTS[tracking], np.full((count, 7), levels_of(43.0))
    aiding = vars(feeling_nothing(USER, count)).values()
    told = AidingInputs(satellites, *aiding, level, np.zeros((count, 2)))
    arriving, found = SignalArrivals(ranges, rates, level, np.zeros((count, 7))), []
    at, states = TrueStart(USER, np.zeros(3), np.eye(3), 0.0, 0.0, np.zeros(3)), [*COLUMNS]
    states += [BA, BA + 1, BA + 2] if accelerates else []
    for name in ("one_stage", "optimal"):
        rng = np.random.default_rng(33)
        disturbed = disturbed_states(not accelerates) if name == "optimal" else ()
        f = filter_room(grade, oscillator, start, at, rng, False, disturbed=disturbed)
        if not accelerates:
            f.P[BA : BA + 3], f.P[:, BA : BA + 3] = 0.0, 0.0
            f.state[0].b_a[:] = 0.0
        unknown = steady if accelerates else None
        receiver = receiver_of(VARIANTS[name], of.channels.step_s, interval, 0.0, unknown, ANY, count, 0)
        room = channel_room(receiver, ranges[0], rates[:2], start, rng, of.channels.step_s)
        noise = rng.standard_normal((count, 7, noise_count(of.channels)))
        run_receiver(
            receiver, of.channels, arriving, told, f, room, noise, new_found(receiver, count, 7, count)
        )
        found.append(f.P[np.ix_(states, states)].copy())
    return found


@pytest.mark.parametrize("tracking", ["coherent", "noncoherent"])
@pytest.mark.parametrize(
    ("interval", "count", "accelerates"),
    [(2, 40, False), (10, 10, False), (10, 50, False), (4, 40, True), (10, 50, True)],
)
def test_receiver_with_messages_of_intervals_knows_as_much_as_one_stage(
    tracking: str, interval: int, count: int, accelerates: bool
) -> None:
    one, two = covariances(tracking, interval, count, accelerates)
    scale = np.sqrt(np.outer(np.diag(one), np.diag(one)))

    # the Earth's turn and the gradient of gravity, which the message does not know, in 0.1 s: (7e-5 rad/s) x (0.1 s)
    assert np.abs((one - two) / scale).max() < {"coherent": 4e-6, "noncoherent": 2e-5}[tracking]
