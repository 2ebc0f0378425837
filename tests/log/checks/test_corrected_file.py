"""The corrected flight file: the user's text with the proposed keys changed, each with its reason; no overwriting."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from insgnss.errors import ResultError
from insgnss.log.checks import corrected_flight, corrected_text, write_corrected
from insgnss.log.checks.report import CheckReport, Finding, Proposal
from insgnss.log.flight import Flight

TEXT = """# my flight
gps_week = 2268  # of the survey

[imu]
files = ["logs/imu.csv"]  # from the second logger
gyro_unit = "rad/s"
grade = "tactical"
time = { unit = "ms" }

[gnss]
files = ["/elsewhere/gnss.csv"]
navigation = ["nav.rnx"]
oscillator = "tcxo"
"""
PROPOSALS = (
    Proposal("gps_week", 2269, "only so do the messages serve"),
    Proposal("imu.gyro_unit", "deg/s", "the turns ask\nfor it"),
    Proposal("imu.axes", ("+y", "+x", "-z"), "gravity"),
    Proposal("imu.time.offset_s", -0.25, "found"),
    Proposal("gnss.time.scale", "utc", "ranges"),
)


@pytest.fixture
def flight(tmp_path: Path) -> Flight:
    (tmp_path / "flight.toml").write_text(TEXT)
    return Flight.load(tmp_path / "flight.toml")


def test_corrected_text_has_the_proposed_values_and_all_others_as_before(flight: Flight) -> None:
    data = tomllib.loads(corrected_text(flight, PROPOSALS, flight.path.parent))
    wanted = tomllib.loads(TEXT)
    wanted["gps_week"] = 2269
    wanted["imu"] |= {"gyro_unit": "deg/s", "axes": ["+y", "+x", "-z"]}
    wanted["imu"]["time"]["offset_s"] = -0.25
    wanted["gnss"]["time"] = {"scale": "utc"}
    assert data == wanted


def test_corrected_text_keeps_comments_and_says_what_stood_there_and_why(flight: Flight) -> None:
    text = corrected_text(flight, PROPOSALS, flight.path.parent)
    assert "# my flight" in text and "# from the second logger" in text
    assert '# corrected, was "rad/s": the turns ask for it' in text
    assert "# corrected, was not given: gravity" in text
    assert "# corrected, was 2268: only so do the messages serve" in text


def test_value_takes_the_place_of_a_table_and_its_comment_keeps_what_the_table_held(flight: Flight) -> None:
    table = "\n[gnss.time]\nscale = 'gps'\n\n[gnss.oscillator]\nh0_s = 8e-22\nh_minus2_per_s = 4e-25\n"
    flight.path.write_text(TEXT.replace('oscillator = "tcxo"\n', table))
    proposal = Proposal("gnss.oscillator", "tcxo", "it wanders")
    text = corrected_text(flight, [proposal], flight.path.parent)
    assert tomllib.loads(text)["gnss"]["oscillator"] == "tcxo"
    assert "was h0_s = 8e-22 h_minus2_per_s = 4e-25: it wanders" in text


def test_corrected_text_without_proposals_is_the_users_own(flight: Flight) -> None:
    assert corrected_text(flight, (), flight.path.parent) == TEXT


def test_corrected_file_in_another_folder_names_the_same_logs(flight: Flight, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    written = Flight.load(write_corrected(flight, PROPOSALS, tmp_path / "out" / "corrected.toml"))
    assert written.config.imu.files == flight.config.imu.files
    assert written.config.gnss.files == flight.config.gnss.files
    assert written.config.gnss.navigation == flight.config.gnss.navigation


def test_corrected_file_reads_as_the_flight_corrected_in_memory(flight: Flight, tmp_path: Path) -> None:
    written = Flight.load(write_corrected(flight, PROPOSALS, tmp_path / "corrected.toml"))
    assert written.config == corrected_flight(flight, PROPOSALS).config


def test_corrected_file_is_never_written_over_another(flight: Flight) -> None:
    with pytest.raises(ResultError, match="already"):
        write_corrected(flight, PROPOSALS, flight.path)
    assert flight.path.read_text() == TEXT


def test_of_two_proposals_for_a_key_the_first_stands() -> None:
    first, second = Proposal("gps_week", 1, ""), Proposal("gps_week", 2, "")
    findings = tuple(Finding("error", "imu", "", proposals=(one,)) for one in (first, second))
    assert CheckReport("x", findings).proposals == (first,)


def test_finding_with_a_proposal_shows_it_as_it_stands_in_a_flight_file() -> None:
    line = Finding("error", "motion", "the axes", sure="sure", proposals=PROPOSALS[2:4]).line()
    assert line.endswith(
        'the axes (sure) -> proposed: imu.axes = ["+y", "+x", "-z"], imu.time.offset_s = -0.25'
    )
