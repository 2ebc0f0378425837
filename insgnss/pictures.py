"""Where pictures begin: an empty figure of matplotlib's, which is loaded when one is drawn."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure that no window shows, and that Jupyter does.

    Parameters
    ----------
    width, height : in inches
    """
    # matplotlib takes a third of a second to load, which only those who draw should wait for
    from insgnss.shown_figure import ShownFigure

    return ShownFigure(figsize=(width, height), layout="constrained")
