"""Phases that begin from one position: how long the error of that position stays what it was.

Least squares over all phases, and the one-stage receiver itself, at rest and without noise.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from scipy import stats

from insgnss.constants import C_MPS
from insgnss.filter.state import BA, CLOCK, DR, DRIFT, DV
from insgnss.simulation.closed_loop_sky import lines_of_sight, orbits_towards
from insgnss.studies.receiver.imu import UnknownMotion
from insgnss.studies.receiver.loop import run_receiver
from insgnss.studies.receiver.options import AZIMUTH_DEG, ELEVATION_DEG
from insgnss.studies.receiver.runs import channel_room, new_found
from insgnss.studies.receiver.variants import (
    STARTS,
    VARIANTS,
    InitialSigmas,
    TrueStart,
    feeling_nothing,
    filter_room,
    oscillator_of,
    receiver_of,
    without_ins,
)
from insgnss.studies.receiver.workspace import AidingInputs, ReceiverHistory, SignalArrivals
from insgnss.tracking.lock_and_cn0 import SLIP_SHARE
from insgnss.tracking.phase_discriminators import PhaseDiscriminator
from insgnss.tracking.vector_loop import channels_of, levels_of, noise_count

USER = np.array([2.8e6, 1.6e6, 5.5e6])
AFTER_S = 1200.0
OVERHEAD = 8  # the ninth satellite
OFFSET = np.array([0.48, -0.6, 0.64])


@cache
def satellites(at_s: float) -> np.ndarray:
    """Return nine satellites after some time, (9, 6)."""
    sky = orbits_towards(USER, (*AZIMUTH_DEG, 0.0), (*ELEVATION_DEG, 85.0))
    return np.ascontiguousarray(sky.states(np.full((1, 1), at_s))[0])


def ranges(sat: np.ndarray, place: np.ndarray) -> np.ndarray:
    found, rates = np.empty((2, 1, len(sat)))
    lines_of_sight(sat[None], place[None], np.zeros((1, 3)), found, rates)
    return found[0]


def rows(sat: np.ndarray) -> np.ndarray:
    """Return the rows of position and clock, (m, 4)."""
    u = sat[:, :3] - USER
    u /= np.linalg.norm(u, axis=1)[:, None]
    return np.column_stack([-u, np.ones(len(u))])


def pseudo_coordinates(sat: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Return X^P - X (3,) of phases whose ranges are off by ``offsets``, by least squares to its end."""
    x = np.zeros(4)
    for _ in range(5):
        x += np.linalg.lstsq(
            rows(sat), ranges(sat, USER) + offsets - ranges(sat, USER + x[:3]) - x[3], rcond=None
        )[0]
    return x[:3]


def begun_at(offset: np.ndarray) -> np.ndarray:
    """Return what all phases' ranges are off by when they begin from one position that is off by ``offset``."""
    # a clock shifts all alike
    return ranges(satellites(0.0), USER + offset) - ranges(satellites(0.0), USER) + 7.0


def turned_deg() -> float:
    u = [-rows(satellites(t))[:, :3] for t in (0.0, AFTER_S)]
    return float(np.degrees(np.arccos(np.sum(u[0] * u[1], axis=1))).mean())


@pytest.mark.parametrize(("off_m", "moved_m"), [(0.0, 1e-6), (0.004, 1e-3)])
def test_phases_from_a_position_that_is_good_to_millimetres_stay_a_millimetre_for_twenty_minutes(
    off_m: float, moved_m: float
) -> None:
    offsets = begun_at(off_m * OFFSET)
    before, after = (pseudo_coordinates(satellites(t), offsets) for t in (0.0, AFTER_S))

    assert before == pytest.approx(off_m * OFFSET, abs=1e-6)
    assert np.linalg.norm(after - before) < moved_m
    assert turned_deg() > 10.0


def test_phases_from_a_position_off_by_metres_move_by_that_times_the_change_of_direction() -> None:
    offsets = begun_at(5.0 * OFFSET)
    before, after = (pseudo_coordinates(satellites(t), offsets) for t in (0.0, AFTER_S))
    # H^+(t) (H(0) - H(t)) delta: no position explains offsets that were those of another sky
    first, last = rows(satellites(0.0)), rows(satellites(AFTER_S))
    leak = np.linalg.pinv(last) @ (first - last) @ np.append(5.0 * OFFSET, 0.0)

    assert after - before == pytest.approx(leak[:3], abs=1e-4)
    assert 0.02 < np.linalg.norm(after - before) / (5.0 * math.radians(turned_deg())) < 1.0


def test_phases_from_codes_of_their_own_move_by_metres_in_a_degree() -> None:
    rng, moved = np.random.default_rng(51), []
    u = [-rows(satellites(t))[:, :3] for t in (0.0, 60.0)]
    degrees = float(np.degrees(np.arccos(np.sum(u[0] * u[1], axis=1))).mean())
    for _ in range(200):
        offsets = rng.uniform(-50.0, 50.0, 9)
        moved.append(np.subtract(*(pseudo_coordinates(satellites(t), offsets) for t in (60.0, 0.0))))
    found = float(np.mean(np.sum(np.square(moved), axis=1)))
    change = (np.linalg.pinv(rows(satellites(60.0))) - np.linalg.pinv(rows(satellites(0.0))))[:3]
    expected = 50.0**2 / 3.0 * float(np.sum(change**2))
    low, high = stats.chi2.interval(0.999, 200)

    # three axes of which one is most of it: a draw is one look
    assert low < 200 * found / expected < high
    assert 0.5 < math.sqrt(expected) / degrees < 5.0


def test_rising_satellite_begins_from_pseudo_coordinates_without_a_jump_and_from_its_code_with_one() -> None:
    offsets, late = begun_at(5.0 * OFFSET), satellites(AFTER_S)
    old = np.delete(np.arange(9), OVERHEAD)
    before = pseudo_coordinates(late[old], offsets[old])
    # with the clock that belongs to them: what is left of the ranges at these coordinates
    clock = np.mean(ranges(late, USER)[old] + offsets[old] - ranges(late, USER + before)[old])
    expected = ranges(late, USER + before)[OVERHEAD] + clock - ranges(late, USER)[OVERHEAD]
    own_code = np.insert(offsets[old], OVERHEAD, expected + 10.0)

    assert pseudo_coordinates(late, np.insert(offsets[old], OVERHEAD, expected)) == pytest.approx(
        before, abs=1e-4
    )
    assert np.linalg.norm(pseudo_coordinates(late, own_code) - before) > 1.0


T, CARRIER_HZ, RECORD = 0.02, 1.6e9, 50


@cache
def one_stage_begun_at(off_m: float) -> tuple[np.ndarray, ReceiverHistory, np.ndarray]:
    """Return X^P - X (k, 3) of the receiver a second apart, its history, and its satellites at the end (8, 6)."""
    count, m = round(AFTER_S / T), len(AZIMUTH_DEG)
    sky = orbits_towards(USER, AZIMUTH_DEG, ELEVATION_DEG)
    sat = np.ascontiguousarray(sky.states(np.repeat(T * np.arange(count)[:, None], m, axis=1)))
    true, rates = np.empty((2, count, m))
    lines_of_sight(sat, np.tile(USER, (count, 1)), np.zeros((count, 3)), true, rates)
    place = USER + off_m * OFFSET
    counted = true + ranges(sat[0], place) - ranges(sat[0], USER)  # phases that begin from that place

    channels, oscillator = (
        channels_of("coherent", T, CARRIER_HZ, 1.022e6, phase_kind="atan"),
        oscillator_of(1.0, CARRIER_HZ),
    )
    unknown, rng = UnknownMotion(1e-4, 1e3), np.random.default_rng(52)
    at = TrueStart(place, np.zeros(3), np.eye(3), 0.0, 0.0, np.zeros(3))
    exact = InitialSigmas(*(1e-9,) * 6)
    f = filter_room(without_ins(unknown), oscillator, exact, at, rng, False)
    for first, size, sigma in ((DR, 3, 3.0), (CLOCK, 1, 3.0), (DV, 3, 0.01), (DRIFT, 1, 0.01), (BA, 3, 1e-4)):
        for i in range(first, first + size):
            f.P[i, i] = sigma**2
    receiver = receiver_of(VARIANTS["one_stage"], T, 5, 1.0, unknown, (1e9, 1e9, 0), RECORD, 0)
    room = channel_room(receiver, counted[0], rates[:2], STARTS["coherent"], rng, T)
    level, found = np.full((count, m), levels_of(70.0)), new_found(receiver, count, m, count)
    told = AidingInputs(sat, *vars(feeling_nothing(USER, count)).values(), level, np.zeros((count, 2)))
    arriving = SignalArrivals(counted, rates, level, np.zeros((count, m)))
    run_receiver(
        receiver, channels, arriving, told, f, room, np.zeros((count, m, noise_count(channels))), found
    )
    return found.state[:, :3] - USER, found, sat[-1]


def first_beyond_aperture_s(found: ReceiverHistory) -> float:
    limit = SLIP_SHARE * PhaseDiscriminator("atan").aperture_rad / (2.0 * math.pi * CARRIER_HZ / C_MPS)
    beyond = np.flatnonzero((np.abs(found.offsets[:, :, 0]) > limit).any(axis=1))
    return float(beyond[0]) * T * RECORD if beyond.size else math.inf


def test_one_stage_receiver_moves_as_least_squares_over_its_phases_says() -> None:
    error, found, last = one_stage_begun_at(0.1)
    first = rows(satellites(0.0)[:OVERHEAD])
    leak = np.linalg.pinv(rows(last)) @ (first - rows(last)) @ np.append(0.1 * OFFSET, 0.0)

    assert error[0] == pytest.approx(0.1 * OFFSET, abs=1e-4)
    assert error[-1] - error[0] == pytest.approx(leak[:3], abs=2e-4)
    assert first_beyond_aperture_s(found) == math.inf


def test_phases_of_a_one_stage_receiver_that_begins_metres_off_leave_the_aperture_within_minutes() -> None:
    # what no position explains grows as the satellites move: by 1 mm/s for 5 m, of 35 mm that data bits leave
    assert 30.0 < first_beyond_aperture_s(one_stage_begun_at(5.0)[1]) < 100.0
    assert 150.0 < first_beyond_aperture_s(one_stage_begun_at(1.0)[1]) < 500.0
