"""Frozen and dead sensors are told; coarse ones at rest, and loggers faster than their sensor, are not accused."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.log.imu.faults import SensorTriad, frozen_events
from insgnss.tables import Event
from tests.log.writing import Float64

N = 6000
T_NS = np.arange(N, dtype=np.int64) * 10_000_000  # a minute at 100 Hz
STEP = 0.01  # of the coarse sensors: their noise, a quarter of it, is a few steps in motion and none at rest
GYROS, ACCELS = slice(0, 3), slice(3, 6)


def events(columns: Float64) -> list[Event]:
    sensors = (
        SensorTriad("gyro", list(columns[:, GYROS].T.copy()), ("a", "b", "c"), 1.0, None),
        SensorTriad("accel", list(columns[:, ACCELS].T.copy()), ("d", "e", "f"), 1.0, None),
    )
    return frozen_events(T_NS, sensors, "imu.csv")


def told(columns: Float64) -> list[tuple[str, float]]:
    return [(event.kind, event.t_ns / 1e9) for event in events(columns)]


@pytest.fixture
def moving(rng: np.random.Generator) -> Float64:
    """Return a drive with turns and runs, and noise of 16-bit sensors: some resolution steps."""
    t = T_NS / 1e9
    columns = rng.normal(0.0, [0.03] * 3 + [0.1] * 3, (N, 6))
    columns[:, 2] += 0.3 * np.sin(0.5 * t)
    columns[:, 3] += 1.5 * np.sin(0.3 * t)
    columns[:, 5] -= 9.8
    return np.round(columns / STEP) * STEP


def test_healthy_sensors_give_no_event(moving: Float64) -> None:
    assert told(moving) == []


@pytest.mark.parametrize(
    ("which", "name"), [(GYROS, "gyros"), (ACCELS, "accelerometers"), (slice(0, 6), "six")]
)
def test_sensor_that_holds_its_values_is_told_with_its_span(moving: Float64, which: slice, name: str) -> None:
    moving[2000:3000, which] = moving[2000, which] + 0.2  # so far from what follows
    found = events(moving)
    assert [(event.kind, event.t_ns) for event in found] == [("imu_frozen_sensor", T_NS[2000])]
    assert name in found[0].detail and "for 9.99 s" in found[0].detail


def test_short_hold_is_not_told(moving: Float64) -> None:
    moving[2000:2090] = moving[2000] + 0.2
    assert told(moving) == []


@pytest.mark.parametrize("which", [GYROS, ACCELS])
def test_sensor_that_never_changes_while_the_other_moves_is_dead(moving: Float64, which: slice) -> None:
    moving[:, which] = 0.0
    assert told(moving) == [("imu_dead_sensor", 0.0)]


def test_sensor_that_freezes_to_the_end_is_told_by_the_motion_of_the_other(moving: Float64) -> None:
    """No sample follows from which a leap could be seen."""
    moving[4000:, ACCELS] = moving[4000, ACCELS]
    assert told(moving) == [("imu_frozen_sensor", 40.0)]


def test_fine_sensor_at_rest_that_holds_its_values_is_told(rng: np.random.Generator) -> None:
    """Noise of many digits never repeats itself, at rest neither."""
    columns = rng.normal(0.0, 0.01, (N, 6))
    columns[2000:2200] = columns[2000]
    assert told(columns) == [("imu_frozen_sensor", 20.0)]


@pytest.mark.parametrize("noise_in_steps", [0.0, 0.1, 0.2])
def test_coarse_sensors_that_stop_and_go_are_not_told(
    moving: Float64, rng: np.random.Generator, noise_in_steps: float
) -> None:
    """At rest the noise is less than a step: values stay for seconds, and go on by a step."""
    at_rest = STEP * noise_in_steps * rng.normal(0.0, 1.0, (2000, 6)) + [0.0, 0.0, 0.0, 0.0, 0.0, -9.8]
    moving[1000:3000] = np.round(at_rest / STEP) * STEP
    moving[3000:3010] = moving[2999] + STEP  # it starts off softly
    assert told(moving) == []


def test_coarse_gyros_at_rest_while_the_accelerometers_are_fine_are_not_told(
    rng: np.random.Generator,
) -> None:
    columns = rng.normal(0.0, 0.01, (N, 6))
    # half a step is two sigma: a tenth flickers
    columns[:, GYROS] = np.round(columns[:, GYROS] / 0.04) * 0.04
    assert told(columns) == []
    columns[:, GYROS] = 0.0  # a still coarser one never changes
    assert told(columns) == []


def test_logger_that_repeats_each_sample_is_not_told(moving: Float64) -> None:
    assert told(np.repeat(moving[: N // 2], 2, axis=0)) == []


def test_error_free_sensors_that_turn_steadily_are_not_told() -> None:
    """A simulated spin about down without errors: the accelerometers see gravity alone, the gyros a rate."""
    columns = np.zeros((N, 6))
    columns[:, 2] = np.where(np.arange(N) < N // 2, 0.1, 0.0)
    columns[:, 5] = -9.8
    assert [kind for kind, _ in told(columns) if kind == "imu_dead_sensor"] == []
