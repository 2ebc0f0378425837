"""Pictures of the masking study: errors over time, status of each row, time until a satellite is tracked again."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

import numpy as np
import pandas as pd

from insgnss.studies.figures import COLOURS, SHOWN_AROUND_S, new_figure, shade

if TYPE_CHECKING:
    from insgnss.studies.figures import Axes, Figure

_BELIEVED_FALSE, _REFUSED_FALSE, _USED_TRUE, _REFUSED_TRUE = "#b2182b", "#ef8a62", "#1b7837", "#7b3294"
_LINES: Final = {"a": (3.0, "-"), "b": (1.2, "--"), "c": (2.4, "-"), "d": (1.2, "--")}


def error_figure(
    errors: pd.DataFrame, outage_s: tuple[float, float], words: Mapping[str, str], title: str
) -> Figure:
    """Return the rms of the position error over the flights, at each epoch, one line per case.

    Parameters
    ----------
    words : of each case, by its letter
    """
    figure = new_figure(9.0, 5.0)
    axes = figure.add_subplot()
    shade(axes, outage_s)
    shown = errors[errors["time_s"].between(outage_s[0] - SHOWN_AROUND_S, outage_s[1] + 2.0 * SHOWN_AROUND_S)]
    for k, (case, name) in enumerate(words.items()):
        rows = shown[shown["case"] == case].assign(square=lambda t: t["error_m"] ** 2)
        rms = np.sqrt(rows.groupby("time_s")["square"].mean())
        width, style = _LINES.get(case, (1.5, "-"))
        axes.plot(rms.index, rms, style, lw=width, color=COLOURS[k % len(COLOURS)], label=f"({case}) {name}")
    flights = errors["run"].nunique()
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("{x:g}")
    axes.tick_params(axis="y", which="minor", labelsize=7)
    axes.set_xlabel("time, s")
    axes.set_ylabel(f"position error, m (rms of {flights} flights)" if flights > 1 else "position error, m")
    axes.set_title(title)
    axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize=8)
    return figure


def rows_figure(rows: pd.DataFrame, spells: pd.DataFrame, words: Mapping[str, str], title: str) -> Figure:
    """Return the pseudoranges of the hidden satellites in one flight: true or false, used or refused.

    A bar shows when the satellite was truly hidden, a bracket when its channel measured it again.
    """
    names = sorted(spells["sv"].unique())
    figure = new_figure(10.0, 1.2 + 1.75 * len(words))
    first, last = spells["lost_s"].min() - 3.0, spells["returned_s"].max() + 7.0
    panels = figure.subplots(len(words), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (case, name) in zip(panels, words.items(), strict=True):
        own = spells[spells["case"] == case]
        for spell in own.itertuples():
            y = names.index(str(spell.sv))
            axes.plot([spell.lost_s, spell.returned_s], [y, y], color="#dddddd", lw=11, solid_capstyle="butt")
            axes.plot([spell.tracked_s], [y], "|", ms=13, mew=1.8, color="#333333")
        table = rows[(rows["case"] == case) & (rows["kind"] == "pseudorange")]
        _draw_rows(axes, table[table["time_s"].between(first, last)], names)
        locks = {str(s.sv): str(s.lock) for s in own.itertuples() if s.how != "supervised"}
        labels = [f"{sv}, {locks[sv].replace('_', ' ')}" if sv in locks else sv for sv in names]
        axes.set_yticks(range(len(names)), labels, fontsize=8)
        axes.set_ylim(len(names) - 0.4, -0.6)
        axes.set_title(f"({case}) {name}", fontsize=9, loc="left")
    panels[-1].set_xlim(first, last)
    panels[-1].set_xlabel("time, s")
    figure.suptitle(f"Pseudoranges of the hidden satellites in one flight\n{title}", fontsize=10)
    _legend_of_rows(figure, panels[0])
    return figure


def _draw_rows(axes: Axes, table: pd.DataFrame, names: list[str]) -> None:
    place = table["sv"].map(names.index)
    false, believed = table["lock"] != "", table["believed"]
    for wanted, marker, colour in (
        (~false & believed, "o", _USED_TRUE),
        (~false & ~believed, "x", _REFUSED_TRUE),
        (false & believed, "s", _BELIEVED_FALSE),
        (false & ~believed, "x", _REFUSED_FALSE),
    ):
        axes.plot(table.loc[wanted, "time_s"], place[wanted], marker, ms=4.5, color=colour)


def _legend_of_rows(figure: Figure, axes: Axes) -> None:
    marks = [("o", _USED_TRUE, "true, used"), ("x", _REFUSED_TRUE, "true, refused")]
    marks += [("s", _BELIEVED_FALSE, "false, used"), ("x", _REFUSED_FALSE, "false, refused")]
    entries = [axes.plot([], [], marker, color=colour, label=label)[0] for marker, colour, label in marks]
    entries += axes.plot([], [], lw=9, color="#dddddd", label="hidden by the bank")
    entries += axes.plot([], [], "|", ms=11, mew=1.8, color="#333333", label="tracked again")
    figure.legend(handles=entries, loc="outside lower center", ncols=6, fontsize=8)


def reacquisition_figure(reacquisition: pd.DataFrame, title: str) -> Figure:
    """Return delay of re-acquisition and seconds of search by how the channel came back, all flights."""
    figure = new_figure(9.0, 4.8)
    left, right = figure.subplots(1, 2)
    table = reacquisition[reacquisition["case"].isin(["c", "d"]) & np.isfinite(reacquisition["delay_s"])]
    labels = {
        "supervised": "supervised",
        "captured": "false lock, taken over\nby the direct signal",
        "released": "false lock, given up",
        "searched": "searched all along",
    }
    kinds = [how for how in labels if how in set(table["how"])]
    for k, how in enumerate(kinds):
        rows, colour = table[table["how"] == how], COLOURS[k % len(COLOURS)]
        spread = np.linspace(-0.25, 0.25, len(rows)) if len(rows) > 1 else np.zeros(1)
        left.plot(rows["delay_s"], k + spread, ".", ms=4, color=colour, alpha=0.6)
        left.plot([rows["delay_s"].mean()] * 2, [k - 0.38, k + 0.38], color="#333333", lw=1.8)
        means = rows[["in_vain_s", "search_s", "false_lock_s"]].mean()
        right.barh(k, means["search_s"], height=0.6, color=colour)
        right.barh(k, means["false_lock_s"], height=0.6, left=means["search_s"], color=colour, alpha=0.3)
        label = f"{means['search_s']:.2g} s search, {means['false_lock_s']:.3g} s false lock"
        right.text(0.2, k + 0.4, label, va="center", fontsize=7.5)
    left.set_yticks(range(len(kinds)), [labels[how] for how in kinds], fontsize=8)
    right.set_yticks(range(len(kinds)), [""] * len(kinds))
    left.set_xlabel("delay from the return\nto the next measurement, s", fontsize=9)
    right.set_xlabel("a satellite's mean time in search (full)\nand on a false lock (pale), s", fontsize=9)
    for axes in (left, right):
        axes.set_ylim(len(kinds) - 0.4, -0.6)
        axes.set_xlim(left=0.0)
        axes.grid(alpha=0.3, axis="x")
    figure.suptitle(f"Re-acquisition of the hidden satellites, all flights; bar: mean\n{title}", fontsize=10)
    return figure
