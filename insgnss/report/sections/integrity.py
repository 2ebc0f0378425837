"""Protection levels: over time, against the errors if there is a reference, and the effect of each fault."""

from __future__ import annotations

from typing import Final

import numpy as np
import pandas as pd

from insgnss.report.charts import (
    Chart,
    ChartRows,
    Trace,
    colour_of,
    line_trace,
    lines,
    log_ticks,
    marker_trace,
    packed,
)
from insgnss.report.html import Section, paragraphs, table
from insgnss.report.labels import number
from insgnss.runs.result import Run
from insgnss.tables import Float64

_LEVELS: Final = {"horizontal": "hpl_m", "vertical": "vpl_m"}
_POINTS: Final = 4000  # of the diagram
_LEAST_M: Final = 1e-3  # smaller errors are drawn there
_HEADS: Final = ("without", "largest separation, m", "axis", "at, s", "limit, m", "rows with an alert")
_DIAGRAM: Final = (
    "Each point is a row of the run. Above the line its error is below the protection level; a point below it would be"
    " a misleading row."
)


def section(run: Run) -> Section | None:
    """Return levels, Stanford diagram and faults, None for a run without protection levels."""
    if run.integrity is None or "hpl_m" not in run.nav:
        return None
    charts = [_over_time(run)]
    before = ""
    errors = _errors(run)
    if errors is not None and len(errors):
        charts.append(_diagram(errors))
        beyond = [int((errors[name] > errors[level]).sum()) for name, level in _LEVELS.items()]
        unbounded = int(np.isinf(errors[list(_LEVELS.values())]).any(axis=1).sum())
        before = paragraphs(
            [
                f"The error is beyond its protection level in {beyond[0]} (horizontal) and {beyond[1]} (vertical) of"
                f" {len(errors)} rows inside the reference."
                + (f" Infinite levels, in {unbounded} rows, are not drawn." if unbounded else "")
            ]
        )
    names = ["fault", "separation_m", "axis", "time_s", "limit_m", "alert_rows"]
    ratio = (run.integrity["separation_m"].abs() / run.integrity["limit_m"]).fillna(0.0)
    suspects_first = run.integrity.loc[ratio.sort_values(ascending=False, kind="stable").index, names]
    rows = [
        (fault, number(moved), axis, f"{time_s:.1f}", number(limit), alerts)
        for fault, moved, axis, time_s, limit, alerts in suspects_first.to_numpy()
    ]
    return Section("integrity", "Protection levels", before=before, charts=charts, after=table(_HEADS, rows))


def _errors(run: Run) -> pd.DataFrame | None:
    """Return horizontal and vertical errors beside their levels, None without a reference."""
    if run.errors is None:
        return None
    both = run.errors.merge(run.nav[["time_s", *_LEVELS.values()]], on="time_s")
    return both.assign(horizontal=np.hypot(both["d_n_m"], both["d_e_m"]), vertical=both["d_d_m"].abs())


def _over_time(run: Run) -> Chart:
    rows = ChartRows([f"{name}, m" for name in _LEVELS])
    for row, (name, level) in enumerate(_LEVELS.items()):
        values = _finite(run.nav[level].to_numpy())
        rows.add(
            row, line_trace(run.nav["time_s"].to_numpy(), values, f"{name} protection level", colour_of(row))
        )
        rows.kinds[row] = "log"
    return rows.chart("chart-protection-levels", "Protection levels", showlegend=False)


def _diagram(errors: pd.DataFrame) -> Chart:
    """Return the Stanford diagram of both levels; no misleading row is thinned out."""
    one_of_many = np.arange(len(errors)) % max(len(errors) // _POINTS, 1) == 0
    traces: list[Trace] = []
    drawn = []
    for i, (name, level) in enumerate(_LEVELS.items()):
        rows = errors[one_of_many | (errors[name] > errors[level]).to_numpy()]
        x = np.maximum(rows[name].to_numpy(), _LEAST_M)
        y = _finite(rows[level].to_numpy())
        traces.append(marker_trace(x, y, name, colour_of(i)))
        drawn += [x, y]
    values = np.concatenate(drawn)
    values = values[np.isfinite(values)]
    ends = np.array([values.min(), values.max()])
    dotted = {"dash": "dot", "width": 1}
    traces.append(lines("error = level", packed(ends, double=True), packed(ends), dotted))
    axis = {"type": "log", **log_ticks(values)}
    layout = {
        "xaxis": {"title": {"text": "error, m"}, **axis},
        "yaxis": {"title": {"text": "protection level, m"}, **axis},
    }
    return Chart("chart-stanford", "Stanford diagram", traces, layout, 430, _DIAGRAM)


def _finite(values: Float64) -> Float64:
    """Return levels with infinite ones as not a number, which is a gap."""
    return np.where(np.isfinite(values), values, np.nan)
