"""The picture of receivers on samples: position errors with their sigma, and channels on their signal."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from insgnss.studies.figures import COLOURS, new_figure

if TYPE_CHECKING:
    from insgnss.studies.figures import Figure


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
