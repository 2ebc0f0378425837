"""The events in the order of their time, to sort and to filter."""

from __future__ import annotations

from typing import Final

from insgnss.report.html import Section, table
from insgnss.runs.result import Run

_MOST: Final = 3000  # rows that a phone can still sort


def section(run: Run) -> Section:
    """Return the table of events; of very many, the first, and how many more there are."""
    events = run.events
    shown = events.head(_MOST)
    rows = (
        ("" if time_s != time_s else f"{time_s:.3f}", kind, detail)
        for time_s, kind, detail in zip(shown["time_s"], shown["kind"], shown["detail"], strict=True)
    )
    more = len(events) - len(shown)
    note = f"<p>{more} further events are in the table 'events' of the run.</p>" if more else ""
    inside = table(("time, s", "kind", "detail"), rows, name="events-table", searchable=True)
    return Section("events", f"Events ({len(events)})", before=note + inside)
