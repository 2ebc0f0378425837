"""Position and attitude of a vehicle over time: from a reference, a run, or numbers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd

from insgnss.errors import InputError
from insgnss.geodesy.rotations import euler_to_matrix, quaternion_to_matrix
from insgnss.gpstime import week_seconds_to_ns
from insgnss.results.nav_columns import ATTITUDE
from insgnss.tables import Event, Float64, Int64, ReferenceTable


@dataclass(frozen=True)
class AttitudeHistory:
    """Position and attitude at n times, and how well the attitude is known."""

    t_ns: Int64  # (n,) GPS time, increasing
    position: Float64  # (n, 3) latitude, longitude [rad], height [m]
    C_nb: Float64  # (n, 3, 3)
    P_b: Float64  # (n, 3, 3) covariance of the attitude error, body axes [rad^2]

    @classmethod
    def from_rpy(
        cls, t_ns: Int64, rpy: Float64, position: Float64, sd_rpy: Float64 | None = None
    ) -> AttitudeHistory:
        """Return the history of roll, pitch, yaw (n, 3) [rad]; known exactly where no sigmas are given.

        Equation: phi_b = E d(roll, pitch, yaw), P_b = E diag(sd^2) E^T,
        E = [[1, 0, -sin p], [0, cos r, sin r cos p], [0, -sin r, cos r cos p]]; the three errors count as independent.

        Raises
        ------
        InputError : no time at all, times that do not increase, or a value that is not finite
        """
        t_ns, rpy = np.asarray(t_ns, np.int64), np.asarray(rpy, np.float64)
        C_nb = np.empty((len(t_ns), 3, 3))
        for k in range(len(t_ns)):
            euler_to_matrix(rpy[k, 0], rpy[k, 1], rpy[k, 2], C_nb[k])
        P_b = np.zeros((len(t_ns), 3, 3))
        if sd_rpy is not None:
            (sr, sp), (cr, cp) = np.sin(rpy[:, :2]).T, np.cos(rpy[:, :2]).T
            zero, one = np.zeros_like(sr), np.ones_like(sr)
            E = np.stack([one, zero, -sp, zero, cr, sr * cp, zero, -sr, cr * cp], axis=-1).reshape(-1, 3, 3)
            P_b = np.einsum("nij,nj,nkj->nik", E, np.asarray(sd_rpy) ** 2, E)
        return cls(t_ns, np.asarray(position, np.float64), C_nb, P_b)._checked()

    @classmethod
    def from_quaternion(
        cls, t_ns: Int64, q_nb: Float64, position: Float64, P_b: Float64 | None = None
    ) -> AttitudeHistory:
        """Return the history of unit quaternions (n, 4), scalar first; known exactly without a covariance.

        Raises
        ------
        InputError : no time at all, times that do not increase, or a value that is not finite
        """
        q_nb = np.asarray(q_nb, np.float64)
        C_nb = np.empty((len(q_nb), 3, 3))
        for k in range(len(q_nb)):
            quaternion_to_matrix(q_nb[k] / np.linalg.norm(q_nb[k]), C_nb[k])
        P_b = np.zeros((len(q_nb), 3, 3)) if P_b is None else np.array(P_b, np.float64)
        history = cls(np.asarray(t_ns, np.int64), np.asarray(position, np.float64), C_nb, P_b)
        return history._checked()

    @classmethod
    def of_reference(
        cls, reference: ReferenceTable, step_s: float = 0.0, file: Path | None = None
    ) -> tuple[AttitudeHistory, list[Event]]:
        """Return the history of a reference trajectory; rows without attitude are left out, with an event.

        Parameters
        ----------
        step_s : least time between two rows; 0 keeps all
        file : where it was read, for messages

        Raises
        ------
        InputError : no row has an attitude
        """
        degrees = np.column_stack([reference.lat_deg, reference.lon_deg, reference.rpy_deg])
        return _of_columns(reference.t_ns, degrees, reference.h_m, None, step_s, file)

    @classmethod
    def of_nav(cls, nav: pd.DataFrame, week: int, step_s: float = 0.0) -> tuple[AttitudeHistory, list[Event]]:
        """Return the history of a run's navigation table, with its sigmas; ``week`` is that of its ``time_s``."""
        t_ns = week_seconds_to_ns(week, nav["time_s"].to_numpy())
        degrees = nav[["lat_deg", "lon_deg", *ATTITUDE]].to_numpy(np.float64)
        sd_deg = nav[[f"sd_{name}" for name in ATTITUDE]].to_numpy(np.float64)
        return _of_columns(t_ns, degrees, nav["h_m"].to_numpy(np.float64), sd_deg, step_s)

    def _checked(self) -> AttitudeHistory:
        if len(self.t_ns) == 0 or (np.diff(self.t_ns) <= 0).any():
            raise InputError("the attitude history needs times that increase", advice="sort it, drop repeats")
        for name in ("position", "C_nb", "P_b"):
            if not np.isfinite(getattr(self, name)).all():
                advice = "leave out the rows without a number"
                raise InputError(f"{name} of the attitude history is not finite", advice=advice)
        return self


def _of_columns(
    t_ns: Int64,
    degrees: Float64,
    h_m: Float64,
    sd_deg: Float64 | None,
    step_s: float,
    file: Path | None = None,
) -> tuple[AttitudeHistory, list[Event]]:
    """Return the history of latitude, longitude, roll, pitch, yaw (n, 5) [deg]."""
    known = np.isfinite(degrees).all(axis=1) & np.isfinite(h_m)
    if sd_deg is not None:
        known &= np.isfinite(sd_deg).all(axis=1)
    events = []
    if not known.all():
        of = "" if file is None else f"{file}: "
        detail = f"{of}{np.count_nonzero(~known)} of {len(known)} rows have no attitude: left out"
        events.append(Event(None, "attitude_missing", detail))
    rows = _thinned(t_ns, np.flatnonzero(known), step_s)
    if not len(rows):
        raise InputError(
            "no row has position and attitude",
            file=file,
            advice="columns of roll, pitch and yaw are needed; a saved run has those of the filter",
        )
    radians = np.radians(degrees[rows])
    position = np.column_stack([radians[:, :2], h_m[rows]])
    sd = None if sd_deg is None else np.radians(sd_deg[rows])
    return AttitudeHistory.from_rpy(t_ns[rows], radians[:, 2:], position, sd), events


def _thinned(t_ns: Int64, rows: npt.NDArray[np.intp], step_s: float) -> npt.NDArray[np.intp]:
    """Return the first row of each step of time."""
    if step_s <= 0.0 or not len(rows):
        return rows
    step = (t_ns[rows] - t_ns[rows[0]]) // max(round(step_s * 1e9), 1)
    return rows[np.unique(step, return_index=True)[1]]
