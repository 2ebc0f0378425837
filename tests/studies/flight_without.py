"""A flight whose log lacks what an outage takes away: the long way to what a branch of the study gives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from insgnss.gpstime import week_seconds_to_ns
from insgnss.log.flight import Flight, FlightInMemory
from insgnss.studies.outage.windows import OutageWindow, Removal, further_without, window_ns


def flight_without(flight: Flight, window: OutageWindow, removal: Removal) -> Flight:
    """Return a flight whose GNSS log lacks whole satellites in a window: what a branch must agree with."""
    logs = flight.read()
    week_ns = int(week_seconds_to_ns(flight.config.gps_week, 0.0))
    from_ns, until_ns = window_ns(window, week_ns)
    within = (logs.gnss.t_ns >= from_ns) & (logs.gnss.t_ns < until_ns)
    kept = np.flatnonzero(~(removal.rows_of(logs.gnss) & within))
    further, _ = further_without(logs.further, logs.gnss, removal, from_ns, until_ns)
    return FlightInMemory(
        flight.path,
        flight.config,
        flight.imu_grade,
        flight.oscillator,
        replace(logs, gnss=logs.gnss.take(kept), further=tuple(further)),
    )
