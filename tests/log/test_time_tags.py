"""Time columns of every kind become the same GPS nanoseconds."""

from __future__ import annotations

import datetime as dt
from pathlib import Path

import numpy as np
import pytest

from insgnss.config.log_table import LogTable
from insgnss.errors import TimeError
from insgnss.gpstime import datetime_to_ns
from insgnss.log.csv.columns import ColumnSelection
from insgnss.log.csv.time_tags import continued_times, read_timed_table
from insgnss.tables import Event, Int64
from tests.log.writing import WEEK, write_lines

WEEK_NS = 604_800 * 10**9
FIRST_NS = WEEK * WEEK_NS + 385_980_794_000_001  # 2023-06-29 11:13:00.794000001 GPS
FIRST_UNIX_GPS_NS = FIRST_NS + 315_964_800 * 10**9


def times(folder: Path, cells: list[str], **settings: object) -> tuple[Int64, list[Event]]:
    log = LogTable.model_validate({"columns": {"time": "t"}, "time": settings})
    path = write_lines(folder / "log.csv", ["t,x", *(f"{cell},1" for cell in cells)])
    t_ns, table = read_timed_table(path, log, ColumnSelection(numeric=("x",)), WEEK)
    return t_ns, table.events


def decimal(ns: int, digits: int) -> str:
    return f"{ns // 10**digits}.{ns % 10**digits:0{digits}d}" if digits else str(ns)


@pytest.mark.parametrize(("unit", "digits"), [("s", 9), ("ms", 6), ("us", 3), ("ns", 0)])
@pytest.mark.parametrize(
    ("origin", "first"),
    [("gps_week", FIRST_NS - WEEK * WEEK_NS), ("gps_epoch", FIRST_NS), ("unix_epoch", FIRST_UNIX_GPS_NS)],
)
def test_each_unit_and_origin_keeps_each_nanosecond(
    tmp_path: Path, unit: str, digits: int, origin: str, first: int
) -> None:
    cells = [decimal(first + k, digits) for k in range(50)]
    t_ns, events = times(tmp_path, cells, unit=unit, origin=origin)
    assert np.array_equal(t_ns, FIRST_NS + np.arange(50))
    assert not events


def test_utc_takes_the_leap_seconds_of_its_date_and_says_so(tmp_path: Path) -> None:
    unix = FIRST_UNIX_GPS_NS - 18 * 10**9
    t_ns, events = times(tmp_path, [decimal(unix, 9)], origin="unix_epoch", scale="utc")
    assert t_ns[0] == FIRST_NS
    assert [event.kind for event in events] == ["leap_seconds_by_date"]
    assert "18 s" in events[0].detail


@pytest.mark.parametrize(
    ("date", "leap"), [((2008, 12, 31, 23), 14), ((2009, 1, 1, 1), 15), ((2016, 12, 31, 12), 17)]
)
def test_leap_seconds_follow_the_date(tmp_path: Path, date: tuple[int, int, int, int], leap: int) -> None:
    when = dt.datetime(*date)
    unix = int((when - dt.datetime(1970, 1, 1)).total_seconds())
    t_ns, _ = times(tmp_path, [str(unix)], origin="unix_epoch", scale="utc")
    assert t_ns[0] == datetime_to_ns(when) + leap * 10**9


def test_given_leap_seconds_and_offset_are_added(tmp_path: Path) -> None:
    t_ns, events = times(tmp_path, ["100.5"], scale="utc", leap_seconds=17, offset_s=-0.47)
    assert t_ns[0] == WEEK * WEEK_NS + round((100.5 + 17 - 0.47) * 1e9)
    assert not events


def test_week_crossover_is_counted_on_with_an_event(tmp_path: Path) -> None:
    cells = [f"{(604_799 + 0.25 * k) % 604_800:.3f}" for k in range(12)]
    t_ns, events = times(tmp_path, cells)
    assert np.array_equal(np.diff(t_ns), np.full(11, 250_000_000))
    assert [event.kind for event in events] == ["week_crossover"]
    assert events[0].t_ns == (WEEK + 1) * WEEK_NS


def test_rows_out_of_order_around_the_crossover_stay_in_their_week(tmp_path: Path) -> None:
    t_ns, _ = times(tmp_path, ["604799.0", "0.0", "604799.5", "0.5"])
    assert ((t_ns - WEEK * WEEK_NS) / 1e9).tolist() == [604_799.0, 604_800.0, 604_799.5, 604_800.5]


def test_single_wild_tag_is_no_crossover(tmp_path: Path) -> None:
    t_ns, events = times(tmp_path, ["400000.0", "0.0", "400000.2"])
    assert ((t_ns - WEEK * WEEK_NS) / 1e9).tolist() == [400_000.0, 0.0, 400_000.2]
    assert not events


@pytest.mark.parametrize("cell", ["1e17", "-1e17"])
def test_tag_that_is_no_date_refuses_its_row(tmp_path: Path, cell: str) -> None:
    t_ns, events = times(tmp_path, ["100.0", "101.0", cell, "103.0"])
    assert ((t_ns - WEEK * WEEK_NS) / 1e9).tolist() == [100.0, 101.0, 103.0]
    assert [event.kind for event in events] == ["bad_row"]
    assert "log.csv:4, column 't'" in events[0].detail


@pytest.mark.parametrize("at", [0, 5, 9])
@pytest.mark.parametrize("stray", ["315964800.0", "946684800.5", "4102444800"])
def test_date_of_an_unset_clock_refuses_its_row_and_leaves_the_leap_seconds(
    tmp_path: Path, at: int, stray: str
) -> None:
    unix = FIRST_UNIX_GPS_NS - 18 * 10**9
    cells = [decimal(unix + k * 10**9, 9) for k in range(10)]
    cells[at] = stray
    t_ns, events = times(tmp_path, cells, origin="unix_epoch", scale="utc")
    assert np.array_equal(t_ns, FIRST_NS + np.delete(np.arange(10), at) * 10**9)
    assert [event.kind for event in events] == ["bad_row", "leap_seconds_by_date"]
    assert f"log.csv:{at + 2}, column 't'" in events[0].detail and "years" in events[0].detail
    assert "18 s" in events[1].detail


def test_leap_seconds_are_those_of_the_middle_of_the_log(tmp_path: Path) -> None:
    """A log that begins an hour before the end of 2016 and is mostly of 2017: one shift for all of it."""
    first = dt.datetime(2016, 12, 31, 23)
    unix = int((first - dt.datetime(1970, 1, 1)).total_seconds())
    t_ns, _ = times(tmp_path, [str(unix + 600 * k) for k in range(20)], origin="unix_epoch", scale="utc")
    assert t_ns[0] == datetime_to_ns(first) + 18 * 10**9


@pytest.mark.parametrize(
    ("cells", "settings"),
    [
        (["1688037180.0", "1688037181.0"], {}),
        (["385980000.0", "385981000.0"], {}),
        (["385980.0", "385981.0"], {"origin": "unix_epoch"}),
        (["1688037180.0", "1688037181.0"], {"origin": "unix_epoch", "unit": "ms"}),
    ],
)
def test_wrong_unit_or_origin_is_a_time_error(
    tmp_path: Path, cells: list[str], settings: dict[str, str]
) -> None:
    with pytest.raises(TimeError, match=r"time\.origin"):
        times(tmp_path, cells, **settings)


def test_next_file_may_go_on_after_the_weeks_end() -> None:
    last = WEEK * WEEK_NS + 604_799 * 10**9
    t_ns = np.array([WEEK * WEEK_NS, WEEK * WEEK_NS + 10**9])
    later, events = continued_times(t_ns, last, LogTable(), "b.csv")
    assert np.array_equal(later, t_ns + WEEK_NS) and len(events) == 1
    same, none = continued_times(t_ns, last - 2 * 3600 * 10**9, LogTable(), "b.csv")
    assert np.array_equal(same, t_ns) and not none
