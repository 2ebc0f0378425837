"""Whether navigation data and a GNSS log are of the same time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from insgnss.constants import NS_PER_S, NS_PER_WEEK, S_PER_DAY
from insgnss.errors import NavigationDataError
from insgnss.gpstime import nearest, ns_to_datetime
from insgnss.tables import Event, Int64, NavigationData

# No message is of use further than this from the log: the longest validity is 4 h, a fit interval up to 26 h
WRONG_DAY_S = 1.5 * S_PER_DAY
# A part of the log this far from every message has no ephemeris of GPS (2 h) nor of most others
UNCOVERED_S = 7200.0


def check_navigation_time(navigation: NavigationData, gnss_ns: Int64, paths: tuple[Path, ...]) -> list[Event]:
    """Return an event where the messages cover a part of the log alone.

    Parameters
    ----------
    navigation : the messages as read
    gnss_ns : time tags of the GNSS log, in time order
    paths : the navigation files, for the message

    Raises
    ------
    NavigationDataError : the messages are of another day or week than the log
    """
    of_states = np.zeros(0, np.int64) if navigation.state_vectors is None else navigation.state_vectors.t_ns
    times = np.sort(np.concatenate([navigation.ephemerides.toe_ns, of_states]))
    if not len(times) or not len(gnss_ns):
        return []
    epochs = np.unique(gnss_ns)
    gap_s = np.abs(times[nearest(times, epochs)] - epochs) / NS_PER_S
    if gap_s.min() > WRONG_DAY_S:
        raise NavigationDataError(
            f"the navigation data are of {_span(times)}, the GNSS log of {_span(epochs)}",
            file=", ".join(map(str, paths)),
            advice="give the broadcast navigation file of the flight's day, and check the flight's gps_week",
        )
    uncovered = int(np.count_nonzero(gap_s > UNCOVERED_S))
    if not uncovered:
        return []
    detail = f"{uncovered} of {len(epochs)} epochs are more than 2 h from every message: add the files of those hours"
    return [Event(int(epochs[np.argmax(gap_s > UNCOVERED_S)]), "navigation_gap", detail)]


def _span(times: Int64) -> str:
    """Return the first and the last time in words, with the GPS week."""
    first, last = (f"{ns_to_datetime(int(t)):%Y-%m-%d %H:%M}" for t in (times[0], times[-1]))
    return f"{first} to {last} (GPS week {int(times[0]) // NS_PER_WEEK})"
