"""Errors of the inertial sensors that grow with what they measure: constants of a sensor, shown by what changes.

    w_measured = w + b_g + (K_g + M_g) w + G f + noise,    f_measured = f + b_a + (K_a + M_a) f + noise

with K diagonal (scale factors), M off the diagonal (misalignments of each axis against the other two) and G full (what
specific force does to the gyros). A block is there where the grade has a number for it and the settings want it.
"""

from __future__ import annotations

from functools import partial
from typing import Final

from insgnss.constants import STANDARD_GRAVITY_MPS2
from insgnss.filter.layout import Coupling, StateBlock, diagonal
from insgnss.filter.states.wanted import StateInputs
from insgnss.inertial.sensor_model import UNIT_OF_ERROR
from insgnss.units import deg_per_h_to_radps

_AXES: Final = "xyz"


def _across(sensor: str) -> tuple[Coupling, ...]:
    """Return the couplings of misalignments: each axis of a sensor in proportion to what the other two measure."""
    letter = "w" if sensor == "gyro" else "f"
    return tuple(Coupling(sensor, i, f"{letter}_{j}") for i in _AXES for j in _AXES if i != j)


_OF_FORCE: Final = tuple(Coupling("gyro", i, f"f_{j}") for i in _AXES for j in _AXES)
_COUPLES: Final = {
    "gyro_scale_factor": diagonal("gyro"),
    "gyro_misalignment": _across("gyro"),
    "gyro_g_sensitivity": _OF_FORCE,
    "accel_scale_factor": diagonal("accelerometer"),
    "accel_misalignment": _across("accelerometer"),
}
_SI: Final = {
    "ppm": 1e-6,
    "mrad": 1e-3,
    "deg_per_h_per_g": deg_per_h_to_radps(1.0) / STANDARD_GRAVITY_MPS2,
}


def _block(name: str, wanted: StateInputs) -> StateBlock | None:
    """Return the states of a kind of error, None where the grade has none of it or the settings do not want it."""
    unit = UNIT_OF_ERROR[name]
    sigma = float(getattr(wanted.grade, f"{name}_{unit}"))
    if not (sigma > 0.0 and name in wanted.config.process.sensor_error_states):
        return None
    columns = tuple(_column(name, one, unit) for one in _COUPLES[name])
    return StateBlock(
        name,
        columns,
        unit,
        sigma,
        couples=_COUPLES[name],
        si_per_unit=_SI[unit],
        shown=wanted.config.process.sensor_error_columns,
    )


def _column(name: str, one: Coupling, unit: str) -> str:
    """Return a state's column in ``nav``: its axis, then that of what it is proportional to where that may differ."""
    axes = one.axis if name.endswith("scale_factor") else one.axis + one.times[-1]
    return f"{name}_{axes}_{unit}"


SENSOR_ERRORS: Final = tuple(partial(_block, name) for name in _COUPLES)
