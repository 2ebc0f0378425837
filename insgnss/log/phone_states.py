"""The satellite states that a phone's log holds, beside messages or products that give them, too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from insgnss.gnss.orbits.satellite_state import satellite_states, status_of_given
from insgnss.status import USED
from insgnss.tables import Event, GnssTable, NavigationData


def states_beside(
    gnss: GnssTable, navigation: NavigationData | None, products: bool = False
) -> tuple[GnssTable, list[Event]]:
    """Return a phone's log with its own satellite states where no message serves the row; an event tells how many.

    Orbits of messages are better known than those that a phone computed, and have a group delay for each signal.
    Products replace all of them.
    """
    if gnss.sat is None or not (products or (navigation is not None and navigation.has_messages)):
        return gnss, []
    served = np.ones(len(gnss.t_ns), np.bool_)
    if not products:
        served = satellite_states(replace(gnss, sat=None), navigation).message >= 0
    kept = ~served & (status_of_given(gnss.sat) == USED)
    if not kept.any():
        detail = f"the phone's satellite states are not used: {'products' if products else 'messages'} replace them"
        return replace(gnss, sat=None), [Event(None, "satellite_states_not_used", detail)]
    systems = np.array([name[0] for name in gnss.sv_names], "U1")[gnss.sv]
    detail = f"the phone's satellite states are used in rows without a message: {_by_system(systems[kept])}"
    sat = np.where(kept[:, None], gnss.sat, np.nan)
    return replace(gnss, sat=sat), [Event(None, "satellite_states_beside", detail)]


def _by_system(systems: npt.NDArray[np.str_]) -> str:
    letters, counts = np.unique(systems, return_counts=True)
    return ", ".join(f"{n} rows of {letter}" for letter, n in zip(letters, counts, strict=True))
