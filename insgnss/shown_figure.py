"""A figure that shows itself in a notebook, whether or not pyplot has been loaded there.

Jupyter knows how to show matplotlib's figures only once its inline backend runs, and ``import matplotlib.pyplot`` alone
does not start it. ``insgnss.pictures`` loads this module, and with it matplotlib, when the first figure is drawn.
"""

from __future__ import annotations

from io import BytesIO

from matplotlib.figure import Figure


class ShownFigure(Figure):
    """A figure of matplotlib's with a picture for Jupyter; the inline backend's own settings win where it runs."""

    def _repr_png_(self) -> bytes:
        file = BytesIO()
        self.savefig(file, format="png", dpi=self.dpi)
        return file.getvalue()
