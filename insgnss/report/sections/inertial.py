"""The inertial log as it came in: extremes of rate and specific force over time, and their spectra."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import pandas as pd

from insgnss.report.charts import (
    Chart,
    ChartRows,
    Trace,
    colour_of,
    lines,
    log_ticks,
    packed,
    translucent,
    unpacked,
)
from insgnss.report.html import Section
from insgnss.runs.result import Run
from insgnss.tables import Float64

_SENSORS: Final = (("gyro", "degps", "rate, °/s"), ("accel", "mps2", "specific force, m/s²"))
_AXES: Final = (("x", "forward"), ("y", "right"), ("z", "down"))


def section(run: Run) -> Section | None:
    """Return the sensors' measurements, None for a run without them."""
    if run.imu is None or run.imu.empty:
        return None
    charts = [_over_time(run.imu)]
    if run.imu_spectrum is not None and not run.imu_spectrum.empty:
        charts.append(_spectrum(run.imu_spectrum))
    return Section("inertial", "Inertial sensors", charts=charts)


def _over_time(table: pd.DataFrame) -> Chart:
    rows = ChartRows([words for _, _, words in _SENSORS])
    time_s = table["time_s"].to_numpy()
    for row, (sensor, unit, _) in enumerate(_SENSORS):
        for place, (axis, words) in enumerate(_AXES):
            low, high = (table[f"{sensor}_{axis}_{end}_{unit}"].to_numpy() for end in ("min", "max"))
            rows.add(row, _between(time_s, low, high, words, place, row == 0))
    caption = (
        "What the sensors measured in body axes, before the filter subtracts a bias: the smallest and largest value of"
        " each interval."
    )
    return rows.chart("chart-imu", "Rates and specific forces", row_px=190, caption=caption)


def _between(time_s: Float64, low: Float64, high: Float64, words: str, place: int, named: bool) -> Trace:
    """Return the area between two lines over time, as wide as a line where they are one."""
    colour = colour_of(place)
    x = packed(np.concatenate([time_s, time_s[::-1]]), double=True)
    y = packed(np.concatenate([low, high[::-1]]))
    more = {"legendgroup": words, "showlegend": named, "hoverinfo": "skip"}
    more |= {"fill": "toself", "fillcolor": translucent(colour, 0.5)}
    return lines(words, x, y, {"color": colour, "width": 1}, **more)


def _spectrum(table: pd.DataFrame) -> Chart:
    """Return both sensors' amplitude spectral density over the frequency."""
    frequency_hz = table["frequency_hz"].to_numpy(np.float64)
    frequency = packed(frequency_hz)
    traces: list[Trace] = []
    for row, (sensor, unit, _) in enumerate(_SENSORS):
        for place, (axis, words) in enumerate(_AXES):
            values = table[f"{sensor}_{axis}_{unit}_per_sqrt_hz"].to_numpy()
            y, style = packed(np.where(values > 0.0, values, np.nan)), {"color": colour_of(place), "width": 1}
            axes = {"xaxis": "x", "yaxis": "y" if row == 0 else "y2"}
            more = {"legendgroup": words, "showlegend": row == 0, **axes}
            traces.append(lines(words, frequency, y, style, **more))
    layout = {
        "xaxis": _log("frequency, Hz", frequency_hz, anchor="y2"),
        "yaxis": _log("gyro, °/s/√Hz", _drawn(traces, "y"), domain=[0.53, 1.0]),
        "yaxis2": _log("acc., m/s²/√Hz", _drawn(traces, "y2"), domain=[0.0, 0.47]),
    }
    caption = (
        "Amplitude spectral density over the whole log, the mean over up to 64 intervals. White noise is level;"
        " engines, propellers and resonances of the mounting are lines."
    )
    return Chart("chart-imu-spectrum", "Spectrum of the inertial sensors", traces, layout, 430, caption)


def _drawn(traces: list[Trace], axis: str) -> Float64:
    return np.concatenate([unpacked(trace["y"]) for trace in traces if trace["yaxis"] == axis])


def _log(words: str, values: Float64, **more: Any) -> dict[str, Any]:
    return {"title": {"text": words}, "type": "log", **log_ticks(values), **more}
