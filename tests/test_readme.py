"""What README and pages show is what the package does: flight file, commands, tables, exit codes."""

from __future__ import annotations

import re
import tomllib
from dataclasses import fields
from pathlib import Path

import pytest

from insgnss import status
from insgnss.cli.main import EXAMPLES, EXIT_CODES
from insgnss.config.flight import FlightConfig
from insgnss.runs.result import TABLES
from insgnss.studies import ReceiverOptions
from insgnss.version import __version__
from tests.test_settings_pages import FILES, keys_of

REPOSITORY = Path(__file__).resolve().parents[1]
DOCS = REPOSITORY / "docs"
README = (REPOSITORY / "README.md").read_text(encoding="utf-8")
FLIGHT_FILE = (DOCS / "flight-file.md").read_text(encoding="utf-8")
COMMANDS = (DOCS / "command-line.md").read_text(encoding="utf-8")
RESULT = (DOCS / "result.md").read_text(encoding="utf-8")
ALL_PAGES = "\n".join([README, *(page.read_text(encoding="utf-8") for page in sorted(DOCS.rglob("*.md")))])
SETTINGS = {FlightConfig, *(schema for schemas in FILES.values() for schema in schemas)}
MAKEFILE = (REPOSITORY / "Makefile").read_text(encoding="utf-8")


def flight_example(uncommented: tuple[str, ...] = ()) -> str:
    """Return the page's flight file, with the commented-out blocks that begin with these headers switched on."""
    match = re.search(r"```toml\n(name = \"survey 7\".*?)```", FLIGHT_FILE, re.DOTALL)
    assert match is not None
    blocks = match.group(1).split("\n\n")
    for header in uncommented:
        blocks = [re.sub(r"^# ", "", b, flags=re.M) if b.startswith(f"# {header}") else b for b in blocks]
    return "\n\n".join(blocks)


def test_flight_example_is_a_valid_flight_file() -> None:
    config = FlightConfig.model_validate(tomllib.loads(flight_example()))

    assert config.gps_week == 2268
    assert config.start == "automatic"


def test_flight_example_is_valid_with_its_own_start_and_grade() -> None:
    text = flight_example(("[start]", "[imu.grade]"))
    text = text.replace('start = "automatic"', "").replace('grade = "tactical"', "")

    config = FlightConfig.model_validate(tomllib.loads(text))

    assert not isinstance(config.start, str)
    assert config.start.rpy_deg == (0.0, 0.0, 90.0)
    assert not isinstance(config.imu.grade, str)
    assert config.imu.grade.accel_vrw_mps_per_sqrt_h == 0.12


def test_flight_example_names_every_key_of_the_schema() -> None:
    words = set(re.findall(r"\w+", flight_example()))

    # a model's source is free text
    assert set(keys_of(FlightConfig)) - {"source"} - words == set()


def test_flight_example_shows_the_defaults_of_what_may_be_left_out() -> None:
    shown = FlightConfig.model_validate(tomllib.loads(flight_example()))
    bare = FlightConfig.model_validate(
        {
            "gps_week": 2268,
            "imu": {"files": ["imu.csv"], "grade": "tactical"},
            "gnss": {"files": ["gnss.csv"]},
        }
    )

    assert shown.imu == bare.imu
    assert shown.start == bare.start
    assert shown.gnss.columns == bare.gnss.columns
    assert shown.gnss.oscillator == bare.gnss.oscillator


def test_every_table_of_a_run_is_named() -> None:
    assert [name for name in TABLES if f"`run.{name}`" not in RESULT] == []


def test_every_status_that_a_page_names_exists() -> None:
    words = r"`((?:masked|no|bad|stale|not|too|clock)_\w+|used|gated|unhealthy|duplicate)`"
    named = set(re.findall(words, ALL_PAGES))

    assert len(named) > 8
    # columns and events
    others = {"clock_bias_m", "clock_drift_mps", "no_measurements", "masked_bank", "bad_row", "bad_cell"}
    settings = {key for schema in SETTINGS for key in keys_of(schema)}
    settings |= {field.name for field in fields(ReceiverOptions)}
    assert named - set(status.NAMES.values()) - others - settings == set()


def test_exit_codes_are_those_of_the_page() -> None:
    table = COMMANDS.split("| exit code | meaning |")[1].split("\n\n")[0]
    shown = dict(re.findall(r"^\| (\d+) \| (.+?) \|$", table, re.MULTILINE))

    assert set(shown) == set(map(str, EXIT_CODES))
    assert all(shown[str(code)].startswith(words) for code, words in EXIT_CODES.items())


@pytest.mark.parametrize("page", [README, COMMANDS], ids=["README", "command line"])
def test_every_command_is_in_the_table(page: str) -> None:
    commands = {example.split()[1] for example in EXAMPLES.values()}

    assert set(re.findall(r"^\| `insgnss (\w+)", page, re.MULTILINE)) == commands


def test_every_file_that_is_named_exists() -> None:
    named = set(re.findall(r"`((?:insgnss|tests|models|data|notebooks|docs)/[\w/.]+)`", ALL_PAGES))

    assert len(named) > 40
    assert [path for path in named if not (REPOSITORY / path).exists()] == []


def test_citation_is_of_this_version() -> None:
    citation = (REPOSITORY / "CITATION.cff").read_text(encoding="utf-8")

    assert f"version: {__version__}\n" in citation
    assert "license: Apache-2.0\n" in citation


def test_every_make_target_that_is_shown_exists() -> None:
    shown = set(re.findall(r"(?:^    |`)make ([a-z-]+)", ALL_PAGES, re.MULTILINE))

    assert {"demo", "test", "docs", "notebooks"} <= shown
    assert all(re.search(rf"^{target}:", MAKEFILE, re.MULTILINE) for target in shown)
