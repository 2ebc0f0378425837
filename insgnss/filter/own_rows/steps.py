"""A sensor whose own error steps: the error is estimated anew, and the sensor goes on measuring changes.

A window that opens moves the pressure at a barometer's port by a hectopascal, 8 m of height, for as long as it is open.
The gate refuses such readings while the filter's prediction is good. In an outage the prediction becomes vague within
seconds, until the gate takes them and the step passes for motion. A vehicle would not produce this: several readings in
a row far off show that the sensor's error has stepped. Its state o gets the variance of such a step,

    P_oo <- P_oo + (y / h)^2,    y the innovation, h the row's partial by o,

so that the next reading sets o and leaves the rest of the filter as it is. What was known of o before is lost. A single
outlier is gated as before.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Final, NamedTuple

from insgnss.filter.layout_names import StateLayout
from insgnss.filter.own_rows.checked_rows import CheckedRow
from insgnss.filter.own_rows.ledger import OwnEntry
from insgnss.filter.own_rows.rows import Kind
from insgnss.filter.state import Bank, HeadRecord
from insgnss.status import GATED, USED
from insgnss.tables import Event

_IN_A_ROW: Final = 3  # refused readings
_LEAST_NS: Final = 1_000_000_000  # from the first of them to the last


class ErrorStep(NamedTuple):
    """A step of a sensor's own error."""

    place: int  # of its state in the error state
    event: Event


def open_steps(
    bank: Bank,
    entries: Iterable[OwnEntry],
    rows: Mapping[int, Sequence[tuple[Kind, CheckedRow]]],
    layout: StateLayout,
    t_ns: int,
) -> tuple[ErrorStep, ...]:
    """Give each state that has stepped the variance of its step, in every hypothesis; return the steps.

    Parameters
    ----------
    entries : the leading hypothesis' entries of a time
    rows : of each hypothesis, by its place in the bank, in the order of the entries
    """
    steps, kinds = [], [kind for kind, _ in next(iter(rows.values()))]
    for j, (kind, entry) in enumerate(zip(kinds, entries, strict=True)):
        if not (kind.steps and _is_refused_again(bank.head[0], kind, entry, t_ns)):
            continue
        place = int(layout[kind.steps].columns.start)
        for i, of_member in rows.items():
            row = of_member[j][1]
            partial = float(row.h[row.columns == place].sum())
            if math.isfinite(row.innovation) and partial != 0.0:
                bank.P[i, place, place] += (row.innovation / partial) ** 2
        steps.append(ErrorStep(place, _in_words(kind, entry)))
    return tuple(steps)


def _is_refused_again(head: HeadRecord, kind: Kind, entry: OwnEntry, t_ns: int) -> bool:
    """Count the refused readings of a kind; return whether they show a step, and begin to count again if so."""
    at = kind.stepping
    if entry.status == USED:
        head.own_refused[at] = 0
    if entry.status != GATED:
        return False
    if head.own_refused[at] == 0:
        head.own_refused_ns[at] = t_ns
    head.own_refused[at] += 1
    stepped = head.own_refused[at] >= _IN_A_ROW and t_ns - head.own_refused_ns[at] >= _LEAST_NS
    if stepped:
        head.own_refused[at] = 0
    return bool(stepped)


def _in_words(kind: Kind, entry: OwnEntry) -> Event:
    detail = (
        f"several readings of '{kind.name}' in a row are off, the last by {abs(entry.innovation):.3g} {kind.unit}"
        f" ({math.sqrt(entry.nis):.0f} sigma): its own error has stepped; {kind.steps} is re-estimated"
    )
    look = f"; look for: {kind.hint}" if kind.hint else ""
    return Event(entry.t_ns, "sensor_stepped", detail + look)
