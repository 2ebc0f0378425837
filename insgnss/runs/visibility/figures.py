"""Pictures of a study: the sky in body axes over the pattern, a timeline per satellite, dilution with and without.

matplotlib is loaded when a picture is asked for.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from insgnss.antenna.equipment import limits_of
from insgnss.antenna.visibility import DECISIONS, gain_map
from insgnss.results.matplotlib_figure import MOST_LABELS, new_figure, save_figure, with_caption
from insgnss.runs.datum import what_and_when
from insgnss.runs.visibility.study import VisibilityStudy

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PICTURES: Final = ("visibility_sky.png", "visibility_timeline.png", "visibility_dop.png")
COLOURS: Final = dict(zip(DECISIONS, ("#b2182b", "#1b7837", "#ef8a62", "#7fbf7b"), strict=True))
_BELOW: Final = "#cccccc"  # under the elevation mask
_GRID_DEG: Final = 2.0  # of the pattern's picture


def save_figures(study: VisibilityStudy, folder: str | Path) -> list[Path]:
    """Write ``visibility_sky.png``, ``_timeline.png`` and ``_dop.png`` into ``folder``; return their paths.

    Raises
    ------
    ResultError : the folder cannot be written
    """
    drawn: tuple[Callable[[VisibilityStudy], Figure], ...] = (sky_figure, timeline_figure, dop_figure)
    return [save_figure(draw(study), Path(folder) / name) for name, draw in zip(PICTURES, drawn, strict=True)]


def sky_figure(study: VisibilityStudy) -> Figure:
    """Return the satellites' ways in body axes, forward up, over the gain of the best antenna.

    The middle is up (-z of the body), the inner circle the body's own horizon, the rim straight down.
    """
    figure = new_figure(8.0, 7.0)
    axes: Any = figure.add_subplot(projection="polar")  # its own class, with a direction of its angle
    axes.set_theta_zero_location("N")
    axes.set_theta_direction(-1)
    azimuth, down = np.radians(np.arange(0.0, 360.1, _GRID_DEG)), np.arange(0.0, 180.1, _GRID_DEG)
    if len(study.antennas.lever_b):
        gain = gain_map(study.antennas, limits_of(study.settings), np.degrees(azimuth), down)
        shown = axes.pcolormesh(azimuth, down, gain, shading="gouraud", cmap="Greys_r", rasterized=True)
        figure.colorbar(shown, ax=axes, label="gain of the best antenna, dBic", shrink=0.8)
        threshold = limits_of(study.settings).threshold_dbic
        if np.nanmin(gain) < threshold < np.nanmax(gain):
            axes.contour(azimuth, down, gain, levels=[threshold], colors="#2166ac", linewidths=1.0)
    table = study.satellites[study.satellites["reason"] != "masked_elevation"]
    for decision, colour in COLOURS.items():
        rows = table[table["decision"] == decision]
        if len(rows):
            label = decision.replace("_", ", ")
            place = np.radians(rows["body_az_deg"]), 90.0 - rows["body_el_deg"]
            axes.plot(*place, ".", ms=2.5, color=colour, label=label)
    for sv, rows in table.groupby("sv", observed=True):
        last = rows.iloc[-1]
        axes.annotate(str(sv), (np.radians(last["body_az_deg"]), 90.0 - last["body_el_deg"]), fontsize=8)
    axes.set_ylim(0.0, 180.0)
    axes.set_yticks([45.0, 90.0, 135.0], ["45°", "0°", "-45°"])
    axes.set_title("Satellites in body axes (azimuth from forward to the right)")
    if axes.get_legend_handles_labels()[1]:
        axes.legend(loc="lower left", bbox_to_anchor=(-0.15, -0.1), fontsize=8, markerscale=4)
    return with_caption(figure, what_and_when(study.satellites))


def timeline_figure(study: VisibilityStudy) -> Figure:
    """Return a line per satellite, coloured by the decision; grey while it is under the elevation mask."""
    table = study.satellites
    shown = table.loc[table["reason"] != "masked_elevation", "sv"]
    names = sorted(shown.astype("str").unique())[:MOST_LABELS]
    figure = new_figure(9.0, 1.5 + 0.25 * max(len(names), 4))
    axes = figure.add_subplot()
    for row, name in enumerate(names):
        rows = table[table["sv"] == name]
        below = rows["reason"] == "masked_elevation"
        axes.plot(rows["time_s"][below], np.full(below.sum(), row), "|", ms=6, color=_BELOW)
        for decision, colour in COLOURS.items():
            at = rows.loc[(rows["decision"] == decision) & ~below, "time_s"]
            axes.plot(at, np.full(len(at), row), "|", ms=8, color=colour)
    for decision, colour in COLOURS.items():
        axes.plot([], [], "|", ms=8, mew=3, color=colour, label=decision.replace("_", ", "))
    axes.plot([], [], "|", ms=8, mew=3, color=_BELOW, label="under the elevation mask")
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names), -1)
    axes.set_xlabel("time, s of the GPS week")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 1.0 + 1.0 / (len(names) + 4)), ncols=5, fontsize=8)
    return with_caption(figure, what_and_when(study.satellites))


def dop_figure(study: VisibilityStudy) -> Figure:
    """Return position dilution and number of satellites over time, with and without the stage."""
    figure, table = new_figure(9.0, 6.0), study.dop
    upper = figure.add_subplot(2, 1, 1)
    lower = figure.add_subplot(2, 1, 2, sharex=upper)
    for label, colour, words in (
        ("all", "#999999", "above the elevation mask"),
        ("seen", "#2166ac", "seen by an antenna"),
    ):
        upper.plot(table["time_s"], table[f"pdop_{label}"], color=colour, label=words)
        lower.step(table["time_s"], table[f"n_{label}"], where="post", color=colour, label=words)
    if np.isfinite(table[["pdop_all", "pdop_seen"]].to_numpy()).any():
        upper.set_yscale("log")
    for ticks in (upper.yaxis.set_major_formatter, upper.yaxis.set_minor_formatter):
        ticks("{x:g}")
    upper.set_ylabel("PDOP")
    upper.legend(fontsize=8)
    lower.set_ylabel("satellites")
    lower.set_xlabel("time, s of the GPS week")
    lower.set_ylim(bottom=0)
    for axes in (upper, lower):
        axes.grid(alpha=0.3)
    return with_caption(figure, what_and_when(study.satellites))
