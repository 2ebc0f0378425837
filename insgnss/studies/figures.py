"""Pictures of the studies. matplotlib is loaded when a picture is asked for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import pandas as pd

from insgnss.results.matplotlib_figure import new_figure as new_figure

if TYPE_CHECKING:  # named for the other modules of this room, which draw through this one alone
    from matplotlib.axes import Axes as Axes
    from matplotlib.figure import Figure as Figure

# dark enough on white, and distinct for the colour-blind
COLOURS: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b8860b", "#56b4e9", "#555555")
_SHADE: Final = "#eeeeee"
SHOWN_AROUND_S: Final = 30.0  # before and after an outage


def variance_figure(
    table: pd.DataFrame, hidden: Sequence[str], outage_s: tuple[float, float], title: str
) -> Figure:
    """Return D of the hidden satellites' pseudoranges over time; the others in grey.

    Parameters
    ----------
    table : of ``HiddenVariance``
    hidden : names of the satellites to mark
    outage_s : first and last moment of the outage
    """
    figure = new_figure(9.0, 5.0)
    axes = figure.add_subplot()
    shade(axes, outage_s)
    shown = table[table["time_s"].between(outage_s[0] - SHOWN_AROUND_S, outage_s[1] + SHOWN_AROUND_S)]
    others = shown[~shown["sv"].isin(hidden)]
    for k, (_, rows) in enumerate(others.groupby("sv")):
        label = "the other satellites" if k == 0 else None
        axes.plot(rows["time_s"], rows["d_range_m2"], color="#bbbbbb", lw=0.8, label=label)
    for k, sv in enumerate(hidden):
        rows, colour = shown[shown["sv"] == sv], COLOURS[k % len(COLOURS)]
        axes.plot(rows["time_s"], rows["d_range_m2"], color=colour, lw=1.2, label=sv)
        off = rows[rows["hidden"]]
        axes.plot(off["time_s"], off["d_range_m2"], "o", ms=3.5, color=colour)
    axes.plot([], [], "o", ms=3.5, color="#333333", label="hidden: no update")
    axes.set_xlabel("time, s")
    axes.set_ylabel("D = h P⁻ hᵀ of the pseudorange, m²")
    axes.set_ylim(bottom=0.0)
    axes.set_title(title)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, ncols=2)
    return figure


def shade(axes: Axes, outage_s: tuple[float, float]) -> None:
    """Shade the time of the outage."""
    axes.axvspan(*outage_s, color=_SHADE, zorder=0)
