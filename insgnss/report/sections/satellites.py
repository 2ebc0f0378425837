"""Satellites tracked over time: a line per satellite, coloured by its status, and the number used."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import pandas as pd
from pandas.api.types import union_categoricals

from insgnss.report.charts import (
    PALETTE,
    TIME_AXIS,
    Chart,
    ChartRows,
    Trace,
    colour_of,
    line_trace,
    lines,
    packed,
)
from insgnss.report.epochs import of_satellites, satellites_of, satellites_used
from insgnss.report.html import Section
from insgnss.report.thinning import columns_of_time
from insgnss.runs.result import Run
from insgnss.status import NAMES
from insgnss.tables import Bool, Float64, Int64

_COLUMNS: Final = 1500  # of the picture's time
# of the states that are seen most; each other status has a colour of its own beyond the palette
_STATUS_COLOURS: Final = {
    "tracked": "#009e73",
    "gated": "#d55e00",
    "no_ephemeris": "#56b4e9",
    "stale_ephemeris": "#0072b2",
    "masked_elevation": "#8c8c8c",
    "masked_cn0": "#b8a800",
    "masked_gain": "#cc79a7",
    "masked_obstruction": "#882255",
    "inconsistent": "#a65628",
    "drifting": "#e69f00",
    "reflected": "#9b6cff",
    "unhealthy": "#c51b7d",
    "not_started": "#c8b8a8",
    "used_for_start": "#66c2a5",
    "no_imu": "#707070",
    "absent": "#b0b0b0",
}
_STATUSES: Final = tuple(NAMES.values())
_CHANNEL_COLOURS: Final = {
    "track": "#009e73",
    "hold": "#e69f00",
    "search": "#d55e00",
    "control_detection": "#cc79a7",
    "resume": "#56b4e9",
    "lost": "#8c8c8c",
}
_SAME_TIME_S: Final = 1e-4


def state_colour(state: str) -> str:
    """Return the colour of a satellite's status, or of a supervised channel's state: no two of either have one."""
    known = _STATUS_COLOURS.get(state) or _CHANNEL_COLOURS.get(state)
    place = _STATUSES.index(state) if state in _STATUSES else len(_STATUSES)
    return known or colour_of(len(PALETTE) + place)


def section(run: Run) -> Section | None:
    """Return the satellites' timeline and number, None where the run has seen none."""
    if run.satellites.empty:
        return None
    rows = ChartRows(["satellites used"])
    time_s, used = satellites_used(run)
    step = {"shape": "hv"}
    rows.add(0, line_trace(time_s, used.astype(np.float64), "used", "#0072b2", line=step, fill="tozeroy"))
    rows.ranges[0] = (0.0, float(used.max()) * 1.1 + 0.5)
    count = rows.chart("chart-used", "Satellites used at each epoch", row_px=160, showlegend=False)
    caption = "Where the plot cannot resolve every epoch, refused measurements are drawn over tracked ones."
    timeline = timeline_chart(states_of_the_log(run), "chart-timeline", "Satellites and their state", caption)
    return Section("satellites", "Satellites", charts=(timeline, count))


def states_of_the_log(run: Run) -> pd.DataFrame:
    """Return time_s, sv and state of every satellite of the log, those too that nothing was computed for.

    A satellite without ephemeris has no direction, and no row in the table of satellites: its state is then that of
    its first measurement.
    """
    seen = run.satellites[["time_s", "sv", "state"]]
    ledger = of_satellites(run.measurements)
    ledger = ledger.loc[(ledger["status"] != "used").to_numpy(), ["time_s", "sv", "status"]]
    ledger = ledger.rename(columns={"status": "state"})
    # words stay numbers into their lists: an hour's table has a million rows
    sv, states = (
        union_categoricals([pd.Categorical(part[name]) for part in (seen, ledger)])
        for name in ("sv", "state")
    )
    time_s = np.concatenate([seen["time_s"], ledger["time_s"]])
    key = np.rint(time_s / _SAME_TIME_S).astype(np.int64) * len(sv.categories) + sv.codes
    n = len(seen)
    wanted, first = np.unique(key[n:], return_index=True)
    if len(wanted) == 0:
        return seen
    # the few are sorted, and each of the many looked up among them
    place = np.minimum(np.searchsorted(wanted, key[:n]), len(wanted) - 1)
    has_row = np.zeros(len(wanted), np.bool_)
    has_row[place[wanted[place] == key[:n]]] = True
    unseen = n + np.sort(first[~has_row])
    rows = np.concatenate([np.arange(n), unseen])
    return pd.DataFrame({"time_s": time_s[rows], "sv": sv[rows], "state": states[rows]})


def timeline_chart(table: pd.DataFrame, name: str, title: str, caption: str = "") -> Chart:
    """Return a line per satellite, coloured by the column ``state``.

    Parameters
    ----------
    table : one row per satellite and time: ``time_s``, ``sv``, ``state``
    name : the chart's place on the page
    """
    place, present = satellites_of(table)
    traces = []
    columns = columns_of_time(table["time_s"].to_numpy(np.float64), _COLUMNS)
    counts = table["state"].value_counts()
    # the most frequent state first, the rare ones over it
    for state in [str(s) for s in counts.index if counts[s] > 0]:
        traces.append(_state_trace((table["state"] == state).to_numpy(), place, columns, state, present))
    layout: dict[str, Any] = {
        "xaxis": dict(TIME_AXIS),
        "yaxis": {"type": "category", "categoryorder": "array", "categoryarray": present[::-1]},
        "showlegend": True,
    }
    layout["yaxis"] |= {"range": [-0.6, len(present) - 0.4], "tickmode": "linear"}
    return Chart(name, title, traces, layout, 110 + 20 * max(len(present), 5), caption, linked=True)


def _state_trace(
    here: Bool,
    place: Int64,
    columns: tuple[Int64, float, float],
    state: str,
    present: list[str],
) -> Trace:
    """Return one state's stretches of all satellites, as one broken line."""
    column, first, width = columns
    sv = place[here]
    # one more: the last column of a satellite never touches the next one's first
    n_columns = int(column.max()) + 2
    cells = np.unique(sv * np.int64(n_columns) + column[here])
    starts = np.flatnonzero(np.diff(cells, prepend=cells[0] - 2) > 1)
    ends = np.append(starts[1:], len(cells)) - 1
    row = cells[starts] // n_columns
    x: Float64 = np.full(3 * len(starts), np.nan)
    x[0::3] = first + width * (cells[starts] % n_columns)
    x[1::3] = first + width * (cells[ends] % n_columns + 1)
    x[2::3] = x[1::3]
    y = [name for sat in row.tolist() for name in (present[sat], present[sat], None)]
    hover = f"%{{y}}: {state}<br>%{{x:.2f}} s<extra></extra>"
    style = {"color": state_colour(state), "width": 9}
    return lines(state.replace("_", " "), packed(x, double=True), y, style, hovertemplate=hover)
