"""Error-free flights, whose truth is a spline made without the mechanization: how far it strays by itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from insgnss.simulation import sample_trajectories
from insgnss.simulation.trajectory import Trajectory
from tests.inertial.strapdown import angle_of, even_edges, fly

TEN_MINUTES_S = 600.0


@dataclass(frozen=True)
class Strayed:
    """The largest errors on the way, at each second."""

    position_m: float
    velocity_mps: float
    attitude_rad: float  # at the end


def strayed(
    trajectory: Trajectory, edges_s: np.ndarray, per_second: int, *, corrected: bool = True
) -> Strayed:
    """Return how far the mechanization strays from a trajectory between edges."""
    increments = trajectory.increments(edges_s)
    start, truth = trajectory.motion(edges_s[:1]), trajectory.motion(edges_s[per_second::per_second])
    flown = fly(
        np.diff(edges_s),
        increments.mean_rate(),
        increments.mean_specific_force(),
        start.C_eb[0],
        start.r_e[0],
        start.v_e[0],
        corrected=corrected,
        every=per_second,
    )
    return Strayed(
        float(np.max(np.linalg.norm(flown.r_e - truth.r_e, axis=1))),
        float(np.max(np.linalg.norm(flown.v_e - truth.v_e, axis=1))),
        angle_of(flown.C_eb[-1] @ truth.C_eb[-1].T),
    )


@pytest.fixture(scope="module")
def turns() -> Trajectory:
    return sample_trajectories.level_turns()


@pytest.mark.parametrize(
    ("rate_hz", "limit_m"),
    [
        (100.0, 1e-3),  # reached 0.39 mm
        (200.0, 1e-4),  # reached 0.05 mm: third order
    ],
)
def test_ten_minutes_of_turns_stray_less_than_a_millimetre(
    turns: Trajectory, rate_hz: float, limit_m: float
) -> None:
    errors = strayed(turns, 300.0 + even_edges(TEN_MINUTES_S, rate_hz), round(rate_hz))

    assert errors.position_m < limit_m
    assert errors.velocity_mps < limit_m * 0.01
    assert errors.attitude_rad < 2e-9


def test_take_off_and_climb_stray_less_than_a_tenth_of_a_millimetre(turns: Trajectory) -> None:
    assert strayed(turns, even_edges(300.0, 100.0), 100).position_m < 1e-4


@pytest.mark.parametrize(("rate_hz", "limit_m"), [(50.0, 1e-4), (100.0, 1e-5)])
def test_ten_minutes_over_the_pole_stray_less_than_a_tenth_of_a_millimetre(
    rate_hz: float, limit_m: float
) -> None:
    errors = strayed(sample_trajectories.over_the_pole(), even_edges(TEN_MINUTES_S, rate_hz), round(rate_hz))

    # 250 m/s, straight: gravity and Coriolis alone. Reached 4 um and 1.4 um, which is rounding
    assert errors.position_m < limit_m
    assert errors.attitude_rad < 1e-11


def test_ten_minutes_of_a_cars_corners_stray_less_than_a_tenth_of_a_millimetre() -> None:
    assert strayed(sample_trajectories.car(), even_edges(TEN_MINUTES_S, 100.0), 100).position_m < 1e-4


def test_coning_and_sculling_of_ordinary_turns_must_matter(turns: Trajectory) -> None:
    edges = 300.0 + even_edges(TEN_MINUTES_S, 100.0)

    # 1.4 m without the correction, 0.39 mm with it
    assert strayed(turns, edges, 100, corrected=False).position_m > 1.0


def test_steps_of_2_and_8_ms_by_turns_stray_as_little_as_even_steps(turns: Trajectory) -> None:
    pairs = 300.0 + 0.01 * np.arange(30_001.0)
    uneven = np.sort(np.concatenate([pairs, pairs[:-1] + 0.002]))

    errors = strayed(turns, uneven, 200)

    # 5 minutes: reached 0.044 mm, 8 ms throughout 0.056 mm; without the correction 56 mm
    assert errors.position_m < 1e-4
    assert strayed(turns, uneven, 200, corrected=False).position_m > 0.03
