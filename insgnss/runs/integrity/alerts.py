"""The effect of each fault on the solution, and the alerts, each of which names the suspect satellite.

A fault of one satellite moves the full solution and all sub-filters that still use the satellite, so separations of
healthy satellites exceed their limits as well, sometimes by more: with fewer satellites the fault weighs more. The
suspect of an alert is the fault, among those beyond their limits, that explains the measurements best:

    smallest sum_used(nu_k^2 / S_k - nu_0^2 / S_0 + ln(S_k / S_0)) + sum_left_out(2 - nu_0^2 / S_0) - 2 ln p_k

over the pseudoranges and range rates of the consecutive rows of the alert, by the innovations nu of the sub-filter k
and of the full one 0: twice the logarithm of the likelihood ratio, and the probability of the fault. A measurement that
is left out counts as 2, one more than a good one is expected to be, so that a satellite is preferred to its
constellation.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import pandas as pd

from insgnss.filter.whole_log import LedgerPart
from insgnss.gnss.observation_rows import GnssRows
from insgnss.runs.integrity.faults import Fault
from insgnss.tables import Event, Float64, Int64, stretches_of

AXES: Final = ("n", "e", "d")
_LEFT_OUT: Final = 2.0  # of a measurement, as a normalised innovation squared
_COLUMNS: Final = (
    *("fault", "probability", "time_s", "axis", "separation_m", "limit_m", "alert_rows", "rows_without"),
)


class Separations(NamedTuple):
    """Separations of k sub-filters at n rows and their limits; NaN where a sub-filter has no row."""

    faults: Sequence[Fault]
    d: Float64  # (k, 3, n) north, east, down [m]
    limit: Float64  # (k, 3, n)
    t_ns: Int64  # (n,)
    time_s: Float64  # (n,) of the GPS week
    misfit: Float64  # (k, m) of the sub-filters at each epoch
    epoch_ns: Int64  # (m,)

    def ratio(self) -> Float64:
        """Return each separation over its limit (k, 3, n), 0 where there is none."""
        return np.nan_to_num(np.abs(self.d) / self.limit, nan=0.0)

    def largest(self, k: int, ratio: Float64) -> tuple[int, int]:
        """Return axis and row of a fault's largest separation over its limit."""
        axis, row = np.unravel_index(int(np.argmax(ratio[k])), ratio[k].shape)
        return int(axis), int(row)

    def suspect(self, candidates: Int64, first: int, last: int) -> int:
        """Return which of the candidates explains the measurements best from one row to another."""
        begin = max(int(np.searchsorted(self.epoch_ns, self.t_ns[first], side="right")) - 1, 0)
        end = int(np.searchsorted(self.epoch_ns, self.t_ns[last], side="right"))
        p = np.array([self.faults[k].probability for k in candidates])
        return int(candidates[np.argmin(self.misfit[candidates, begin:end].sum(axis=1) - 2.0 * np.log(p))])


def epoch_misfit(
    blocks: Sequence[GnssRows], ledger: Sequence[LedgerPart], full: Sequence[LedgerPart]
) -> Float64:
    """Return how much worse a sub-filter explains each epoch's measurements than the full filter does (m,).

    Twice the logarithm of the likelihood ratio, as above; negative where the sub-filter is better.
    """
    sums = []
    for rows, part, other in zip(blocks, ledger, full, strict=False):
        nis, log_variance = [], []
        for entries in (part.entries, other.entries):
            variance = entries["variance"].astype(np.float64)
            nis.append(entries["innovation"] ** 2 / variance)
            log_variance.append(np.log(variance))
        used = nis[0] + log_variance[0] - log_variance[1]
        explained = np.where(np.isnan(used), _LEFT_OUT, used) - nis[1]
        so_far = np.concatenate([[0.0], np.cumsum(np.nan_to_num(explained, nan=0.0).sum(axis=1))])
        sums.append(np.diff(so_far[rows.first]))
    return np.concatenate([np.zeros(0), *sums])


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


def alert_events(separations: Separations) -> list[Event]:
    """Return an event for each suspect, at the first row of its first alert; the largest separation first."""
    ratio = separations.ratio()
    return [_event(separations, ratio, k, rows) for k, rows in suspect_rows(separations).items()]


def suspect_rows(separations: Separations) -> dict[int, Int64]:
    """Return the rows with an alert by the number of their suspect; the largest separation over its limit first."""
    of_rows = separations.ratio().max(axis=1, initial=0.0)  # (k, n)
    alert = (of_rows > 1.0).any(axis=0)
    rows_of: dict[int, list[Int64]] = {}
    for first, end in stretches_of(alert):
        candidates = np.flatnonzero((of_rows[:, first:end] > 1.0).any(axis=1))
        suspect = separations.suspect(candidates, int(first), int(end) - 1)
        rows_of.setdefault(suspect, []).append(np.arange(first, end))
    suspects = sorted(rows_of, key=lambda k: -float(of_rows[k].max()))
    return {k: np.concatenate(rows_of[k]) for k in suspects}


def _event(separations: Separations, ratio: Float64, suspect: int, rows: Int64) -> Event:
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
    return Event(int(separations.t_ns[rows[0]]), "integrity_alert", detail)
