"""Biases of the inertial sensors, the receiver's clock, and the optional states."""

from __future__ import annotations

import numpy as np

from insgnss.constants import STANDARD_GRAVITY_MPS2
from insgnss.report.charts import Chart, ChartRows, band_trace, colour_of, line_trace
from insgnss.report.html import Section
from insgnss.report.labels import label
from insgnss.runs.result import Run
from insgnss.tables import Float64

_RADPS_TO_DEG_PER_H = np.degrees(1.0) * 3600.0
_MPS2_TO_MG = 1000.0 / STANDARD_GRAVITY_MPS2


def section(run: Run) -> Section:
    """Return biases and clock over time with their bands."""
    charts = [
        _biases(run, "accel", "mps2", _MPS2_TO_MG, "mg", "Accelerometer bias"),
        _biases(run, "gyro", "radps", _RADPS_TO_DEG_PER_H, "°/h", "Gyro bias"),
        _clock(run),
    ]
    names = [name for name in run.nav.columns if name.startswith(("offset_", "glonass_", "zenith_"))]
    offsets = [name for name in names if run.nav[name].any()]  # of a band that was never used it stays zero
    if offsets:
        charts.append(_optional(run, offsets))
    return Section("biases", "Biases and clock", charts=charts)


def _biases(run: Run, sensor: str, ending: str, factor: float, unit: str, title: str) -> Chart:
    time_s = run.nav["time_s"].to_numpy()
    rows = ChartRows([f"{axis}, {unit}" for axis in ("forward", "right", "down")])
    for row, axis in enumerate("xyz"):
        column = f"{sensor}_bias_{axis}_{ending}"
        values, sigma = (factor * run.nav[name].to_numpy() for name in (column, f"sd_{column}"))
        _band(rows, row, time_s, values, sigma)
    caption = "Estimated bias in body axes and three sigma."
    name = f"chart-bias-{sensor}"
    return rows.chart(name, title, row_px=130, caption=caption, showlegend=False)


def _clock(run: Run) -> Chart:
    """Return clock bias less its straight line, which would hide all else, and drift."""
    nav = run.nav
    time_s, bias = nav["time_s"].to_numpy(), nav["clock_bias_m"].to_numpy()
    centred = time_s - time_s.mean()
    slope, level = np.polyfit(centred, bias, 1) if len(bias) > 2 else (0.0, float(bias.mean()))
    rows = ChartRows(["bias minus line, m", "drift, m/s"])
    _band(rows, 0, time_s, bias - (level + slope * centred), nav["sd_clock_bias_m"].to_numpy())
    _band(rows, 1, time_s, nav["clock_drift_mps"].to_numpy(), nav["sd_clock_drift_mps"].to_numpy())
    caption = (
        f"Subtracted from the bias: a line of {slope:.3f} m/s; at the first row the bias was {bias[0]:.1f} m."
    )
    return rows.chart("chart-clock", "Receiver clock", row_px=150, caption=caption, showlegend=False)


def _optional(run: Run, names: list[str]) -> Chart:
    time_s = run.nav["time_s"].to_numpy()
    rows = ChartRows(["offset minus median"])
    for place, name in enumerate(names):
        values = run.nav[name].to_numpy()
        middle = float(np.nanmedian(values)) if np.isfinite(values).any() else 0.0
        words = f"{label(name).words} ({middle:.2f} {label(name).unit})"
        rows.add(0, line_trace(time_s, values - middle, words, colour_of(place)))
    caption = "Offsets between constellations and bands, in metres; the legend gives the median subtracted from each."
    return rows.chart("chart-offsets", "Clock offsets and optional states", row_px=240, caption=caption)


def _band(rows: ChartRows, row: int, time_s: Float64, values: Float64, sigma: Float64) -> None:
    rows.add(row, band_trace(time_s, values, sigma, colour_of(row)))
    rows.add(row, line_trace(time_s, values, "estimate", colour_of(row)))
