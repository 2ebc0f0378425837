"""A flight file without a format takes the one that its log states; errors of tables name it too."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from insgnss.errors import InputError
from insgnss.log.flight import Flight
from tests.log.android_generator import COLUMNS as ANDROID_COLUMNS
from tests.log.test_flight import FLIGHT
from tests.log.test_nmea import EPOCHS
from tests.log.test_rinex_navigation import HEADER as NAV_HEADER
from tests.log.test_rinex_navigation import message
from tests.log.test_rinex_observations import HEADER as OBS_HEADER
from tests.log.test_rinex_observations import epoch
from tests.log.ubx_writing import rawx
from tests.log.writing import gnss_lines, rest, write_imu

OBSERVATIONS = (OBS_HEADER + epoch()).encode()
UBX = rawx() * 3


def flight(folder: Path, name: str, content: bytes, *more: str) -> Flight:
    """Return a flight whose GNSS log is a file of that name and content, with more lines in its table."""
    (folder / name).write_bytes(content)
    (folder / "nav.rnx").write_text(NAV_HEADER + message(toc="2023 06 25 00 00 00", toe=0.0))
    text = FLIGHT.replace('files = ["gnss.csv"]', "\n".join([f'files = ["{name}"]', *more]))
    (folder / "flight.toml").write_text(text)
    return Flight.load(folder / "flight.toml")


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("rover.obs", OBSERVATIONS, "rinex"),
        ("rover.nav", OBSERVATIONS, "rinex"),
        ("rover", gzip.compress(OBSERVATIONS), "rinex"),
        ("gnss.csv", UBX, "ubx"),
        ("gnss.csv", "\n".join(gnss_lines()).encode(), "csv"),
        ("rover.obs", NAV_HEADER.encode(), "csv"),
    ],
)
def test_format_left_out_is_the_one_that_the_log_states(
    tmp_path: Path, name: str, content: bytes, expected: str
) -> None:
    assert flight(tmp_path, name, content).config.gnss.format == expected


@pytest.mark.parametrize("line", ['format = "csv"', 'columns = { sv = "satellite" }'])
def test_declared_table_stays_one_and_its_error_names_the_format(tmp_path: Path, line: str) -> None:
    declared = flight(tmp_path, "rover.obs", OBSERVATIONS, line)
    assert declared.config.gnss.format == "csv"
    write_imu(tmp_path / "imu.csv", rest(np.random.default_rng(1), n=2000))
    with pytest.raises(InputError) as error:
        declared.read()
    assert "RINEX observation" in error.value.advice and "format = 'rinex'" in error.value.advice


def test_table_of_androids_columns_keeps_the_advice_of_a_table(tmp_path: Path) -> None:
    table = f"{ANDROID_COLUMNS}\n{','.join('1' for _ in ANDROID_COLUMNS.split(','))}\n".encode()
    log = flight(tmp_path, "device.csv", table, 'columns = { time = "TimeNanos", sv = "Satellite" }')
    write_imu(tmp_path / "imu.csv", rest(np.random.default_rng(1), n=2000))
    with pytest.raises(InputError) as error:
        log.read()
    assert "format = 'android'" in error.value.advice and "the file has " in error.value.advice


def test_file_that_is_no_table_is_called_what_it_is(tmp_path: Path) -> None:
    navigation = flight(tmp_path, "day.nav", NAV_HEADER.encode())
    (tmp_path / "imu.csv").write_bytes(EPOCHS)
    with pytest.raises(InputError) as error:
        navigation.read()
    assert "NMEA 0183 file, not a table" in error.value.advice and "insgnss convert" in error.value.advice
    write_imu(tmp_path / "imu.csv", rest(np.random.default_rng(1), n=2000))
    with pytest.raises(InputError) as error:
        navigation.read()
    assert "RINEX navigation" in error.value.advice and "gnss.navigation" in error.value.advice


def test_base_without_a_format_may_be_a_receivers_own_file(tmp_path: Path) -> None:
    (tmp_path / "base.bin").write_bytes(UBX)
    path = flight(tmp_path, "rover.obs", OBSERVATIONS).path
    place = '\n[gnss.base]\nfiles = ["base.bin"]\nlat_deg = 1.0\nlon_deg = 2.0\nh_m = 3.0\n'
    path.write_text(path.read_text() + place)
    base = Flight.load(path).config.gnss.base
    assert base is not None and base.format == "ubx"


ANTENNA = '\n[attitude]\nclocks = "separate"\n[[attitude.antenna]]\nname = "ahead"\nfiles = ["ahead"]\n'


@pytest.mark.parametrize(
    ("main", "content", "lines", "expected"),
    [
        ("\n".join(gnss_lines()).encode(), UBX, (), "ubx"),
        (UBX, OBSERVATIONS, (), "rinex"),
        (UBX, "\n".join(gnss_lines()).encode(), (), "csv"),
        (UBX, OBSERVATIONS, ('format = "ubx"',), "rinex"),
        (UBX, b"?", ('format = "ubx"',), "ubx"),
        (OBSERVATIONS, f"{ANDROID_COLUMNS}\n".encode(), (), "android"),
        (OBSERVATIONS, f"{ANDROID_COLUMNS}\n".encode(), ('columns = { sv = "Satellite" }',), "csv"),
    ],
)
def test_format_left_out_of_a_further_antenna_is_the_one_that_its_own_log_states(
    tmp_path: Path, main: bytes, content: bytes, lines: tuple[str, ...], expected: str
) -> None:
    (tmp_path / "ahead").write_bytes(content)
    path = flight(tmp_path, "main", main, *lines).path
    path.write_text(path.read_text() + ANTENNA)
    attitude = Flight.load(path).config.attitude
    assert attitude is not None and attitude.antenna[0].format == expected
    # what is declared stays
    path.write_text(path.read_text() + 'format = "sbf"\n')
    attitude = Flight.load(path).config.attitude
    assert attitude is not None and attitude.antenna[0].format == "sbf"
