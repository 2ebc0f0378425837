"""A filter that cannot start says why, in a stream too, where no error ends the run."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from insgnss.constants import NS_PER_S
from insgnss.tables import GnssTable
from tests.filter.test_engine import no_delay, stream
from tests.runs.scenes import flight, rows_where, true_start, turns
from tests.sensors.test_live import live_engine


def late(gnss: GnssTable) -> GnssTable:
    return dataclasses.replace(gnss, t_ns=gnss.t_ns + NS_PER_S)


def three_satellites(gnss: GnssTable) -> GnssTable:
    return rows_where(gnss, np.isin(gnss.sv, np.unique(gnss.sv)[:3]))


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (late, "agree on no place"),
        (three_satellites, "only 3 of 3 pseudoranges"),
    ],
)
def test_stream_that_does_not_start_says_why(spoil: Callable[[GnssTable], GnssTable], words: str) -> None:
    """After half a minute, and not at every epoch."""
    flown = flight(turns(45.0))
    engine = live_engine(flown)
    stream(engine, dataclasses.replace(flown.logs, gnss=spoil(flown.logs.gnss)), no_delay())
    (event,) = engine.events
    assert event.kind == "start_waits" and event.detail.startswith("no start for 30 s: ")
    assert words in event.detail


def test_given_start_later_in_the_log_is_not_waited_for() -> None:
    flown = flight(turns(45.0), start=true_start(turns(45.0), 40.0))
    engine = live_engine(flown)
    stream(engine, flown.logs, no_delay())
    assert "start_waits" not in {event.kind for event in engine.events}
