"""Pictures of the studies. matplotlib is loaded when a picture is asked for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
import pandas as pd

from insgnss.results.matplotlib_figure import new_figure as new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
    from matplotlib.figure import Figure as Figure


# dark enough on white, and distinct for the colour-blind
COLOURS: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b8860b", "#56b4e9", "#555555")
_SHADE: Final = "#eeeeee"
SHOWN_AROUND_S: Final = 30.0  # before and after an outage
WORDS: Final = {
    "d_worst_m2": "largest D of a hidden range, m²",
    "d_mean_m2": "mean D of the hidden ranges, m²",
    "n_hidden": "satellites hidden",
    "n_seen": "satellites left",
    "pdop": "PDOP of the satellites left",
    "sd_position_m": "position sigma at the end of the bank, m",
}
_MOST_CELLS: Final = 200  # in a panel, for numbers to be legible


def variance_figure(
    table: pd.DataFrame, hidden: Sequence[str], outage_s: tuple[float, float], title: str
) -> Figure:
    """Return D of the hidden satellites' pseudoranges over time; the others in grey.

    Parameters
    ----------
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


def drift_figure(drift: pd.DataFrame, errors: pd.DataFrame, percentiles: pd.DataFrame, title: str) -> Figure:
    """Return a panel for each solution or reference of the comparison; tables are those of ``OutageStudy``."""
    against = [("undisturbed", "drift from the undisturbed solution, m", drift)]
    against += [("reference", "error against the reference, m", errors)] if len(errors) else []
    figure = new_figure(6.0 * len(against), 4.8)
    for (name, label, table), axes in zip(
        against, figure.subplots(1, len(against), squeeze=False)[0], strict=True
    ):
        _draw_drift(axes, table, percentiles[percentiles["against"] == name])
        axes.set_ylabel(label)
    figure.suptitle(title, fontsize=10)
    return figure


def _draw_drift(axes: Axes, table: pd.DataFrame, percentiles: pd.DataFrame) -> None:
    for k, (_, rows) in enumerate(table.groupby("window")):
        label = "one window" if k == 0 else None
        axes.plot(rows["since_s"], rows["position_m"], color="#cccccc", lw=0.7, label=label)
    p = percentiles[percentiles["measure"] == "position_m"]
    axes.plot(p["since_s"], p["p50"], color=COLOURS[0], lw=1.6, label="50 %")
    axes.plot(p["since_s"], p["p95"], color=COLOURS[1], lw=1.6, label="95 %")
    axes.plot(p["since_s"], p["rms"], color="#333333", lw=1.4, label="root mean square")
    axes.plot(p["since_s"], p["sd"], color="#333333", lw=1.4, ls="--", label="predicted sigma")
    axes.set_xlabel("time since the loss, s")
    axes.set_ylim(bottom=0.0)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)


def heat_map(cases: pd.DataFrame, column: str) -> Figure:
    """Return the picture of a column of ``ManoeuvreStudy.cases``; empty cells: nothing is hidden."""
    panels = list(cases.groupby(["imu", "antenna"], sort=False))
    across = min(len(panels), 2)
    down = -(-len(panels) // across)
    figure = new_figure(6.4 * across + 1.2, 3.6 * down)
    all_axes = figure.subplots(down, across, squeeze=False).ravel()
    least, most = cases[column].min(), cases[column].max()
    image = None
    for axes, ((imu, antenna), rows) in zip(all_axes, panels, strict=False):
        wide = rows.pivot(index="bank_deg", columns="heading_deg", values=column)
        image = axes.imshow(
            wide.to_numpy(np.float64), origin="lower", aspect="auto", vmin=least, vmax=most, cmap="viridis"
        )
        axes.set_xticks(range(wide.shape[1]), [f"{h:g}" for h in wide.columns], fontsize=8)
        axes.set_yticks(range(wide.shape[0]), [f"{b:g}" for b in wide.index], fontsize=8)
        axes.set_xlabel("heading, deg")
        axes.set_ylabel("bank, deg (right wing down)")
        axes.set_title(f"{imu} IMU, antenna {antenna}", fontsize=9)
        if wide.size <= _MOST_CELLS:
            for (i, j), value in np.ndenumerate(wide.to_numpy(np.float64)):
                if np.isfinite(value):
                    pale = value < 0.5 * (least + most)
                    axes.text(j, i, f"{value:.2g}", ha="center", va="center", fontsize=7,
                              color="white" if pale else "black")  # fmt: skip
    for axes in all_axes[len(panels) :]:
        axes.set_visible(False)
    if image is not None:
        figure.colorbar(image, ax=all_axes.tolist(), label=WORDS.get(column, column))
    return figure


def sample_figure(epochs: pd.DataFrame, channels: pd.DataFrame) -> Figure:
    """Return a column for each C/N0: position error with 3 sigma above, channels on their signal below."""
    strengths = sorted(epochs["cn0_dbhz"].unique(), reverse=True)
    figure = new_figure(5.5 * len(strengths), 6.5)
    panels = figure.subplots(2, len(strengths), squeeze=False, sharex=True)
    for column, cn0 in enumerate(strengths):
        above, below = panels[0][column], panels[1][column]
        begin_s = float(epochs["time_s"].min())
        for colour, (name, rows) in zip(
            COLOURS, epochs[epochs["cn0_dbhz"] == cn0].groupby("receiver"), strict=False
        ):
            t = rows["time_s"] - begin_s
            size = np.sqrt(sum(rows[f"error_{a}_m"] ** 2 for a in "ned"))
            sigma = np.sqrt(sum(rows[f"sd_{a}_m"].astype(float) ** 2 for a in "ned"))
            above.plot(t, size, color=colour, lw=1.2, label=f"{name}: error")
            above.plot(t, 3.0 * sigma, color=colour, lw=0.9, ls="--", label=f"{name}: 3 sigma")
        for colour, (name, rows) in zip(
            COLOURS, channels[channels["cn0_dbhz"] == cn0].groupby("receiver"), strict=False
        ):
            counted = rows.groupby("time_s")["on_signal"].sum()
            below.step(counted.index - begin_s, counted, where="post", color=colour, lw=1.2, label=name)
        above.set_title(f"{cn0:.0f} dBHz")
        above.set_yscale("log")
        below.set_ylim(-0.3, channels["sv"].nunique() + 0.3)
        below.set_xlabel("time, s")
        for axes in (above, below):
            axes.grid(alpha=0.3)
            axes.legend(fontsize=8)
    panels[0][0].set_ylabel("position error, m")
    panels[1][0].set_ylabel("channels on their signal")
    return figure
