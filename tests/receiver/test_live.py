"""The search supervisor in the streaming engine: the decisions of a replay, epoch by epoch."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest

import insgnss
from insgnss.config.library import filter_config
from insgnss.constants import NS_PER_S
from insgnss.errors import ConfigError
from insgnss.log.flight import FlightInMemory
from insgnss.receiver import SupervisedRun
from insgnss.runs.result import Run
from insgnss.runs.setup import setup_filter
from insgnss.tables import GnssTable
from tests.aiding.arriving import feed
from tests.receiver.test_replay import banked_flight
from tests.runs.scenes import START_NS

LATE_NS = 150_000_000
SILENT_S = (19.5, 24.5)  # no epochs
BLIND_S = (39.5, 44.5)  # epochs of a receiver that tracks nothing


def engine_of(flown: FlightInMemory) -> insgnss.Engine:
    setup = setup_filter(flown, flown.logs, filter_config("tight"))
    return insgnss.Engine(setup, supervise=True)


@cache
def replayed() -> Run:
    return insgnss.replay(banked_flight(), supervise=True)


@cache
def interrupted_flight() -> FlightInMemory:
    """Return the banked flight with a silence of the receiver and a time in which it tracks nothing."""
    flown = banked_flight()
    gnss = flown.logs.gnss
    t_s = (gnss.t_ns - START_NS) / NS_PER_S
    blind = (t_s > BLIND_S[0]) & (t_s < BLIND_S[1])
    pseudorange = np.where(blind, np.nan, gnss.pseudorange_m)
    kept = replace(gnss, pseudorange_m=pseudorange, doppler_hz=np.where(blind, np.nan, gnss.doppler_hz))
    kept = kept.take(np.flatnonzero((t_s < SILENT_S[0]) | (t_s > SILENT_S[1])))
    return replace(flown, logs=replace(flown.logs, gnss=kept))


def decided(flown: FlightInMemory, *, epoch_first: bool, late_ns: int = 0) -> SupervisedRun:
    engine = engine_of(flown)
    feed(engine, flown.logs, epoch_first=epoch_first, late_ns=late_ns)
    return engine.take_supervision()


def assert_same_decisions(found: SupervisedRun, run: Run) -> None:
    """Hold every column against the replay's up to the last epoch that has arrived, bit for bit."""
    assert found.supervision["time_s"].iloc[-1] >= run.supervision["time_s"].iloc[-1] - 1.0
    for name in ("supervision", "transitions"):
        table, wanted = getattr(found, name), getattr(run, name)
        wanted = wanted[wanted["time_s"] <= found.supervision["time_s"].iloc[-1]]
        assert list(table.columns) == list(wanted.columns) and len(table) == len(wanted)
        for column in wanted.columns:
            a, b = (_plain(each[column]) for each in (table, wanted))
            np.testing.assert_array_equal(a, b, err_msg=column)


def _plain(column: pd.Series) -> np.ndarray:
    return (column.astype("str") if column.dtype == "category" else column).to_numpy()


@pytest.mark.parametrize(
    ("epoch_first", "late_ns"), [(True, 0), (False, LATE_NS)], ids=["epoch before its sample", "epoch late"]
)
def test_live_decisions_have_the_bits_of_the_replay(epoch_first: bool, late_ns: int) -> None:
    found = decided(banked_flight(), epoch_first=epoch_first, late_ns=late_ns)

    assert_same_decisions(found, replayed())
    assert len(found.supervision) >= 600 and "hidden" in set(found.transitions["reason"].astype("str"))


def test_decisions_of_a_silent_and_of_a_blind_receiver_are_those_of_the_replay() -> None:
    flown = interrupted_flight()
    found, run = decided(flown, epoch_first=False), insgnss.replay(flown, supervise=True)

    assert_same_decisions(found, run)
    t_s = found.supervision["time_s"] - 293_700.0
    silent, blind = ((t_s > first) & (t_s < last) for first, last in (SILENT_S, BLIND_S))
    assert t_s[silent].nunique() == t_s[blind].nunique() == 5
    # after one interval a silence says nothing, while a receiver without any pseudorange says that all are missing
    assert set(found.supervision.loc[silent & (t_s > 21.5), "receiver"]) == {"not_known"}
    assert set(found.supervision.loc[blind, "receiver"]) == {"missing"}
    lost = found.supervision[blind & (t_s > 42.5) & (found.supervision["decision"] == "visible")]
    assert len(lost) and not set(lost["state"]) & {"track", "resume"}


def test_supervised_engine_has_the_state_of_the_replay_and_gives_each_decision_once() -> None:
    flown = banked_flight()
    logs = flown.logs
    engine = engine_of(flown)
    pieces = []
    epochs = [logs.gnss.take(np.flatnonzero(logs.gnss.t_ns == t)) for t in np.unique(logs.gnss.t_ns)[:20]]
    for t_ns, w, f in zip(logs.imu.t_ns, logs.imu.w_ib_b, logs.imu.f_b, strict=True):
        engine.imu(int(t_ns), w, f)
        if not epochs:
            break
        if t_ns == epochs[0].t_ns[0]:
            pieces += arrived_in_parts(engine, epochs.pop(0))
    run = replayed()
    together = pd.concat([piece.supervision for piece in pieces], ignore_index=True)
    last_s = together["time_s"].iloc[-1]
    wanted = run.supervision[run.supervision["time_s"] <= last_s]
    nav = run.nav[run.nav["time_s"] <= last_s].iloc[-1]

    # the first call after an epoch has its rows, the second none
    assert [len(piece.supervision) for piece in pieces[-4:]] == [11, 0, 11, 0]
    np.testing.assert_array_equal(_plain(together["state"]), _plain(wanted["state"]))
    np.testing.assert_array_equal(together["sd_range_m"], wanted["sd_range_m"])
    assert engine.state.values["lat_deg"] == pytest.approx(nav["lat_deg"], abs=1e-4)
    spent = pieces[-1].search_times.set_index("sv")["predicted_s"]
    assert set(spent) == {together["time_s"].nunique() - 1.0}


def arrived_in_parts(engine: insgnss.Engine, epoch: GnssTable) -> list[SupervisedRun]:
    """Hand over an epoch in two parts and take what is decided, twice."""
    half = len(epoch.t_ns) // 2
    for part in (slice(0, half), slice(half, None)):
        engine.gnss(epoch.take(np.arange(len(epoch.t_ns))[part]))
    return [engine.take_supervision(), engine.take_supervision()]


def test_engine_that_is_not_asked_to_supervise_says_how() -> None:
    flown = banked_flight()
    engine = insgnss.Engine(setup_filter(flown, flown.logs, filter_config("tight")))

    with pytest.raises(ConfigError, match="does not supervise"):
        engine.take_supervision()
