"""The picture of a consistency study: NIS over time and by satellite, autocorrelation, sigmas coming down."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import pandas as pd
from scipy import stats

from insgnss.results.matplotlib_figure import with_caption
from insgnss.runs.datum import what_and_when
from insgnss.studies.figures import COLOURS, new_figure

if TYPE_CHECKING:
    from insgnss.studies.figures import Axes, Figure

_PIECES: Final = 60  # of the time, a mean in each
_TAILS: Final = (0.005, 0.995)  # of the band in which consistent means lie
_TITLE_SIZE: Final = 9
_LINES: Final = ("-", "--", ":")


def consistency_figure(
    innovations: pd.DataFrame,
    kinds: pd.DataFrame,
    satellites: pd.DataFrame,
    whiteness: pd.DataFrame,
    sigmas: pd.DataFrame,
) -> Figure:
    """Return the four panels; tables are those of ``Consistency``."""
    figure = new_figure(11.0, 7.5)
    over_time, by_satellite, lagged, coming_down = figure.subplots(2, 2).ravel()
    _nis_over_time(over_time, innovations, kinds)
    _nis_by_satellite(by_satellite, satellites)
    _autocorrelation(lagged, whiteness)
    _sigma_reduction(coming_down, sigmas)
    for axes in (over_time, by_satellite, lagged, coming_down):
        axes.grid(alpha=0.3)
    return with_caption(figure, what_and_when(innovations))


def _nis_over_time(axes: Axes, innovations: pd.DataFrame, kinds: pd.DataFrame) -> None:
    used = innovations[innovations["used"]]
    edges = np.linspace(used["time_s"].min(), used["time_s"].max() + 1e-9, _PIECES + 1)
    middle = 0.5 * (edges[1:] + edges[:-1])
    for k, (kind, worth) in enumerate(zip(kinds["kind"], kinds["dof"] / kinds["used"], strict=True)):
        rows = used[used["kind"] == kind]
        piece = np.clip(np.digitize(rows["time_s"], edges) - 1, 0, _PIECES - 1)
        count = np.bincount(piece, minlength=_PIECES)
        some = np.maximum(count, 1)
        mean = np.bincount(piece, weights=rows["z"] ** 2, minlength=_PIECES) / some
        colour = COLOURS[k % len(COLOURS)]
        axes.plot(middle[count > 0], mean[count > 0], color=colour, lw=1.3, label=kind.replace("_", " "))
        low, high = (stats.chi2.ppf(p, some * worth) / (some * worth) for p in _TAILS)
        axes.fill_between(middle, low, high, color=colour, alpha=0.12, lw=0)
    axes.axhline(1.0, color="#333333", lw=0.8)
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("time, s")
    axes.set_ylabel("mean NIS")
    axes.set_title("innovations against their sigma; band: 99 % of consistent ones", fontsize=_TITLE_SIZE)
    axes.legend(fontsize=8)


def _nis_by_satellite(axes: Axes, satellites: pd.DataFrame) -> None:
    names = sorted(satellites["sv"].unique())
    groups = list(satellites.groupby("kind", sort=False))
    for k, (kind, rows) in enumerate(groups):
        place = rows["sv"].map(names.index) + 0.22 * (k - 0.5 * (len(groups) - 1))
        colour = COLOURS[k % len(COLOURS)]
        axes.vlines(place, rows["low"], rows["high"], color=colour, lw=5, alpha=0.2)
        axes.plot(place, rows["mean_nis"], "o", ms=4, color=colour, label=str(kind).replace("_", " "))
    axes.axhline(1.0, color="#333333", lw=0.8)
    axes.set_xticks(range(len(names)), names, rotation=90, fontsize=7)
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel("mean NIS")
    axes.set_title("by satellite; bar: bounds for all of them together", fontsize=_TITLE_SIZE)


def _autocorrelation(axes: Axes, whiteness: pd.DataFrame) -> None:
    for k, (kind, rows) in enumerate(whiteness.groupby("kind", sort=False)):
        colour = COLOURS[k % len(COLOURS)]
        axes.plot(rows["lag_s"], rows["correlation"], "o-", ms=3, lw=1, color=colour, label=kind)
        axes.fill_between(rows["lag_s"], -rows["bound"], rows["bound"], color=colour, alpha=0.12, lw=0)
    axes.axhline(0.0, color="#333333", lw=0.8)
    axes.set_xlabel("lag, s")
    axes.set_ylabel("correlation")
    axes.set_title("autocorrelation of the innovations; band: that of white ones", fontsize=_TITLE_SIZE)


def _sigma_reduction(axes: Axes, sigmas: pd.DataFrame) -> None:
    styles = (
        ("sd_yaw_deg", "heading"),
        ("sd_accel_bias_", "accelerometer bias"),
        ("sd_gyro_bias_", "gyro bias"),
    )
    for k, (prefix, label) in enumerate(styles):
        for i, column in enumerate(c for c in sigmas if str(c).startswith(prefix)):
            share = sigmas[column] / max(float(sigmas[column].iloc[0]), 1e-30)
            name = label if i == 0 else None
            axes.plot(sigmas["time_s"], share, _LINES[i], lw=1.1, color=COLOURS[k], label=name)
    axes.set_yscale("log")
    axes.set_xlabel("time, s")
    axes.set_ylabel("sigma over its first")
    axes.set_title("observability in this flight; axes x, y, z solid, dashed, dotted", fontsize=_TITLE_SIZE)
    axes.legend(fontsize=8)
