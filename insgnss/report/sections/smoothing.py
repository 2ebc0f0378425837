"""The effect of smoothing: the filter's own solution against the smoothed one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from insgnss.errors import ResultError
from insgnss.report.charts import Chart, ChartRows, band_trace, colour_of, line_trace
from insgnss.report.html import Section
from insgnss.report.labels import label
from insgnss.report.run_time import gps_week
from insgnss.report.sections.motion import SIGMA_GROUPS, opening_range
from insgnss.runs.reference_errors import errors_against, trajectory_of
from insgnss.runs.result import Run
from insgnss.tables import Bool, Float64

_CAPTION: Final = (
    "Filter minus smoother. The band is three times the root of the variance that smoothing removed: a consistent"
    " filter stays within it."
)


def section(run: Run) -> Section | None:
    """Return the differences and both sigmas, None for a run that was not smoothed."""
    if run.filtered is None or run.filtered.empty:
        return None
    try:
        week = gps_week(run)
    except ResultError:
        return None
    errors = errors_against(run.filtered, trajectory_of(run.nav, week), week, None)
    time_s = errors["time_s"].to_numpy()
    known_s = run.heading_known_s()
    settled = time_s >= (-np.inf if known_s is None or known_s > time_s[-1] else known_s)
    charts = []
    for group, _, columns in SIGMA_GROUPS:
        values = [errors[f"d_{column}"].to_numpy() for column in columns]
        taken = [_taken_off(run, time_s, column, errors[f"sd_{column}"].to_numpy()) for column in columns]
        charts.append(_chart(group, columns, time_s, values, taken, settled))
    return Section("smoothing", "Filter against smoother", charts=charts)


def _taken_off(run: Run, time_s: Float64, column: str, sd: Float64) -> Float64:
    """Return the root of the filter's variance less the smoother's, at the filter's times."""
    smoothed = np.interp(time_s, run.nav["time_s"].to_numpy(), run.nav[f"sd_{column}"].to_numpy())
    return np.asarray(np.sqrt(np.maximum(sd**2 - smoothed**2, 0.0)))


def _chart(
    group: str,
    columns: Sequence[str],
    time_s: Float64,
    values: list[Float64],
    taken: list[Float64],
    settled: Bool,
) -> Chart:
    rows = ChartRows([label(column).axis() for column in columns])
    for row, column in enumerate(columns):
        rows.add(row, band_trace(time_s, np.zeros(len(time_s)), taken[row], colour_of(row)))
        rows.add(row, line_trace(time_s, values[row], label(column).words, colour_of(row)))
        rows.ranges[row] = opening_range(values[row][settled], taken[row][settled])
    name, title = f"chart-smoothing-{group}", f"Filter minus smoother: {group}"
    return rows.chart(name, title, row_px=140, caption=_CAPTION, showlegend=False)
