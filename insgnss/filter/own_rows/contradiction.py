"""Own rows that contradict everything else: they are not used until they agree again.

A gate refuses what is far off. Rows that are always somewhat off, as those of an aircraft declared as a car, pass it
and pull the filter away from its other measurements. Their normalised squared innovations show it: 1 on average, less
for rows that count less because their errors are correlated. The mean over the last 10 s, each value kept below 25, is
chi-square of some 40 degrees of freedom divided by them (sigma 0.22), so 3 is 9 sigma away. A slide of 5 s gives 5.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

from insgnss.filter.own_rows.ledger import OwnEntry
from insgnss.filter.own_rows.rows import NOT_WATCHED, Kind
from insgnss.filter.state import HeadRecord
from insgnss.tables import Event

_MEMORY_S: Final = 10.0
_CONTRADICTS: Final = 3.0
_AGREES: Final = 1.5
_MOST: Final = 25.0  # a row as far off as 5 sigma: one outlier is not a contradiction
_LONGEST_STEP_S: Final = 5.0  # rows after a pause count as at most so many seconds of evidence


def contradicting(head: HeadRecord, kinds: Iterable[Kind]) -> frozenset[str]:
    """Return the kinds that are not to be used."""
    found = head.own_contradicts
    if not found.any():
        return frozenset()
    return frozenset(kind.name for kind in kinds if kind.watch != NOT_WATCHED and found[kind.watch])


def watch(head: HeadRecord, kinds: Iterable[Kind], entries: Iterable[OwnEntry], t_ns: int) -> None:
    """Carry the mean of each watched kind on with the rows of a time, and note which contradict."""
    found: dict[str, list[float]] = {}
    for entry in entries:
        if math.isfinite(entry.nis):
            found.setdefault(entry.kind, []).append(min(entry.nis, _MOST))
    mean, last_ns, contradicts = head.own_nis, head.own_nis_ns, head.own_contradicts
    for kind in kinds:
        values = found.get(kind.name)
        if kind.watch == NOT_WATCHED or not values:
            continue
        at, nis = kind.watch, sum(values) / len(values)
        before_ns = int(last_ns[at])
        step_s = min((t_ns - before_ns) * 1e-9, _LONGEST_STEP_S) if before_ns else 1.0
        share = 1.0 - math.exp(-step_s / _MEMORY_S)
        mean[at] += share * (nis - mean[at])
        last_ns[at] = t_ns
        contradicts[at] = int(mean[at] > (_AGREES if contradicts[at] else _CONTRADICTS))


def changes(before: frozenset[str], head: HeadRecord, kinds: Iterable[Kind], t_ns: int) -> list[Event]:
    """Return an event for each kind that is not used any more, or used again; ``before``: those that were not."""
    kinds = tuple(kinds)
    changed = before ^ contradicting(head, kinds)
    return [Event(t_ns, *_in_words(head, kind)) for kind in kinds if kind.name in changed]


def _in_words(head: HeadRecord, kind: Kind) -> tuple[str, str]:
    nis = f"normalised squared innovations of {kind.name} {head.own_nis[kind.watch]:.1f} on average"
    if head.own_contradicts[kind.watch]:
        return "rows_contradict", f"{nis}: its rows are not used until they agree with the other measurements"
    return "rows_agree", f"{nis}: its rows are used again"
