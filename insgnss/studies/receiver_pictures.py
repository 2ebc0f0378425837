"""Pictures of a receiver study."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import pandas as pd

from insgnss.studies.figures import COLOURS, new_figure

if TYPE_CHECKING:
    from insgnss.studies.figures import Axes, Figure

_PANELS: Final = (
    ("position_m", "position, m"),
    ("velocity_mps", "velocity, m/s"),
    ("attitude_deg", "attitude, deg"),
    ("rate_mps", "range rate of the replicas, m/s"),
)
_OVER_TIME: Final = (
    ("position_m", "position, m"),
    ("velocity_mps", "velocity, m/s"),
    ("nees", "NEES by state"),
    ("lost", "runs lost"),
    ("received_dbhz", "C/N0, dBHz"),
)


def error_figure(summary: pd.DataFrame, thresholds: pd.DataFrame, title: str) -> Figure:
    """Return errors over C/N0, and the share of runs in lock over J/S with the linear theory's limits as lines."""
    figure = new_figure(10.0, 9.0)
    grid = figure.add_gridspec(3, 2)
    for k, (column, label) in enumerate(_PANELS):
        axes = figure.add_subplot(grid[k // 2, k % 2])
        drawn = [
            axes.semilogy(rows["cn0_dbhz"], rows[column], "o-", ms=4, lw=1.2, color=colour, label=name)
            for name, rows, colour in _by_variant(summary)
            if np.isfinite(rows[column]).any()
        ]
        axes.set_xlabel("C/N0, dBHz")
        axes.set_ylabel(label)
        axes.grid(alpha=0.3, which="both")
        if k == 0 and drawn:
            axes.legend(fontsize=8)
    _draw_lock(figure.add_subplot(grid[2, :]), summary, thresholds)
    figure.suptitle(title, fontsize=10)
    return figure


def epoch_figure(epochs: pd.DataFrame, title: str) -> Figure:
    """Return errors, NEES, share lost and C/N0 over time at the lowest C/N0, a line a receiver."""
    figure = new_figure(10.0, 9.0)
    lowest = epochs["cn0_dbhz"].min()
    shown = epochs[epochs["cn0_dbhz"] == lowest]
    for k, (column, label) in enumerate(_OVER_TIME):
        axes = figure.add_subplot(5, 1, k + 1)
        for name, rows, colour in _by_variant(shown):
            if np.isfinite(rows[column]).any():
                axes.plot(rows["time_s"], rows[column], lw=1.0, color=colour, label=name)
        if column in ("position_m", "velocity_mps", "nees"):
            axes.set_yscale("log")
        if column == "nees":
            axes.axhline(1.0, color="#333333", lw=0.8, ls=":")
        axes.set_ylabel(label)
        axes.grid(alpha=0.3)
        if k == 0:
            axes.legend(fontsize=8, ncols=3)
    axes.set_xlabel("time, s")
    figure.suptitle(f"{title}, {lowest:g} dBHz", fontsize=10)
    return figure


def channel_figure(epochs: pd.DataFrame, title: str, cycle_m: float | None) -> Figure:
    """Return truth minus replica of one channel over time at the lowest C/N0, before a loss and after it.

    ``cycle_m`` is the wavelength of a phase that is tracked: its range is shown in cycles; None: in metres.
    """
    figure = new_figure(10.0, 7.0)
    lowest = epochs["cn0_dbhz"].min()
    shown = epochs[epochs["cn0_dbhz"] == lowest]
    labels = ("range, m" if cycle_m is None else "phase, cycles", "range rate, m/s")
    for k, column in enumerate(("channel_m", "channel_mps")):
        axes = figure.add_subplot(2, 1, k + 1)
        for name, rows, colour in _by_variant(shown):
            unit = cycle_m if cycle_m is not None and column == "channel_m" else 1.0
            axes.plot(rows["time_s"], rows[column] / unit, lw=1.0, color=colour, label=name)
        axes.set_yscale("symlog", linthresh=1.0 if cycle_m is None or k else 0.25)
        axes.set_ylabel(labels[k])
        axes.grid(alpha=0.3)
        if k == 0:
            axes.legend(fontsize=8, ncols=3)
    axes.set_xlabel("time, s")
    figure.suptitle(f"{title}, {lowest:g} dBHz: truth minus replica of one channel of one run", fontsize=10)
    return figure


def _draw_lock(axes: Axes, summary: pd.DataFrame, thresholds: pd.DataFrame) -> None:
    limits = dict(zip(thresholds["variant"], thresholds["linear_js_db"].to_numpy(np.float64), strict=True))
    for name, rows, colour in _by_variant(summary):
        axes.plot(rows["js_db"], 100.0 * (1.0 - rows["lost"]), "o-", ms=4, lw=1.2, color=colour)
        linear = limits[name]
        if np.isfinite(linear):
            axes.axvline(linear, color=colour, lw=0.9, ls="--")
    axes.set_xlabel("J/S, dB (dashed: linear theory)")
    axes.set_ylabel("runs in lock, %")
    axes.grid(alpha=0.3)


def _by_variant(table: pd.DataFrame) -> list[tuple[str, pd.DataFrame, str]]:
    """Return name, rows and colour of each receiver, in the table's order."""
    names = list(dict.fromkeys(table["variant"]))
    return [
        (str(name), table[table["variant"] == name], COLOURS[k % len(COLOURS)])
        for k, name in enumerate(names)
    ]
