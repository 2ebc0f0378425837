"""From a flight file's antennas to the arrays of the visibility stage."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from insgnss.antenna.gain_pattern import pattern_of
from insgnss.antenna.installation import Installation, no_antenna
from insgnss.antenna.obstruction import clearance_raster, read_obstruction
from insgnss.antenna.pattern_file import read_pattern
from insgnss.antenna.visibility import DEWEIGHT, HIDE, KEEP, VisibilityLimits
from insgnss.config.filter import Visibility
from insgnss.config.flight import MountedAntenna, Vector3
from insgnss.config.library import antenna_file
from insgnss.geodesy.rotations import euler_to_matrix
from insgnss.tables import Event, Float64
from insgnss.units import deg_to_rad

_UNCERTAIN: Final = {"keep": KEEP, "hide": HIDE, "deweight": DEWEIGHT}


def installation(
    antennas: Sequence[MountedAntenna], folder: Path, lever_arm_m: Vector3 | None = None
) -> tuple[Installation, list[Event]]:
    """Return the antennas with their patterns and obstructions read, and the events of the files.

    Parameters
    ----------
    antennas : as the flight file describes them; none gives an installation that masks nothing
    folder : where relative paths start and where the user's own patterns lie
    lever_arm_m : of antennas that give none of their own; zero when None

    Raises
    ------
    ModelError, MissingFileError : there is no such pattern or file
    ConfigError : a pattern or an obstruction file is wrong
    """
    if not antennas:
        return no_antenna(), []
    tables, events = [], []
    for antenna in antennas:
        table, found = read_pattern(antenna_file(antenna.pattern, (folder,)))
        tables.append(table)
        events += found
    hidden = [antenna.obstruction and read_obstruction(folder / antenna.obstruction) for antenna in antennas]
    levers = [antenna.lever_arm_m or lever_arm_m or (0.0, 0.0, 0.0) for antenna in antennas]
    arrays = Installation(
        pattern_of(tables),
        np.stack([mounting(antenna).T for antenna in antennas]).copy(),
        np.array(levers, np.float64),
        np.stack([clearance_raster(obstruction or None) for obstruction in hidden]),
        np.array([obstruction is not None for obstruction in hidden]),
    )
    return arrays, events


def mounting(antenna: MountedAntenna) -> Float64:
    """Return C_ba (3, 3), which turns components along the antenna's axes into those along the body's."""
    if antenna.mounting_matrix is not None:
        return np.array(antenna.mounting_matrix, np.float64)
    C_ba = np.empty((3, 3))
    roll, pitch, yaw = (deg_to_rad(angle) for angle in antenna.mounting_rpy_deg)
    euler_to_matrix(roll, pitch, yaw, C_ba)
    return C_ba


def limits_of(settings: Visibility) -> VisibilityLimits:
    """Return the stage's settings as the kernels read them; a threshold on C/N0 becomes one on gain.

    Equation: predicted C/N0 = nominal C/N0 at 0 dBic + gain. ``on`` and ``use_masked`` are the caller's: they change
    what is done with the decisions, not the decisions.
    """
    threshold = settings.threshold_gain_dbic
    if settings.threshold == "cn0":
        threshold = settings.threshold_cn0_dbhz - settings.nominal_cn0_dbhz
    heading = math.radians(settings.heading_sigma_limit_deg)
    return VisibilityLimits(
        threshold,
        settings.hysteresis_db,
        settings.margin_sigma,
        heading**2,
        _UNCERTAIN[settings.uncertain],
        settings.false_range_m**2,
        settings.false_rate_mps**2,
    )
