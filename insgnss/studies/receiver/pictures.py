"""Pictures of a receiver study."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
import pandas as pd

from insgnss.studies.figures import COLOURS, new_figure

if TYPE_CHECKING:
    from insgnss.studies.figures import Axes, Figure

# column of the summary, and that of the linear theory
_PANELS: Final = (
    ("position_m", "position, m", ""),
    ("velocity_mps", "velocity, m/s", "linear_velocity_mps"),
    ("channels_mps", "velocity by range rates alone, m/s", "linear_channels_mps"),
    ("attitude_deg", "attitude, deg", "linear_attitude_deg"),
)
_PHASE: Final = ("phase_rad", "phase of the replicas, rad", "linear_phase_rad")
_RATE: Final = ("rate_mps", "range rate of the replicas, m/s", "")
_OVER_TIME: Final = (
    ("position_m", "position, m"),
    ("velocity_mps", "velocity, m/s"),
    ("nees", "NEES by state"),
    ("lost", "runs lost"),
    ("tracked", "channels tracked"),
    ("received_dbhz", "C/N0, dBHz"),
)

_SIGMAS: Final = {"position_m": "position_sd_m", "velocity_mps": "velocity_sd_mps"}


def error_figure(summary: pd.DataFrame, thresholds: pd.DataFrame, title: str) -> Figure:
    """Return errors over C/N0 and the share of runs in lock over J/S: runs as dots, the linear theory as lines."""
    figure = new_figure(10.0, 9.0)
    grid = figure.add_gridspec(3, 2)
    tracked = np.isfinite(summary["phase_rad"]).any()
    for k, panel in enumerate((*_PANELS, _PHASE if tracked else _RATE)):
        axes = figure.add_subplot(grid[k // 2, k % 2])
        _draw_errors(axes, summary, panel)
        if k == 0 and axes.get_lines():
            axes.legend(fontsize=8)
    _draw_lock(figure.add_subplot(grid[2, 1]), summary, thresholds)
    figure.suptitle(f"{title} (lines: linear theory)", fontsize=10)
    return figure


def _draw_errors(axes: Axes, summary: pd.DataFrame, panel: tuple[str, str, str]) -> None:
    """Draw an error of each receiver over C/N0; ``panel`` are its column, its label and the theory's column, if any."""
    column, label, linear = panel
    for name, rows, colour in _by_variant(summary):
        if np.isfinite(rows[column]).any():
            axes.semilogy(rows["cn0_dbhz"], rows[column], "o", ms=4, color=colour, label=name)
        if linear and np.isfinite(rows[linear]).any():
            axes.semilogy(rows["cn0_dbhz"], rows[linear], "-", lw=1.0, color=colour)
    axes.set_xlabel("C/N0, dBHz")
    axes.set_ylabel(label, fontsize=8)
    axes.grid(alpha=0.3, which="both")


def epoch_figure(epochs: pd.DataFrame, title: str) -> Figure:
    """Return errors, NEES, share lost, channels and C/N0 over time at the lowest C/N0, one line per receiver.

    Errors have three times their predicted sigmas as dashed lines.
    """
    figure, panels = _over_time(epochs, [(column, label, 1.0) for column, label in _OVER_TIME], 10.5)
    lowest = epochs[epochs["cn0_dbhz"] == epochs["cn0_dbhz"].min()]
    for (column, _), axes in zip(_OVER_TIME, panels, strict=True):
        for _, rows, colour in _by_variant(lowest) if column in _SIGMAS else ():
            axes.plot(rows["time_s"], 3.0 * rows[_SIGMAS[column]], "--", lw=0.8, color=colour)
        if column in ("position_m", "velocity_mps", "nees"):
            axes.set_yscale("log")
        if column == "nees":
            axes.axhline(1.0, color="#333333", lw=0.8, ls=":")
    figure.suptitle(f"{title}, {epochs['cn0_dbhz'].min():g} dBHz (dashed: 3 sigma)", fontsize=10)
    return figure


def channel_figure(epochs: pd.DataFrame, title: str, cycle_m: float | None) -> Figure:
    """Return truth minus replica of one channel over time at the lowest C/N0, before a loss and after it.

    ``cycle_m`` is the wavelength of a phase that is tracked: its range is shown in cycles; None: in metres.
    """
    ranges = ("channel_m", "range, m", 1.0) if cycle_m is None else ("channel_m", "phase, cycles", cycle_m)
    figure, (upper, lower) = _over_time(epochs, [ranges, ("channel_mps", "range rate, m/s", 1.0)], 7.0)
    upper.set_yscale("symlog", linthresh=1.0 if cycle_m is None else 0.25)
    lower.set_yscale("symlog", linthresh=1.0)
    words = f"{title}, {epochs['cn0_dbhz'].min():g} dBHz: truth minus replica of one channel of one run"
    figure.suptitle(words, fontsize=10)
    return figure


def _over_time(
    epochs: pd.DataFrame, panels: Sequence[tuple[str, str, float]], height_in: float
) -> tuple[Figure, list[Axes]]:
    """Return columns over time at the lowest C/N0, one line per receiver; ``panels`` are column, label and unit."""
    figure = new_figure(10.0, height_in)
    shown = epochs[epochs["cn0_dbhz"] == epochs["cn0_dbhz"].min()]
    drawn = [figure.add_subplot(len(panels), 1, k + 1) for k in range(len(panels))]
    for axes, (column, label, unit) in zip(drawn, panels, strict=True):
        for name, rows, colour in _by_variant(shown):
            if np.isfinite(rows[column]).any():
                axes.plot(rows["time_s"], rows[column] / unit, lw=1.0, color=colour, label=name)
        axes.set_ylabel(label)
        axes.grid(alpha=0.3)
    drawn[0].legend(fontsize=8, ncols=3)
    drawn[-1].set_xlabel("time, s")
    return figure, drawn


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
