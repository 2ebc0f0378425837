"""What a run proposes for lever arm, IMU time and mounting, and what it must not: tables made by hand, no replay."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from typer.testing import CliRunner

import insgnss
from insgnss.cli.main import app
from insgnss.config.flight import FlightConfig
from insgnss.config.library import filter_config
from insgnss.errors import ConfigError, ResultError
from insgnss.log.checks.report import CheckReport, Finding
from insgnss.log.files import sha256
from insgnss.runs.installation import installation_findings
from tests.report.runs import made_run
from tests.runs.scenes import flight, turns

LEVER = dict(zip(("lever_arm_x_m", "lever_arm_y_m", "lever_arm_z_m"), (0.5, 0.002, -0.3), strict=True))
SIGMA_M = 0.2
SIGMA_S = 0.02
LEVER_ONLY = {"process.lever_arm_sigma_m": SIGMA_M, "process.imu_time_sigma_s": 0.0}
BOTH = {**LEVER_ONLY, "process.imu_time_sigma_s": SIGMA_S}


@pytest.fixture
def config() -> FlightConfig:
    return flight(turns(20.0), seed=1).config


def run_of(
    config: FlightConfig,
    estimates: dict[str, float],
    changes: dict[str, float],
    *,
    sigma: float = 0.01,
    settings: dict[str, Any] | None = None,
    events: dict[str, str] | None = None,
) -> insgnss.Run:
    """Return a run of three rows that has come to some estimates, each with one sigma of ``sigma`` declared ones."""
    names = {
        "lever": "process.lever_arm_sigma_m",
        "imu": "process.imu_time_sigma_s",
        "range": "process.range_rate_lag_sigma_s",
    }
    columns: dict[str, list[float]] = {"time_s": [293_700.0, 293_701.0, 293_702.0]}
    for name, value in estimates.items():
        columns[name] = [value] * 3
        columns[f"sd_{name}"] = [sigma * changes[names[name.split("_")[0]]]] * 3
    events = events or {}
    told = pd.DataFrame({"time_s": 293_701.0, "kind": list(events), "detail": list(events.values())})
    empty = pd.DataFrame({"time_s": []})
    given = {
        "flight": config.model_dump(mode="json"),
        "filter": filter_config("tight", changes).model_dump(mode="json"),
        "input_sha256": {},
    }
    return insgnss.Run(pd.DataFrame(columns), empty, empty, told, settings=given | (settings or {}))


def proposed(findings: list[Finding]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return all proposals of findings, and the sure ones, as keys and values."""
    report = CheckReport("flight", tuple(findings))
    return {p.key: p.value for p in report.proposals}, {p.key: p.value for p in report.sure_proposals}


def test_lever_arm_is_likely_where_the_run_took_the_tags_as_exact_and_sure_else(config: FlightConfig) -> None:
    findings = installation_findings(run_of(config, LEVER, LEVER_ONLY), config)
    likely, sure = proposed(findings)
    assert set(likely) == {"gnss.lever_arm_m"} and not sure
    reasons = [finding.sure for finding in findings if finding.proposals]
    assert all("time tags" in reason and "process.imu_time_sigma_s" in reason for reason in reasons)
    both = run_of(config, {**LEVER, "imu_time_offset_s": 0.0}, BOTH)
    assert set(proposed(installation_findings(both, config))[1]) == {"gnss.lever_arm_m"}


def test_time_is_likely_where_the_run_took_the_lever_arm_as_exact_and_sure_else(config: FlightConfig) -> None:
    """A jet whose lever arm is 0.5 m too short comes to a time 11 sigmas off."""
    late = {"imu_time_offset_s": -0.03}
    alone = installation_findings(run_of(config, late, {"process.imu_time_sigma_s": SIGMA_S}), config)
    likely, sure = proposed(alone)
    assert likely == {"imu.time.offset_s": pytest.approx(-0.03)} and not sure
    assert "process.lever_arm_sigma_m" in alone[0].sure
    none = dict.fromkeys(LEVER, 0.0)
    assert proposed(installation_findings(run_of(config, {**late, **none}, BOTH), config))[1] == likely


LAG = {"process.range_rate_lag_sigma_s": 0.05}


def test_lag_of_the_range_rates_is_proposed_unless_they_would_lead_the_motion(config: FlightConfig) -> None:
    late = installation_findings(run_of(config, {"range_rate_lag_s": 0.12}, LAG), config)
    assert proposed(late) == ({"gnss.range_rate_lag_s": pytest.approx(0.12)}, {})
    assert "lever_arm" in late[0].sure
    (leads,) = installation_findings(run_of(config, {"range_rate_lag_s": -0.02}, LAG), config)
    assert leads.severity == "warning" and not leads.proposals and "lead" in leads.advice
    gnss = config.gnss.model_copy(update={"range_rate_lag_s": 0.2})
    declared = config.model_copy(update={"gnss": gnss})
    none = installation_findings(run_of(declared, {"range_rate_lag_s": -0.2}, LAG), declared)
    assert proposed(none)[0] == {"gnss.range_rate_lag_s": pytest.approx(0.0)}


def test_lag_beside_that_of_an_event_is_not_proposed_for_the_flight_file(config: FlightConfig) -> None:
    """The state is what the rates lag beyond the number that the event names."""
    found = run_of(config, {"range_rate_lag_s": 0.02}, LAG, events={"rates_late": "lag 0.31 s"})
    (finding,) = installation_findings(found, config)
    assert finding.severity == "warning" and not finding.proposals and "lag 0.31 s" in finding.text


def test_only_components_that_are_contradicted_are_changed(config: FlightConfig) -> None:
    """y is 0.002 m with a sigma of 0.002 m."""
    likely, _ = proposed(installation_findings(run_of(config, LEVER, LEVER_ONLY), config))
    before = config.gnss.lever_arm_m
    assert before is not None
    expected = before[0] + LEVER["lever_arm_x_m"], before[1], before[2] + LEVER["lever_arm_z_m"]
    assert likely["gnss.lever_arm_m"] == pytest.approx(expected, abs=1e-3)
    assert likely["gnss.lever_arm_m"][1] == before[1]


@pytest.mark.parametrize("axis", ["x", "z"])
def test_error_beyond_four_declared_sigmas_is_a_warning_without_a_proposal(
    config: FlightConfig, axis: str
) -> None:
    wild = {**LEVER, f"lever_arm_{axis}_m": -4.5 * SIGMA_M}
    findings = installation_findings(run_of(config, wild, LEVER_ONLY), config)
    assert not any(finding.proposals for finding in findings)
    assert {finding.severity for finding in findings} == {"warning"}
    assert all("process.lever_arm_sigma_m = 0.2" in finding.advice for finding in findings)
    late = run_of(config, {"imu_time_offset_s": 5.0 * SIGMA_S}, {"process.imu_time_sigma_s": SIGMA_S})
    (finding,) = installation_findings(late, config)
    assert finding.severity == "warning" and not finding.proposals


def test_lever_arm_beside_an_implausible_time_is_not_sure(config: FlightConfig) -> None:
    run = run_of(config, {**LEVER, "imu_time_offset_s": 5.0 * SIGMA_S}, BOTH)
    likely, sure = proposed(installation_findings(run, config))
    assert "gnss.lever_arm_m" in likely and not sure


@pytest.mark.parametrize("of_antenna", [None, (0.3, 0.1, -0.2)])
def test_lever_arm_that_is_left_out_counts_as_the_replay_took_it(
    config: FlightConfig, of_antenna: tuple[float, float, float] | None
) -> None:
    """Zero, or that of the first antenna."""
    antennas = [] if of_antenna is None else [{"pattern": "isotropic", "lever_arm_m": of_antenna}]
    gnss = config.gnss.model_dump(mode="json") | {"lever_arm_m": None, "antenna": antennas}
    left_out = FlightConfig.model_validate_json(
        FlightConfig.model_construct(**(config.model_dump(mode="json") | {"gnss": gnss})).model_dump_json(
            warnings=False
        )
    )
    likely, _ = proposed(installation_findings(run_of(left_out, LEVER, LEVER_ONLY), left_out))
    x, y, z = of_antenna or (0.0, 0.0, 0.0)
    assert likely["gnss.lever_arm_m"] == pytest.approx((x + 0.5, y, z - 0.3), abs=1e-3)


def test_run_of_logs_of_another_name_is_refused(config: FlightConfig) -> None:
    assert config.imu is not None
    other = config.model_copy(update={"imu": config.imu.model_copy(update={"files": (Path("other.csv"),)})})
    with pytest.raises(ConfigError, match="another flight") as refused:
        installation_findings(run_of(other, LEVER, LEVER_ONLY), config)
    assert refused.value.key == "run" and "replay this flight" in refused.value.advice
    assert "other.csv" in refused.value.message


def test_run_of_logs_of_the_same_name_and_other_content_is_refused(
    config: FlightConfig, tmp_path: Path
) -> None:
    """A run of a folder that was moved is accepted."""
    configs, hashes = [], []
    for folder, text in (("first", "1"), ("second", "2"), ("moved", "1")):
        (tmp_path / folder).mkdir()
        files = {table: tmp_path / folder / f"{table}.csv" for table in ("imu", "gnss")}
        for path in files.values():
            path.write_text(text, encoding="utf-8")
        tables = {
            table: getattr(config, table).model_copy(update={"files": (path,)})
            for table, path in files.items()
        }
        configs.append(config.model_copy(update=tables))
        hashes.append({str(path): sha256(path) for path in files.values()})
    run = run_of(configs[0], LEVER, LEVER_ONLY, settings={"input_sha256": hashes[0]})
    with pytest.raises(ConfigError, match="changed since"):
        installation_findings(run, configs[1])
    assert proposed(installation_findings(run, configs[2]))[0]


def test_run_without_a_flight_or_without_the_sigma_raises_no_error_of_python(config: FlightConfig) -> None:
    run = run_of(config, LEVER, LEVER_ONLY)
    with pytest.raises(ResultError, match="flight"):
        installation_findings(replace(run, settings={"filter": run.settings["filter"]}), config)
    for settings in ({"filter": {}}, {"filter": {"process": None}}, {"filter": None}):
        (finding,) = installation_findings(run_of(config, LEVER, LEVER_ONLY, settings=settings), config)
        assert finding.severity == "ok" and not finding.proposals


def test_changed_key_is_left_alone(config: FlightConfig) -> None:
    gnss = config.gnss.model_copy(update={"lever_arm_m": (9.0, 0.0, 0.0)})
    changed = config.model_copy(update={"gnss": gnss})
    findings = installation_findings(run_of(config, LEVER, LEVER_ONLY), changed)
    assert findings and not any(finding.proposals for finding in findings)
    assert all("changed since the run" in finding.advice for finding in findings)


def complete(run: insgnss.Run) -> insgnss.Run:
    """Return a run with all columns, so that it can be saved and loaded."""
    made = made_run(3.0)
    estimates = run.nav.drop(columns="time_s").set_index(made.nav.index)
    return replace(made, nav=pd.concat([made.nav, estimates], axis=1), settings=run.settings)


def test_command_refuses_a_run_of_another_flight_and_writes_no_likely_key(
    config: FlightConfig, tmp_path: Path
) -> None:
    sample = Path(__file__).resolve().parents[2] / "data" / "sample_flight" / "flight.toml"
    complete(run_of(config, LEVER, LEVER_ONLY)).save(tmp_path / "other")
    refused = CliRunner().invoke(app, ["check", str(sample), "--run", str(tmp_path / "other")])
    assert refused.exit_code == 2 and "another flight" in refused.output and "reading" not in refused.output
    flown = insgnss.Flight.load(sample).config
    assert flown.imu is not None
    hashes = {str(path): sha256(path) for path in (*flown.imu.files, *flown.gnss.files)}
    complete(run_of(flown, LEVER, LEVER_ONLY, settings={"input_sha256": hashes})).save(tmp_path / "run")
    arguments = ["check", str(sample), "--run", str(tmp_path / "run"), "--write", str(tmp_path / "new.toml")]
    done = CliRunner().invoke(app, arguments)
    assert "proposed: gnss.lever_arm_m" in done.output and "likely: an error of the IMU's time" in done.output
    assert not (tmp_path / "new.toml").exists()
