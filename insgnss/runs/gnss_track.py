"""The antenna's way by the GNSS log alone, solved as the point solution and the filter's settings have it."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from insgnss.config.library import filter_config
from insgnss.log.checks.track import GnssTrack, track_of
from insgnss.log.flight import Flight, FlightLogs
from insgnss.log.precise import read_precise
from insgnss.runs.point import solve_rows
from insgnss.runs.setup import setup_filter
from insgnss.tables import GnssTable, ImuTable, NavigationData

FILTER: Final = "tight"  # its signals, masks and noise


def solve_track(flight: Flight, gnss: GnssTable, navigation: NavigationData | None) -> GnssTrack | None:
    """Return the track of a GNSS log, None where there is nothing to solve it with.

    Raises
    ------
    InsGnssError : the settings ask for something that the log has not
    """
    config = flight.config.gnss
    products = read_precise(config.precise)[0] if config.precise else None
    has_messages = navigation is not None and navigation.has_messages
    if gnss.sat is None and not has_messages and products is None:
        return None
    no_imu = ImuTable(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3)))
    logs = FlightLogs(no_imu, gnss, navigation, None, [], {}, products)
    setup = replace(setup_filter(flight, logs, filter_config(FILTER), several=False), with_carrier=False)
    if not setup.clock_groups:
        return None
    rows = setup.rows(gnss, setup.navigation)
    _, _, out = solve_rows(setup, rows)
    return track_of(rows.epoch_ns, out)
