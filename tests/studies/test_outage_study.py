"""The outage study: a branch from a stored filter is the replay of the log without those rows, and costs far less."""

from __future__ import annotations

import copy
import dataclasses
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from insgnss.cli.main import app
from insgnss.config.library import filter_config
from insgnss.errors import ConfigError
from insgnss.runs.replay import replay
from insgnss.simulation.observations import NoiseTerms
from insgnss.status import SWITCHED_OFF, USED
from insgnss.studies.outage.drift import back_after, percentile_table
from insgnss.studies.outage.replays import OutageLog, branch, undisturbed
from insgnss.studies.outage.study import Banked, OutageStudy, Periodic, Random, outage_study
from insgnss.studies.outage.windows import (
    OutageWindow,
    Removal,
    banked_windows,
    periodic_windows,
    random_windows,
    switch_off,
    window_ns,
)
from tests.runs.scenes import START_S, FlightInMemory, flight, turns
from tests.studies.flight_without import flight_without

DURATION_S = 300.0
WINDOW = OutageWindow(START_S + 150.0, START_S + 170.0)
AFTER_S = 40.0
SAMPLE = str(Path(__file__).resolve().parents[2] / "data" / "sample_flight" / "flight.toml")


@cache
def flown(*, carrier: bool = False) -> FlightInMemory:
    base = turns(DURATION_S)
    if carrier:
        noise = NoiseTerms(floor=0.003)
        receiver = dataclasses.replace(base.scenario.receiver, carrier_noise=noise)
        base = copy.copy(base)
        base.scenario = dataclasses.replace(base.scenario, receiver=receiver)
    return flight(base)


@pytest.mark.parametrize(
    "removal",
    [Removal(), Removal(satellites=("G01", "G16", "G30")), Removal(constellations=("G",))],
    ids=["all", "chosen", "constellation"],
)
@pytest.mark.parametrize("carrier", [False, True], ids=["code", "carrier"])
def test_branch_gives_the_bits_of_a_whole_replay_without_the_rows(removal: Removal, carrier: bool) -> None:
    base = flown(carrier=carrier)
    log = OutageLog.of(base, filter_config("tight17"), 1.0)
    _, kept, skipped = undisturbed(log, [WINDOW])
    found = branch(log, kept[0], removal, AFTER_S)
    whole = replay(flight_without(base, WINDOW, removal), output=1.0)
    counts = whole.status_counts()

    assert ("carrier_difference" in counts) == carrier
    assert not carrier or counts.loc["used", "carrier_difference"] > 2000
    whole_nav = whole.nav
    expected = whole_nav[whole_nav["time_s"].isin(found.nav["time_s"])].reset_index(drop=True)
    assert not skipped
    assert len(found.nav) == 61  # both ends of 20 s and of 40 s after
    assert found.n_taken == (60 if removal.satellites else 220)
    pd.testing.assert_frame_equal(found.nav, expected, check_exact=True)
    undone = replay(base, output=1.0).nav
    assert not undone[undone["time_s"].isin(found.nav["time_s"])].reset_index(drop=True).equals(expected)


def test_undisturbed_pass_with_checkpoints_gives_the_bits_of_a_replay() -> None:
    log = OutageLog.of(flown(), filter_config("tight17"), 1.0)
    windows = [OutageWindow(START_S + t, START_S + t + 10.0) for t in (100.0, 105.0, 200.25)]
    nav, kept, _ = undisturbed(log, windows)

    assert len(kept) == 3
    replayed = replay(flown(), output=1.0).nav
    pd.testing.assert_frame_equal(nav, replayed, check_exact=True)


def test_branches_do_not_depend_on_the_number_of_threads() -> None:
    studies = [outage_study(flown(), Periodic(15.0, 25.0), after_s=10.0, threads=n) for n in (1, 3)]

    for name in ("windows", "drift", "percentiles"):
        pd.testing.assert_frame_equal(getattr(studies[0], name), getattr(studies[1], name), check_exact=True)


@cache
def periodic() -> OutageStudy:
    return outage_study(flown(), Periodic(20.0, 20.0), after_s=40.0)


def test_drift_is_nothing_at_the_loss_grows_without_measurements_and_comes_back() -> None:
    p = periodic().percentiles
    drift = p[(p["against"] == "undisturbed") & (p["measure"] == "position_m")].set_index("since_s")["rms"]

    # the row at the loss is before the epoch there, which the undisturbed solution has used
    assert drift[0.0] < 0.3
    assert drift[19.0] > 2.0 * drift[5.0] > 2.5 * drift[0.0]
    assert drift[60.0] < 0.3 * drift[19.0]


def test_picture_carries_the_flight_and_its_time_in_utc() -> None:
    words = [text.get_text() for text in periodic().figure().texts]

    assert any(text.startswith(f"{flown().name}, 20") and text.endswith(" UTC") for text in words)


def test_end_of_a_window_is_before_the_measurements_are_back() -> None:
    study = periodic()
    last = study.drift[study.drift["since_s"] == 19.0]

    assert study.windows["end_m"].tolist() == last["position_m"].tolist()
    assert (study.windows["peak_m"] >= study.windows["end_m"]).all()


def test_predicted_sigma_agrees_with_the_drift_over_the_windows() -> None:
    """Eight windows of three axes each: the root mean square is known to 15 to 20 %, three of those are allowed."""
    study = periodic()
    table = study.at(19.0).set_index("measure")["sd_ratio"]

    assert len(study.windows) == 8
    assert 0.5 < table["position_m"] < 1.6
    assert 0.5 < table["velocity_mps"] < 1.6
    assert study.at(19.0, "reference")["n"].min() >= 7


def test_outage_of_all_costs_more_than_that_of_three_satellites() -> None:
    few = outage_study(flown(), Periodic(20.0, 20.0), Removal(satellites=("G01", "G16", "G30")), after_s=40.0)

    assert (few.windows["sd_end_m"] < 0.5 * periodic().windows["sd_end_m"]).all()
    assert (few.windows["n_taken"] < periodic().windows["n_taken"]).all()


def test_outage_of_range_rates_leaves_the_ranges() -> None:
    """With ranges alone the position holds; the velocity's sigma grows."""
    study = outage_study(flown(), [WINDOW], Removal(kinds=("range_rate",)), after_s=20.0)
    everything = outage_study(flown(), [WINDOW], after_s=20.0)
    end = study.drift[study.drift["since_s"] == 19.0].iloc[0]

    assert end["sd_velocity_mps"] > 0.01
    assert study.windows["sd_end_m"].iloc[0] < 0.7 * everything.windows["sd_end_m"].iloc[0]
    assert "no_measurements" in everything.windows["events"].iloc[0]
    assert study.windows["events"].iloc[0] == ""


def test_window_before_the_start_is_told_and_not_studied() -> None:
    study = outage_study(flown(), [(START_S - 50.0, START_S - 40.0), WINDOW], after_s=5.0)

    assert [w.from_s for w in study.skipped] == [START_S - 50.0]
    assert len(study.windows) == 1
    with pytest.raises(ConfigError, match="in none of the windows"):
        outage_study(flown(), [(START_S - 50.0, START_S - 40.0)])


def test_restarts_cost_far_less_than_whole_replays() -> None:
    """Counted in epochs: eight windows of 60 s and one pass against eight passes of 300 s."""
    study = periodic()
    epochs = len(study.undisturbed) + study.windows["n_rows"].sum()

    assert epochs < 0.35 * len(study.windows) * len(study.undisturbed)


def test_banked_windows_are_where_the_roll_is_beyond_the_angle() -> None:
    study = outage_study(flown(), Banked(30.0), after_s=5.0)
    nav = study.undisturbed
    beyond = nav["roll_deg"].abs() > 30.0
    inside = np.zeros(len(nav), bool)
    for row in study.windows.itertuples():
        inside |= nav["time_s"].between(row.from_s, row.until_s, inclusive="left").to_numpy()

    assert len(study.windows) >= 2
    assert (inside == beyond.to_numpy()).all()
    with pytest.raises(ConfigError, match="never beyond"):
        banked_windows(nav, 80.0)


def test_random_windows_keep_clear_of_each_other_and_repeat_with_their_seed() -> None:
    drawn = [
        random_windows(0.0, 100.0, length_s=9.0, count=10, rng=np.random.default_rng(seed))
        for seed in (1, 1, 2)
    ]

    assert drawn[0] == drawn[1] != drawn[2]
    ends = np.array(drawn[0])
    assert (ends[1:, 0] >= ends[:-1, 1]).all()
    assert ends.min() >= 0.0
    assert ends.max() <= 100.0
    with pytest.raises(ConfigError, match="do not fit"):
        random_windows(0.0, 50.0, length_s=9.0, count=10, rng=np.random.default_rng(1))
    assert len(outage_study(flown(), Random(10.0, 3), after_s=5.0).windows) == 3


def test_periodic_windows_end_before_the_log() -> None:
    assert periodic_windows(10.0, 40.0, length_s=10.0, every_s=10.0) == [
        OutageWindow(10.0, 20.0),
        OutageWindow(20.0, 30.0),
        OutageWindow(30.0, 40.0),
    ]


def test_time_to_come_back_is_that_from_which_it_stays() -> None:
    table = pd.DataFrame(
        {
            "time_s": [10.0, 11.0, 12.0, 13.0],
            "sd_position_m": [3.0, 1.0, 0.2, 0.1],
            "position_m": [2.0, 0.5, 2.0, 0.5],
            "sd_undisturbed_m": [1.0, 1.0, 1.0, 1.0],
        }
    )

    assert back_after(table, 10.0) == (2.0, 3.0)
    assert np.isnan(back_after(table.iloc[:1], 10.0)).all()


def test_percentiles_are_those_over_the_windows() -> None:
    windows = np.arange(1.0, 101.0)
    names = ["horizontal_m", "vertical_m", "position_m", "velocity_mps", "attitude_deg"]
    columns = {name: windows for name in names} | {f"sd_{name}": np.full(100, 10.0) for name in names}
    table = percentile_table({"it": pd.DataFrame({"window": np.arange(100), "since_s": 5.0, **columns})})
    row = table[table["measure"] == "position_m"].iloc[0]

    assert (row["n"], row["p50"], row["max"]) == (100, 50.5, 100.0)
    assert row["sd_ratio"] == pytest.approx(np.sqrt(np.mean(windows**2)) / 10.0)


@pytest.mark.parametrize(
    ("removal", "key"),
    [(Removal(satellites=("G29",)), "satellites"), (Removal(constellations=("R",)), "constellations")],
)
def test_satellite_that_the_log_lacks_is_refused_by_name(removal: Removal, key: str) -> None:
    with pytest.raises(ConfigError) as caught:
        outage_study(flown(), [WINDOW], removal)
    assert caught.value.key == key
    with pytest.raises(ConfigError, match="unknown kind"):
        Removal(kinds=("range",))


def test_switched_off_kind_is_off_within_the_window_alone() -> None:
    log = OutageLog.of(flown(), filter_config("tight17"), 1.0)
    rows = log.rows(slice(None))
    t_ns = np.repeat(rows.epoch_ns, np.diff(rows.first))
    from_ns, until_ns = window_ns(WINDOW, log.week_ns)
    switch_off(rows, ("range_rate",), np.ones(len(t_ns), np.bool_), from_ns, until_ns)
    inside = (t_ns >= from_ns) & (t_ns < until_ns)

    assert np.count_nonzero(inside) == 220
    assert (rows.observation["status"][inside, 1] == SWITCHED_OFF).all()
    assert (rows.observation["status"][~inside, 1] == USED).all()
    assert (rows.observation["status"][:, 0] == USED).all()


def test_command_prints_percentiles_and_writes_tables_and_picture(tmp_path: Path) -> None:
    arguments = ["outage", SAMPLE, "--random", "4", "--length", "20", "-o", str(tmp_path)]
    result = CliRunner().invoke(app, arguments)

    assert result.exit_code == 0, result.output
    assert "4 window(s); removed: all measurements of all satellites" in result.output
    assert len(pd.read_csv(tmp_path / "outage_windows.csv")) == 4
    assert (tmp_path / "outage.png").stat().st_size > 10_000
    assert CliRunner().invoke(app, ["outage", SAMPLE]).exit_code == ConfigError.exit_code


@pytest.mark.parametrize(
    ("way", "unused", "told"),
    [
        (
            ("--window", "293800:293830"),
            ("--length", "5"),
            "--length is not used without --every or --random",
        ),
        (
            ("--bank", "20"),
            ("--length", "5", "--seed", "3"),
            "--length, --seed are not used without --every or",
        ),
        (("--every", "60"), ("--seed", "3"), "--seed is not used without --random"),
    ],
)
def test_options_that_a_way_of_windows_does_not_use_are_refused(
    way: tuple[str, ...], unused: tuple[str, ...], told: str
) -> None:
    result = CliRunner().invoke(app, ["outage", SAMPLE, *way, *unused])

    assert result.exit_code == ConfigError.exit_code
    assert told in " ".join(result.stderr.split())
