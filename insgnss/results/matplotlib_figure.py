"""Where pictures begin: an empty figure of matplotlib's, which is loaded when one is drawn."""

from __future__ import annotations

from functools import partial
from io import BytesIO
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_LABELS: Final = 40  # satellites that an axis names


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure that no window shows, and that Jupyter does.

    Jupyter knows how to show matplotlib's figures only once its inline backend runs, and ``import matplotlib.pyplot``
    alone does not start it: each figure brings its own picture. Where the backend runs, its settings win.

    Parameters
    ----------
    width, height : in inches
    """
    # a third of a second, for which only those who draw should wait
    from matplotlib.figure import Figure as NewFigure

    figure = NewFigure(figsize=(width, height), layout="constrained")
    figure._repr_png_ = partial(_png, figure)  # type: ignore[attr-defined]
    return figure


def _png(figure: Figure) -> bytes:
    file = BytesIO()
    figure.savefig(file, format="png", dpi=figure.dpi)
    return file.getvalue()
