"""Height, velocity and attitude over time with their bands, and the size of their sigmas."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from insgnss.report.charts import BAND_SIGMAS, Chart, ChartRows, band_trace, colour_of, line_trace
from insgnss.report.html import Section
from insgnss.report.labels import label
from insgnss.results.nav_columns import ATTITUDE, POSITION, VELOCITY
from insgnss.runs.result import Run
from insgnss.tables import Float64

# column, its sigma, and the period of an angle
_HEIGHT: Final = (("h_m", "sd_d_m", None),)
_VELOCITY: Final = tuple((f"v{axis}_mps", f"sd_v{axis}_mps", None) for axis in "ned")
_ATTITUDE: Final = tuple((f"{angle}_deg", f"sd_{angle}_deg", 360.0) for angle in ("roll", "pitch", "yaw"))
_LINES: Final = ("north, roll", "east, pitch", "down, yaw")
SIGMA_GROUPS: Final = (
    ("position", "m", POSITION),
    ("velocity", "m/s", VELOCITY),
    ("attitude", "°", ATTITUDE),
)


def section(run: Run) -> Section:
    """Return height, velocity and attitude with bands of three sigma, and the sigma themselves."""
    charts = (
        _banded(run, "chart-height", "Height above the ellipsoid", _HEIGHT, 240),
        _banded(run, "chart-velocity", "Velocity", _VELOCITY, 150),
        _banded(run, "chart-attitude", "Attitude", _ATTITUDE, 150),
        _sigmas(run),
    )
    return Section("motion", "Height, velocity, attitude", charts=charts)


def opening_range(values: Float64, sigma: Float64) -> tuple[float, float]:
    """Return the axis that shows every value and the usual band, but not how wide it was at the start."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    margin = max(0.08 * (high - low), 1.3 * BAND_SIGMAS * float(np.nanmedian(sigma)), 1e-6)
    return low - margin, high + margin


def _banded(
    run: Run, name: str, title: str, columns: Sequence[tuple[str, str, float | None]], row_px: int
) -> Chart:
    nav = run.nav
    time_s = nav["time_s"].to_numpy()
    rows = ChartRows([label(column).axis() for column, _, _ in columns])
    for row, (column, sigma, period) in enumerate(columns):
        colour, values = colour_of(row), nav[column].to_numpy()
        rows.add(row, band_trace(time_s, values, nav[sigma].to_numpy(), colour, period=period))
        rows.add(row, line_trace(time_s, values, label(column).words, colour, period=period))
        rows.ranges[row] = opening_range(values, nav[sigma].to_numpy())
        if period is not None and np.ptp(rows.ranges[row]) > 0.5 * period:
            rows.more[row] = {"dtick": 0.25 * period}  # quarters of the circle
    caption = "The band is three sigma to either side; where it cannot be seen, it is thinner than the line."
    return rows.chart(name, title, row_px=row_px, caption=caption, showlegend=False)


def _sigmas(run: Run) -> Chart:
    """Return one sigma of position, velocity and attitude over time, in the colours of the axes above."""
    time_s = run.nav["time_s"].to_numpy()
    rows = ChartRows([f"{group}, {unit}" for group, unit, _ in SIGMA_GROUPS])
    for row, (_, _, columns) in enumerate(SIGMA_GROUPS):
        rows.kinds[row] = "log"
        for place, column in enumerate(columns):
            values = run.nav[f"sd_{column}"].to_numpy()
            more: dict[str, Any] = {"legendgroup": place, "showlegend": row == 0}
            rows.add(row, line_trace(time_s, values, _LINES[place], colour_of(place), **more))
    return rows.chart("chart-sigma", "One sigma", row_px=170)
