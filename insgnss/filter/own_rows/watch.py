"""Whether the rows of a further sensor are refused for long, and when they are used again."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

from insgnss.constants import NS_PER_S
from insgnss.filter.own_rows.ledger import OwnEntry
from insgnss.filter.own_rows.rows import OwnMeasurements
from insgnss.status import BAD_VALUE, CONTRADICTS, USED
from insgnss.tables import Event

_MEMORY_S: Final = 6.0  # of the share of refused times: after ten seconds of nothing else it is 0.8
_MOST_AT_ONCE: Final = 0.28  # that one time moves the share: a slow sensor needs five of them
_LONG: Final = 0.8
_OVER: Final = 0.3


class Refusals(NamedTuple):
    """A sensor's recent agreement with the filter."""

    share: float  # of the times at which nothing of it was used
    last_ns: int
    since_ns: int  # first of the refused times that have not been followed by used ones
    told: bool


@dataclass
class RefusalWatch:
    """Counts, for each kind of own rows, the times at which all were refused."""

    kinds: dict[str, Refusals] = field(default_factory=dict)

    def copied(self) -> RefusalWatch:
        """Return a copy that shares nothing that changes."""
        return replace(self, kinds=dict(self.kinds))

    def take(self, own: OwnMeasurements, t_ns: int, entries: list[OwnEntry]) -> list[Event]:
        """Take the status of the rows of a time; return the events."""
        events = []
        by_kind: dict[str, list[OwnEntry]] = {}
        for entry in entries:
            by_kind.setdefault(entry.kind, []).append(entry)
        for name, rows in by_kind.items():
            refused = all(row.status != USED for row in rows)
            before = self.kinds.get(name, Refusals(0.0, t_ns, t_ns, False))
            if all(row.status == CONTRADICTS for row in rows):
                self.kinds[name] = before._replace(last_ns=t_ns)
                continue  # an event of its own names them and their end
            step = 1.0 - math.exp(-(t_ns - before.last_ns) / NS_PER_S / _MEMORY_S)
            share = before.share + min(step, _MOST_AT_ONCE) * (float(refused) - before.share)
            since_ns = before.since_ns if before.share >= _OVER else t_ns
            is_told = before.told
            if share > _LONG and not is_told:
                hint = next(kind.hint for kind in own.kinds if kind.name == name)
                events.append(_refused(name, hint, rows, since_ns, t_ns))
                is_told = True
            elif share < _OVER and is_told:
                seconds = (t_ns - before.since_ns) / NS_PER_S
                detail = f"'{name}' agrees with the filter again, {seconds:.0f} s after its rows were first refused"
                events.append(Event(t_ns, "sensor_agrees", detail))
                is_told = False
            self.kinds[name] = Refusals(share, t_ns, since_ns, is_told)
        return events


def _refused(name: str, hint: str, rows: list[OwnEntry], since_ns: int, t_ns: int) -> Event:
    """Return the event of a sensor whose rows are refused for long."""
    seconds = (t_ns - since_ns) / NS_PER_S
    if all(row.status == BAD_VALUE for row in rows):
        why = "it gives no usable number"
    else:
        ratio = math.sqrt(max(row.nis for row in rows if row.variance > 0.0))
        why = f"it contradicts the filter by {ratio:.0f} sigma"
    look = f"; look for: {hint}" if hint else ""
    return Event(t_ns, "sensor_refused", f"'{name}' has been refused since {seconds:.0f} s: {why}{look}")
