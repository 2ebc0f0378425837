"""Range rates that lag: found in a turn and taken into account from then on; with the lag declared nothing is wrong."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import insgnss
from insgnss.config.library import filter_config
from insgnss.log.flight import FlightInMemory
from insgnss.runs.engine import Engine
from insgnss.runs.setup import setup_filter
from insgnss.tables import GnssTable, ImuTable
from tests.benchmarks.trust import spoiling
from tests.benchmarks.trust.faults import fault_rows
from tests.benchmarks.trust.flying import drawn
from tests.benchmarks.trust.rows import Case
from tests.filter.test_engine import assert_same_bits, no_delay, shortened, stream
from tests.runs.test_suspects import (
    ATTITUDE,
    BEGIN_S,
    FAULT_S,
    POSITION,
    VELOCITY,
    seconds,
    sigmas,
    told,
    when,
    with_logs,
    with_rows,
)

LAG_S = 0.2
LATE = "rates_late"


@cache
def lagging() -> FlightInMemory:
    """Return the sample flight with Doppler that is 0.2 s late from 500 s on, linear between its epochs."""

    def change(gnss: GnssTable, rows: np.ndarray) -> None:
        t, was = seconds(gnss.t_ns), gnss.doppler_hz.copy()
        for sv in np.unique(gnss.sv):
            own = np.flatnonzero(gnss.sv == sv)
            late = own[np.isin(own, rows)]
            gnss.doppler_hz[late] = np.interp(t[late] - LAG_S, t[own], was[own])

    return with_rows(change, to_s=np.inf)


def declared(flight: FlightInMemory, lag_s: float) -> FlightInMemory:
    """Return a flight whose file says that the range rates lag."""
    gnss = flight.config.gnss.model_copy(update={"range_rate_lag_s": lag_s})
    return replace(flight, config=flight.config.model_copy(update={"gnss": gnss}))


def test_lag_of_the_range_rates_is_found_in_a_turn_and_named() -> None:
    run = insgnss.replay(lagging())
    (detail,) = told(run, LATE)
    assert float(re.findall(r"lag ([\d.]+) s", detail)[0]) == pytest.approx(LAG_S, abs=0.05)
    assert "gnss.range_rate_lag_s" in detail
    others = {"reset", "restart", "sensor_suspect", "imu_distrusted", "time_tag_suspect", "kind_refused"}
    assert not others & set(run.events["kind"])
    assert sigmas(run, FAULT_S + when(run, LATE)[0], POSITION, VELOCITY, ATTITUDE) < 5.0


def test_lag_that_was_found_is_kept_over_a_gap_of_the_inertial_samples() -> None:
    flight, gap_s = lagging(), FAULT_S + 50.0
    imu = flight.logs.imu
    kept = np.abs(seconds(imu.t_ns) - gap_s) > 5.0
    imu = ImuTable(imu.t_ns[kept], imu.w_ib_b[kept], imu.f_b[kept])
    run = insgnss.replay(replace(flight, logs=replace(flight.logs, imu=imu)))
    assert when(run, "start")[1] > when(run, "imu_gap")[0] > when(run, LATE)[0]
    assert sigmas(run, gap_s + 7.0, POSITION, VELOCITY, ATTITUDE) < 5.0


def test_engine_finds_the_lag_as_replay_does_to_the_bit() -> None:
    flight = lagging()
    logs = shortened(flight.logs, FAULT_S + 60.0 - BEGIN_S)
    engine = Engine(setup_filter(flight, logs, filter_config("tight17")))
    stream(engine, logs, no_delay())
    assert_same_bits(engine.take_results(all_of_them=True), logs, replace(flight, logs=logs))
    assert LATE in {event.kind for event in engine.events}


def test_lag_that_is_declared_is_no_fault() -> None:
    (row,) = (row for row in fault_rows() if row.name == "fault_doppler_late")
    _, log, flight = drawn(replace(row, grade="tactical"), 3)
    start_ns = int(flight.logs.imu.t_ns[0])
    late = spoiling.late_doppler(
        Case(log.imu, log.gnss, log.navigation, start_ns), 0.0, np.random.default_rng(1)
    )
    run = insgnss.replay(declared(replace(flight, logs=replace(flight.logs, gnss=late.gnss)), LAG_S))
    assert set(run.events["kind"]) <= {"start", "heading_known", "heading_single"}
    assert run.errors is not None
    known = run.errors[run.errors["time_s"] > run.errors["time_s"].iloc[0] + 100.0]
    names = (*POSITION, *VELOCITY, *ATTITUDE)
    assert max((known[f"d_{name}"].abs() / known[f"sd_{name}"]).max() for name in names) < 5.0


def test_lag_that_is_declared_but_not_there_is_found_not_to_be() -> None:
    run = insgnss.replay(declared(with_logs(), LAG_S))
    (detail,) = told(run, "installation_known")
    (found,) = re.findall(r"range_rate_lag_s is ([-+\d.]+)", detail)
    assert float(found) == pytest.approx(-LAG_S, abs=0.01)
    assert sigmas(run, FAULT_S, POSITION, VELOCITY, ATTITUDE) < 5.0


def lagging_from_the_start(lag_s: float) -> FlightInMemory:
    """Return a shorter sample flight whose range rates are of an earlier time, five turns."""

    def change(gnss: GnssTable, rows: np.ndarray) -> None:
        t, was = seconds(gnss.t_ns), gnss.doppler_hz.copy()
        for sv in np.unique(gnss.sv):
            own = np.flatnonzero(gnss.sv == sv)
            gnss.doppler_hz[own] = np.interp(t[own] - lag_s, t[own], was[own])

    return with_rows(change)


@pytest.mark.parametrize("lag_s", [0.03, 0.05])
def test_lag_from_the_start_is_estimated_and_does_not_pass_for_early_tags(lag_s: float) -> None:
    run = insgnss.replay(lagging_from_the_start(lag_s))
    last = run.nav.iloc[-1]
    for column, truth in (("range_rate_lag_s", lag_s), ("imu_time_offset_s", 0.0)):
        # Doppler that is linear between epochs a second apart lags by a little more or less than it should
        assert abs(last[column] - truth) < 4.0 * last[f"sd_{column}"] < 0.02
    assert not {"time_tag_suspect", "sensor_suspect", "reset"} & set(run.events["kind"])
    assert sigmas(run, 100.0, POSITION, VELOCITY, ATTITUDE) < 5.0
    assert "range_rate_lag_s" in told(run, "installation_known")[0]
