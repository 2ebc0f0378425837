"""The ionosphere coefficients of GPS that newer phones repeat in each "Raw" line."""

from __future__ import annotations

from typing import Final

import numpy as np

from insgnss.log.android.lines import AndroidCells
from insgnss.log.messages.broadcast import Broadcast
from insgnss.tables import NavigationData

COLUMNS: Final = tuple(f"Klobuchar{part}{k}" for part in ("Alpha", "Beta") for k in range(4))


def coefficients(raw: AndroidCells) -> NavigationData | None:
    """Return the coefficients that most lines state, as navigation data without messages; None where none does.

    Lines of constellations other than GPS may leave them empty or zero.
    """
    stated = np.stack([raw.decimals(name) for name in COLUMNS], axis=1)
    stated = stated[np.isfinite(stated).all(axis=1) & stated.any(axis=1)]
    if not len(stated):
        return None
    distinct, count = np.unique(stated, axis=0, return_counts=True)
    broadcast = Broadcast()
    broadcast.ionosphere_of("gps", tuple(distinct[np.argmax(count)].tolist()))
    return broadcast.navigation()
