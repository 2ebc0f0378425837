"""The ledger of a user's own rows: an entry for each, and one for each time at which no filter could take them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

from insgnss.filter.own_rows.rows import OwnMeasurements
from insgnss.status import NO_IMU, NOT_STARTED


class OwnEntry(NamedTuple):
    """The status of one row: its entry in the ledger."""

    t_ns: int
    kind: str
    innovation: float
    variance: float  # of the innovation; NaN where nothing was predicted
    status: int  # of ``status``

    @property
    def nis(self) -> float:
        """Its normalised squared innovation; NaN where nothing was predicted."""
        return self.innovation**2 / self.variance if self.variance > 0.0 else math.nan


def complete_ledger(
    own: OwnMeasurements,
    existing: dict[int, list[OwnEntry]],
    spans_ns: Iterable[tuple[int, int]],
    between_ns: tuple[int, int],
) -> list[OwnEntry]:
    """Return the entries of all times after the first and up to the second of ``between_ns``, in their order.

    A listed time at which the filter took no rows has one entry of each kind: it stands outside the inertial samples,
    or there was no filter. Of a period only the ticks that the filter took have entries.

    Parameters
    ----------
    existing : the existing entries, by time
    spans_ns : the unbroken stretches of inertial samples, first and last time
    """
    entries: list[OwnEntry] = []
    spans = list(spans_ns)
    first_ns, last_ns = between_ns
    taken = {t_ns for t_ns in existing if first_ns < t_ns <= last_ns}
    for t_ns in sorted(taken.union(own.listed(*between_ns))):
        if t_ns in existing:
            entries += existing[t_ns]
            continue
        status = NOT_STARTED if any(a <= t_ns <= b for a, b in spans) else NO_IMU
        listed = [kind for kind in own.at(t_ns) if not kind.period_ns]
        entries += [OwnEntry(t_ns, kind.name, math.nan, math.nan, status) for kind in listed]
    return entries


class OwnResults:
    """The status of own rows in the streaming engine, reported once it is final."""

    def __init__(self, own: OwnMeasurements | None) -> None:
        """Begin before the first of them."""
        self._own = own
        self._found: dict[int, list[OwnEntry]] = {}  # of stretches that have ended
        self._spans: list[tuple[int, int]] = []
        self._taken_ns = -(2**62)

    def keep(self, by_time: dict[int, list[OwnEntry]], span_ns: tuple[int, int]) -> None:
        """Keep the entries of a stretch of samples that has ended."""
        self._found |= {t_ns: entries for t_ns, entries in by_time.items() if t_ns > self._taken_ns}
        if span_ns[0] < span_ns[1]:  # of a single sample the filter makes nothing
            self._spans.append(span_ns)

    def taken(
        self, by_time: dict[int, list[OwnEntry]], spans: list[tuple[int, int]], until_ns: int
    ) -> list[OwnEntry]:
        """Return the entries up to ``until_ns``, or to the end of the last stretch, that were not returned before.

        ``by_time`` and ``spans`` are those of the stretch that goes on; what is returned goes from ``by_time``.
        """
        until_ns = max([until_ns, *(last for _, last in self._spans)])
        if self._own is None or until_ns <= self._taken_ns:
            return []
        span = (self._taken_ns, until_ns)
        entries = complete_ledger(self._own, self._found | by_time, [*self._spans, *spans], span)
        self._taken_ns = until_ns
        self._found = {}
        for t_ns in [t_ns for t_ns in by_time if t_ns <= until_ns]:
            del by_time[t_ns]
        return entries
