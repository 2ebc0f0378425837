"""The signal strength of each satellite at a vehicle's antennas: pattern, mounting, obstructions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from insgnss.antenna.equipment import mounting
from insgnss.antenna.gain_pattern import GainTable
from insgnss.antenna.obstruction import Obstruction, is_inside, read_obstruction
from insgnss.antenna.pattern_file import read_pattern
from insgnss.config.flight import MountedAntenna
from insgnss.config.library import antenna_file
from insgnss.geodesy.directions import angles_of
from insgnss.tables import Float64

HIDDEN_DBIC = -60.0  # behind the airframe: below any receiver's threshold


@dataclass(frozen=True)
class ReceivingAntenna:
    """One antenna: its pattern between the nodes of its file, its orientation, its obstructions."""

    gain: RegularGridInterpolator  # of elevation and azimuth [deg], antenna axes
    C_ba: Float64  # (3, 3)
    obstruction: Obstruction | None

    @classmethod
    def mounted(cls, antenna: MountedAntenna, folder: Path) -> ReceivingAntenna:
        """Return the antenna as a flight file describes it; relative paths start at ``folder``.

        Raises
        ------
        ModelError, MissingFileError, ConfigError : no such pattern or file, or a wrong one
        """
        table, _ = read_pattern(antenna_file(antenna.pattern, (folder,)))
        hidden = None if antenna.obstruction is None else read_obstruction(folder / antenna.obstruction)
        return cls(interpolated(table), mounting(antenna), hidden)

    def gain_dbic(self, u_b: Float64) -> Float64:
        """Return the gain towards unit directions (k, 3), body axes."""
        azimuth, elevation = np.degrees(angles_of(u_b @ self.C_ba))  # C_ab u_b
        gain = np.asarray(self.gain(np.column_stack([elevation, azimuth % 360.0])))
        for shape in () if self.obstruction is None else self.obstruction.shapes():
            gain = np.where(is_inside(shape, u_b), HIDDEN_DBIC, gain)
        return gain


def interpolated(table: GainTable) -> RegularGridInterpolator:
    """Return a pattern as a bilinear function of elevation and azimuth (0 to 360) [deg]."""
    azimuth = np.append(table.azimuth_deg, 360.0)
    around = np.column_stack([table.gain_dbic, table.gain_dbic[:, 0]])
    return RegularGridInterpolator((table.elevation_deg, azimuth), around)


@dataclass(frozen=True)
class Reception:
    """A receiver with one antenna or several, the strongest of which counts, and its link budget."""

    antennas: Sequence[ReceivingAntenna]
    cn0_at_0_dbic_dbhz: float = 45.0

    def cn0_dbhz(self, direction_b: Float64) -> Float64:
        """Return C/N0 (m, n) towards unit directions (m, n, 3) to the satellites, body axes."""
        flat = direction_b.reshape(-1, 3)
        gain = np.max([antenna.gain_dbic(flat) for antenna in self.antennas], axis=0)
        return np.asarray(self.cn0_at_0_dbic_dbhz + gain.reshape(direction_b.shape[:2]))
