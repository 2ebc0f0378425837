"""The picture of an outage study: drift by time since the loss, its percentiles, and the sigma that was predicted."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pandas as pd

from insgnss.studies.figures import COLOURS, new_figure

if TYPE_CHECKING:
    from insgnss.studies.figures import Axes, Figure


def drift_figure(drift: pd.DataFrame, errors: pd.DataFrame, percentiles: pd.DataFrame, title: str) -> Figure:
    """Return a panel for each thing the solution is held against; tables are those of ``OutageStudy``."""
    against = [("undisturbed", "drift from the undisturbed solution, m", drift)]
    against += [("reference", "error against the reference, m", errors)] if len(errors) else []
    figure = new_figure(6.0 * len(against), 4.8)
    for (name, label, table), axes in zip(
        against, figure.subplots(1, len(against), squeeze=False)[0], strict=True
    ):
        _draw(axes, table, percentiles[percentiles["against"] == name])
        axes.set_ylabel(label)
    figure.suptitle(title, fontsize=10)
    return figure


def _draw(axes: Axes, table: pd.DataFrame, percentiles: pd.DataFrame) -> None:
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
