"""The aiding of the tracking loops for each satellite, and its uncertainty."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from insgnss.aiding.uncertainty import PARTS
from insgnss.report.charts import Chart, ChartRows, colour_of, dash_of, line_trace
from insgnss.report.epochs import satellites_of
from insgnss.report.html import Section
from insgnss.runs.result import Run


def section(run: Run) -> Section | None:
    """Return the aiding, None where it was not asked for."""
    table = run.aiding
    if table is None or table.empty:
        return None
    charts = [
        _by_satellite(
            table,
            "chart-aiding",
            "What the loops should expect",
            (("doppler_hz", "Doppler, Hz"), ("doppler_rate_hz_per_s", "Doppler rate, Hz/s")),
            log=False,
        ),
        _by_satellite(
            table,
            "chart-aiding-sigma",
            "Uncertainty of the aiding",
            (("sd_doppler_hz", "sigma of Doppler, Hz"), ("sd_doppler_rate_hz_per_s", "of its rate, Hz/s")),
            log=True,
        ),
    ]
    budget = getattr(run, "aiding_budget", None)
    if budget is not None and not budget.empty:
        charts.append(_budget(budget))
    return Section("aiding", "Loop aiding", charts=charts)


def _by_satellite(
    table: pd.DataFrame, name: str, title: str, columns: tuple[tuple[str, str], ...], *, log: bool
) -> Chart:
    rows = ChartRows([words for _, words in columns])
    place_of, names = satellites_of(table)
    for place, sv in enumerate(names):
        mine = table[place_of == place]
        time_s = mine["time_s"].to_numpy(np.float64)
        for row, (column, _) in enumerate(columns):
            values = mine[column].to_numpy(np.float64)
            more: dict[str, Any] = {"legendgroup": sv, "showlegend": row == 0}
            more["line"] = {"dash": dash_of(place)}
            rows.add(
                row, line_trace(time_s, values, sv, colour_of(place), at_most=_points(len(names)), **more)
            )
    if log:
        rows.kinds = dict.fromkeys(range(len(columns)), "log")
    return rows.chart(name, title, row_px=200)


def _budget(budget: pd.DataFrame) -> Chart:
    """Return the median over the satellites of each part of the Doppler's sigma."""
    rows = ChartRows(["sigma of the rate, m/s"])
    names = [f"sd_rate_{part}_mps" for part in PARTS if f"sd_rate_{part}_mps" in budget.columns]
    middle = budget.groupby("time_s")[names].median()
    time_s = middle.index.to_numpy(np.float64)
    for place, name in enumerate(names):
        values = middle[name].to_numpy(np.float64)
        values = np.where(values > 0.0, values, np.nan)
        if np.isfinite(values).any():
            rows.add(0, line_trace(time_s, values, name[8:-4].replace("_", " "), colour_of(place)))
    rows.kinds[0] = "log"
    caption = "Median over the satellites; parts that are zero are not drawn."
    return rows.chart("chart-aiding-budget", "Error budget of the Doppler", row_px=260, caption=caption)


def _points(satellites: int) -> int:
    """Return how many points each of so many lines may have."""
    return max(9000 // max(satellites, 1), 150)
