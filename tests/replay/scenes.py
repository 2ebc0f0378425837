"""Place, time and sky that the simulated replays share."""

from __future__ import annotations

from functools import cache

from insgnss.gpstime import week_seconds_to_ns
from insgnss.simulation.journeys import AIRFIELD
from insgnss.simulation.sky import PAPER_SKY, constellation_over
from insgnss.tables import NavigationData

WEEK = 2385
START_S = 293_700.0
START_NS = int(week_seconds_to_ns(WEEK, START_S))
TOE_NS = int(week_seconds_to_ns(WEEK, START_S + 1500.0))


@cache
def paper_sky() -> NavigationData:
    """Return the 11 satellites over the airfield."""
    return constellation_over(AIRFIELD, PAPER_SKY, START_NS, 1200.0, TOE_NS)
