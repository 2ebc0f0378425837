"""Times as recorders, robots and spreadsheets leave them: read to the nanosecond, or refused with what to write."""

from __future__ import annotations

import datetime as dt
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from insgnss.config.flight import Gnss
from insgnss.config.imu import ImuConfig
from insgnss.config.log_table import LogTable
from insgnss.errors import ColumnError, TimeError
from insgnss.gpstime import datetime_to_ns
from insgnss.log.csv.calendar import Calendar
from insgnss.log.csv.columns import ColumnSelection
from insgnss.log.csv.time_tags import continued_times, read_timed_table
from insgnss.log.gnss_csv import read_gnss
from insgnss.log.imu.csv_log import read_imu
from insgnss.tables import Event, Int64
from tests.log.writing import GRADE, WEEK, rest, write_lines

DAY_NS = 86_400 * 10**9
MOMENT_NS = datetime_to_ns(dt.datetime(2025, 9, 24, 9, 34, 43))
APART = {"time": "clock", "date": "day"}


def read(
    folder: Path, header: str, rows: list[str], columns: dict[str, str], **time: object
) -> tuple[Int64, list[Event]]:
    log = LogTable.model_validate({"columns": columns, "time": time})
    path = write_lines(folder / "log.csv", [header, *(f"{row};1" for row in rows)])
    t_ns, table = read_timed_table(path, log, ColumnSelection(numeric=("x",)), WEEK)
    return t_ns, [event for event in table.events if event.kind != "csv_delimiter"]


def clock(seconds: float) -> str:
    """Return seconds, counted on over midnight, as a time of day."""
    hour, rest_s = divmod(seconds % 86_400, 3600)
    return f"{int(hour):02d}:{int(rest_s // 60):02d}:{rest_s % 60:06.3f}"


@pytest.mark.parametrize("scale", ["gps", "utc"])
@pytest.mark.parametrize("form", ["date column", "date key"])
def test_midnight_with_a_date_that_stays_is_counted_on_and_reported_once(
    tmp_path: Path, scale: str, form: str
) -> None:
    seconds = 86_390 + 0.25 * np.arange(200)
    if form == "date key":
        rows = [clock(second) for second in seconds]
        t_ns, events = read(
            tmp_path, "clock;x", rows, {"time": "clock"}, origin="calendar", scale=scale, date="2025-09-24"
        )
    else:
        rows = [f"2025-09-24;{clock(second)}" for second in seconds]
        t_ns, events = read(tmp_path, "day;clock;x", rows, APART, origin="calendar", scale=scale)
    leap_ns = 18 * 10**9 if scale == "utc" else 0
    day_ns = datetime_to_ns(dt.datetime(2025, 9, 24)) + leap_ns
    assert t_ns.tolist() == (day_ns + (seconds * 1e9).astype(np.int64)).tolist()
    midnights = [event for event in events if event.kind == "midnight_crossover"]
    assert len(midnights) == 1 and midnights[0].t_ns == day_ns + DAY_NS and "row 41" in midnights[0].detail


def test_every_midnight_counts_and_a_date_that_catches_up_fits_again(tmp_path: Path) -> None:
    seconds = 80_000 + 600 * np.arange(600)  # four days: the date stays for two of them
    dates = [24 + (0 if second < 3 * 86_400 - 7000 else int(second // 86_400)) for second in seconds]
    rows = [f"2025-09-{date};{clock(second)}" for date, second in zip(dates, seconds, strict=True)]
    t_ns, events = read(tmp_path, "day;clock;x", rows, APART, origin="calendar", scale="gps")
    assert set(np.diff(t_ns).tolist()) == {600 * 10**9}
    assert [event.kind for event in events] == ["midnight_crossover"]


def test_rows_out_of_order_around_midnight_stay_in_their_day(tmp_path: Path) -> None:
    seconds = [86_398.0, 86_399.0, 86_400.5, 86_399.5, 86_401.0, 86_402.0]
    rows = [f"2025-09-24;{clock(second)}" for second in seconds]
    t_ns, _ = read(tmp_path, "day;clock;x", rows, APART, origin="calendar", scale="gps")
    assert ((t_ns - t_ns[0]) / 1e9 + 86_398).tolist() == seconds


@pytest.mark.parametrize("turned_on", [True, False])
def test_dates_that_go_on_and_rows_out_of_order_are_left_as_they_are(tmp_path: Path, turned_on: bool) -> None:
    """A date that is right needs nothing; a date that goes back by a day is not midnight."""
    seconds = 86_390 + np.array([0, 1, 3, 2, 4, 9, 12, 10, 11, 13]) if turned_on else 43_200 + np.arange(10)
    dates = [24 + int(second // 86_400) if turned_on else 25 - (k > 4) for k, second in enumerate(seconds)]
    rows = [f"2025-09-{date};{clock(second)}" for date, second in zip(dates, seconds, strict=True)]
    t_ns, events = read(tmp_path, "day;clock;x", rows, APART, origin="calendar", scale="utc")
    assert [event.kind for event in events] == ["leap_seconds_by_date"] * (len(events) == 1)
    expected = [datetime_to_ns(dt.datetime(2025, 9, date)) + 18 * 10**9 for date in dates]
    assert ((t_ns - expected) / 1e9).tolist() == (seconds % 86_400).tolist()


def test_a_day_sorted_by_satellite_is_no_row_of_midnights(tmp_path: Path) -> None:
    spans = [
        (0, 86_400),
        (0, 40_000),
        (30_000, 86_400),
        (0, 86_400),
        (50_000, 80_000),
        (0, 60_000),
        (20_000, 86_400),
    ]
    rows = [f"2025-09-24;{clock(second)}" for first, last in spans for second in range(first, last, 600)]
    t_ns, events = read(tmp_path, "day;clock;x", rows, APART, origin="calendar", scale="gps")
    assert int(t_ns.max() - t_ns.min()) < DAY_NS and not events


def test_inertial_and_gnss_logs_go_on_over_a_midnight_that_their_date_misses(tmp_path: Path) -> None:
    rows = rest(np.random.default_rng(1), n=400, rate_hz=20.0)
    clocks = [clock(86_390 + 0.05 * k) for k in range(400)]
    lines = [
        f"{c};" + ";".join(f"{value:.7f}" for value in row[1:]) for c, row in zip(clocks, rows, strict=True)
    ]
    names = "gyro_x;gyro_y;gyro_z;accel_x;accel_y;accel_z"
    # in two files, the second after midnight: it is of the day of the first
    files = [
        write_lines(tmp_path / "a.csv", [f"time_s;{names}", *lines[:150]]),
        write_lines(tmp_path / "b.csv", [f"time_s;{names}", *lines[150:300]]),
        write_lines(tmp_path / "c.csv", [f"time_s;{names}", *lines[300:]]),
    ]
    time = {"origin": "calendar", "scale": "gps", "date": "2025-09-24"}
    config = ImuConfig.model_validate({"files": files, "grade": GRADE, "time": time})
    table, events = read_imu(config, WEEK)
    assert set(np.diff(table.t_ns).tolist()) == {50_000_000}
    assert [event.kind for event in events if "imu_time" in event.kind] == []
    lines = [f"2025-09-24;{c};G05;C1C;{2.2e7 + k:.3f}" for k, c in enumerate(clocks)]
    path = write_lines(tmp_path / "gnss.csv", ["day;time_s;sv;signal;pseudorange_m", *lines])
    gnss = Gnss.model_validate(
        {"files": [path], "columns": {"date": "day"}, "time": {"origin": "calendar", "scale": "gps"}}
    )
    log, events = read_gnss(gnss, WEEK)
    assert np.array_equal(log.t_ns, table.t_ns) and "gnss_time_order" not in [e.kind for e in events]


def test_file_after_several_midnights_goes_on_in_its_day() -> None:
    log = LogTable.model_validate({"time": {"origin": "calendar", "scale": "gps", "date": "2025-09-24"}})
    start = datetime_to_ns(dt.datetime(2025, 9, 24)) + np.arange(3) * 10**9
    later, events = continued_times(start, int(start[0]) + 2 * DAY_NS - 10**9, log, "c.csv")
    assert np.array_equal(later, start + 2 * DAY_NS) and events[0].kind == "midnight_crossover"
    same, none = continued_times(start, int(start[0]) + DAY_NS // 2, log, "c.csv")
    assert np.array_equal(same, start) and not none


@pytest.mark.parametrize(("unit", "digits"), [("s", 9), ("ms", 6)])
@pytest.mark.parametrize("origin", ["unix_epoch", "gps_epoch", "gps_week"])
def test_nanoseconds_of_a_column_of_their_own_are_added(
    tmp_path: Path, unit: str, digits: int, origin: str
) -> None:
    start = {
        "unix_epoch": 315_964_800 * 10**9,
        "gps_epoch": 0,
        "gps_week": -(MOMENT_NS // (7 * DAY_NS)) * 7 * DAY_NS,
    }
    known = [MOMENT_NS + start[origin] + k * 5_000_001 for k in range(50)]
    rows = [f"{ns // 10**digits};{ns % 10**digits}" for ns in known]
    columns = {"time": "secs", "nanoseconds": "nsecs"}
    t_ns, events = read(tmp_path, "secs;nsecs;x", rows, columns, unit=unit, origin=origin)
    assert np.diff(t_ns).tolist() == [5_000_001] * 49 and not events
    assert int(t_ns[0]) == (MOMENT_NS if origin != "gps_week" else known[0] + WEEK * 7 * DAY_NS)


@pytest.mark.parametrize("cell", ["-1", "1000000000", "x"])
def test_nanoseconds_that_are_none_refuse_their_row(tmp_path: Path, cell: str) -> None:
    rows = [f"{1_758_706_483 + k};{cell if k == 7 else 500}" for k in range(30)]
    columns = {"time": "secs", "nanoseconds": "nsecs"}
    t_ns, events = read(tmp_path, "secs;nsecs;x", rows, columns, origin="unix_epoch")
    assert len(t_ns) == 29 and ["log.csv:9" in event.detail for event in events] == [True]


@pytest.mark.parametrize(
    ("cell", "order"),
    [
        ("2025 09 24 09 34 43.000", None),
        ("2025  9 24  9 34 43.0000000", None),
        ("24 09 2025 09 34 43", "dmy"),
        ("20250924093443.000", None),
        ("20250924093443", "ymd"),
        ("24092025093443", "dmy"),
        ("240925093443.0", "dmy"),
        ("2025:09:24 09:34:43", None),
        ("2025-09-24_09:34:43.000", None),
        ("20250924_093443.000", None),
        ("24.09.25 09:34:43", "dmy"),
        ("09/24/25 09:34:43.0", "mdy"),
        ("25-09-24T09:34:43", "ymd"),
        ("2025-09-24 09:34:43 GMT", None),
        ("20250924093443Z", None),
        ("Wed, 24 Sep 2025 09:34:43 GMT", None),
        ("Wed, 24 Sep 2025 09:34:43 +0000", "mdy"),
        ("Wednesday, 24-Sep-2025 09:34:43 GMT", None),
        ("Wed Sep 24 09:34:43 2025", None),
        ("Wed Sep 24 09:34:43.000 UTC 2025", "dmy"),
    ],
)
@pytest.mark.parametrize("fraction", [False, True])
def test_form_is_read_in_every_cell(tmp_path: Path, cell: str, order: str | None, fraction: bool) -> None:
    declared = {} if order is None else {"date_order": order}
    rows = [cell.replace(":43.0", ":43.5").replace(" 43.0", " 43.5") if fraction else cell] * 9
    after_ns = 5 * 10**8 if fraction and "43.5" in rows[0] else 0
    t_ns, events = read(tmp_path, "t;x", rows, {"time": "t"}, origin="calendar", scale="utc", **declared)
    assert set(t_ns.tolist()) == {MOMENT_NS + 18 * 10**9 + after_ns}
    assert [event.kind for event in events] == ["leap_seconds_by_date"]


@pytest.mark.parametrize(
    "cell",
    [
        "24.09.25 09:34:43",  # which number is the year is not stated
        "240925093443",
        "2025092409344",
        "24:09:25 09:34:43",
        "Wed Sep 24 09:34 43 2025",
        "2025 09 24 09 34 61",
        "Wen, 24 Sep 2025 09:34:43",
        "2025-09-24__09:34:43",
    ],
)
def test_what_may_mean_several_things_is_not_read(cell: str) -> None:
    _, readable = Calendar(("t",), "ymd", "utc", None).to_gps([pa.array([cell])])
    assert not readable[0]


@pytest.mark.parametrize(
    "cell", ["2025-09-24 09:34:43 GMT", "Wed Sep 24 09:34:43 UTC 2025", "20250924093443Z"]
)
def test_every_zone_contradicts_gps_time(tmp_path: Path, cell: str) -> None:
    with pytest.raises(TimeError, match="has a zone"):
        read(tmp_path, "t;x", [cell] * 9, {"time": "t"}, origin="calendar", scale="gps")


@pytest.mark.parametrize("form", ["date column", "date key"])
def test_time_of_day_without_its_leading_zeros_is_read_beside_a_date(tmp_path: Path, form: str) -> None:
    clocks = ["0.5", "7.0", "93443.0", "93443", "235959.9"]
    expected = [0.5, 7.0, 34_483.0, 34_483.0, 86_399.9]
    header, columns, declared = "day;clock;x", APART, {"date_order": "dmy"}
    rows = [f"240925;{each}" for each in clocks]
    if form == "date key":
        header, columns, declared, rows = "clock;x", {"time": "clock"}, {"date": "2025-09-24"}, clocks
    t_ns, events = read(tmp_path, header, rows, columns, origin="calendar", scale="gps", **declared)
    day_ns = datetime_to_ns(dt.datetime(2025, 9, 24))
    assert ((t_ns - day_ns) / 1e9).tolist() == expected and not events


@pytest.mark.parametrize(("unit", "digits"), [("s", 9), ("ms", 6), ("us", 3), ("ns", 0)])
def test_counts_since_midnight_are_read_in_every_unit(tmp_path: Path, unit: str, digits: int) -> None:
    known = [0, 7_000_000_000, 34_482_250_000_000, DAY_NS - 1]
    cells = [f"{ns // 10**digits}.{ns % 10**digits:0{digits}d}" if digits else str(ns) for ns in known]
    rows = [f"2025-09-24;{cell}" for cell in (*cells, "09:34:43.5", str(DAY_NS // 10**digits))]
    t_ns, events = read(tmp_path, "day;clock;x", rows, APART, origin="calendar", scale="gps", unit=unit)
    assert (t_ns - datetime_to_ns(dt.datetime(2025, 9, 24))).tolist() == [*known, 34_483_500_000_000]
    assert ["log.csv:7" in event.detail for event in events] == [True]


@pytest.mark.parametrize(
    ("cell", "declared", "advice"),
    [
        ("34482250", {}, "time.unit = 'ms'"),
        ("93443.0", {"unit": "s"}, "leave time.unit out"),
        ("34482.0", {"unit": "us", "date_order": "dmy"}, "four digits"),
    ],
)
def test_numbers_beside_a_date_are_refused_with_the_key_that_reads_them(
    tmp_path: Path, cell: str, declared: dict[str, str], advice: str
) -> None:
    day = "2025-09-24" if not declared.get("date_order") else "Okt-24"
    with pytest.raises(ColumnError) as caught:
        read(
            tmp_path, "day;clock;x", [f"{day};{cell}"] * 9, APART, origin="calendar", scale="gps", **declared
        )
    assert advice in caught.value.advice


def test_weeks_modulo_1024_are_an_error_that_names_the_column_and_an_offset_mends_them(
    tmp_path: Path,
) -> None:
    week = MOMENT_NS // (7 * DAY_NS)
    rows = [f"{week - 2048};{1000 + k}" for k in range(9)]
    columns = {"time": "tow", "week": "wn"}
    with pytest.raises(TimeError, match="modulo 1024") as caught:
        read(tmp_path, "wn;tow;x", rows, columns)
    assert caught.value.column == "wn" and "1238630400" in caught.value.advice
    t_ns, _ = read(tmp_path, "wn;tow;x", rows, columns, offset_s=1_238_630_400)
    assert int(t_ns[0]) == week * 7 * DAY_NS + 1000 * 10**9


@pytest.mark.parametrize(
    ("settings", "word"),
    [
        ({"time": {"date": "2025-09-24"}}, "origin = 'calendar'"),
        (
            {"columns": {"date": "d"}, "time": {"origin": "calendar", "scale": "gps", "date": "2025-09-24"}},
            "both",
        ),
        ({"columns": {"nanoseconds": "n"}, "time": {"origin": "calendar", "scale": "gps"}}, "are numbers"),
        ({"columns": {"nanoseconds": "time_s"}}, "two things"),
    ],
)
def test_keys_that_contradict_each_other_are_an_error(settings: dict[str, object], word: str) -> None:
    with pytest.raises(ValueError, match=word):
        LogTable.model_validate(settings)


def test_a_copy_of_settings_declares_what_they_do() -> None:
    """A unit that is written makes seconds of the day of numbers: one that a copy adds would change their meaning."""
    time = {"origin": "calendar", "scale": "utc", "date": "2025-09-24"}
    log = LogTable.model_validate({"time": time})
    copy = LogTable.model_validate(log.model_dump(mode="json"))
    assert {"unit", "date_order"} & copy.time.model_fields_set == {"unit", "date_order"} & set(time)
    assert copy == log
