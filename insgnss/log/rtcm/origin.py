"""Whose measurements RTCM messages in another log are: this receiver's own, or a base station's that corrects it.

Many receivers send their measurements as RTCM alone. As many logs hold the corrections that a rover was sent. A station
message gives the place of the antenna: if it is far from the receiver's fixes, the measurements are a base station's.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import pymap3d

from insgnss.log.receiver import ReceiverLog, RtcmOrigin
from insgnss.tables import Event, ReferenceTable

SAME_ANTENNA_M: Final = 50.0  # a receiver alone errs by less; a base is seldom so near


def judged_origin(
    stream: ReceiverLog,
    fixes: ReferenceTable | None,
    declared: RtcmOrigin | None,
    name: str,
    own_measurements: str,
) -> tuple[RtcmOrigin, Event]:
    """Return whose the measurements of a stream are, and the event that says so.

    Parameters
    ----------
    stream : the RTCM messages, read
    fixes : the receiver's own
    declared : what the user says, None without
    name : what the messages are called in the event
    own_measurements : what this receiver can record instead of RTCM
    """
    if declared == "base":
        detail = f"{name} are a base station's, as declared: not read"
        return "base", Event(None, "rtcm_of_base", detail)
    if declared == "own":
        return "own", Event(
            None, "rtcm_read", f"{name} are read as this receiver's measurements, as declared"
        )
    away_m = _distance_m(fixes, stream.station_m)
    if away_m > SAME_ANTENNA_M:
        detail = (
            f"{name} hold the measurements of a station {away_m / 1e3:.3g} km away, a base: not read. If they are this"
            " receiver's own, declare it: --rtcm own"
        )
        return "base", Event(None, "rtcm_of_base", detail)
    whose = "they do not say whose they are"
    if fixes is not None and stream.station_m is not None:
        whose = f"their station is {away_m:.0f} m from the fixes"
    instead = (
        "" if fixes is None else "declare it (--rtcm base), and the receiver's fixes take their place; or "
    )
    detail = (
        f"{name} are read as this receiver's measurements; {whose}. If they are a base station's: {instead}name the"
        " measurements converted from them under [gnss.base] with format = 'csv' and the place of the base"
        f" (lat_deg, lon_deg, h_m), and record {own_measurements} of this receiver for [gnss]"
    )
    return "own", Event(None, "rtcm_read", detail)


def _distance_m(fixes: ReferenceTable | None, station_m: tuple[float, float, float] | None) -> float:
    """Return how far the middle of a receiver's fixes is from the place that a stream states, 0 without either."""
    if fixes is None or station_m is None:
        return 0.0
    middle = (float(np.median(part)) for part in (fixes.lat_deg, fixes.lon_deg, fixes.h_m))
    return float(np.linalg.norm(np.subtract(pymap3d.geodetic2ecef(*middle), station_m)))
