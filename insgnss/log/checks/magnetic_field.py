"""Unit and axes of a magnetometer that fit the Earth's field.

Of a level vehicle on a known course the field along its axes is known: the horizontal part is declared, and the
vertical part follows from the size F of the readings, whatever their axes are.

    m_b = R_z(-course) (H cos D, H sin D, Z),    Z = +-sqrt(F^2 - H^2)

The field points down north of the dip equator and up south of it.
Neglects: bank and pitch, 0.7 uT a degree where Z is 43 uT; the angle between course and heading, the vehicle's iron.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from insgnss.config.sensors import Magnetometer
from insgnss.geodesy.magnetic_dipole import EARTH_FIELD_UT
from insgnss.log.checks.motion_fit import signed_permutations
from insgnss.log.imu.axes import magnetometer_axes
from insgnss.log.imu.sensor_csv import UT_PER_UNIT
from insgnss.tables import Float64
from insgnss.units import RAD_PER_DEG

_LARGEST_MISFIT: Final = 0.25  # of the field's size: iron, 10 deg of bank and 20 deg of crab
_ALONE: Final = 0.5  # of the misfit of any other axes
_UPRIGHT: Final = 0.3  # of the field's size: a smaller vertical part may be iron and tilt


def fitting_units(config: Magnetometer, total_ut: float) -> list[str]:
    """Return the other units in which readings have the size of the Earth's field."""
    counts = total_ut / UT_PER_UNIT[config.unit]
    return [
        unit
        for unit, factor in UT_PER_UNIT.items()
        if unit != config.unit and EARTH_FIELD_UT[0] < counts * factor < EARTH_FIELD_UT[1]
    ]


def wrong_vertical(level_b: Float64, sign: int) -> str:
    """Return a sentence if the vertical field of level readings (n, 3) has the wrong sign, else nothing."""
    down, total = float(np.median(level_b[:, 2])), float(np.median(np.linalg.norm(level_b, axis=1)))
    if sign == 0 or sign * down >= -_UPRIGHT * total:
        return ""
    way, other = ("up", "down") if down < 0.0 else ("down", "up")
    return f"the vertical field points {way}, {abs(down):.0f} uT; at this place it points {other}: check its axes"


def fitting_axes(config: Magnetometer, level_b: Float64, course: Float64, sign: int) -> str:
    """Return the axes that fit, as text; empty if the declared axes or several others fit.

    Parameters
    ----------
    level_b : (n, 3) readings of a level vehicle in motion, body axes as declared [uT]
    course : (n,) [rad]
    sign : that of the vertical field, 0 where it is not known
    """
    if config.mounting_matrix is not None:
        return ""
    total, H = float(np.median(np.linalg.norm(level_b, axis=1))), config.horizontal_ut
    away = RAD_PER_DEG * config.declination_deg - course
    Z = math.sqrt(max(total**2 - H**2, 0.0))
    maps, misfits = signed_permutations(), []
    for vertical in (Z, -Z) if sign == 0 else (sign * Z,):
        field = np.column_stack([H * np.cos(away), H * np.sin(away), np.full(len(away), vertical)])
        misfits.append([float(np.sqrt(np.mean(np.sum((level_b @ C.T - field) ** 2, axis=1)))) for C in maps])
    misfit = np.min(misfits, axis=0)
    best, second = np.argsort(misfit)[:2]
    if misfit[best] > min(_ALONE * misfit[second], _LARGEST_MISFIT * total) or np.array_equal(
        maps[best], np.eye(3)
    ):
        return ""
    C_bs = maps[best] @ magnetometer_axes(config)
    column = np.argmax(np.abs(C_bs), axis=1)
    names = ["+-"[int(C_bs[row, k] < 0.0)] + "xyz"[k] for row, k in enumerate(column)]
    if np.linalg.det(C_bs) > 0.0:
        return f"axes = {names} fits".replace("'", '"')
    order = ", ".join(names)
    return (
        f"forward, right, down are its {order}, which is left-handed: exchange two names in columns.field, or reverse"
        " one sign in the file"
    )
