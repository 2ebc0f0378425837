"""Names of flights, files and folders that are markup, control characters or no text at all."""

from __future__ import annotations

import gzip
import os
import shutil
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from typer.testing import CliRunner

from insgnss.cli.main import app
from insgnss.config.flight import FlightConfig
from insgnss.config.strict import load_toml
from insgnss.errors import ConfigError, InputError
from insgnss.log.files import file_buffer
from insgnss.studies.campaign.study import load_campaign
from tests.small_run import small_run

SAMPLE = Path(__file__).resolve().parents[1] / "data" / "sample_flight"
ODD = "[/x] \\u0001 [bold] :smile: $_\\\\q"


def ended(*arguments: object) -> tuple[int, str]:
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    return done.exit_code, done.output


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder whose name is not UTF-8."""
    path = Path(os.fsdecode(os.fsencode(tmp_path) + b"/\xff\xe9"))
    try:
        path.mkdir()
    except OSError:
        pytest.skip("the file system takes names in UTF-8 alone")
    return path


def test_flight_and_folders_of_odd_names_are_replayed_drawn_and_exported(folder: Path) -> None:
    shutil.copytree(SAMPLE, folder / "flight")
    flight = folder / "flight" / "flight.toml"
    lines = [line for line in flight.read_text(encoding="utf-8").splitlines() if not line.startswith("name")]
    flight.write_text("\n".join([f'name = "{ODD}"', *lines]), encoding="utf-8")

    code, told = ended("replay", flight, "--output", folder / "run", "--report", folder / "page.html")
    assert code == 0, told
    assert "[/x] " in told and "[bold] :smile:" in told
    for ending in ("kml", "gpx", "geojson", "csv"):
        code, told = ended("export", folder / "run", "--output", folder / f"track.{ending}")
        assert code == 0, told
    for ending in ("kml", "gpx"):
        assert "[/x] \ufffd" in "".join(ET.parse(folder / f"track.{ending}").getroot().itertext())
    for form in ("parquet", "csv"):
        small_run().save(folder / form, form)  # type: ignore[arg-type]
        assert ended("compare", folder / form, folder / form)[0] == 0
    code, told = ended("report", folder / "nothing")
    assert code == 5 and "no such folder" in told


def test_deeply_nested_settings_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "flight.toml"
    for text in ("a = " + "[" * 100_000, "a = " + "[" * 2000 + "]" * 2000, "a." * 3000 + "b = 1"):
        path.write_text(text)
        with pytest.raises(ConfigError):
            load_toml(path, FlightConfig)


@pytest.mark.parametrize("seeds", ["10_000_000_000", "100_000_001", "-1", "[-1]"])
def test_campaign_of_impossible_seeds_is_refused_at_once(tmp_path: Path, seeds: str) -> None:
    path = tmp_path / "campaign.toml"
    path.write_text(f'name = "many"\ncase = "matched"\nseeds = {seeds}\n')
    with pytest.raises(ConfigError, match="seeds"):
        load_campaign(path)


def test_gzip_bomb_is_refused_before_it_fills_the_memory(tmp_path: Path) -> None:
    path = tmp_path / "log.csv.gz"
    path.write_bytes(gzip.compress(bytes(1 << 20)) * 2000)  # 2 GB, one member after the other
    with pytest.raises(InputError, match="100 times"):
        file_buffer(path)
    path.write_bytes(gzip.compress(bytes(1 << 20)) * 3)
    assert len(file_buffer(path)) == 3 << 20
