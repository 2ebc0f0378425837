"""Whatever a file holds, a reader gives a table without NaN where none may be, or an error of the package's own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insgnss.errors import InsGnssError
from insgnss.log.csv.columns import ColumnSelection
from insgnss.log.csv.table import read_csv_table
from tests.log.test_rinex_navigation import HEADER as NAV_HEADER
from tests.log.test_rinex_navigation import message
from tests.log.test_rinex_observations import HEADER as OBS_HEADER
from tests.log.test_rinex_observations import epoch
from tests.log.writing import (
    GNSS_HEADER,
    IMU_HEADER,
    gnss_lines,
    lines_of,
    rest,
)

IMU_TEXT = "\n".join([IMU_HEADER, *lines_of(rest(np.random.default_rng(1), n=30))]) + "\n"
GNSS_TEXT = "\n".join([GNSS_HEADER, *gnss_lines(6)]) + "\n"
NAV_TEXT = NAV_HEADER + message() + message("E11") + message("C21")
OBS_TEXT = OBS_HEADER + "".join(epoch(f"{42 + k}.0000000") for k in range(4))


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz") / "file"


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
