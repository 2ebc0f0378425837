"""GNSS tags that are off: one epoch shows it, then their offset is a state, and no sigma lies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any, cast

import numpy as np
import pytest

import insgnss
from insgnss.config.library import filter_config
from insgnss.filter.diagnosis.offset_state import with_gnss_time
from insgnss.filter.loop_events import take_events
from insgnss.filter.output.writing import TAG_STEP, log_event, new_output
from insgnss.filter.setup import FilterSetup
from insgnss.filter.state import MAX_OPTIONAL, OFFSETS, new_bank
from insgnss.filter.states.gnss_time import GNSS_TIME
from insgnss.log.flight import FlightInMemory
from insgnss.runs.result import Run
from insgnss.runs.setup import setup_filter
from insgnss.tables import Float64
from tests.filter.scene import place, rows_of, sky
from tests.filter.test_engine import beginning
from tests.runs.scenes import START_NS, START_S, flight, kinds, turns, without_samples
from tests.runs.test_imu_tags_found import (
    NAMES,
    assert_stream_has_the_same_bits,
    rms_over_sigma,
)

FROM_S, TO_S = 100.0, 140.0
Off = Callable[[Float64], Float64]


def off_for_a_while(by_s: float) -> Off:
    return lambda t_s: np.where((t_s > FROM_S) & (t_s < TO_S), by_s, 0.0)


def off_by(by_s: float) -> Off:
    return lambda t_s: np.full(len(t_s), by_s)


def jittering(t_s: Float64) -> Float64:
    return np.where(t_s > FROM_S, np.random.default_rng(5).normal(0.0, 0.02, len(t_s)), 0.0)


def with_tags(off: Off, seed: int) -> FlightInMemory:
    """Return a flight in turns whose epochs have tags that are off by ``off`` of the time of the flight [s]."""
    flown = flight(turns(180.0), seed=seed)
    gnss = flown.logs.gnss
    epochs, of_row = np.unique(gnss.t_ns, return_inverse=True)
    off_ns = np.rint(off((epochs - START_NS) * 1e-9) * 1e9).astype(np.int64)
    return replace(flown, logs=replace(flown.logs, gnss=replace(gnss, t_ns=gnss.t_ns + off_ns[of_row])))


@cache
def jumped(by_s: float, seed: int = 41) -> FlightInMemory:
    return with_tags(off_for_a_while(by_s), seed)


def told(run: Run) -> list[tuple[float, str]]:
    """Return the times of the flight and the words of the events on GNSS tags."""
    found = run.events[run.events["kind"] == "time_tag_jump"]
    return list(zip(found["time_s"] - START_S, found["detail"], strict=True))


def offset_s(detail: str) -> float:
    """Return the offset that an event states [s]."""
    return float(detail.split("off by ")[1].split(" s")[0])


def worst(run: Run, from_s: float) -> float:
    """Return the largest error over its sigma from a time of the flight on."""
    assert run.errors is not None
    later = run.errors[run.errors["time_s"] > START_S + from_s]
    return max(float((later[f"d_{name}"] / later[f"sd_{name}"]).abs().max()) for name in NAMES)


@pytest.mark.parametrize("by_s", [0.02, 0.05, -0.1, 1.0])
def test_jump_and_return_are_told_with_their_size_and_the_sigmas_stay_honest(by_s: float) -> None:
    run = insgnss.replay(jumped(by_s))
    (begun_s, begun), (ended_s, ended) = told(run)
    assert begun_s - FROM_S < 5.0 + abs(by_s) and ended_s - TO_S < 5.0 + abs(by_s)
    for detail, known_s in ((begun, by_s), (ended, 0.0)):
        assert abs(offset_s(detail) - known_s) < 0.01
        assert "their offset is estimated" in detail
    assert worst(run, FROM_S) < 5.0
    assert rms_over_sigma(run, START_S + FROM_S).max() < 1.6
    assert not {"reset", "restart", "time_tag_suspect", "sensor_suspect"} & set(kinds(run))
    assert "gnss_time_offset_s" not in run.nav.columns


def test_filter_that_does_not_recover_does_not_look_at_the_tags() -> None:
    run = insgnss.replay(jumped(0.05), settings={"health.recovery": False})
    assert told(run) == []
    assert worst(run, FROM_S) > 5.0


@pytest.mark.parametrize("by_s", [0.05, -0.03, 0.1])
def test_tags_that_are_off_from_the_start_are_found_though_the_start_was_elsewhere(by_s: float) -> None:
    run = insgnss.replay(with_tags(off_by(by_s), seed=43))
    ((at_s, detail),) = told(run)
    began_s = float(run.events.loc[run.events["kind"] == "start", "time_s"].iloc[0]) - START_S
    assert at_s - began_s < 2.0
    assert abs(offset_s(detail) - by_s) < 0.01
    assert worst(run, 0.0) < 5.0


def test_tags_that_jitter_are_believed_no_more_and_that_is_told_once() -> None:
    run = insgnss.replay(with_tags(jittering, seed=47))
    details = [detail for _, detail in told(run)]
    assert sum("counts as unknown" in detail for detail in details) == 1
    assert len(details) <= 4
    assert worst(run, FROM_S) < 5.0
    carriers = run.measurements[run.measurements["kind"] == "carrier"]
    assert set(carriers.loc[carriers["time_s"] > START_S + FROM_S + 30.0, "status"]) <= {"tag_jump"}


def test_stream_of_such_epochs_has_the_same_bits() -> None:
    assert_stream_has_the_same_bits(beginning(jumped(0.05), TO_S + 10.0), "time_tag_jump")


def test_offset_is_unknown_after_a_gap_in_the_samples_and_no_fix_with_wrong_tags_is_believed() -> None:
    flown = jumped(0.05)
    gapped = replace(flown, logs=replace(flown.logs, imu=without_samples(flown.logs.imu, 115.0, 118.0)))
    run = insgnss.replay(gapped)
    assert kinds(run).count("imu_gap") == 1 and "reset" not in kinds(run)
    assert worst(run, 118.0) < 5.0


def test_smoother_goes_back_over_the_return_of_the_tags() -> None:
    flown = jumped(0.05)
    smoothed, filtered = insgnss.replay(flown, smooth=True), insgnss.replay(flown)
    assert rms_over_sigma(smoothed, START_S + FROM_S + 5.0).max() < 1.6
    assert smoothed.errors is not None and filtered.errors is not None
    rms = [
        run.errors.loc[run.errors["time_s"] > START_S + FROM_S + 5.0, ["d_n_m", "d_e_m"]].pow(2).mean()
        for run in (smoothed, filtered)
    ]
    assert (rms[0] < 0.8 * rms[1]).all()


@cache
def sound_setup() -> FilterSetup:
    flown = jumped(0.05)
    return setup_filter(flown, flown.logs, filter_config("tight17"))


def test_offset_becomes_a_state_once_and_not_beside_the_phases_of_several_antennas() -> None:
    setup = sound_setup()
    bank = new_bank(1, setup.layout.n_optional)
    wider, with_it = with_gnss_time(bank, setup)
    assert with_it.layout.at(GNSS_TIME) == OFFSETS + setup.layout.n_values
    assert wider.P.shape[1] == bank.P.shape[1] + 1
    assert with_gnss_time(wider, with_it) == (wider, with_it)
    several = replace(setup, aid=cast(Any, object()))
    assert with_gnss_time(bank, several) == (bank, several)
    assert setup.layout.n_optional < MAX_OPTIONAL


def test_event_says_what_becomes_of_the_epochs() -> None:
    out = new_output(rows_of([START_NS], sky(place())), 1, 4, np.zeros(0, np.int64))
    setup = sound_setup()
    for fits, words in ((setup, "estimated"), (replace(setup, aid=cast(Any, object())), "are not used")):
        log_event(out.events, out.counts[0], START_NS, TAG_STEP, 0.05)
        (event,) = take_events(out, fits)
        assert event.kind == "time_tag_jump" and words in event.detail and "+0.050 s" in event.detail
