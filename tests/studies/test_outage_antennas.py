"""The outage study with several antennas: their rows are absent too, and a branch is still the replay without them."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pandas as pd
import pytest

from insgnss.config.library import filter_config
from insgnss.errors import ConfigError, InputError
from insgnss.log.flight import Flight, FlightInMemory
from insgnss.runs.replay import replay
from insgnss.studies.outage.replays import OutageLog, branch, undisturbed
from insgnss.studies.outage.study import OutageStudy, outage_study
from insgnss.studies.outage.windows import OutageWindow, Removal
from tests.attitude.several_flights import AT_REST, SLALOM, scenario_text, write_flight
from tests.studies.flight_without import flight_without

START_S = 150_000.0
WINDOW = OutageWindow(START_S + 25.0, START_S + 40.0)
AFTER_S = 15.0
TWO = ("G01", "G12")


def in_memory(folder: Path, text: str) -> FlightInMemory:
    """Return a drawn flight with its logs; one antenna's tags are 200 ns (0.2 mm of phase) before the main one's."""
    flight = Flight.load(write_flight(folder, text))
    logs = flight.read()
    ahead, right = logs.further
    early = dataclasses.replace(ahead, t_ns=ahead.t_ns - 200)
    logs = dataclasses.replace(logs, further=(early, right))
    return FlightInMemory(flight.path, flight.config, flight.imu_grade, flight.oscillator, logs)


@pytest.fixture(scope="module")
def moving(tmp_path_factory: pytest.TempPathFactory) -> FlightInMemory:
    """A minute of turns with receivers that have clocks of their own."""
    text = scenario_text(clocks="separate", clock_bias_m=60_000.0, manoeuvres=SLALOM, speed_mps=60.0)
    return in_memory(tmp_path_factory.mktemp("moving"), text)


@pytest.fixture(scope="module")
def at_rest(tmp_path_factory: pytest.TempPathFactory) -> FlightInMemory:
    """A minute at rest, where only the antennas tell the heading."""
    text = scenario_text(manoeuvres=AT_REST.format(duration=60.0))
    return in_memory(tmp_path_factory.mktemp("rest"), text)


def nav_of(flight: FlightInMemory) -> pd.DataFrame:
    """Return a replay's navigation rows at 1 Hz."""
    return replay(flight, output=1.0).nav


@pytest.mark.parametrize("removal", [Removal(), Removal(satellites=TWO)], ids=["all", "two satellites"])
def test_branch_gives_the_bits_of_a_replay_without_any_antennas_rows(
    moving: FlightInMemory, removal: Removal
) -> None:
    log = OutageLog.of(moving, filter_config("tight"), 1.0)
    nav, kept, _ = undisturbed(log, [WINDOW])
    found = branch(log, kept[0], removal, AFTER_S)

    pd.testing.assert_frame_equal(nav, nav_of(moving), check_exact=True)
    whole = nav_of(flight_without(moving, WINDOW, removal))
    expected = whole[whole["time_s"].isin(found.nav["time_s"])].reset_index(drop=True)
    pd.testing.assert_frame_equal(found.nav, expected, check_exact=True)
    assert len(found.nav) == 31
    assert nav["sd_yaw_deg"].iloc[-1] < 0.03  # by the differences
    left = flight_without(moving, WINDOW, removal).read()
    taken = [len(a.t_ns) - len(b.t_ns) for a, b in zip(moving.logs.further, left.further, strict=True)]
    assert taken == [15 * (2 if removal.satellites else 11)] * 2
    last_ns = log.week_ns + round(WINDOW.until_s * 1e9) - 200  # of a main epoch after the window
    assert (left.further[0].t_ns == last_ns).any()
    assert found.n_taken == len(moving.logs.gnss.t_ns) - len(left.gnss.t_ns) + sum(taken)


def at_end(study: OutageStudy, column: str) -> float:
    """Return a drift's sigma at the last second of the window."""
    return float(study.drift.loc[study.drift["since_s"] == 14.0, column].iloc[0])


def test_outage_of_the_differences_alone_costs_heading_and_no_position(at_rest: FlightInMemory) -> None:
    differences = Removal(kinds=("attitude_difference",))
    alone = outage_study(at_rest, [WINDOW], differences, after_s=AFTER_S)
    everything = outage_study(at_rest, [WINDOW], after_s=AFTER_S)

    # the gyros' random walk of 0.3 deg/sqrt(h) and their bias over 15 s: some hundredths of a degree
    assert 0.01 < at_end(alone, "sd_attitude_deg") < 0.2
    assert at_end(alone, "sd_position_m") < 0.02
    assert at_end(everything, "sd_position_m") > 0.5
    assert at_end(everything, "sd_attitude_deg") > at_end(alone, "sd_attitude_deg")
    assert alone.windows["n_taken"].iloc[0] == 15 * 2 * 11
    # the cycles of a phase that was away are searched again
    assert alone.windows["events"].iloc[0] == everything.windows["events"].iloc[0].split(", ")[-1]


def test_outage_of_ranges_leaves_the_differences(at_rest: FlightInMemory) -> None:
    study = outage_study(at_rest, [WINDOW], Removal(kinds=("pseudorange", "range_rate")), after_s=AFTER_S)

    assert at_end(study, "sd_attitude_deg") < 0.01
    assert at_end(study, "sd_position_m") > 0.3
    assert study.windows["n_taken"].iloc[0] == 15 * 11


def test_kinds_that_are_none_are_refused_by_name_and_logs_of_other_epochs_too(
    at_rest: FlightInMemory,
) -> None:
    with pytest.raises(ConfigError, match="attitude_difference"):
        Removal(kinds=("heading",))
    apart = tuple(dataclasses.replace(t, t_ns=t.t_ns + 500_000_000) for t in at_rest.logs.further)
    other = dataclasses.replace(at_rest, logs=dataclasses.replace(at_rest.logs, further=apart))
    with pytest.raises(InputError, match="no epoch of antenna 'ahead'"):
        outage_study(other, [WINDOW])
