"""Vehicles with antennas, and the sky of the study of attitude-aware masking, for the tests of this folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from insgnss.antenna.equipment import installation
from insgnss.antenna.installation import Installation
from insgnss.antenna.obstruction import directions
from insgnss.antenna.visibility import VisibilityLimits, look_at_all, new_looks
from insgnss.config.flight import MountedAntenna
from insgnss.runs.visibility import AttitudeHistory
from insgnss.simulation.sky import PAPER_SKY

NO_LIMIT = np.inf  # of the heading's variance
HIDDEN_FIVE = {"G01", "G16", "G30", "G31", "G32"}


def vehicle(*antennas: MountedAntenna | str, folder: Path = Path()) -> Installation:
    """Return the installation of antennas, a level one for each name of a pattern."""
    mounted = [MountedAntenna(pattern=a) if isinstance(a, str) else a for a in antennas]
    return installation(mounted, folder)[0]


def paper_sky(at_s: float) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Return names, azimuths and elevations [deg] of the 11 satellites, by the linear law over 20 minutes."""
    share = at_s / 1200.0
    azimuth = [t.azimuth_deg[0] + share * (t.azimuth_deg[1] - t.azimuth_deg[0]) for t in PAPER_SKY]
    elevation = [t.elevation_deg[0] + share * (t.elevation_deg[1] - t.elevation_deg[0]) for t in PAPER_SKY]
    return tuple(f"G{t.number:02d}" for t in PAPER_SKY), np.array(azimuth), np.array(elevation)


def attitudes(rpy_deg: np.ndarray, sd_deg: float = 0.0, step_s: float = 0.1) -> AttitudeHistory:
    """Return a history at one place, every ``step_s``."""
    rpy = np.radians(np.atleast_2d(np.asarray(rpy_deg, np.float64)))
    n = len(rpy)
    place = np.tile([np.radians(59.97), np.radians(30.32), 1000.0], (n, 1))
    t_ns = 2385 * 604_800 * 10**9 + np.round(np.arange(n) * step_s * 1e9).astype(np.int64)
    return AttitudeHistory.from_rpy(t_ns, rpy, place, np.full((n, 3), np.radians(sd_deg)))


class Decisions:
    """What the stage says of one satellite, or several that stand still, over a history."""

    def __init__(
        self,
        history: AttitudeHistory,
        azimuth_deg: np.ndarray | float,
        elevation_deg: np.ndarray | float,
        antennas: Installation,
        limits: VisibilityLimits,
    ) -> None:
        u = np.atleast_2d(directions(azimuth_deg, elevation_deg))
        n, s = len(history.t_ns), len(u)
        looks = new_looks(n, s, with_doubt=True)
        self.decision, self.reason, self.antenna, self.gain = looks
        u_n = np.repeat(u[None], n, axis=0)
        look_at_all(history.C_nb, history.P_b, u_n, antennas, limits, looks)

    @property
    def visible(self) -> np.ndarray:
        return (self.decision & 1) == 1
