"""Many events of one kind: the first are reported one by one, the others counted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final, TypeVar

from insgnss.tables import Event

MAX_EVENTS_EACH: Final = 20
_T = TypeVar("_T")


def first_events(
    items: Sequence[_T], event: Callable[[_T], Event], source: object, outcome: str = ""
) -> list[Event]:
    """Return an event for each of the first items, all of one kind, and one that counts them where there are more.

    Parameters
    ----------
    source : the file, named in the count
    outcome : the common outcome, named there too
    """
    events = [event(item) for item in items[:MAX_EVENTS_EACH]]
    if len(items) > MAX_EVENTS_EACH:
        next_one = event(items[MAX_EVENTS_EACH])
        counted = f"{source}: {len(items) - MAX_EVENTS_EACH} more such, {len(items)} in all"
        events.append(Event(next_one.t_ns, next_one.kind, counted + (f"; {outcome}" if outcome else "")))
    return events


def shortened(events: Sequence[Event], source: object) -> list[Event]:
    """Return the first events of each kind, and for each kind with more one that counts them."""
    kinds = dict.fromkeys(event.kind for event in events)
    short: list[Event] = []
    for kind in kinds:
        short += first_events([event for event in events if event.kind == kind], lambda event: event, source)
    return short
