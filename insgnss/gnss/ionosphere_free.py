"""The ionosphere-free combination of two pseudoranges of a satellite.

Equation: P = (f1^2 P1 - f2^2 P2) / (f1^2 - f2^2), which the ionosphere's delay (of first order, k / f^2) leaves alone
                                                                              [IS-GPS-200N, 20.3.3.3.3.3]
The noise grows: with a = f1^2 / (f1^2 - f2^2) its variance is a^2 + (a - 1)^2 times that of one pseudorange, 8.9 for
L1/L2, 6.6 for L1/L5. The satellite's clock is combined the same way, so each signal's group delay stays right.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from insgnss.gnss.measurement_kinds import PSEUDORANGE
from insgnss.status import COMBINED, NO_SECOND_SIGNAL, USED
from insgnss.tables import Float64, Int64


def combine_pseudoranges(
    observation: npt.NDArray[Any], sat: Float64, carrier_hz: Float64, first: Int64
) -> Float64:
    """Combine the pseudoranges of each satellite and epoch; return the satellite states with combined clocks (n, 8).

    The usable row of a satellite whose clock group comes first gets the combination with its row farthest in frequency,
    which becomes COMBINED, as do any further ones; a satellite with one usable pseudorange is refused as
    NO_SECOND_SIGNAL, since its clock would not be the others'.

    Parameters
    ----------
    observation : (n,) of OBSERVATION_DTYPE, its values and statuses are changed
    sat : (n, 8) satellite states
    carrier_hz : (n,) of each row
    first : (m + 1,) first row of each epoch
    """
    status = observation["status"][:, PSEUDORANGE]
    rows = np.flatnonzero((status == USED) & np.isfinite(carrier_hz))
    epoch = np.repeat(np.arange(len(first) - 1), np.diff(first))
    keys = rows, observation["group"][rows], observation["sv"][rows], epoch[rows]
    order = rows[np.lexsort(keys)]
    key = epoch[order] * (int(observation["sv"].max(initial=0)) + 1) + observation["sv"][order]
    starts = np.flatnonzero(np.concatenate([[True], np.diff(key) != 0])) if len(order) else np.zeros(0, int)
    which = np.cumsum(np.concatenate([[0], np.diff(key) != 0])) if len(order) else np.zeros(0, int)
    lead = order[starts]
    squared = carrier_hz**2
    distance = np.abs(squared[order] - squared[lead][which])
    far = _last_of_each(which, distance, len(starts))
    second = order[far]
    alone = squared[second] == squared[lead]
    observation["status"][order, PSEUDORANGE] = COMBINED
    observation["status"][lead, PSEUDORANGE] = np.where(alone, NO_SECOND_SIGNAL, USED)
    a, b = lead[~alone], second[~alone]
    share = squared[a] / (squared[a] - squared[b])
    value = observation["value"]
    value[a, PSEUDORANGE] = share * value[a, PSEUDORANGE] - (share - 1.0) * value[b, PSEUDORANGE]
    observation["ionosphere_factor"][a] = 0.0
    observation["variance_scale"][a] *= share**2 + (share - 1.0) ** 2
    combined = sat.copy()
    combined[a, 6] = share * sat[a, 6] - (share - 1.0) * sat[b, 6]
    return combined


def _last_of_each(which: npt.NDArray[Any], distance: Float64, n: int) -> npt.NDArray[Any]:
    """Return the place of the largest distance of each group (``which`` ascending)."""
    order = np.lexsort((distance, which))
    ends = np.cumsum(np.bincount(which, minlength=n)) - 1
    return np.asarray(order[ends])
