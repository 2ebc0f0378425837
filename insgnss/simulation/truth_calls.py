"""The kernels of a simulated flight, each with arguments of the types it is called with (``runs.kernel_list``)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from insgnss.simulation.atmosphere import delays_along
from insgnss.simulation.course import lay_over_ellipsoid
from insgnss.simulation.trajectory import gravity_along


def calls() -> dict[Callable[..., Any], tuple[Any, ...]]:
    """Return the kernels."""
    row, rows = np.zeros(1), np.zeros((1, 3))
    return {
        lay_over_ellipsoid: (row, row, row, row, 0.0, rows, np.zeros((1, 3, 3))),
        delays_along: (np.zeros(8), rows, rows, rows, row, 0.0, rows),
        gravity_along: (rows, rows),
    }
