"""Whatever a file holds, a reader gives a table without NaN where none may be, or an error of the package's own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insgnss.config.flight import FlightConfig
from insgnss.config.strict import load_toml
from insgnss.errors import InsGnssError
from insgnss.log.csv.columns import ColumnSelection
from insgnss.log.csv.table import read_csv_table
from insgnss.log.gnss_csv import read_gnss
from insgnss.log.imu.csv_log import read_imu
from insgnss.log.rinex.navigation import read_navigation
from insgnss.log.rinex.observations import read_rinex_obs
from tests.config.test_strict import GOOD
from tests.log.test_rinex_navigation import HEADER as NAV_HEADER
from tests.log.test_rinex_navigation import message
from tests.log.test_rinex_observations import HEADER as OBS_HEADER
from tests.log.test_rinex_observations import epoch
from tests.log.writing import (
    GNSS_HEADER,
    IMU_HEADER,
    WEEK,
    gnss_config,
    gnss_lines,
    imu_config,
    lines_of,
    rest,
)

IMU_TEXT = "\n".join([IMU_HEADER, *lines_of(rest(np.random.default_rng(1), n=30))]) + "\n"
GNSS_TEXT = "\n".join([GNSS_HEADER, *gnss_lines(6)]) + "\n"
NAV_TEXT = NAV_HEADER + message() + message("E11") + message("C21")
OBS_TEXT = OBS_HEADER + "".join(epoch(f"{42 + k}.0000000") for k in range(4))

# A piece of text and where it goes: over the text, into it, or the text ends there
PIECES = st.one_of(
    st.binary(max_size=12),
    st.sampled_from(
        [
            b"nan",
            b"inf",
            b"-",
            b",",
            b",,",
            b"\n",
            b"\r",
            b"\r\n",
            b"#",
            b'"',
            b";",
            b" ",
            b"\0",
            b"\xff",
            b"1e999",
        ]
    ),
    st.sampled_from(
        [b"\xef\xbb\xbf", b"9" * 40, b"-9223372036854775808", b"1,234", b"604799.9", b"\x1f", b"G99", b">"]
    ),
)
DAMAGES = st.lists(
    st.tuples(st.sampled_from(["over", "into", "end"]), st.floats(0.0, 1.0), PIECES), max_size=6
)


def damaged(text: str, damages: list[tuple[str, float, bytes]]) -> bytes:
    data = text.encode()
    for kind, share, piece in damages:
        at = int(share * len(data))
        if kind == "end":
            data = data[:at] + piece
        else:
            data = data[:at] + piece + data[at + (len(piece) if kind == "over" else 0) :]
    return data


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz") / "file"


@settings(max_examples=150)
@given(damages=DAMAGES)
def test_inertial_log(path: Path, damages: list[tuple[str, float, bytes]]) -> None:
    path.write_bytes(damaged(IMU_TEXT, damages))
    try:
        table, _ = read_imu(imu_config(path), WEEK)
    except InsGnssError:
        return
    assert (np.diff(table.t_ns) > 0).all()
    assert np.isfinite(table.w_ib_b).all() and np.isfinite(table.f_b).all()


@settings(max_examples=150)
@given(damages=DAMAGES)
def test_inertial_log_with_unix_time(path: Path, damages: list[tuple[str, float, bytes]]) -> None:
    text = "\n".join("1688037" + line[1:] if line[0] == "1" else line for line in IMU_TEXT.splitlines())
    path.write_bytes(damaged(text, damages))
    try:
        table, _ = read_imu(imu_config(path, time={"origin": "unix_epoch", "scale": "utc"}), WEEK)
    except InsGnssError:
        return
    assert (np.diff(table.t_ns) > 0).all() and (table.t_ns >= 0).all()


@settings(max_examples=150)
@given(damages=DAMAGES)
def test_gnss_log(path: Path, damages: list[tuple[str, float, bytes]]) -> None:
    path.write_bytes(damaged(GNSS_TEXT, damages))
    try:
        table, _ = read_gnss(gnss_config(path), WEEK)
    except InsGnssError:
        return
    assert (np.diff(table.t_ns) >= 0).all()
    assert not np.isinf(table.pseudorange_m).any() and not np.isinf(table.doppler_hz).any()
    assert ((table.sv >= 0) & (table.sv < len(table.sv_names))).all()
    assert ((table.signal >= 0) & (table.signal < len(table.signal_names))).all()
    assert (table.bad_cells < len(table.t_ns)).all()


@settings(max_examples=100)
@given(damages=DAMAGES)
def test_rinex_navigation(path: Path, damages: list[tuple[str, float, bytes]]) -> None:
    path.write_bytes(damaged(NAV_TEXT, damages))
    try:
        navigation, _ = read_navigation([path])
    except InsGnssError:
        return
    assert len(navigation.ephemerides.sv_names) == len(navigation.ephemerides.toe_ns) > 0


@settings(max_examples=100)
@given(damages=DAMAGES)
def test_rinex_observations(path: Path, damages: list[tuple[str, float, bytes]]) -> None:
    path.write_bytes(damaged(OBS_TEXT, damages))
    try:
        table, _ = read_rinex_obs([path])
    except InsGnssError:
        return
    assert len(table.t_ns) > 0 and (np.diff(table.t_ns) >= 0).all()


@settings(max_examples=100)
@given(damages=DAMAGES)
def test_flight_file(path: Path, damages: list[tuple[str, float, bytes]]) -> None:
    path.write_bytes(damaged(GOOD, damages))
    try:
        config = load_toml(path, FlightConfig)
    except InsGnssError:
        return
    assert config.gps_week >= 0 and config.imu.files


@settings(max_examples=300)
@given(data=st.binary(max_size=200))
def test_any_bytes(path: Path, data: bytes) -> None:
    path.write_bytes(b"a,b,c\n" + data)
    try:
        table = read_csv_table(path, ColumnSelection(numeric=("a",), optional=("b",), text=("c",), exact={}))
    except InsGnssError:
        return
    assert np.isfinite(table.columns["a"]).all() and len(table.line) == table.n


@settings(max_examples=200)
@given(cells=st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=50))
def test_every_float_comes_back_as_written(path: Path, cells: list[float]) -> None:
    path.write_text("a\n" + "".join(f"{cell!r}\n" for cell in cells))
    assert read_csv_table(path, ColumnSelection(numeric=("a",))).columns["a"].tolist() == cells


@settings(max_examples=200)
@given(
    rows=st.lists(
        st.sampled_from(["1,2", "x,2", ",2", "1,2,3", "1", "", "# c", "nan,1", "2,", "5,inf"]), max_size=60
    )
)
def test_every_row_is_in_the_table_or_in_an_event(path: Path, rows: list[str]) -> None:
    good = [f"{k},0" for k in range(2000)]
    path.write_text("\n".join(["a,b", *good, *rows]) + "\n")
    table = read_csv_table(path, ColumnSelection(numeric=("a",), optional=("b",)))
    refused = sum(row in ("x,2", ",2", "1,2,3", "1", "nan,1") for row in rows)
    kept = sum(row in ("1,2", "2,", "5,inf") for row in rows)
    told = [event for event in table.events if event.kind == "bad_row"]
    assert table.n == 2000 + kept
    counted = int(told[-1].detail.split(" more such, ")[1].split(" ")[0]) if len(told) > 20 else len(told)
    assert counted == refused
