"""Antennas on a vehicle as arrays: place, orientation, pattern and obstructions of each."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from insgnss.antenna.gain_pattern import Pattern
from insgnss.kernels.jit import kernel
from insgnss.tables import Bool, Float64, Int8

N_ELEVATIONS: Final = 180  # cells of 1 deg of the raster of what is hidden
N_AZIMUTHS: Final = 360
FARTHEST_DEG: Final = 127  # that far, or more, to an edge of the free sky: the widest an int8 holds
_CELLS_PER_RAD: Final = 180.0 / math.pi


class Installation(NamedTuple):
    """The k antennas of a vehicle, as the kernels read them; no antenna where nothing is known of one."""

    pattern: Pattern  # of all antennas
    C_ab: Float64  # (k, 3, 3) turns body components into those of the antenna
    lever_b: Float64  # (k, 3) IMU to phase centre, body axes [m]
    # (k, 180, 360) angle to the edge of the free sky, negative where the airframe hides it
    clearance_deg: Int8
    is_obstructed: Bool  # (k,) whether anything hides this antenna


def no_antenna() -> Installation:
    """Return the installation of a vehicle without antenna description: nothing is masked."""
    return Installation(
        Pattern(np.zeros(0), np.zeros((0, 3), np.int64), np.zeros((0, 2))),
        np.zeros((0, 3, 3)),
        np.zeros((0, 3)),
        np.zeros((0, N_ELEVATIONS, N_AZIMUTHS), np.int8),
        np.zeros(0, np.bool_),
    )


@kernel(inline=True)
def clearance_at(clearance_deg: Int8, k: int, x: float, y: float, z: float) -> float:
    """Return the angle from (x, y, z), body axes, to the edge of antenna ``k``'s free sky [rad], negative if hidden.

    A direction that is not a number counts as hidden.

    Parameters
    ----------
    clearance_deg : (antennas, 180, 360) cells of one degree: elevation from -90 up, azimuth from forward to the right
    """
    azimuth = math.atan2(y, x)
    if azimuth < 0.0:
        azimuth += 2.0 * math.pi
    elevation = math.atan2(-z, math.sqrt(x * x + y * y))
    if not (math.isfinite(elevation) and math.isfinite(azimuth)):
        return -math.pi
    i = min(int((elevation + 0.5 * math.pi) * _CELLS_PER_RAD), N_ELEVATIONS - 1)
    j = min(int(azimuth * _CELLS_PER_RAD), N_AZIMUTHS - 1)
    return float(clearance_deg[k, i, j] / _CELLS_PER_RAD)
