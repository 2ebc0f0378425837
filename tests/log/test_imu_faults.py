"""Stuck and saturated axes are told; healthy sensors, coarse or at rest, are not accused."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.log.imu.faults import SensorTriad, fault_events
from tests.log.writing import Float64

NAMES = ("a", "b", "c")
T_NS = np.arange(2000, dtype=np.int64) * 10_000_000


def kinds(columns: Float64, kind: str = "gyro", range_si: float | None = None) -> list[str]:
    axes = SensorTriad(kind, [column.copy() for column in columns.T], NAMES, 1.0, range_si)
    events = fault_events(T_NS, axes, "imu.csv")
    return [event.kind + ":" + event.detail.split("'")[1] for event in events]


@pytest.fixture
def noise(rng: np.random.Generator) -> Float64:
    return rng.normal(0.0, 0.3, (2000, 3))


def test_healthy_axes_give_no_event(noise: Float64) -> None:
    assert kinds(noise) == []


@pytest.mark.parametrize("value", [0.0, 0.123])
def test_axis_that_stands_still_for_a_second_is_stuck(noise: Float64, value: float) -> None:
    noise[500:610, 1] = value
    assert kinds(noise) == ["imu_stuck_axis:b"]


def test_axis_that_is_dead_throughout_is_stuck(noise: Float64) -> None:
    noise[:, 2] = 0.0
    assert kinds(noise) == ["imu_stuck_axis:c"]


def test_short_repetition_is_not_stuck(noise: Float64) -> None:
    noise[500:590, 1] = 0.0
    assert kinds(noise) == []


def test_all_axes_constant_is_a_perfect_rest_and_not_stuck() -> None:
    assert kinds(np.tile([0.0, 0.0, -9.8], (2000, 1)), "accel") == []


def test_values_pinned_at_the_largest_magnitude_are_saturated(noise: Float64) -> None:
    noise[:, 0] = np.clip(20.0 * noise[:, 0], -4.36, 4.36)
    assert kinds(noise) == ["imu_saturated:a"]


def test_values_at_the_declared_range_are_saturated(noise: Float64) -> None:
    noise[100, 1] = -4.4
    assert kinds(noise, range_si=4.363) == ["imu_saturated:b"]
    assert kinds(noise, range_si=8.7) == []


def test_single_peak_is_not_saturated(noise: Float64) -> None:
    noise[100, 1] = 30.0
    assert kinds(noise) == []


def test_three_equal_peaks_alone_are_not_saturated(noise: Float64) -> None:
    noise[100:103, 1] = 30.0
    assert kinds(noise) == []
    noise[200:203, 1] = 30.0
    assert kinds(noise) == ["imu_saturated:b"]


def test_coarse_numbers_at_rest_are_not_saturated(rng: np.random.Generator) -> None:
    coarse = rng.choice([-2.0, 0.0, 2.0], (2000, 3))  # some levels only, each often in a row
    assert not [kind for kind in kinds(coarse) if kind.startswith("imu_saturated")]


def test_steady_fast_spin_is_not_saturated(rng: np.random.Generator) -> None:
    spin = rng.normal((90.0, 0.0, 0.0), 0.01, (2000, 3))
    assert kinds(spin) == []
