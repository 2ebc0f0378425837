"""Clocks of several constellations over whole simulated flights: they come, go, are swapped, and differ by channel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.runs.corrected_flights import (
    SETTLED_S,
    of_second,
    replayed,
    seconds_of,
    settings,
    statuses,
    two_clocks,
    two_systems,
)
from tests.runs.scenes import (
    START_S,
    after,
    assert_honest,
    flight,
    position_error_m,
)


@pytest.mark.parametrize("offset_m", [40.0, -700.0])
def test_constellation_of_the_middle_third_comes_and_goes_with_its_offset_found(offset_m: float) -> None:
    _, log = two_systems()
    t = seconds_of(log.gnss)
    run = replayed(
        two_clocks(offset_m, ~of_second(log.gnss) | ((t >= 40.0) & (t < 80.0))), settings(ionosphere="none")
    )
    assert_honest(run, 0.0)
    assert position_error_m(after(run, SETTLED_S)).max() < 3.0
    assert set(statuses(run, "E")) == {"used"} and set(statuses(run, "G", 40.0)) == {"used"}
    found = run.nav[run.nav["time_s"] > START_S + 45.0]["offset_E_m"]
    assert len(found) and np.abs(found - offset_m).max() < 2.0


def test_qzss_that_the_receiver_shows_off_by_metres_moves_no_position() -> None:
    """2 m of five satellites are 1.2 m in the position where QZSS shares the clock of GPS."""
    off, right = (
        replayed(two_clocks(offset_m, letter="J"), settings(ionosphere="none")) for offset_m in (2.0, 0.0)
    )
    assert_honest(off, 0.0)
    assert off.nav["offset_J_m"].iloc[-1] == pytest.approx(2.0, abs=0.6)
    moved = position_error_m(after(off, 60.0)) - position_error_m(after(right, 60.0))
    assert np.abs(moved).max() < 0.2


def test_outage_of_gps_is_flown_through_with_galileo_alone() -> None:
    _, log = two_systems()
    t = seconds_of(log.gnss)
    run = replayed(
        two_clocks(40.0, of_second(log.gnss) | (t < 50.0) | (t >= 110.0)), settings(ionosphere="none")
    )
    assert_honest(run, 0.0)
    during = run.nav[run.nav["time_s"].between(START_S + 51.0, START_S + 109.0)]
    assert (during["n_used"] >= 4).all()
    assert position_error_m(after(run, SETTLED_S)).max() < 5.0
    assert set(statuses(run, "G", 110.0)) == {"used"}


@pytest.mark.parametrize("step_m", [0.0, 30_000.0])
def test_start_with_galileo_alone_takes_gps_in_when_it_comes(step_m: float) -> None:
    """Until then the clock of GPS is unknown, also after a step of the receiver's."""
    _, log = two_systems()
    t = seconds_of(log.gnss)
    flown = two_clocks(40.0, of_second(log.gnss) | (t >= 30.0), stepped_m=np.where(t >= 22.0, step_m, 0.0))
    run = replayed(flown, settings(ionosphere="none"))
    assert run.nav["time_s"].iloc[0] < START_S + 15.0
    assert_honest(run, 0.0)
    assert position_error_m(after(run, 40.0)).max() < 3.0
    assert set(statuses(run, "G", 30.0)) == {"used"}
    clock = run.nav.set_index("time_s")["sd_clock_bias_m"]
    assert clock[: START_S + 29.0].min() > 1000.0 and clock[START_S + 31.0 :].max() < 20.0
    assert ("clock_jump" in set(run.events["kind"])) == (step_m > 0.0)


def test_constellations_whose_clocks_are_swapped_in_flight_are_told_and_survived() -> None:
    """The offset turns its sign at 60 s: no constant offset fits any more, and one constellation must give way."""
    _, log = two_systems()
    t = seconds_of(log.gnss)
    run = replayed(two_clocks(np.where(t < 60.0, 150.0, -150.0)), settings(ionosphere="none"))
    told = set(run.events["kind"]) & {"clock_jump", "reset", "restart", "lockout"}
    refused = set(statuses(run, "E", 60.0)) | set(statuses(run, "G", 60.0))
    assert told or refused & {"gated", "inconsistent", "drifting"}
    assert_honest(run, 0.0)
    assert position_error_m(after(run, SETTLED_S)).max() < 10.0


def test_delay_that_grows_with_the_glonass_channel_is_estimated() -> None:
    """0.8 m per channel over channels of -7 to 6: without the state 5 m are left in single ranges."""
    base, log = two_systems("R")
    channels = dict(zip(("R02", "R10", "R16", "R20", "R31"), (-7, 6, -4, 3, 1), strict=True))
    of_row = np.array([channels.get(name, 0) for name in log.gnss.sv_names])[log.gnss.sv]
    gnss = replace(log.gnss, pseudorange_m=log.gnss.pseudorange_m + 0.8 * of_row, glonass_channels=channels)
    flown = flight(base, log, gnss=gnss)
    with_state, without = (
        replayed(flown, settings(ionosphere="none", glonass_channel_bias=on, variance_scale={}))
        for on in (True, False)
    )
    assert with_state.nav["glonass_bias_m_per_channel"].iloc[-1] == pytest.approx(0.8, abs=0.15)
    assert "glonass_bias_m_per_channel" not in without.nav
    errors = [np.sqrt(np.mean(position_error_m(after(run, 30.0)) ** 2)) for run in (with_state, without)]
    assert errors[0] < 0.8 * errors[1]


# ------------------------------------------------------------------------------------------------ air
