"""The heat map of a manoeuvre study: bank over heading, a panel for each antenna and IMU."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import pandas as pd

from insgnss.studies.figures import new_figure

if TYPE_CHECKING:
    from insgnss.studies.figures import Figure

WORDS: Final = {
    "d_worst_m2": "largest D of a hidden range, m²",
    "d_mean_m2": "mean D of the hidden ranges, m²",
    "n_hidden": "satellites hidden",
    "n_seen": "satellites left",
    "pdop": "PDOP of the satellites left",
    "sd_position_m": "position sigma at the end of the bank, m",
}
_MOST_CELLS: Final = 200  # in a panel, for numbers to be legible


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
