"""Reception and geometry: C/N0 of each satellite, and the dilution of precision of those used."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import pandas as pd

from insgnss.geodesy.directions import directions
from insgnss.report.charts import Chart, ChartRows, colour_of, dash_of, line_trace
from insgnss.report.epochs import satellites_of
from insgnss.report.html import Section
from insgnss.runs.result import Run
from insgnss.tables import Float64

_POINTS: Final = 12000  # of all satellites' lines together
_MOST_DOP: Final = 50.0  # a larger one is not a useful geometry, and would flatten the others
_LEAST: Final = 4  # satellites, for a position and a clock


def section(run: Run) -> Section | None:
    """Return C/N0 and dilution over time, None where the run has seen no satellite."""
    if run.satellites.empty:
        return None
    charts = [chart for chart in (_cn0(run.satellites), _dop(run.satellites)) if chart is not None]
    return Section("reception", "Reception and geometry", charts=charts) if charts else None


def _cn0(table: pd.DataFrame) -> Chart | None:
    if "cn0_dbhz" not in table or not table["cn0_dbhz"].notna().any():
        return None
    rows = ChartRows(["C/N0, dBHz"])
    place_of, names = satellites_of(table)
    each = max(_POINTS // max(len(names), 1), 150)
    for place, sv in enumerate(names):
        mine = table[(place_of == place) & table["cn0_dbhz"].notna().to_numpy()]
        if mine.empty:
            continue
        values = mine["cn0_dbhz"].to_numpy(np.float64)
        style: dict[str, Any] = {"line": {"dash": dash_of(place), "width": 1.2}}
        rows.add(
            0, line_trace(mine["time_s"].to_numpy(), values, sv, colour_of(place), at_most=each, **style)
        )
    caption = (
        "For each satellite, the signal that was used. Click a name to hide it, double-click to see it alone."
    )
    return rows.chart("chart-cn0", "C/N0 of each satellite", row_px=300, caption=caption)


def _dop(table: pd.DataFrame) -> Chart | None:
    used = table[(table["state"] == "tracked").to_numpy()]
    time_s, dop = dilution_of_directions(
        *(used[name].to_numpy(np.float64) for name in ("time_s", "az_deg", "el_deg"))
    )
    if not np.isfinite(dop).any():
        return None
    rows = ChartRows(["dilution"])
    for place, name in enumerate(("PDOP", "HDOP", "VDOP")):
        values = np.where(dop[:, place] <= _MOST_DOP, dop[:, place], np.nan)
        rows.add(0, line_trace(time_s, values, name, colour_of(place)))
    caption = (
        "DOP of the satellites used, each counted once, with one receiver clock. The inertial sensors bridge its gaps;"
        f" values above {_MOST_DOP:g} are not drawn."
    )
    return rows.chart("chart-dop", "Dilution of precision", row_px=220, caption=caption)


def dilution_of_directions(time_s: Float64, az_deg: Float64, el_deg: Float64) -> tuple[Float64, Float64]:
    """Return the epochs (m,) and PDOP, HDOP, VDOP of each (m, 3), NaN where the directions do not give a position.

    Equation: Q = (H^T H)^-1 with the rows h = (-u_ned, 1), PDOP^2 = Q_nn + Q_ee + Q_dd  [Misra and Enge 2011, 6.1.2]
    Neglects: further clocks, one for each constellation: what they cost a snapshot, the filter knows from before.

    Parameters
    ----------
    time_s, az_deg, el_deg : (n,) a row for each satellite used, in any order
    """
    epochs, epoch = np.unique(time_s, return_inverse=True)
    h = np.column_stack([-directions(az_deg, el_deg), np.ones(len(az_deg))])
    normal = np.empty((len(epochs), 4, 4))
    for i in range(4):
        for j in range(4):
            normal[:, i, j] = np.bincount(epoch, h[:, i] * h[:, j], minlength=len(epochs))
    enough = np.bincount(epoch, minlength=len(epochs)) >= _LEAST
    # satellites in one plane or on one cone give none; the smallest eigenvalue is 1 / the largest part of Q
    enough &= np.linalg.eigvalsh(normal)[:, 0] > _MOST_DOP**-2 / 4.0
    dop = np.full((len(epochs), 3), np.nan)
    variance = np.diagonal(np.linalg.inv(normal[enough]), axis1=1, axis2=2)
    dop[enough, 0] = np.sqrt(variance[:, :3].sum(axis=1))
    dop[enough, 1] = np.sqrt(variance[:, :2].sum(axis=1))
    dop[enough, 2] = np.sqrt(variance[:, 2])
    return epochs, dop
