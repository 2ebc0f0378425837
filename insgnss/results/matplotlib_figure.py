"""Where pictures begin: an empty figure of matplotlib's, which is loaded when one is drawn."""

from __future__ import annotations

from functools import partial
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Final

from insgnss.results.saving import PICTURE_KIND, saving_file, writing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAPER_COLOURS: Final = ("#2166ac", "#b2182b", "#1b7837", "#762a83", "#8c510a")  # of figures after a paper's
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


def with_caption(figure: Figure, text: str) -> Figure:
    """Write a small line below a figure, as what flight and what time it shows; return the figure."""
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    engine = figure.get_layout_engine()
    if text and isinstance(engine, ConstrainedLayoutEngine):
        share = 0.2 / figure.get_figheight()
        engine.set(rect=(0.0, share, 1.0, 1.0 - share))
        figure.text(
            0.995, 0.04 / figure.get_figheight(), text, ha="right", va="bottom", fontsize=7, color="#666666"
        )
    return figure


def save_figure(figure: Figure, path: str | Path) -> Path:
    """Write a picture in the form that the file's ending names; return its path.

    Raises
    ------
    ResultError : the file cannot be written, or is somebody else's
    """
    path = Path(path)
    with writing("the picture", path), saving_file(path, PICTURE_KIND) as new:
        figure.savefig(new, dpi=120)
    return path


def _png(figure: Figure) -> bytes:
    file = BytesIO()
    figure.savefig(file, format="png", dpi=figure.dpi)
    return file.getvalue()
