"""Which fault moves the solution how far, and the alerts, each of which names the satellite that is suspect.

A fault of one satellite moves the full solution and all sub-filters that still use the satellite, so separations of
healthy satellites exceed their limits as well. The suspect of an alert is the fault whose separation is largest against
its limit over the consecutive rows of the alert.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import pandas as pd

from insgnss.runs.integrity.faults import Fault
from insgnss.tables import Event, Float64, Int64

AXES: Final = ("n", "e", "d")
_COLUMNS: Final = (
    *("fault", "probability", "time_s", "axis", "separation_m", "limit_m", "alert_rows", "rows_without"),
)


class Separations(NamedTuple):
    """Separations of k sub-filters at n rows and their limits; NaN where a sub-filter has no row."""

    faults: Sequence[Fault]
    d: Float64  # (k, 3, n) north, east, down [m]
    limit: Float64  # (k, 3, n)
    time_s: Float64  # (n,)

    def ratio(self) -> Float64:
        """Return each separation over its limit (k, 3, n), 0 where there is none."""
        return np.nan_to_num(np.abs(self.d) / self.limit, nan=0.0)

    def largest(self, k: int, ratio: Float64) -> tuple[int, int]:
        """Return axis and row of a fault's largest separation over its limit."""
        axis, row = np.unravel_index(int(np.argmax(ratio[k])), ratio[k].shape)
        return int(axis), int(row)


def fault_table(separations: Separations) -> pd.DataFrame:
    """Return for each fault its largest separation over the limit, where and when, and its rows with an alert."""
    ratio, rows = separations.ratio(), []
    for k, fault in enumerate(separations.faults):
        axis, row = separations.largest(k, ratio)
        d, limit = separations.d[k, axis, row], separations.limit[k, axis, row]
        alerts, missing = (ratio[k] > 1.0).any(axis=0), np.isnan(separations.d[k, 0])
        rows.append(
            (
                *(fault.name, fault.probability, separations.time_s[row], AXES[axis], d, limit),
                *(int(alerts.sum()), int(missing.sum())),
            )
        )
    return pd.DataFrame(rows, columns=list(_COLUMNS))


def alert_events(separations: Separations, t_ns: Int64) -> list[Event]:
    """Return an event for each suspect, at the first row of its first alert; the largest separation first."""
    ratio = separations.ratio()
    of_rows = ratio.max(axis=1, initial=0.0)  # (k, n)
    alert = (of_rows > 1.0).any(axis=0)
    ends = np.flatnonzero(np.diff(np.concatenate([[False], alert, [False]]).astype(np.int8)))
    rows_of: dict[int, list[Int64]] = {}
    for first, end in ends.reshape(-1, 2):
        suspect = int(np.argmax(of_rows[:, first:end].max(axis=1)))
        rows_of.setdefault(suspect, []).append(np.arange(first, end))
    suspects = sorted(rows_of, key=lambda k: -float(of_rows[k].max()))
    return [_event(separations, ratio, k, np.concatenate(rows_of[k]), t_ns) for k in suspects]


def _event(separations: Separations, ratio: Float64, suspect: int, rows: Int64, t_ns: Int64) -> Event:
    """Return the event of a suspect with its alerts' rows."""
    here = ratio[:, :, rows]
    axis, row = separations.largest(suspect, here)
    d, limit = separations.d[suspect, axis, rows[row]], separations.limit[suspect, axis, rows[row]]
    most = here.max(axis=(1, 2))
    others = [k for k in np.argsort(-most, kind="stable").tolist() if k != suspect and most[k] > 1.0]
    also = ", ".join(separations.faults[k].name for k in others)
    detail = (
        f"suspect {separations.faults[suspect].name}: without it the position differs by {d:+.2f} m {AXES[axis]} at"
        f" {separations.time_s[rows[row]]:.1f} s, limit {limit:.2f} m; alert in {len(rows)} row(s)"
        + (f"; also beyond their limits, probably due to the suspect: {also}" if also else "")
    )
    return Event(int(t_ns[rows[0]]), "integrity_alert", detail)
