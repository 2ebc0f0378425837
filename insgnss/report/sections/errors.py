"""Errors against the reference, each within its band of three sigma, and their statistics."""

from __future__ import annotations

from typing import Final

import numpy as np
import pandas as pd

from insgnss.report.charts import BAND_SIGMAS, Chart, ChartRows, band_trace, colour_of, line_trace
from insgnss.report.html import Section, table
from insgnss.report.labels import label, row_of_numbers
from insgnss.report.sections.motion import SIGMA_GROUPS
from insgnss.runs.result import Run
from insgnss.tables import Float64

_SHOWN_SHARE: Final = 0.95  # of the values lies inside the axis as it opens
_HEADS: Final = (
    "",
    "mean",
    "rms",
    "50 %",
    "95 %",
    "largest",
    "mean sigma",
    "rms of error/sigma",
    "without slow errors",
)


def section(run: Run) -> Section | None:
    """Return the errors, None without a reference that covers the run."""
    if run.errors is None or run.errors.empty:
        return None
    errors = run.errors
    charts = [
        _chart(errors, group, columns, run.heading_known_s())
        for group, _, columns in SIGMA_GROUPS
        if errors[f"d_{columns[0]}"].notna().any()
    ]
    return Section("errors", "Errors against the reference", before=_statistics(run), charts=charts)


def opening_range(values: Float64, band: Float64) -> tuple[float, float]:
    """Return the axis that the share of errors and bands lies in, symmetric about zero."""
    size = np.fmax(np.abs(values), band)
    size = size[np.isfinite(size)]
    limit = 1.3 * float(np.quantile(size, _SHOWN_SHARE)) if len(size) else 1.0
    return (-limit, limit) if limit > 0.0 else (-1.0, 1.0)


def _chart(errors: pd.DataFrame, group: str, columns: tuple[str, ...], known_s: float | None) -> Chart:
    time_s = errors["time_s"].to_numpy()
    settled = time_s >= (-np.inf if known_s is None or known_s > time_s[-1] else known_s)
    rows = ChartRows([label(column).axis() for column in columns])
    for row, column in enumerate(columns):
        values, sigma = errors[f"d_{column}"].to_numpy(), errors[f"sd_{column}"].to_numpy()
        rows.add(row, band_trace(time_s, np.zeros(len(values)), sigma, colour_of(row)))
        rows.add(row, line_trace(time_s, values, f"error {label(column).words}", colour_of(row)))
        rows.ranges[row] = opening_range(values[settled], BAND_SIGMAS * sigma[settled])
    caption = (
        "Estimate minus reference, and three sigma. The axes first show 95 % of the errors after the heading became"
        " known; a double click shows all."
    )
    return rows.chart(f"chart-error-{group}", f"Error of the {group}", caption=caption, showlegend=False)


def _statistics(run: Run) -> str:
    known_s = run.heading_known_s()
    summary = run.error_summary()
    rows = []
    for name, row in summary.iterrows():
        columns = ("mean", "rms", "p50", "p95", "max", "mean_sigma")
        numbers = row_of_numbers(
            [float(row[column]) for column in columns], min(float(row["rms"]), float(row["mean_sigma"]))
        )
        noise = f"{row['rms_over_noise']:.2f}" if f"sd_slow_{name}" in run.nav else ""
        rows.append([label(str(name)).axis(), *numbers, f"{row['rms_over_sigma']:.2f}", noise])
    if run.errors is not None and known_s is not None and not known_s <= run.errors["time_s"].max():
        known_s = None  # the summary is of the whole reference then
    since = "" if known_s is None else f"<p>From {known_s:.1f} s on, when the heading was known.</p>"
    return since + table(_HEADS, rows)
