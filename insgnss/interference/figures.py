"""Pictures of the margin: against the drift, the diagram and the trade-off lines of the paper, and the threshold.

matplotlib is loaded when a picture is asked for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from insgnss.interference.lock_thresholds import LIFETIME, LockThreshold
from insgnss.interference.margin import PhaseLoop, bandwidth_at_margin_hz, diagram, margin_db, trade_off
from insgnss.results.matplotlib_figure import PAPER_COLOURS, new_figure
from insgnss.tables import Float64

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Which values figures 5 and 6 carry is not in the paper's text: these reach from a crystal to an oven oscillator
TYPE_1_MARGINS_DB: Final = (35.0, 40.0, 45.0, 50.0, 55.0)
TYPE_2_MARGINS_DB: Final = (30.0, 35.0, 40.0, 42.0, 45.0)
_POINTS: Final = 200


def margin_figure(
    loops: Mapping[str, PhaseLoop], cn0_dbhz: float | None = None, marks: Mapping[str, float] | None = None
) -> Figure:
    """Return J/S and the loop's bandwidth over the drift's density S, one-sided; ``marks`` are drifts with a name."""
    figure = new_figure(8.0, 7.0)
    upper = figure.add_subplot(2, 1, 1)
    lower = figure.add_subplot(2, 1, 2, sharex=upper)
    S = np.logspace(-2.0, 6.0, _POINTS)
    for colour, (name, loop) in zip(PAPER_COLOURS, loops.items(), strict=False):
        upper.semilogx(S, margin_db(S, loop), color=colour, label=name)
        if cn0_dbhz is not None:
            noisy = margin_db(S, loop, cn0_dbhz)
            upper.semilogx(S, noisy, color=colour, ls="--", label=f"{name}, C/N0 {cn0_dbhz:g} dBHz")
        lower.loglog(S, bandwidth_at_margin_hz(S, loop), color=colour, label=name)
    for name, drift in (marks or {}).items():
        for axes in (upper, lower):
            axes.axvline(drift, color="#888888", lw=0.8)
        upper.annotate(name, (drift, 0.02), xycoords=("data", "axes fraction"), rotation=90, fontsize=8)
    upper.set_ylabel("margin J/S, dB")
    lower.set_ylabel("noise bandwidth at the threshold, Hz")
    lower.set_xlabel("drift density S, rad²/s³ (one-sided)")
    upper.legend(fontsize=8)
    for axes in (upper, lower):
        axes.grid(alpha=0.3)
    return figure


def diagram_figure(loops: Mapping[str, PhaseLoop], carrier_hz: float) -> Figure:
    """Return figure 4: the margin with one sensor's drift alone; on one level both add as much to S."""
    figure = new_figure(8.0, 5.5)
    left = figure.add_subplot()
    margins = np.linspace(25.0, 60.0, _POINTS)
    ratio = 1.0
    for colour, (name, loop) in zip(PAPER_COLOURS, loops.items(), strict=False):
        lines = diagram(margins, loop, carrier_hz)
        left.semilogy(margins, lines.c_ins, color=colour, label=name)
        ratio = float(lines.c_osc[0] / lines.c_ins[0])

    def to_right(y: npt.ArrayLike) -> Float64:
        return np.asarray(y, np.float64) * ratio

    def to_left(y: npt.ArrayLike) -> Float64:
        return np.asarray(y, np.float64) / ratio

    right = left.secondary_yaxis("right", functions=(to_right, to_left))
    left.set_xlabel("margin J/S, dB")
    left.set_ylabel("INS: ΔV² / T, m²/s³ (oscillator without drift)")
    right.set_ylabel("oscillator: Δf² / T, Hz²/s (INS without drift)")
    left.grid(alpha=0.3)
    left.legend(fontsize=8)
    return figure


def trade_off_figure(loop: PhaseLoop, carrier_hz: float) -> Figure:
    """Return figure 5 (type 1) or 6 (type 2): below its line, every pair of sensors allows the margin."""
    margins_db = TYPE_1_MARGINS_DB if loop.discriminator.type == 1 else TYPE_2_MARGINS_DB
    figure = new_figure(8.0, 5.5)
    axes = figure.add_subplot()
    for colour, margin in zip(PAPER_COLOURS, margins_db, strict=False):
        line = trade_off(margin, loop, carrier_hz)
        near_the_end = 1.0 - np.logspace(-1.0, -4.0, _POINTS)
        c_ins = line.c_ins * np.concatenate([np.logspace(-5.0, -0.1, _POINTS), near_the_end])
        axes.loglog(c_ins, line.osc_left(c_ins), color=colour, label=f"{margin:g} dB")
    axes.set_xlabel("INS: ΔV² / T, m²/s³")
    axes.set_ylabel("oscillator: Δf² / T, Hz²/s")
    axes.set_title(f"{loop.discriminator.name}, aperture {np.degrees(loop.discriminator.aperture_rad):.0f}°")
    axes.grid(alpha=0.3)
    axes.legend(title="J/S", fontsize=8)
    return figure


def threshold_figure(found: Sequence[LockThreshold]) -> Figure:
    """Return the threshold ratio over the mean time to slip, with the bounds of the simulation."""
    figure = new_figure(8.0, 5.5)
    axes = figure.add_subplot()
    for colour, one in zip(PAPER_COLOURS, found, strict=False):
        bounds = np.stack([one.lifetime - one.low, one.high - one.lifetime])
        axes.errorbar(
            one.lifetime, one.level, xerr=bounds, color=colour, marker=".", label=one.discriminator.name
        )
    axes.axvline(LIFETIME, color="#888888", lw=0.8)
    axes.set_xscale("log")
    axes.set_xlabel("mean time to slip times noise bandwidth")
    axes.set_ylabel("threshold ratio: linear theory's rms over the aperture")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    return figure
