"""By how much a sensor's bias may have jumped: by some sigmas of its grade, or as a sensor that fails."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Final, TypeAlias

import numpy as np

from insgnss.config.imu import ImuGrade
from insgnss.constants import STANDARD_GRAVITY_MPS2
from insgnss.filter.setup import FilterSetup
from insgnss.filter.state import BA, BG
from insgnss.inertial.sensor_model import BiasModel, SensorModel, sensor_model
from insgnss.tables import Float64

ACCELEROMETER, GYRO = "accelerometer", "gyro"

WIDEST: Final = 20.0  # sigmas of the grade's bias by which it may have jumped ...
# ... or by so much, whatever the grade: of a sensor that fails the sigma of a sound one says nothing ...
_FAILED: Final = {ACCELEROMETER: 0.3 * STANDARD_GRAVITY_MPS2, GYRO: math.radians(1.0)}  # [m/s^2], [rad/s]
_MOST_TURNED_RAD: Final = math.radians(10.0)  # ... which has not turned the attitude by more than this
_SPARE: Final = (
    1.5  # a jump found with all axes unknown, times this, is the sigma with which it is estimated again
)

Widths: TypeAlias = Mapping[str, Float64]  # of a sensor: (3,) sigmas of the jumps [rad/s] or [m/s^2]


def bias_of(sensor: str, setup: FilterSetup) -> tuple[int, str, BiasModel]:
    """Return the place of a sensor's biases in the error state, their name in the state, and their model."""
    model = _model(setup.grade)
    return (BA, "b_a", model.accel_bias) if sensor == ACCELEROMETER else (BG, "b_g", model.gyro_bias)


@lru_cache(maxsize=8)
def _model(grade: ImuGrade) -> SensorModel:
    """Return the model of a grade: a look back asks for it some hundred times."""
    return sensor_model(grade)


def largest_jump(sensor: str, setup: FilterSetup, since_s: float) -> float:
    """Return the sigma of a jump that happened ``since_s`` ago [rad/s] or [m/s^2]."""
    failed = _FAILED[sensor]
    if sensor == GYRO:
        failed = min(failed, _MOST_TURNED_RAD / max(since_s, 1.0))
    return max(WIDEST * bias_of(sensor, setup)[2].sigma, failed)


def estimated_widths(
    sensor: str, setup: FilterSetup, jumps: Iterable[tuple[Sequence[int], Sequence[float]]]
) -> Float64:
    """Return sigmas (3,) of the jumps that may follow from ``jumps``: the axes that jumped, and by how much all did.

    With every axis as wide as the largest jump the filter would forget the axes that are sound.
    """
    widths = np.full(3, WIDEST * bias_of(sensor, setup)[2].sigma)
    for axes, moved in jumps:
        for axis in axes:
            widths[axis] = max(widths[axis], _SPARE * abs(moved[axis]))
    return widths
