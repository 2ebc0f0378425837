"""The search supervisor's decision for each satellite, and the search time that it saved."""

from __future__ import annotations

import pandas as pd

from insgnss.report.html import Section, table
from insgnss.report.labels import number
from insgnss.report.sections.satellites import timeline_chart
from insgnss.runs.result import Run


def section(run: Run) -> Section | None:
    """Return the supervision, None where it was not asked for."""
    states: pd.DataFrame | None = getattr(run, "supervision", None)
    if states is None or states.empty:
        return None
    after = _transitions(getattr(run, "transitions", None)) + _times(getattr(run, "search_times", None))
    after += _receiver(getattr(run, "receiver_events", None))
    chart = timeline_chart(states, "chart-supervision", "State of each channel")
    return Section("supervision", "Search supervision", charts=(chart,), after=after)


def _transitions(changes: pd.DataFrame | None) -> str:
    if changes is None:
        return ""
    counts = changes.groupby(["from_state", "to_state", "reason"], observed=True).size().reset_index()
    rows = [[str(word) for word in row] for row in counts.itertuples(index=False)]
    return "<h3>Transitions</h3>" + table(("from", "to", "reason", "count"), rows)


def _times(times: pd.DataFrame | None) -> str:
    if times is None or times.empty:
        return ""
    columns = [name for name in times.columns if name != "sv" and times[name].notna().any()]
    head = [
        name.removesuffix("_s").replace("_", " ") + (", s" if name.endswith("_s") else "") for name in columns
    ]
    rows = [[str(row["sv"]), *(number(float(row[name])) for name in columns)] for _, row in times.iterrows()]
    return "<h3>Time in search</h3>" + table(("satellite", *head), rows)


def _receiver(events: pd.DataFrame | None) -> str:
    if events is None:
        return ""
    counts = events["verdict"].value_counts()
    rows = [[str(word).replace("_", " "), int(n)] for word, n in counts.items() if n]
    return "<h3>The receiver's own events</h3>" + table(("verdict", "count"), rows)
