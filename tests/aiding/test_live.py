"""The aiding as it comes out of the live engine: the numbers of a replay, whoever takes them."""

from __future__ import annotations

import dataclasses
import socket
from typing import Any

import numpy as np
import pytest

import insgnss
from insgnss.aiding.sources import aiding_sources
from insgnss.aiding.stream import AidingStream, decode, messages_of
from insgnss.aiding.table import AidingTable
from insgnss.aiding.trace import FilterTrace, TraceSamples, traced
from insgnss.config.aiding import AidingConfig
from insgnss.config.library import filter_config
from insgnss.errors import ConfigError, NavigationDataError
from insgnss.filter.whole_log import TraceIntervals, run_filter
from insgnss.runs.setup import setup_filter
from insgnss.simulation.faults import cycle_slip
from insgnss.simulation.observations import NoiseTerms
from tests.aiding.arriving import Collected, feed
from tests.runs.scenes import WEEK, FlightInMemory, flight, turns, with_faults

SECONDS = 60.0
RATE_HZ = 50.0
CONFIG = AidingConfig(rate_hz=RATE_HZ, latency_s=0.01, sigma_interval_s=0.4)


def plain_flight() -> FlightInMemory:
    """Return a flight in turns whose epochs stand at samples."""
    return flight(turns(SECONDS))


def flight_between() -> FlightInMemory:
    """Return the flight with epochs 3 ms behind a sample."""
    return flight(turns(SECONDS, 1.003))


def carrier_flight() -> FlightInMemory:
    """Return a flight on two frequencies with carrier differences and a slip."""
    base = with_faults(turns(SECONDS), (cycle_slip(["G04"], 1.0, 40.0, signal="C5Q"),))
    receiver = dataclasses.replace(
        base.scenario.receiver,
        signals=("C1C", "C5Q"),
        carrier_noise=NoiseTerms(floor=0.0015, elevation=0.0007, cn0=0.0015),
    )
    base.scenario = dataclasses.replace(base.scenario, receiver=receiver)
    return flight(base)


def replayed(flown: FlightInMemory, config: AidingConfig = CONFIG) -> AidingTable:
    """Return the aiding of a replay."""
    logs = flown.logs
    setup = setup_filter(flown, logs, filter_config("tight17"))
    out, _ = run_filter(
        setup,
        logs.imu,
        setup.rows(logs.gnss, setup.navigation),
        "gnss",
        trace=TraceIntervals(config.rate_hz, config.sigma_interval_s),
    )
    return aiding_sources(setup, config).table(trace_of(out, flown))


def trace_of(out: Any, flown: FlightInMemory) -> FilterTrace:
    """Return what the loop left behind."""
    imu = flown.logs.imu
    return traced(out.trace, TraceSamples(imu.t_ns, imu.w_ib_b, imu.f_b))


def engine_of(flown: FlightInMemory, sink: Any, aiding: float | AidingConfig = CONFIG) -> insgnss.Engine:
    """Return a live engine for a flight."""
    setup = setup_filter(flown, flown.logs, filter_config("tight17"))
    return insgnss.Engine(setup, aiding=aiding, on_aiding=sink)


@pytest.mark.parametrize("epoch_first", [True, False], ids=["epoch before its sample", "epoch after it"])
@pytest.mark.parametrize("made", [plain_flight, carrier_flight])
def test_live_aiding_has_the_bits_of_the_replay(made: Any, epoch_first: bool) -> None:
    assert_same_bits(made(), epoch_first=epoch_first)


def test_live_aiding_has_the_bits_of_the_replay_with_epochs_between_samples() -> None:
    assert_same_bits(flight_between(), epoch_first=True)


def assert_same_bits(flown: FlightInMemory, *, epoch_first: bool) -> None:
    """Hold every column of the engine's aiding against the replay's."""
    sink = Collected()
    engine = engine_of(flown, sink)
    feed(engine, flown.logs, epoch_first=epoch_first)
    table = replayed(flown)
    wanted = table.columns(WEEK, parts=True)
    wanted["sv"] = np.array(table.sv_names)[wanted["sv"]]
    found = sink.columns()

    assert len(wanted["time_s"]) > 20_000
    assert list(found) == list(wanted)
    for name, values in wanted.items():
        np.testing.assert_array_equal(found[name], values, err_msg=name)


def test_late_epochs_hold_up_no_output_and_what_comes_between_is_near() -> None:
    flown = plain_flight()
    sink = Collected()
    feed(engine_of(flown, sink), flown.logs, epoch_first=False, late_ns=400_000_000)
    table = replayed(flown)
    # the start comes with the first epochs, which are late too
    t_ns = np.array([int(part.t_ns[0]) for part in sink.tables])
    first = int(np.searchsorted(table.t_ns, t_ns[0]))
    np.testing.assert_array_equal(t_ns, table.t_ns[first:])
    rate = sink.columns()["range_rate_mps"]
    wanted = table.columns(WEEK)["range_rate_mps"][-len(rate) :]
    sigma = sink.columns()["sd_range_rate_mps"]

    assert len(rate) == len(wanted)
    assert np.abs(rate - wanted).max() > 0.0
    # an update of a second's worth of range rates moves the prediction by less than its own sigma, as a rule
    assert np.mean(np.abs(rate - wanted) < 3.0 * sigma) > 0.99


def test_function_gets_messages_with_the_numbers_of_the_replay() -> None:
    flown = plain_flight()
    taken: list[Any] = []
    engine = engine_of(flown, taken.append)
    feed(engine, flown.logs, epoch_first=False)

    assert taken == messages_of(replayed(flown), WEEK)


def test_function_that_raises_is_told_and_the_filter_goes_on() -> None:
    flown = plain_flight()

    def difficult(_: Any) -> None:
        raise RuntimeError("no")

    engine = engine_of(flown, difficult, 2.0)
    feed(engine, flown.logs, epoch_first=False)

    assert engine.state.started
    assert {"start", "aiding_callback", "aiding_dropped"} <= {event.kind for event in engine.events}


def test_stream_to_a_socket_can_be_what_the_engine_feeds() -> None:
    flown = plain_flight()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as reader:
        reader.bind(("127.0.0.1", 0))
        reader.settimeout(5.0)
        with AidingStream(reader.getsockname()) as stream:
            feed(engine_of(flown, stream, 0.5), flown.logs, epoch_first=False)
            lines = [decode(reader.recv(65_536)) for _ in range(stream.sent)]

    assert len(lines) >= SECONDS * 0.5 - 3.0
    wanted = replayed(flown, filter_config("tight17").aiding.model_copy(update={"rate_hz": 0.5}))
    assert [line["satellites"] for line in lines] == [m["satellites"] for m in messages_of(wanted, WEEK)]


def test_rate_without_a_taker_and_the_reverse_are_errors() -> None:
    flown = plain_flight()
    setup = setup_filter(flown, flown.logs, filter_config("tight17"))
    with pytest.raises(ConfigError, match="a function that takes its rows"):
        insgnss.Engine(setup, aiding=50.0)
    with pytest.raises(ConfigError, match="a function that takes its rows"):
        insgnss.Engine(setup, on_aiding=print)
    with pytest.raises(ConfigError, match="invalid aiding rate"):
        insgnss.Engine(setup, aiding=-1.0, on_aiding=print)
    with pytest.raises(NavigationDataError, match="satellite states"):
        insgnss.Engine(dataclasses.replace(setup, navigation=None), aiding=1.0, on_aiding=print)
