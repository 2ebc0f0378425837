"""What a replay hands back: complete, repeatable to the bit, at the times asked for, the same after saving."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import insgnss
from insgnss.config.library import filter_config
from insgnss.errors import ConfigError, ResultError, TimeError
from insgnss.filter.whole_log import output_times
from insgnss.runs.result import TABLES, Run
from insgnss.simulation.faults import outage
from insgnss.simulation.simulated_log import SimulatedLog
from insgnss.version import __version__
from tests.conftest import REPOSITORY
from tests.runs.files import write_flight
from tests.runs.scenes import START_NS, START_S, assert_sound, flight, turns, with_faults

DURATION_S = 60.0


@pytest.fixture(scope="module")
def log() -> SimulatedLog:
    return turns(DURATION_S).draw(np.random.default_rng(1))


@pytest.fixture(scope="module")
def run(log: SimulatedLog) -> Run:
    return insgnss.replay(flight(turns(DURATION_S), log))


@pytest.fixture(scope="module")
def flight_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a flight of files whose GNSS log has empty cells of either kind."""
    path = write_flight(tmp_path_factory.mktemp("flight"), turns(DURATION_S))
    csv = path.parent / "gnss.csv"
    table = pd.read_csv(csv, dtype=str)
    table.loc[100:104, "pseudorange_m"] = ""
    table.loc[103:109, "doppler_hz"] = ""
    table.to_csv(csv, index=False)
    return path


@pytest.fixture(scope="module")
def filed(flight_path: Path) -> Run:
    return insgnss.replay(flight_path)


def same_bits(a: Run, b: Run) -> bool:
    """Return whether every number of the solution and the ledger has the same bits."""
    numbers = ["time_s", "innovation", "sd_innovation", "nis"]
    return (
        a.nav.to_numpy().tobytes() == b.nav.to_numpy().tobytes()
        and a.measurements[numbers].to_numpy().tobytes() == b.measurements[numbers].to_numpy().tobytes()
        and a.measurements["status"].astype(str).equals(b.measurements["status"].astype(str))
        and a.events.equals(b.events)
    )


# ------------------------------------------------------------------------------------------------ ledger


def test_ledger_counts_each_filled_cell_of_the_file_once(filed: Run, flight_path: Path) -> None:
    cells = pd.read_csv(flight_path.parent / "gnss.csv")
    counts = filed.measurements.groupby("kind", observed=True).size()
    assert counts["pseudorange"] == cells["pseudorange_m"].notna().sum() == len(cells) - 5
    assert counts["range_rate"] == cells["doppler_hz"].notna().sum() == len(cells) - 7
    assert filed.status_counts().sum().to_dict() == counts.to_dict()


def test_used_counts_of_the_solution_are_those_of_the_ledger(run: Run) -> None:
    used = run.measurements[run.measurements["status"].isin(["used", "used_for_start"])]
    ranges = used[used["kind"] == "pseudorange"].groupby("time_s").size()
    by_epoch = run.nav.set_index("time_s")["n_used"]
    assert by_epoch.equals(ranges.reindex(by_epoch.index, fill_value=0).rename("n_used"))


def test_smoothed_run_keeps_the_rows_that_the_filter_had() -> None:
    """To the bit: the way back must not touch what it is compared with."""
    flown = flight(turns(60.0))
    forward, smoothed = insgnss.replay(flown), insgnss.replay(flown, smooth=True)

    assert forward.filtered is None and smoothed.filtered is not None
    kept = forward.nav[smoothed.filtered.columns]
    pd.testing.assert_frame_equal(smoothed.filtered, kept, check_exact=True)
    assert not smoothed.nav["lat_deg"].equals(kept["lat_deg"])


def test_satellites_have_the_cn0_of_the_log(run: Run) -> None:
    assert run.satellites["cn0_dbhz"].between(30.0, 60.0).all()


def test_ledger_of_innovations_agrees_with_itself(run: Run) -> None:
    used = run.measurements[run.measurements["status"] == "used"]
    assert len(used) > 1000
    np.testing.assert_allclose(used["nis"], (used["innovation"] / used["sd_innovation"]) ** 2, rtol=1e-12)
    summary = run.nis_summary(from_s=-np.inf)
    assert summary["used"].sum() == len(used)
    assert summary.loc["range_rate", "mean_nis"] == pytest.approx(
        used.loc[used["kind"] == "range_rate", "nis"].mean(), rel=1e-12
    )


# ------------------------------------------------------------------------------------------------ saving


def assert_same_tables(a: Run, b: Run) -> None:
    for name in TABLES:
        one, two = getattr(a, name), getattr(b, name)
        assert (one is None) == (two is None), name
        if one is None:
            continue
        pd.testing.assert_frame_equal(one, two, check_exact=True)


@pytest.mark.parametrize("form", ["parquet", "csv"])
def test_saved_run_is_loaded_as_it_was(filed: Run, tmp_path: Path, form: str) -> None:
    loaded = Run.load(filed.save(tmp_path / "run", form))  # type: ignore[arg-type]
    assert_same_tables(filed, loaded)
    assert loaded.settings["filter"] == filed.settings["filter"]
    assert loaded.error_summary().equals(filed.error_summary())
    assert loaded.nis_summary().to_numpy().tolist() == filed.nis_summary().to_numpy().tolist()
    assert loaded.status_counts().to_dict() == filed.status_counts().to_dict()


@pytest.mark.parametrize("form", ["parquet", "csv"])
def test_run_without_events_or_reference_is_loaded_as_it_was(run: Run, tmp_path: Path, form: str) -> None:
    bare = replace(run, errors=None, events=run.events.iloc[:0])
    assert_same_tables(bare, Run.load(bare.save(tmp_path, form)))  # type: ignore[arg-type]


def test_saving_again_in_the_other_form_leaves_nothing_behind(run: Run, tmp_path: Path) -> None:
    run.save(tmp_path, "csv")
    run.save(tmp_path, "parquet")
    assert sorted(p.name for p in tmp_path.glob("[!.]*")) == sorted(
        [*(f"{t}.parquet" for t in TABLES if getattr(run, t) is not None), "settings.json"]
    )


def test_folder_that_cannot_be_written_or_holds_no_run_is_a_typed_error(run: Run, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(ResultError, match="cannot be written"):
        run.save(tmp_path / "file")
    with pytest.raises(ResultError, match="no table"):
        Run.load(tmp_path)
    run.save(tmp_path / "run")
    (tmp_path / "run" / "settings.json").unlink()
    with pytest.raises(ResultError, match="settings"):
        Run.load(tmp_path / "run")
    run.save(tmp_path / "run", "csv")
    (tmp_path / "run" / "columns.json").write_text("{}", encoding="utf-8")
    with pytest.raises(ResultError, match=r"columns\.json"):
        Run.load(tmp_path / "run")


def test_csv_tables_without_their_types_are_loaded_with_the_same_values(run: Run, tmp_path: Path) -> None:
    (run.save(tmp_path, "csv") / "columns.json").unlink()

    loaded = Run.load(tmp_path)

    pd.testing.assert_frame_equal(loaded.nav, run.nav, check_exact=True, check_dtype=False)
    assert loaded.nis_summary().to_dict() == run.nis_summary().to_dict()
    assert loaded.status_counts().to_dict() == run.status_counts().to_dict()


def test_settings_hold_all_that_is_needed_to_repeat_the_run(
    filed: Run, flight_path: Path, tmp_path: Path
) -> None:
    settings = json.loads((filed.save(tmp_path) / "settings.json").read_text())
    assert settings["filter"] == filter_config("tight17").model_dump(mode="json")
    assert settings["versions"]["insgnss"] == __version__ and settings["versions"]["numpy"] == np.__version__
    for name in ("flight.toml", "imu.csv", "gnss.csv", "nav.rnx", "reference.csv"):
        path = flight_path.parent / name
        assert settings["input_sha256"][str(path)] == hashlib.sha256(path.read_bytes()).hexdigest()
    assert settings["flight"]["gnss"]["lever_arm_m"] == [0.8, 0.0, -1.1]
    assert settings["output"] == "gnss" and settings["clock_groups"] == ["G"]


# ------------------------------------------------------------------------------------------------ repetition


def test_same_input_gives_the_same_bits_and_runs_share_no_state(run: Run, log: SimulatedLog) -> None:
    other = with_faults(turns(DURATION_S), [outage(None, 20.0, 40.0)])
    insgnss.replay(flight(other, seed=9))
    assert same_bits(insgnss.replay(flight(turns(DURATION_S), log)), run)


def test_another_process_gives_the_same_bits(filed: Run, flight_path: Path, tmp_path: Path) -> None:
    code = "import sys, insgnss; insgnss.replay(sys.argv[1]).save(sys.argv[2])"
    subprocess.run([sys.executable, "-c", code, flight_path, tmp_path], check=True, cwd=REPOSITORY)
    assert same_bits(Run.load(tmp_path), filed)


def test_order_of_rows_inside_an_epoch_matters_by_rounding_only(run: Run, log: SimulatedLog) -> None:
    rng = np.random.default_rng(5)
    order = np.lexsort((rng.random(len(log.gnss.t_ns)), log.gnss.t_ns))
    shuffled = insgnss.replay(flight(turns(DURATION_S), log, gnss=log.gnss.take(order)))
    # 1e-13 of an ECEF coordinate is 1e-6 m, as much as 60 s of sums of that size can lose
    moved = (shuffled.nav - run.nav).abs().max()
    assert moved[["lat_deg", "lon_deg"]].max() * 111e3 < 1e-6 and moved["h_m"] < 1e-6
    assert (
        moved.filter(regex="mps$").max() < 1e-7 and moved.filter(regex="(roll|pitch|yaw)_deg$").max() < 1e-6
    )
    assert shuffled.status_counts().to_dict() == run.status_counts().to_dict()
    assert list(shuffled.events["kind"]) == list(run.events["kind"])


# ------------------------------------------------------------------------------------------------ output times

STATES = (
    "lat_deg", "lon_deg", "h_m", "vn_mps", "ve_mps", "vd_mps", "roll_deg", "pitch_deg", "yaw_deg",
    "sd_n_m", "sd_vd_mps", "sd_yaw_deg", "accel_bias_x_mps2", "gyro_bias_z_radps", "clock_bias_m", "n_used",
)  # fmt: skip


@pytest.mark.parametrize(
    ("output", "period_s"), [("imu", 0.01), (100.0, 0.01), (20.0, 0.05), (10.0, 0.1), (1.0 / 0.3, 0.3)]
)
def test_output_at_other_times_leaves_the_filter_as_it_is(
    run: Run, log: SimulatedLog, output: float, period_s: float
) -> None:
    """A row at each whole multiple of the period; where a GNSS epoch stands, its very bits."""
    flown = flight(turns(DURATION_S), log)
    dense = insgnss.replay(flown, output=output)
    assert_sound(dense, flown)
    ticks = np.round(dense.nav["time_s"] / period_s).astype(np.int64)
    np.testing.assert_allclose(dense.nav["time_s"], ticks * period_s, rtol=0.0, atol=2e-9)
    # from the start of the filter to the end of the inertial log, none missing
    assert np.all(np.diff(ticks) == 1)
    assert dense.nav["time_s"].iloc[0] - run.nav["time_s"].iloc[0] < period_s
    assert START_S + DURATION_S - dense.nav["time_s"].iloc[-1] < period_s
    common = np.intersect1d(dense.nav["time_s"], run.nav["time_s"])
    assert len(common) == (len(run.nav) if output != 1.0 / 0.3 else 20)
    at = {name: r.nav.set_index("time_s").loc[common, list(STATES)] for name, r in (("a", dense), ("b", run))}
    assert at["a"].to_numpy().tobytes() == at["b"].to_numpy().tobytes()
    assert dense.measurements["innovation"].equals(run.measurements["innovation"])
    assert dense.events.equals(run.events)


def test_rows_between_epochs_follow_the_truth(log: SimulatedLog) -> None:
    dense = insgnss.replay(flight(turns(DURATION_S), log), output="imu")
    assert dense.errors is not None
    late = dense.errors[dense.errors["time_s"] > START_S + 20.0]
    scaled = late["d_n_m"].abs() / late["sd_n_m"]
    assert len(late) == 4000 and scaled.max() < 5.0
    # nothing jumps between samples but at the epochs: 100 m/s are 1 m in 10 ms
    between = np.abs(np.diff(late["d_e_m"]))
    assert np.quantile(between, 0.98) < 1e-2


@pytest.mark.parametrize(
    "output", [0.0, -1.0, np.nan, np.inf, -np.inf, 1e12, 1e300, 1e-300, 0.01, 1001.0, "often", None]
)
def test_impossible_output_rate_is_a_typed_error_with_the_bounds(log: SimulatedLog, output: float) -> None:
    with pytest.raises(ConfigError, match=r"invalid output rate .* for inertial samples at 100 Hz") as caught:
        insgnss.replay(flight(turns(DURATION_S), log), output=output)
    assert caught.value.key == "output"
    assert caught.value.advice == "give 'gnss', 'imu' or a number of Hz, as output=10, from 0.0166694 to 1000"


def test_output_rate_may_be_one_in_the_log_and_ten_in_a_sample() -> None:
    t_ns = np.arange(1001, dtype=np.int64) * 10_000_000 + 5_000_000
    assert np.array_equal(output_times(t_ns, 1000.0), np.arange(5, 10006) * 1_000_000)
    assert output_times(t_ns, 0.1).tolist() == [10_000_000_000]


@pytest.mark.parametrize("output", ["gnss", "imu", 1.0])
def test_samples_that_run_backwards_are_an_error_that_says_so(output: str | float) -> None:
    t_ns = np.arange(1001, dtype=np.int64) * 10_000_000
    with pytest.raises(TimeError, match=r"inertial time tags run backwards, by 10 s from first to last"):
        output_times(t_ns[::-1], output)


# ------------------------------------------------------------------------------------------------ sigma


def test_sigma_falls_with_measurements_and_grows_without(log: SimulatedLog) -> None:
    hidden = flight(with_faults(turns(DURATION_S), [outage(None, 30.5, 55.5)]), seed=1)
    nav = insgnss.replay(hidden, output=10.0).nav
    nav = nav.set_index((nav["time_s"] - START_S).round(1))
    for name in ("sd_n_m", "sd_e_m", "sd_d_m"):
        assert nav.loc[30.0, name] < 0.5 * nav.loc[2.0, name]
        assert np.all(np.diff(nav.loc[31.1:55.4, name]) > 0.0)
        assert nav.loc[58.0, name] < 0.5 * nav.loc[55.4, name]
    assert nav.loc[30.0, "sd_yaw_deg"] < 0.01 * nav.loc[2.0, "sd_yaw_deg"]
    # the clock's variance grows as its random walk does, by the measure of a TCXO some metres in 25 s
    assert nav.loc[55.4, "sd_clock_bias_m"] > nav.loc[30.0, "sd_clock_bias_m"] + 1.0


def test_missing_angle_of_the_reference_costs_its_own_rows_alone(log: SimulatedLog) -> None:
    flown = flight(turns(), log)
    assert flown.logs.reference is not None
    rpy = flown.logs.reference.rpy_deg.copy()
    hole = int(np.searchsorted(flown.logs.reference.t_ns, START_NS + 60 * 10**9))
    rpy[hole - 1 : hole + 2, 2] = np.nan
    reference = replace(flown.logs.reference, rpy_deg=rpy)
    run = insgnss.replay(replace(flown, logs=replace(flown.logs, reference=reference)))
    whole = insgnss.replay(flown)

    assert run.errors is not None and whole.errors is not None
    missing = run.errors["d_yaw_deg"].isna()
    assert 0 < missing.sum() <= 2
    assert np.allclose(run.errors["d_yaw_deg"][~missing], whole.errors["d_yaw_deg"][~missing], atol=1e-9)
