"""Campaigns: the same bits on any number of workers, survives killed workers and a killed client, sums up exactly."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from distributed import LocalCluster
from typer.testing import CliRunner

from insgnss.cli.main import app
from insgnss.config.library import find
from insgnss.errors import ConfigError, ResultError
from insgnss.studies.campaign import task_runners
from insgnss.studies.campaign.columns import COLUMNS
from insgnss.studies.campaign.results import Sums, data_set, failures, summary
from insgnss.studies.campaign.study import CampaignConfig, load_campaign, prepare, run_campaign, tasks_of
from insgnss.studies.campaign.tasks import KEY_COLUMNS, RESULTS
from tests.small_run import small_run

ROOT = Path(__file__).resolve().parents[2]
SLEEPY = "tests.studies.sleepy_case:sleepy"


def campaign(seeds: int = 6, **fixed: float | str) -> CampaignConfig:
    return CampaignConfig(
        name="test", case=SLEEPY, seeds=seeds, seeds_per_task=2, fixed=fixed, grid={"salt": (1, 2)}
    )


def files(folder: Path) -> dict[str, bytes]:
    """Return the results, byte for byte, by their names."""
    return {path.name: path.read_bytes() for path in sorted((folder / RESULTS).iterdir())}


def table(folder: Path) -> pd.DataFrame:
    return data_set(folder).to_table().to_pandas()


def own_columns(results: pd.DataFrame) -> set[str]:
    """Return the columns of the rows that a case function returned."""
    return {name for name in results.columns if name not in KEY_COLUMNS and not str(name).startswith("case_")}


def test_campaign_in_this_process_gives_a_row_for_each_case_seed_and_row_of_the_case(tmp_path: Path) -> None:
    done = run_campaign(campaign(), tmp_path, workers=0)
    found = table(tmp_path)

    assert (done.n_tasks, done.n_runs, done.n_failed, done.lost) == (6, 12, 0, ())
    assert len(found) == 24
    assert set(zip(found["case"], found["case_salt"], strict=True)) == {(0, 1), (1, 2)}
    row = found[(found["case_salt"] == 2) & (found["seed"] == 5) & (found["k"] == 0)]
    assert row["value"].item() == np.random.default_rng([5, 2]).standard_normal()


def test_failing_run_is_recorded_and_the_others_go_on(tmp_path: Path) -> None:
    done = run_campaign(campaign(fails_at=3), tmp_path, workers=0)
    failed = failures(tmp_path)

    assert (done.n_runs, done.n_failed) == (12, 2)
    assert list(failed["seed"]) == [3, 3]
    assert failed["error"].iloc[0] == "ValueError: seed 3 is told to fail"
    assert summary(tmp_path, columns=["value"])["n"].tolist() == [10, 10]
    assert run_campaign(campaign(fails_at=3), tmp_path, workers=0).n_found == 6
    again = run_campaign(campaign(fails_at=3), tmp_path, workers=0, retry_failed=True)
    assert (again.n_found, again.n_runs) == (4, 4)


def test_only_tasks_without_a_whole_file_are_done_again(tmp_path: Path) -> None:
    run_campaign(campaign(), tmp_path, workers=0)
    before = files(tmp_path)
    gone = sorted((tmp_path / RESULTS).iterdir())[2]
    gone.rename(gone.with_name(f".{gone.name}.123"))  # as a worker leaves it that was killed while it wrote
    _, left = prepare(campaign(), tmp_path)
    done = run_campaign(campaign(), tmp_path, workers=0)

    assert [f"{task.key}.parquet" for task in left] == [gone.name]
    assert (done.n_found, done.n_runs) == (5, 2)
    assert {name: data for name, data in files(tmp_path).items() if name[0] != "."} == before


def test_folder_of_another_campaign_is_refused(tmp_path: Path) -> None:
    run_campaign(campaign(), tmp_path, workers=0)
    with pytest.raises(ResultError, match="another campaign"):
        run_campaign(campaign(seeds=7), tmp_path, workers=0)


@pytest.mark.parametrize("by", ["wrong", "case,wrong", "case,case", ","])
def test_wrong_column_is_refused_before_the_runs(tmp_path: Path, by: str) -> None:
    out = tmp_path / "out"

    told = CliRunner().invoke(app, ["campaign", "imu_grades", "-o", str(out), "--workers", "0", "--by", by])

    assert told.exit_code == 2 and "option '--by'" in told.stderr
    assert not out.exists()


def test_wrong_column_of_an_own_case_function_is_refused_after_its_first_task(tmp_path: Path) -> None:
    file, out = tmp_path / "own.toml", tmp_path / "out"
    file.write_text(f'name = "own"\ncase = "{SLEEPY}"\nseeds = 6\nseeds_per_task = 2\n')
    arguments = ["campaign", str(file), "-o", str(out), "--workers", "0", "--by"]

    told = CliRunner().invoke(app, [*arguments, "wrong"])
    assert told.exit_code == 2 and "option '--by'" in told.stderr and "value" in told.stderr
    assert len(files(out)) == 1

    told = CliRunner().invoke(app, [*arguments, "k"])
    assert told.exit_code == 0 and len(files(out)) == 3


def test_campaign_takes_no_folder_of_another_result(tmp_path: Path) -> None:
    run = small_run().save(tmp_path / "run")
    (tmp_path / "mine" / RESULTS).mkdir(parents=True)
    (tmp_path / "mine" / RESULTS / "notes.txt").write_text("mine")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}

    for folder in (run, tmp_path / "mine"):
        told = CliRunner().invoke(app, ["campaign", "imu_grades", "-o", str(folder), "--workers", "0"])
        assert told.exit_code == 5 and "--output" in told.stderr
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def command(file: Path, out: Path, workers: int) -> subprocess.Popen[bytes]:
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    arguments = ["campaign", str(file), "-o", str(out), "--workers", str(workers)]
    return subprocess.Popen(
        [sys.executable, "-m", "insgnss.cli", *arguments],
        env={**os.environ, "PYTHONPATH": path},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=ROOT,
    )


def wait_for(what: str, reached: object, seconds: float = 60.0) -> None:
    """Wait until a call gives something true."""
    end = time.monotonic() + seconds
    while not reached():  # type: ignore[operator]
        assert time.monotonic() < end, f"waited in vain for {what}"
        time.sleep(0.02)


@pytest.mark.slow
def test_killed_worker_and_killed_client_cost_nothing_but_time(tmp_path: Path) -> None:
    pids, out, serial = tmp_path / "pids", tmp_path / "out", tmp_path / "serial"
    pids.mkdir()
    config = campaign(seeds=30, sleep_s=0.04, pids=str(pids))
    file = tmp_path / "campaign.toml"
    file.write_text(
        f'name = "test"\ncase = "{SLEEPY}"\nseeds = 30\nseeds_per_task = 2\n'
        f'[fixed]\nsleep_s = 0.04\npids = "{pids}"\n[grid]\nsalt = [1, 2]\n',
        encoding="utf-8",
    )
    finished = lambda: len(list((out / RESULTS).glob("case-*.parquet"))) if out.exists() else 0  # noqa: E731
    client = command(file, out, 2)
    wait_for("two workers", lambda: len(list(pids.iterdir())) >= 2 and finished() >= 3)
    os.kill(int(next(pids.iterdir()).name), signal.SIGKILL)
    at_kill = finished()
    wait_for("results after the kill of a worker", lambda: finished() >= at_kill + 4)
    client.kill()
    client.communicate()
    found = finished()
    assert 3 <= found < 30, "the client was to be killed midway"
    # the rest in this process: new workers would load the package once more
    again = CliRunner().invoke(app, ["campaign", str(file), "-o", str(out), "--workers", "0"])

    assert again.exit_code == 0, again.output
    # a worker may have ended its task after the count
    told = re.search(r"(\d+) of 30 tasks were there", again.output)
    assert told and found <= int(told[1]) < 30
    run_campaign(config, serial, workers=0)
    assert {n: d for n, d in files(out).items() if n[0] != "."} == files(serial)


def test_running_cluster_gives_the_bytes_of_one_process(tmp_path: Path) -> None:
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=False, dashboard_address=None) as local:
        done = run_campaign(campaign(fails_at=3), tmp_path / "two", scheduler=local.scheduler_address)
    run_campaign(campaign(fails_at=3), tmp_path / "one", workers=0)

    assert (done.n_runs, done.n_failed, done.lost) == (12, 2, ())
    assert files(tmp_path / "two") == files(tmp_path / "one")


@pytest.mark.slow
def test_without_dask_processes_of_this_machine_give_the_bytes_of_one_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(task_runners, "is_installed", lambda: False)
    done = run_campaign(campaign(fails_at=3), tmp_path / "two", workers=2)
    run_campaign(campaign(fails_at=3), tmp_path / "one", workers=0)

    assert (done.n_runs, done.n_failed, done.lost) == (12, 2, ())
    assert files(tmp_path / "two") == files(tmp_path / "one")


@pytest.mark.slow
def test_without_dask_a_task_that_kills_its_process_is_lost_and_no_other_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first task dies while the second waits in the same process."""
    monkeypatch.setattr(task_runners, "is_installed", lambda: False)
    config = campaign(seeds=4, dies_at=1).model_copy(update={"grid": {"salt": (1,)}})
    done = run_campaign(config, tmp_path, workers=1)

    first, second = tasks_of(config, tmp_path)
    assert done.lost == (first.key,)
    assert done.n_runs == len(second.seeds) == 2
    assert list(files(tmp_path)) == [second.path.name]


def test_scheduler_without_dask_is_an_error_that_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ResultError, match=r"insgnss\[campaign\]"):
        run_campaign(campaign(), tmp_path, scheduler="tcp://127.0.0.1:9")


def test_scheduler_that_does_not_answer_is_an_error_with_advice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(task_runners, "PATIENCE_S", 0.5)
    with pytest.raises(ResultError, match="no scheduler answers"):
        run_campaign(campaign(), tmp_path, scheduler="tcp://127.0.0.1:9")


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ('name = "x"\ncase = "nothing"\nseeds = 1\n', "case"),
        ('name = "x"\ncase = "no.module:f"\nseeds = 1\n', "case"),
        ('name = "x"\ncase = "matched"\nseeds = 0\n', "seeds"),
        ('name = "x"\ncase = "matched"\nseeds = 1\nsede = 2\n', "sede"),
        ('name = "x"\ncase = "matched"\nseeds = 1\n[fixed]\nimu = "a"\n[grid]\nimu = ["b"]\n', "imu"),
        ('name = "x"\ncase = "matched"\nseeds = 1\n[grid]\nimu = []\n', "grid"),
    ],
)
def test_mistake_in_a_campaign_file_is_named(tmp_path: Path, text: str, key: str) -> None:
    file = tmp_path / "campaign.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        load_campaign(file)
    assert key in str(caught.value.key)


def test_sums_of_pieces_are_those_of_the_whole() -> None:
    values = np.random.default_rng(1).normal(5.0, 300.0, 10_000)
    sums = Sums()
    for part in np.array_split(values, 17):
        sums.add(np.append(part, np.nan))
    row = sums.row()

    assert row["n"] == 10_000
    assert row["mean"] == pytest.approx(values.mean(), rel=1e-9)
    assert row["sd"] == pytest.approx(values.std(ddof=1), rel=1e-9)
    assert row["rms"] == pytest.approx(np.sqrt(np.mean(values**2)), rel=1e-9)
    for p in (5, 95):
        assert row[f"p{p:02d}"] == pytest.approx(np.quantile(values, p / 100.0), rel=0.011)


def test_summary_groups_by_columns_and_refuses_unknown_ones(tmp_path: Path) -> None:
    run_campaign(campaign(), tmp_path, workers=0)
    whole = table(tmp_path)
    found = summary(tmp_path, ["case_salt", "k"], ["value"]).set_index(["case_salt", "k"])

    expected = whole.groupby(["case_salt", "k"])["value"].mean()
    assert found["mean"].to_dict() == pytest.approx(expected.to_dict())
    with pytest.raises(ConfigError, match="no column 'wrong'"):
        summary(tmp_path, columns=["wrong"])


def test_matched_flights_give_a_row_for_each_epoch_looked_at(tmp_path: Path) -> None:
    """That two workers give the bytes of one process is asserted in ``notebooks/11_campaign_on_dask.py``."""
    config = CampaignConfig(
        name="grades",
        case="matched",
        seeds=4,
        seeds_per_task=2,
        fixed={"duration_s": 40.0},
        grid={"imu": ("tactical", "industrial")},
    )
    run_campaign(config, tmp_path, workers=0)

    found = table(tmp_path)
    assert len(found) == 2 * 4 * 6
    assert (found["nees_whole"] > 1.0).all()
    assert set(COLUMNS["matched"]) == own_columns(found)


def test_outage_of_a_worse_imu_drifts_more(tmp_path: Path) -> None:
    """Windows of 30 s in two flights: the industrial grade's sigma is several times the navigation one's."""
    config = CampaignConfig(
        name="outages", case="outage", seeds=2, grid={"imu": ("navigation", "industrial")}
    )
    run_campaign(config, tmp_path, workers=0)
    found = table(tmp_path)
    assert failures(tmp_path).empty
    assert set(COLUMNS["outage"]) == own_columns(found)
    rms = found.groupby("case_imu")[["end_m", "sd_end_m", "error_end_m"]].agg(
        lambda e: np.sqrt(np.mean(e**2))
    )

    assert rms.loc["industrial", "sd_end_m"] > 2.0 * rms.loc["navigation", "sd_end_m"]
    assert rms.loc["industrial", "end_m"] > 1.5 * rms.loc["navigation", "end_m"]
    ratio = rms["end_m"] / rms["sd_end_m"]
    assert ratio.between(0.5, 1.7).all()


def test_command_prints_a_summary_of_the_masking_study(tmp_path: Path) -> None:
    text = find("scenarios", "sokolov_2015").read_text(encoding="utf-8")
    short = tmp_path / "short.toml"  # the last satellite is back by then
    short.write_text(
        re.sub(r"^duration_s = 240\.0", "duration_s = 110.0", text, flags=re.MULTILINE), encoding="utf-8"
    )
    file = tmp_path / "campaign.toml"
    file.write_text(
        f'name = "m"\ncase = "masking"\nseeds = 1\n[fixed]\nscenario = "{short}"\n', encoding="utf-8"
    )
    arguments = ["campaign", str(file), "-o", str(tmp_path / "out"), "--workers", "0", "--by", "way"]
    result = CliRunner().invoke(app, arguments)

    assert result.exit_code == 0, result.output
    found = table(tmp_path / "out")
    assert list(found["way"]) == ["a", "b", "c", "d"]
    assert set(COLUMNS["masking"]) == own_columns(found)
    assert "rms_during_m" in result.output


def test_results_stay_readable_where_a_task_failed_whole(tmp_path: Path) -> None:
    run_campaign(campaign(seeds=2, fails_at=0), tmp_path, workers=0)
    part = sorted((tmp_path / RESULTS).iterdir())[0]
    pq.write_table(pa.table({"case": [0], "seed": [0], "error": ["all lost"]}), part)

    assert len(failures(tmp_path)) == 2
    assert summary(tmp_path, columns=["value"])["n"].tolist() == [2]
