"""The one picture of a flown margin: J/S against both limits, satellites in lock, and a line per satellite.

matplotlib is loaded when the picture is asked for.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from insgnss.results.matplotlib_figure import MOST_LABELS, new_figure, save_figure, with_caption
from insgnss.runs.datum import what_and_when
from insgnss.runs.margin.study import FlownMargin

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

AIDED: Final = "#2166ac"
UNAIDED: Final = "#b2182b"
INTERFERENCE: Final = "#333333"
_STATES: Final = (
    ("both loops in lock", "#7fbf7b"),
    ("the aided loop alone", AIDED),
    ("the loop without aiding alone", "#ef8a62"),
    ("neither", UNAIDED),
)


PICTURE_FILE: Final = "margin_flown.png"


def picture(study: FlownMargin, path: str | Path) -> Path:
    """Write the picture; return its path.

    Raises
    ------
    ResultError : the file cannot be written
    """
    return save_figure(flown_figure(study), path)


def flown_figure(study: FlownMargin) -> Figure:
    """Return J/S and limits (median and span over satellites), numbers in lock, and each satellite's timeline."""
    names = sorted(study.satellites["sv"].astype("str").unique())[:MOST_LABELS]
    rows = max(len(names), 4)
    figure = new_figure(10.0, 6.5 + 0.22 * rows)
    upper, middle, lower = figure.subplots(
        3, 1, sharex=True, gridspec_kw={"height_ratios": [3.5, 2.0, 0.22 * rows]}
    )
    _draw_ratios(upper, study)
    _draw_numbers(middle, study)
    _draw_timeline(lower, study, names)
    upper.set_title(study.settings.name or "Interference along the path")
    return with_caption(figure, what_and_when(study.satellites))


def _draw_ratios(axes: Axes, study: FlownMargin) -> None:
    """Draw J/S and the limits of both loops: line of the median satellite, band from the worst to the best."""
    for column, colour, label in (
        ("js_limit_unaided_db", UNAIDED, "limit without aiding"),
        ("js_limit_aided_db", AIDED, "limit with aiding"),
        ("js_db", INTERFERENCE, "J/S at the antenna"),
    ):
        finite = study.satellites[np.isfinite(study.satellites[column])]
        groups = finite.groupby("time_s")[column]
        time = np.array(sorted(groups.groups), np.float64)
        axes.plot(time, groups.median(), color=colour, label=label)
        axes.fill_between(time, groups.min(), groups.max(), color=colour, alpha=0.15, linewidth=0.0)
    axes.set_ylabel("J/S, dB")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)


def _draw_numbers(axes: Axes, study: FlownMargin) -> None:
    counts = study.in_lock()
    axes.step(
        counts["time_s"], counts["n_satellites"], where="post", color="#999999", label="above the horizon"
    )
    axes.step(counts["time_s"], counts["lock_aided"], where="post", color=AIDED, label="in lock with aiding")
    axes.step(
        counts["time_s"], counts["lock_unaided"], where="post", color=UNAIDED, ls="--", label="without aiding"
    )
    axes.set_ylabel("satellites")
    axes.set_ylim(bottom=0)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, ncols=3)


def _draw_timeline(axes: Axes, study: FlownMargin, names: list[str]) -> None:
    table = study.satellites
    locked = table["lock_aided"], table["lock_unaided"]
    states = (locked[0] & locked[1], locked[0] & ~locked[1], locked[1] & ~locked[0], ~locked[0] & ~locked[1])
    for (label, colour), of_state in zip(_STATES, states, strict=True):
        for row, name in enumerate(names):
            at = table.loc[of_state & (table["sv"] == name), "time_s"]
            axes.plot(at, np.full(len(at), row), "|", ms=7, color=colour)
        axes.plot([], [], "|", ms=8, mew=3, color=colour, label=label)
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names), -1)
    axes.set_xlabel("time, s of the GPS week")
    # between the panels: at the foot it would cover the figure's caption
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=4, fontsize=8)
