"""Travel times that a phone knows up to whole milliseconds, completed by other epochs of the same satellite.

In the first seconds of a log a receiver has the code of a signal, and not yet its data: the time of transmission lacks
whole milliseconds, 300 km of range. Within a minute, while the receiver's clock runs on, the range of a satellite
changes by less than a third of that, so another epoch of the same satellite tells them.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_MS, NS_PER_S
from insgnss.gpstime import nearest
from insgnss.log.android.clock import ReceiverClock
from insgnss.tables import Bool, Float64, Int64

_LONGEST_NS: Final = 60 * NS_PER_S  # 1.1 km/s, of satellite, phone and clock, in it: 66 of 150 km


def whole_milliseconds(
    clock: ReceiverClock,
    satellites: npt.NDArray[np.str_],
    elapsed_ns: Int64,
    travel_ns: Float64,
    known: Bool,
    ambiguous: Bool,
) -> tuple[Float64, Bool]:
    """Return the travel times with those of ``ambiguous`` rows completed, and which were.

    Parameters
    ----------
    clock : of the receiver; a row takes another of the same stretch alone
    satellites : (n,) names
    elapsed_ns : (n,) reception minus stated transmission, right up to whole milliseconds
    travel_ns, known : (n,) travel times, and where they are sound
    ambiguous : (n,) rows to complete
    """
    travel_ns, completed = travel_ns.copy(), np.zeros(len(known), np.bool_)
    for name in np.unique(satellites[ambiguous]):
        of_satellite = satellites == name
        for stretch in np.unique(clock.stretch[of_satellite & ambiguous]):
            inside = of_satellite & (clock.stretch == stretch)
            others, rows = np.flatnonzero(inside & known), np.flatnonzero(inside & ambiguous)
            if not len(others):
                continue
            others = others[np.argsort(clock.t_ns[others], kind="stable")]
            other = others[nearest(clock.t_ns[others], clock.t_ns[rows])]
            near = np.abs(clock.t_ns[rows] - clock.t_ns[other]) <= _LONGEST_NS
            rows, guess_ns = rows[near], np.rint(travel_ns[other[near]]).astype(np.int64)
            half = NS_PER_MS // 2
            travel_ns[rows] = guess_ns + np.mod(elapsed_ns[rows] - guess_ns + half, NS_PER_MS) - half
            completed[rows] = True
    return travel_ns, completed
