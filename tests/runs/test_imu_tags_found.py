"""Inertial tags that are off though declared exact: found, and a state from then on. Tags that change: found anew."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from itertools import cycle

import numpy as np
import pandas as pd
import pytest
from scipy import stats

import insgnss
from insgnss.config.library import filter_config
from insgnss.errors import ConfigError
from insgnss.filter.engine import FilterEngine
from insgnss.filter.imu.inertial_stream import screened
from insgnss.filter.layout import StateBlock
from insgnss.filter.navigator import Navigator
from insgnss.filter.output.writing import new_output
from insgnss.filter.state import MAX_OPTIONAL, OFFSETS
from insgnss.filter.states.imu_time import IMU_TIME
from insgnss.filter.states.rate_lag import RATE_LAG
from insgnss.log.flight import FlightInMemory
from insgnss.runs.result import Run
from insgnss.runs.setup import setup_filter
from insgnss.studies.outage.study import outage_study
from insgnss.tables import ImuTable
from tests.filter.test_engine import assert_same_bits, beginning, no_delay, stream
from tests.runs.scenes import START_S, flight, kinds, turns, without_samples
from tests.runs.test_imu_time import EXACT, PLAIN, found, with_late_imu

LATE_S = 0.05
LEVER_KNOWN = {"process.lever_arm_sigma_m": 0.01}
SURVEYED = {**LEVER_KNOWN, **EXACT}
NAMES = ("n_m", "e_m", "d_m", "vn_mps", "ve_mps", "vd_mps", "roll_deg", "pitch_deg", "yaw_deg")


@cache
def late(by_s: float = LATE_S, seed: int = 23) -> FlightInMemory:
    return with_late_imu(flight(turns(180.0), seed=seed), by_s)


@cache
def replayed() -> Run:
    """Return the run of the late tags that several tests look at."""
    return insgnss.replay(late(), covariance=True, settings=EXACT)


@cache
def without_search(by_s: float) -> Run:
    return insgnss.replay(late(by_s), settings=PLAIN)


def found_s(run: Run) -> float:
    """Return when the offset became a state [s]."""
    found = run.events[run.events["kind"] == "time_tag_suspect"]
    (at_s,) = found.loc[found["detail"].str.contains("recomputed with the offset"), "time_s"]
    return float(at_s)


def rms_over_sigma(run: Run, from_s: float) -> pd.Series:
    """Return the rms of each error over its sigma from a time of the week on."""
    assert run.errors is not None
    later = run.errors[run.errors["time_s"] > from_s]
    ratios = {name: later[f"d_{name}"] / later[f"sd_{name}"] for name in NAMES}
    return pd.Series({name: float(np.sqrt(np.mean(np.square(values)))) for name, values in ratios.items()})


@pytest.mark.parametrize("by_s", [LATE_S, -LATE_S, 0.1])
@pytest.mark.parametrize("settings, limit", [(SURVEYED, 1.8), (EXACT, stats.norm.isf(0.0005))])
def test_offset_that_is_found_becomes_a_state_and_the_errors_fit_their_sigmas(
    by_s: float, settings: dict[str, float], limit: float
) -> None:
    """At constant speed the offset looks like the lever arm along the way: one error that all rows share."""
    run, plain = insgnss.replay(late(by_s), settings=settings), without_search(by_s)
    at_s = found_s(run)
    assert at_s - START_S < 120.0
    assert not {"restart", "reset"} & set(kinds(run))
    assert rms_over_sigma(run, at_s).max() < limit
    assert rms_over_sigma(plain, at_s)[["roll_deg", "pitch_deg"]].max() > 5.0
    assert "imu_time_offset_s" not in run.nav.columns


def assert_stream_has_the_same_bits(
    flown: FlightInMemory, told: str, settings: Mapping[str, float] | None = None, in_time: bool = False
) -> None:
    """Ask that a stream, its epochs late or in time, gives the bits of a replay and reports an event of a kind.

    The last of every three epochs is in time, so that a flight of as many epochs is done at its end.
    """
    for delays in (cycle((400_000_000, 200_000_000, 0)), *([no_delay()] if in_time else [])):
        engine = FilterEngine(setup_filter(flown, flown.logs, filter_config("tight17", settings)))
        stream(engine, flown.logs, delays)
        assert engine.state.t_ns == flown.logs.imu.t_ns[-1]
        assert_same_bits(engine.take_results(all_of_them=True), flown.logs, flown, settings)
        assert told in {event.kind for event in engine.events}


@cache
def changed(by_s: float) -> FlightInMemory:
    """Return a flight whose inertial tags jump after 60 s; those that would go back are left out."""
    flown = flight(turns(180.0), seed=31)
    imu = flown.logs.imu
    t_s = (imu.t_ns - imu.t_ns[0]) * 1e-9
    t_ns = imu.t_ns + round(by_s * 1e9) * (t_s > 60.0)
    kept = (t_s <= 60.0 + min(by_s, 0.0)) | (t_s > 60.0)
    imu = ImuTable(t_ns[kept], imu.w_ib_b[kept], imu.f_b[kept])
    return replace(flown, logs=replace(flown.logs, imu=imu))


@pytest.mark.parametrize("by_s", [LATE_S, -LATE_S])
def test_tags_that_change_leave_the_offset_unknown_again(by_s: float) -> None:
    """By then it was known to be none, to a millisecond."""
    run = insgnss.replay(changed(by_s), settings=LEVER_KNOWN)
    at_s = found_s(run)
    assert START_S + 60.0 < at_s < START_S + 120.0
    assert not {"restart", "reset"} & set(kinds(run))
    value, sigma = found(run)
    assert abs(value + by_s) < 4.0 * sigma < 0.02
    assert rms_over_sigma(run, at_s).max() < 1.8


def test_stream_of_tags_that_change_has_the_same_bits() -> None:
    assert_stream_has_the_same_bits(beginning(changed(LATE_S), 126.0), "time_tag_suspect")


def test_stream_of_such_samples_has_the_same_bits() -> None:
    assert_stream_has_the_same_bits(beginning(late(), 75.0), "time_tag_suspect", EXACT, in_time=True)


def test_smoother_leaves_the_epochs_before_as_the_filter_wrote_them() -> None:
    smoothed, filtered = (insgnss.replay(late(), smooth=each, settings=SURVEYED) for each in (True, False))
    at_s, names = found_s(filtered), ["n_m", "vn_mps", "roll_deg"]
    before = [run.nav.loc[run.nav["time_s"] < at_s, "lat_deg"].to_numpy() for run in (smoothed, filtered)]
    np.testing.assert_array_equal(*before)
    assert rms_over_sigma(smoothed, at_s).max() < 1.8
    assert smoothed.errors is not None and filtered.errors is not None
    rms = [
        np.sqrt(run.errors.loc[run.errors["time_s"] > at_s, [f"d_{name}" for name in names]].pow(2).mean())
        for run in (smoothed, filtered)
    ]
    assert (rms[0] < 0.8 * rms[1]).all()


def test_offset_stays_a_state_over_a_gap_in_the_samples() -> None:
    gap_s = found_s(replayed()) - START_S + 30.0
    flown = beginning(late(), gap_s + 50.0)
    imu = without_samples(flown.logs.imu, gap_s, gap_s + 3.0)
    with_gap = replace(flown, logs=replace(flown.logs, imu=imu))
    run = insgnss.replay(with_gap, settings=EXACT)
    assert kinds(run).count("time_tag_suspect") == 1
    assert kinds(run).count("imu_gap") == 1
    assert rms_over_sigma(run, START_S + gap_s + 3.0).max() < 1.8
    engine = FilterEngine(setup_filter(with_gap, with_gap.logs, filter_config("tight17", EXACT)))
    stream(engine, with_gap.logs, no_delay())
    assert_same_bits(engine.take_results(all_of_them=True), with_gap.logs, with_gap, EXACT)


def test_offset_that_is_a_state_already_is_doubted_and_without_room_it_does_not_become_one() -> None:
    flown = late()
    setup = setup_filter(flown, flown.logs, filter_config("tight17", EXACT))
    assert setup.may_estimate_imu_time
    wider = setup.with_imu_time(early=True)
    assert wider.may_estimate_imu_time and wider.with_imu_time(early=True).layout == wider.layout
    room = MAX_OPTIONAL - setup.layout.n_optional
    full = StateBlock("many", tuple(f"x_{i}" for i in range(room)), "m", 1.0)
    assert not setup.with_further([full]).may_estimate_imu_time


def late_rates(flown: FlightInMemory, by_s: float) -> FlightInMemory:
    """Return a flight whose range rates are of the time ``by_s`` before their tags, linear between the epochs."""
    gnss = flown.logs.gnss
    t_s, rates, doppler = gnss.t_ns * 1e-9, gnss.range_rate_mps.copy(), gnss.doppler_hz.copy()
    for sv in np.unique(gnss.sv):
        own = np.flatnonzero(gnss.sv == sv)
        for values in (rates, doppler):
            values[own] = np.interp(t_s[own] - by_s, t_s[own], values[own])
    gnss = replace(gnss, range_rate_mps=rates, doppler_hz=doppler)
    return replace(flown, logs=replace(flown.logs, gnss=gnss))


@pytest.mark.parametrize("tags_s, lag_s", [(-0.08, 0.0), (0.0, 0.08)])
def test_pseudoranges_say_whether_tags_are_early_or_range_rates_late(tags_s: float, lag_s: float) -> None:
    """Both look the same in the range rates, so the filter begins with both as states."""
    flown = late_rates(with_late_imu(flight(turns(180.0), seed=29), tags_s), lag_s)
    setup = setup_filter(
        flown, flown.logs, filter_config("tight17", {"measurements.carrier": False, **SURVEYED})
    )
    rows = setup.rows(flown.logs.gnss, setup.navigation)
    ((imu, _),) = screened(flown.logs.imu, setup).stretches()
    navigator = Navigator(setup)
    first, last = np.searchsorted(rows.epoch_ns, [imu.t_ns[0], imu.t_ns[-1] + 1]).tolist()
    out = new_output(rows, last, 64, np.zeros(0, np.int64), setup.layout.n_shown)
    navigator.run(imu, rows, first, last, out)
    bank, layout = navigator.bank, navigator.setup.layout
    assert bank is not None
    at = [layout.at(IMU_TIME), layout.at(RATE_LAG)]
    assert min(at) >= 0
    found = bank.state[0]["optional"][np.array(at) - OFFSETS]
    found[1] += bank.state[0].rates_late_s  # a lag that was found first is beside the state
    sigma = np.sqrt(np.diag(bank.P[0])[at])
    assert sigma.max() < 0.015
    assert np.abs((found - np.array([-tags_s, lag_s])) / sigma).max() < 4.0


def test_covariance_of_every_row_is_that_of_its_sigmas_while_the_states_change() -> None:
    """The row of the epoch at which they do had none: its work space was another one by then."""
    run = replayed()
    sd2 = run.nav["sd_n_m"].pow(2) - run.nav["sd_slow_n_m"].pow(2)
    np.testing.assert_allclose(run.nav["cov_n_n_m2"], sd2, rtol=1e-6)


def test_outage_begins_from_a_filter_with_further_states() -> None:
    from_s = found_s(replayed()) + 40.0
    study = outage_study(
        beginning(late(), from_s - START_S + 20.0), [(from_s, from_s + 10.0)], settings=EXACT
    )
    assert len(study.windows) == 1


def test_names_of_the_states_that_a_filter_may_add_are_refused() -> None:
    flown = late()
    setup = setup_filter(flown, flown.logs, filter_config("tight17", EXACT))
    for name, column in (("range_rate_lag", "x"), ("x", "imu_time_offset_s")):
        with pytest.raises(ConfigError, match="name of the filter's own states"):
            setup.with_further([StateBlock(name, (column,), "s", 1.0)])
