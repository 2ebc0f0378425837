"""Where pictures begin: an empty figure of matplotlib's, an optional part that is loaded when one is drawn."""

from __future__ import annotations

from typing import TYPE_CHECKING

from insgnss.errors import ResultError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def new_figure(width: float, height: float, *, otherwise: str = "") -> Figure:
    """Return an empty figure that no window shows.

    Parameters
    ----------
    width, height : in inches
    otherwise : how to do without pictures, for the advice

    Raises
    ------
    ResultError : matplotlib is not installed
    """
    try:
        from matplotlib.figure import Figure as NewFigure
    except ImportError as error:
        without = f", or ask for none ({otherwise})" if otherwise else ""
        raise ResultError(
            "pictures need matplotlib, which is not installed",
            advice=f"pip install 'insgnss[plots]'{without}",
        ) from error
    return NewFigure(figsize=(width, height), layout="constrained")
