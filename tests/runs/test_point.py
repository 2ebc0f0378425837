"""The point solution of a flight, from its files to its tables and the command."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pymap3d
import pytest
import typer
from scipy import stats
from typer.testing import CliRunner

from insgnss.cli.command import OwnCommand
from insgnss.cli.point import point as point_command
from insgnss.config.library import filter_config
from insgnss.errors import ConfigError, ResultError
from insgnss.gnss.point import integrity
from insgnss.runs.point import TABLES, PointRun, point, solve_rows
from insgnss.runs.setup import setup_filter
from insgnss.simulation.simulated_log import SimulatedLog
from insgnss.status import INCONSISTENT, USED
from insgnss.tables import GnssTable
from tests.runs.files import write_flight
from tests.runs.scenes import flight, turns

DURATION_S = 60.0
APP = typer.Typer()
APP.command(cls=OwnCommand)(point_command)


@pytest.fixture(scope="module")
def log() -> SimulatedLog:
    return turns(DURATION_S).draw(np.random.default_rng(1))


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_flight(tmp_path_factory.mktemp("flight"), turns(DURATION_S))


@pytest.fixture(scope="module")
def run(path: Path) -> PointRun:
    return point(path)


def test_every_epoch_is_solved_within_its_sigma(run: PointRun) -> None:
    """The reference is the IMU's point, so the lever arm of 1.4 m is in the errors."""
    assert run.errors is not None and len(run.errors) >= 55
    assert run.trusted().all()
    assert (run.point["n_used"] >= 8).all()
    for axis in ("n", "e", "d"):
        error, sigma = run.errors[f"d_{axis}_m"], run.errors[f"sd_{axis}_m"]
        assert error.abs().max() < 4.5 * sigma.max() + 1.4
        speed, own = run.errors[f"d_v{axis}_mps"], run.errors[f"sd_v{axis}_mps"]
        # the lever arm turns with up to 10 deg/s
        assert speed.abs().max() < 4.5 * own.max() + 0.3


def test_columns_agree_with_each_other(run: PointRun) -> None:
    table = run.point
    there = np.column_stack(pymap3d.geodetic2ecef(table["lat_deg"], table["lon_deg"], table["h_m"]))
    np.testing.assert_allclose(table[["x_m", "y_m", "z_m"]].to_numpy(), there, rtol=0, atol=1e-6)
    np.testing.assert_allclose(table["gdop"] ** 2, table["pdop"] ** 2 + table["tdop"] ** 2, rtol=1e-9)
    np.testing.assert_allclose(table["pdop"] ** 2, table["hdop"] ** 2 + table["vdop"] ** 2, rtol=1e-9)
    assert (table["hpl_m"] > 4.0 * np.hypot(table["sd_n_m"], table["sd_e_m"]) / np.sqrt(2.0)).all()
    limit = stats.chi2.isf(1e-3, table["n_redundant"])
    np.testing.assert_allclose(table["test_limit"], limit, rtol=1e-9)
    tested = table["test_statistic"] <= table["test_limit"]
    assert (tested == (table["verdict"] == "ok")).all()


def test_ionosphere_that_no_model_removes_is_in_sigmas_and_protection_levels(
    tmp_path: Path, run: PointRun
) -> None:
    """A row's variance grows by (5 m of zenith delay times the thin shell's mapping)^2; an event says so."""
    path = write_flight(tmp_path, turns(DURATION_S))
    nav = path.parent / "nav.rnx"
    nav.write_text(nav.read_text().replace("IONOSPHERIC CORR", "COMMENT         "))
    bare = point(path)
    rows = bare.residuals.merge(
        run.residuals, on=["time_s", "sv", "signal", "kind"], suffixes=("", "_modelled")
    )
    rows = rows[(rows["kind"] == "pseudorange") & (rows["status"] == "used")]
    cosine = np.cos(np.radians(rows["el_deg"])) * 6_378_137.0 / 6_728_137.0
    grown = np.hypot(rows["sd_modelled"], 5.0 / np.sqrt(1.0 - cosine**2))
    np.testing.assert_allclose(rows["sd"], grown, rtol=1e-4)
    assert (bare.point["vpl_m"] > 2.0 * run.point["vpl_m"]).all()
    assert "no_ionosphere_model" in set(bare.events["kind"])
    assert "no_ionosphere_model" not in set(run.events["kind"])


def test_every_value_of_the_log_has_its_row(run: PointRun, path: Path) -> None:
    cells = pd.read_csv(path.parent / "gnss.csv")
    filled = int(cells["pseudorange_m"].notna().sum() + cells["doppler_hz"].notna().sum())
    assert len(run.residuals) == filled == int(run.status_counts().to_numpy().sum())
    used = run.residuals[run.residuals["status"] == "used"]
    of_epoch = used[used["kind"] == "pseudorange"].groupby("time_s").size()
    assert of_epoch.tolist() == run.point.loc[run.point["n_used"] > 0, "n_used"].tolist()
    assert used[["residual", "sd", "normalised", "az_deg", "el_deg"]].notna().all().all()


def test_normalised_residuals_have_deviation_one(run: PointRun) -> None:
    """The simulated noise is the filter's own model; 500 residuals: 99.9 % of deviations between 0.9 and 1.1."""
    used = run.residuals[run.residuals["status"] == "used"]
    for _, of_kind in used.groupby("kind", observed=True):
        assert 0.85 < of_kind["normalised"].std() < 1.15


def faulty(log: SimulatedLog, sv: str, metres: float, after_s: float = 30.0) -> GnssTable:
    gnss = log.gnss
    pseudorange = gnss.pseudorange_m.copy()
    late = gnss.t_ns >= gnss.t_ns[0] + int(after_s * 1e9)
    pseudorange[late & (gnss.sv == gnss.sv_names.index(sv))] += metres
    return replace(gnss, pseudorange_m=pseudorange)


@pytest.mark.parametrize("metres", [80.0, 5e3])
def test_injected_fault_is_named_and_excluded_from_when_it_begins(log: SimulatedLog, metres: float) -> None:
    loaded = flight(turns(DURATION_S), log)
    logs = loaded.read()
    sv = logs.gnss.sv_names[0]
    logs = replace(logs, gnss=faulty(log, sv, metres))
    setup = setup_filter(loaded, logs, filter_config("tight17"))
    rows, _, out = solve_rows(setup, setup.rows(logs.gnss, setup.navigation))
    late = rows.epoch_ns >= rows.epoch_ns[0] + 30_000_000_000
    assert (out.verdict[late, 0] == integrity.EXCLUDED).all()
    assert (out.verdict[~late, 0] == integrity.OK).all()
    status = out.status[:, 0]
    excluded = {logs.gnss.sv_names[k] for k in logs.gnss.sv[status == INCONSISTENT]}
    assert excluded == {sv}
    # the excluded row's residual is the fault
    at = status == INCONSISTENT
    np.testing.assert_allclose(out.residual[at, 0], metres, rtol=0, atol=25.0)
    assert (out.status[at, 1] == USED).all()


def test_epoch_of_three_satellites_says_so_and_breaks_nothing(log: SimulatedLog) -> None:
    loaded = flight(turns(DURATION_S), log)
    logs = loaded.read()
    t_ns = logs.gnss.t_ns
    few = t_ns == np.unique(t_ns)[20]
    keep = ~few | (np.cumsum(few) <= 3)
    logs = replace(logs, gnss=logs.gnss.take(np.flatnonzero(keep)))
    setup = setup_filter(loaded, logs, filter_config("tight17"))
    _, _, out = solve_rows(setup, setup.rows(logs.gnss, setup.navigation))
    assert out.verdict[20].tolist() == [integrity.TOO_FEW] * 2
    assert np.isnan(out.r_e[20]).all() and np.isnan(out.v_e[20]).all()
    assert np.isfinite(np.delete(out.r_e, 20, axis=0)).all()


def test_epochs_do_not_know_of_each_other(log: SimulatedLog) -> None:
    loaded = flight(turns(DURATION_S), log)
    logs = loaded.read()
    half = replace(logs, gnss=logs.gnss.take(np.flatnonzero(logs.gnss.t_ns >= np.unique(logs.gnss.t_ns)[30])))
    found = []
    for part in (logs, half):
        setup = setup_filter(loaded, part, filter_config("tight17"))
        found.append(solve_rows(setup, setup.rows(part.gnss, setup.navigation))[2])
    np.testing.assert_array_equal(found[0].r_e[30:], found[1].r_e)


@pytest.mark.parametrize("form", ["parquet", "csv"])
def test_command_writes_the_tables_and_says_what_it_did(path: Path, tmp_path: Path, form: str) -> None:
    result = CliRunner().invoke(APP, [str(path), "--output", str(tmp_path / "out"), "--format", form])
    assert result.exit_code == 0, result.output
    for word in ("trusted position", "ok", "used", "horizontal, m", "epochs/s", "wrote"):
        assert word in result.output
    assert {f"{name}.{form}" for name in TABLES} <= {p.name for p in (tmp_path / "out").iterdir()}


@pytest.mark.parametrize(
    ("options", "code"),
    [(["--format", "xls"], 2), (["--false-alarm", "0.7"], 2), (["--filter", "tight18"], 2)],
)
def test_command_with_a_wrong_option_is_a_typed_error(path: Path, options: list[str], code: int) -> None:
    result = CliRunner().invoke(APP, [str(path), *options])
    assert result.exit_code == code
    assert "Traceback" not in result.output


def test_missing_inertial_log_does_not_matter(tmp_path: Path) -> None:
    path = write_flight(tmp_path, turns(DURATION_S))
    (tmp_path / "imu.csv").unlink()
    assert point(path).trusted().all()


@pytest.mark.parametrize("value", [0.0, 1.0, -1e-3, float("nan")])
def test_probability_that_is_none_is_a_typed_error(path: Path, value: float) -> None:
    with pytest.raises(ConfigError, match="not a probability"):
        point(path, false_alarm=value)


def test_folder_that_cannot_be_written_is_a_typed_error(run: PointRun, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(ResultError, match="cannot be written"):
        run.save(tmp_path / "file")


def test_errors_without_a_reference_are_a_typed_error(run: PointRun) -> None:
    with pytest.raises(ResultError, match="no reference"):
        replace(run, errors=None).error_summary()


def test_flight_without_an_inertial_log_is_solved_alike(path: Path, run: PointRun) -> None:
    text = path.read_text()
    begin, end = text.index("[imu]"), text.index("[gnss]")
    alone = path.with_name("alone.toml")
    alone.write_text(text[:begin] + text[end:])
    solved = point(alone)
    pd.testing.assert_frame_equal(solved.point, run.point)
    assert not any("imu" in name for name in solved.settings["input_sha256"])
    result = CliRunner().invoke(APP, [str(alone)])
    assert result.exit_code == 0, result.output


def test_reference_with_sigmas_puts_them_beside_the_errors(path: Path) -> None:
    reference = pd.read_csv(path.parent / "reference.csv")
    reference["sd_n_m"], reference["sd_yaw_deg"] = 0.5, 0.25
    reference.to_csv(path.parent / "stated.csv", index=False)
    stated = path.with_name("stated.toml")
    stated.write_text(path.read_text().replace("reference.csv", "stated.csv"))
    errors = point(stated).errors
    assert errors is not None and (errors["sd_reference_n_m"] == 0.5).all()
    assert errors["sd_reference_e_m"].isna().all()


def test_what_the_reference_lacks_has_no_row_in_the_summary(path: Path) -> None:
    pd.read_csv(path.parent / "reference.csv").drop(columns="vd").to_csv(
        path.parent / "level.csv", index=False
    )
    level = path.with_name("level.toml")
    level.write_text(path.read_text().replace("reference.csv", "level.csv"))
    result = CliRunner().invoke(APP, [str(level)])
    assert result.exit_code == 0 and "vertical, m " in result.output
    assert "vertical, m/s" not in result.output and "nan" not in result.output
