"""Own rows that contradict everything else: they are not used until they agree again.

A gate refuses what is far off. Rows that are always somewhat off, as those of an aircraft declared as a car, pass it
and pull the filter away from its other measurements. Their normalised squared innovations show it: 1 on average, less
for rows that count less because their errors are correlated. The mean over the last 10 s, each value kept below 25, is
chi-square of some 40 degrees of freedom divided by them (sigma 0.22), so 3 is 9 sigma away. A slide of 5 s gives 5.

A sensor that gives the heading is not left out by that mean: the gate refuses it, and readings that share an error for
a minute would pass the limit by chance. It is left out where the motion has refuted its heading (``refute``).

A look back at faults (``diagnosis.further_sensors``) may leave out any kind, one whose tags are late for good. A
reading that repeats the one before does not count as agreement.

In an outage the sigma of the prediction grows until any row agrees with it. If the rows were found wrong while GNSS
supported the prediction, a row counts as agreement only while the prediction is as good as then (within a factor of two
in variance), or would still show at three sigma an error of the size that was found. A contradiction that begins in an
outage may be the filter's own error: there any agreement counts.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np

from insgnss.filter.own_rows.ledger import OwnEntry
from insgnss.filter.own_rows.rows import NOT_WATCHED, Kind
from insgnss.filter.state import HeadRecord
from insgnss.tables import Event, Float64

_MEMORY_S: Final = 10.0
_CONTRADICTS: Final = 3.0
_AGREES: Final = 1.5
_MOST: Final = 25.0  # a row as far off as 5 sigma: one outlier is not a contradiction
_SHOWS2: Final = 9.0  # three sigma
_AS_GOOD: Final = 2.0  # in variance
_LATELY_S: Final = 5.0
_LONGEST_STEP_S: Final = 5.0  # rows after a pause count as at most so many seconds of evidence


def contradicting(head: HeadRecord, kinds: Iterable[Kind]) -> frozenset[str]:
    """Return the kinds that are not to be used."""
    contradicts = head.own_contradicts
    if not contradicts.any():
        return frozenset()
    return frozenset(kind.name for kind in kinds if kind.watch != NOT_WATCHED and contradicts[kind.watch])


def watch(
    head: HeadRecord,
    kinds: Iterable[Kind],
    entries: Iterable[OwnEntry],
    predicted: Float64,
    t_ns: int,
    *,
    headings_open: bool = False,
) -> None:
    """Carry the mean of each kind that may be left out on with the rows of a time, and note which contradict.

    Parameters
    ----------
    predicted : variance of each entry's prediction (k,), without that of its own row
    headings_open : more than one heading is open; sensors of the heading are not judged then, as they contradict all
        but one
    """
    by_kind: dict[str, list[tuple[float, ...]]] = {}
    for entry, variance in zip(entries, predicted.tolist(), strict=True):
        if math.isfinite(entry.nis):
            row = min(entry.nis, _MOST), entry.innovation**2, variance, entry.variance - variance
            by_kind.setdefault(entry.kind, []).append(row)
    mean, last_ns, contradicts, reach = head.own_nis, head.own_nis_ns, head.own_contradicts, head.own_reach
    for kind in kinds:
        values = by_kind.get(kind.name)
        if kind.watch == NOT_WATCHED or not values or (headings_open and kind.tells_heading):
            continue
        at, (nis, off2, variance, own) = kind.watch, np.mean(values, axis=0).tolist()
        before_ns = int(last_ns[at])
        step_s = min((t_ns - before_ns) * 1e-9, _LONGEST_STEP_S) if before_ns else 1.0
        last_ns[at] = t_ns
        limit = reach[at] or own
        if contradicts[at] and (variance > limit or kind.repeats(t_ns)):
            continue
        share = 1.0 - math.exp(-step_s / _MEMORY_S)
        mean[at] += share * (nis - mean[at])
        shows = off2 / _SHOWS2
        if contradicts[at]:
            contradicts[at], reach[at] = int(mean[at] > _AGREES), max(limit, shows)
        elif mean[at] > _CONTRADICTS and kind.watched and not kind.tells_heading:
            contradicts[at] = 1
            reach[at] = max(_AS_GOOD * variance, shows) if _is_supported(head, t_ns) else math.inf


def refute(head: HeadRecord, kinds: Sequence[Kind], refuted: HeadRecord, *, is_given: bool) -> list[str]:
    """Leave out, in the filter that takes the place of a refuted one, the kinds that agreed with that one.

    After an automatic start the heading came from these sensors: if none agrees any more, all are left out. Sensors
    that contradicted the old filter stay in use. Agreement counts while the prediction is as good as a reading.
    """
    mean, last_ns = refuted.own_nis, refuted.own_nis_ns
    agreed = {kind.name for kind in kinds if last_ns[kind.watch] != 0 and mean[kind.watch] < _CONTRADICTS}
    if not agreed and not is_given:
        agreed = {kind.name for kind in kinds}
    for kind in kinds:
        at = kind.watch
        if refuted.own_contradicts[at]:  # a look back has left it out
            agreed.discard(kind.name)
            for name in ("own_contradicts", "own_nis", "own_reach", "own_nis_ns"):
                getattr(head, name)[at] = getattr(refuted, name)[at]
            continue
        head.own_contradicts[at], head.own_nis[at] = 0, 1.0
        head.own_reach[at], head.own_nis_ns[at] = 0.0, last_ns[at]
    leave_out(head, [kind for kind in kinds if kind.name in agreed])
    return sorted(agreed)


def leave_out(head: HeadRecord, kinds: Iterable[Kind], *, for_good: bool = False) -> None:
    """Leave out kinds until they agree, which counts while the prediction is as good as a reading, or for good."""
    for kind in kinds:
        at = kind.watch
        head.own_contradicts[at], head.own_nis[at], head.own_reach[at] = 1, _MOST, -1.0 if for_good else 0.0


def _is_supported(head: HeadRecord, t_ns: int) -> bool:
    """Return whether GNSS measurements have been used lately."""
    return bool(head.silent_ns == 0 and (t_ns - head.epoch_ns) * 1e-9 < _LATELY_S)


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
