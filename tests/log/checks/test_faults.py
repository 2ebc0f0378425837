"""Each fault class, put into a copy of a sound log, is found, and the proposals give the sound log back."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from insgnss.cli.main import app
from insgnss.log.flight import Flight
from insgnss.runs.check import examine
from tests.log.checks.spoilt import FAULTS, Log, gnss_later, imu_later, judged, log_of

ROOT = Path(__file__).resolve().parents[3]
SAMPLE = ROOT / "data/sample_flight/flight.toml"
FLIGHTS = ROOT / "tests/flights"
SHORT_S = 200.0  # at rest, take-off run, climb, the first turn
# what the unit tests of the parts cover already is left to the table of tests/benchmarks
MENDED = (
    "gyro in deg/s",
    "accelerometer in g",
    "increments",
    "on its nose (z y -x)",
    "left-handed (-x y z)",
    "gyro z reversed",
    "gravity for specific force",
    "IMU +0.25 s",
    "IMU in UTC",
    "IMU one hour late",
    "IMU one week early",
    "GNSS in UTC",
    "week off by one",
    "Doppler, axes, unit and time",
)
TOLD = tuple(name for name, fault in FAULTS.items() if fault.words)


@pytest.fixture(scope="module")
def short() -> Log:
    """Return the beginning of the sample flight, its inertial log at 50 Hz."""
    log = log_of(SAMPLE, SHORT_S)
    even = log.imu[: len(log.imu) // 2 * 2].reshape(-1, 2, 7)
    return replace(log, imu=np.concatenate((even[:, 1, :1], even[:, :, 1:].mean(axis=1)), axis=1))


def test_sound_log_gets_no_proposal_and_no_warning(short: Log, tmp_path: Path) -> None:
    report = examine(Flight.load(short.write(tmp_path)))
    assert report.proposals == ()
    assert report.severity == "ok", "\n".join(report.lines())
    text = "\n".join(report.lines())
    assert "the axes fit the motion" in text and "IMU and GNSS tags agree" in text
    at_rest = re.search(r"at rest for (\d+) s", text)
    assert at_rest is not None and 65 <= int(at_rest[1]) <= 75  # then it takes off


@pytest.mark.parametrize("name", MENDED)
def test_fault_is_found_and_the_proposals_mend_it(name: str, short: Log, tmp_path: Path) -> None:
    verdict = judged(short, FAULTS[name], tmp_path)
    report = "\n".join(verdict.report.lines())
    assert verdict.right, report
    assert set(FAULTS[name].keys) <= verdict.keys | {"imu.axes"}, report
    assert verdict.report.severity == "error"


@pytest.mark.parametrize("name", TOLD)
def test_fault_that_no_key_mends_is_told_without_a_proposal(name: str, short: Log, tmp_path: Path) -> None:
    verdict = judged(short, FAULTS[name], tmp_path)
    assert verdict.right, "\n".join(verdict.report.lines())


def test_bad_epochs_are_one_warning_and_no_clock_jumps(short: Log, tmp_path: Path) -> None:
    gnss = short.gnss.copy()
    epoch = gnss["time_s"].astype(float)
    for k, off_m in enumerate((1000.0, -700.0, 2500.0, -1800.0, 430.0, -900.0)):
        bad = (epoch == epoch.iloc[0] + 20.0 * (k + 1)) & (gnss["pseudorange_m"] != "")
        gnss.loc[bad, "pseudorange_m"] = [f"{float(p) + off_m:.4f}" for p in gnss.loc[bad, "pseudorange_m"]]
    lines = examine(Flight.load(replace(short, gnss=gnss).write(tmp_path))).lines()
    assert [line[:7] for line in lines if "leaps 12 time(s)" in line] == ["WARNING"]
    assert not any("jump(s)" in line or "clock jumps" in line for line in lines)


@pytest.mark.parametrize("seconds", [0.3, -1.0, 7.5])
def test_gnss_tags_that_are_off_by_any_time_are_not_laid_on_the_inertial_log(
    seconds: float, short: Log, tmp_path: Path
) -> None:
    report = examine(Flight.load(gnss_later(short, seconds).write(tmp_path)))
    (proposal,) = report.sure_proposals
    assert proposal.key == "gnss.time.offset_s"
    assert proposal.value == pytest.approx(-seconds, abs=0.005)
    text = "\n".join(report.lines())
    assert f"s {'late' if seconds > 0.0 else 'early'}: the pseudoranges contradict" in text
    assert "IMU and GNSS tags agree" in text


@pytest.mark.parametrize("seconds", [47.3, -131.2, -1800.0])
def test_gnss_tags_that_are_off_by_minutes_are_found(seconds: float, short: Log, tmp_path: Path) -> None:
    report = examine(Flight.load(gnss_later(short, seconds).write(tmp_path)))
    (proposal,) = report.sure_proposals
    assert proposal.key == "gnss.time.offset_s"
    assert proposal.value == pytest.approx(-seconds, abs=0.005)


@pytest.mark.parametrize(
    ("seconds", "said"),
    [(3600.3, "-1 hour(s) and -0.3"), (-18.3, "+18 leap seconds and +0.3"), (7200.0, "-2 hour(s)\n")],
)
def test_rest_beside_hours_and_leap_seconds_is_told(
    seconds: float, said: str, short: Log, tmp_path: Path
) -> None:
    report = examine(Flight.load(gnss_later(short, seconds).write(tmp_path)))
    assert said in "\n".join(finding.text + "\n" for finding in report.of("error"))
    values = {p.key: p.value for p in report.sure_proposals}
    added_s = 18.0 if values.pop("gnss.time.scale", "gps") == "utc" else 0.0
    assert added_s + float(str(values.pop("gnss.time.offset_s"))) == pytest.approx(-seconds, abs=0.005)
    assert not values


@pytest.mark.parametrize("seconds", [31.7, -95.0])
def test_inertial_tags_that_are_off_by_minutes_are_found(seconds: float, short: Log, tmp_path: Path) -> None:
    report = examine(Flight.load(imu_later(short, seconds).write(tmp_path)))
    (proposal,) = report.sure_proposals
    assert proposal.key == "imu.time.offset_s"
    assert proposal.value == pytest.approx(-seconds, abs=0.06)


def test_inertial_log_of_another_drive_gets_no_offset_of_minutes(short: Log, tmp_path: Path) -> None:
    imu = short.imu.copy()
    imu[:, 1:] = imu[::-1, 1:]
    report = examine(Flight.load(replace(short, imu=imu).write(tmp_path)))
    assert report.sure_proposals == ()


def test_offset_is_not_sure_where_no_time_makes_the_pseudoranges_agree(short: Log, tmp_path: Path) -> None:
    """Each satellite's ranges are hundreds of metres off: either log's tags may be the wrong ones."""
    gnss = short.gnss.copy()
    off_m = {sv: 400.0 * (k % 5 - 2) for k, sv in enumerate(sorted(gnss["sv"].unique()))}
    gnss["pseudorange_m"] = [
        f"{float(p) + off_m[sv]:.4f}" if p else ""
        for sv, p in zip(gnss["sv"], gnss["pseudorange_m"], strict=True)
    ]
    log = imu_later(replace(short, gnss=gnss), 0.25)
    report = examine(Flight.load(log.write(tmp_path)))
    assert "no position fits the pseudoranges" in "\n".join(report.lines())
    assert [p.key for p in report.proposals if p.key.startswith("imu.time")] == ["imu.time.offset_s"]
    assert report.sure_proposals == ()


def scaled_doppler(log: Log, factor: float) -> Log:
    gnss = log.gnss.copy()
    gnss["doppler_hz"] = [f"{factor * float(d)}" if d else "" for d in gnss["doppler_hz"]]
    return replace(log, gnss=gnss)


@pytest.mark.parametrize(("factor", "named"), [(0.991, "B1I, 1561.098 MHz"), (1.01, "another signal")])
def test_doppler_of_another_carrier_is_an_error_and_gives_no_velocity(
    factor: float, named: str, short: Log, tmp_path: Path
) -> None:
    report = examine(Flight.load(scaled_doppler(short, factor).write(tmp_path)))
    text = "\n".join(report.lines())
    assert named in "\n".join(finding.advice for finding in report.of("error")), text
    assert "steers" not in text and "range rates agree" not in text
    assert report.proposals == (), text


def test_scale_of_three_thousandths_shows_though_the_ranges_are_noisy(short: Log, tmp_path: Path) -> None:
    """An epoch's ratio is off by 0.5 % here; over ten seconds the ranges change by kilometres."""
    gnss, rng = scaled_doppler(short, 1.003).gnss.copy(), np.random.default_rng(5)
    gnss["pseudorange_m"] = [
        f"{float(p) + rng.normal(0.0, 1.0):.4f}" if p else "" for p in gnss["pseudorange_m"]
    ]
    report = examine(Flight.load(replace(short, gnss=gnss).write(tmp_path)))
    (error,) = report.of("error")
    assert "contradict the pseudoranges: these change 0.99" in error.text


def test_ratio_that_its_own_noise_explains_is_no_error(short: Log, tmp_path: Path) -> None:
    """With pseudoranges noisy by 300 m the ratio leaves 1 by more than the least that counts."""
    gnss, rng = short.gnss.copy(), np.random.default_rng(5)
    gnss["pseudorange_m"] = [
        f"{float(p) + rng.normal(0.0, 300.0):.4f}" if p else "" for p in gnss["pseudorange_m"]
    ]
    text = "\n".join(examine(Flight.load(replace(short, gnss=gnss).write(tmp_path))).lines())
    (ratio,) = re.findall(r"range rates agree with the pseudoranges \(ratio ([0-9.]+)\)", text)
    assert abs(float(ratio) - 1.0) > 2e-3, text


def test_rate_that_falls_is_told_and_the_rest_is_judged_at_the_full_rate(short: Log, tmp_path: Path) -> None:
    falls_s = short.imu[0, 0] + 150.0
    kept = (short.imu[:, 0] < falls_s) | (np.arange(len(short.imu)) % 10 == 0)
    log = imu_later(replace(short, imu=short.imu[kept]), 0.25)
    report = examine(Flight.load(log.write(tmp_path)))
    text = "\n".join(report.lines())
    (told,) = re.findall(r"the rate changes from 50 to 5 Hz at about ([0-9.]+) s", text)
    assert float(told) == pytest.approx(falls_s, abs=32 / 5.0)
    assert [p.key for p in report.proposals] == ["imu.time.offset_s"], text
    assert report.proposals[0].value == pytest.approx(-0.25, abs=0.06)


def test_lost_samples_and_gaps_are_no_change_of_the_rate(short: Log, tmp_path: Path) -> None:
    lost = np.random.default_rng(3).random(len(short.imu)) < 0.2
    lost |= (short.imu[:, 0] > short.imu[0, 0] + 60.0) & (short.imu[:, 0] < short.imu[0, 0] + 75.0)
    report = examine(Flight.load(replace(short, imu=short.imu[~lost]).write(tmp_path)))
    text = "\n".join(report.lines())
    assert "IMU gap of 15" in text and "the rate changes" not in text


@pytest.mark.parametrize(("left", "until_s"), [(3, 0.0), (2, 15.0)])
def test_few_satellites_are_no_contradiction(short: Log, tmp_path: Path, left: int, until_s: float) -> None:
    """Three satellites agree on any place: that the tags are wrong cannot be said."""
    seconds = short.gnss["time_s"].astype(float)
    kept = short.gnss["sv"].isin(sorted(short.gnss["sv"].unique())[:left])
    few = replace(short, gnss=short.gnss[kept | (seconds - seconds.iloc[0] < until_s)].reset_index(drop=True))
    report = examine(Flight.load(few.write(tmp_path)))
    text = "\n".join(report.lines())
    assert report.severity == "warning" and report.proposals == (), text
    assert "do not agree" not in text
    assert ("was not compared" in text) == (until_s == 0.0)


def test_dead_gyros_are_an_error_and_not_held_against_the_satellites(short: Log, tmp_path: Path) -> None:
    imu = short.imu.copy()
    imu[:, 1:4] = 0.0
    report = examine(Flight.load(replace(short, imu=imu).write(tmp_path)))
    text = "\n".join(report.lines())
    assert "imu_dead_sensor" in "\n".join(finding.text for finding in report.of("error")), text
    assert "fit the motion" not in text and report.proposals == ()


def test_resting_log_gets_suspicions_of_axes_and_no_proposal(short: Log, tmp_path: Path) -> None:
    """At rest gravity shows that z is up, but not which of the other axes is forward."""
    at_rest = replace(short, imu=short.imu[short.imu[:, 0] < short.imu[0, 0] + 55.0])
    verdict = judged(at_rest, FAULTS["z up (x -y -z)"], tmp_path)
    text = "\n".join(verdict.report.lines())
    assert verdict.keys == frozenset()
    assert "points along +z" in text and "a minute with two turns" in text


def test_check_writes_a_corrected_file_only_when_asked_to(short: Log, tmp_path: Path) -> None:
    path = FAULTS["IMU +0.25 s"].spoil(short).write(tmp_path)
    before = path.read_text()
    corrected = tmp_path / "corrected.toml"

    told = CliRunner().invoke(app, ["check", str(path), "--json"])
    assert told.exit_code == 3 and not corrected.exists()
    about = json.loads(told.stdout)
    assert [proposal["key"] for proposal in about["proposals"]] == ["imu.time.offset_s"]
    assert about["written"] is None

    wrote = CliRunner().invoke(app, ["check", str(path), "--write", str(corrected)])
    assert "wrote" in wrote.output and path.read_text() == before
    assert "# the inertial log" in corrected.read_text()

    again = CliRunner().invoke(app, ["check", str(corrected)])
    assert again.exit_code == 0, again.output
    assert "proposed" not in again.output

    nothing = CliRunner().invoke(app, ["check", str(corrected), "--write", str(tmp_path / "twice.toml")])
    assert "nothing was written: no finding has a correction" in nothing.output
    assert not (tmp_path / "twice.toml").exists()


@pytest.mark.real_data
@pytest.mark.parametrize("name", ["xian", "walk", "walk_ubx", "instinct", "instinct_m2"])
def test_real_logs_get_no_proposal_and_no_error(name: str, data_root: Path) -> None:
    flight = Flight.load(FLIGHTS / f"{name}.toml")
    if not flight.config.imu.files[0].is_file():
        pytest.skip(f"the flight file looks for its logs beside the checkout, not in {data_root}")
    report = examine(flight)
    text = "\n".join(report.lines())
    assert report.proposals == () and report.severity != "error", text
    assert not any(finding.topic == "motion" and finding.severity != "ok" for finding in report.findings), (
        text
    )


@pytest.mark.real_data
def test_minutes_are_not_taken_for_hours_where_few_messages_serve_there(
    data_root: Path, tmp_path: Path
) -> None:
    """Three hours later messages of a few satellites alone are valid, and their ranges agreed on some place."""
    if not (data_root / "walk_boulder_20250828").is_dir():
        pytest.skip("no real log")
    log = log_of(FLIGHTS / "walk.toml", 60.0)
    report = examine(Flight.load(gnss_later(log, 25.3).write(tmp_path)))
    values = {p.key: p.value for p in report.sure_proposals}
    assert float(str(values["gnss.time.offset_s"])) == pytest.approx(-25.3, abs=0.02)
