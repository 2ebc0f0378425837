"""Dates and times of every form become the nanosecond that Python's datetime and decimal compute for them."""

from __future__ import annotations

import datetime as dt
from decimal import ROUND_HALF_EVEN, Decimal
from pathlib import Path
from typing import Literal

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from insgnss.config.log_table import LogTable
from insgnss.errors import ColumnError, TimeError
from insgnss.log.csv.calendar import Calendar
from insgnss.log.csv.columns import ColumnSelection
from insgnss.log.csv.time_tags import read_timed_table
from insgnss.tables import Event, Int64
from tests.log.writing import WEEK, write_lines

Order = Literal["ymd", "dmy", "mdy"]
GPS_EPOCH = dt.datetime(1980, 1, 6)
# GPS minus UTC from these days on (IERS Bulletin C), written down apart from the package's own table
LEAPS = [(dt.datetime(1970, 1, 1), 14), (dt.datetime(2009, 1, 1), 15), (dt.datetime(2012, 7, 1), 16)]
LEAPS += [(dt.datetime(2015, 7, 1), 17), (dt.datetime(2017, 1, 1), 18)]

DATES = st.dates(dt.date(2007, 1, 1), dt.date(2060, 12, 31)) | st.sampled_from(
    [dt.date(2008, 12, 31), dt.date(2016, 12, 31), dt.date(2017, 1, 1), dt.date(2024, 2, 29)]
)
CLOCKS = st.times().map(lambda t: t.replace(microsecond=0)) | st.sampled_from(
    [dt.time(23, 59, 59), dt.time(0)]
)
FRACTIONS = st.text("0123456789", min_size=1, max_size=24) | st.sampled_from(["5" + "0" * 9, "0000000005"])
ZONES = st.integers(-14 * 60, 14 * 60).map(
    lambda m: f"{'-' if m < 0 else '+'}{abs(m) // 60:02d}:{abs(m) % 60:02d}"
)
PATTERNS = {
    "ymd": ("%Y-%m-%d", "%Y/%m/%d", "%Y.%m.%d", "%Y%m%d"),
    "dmy": ("%d.%m.%Y", "%d/%m/%Y", "%d-%m-%Y"),
    "mdy": ("%m/%d/%Y", "%m-%d-%Y"),
}


def expected_ns(when: dt.datetime, fraction: str, away: dt.timedelta, scale: str) -> int:
    """Return GPS time [ns] of a local date and time, computed with nothing of the package."""
    utc = when - away
    whole = (utc - GPS_EPOCH) // dt.timedelta(seconds=1)
    leap = max(value for day, value in LEAPS if utc >= day) if scale == "utc" else 0
    parts = Decimal("0." + (fraction or "0")) * 10**9
    return (whole + leap) * 10**9 + int(parts.to_integral_value(ROUND_HALF_EVEN))


def away_of(zone: str) -> dt.timedelta:
    if zone in ("", "Z", "z", " UTC"):
        return dt.timedelta(0)
    hours, minutes = int(zone[1:3]), int(zone[3:].lstrip(":") or 0)
    return dt.timedelta(hours=hours, minutes=minutes) * (-1 if zone[0] == "-" else 1)


@st.composite
def cells(draw: st.DrawFn, order: Order, scale: str) -> tuple[str, int]:
    """Return a cell as somebody may write it, and its GPS time [ns]."""
    when = dt.datetime.combine(draw(DATES), draw(CLOCKS))
    pattern = draw(st.sampled_from(PATTERNS[order]))
    clock = draw(st.sampled_from(["%H:%M:%S", "%H%M%S", "%I:%M:%S"]))
    fraction = draw(st.just("") | FRACTIONS)
    zone = draw(st.sampled_from(["", "Z", "z", " UTC", "+02", "-0330"]) | ZONES)
    text = when.strftime(pattern) + draw(st.sampled_from(["T", " ", "t", "  "])) + when.strftime(clock)
    text += draw(st.sampled_from(".,")) + fraction if fraction else ""
    text += (draw(st.sampled_from([" ", ""])) + ("PM" if when.hour >= 12 else "am")) if "%I" in clock else ""
    return text + zone, expected_ns(when, fraction, away_of(zone), scale)


@settings(max_examples=200)
@given(
    st.data(),
    st.sampled_from(["ymd", "ymd", "dmy", "mdy"]),
    st.sampled_from(["utc", "gps"]),
)
def test_cells_of_any_form_are_the_nanosecond_that_decimal_computes(
    data: st.DataObject, order: Order, scale: Literal["utc", "gps"]
) -> None:
    drawn = data.draw(st.lists(cells(order, scale), min_size=1, max_size=20))
    t_ns, readable = Calendar(("t",), order, scale, None).to_gps([pa.array([text for text, _ in drawn])])
    assert readable.all()
    assert t_ns.tolist() == [ns for _, ns in drawn]


@settings(max_examples=200)
@given(
    st.lists(
        st.tuples(DATES, CLOCKS, st.text("0123456789", min_size=1, max_size=9)), min_size=1, max_size=20
    ),
    st.sampled_from(["", "Z", "+05:30", "-03"]),
    st.sampled_from("T "),
)
def test_columns_of_one_iso_form_are_the_same_nanoseconds(
    drawn: list[tuple[dt.date, dt.time, str]], zone: str, between: str
) -> None:
    """Cells all alike take the short way; the fraction has any length up to nanoseconds."""
    texts = [f"{date}{between}{clock:%H:%M:%S}.{fraction}{zone}" for date, clock, fraction in drawn]
    t_ns, readable = Calendar(("t",), "ymd", "utc", None).to_gps([pa.array(texts)])
    when = [dt.datetime.combine(date, clock) for date, clock, _ in drawn]
    known = [expected_ns(w, cell[2], away_of(zone), "utc") for w, cell in zip(when, drawn, strict=True)]
    assert readable.all() and t_ns.tolist() == known


@settings(max_examples=300)
@given(
    st.lists(
        st.from_regex(
            r"\A20[0-3]\d-[0-2]\d-[0-4]\d[T ][0-2]\d:[0-6]\d(:[0-6]\d([.,]\d{0,12})?)?(Z|[+-]\d\d(:[0-6]\d)?)?\Z"
        )
        | st.text("0123456789-/.:TZ+ ", max_size=30),
        min_size=1,
        max_size=6,
    )
)
def test_whatever_is_read_agrees_with_the_standard_library(texts: list[str]) -> None:
    """A cell is read or refused by itself, whatever its neighbours; where datetime reads it too, both agree."""
    calendar = Calendar(("t",), "ymd", "gps", None)
    t_ns, readable = calendar.to_gps([pa.array(texts)])
    for text, ns, good in zip(texts, t_ns.tolist(), readable.tolist(), strict=True):
        alone, good_alone = calendar.to_gps([pa.array([text])])
        assert (int(alone[0]), bool(good_alone[0])) == (ns, good)
        try:
            known = dt.datetime.fromisoformat(text.strip())
        except ValueError:
            continue
        if good:
            known = known.replace(tzinfo=None) - (known.utcoffset() or dt.timedelta(0))
            assert (ns // 1000) - (known - GPS_EPOCH) // dt.timedelta(microseconds=1) in (0, 1)


def read(
    folder: Path, header: str, rows: list[str], columns: dict[str, str], **time: object
) -> tuple[Int64, list[Event]]:
    log = LogTable.model_validate({"columns": columns, "time": {"origin": "calendar", **time}})
    path = write_lines(folder / "log.csv", [header, *rows])
    t_ns, table = read_timed_table(path, log, ColumnSelection(numeric=("x",)), WEEK)
    return t_ns, table.events


def ns_of(when: dt.datetime, leap: int = 0) -> int:
    return ((when - GPS_EPOCH) // dt.timedelta(microseconds=1)) * 1000 + leap * 10**9


def test_iso_times_in_utc_take_the_leap_seconds_and_say_so(tmp_path: Path) -> None:
    rows = ["2025-08-28T17:30:22.961Z,1", "2025-08-28T17:30:22.966Z,2"]
    t_ns, events = read(tmp_path, "t,x", rows, {"time": "t"}, scale="utc")
    assert t_ns[0] == ns_of(dt.datetime(2025, 8, 28, 17, 30, 22, 961_000), 18)
    assert np.diff(t_ns).tolist() == [5_000_000]
    assert [event.kind for event in events] == ["leap_seconds_by_date"]


@pytest.mark.parametrize("leap", [17, 18])
def test_declared_leap_seconds_count_for_every_row(tmp_path: Path, leap: int) -> None:
    t_ns, events = read(
        tmp_path,
        "t,x",
        ["2025-08-28 17:30:22,1"],
        {"time": "t"},
        scale="utc",
        leap_seconds=leap,
        offset_s=0.5,
    )
    assert t_ns[0] == ns_of(dt.datetime(2025, 8, 28, 17, 30, 22, 500_000), leap) and not events


def test_dates_in_gps_time_get_no_leap_seconds(tmp_path: Path) -> None:
    t_ns, events = read(tmp_path, "t,x", ["2025-08-28T17:30:22,1"], {"time": "t"}, scale="gps")
    assert t_ns[0] == ns_of(dt.datetime(2025, 8, 28, 17, 30, 22)) and not events


def test_date_and_time_in_two_columns_are_one_moment(tmp_path: Path) -> None:
    rows = ["17:30:22.5,28.08.2025,1", "17:30:23,28.08.2025,1"]
    t_ns, _ = read(
        tmp_path, "clock,day,x", rows, {"time": "clock", "date": "day"}, scale="gps", date_order="dmy"
    )
    first = ns_of(dt.datetime(2025, 8, 28, 17, 30, 22, 500_000))
    assert t_ns.tolist() == [first, first + 500_000_000]


def test_time_goes_on_evenly_through_a_leap_second(tmp_path: Path) -> None:
    texts = [
        "2016-12-31T23:59:59.5Z",
        "2016-12-31T23:59:60.0Z",
        "2016-12-31T23:59:60.5Z",
        "2017-01-01T00:00:00Z",
    ]
    t_ns, _ = read(tmp_path, "t,x", [f"{text},1" for text in texts], {"time": "t"}, scale="utc")
    assert np.diff(t_ns).tolist() == [500_000_000] * 3


@pytest.mark.parametrize(
    ("cell", "scale"),
    [
        ("2016-12-30T23:59:60Z", "utc"),  # no leap second came then
        ("2016-12-31T23:59:60", "gps"),  # nor ever in GPS time
        ("2016-12-31T23:59:61Z", "utc"),
        ("2025-02-29T00:00:00Z", "utc"),
        ("2025-08-28T24:00:01Z", "utc"),
        ("2025-08-28", "utc"),
        ("17:30:22", "utc"),
        ("25-08-28T17:30:22", "utc"),
        ("2025-08-28T17:30:22+25:00", "utc"),
        ("2025-08-28T13:30:22 PM", "utc"),
        ("2025-08-28T93022", "utc"),
        ("1e9", "utc"),
        ("", "utc"),
    ],
)
def test_cell_that_is_no_moment_refuses_its_row_by_line_and_column(
    tmp_path: Path, cell: str, scale: str
) -> None:
    zone = "Z" if scale == "utc" else ""
    rows = [f"2016-12-31T12:00:{k:02d}{zone},1" for k in range(40)]
    rows[7] = f"{cell},1"
    t_ns, events = read(tmp_path, "t,x", rows, {"time": "t"}, scale=scale)
    bad = [event.detail for event in events if event.kind == "bad_row"]
    assert len(t_ns) == 39 and len(bad) == 1 and "log.csv:9, column 't'" in bad[0]


def test_month_of_more_digits_than_a_machine_word_is_not_a_month() -> None:
    cell = "9" * 40 + "-28-2025 17:30:22"
    _, readable = Calendar(("t",), "mdy", "gps", None).to_gps([pa.array([cell])])
    assert not readable.any()


@pytest.mark.parametrize(
    ("cell", "order"),
    [
        ("24-Sep-2025 09:34:42.010", None),
        ("24 September 2025 09:34:42.010", None),
        ("24SEP2025T093442.01", "mdy"),
        ("Sep 24, 2025 09:34:42.010", "dmy"),
        ("2025-Sep-24T09:34:42.010", None),
        ("2025:267:09:34:42.01", None),
        ("2025-267T09:34:42.010", "dmy"),
        ("2025 267 093442.010", None),
        ("2025-09-24 09:34:42:010", None),
        ("24.09.2025 09:34:42:010", "dmy"),
        ("24092025 093442.010", "dmy"),
        ("09242025T093442.010", "mdy"),
        ("240925T093442.010", "dmy"),
        ("092425 09:34:42.010", "mdy"),
        ("250924 09:34:42.010", "ymd"),
    ],
)
def test_form_of_a_recorder_is_read_in_every_cell(tmp_path: Path, cell: str, order: str | None) -> None:
    declared: dict[str, object] = {} if order is None else {"date_order": order}
    t_ns, events = read(tmp_path, "t,x", [f'"{cell}",1'] * 9, {"time": "t"}, scale="gps", **declared)
    assert set(t_ns.tolist()) == {ns_of(dt.datetime(2025, 9, 24, 9, 34, 42, 10_000))} and not events


def test_form_with_colon_before_milliseconds_takes_a_zone(tmp_path: Path) -> None:
    t_ns, _ = read(tmp_path, "t,x", ["2025-09-24 11:34:42:010+02:00,1"], {"time": "t"}, scale="utc")
    assert t_ns[0] == ns_of(dt.datetime(2025, 9, 24, 9, 34, 42, 10_000), 18)


@pytest.mark.parametrize(("year", "digits"), [(1980, "80"), (1999, "99"), (2000, "00"), (2079, "79")])
def test_year_of_two_digits_is_of_the_time_of_gps(tmp_path: Path, year: int, digits: str) -> None:
    row = [f"2409{digits} 093442,1"]
    t_ns, _ = read(tmp_path, "t,x", row, {"time": "t"}, scale="gps", date_order="dmy")
    assert t_ns[0] == ns_of(dt.datetime(year, 9, 24, 9, 34, 42))


def test_dates_and_times_of_nmea_in_two_columns_are_one_moment(tmp_path: Path) -> None:
    columns = {"time": "clock", "date": "day"}
    for day in ("240925", "24092025"):
        rows = [f"{day},093442.{k}00,1" for k in range(10)]
        t_ns, events = read(tmp_path, "day,clock,x", rows, columns, scale="gps", date_order="dmy")
        first = ns_of(dt.datetime(2025, 9, 24, 9, 34, 42))
        assert t_ns.tolist() == [first + k * 100_000_000 for k in range(10)] and not events


def test_seconds_of_the_day_beside_a_date_are_read_where_declared(tmp_path: Path) -> None:
    rows = ["2025-09-24,34482.25,1", "2025-09-24,7,1", "2025-09-24,86399.999999999,1", "2025-09-24,86400,1"]
    columns = {"time": "clock", "date": "day"}
    t_ns, events = read(tmp_path, "day,clock,x", rows, columns, scale="gps", unit="s")
    day = ns_of(dt.datetime(2025, 9, 24))
    assert (t_ns - day).tolist() == [34_482_250_000_000, 7_000_000_000, 86_399_999_999_999]
    assert ["log.csv:5" in event.detail for event in events] == [True]


@pytest.mark.parametrize(
    ("date", "clock"),
    [
        ("2025,9,24", "9,4,3.5"),
        ("2025,09,24", "09,04,03.500000000"),
        ("2025.0,9.0,24.0", "9.0,4.0,3.5"),
        (" 2025 , 9, 24", "9 ,4, 3.50"),
    ],
)
def test_year_month_day_hour_minute_and_second_may_have_a_column_each(
    tmp_path: Path, date: str, clock: str
) -> None:
    columns = {"date": ["Y", "M", "D"], "time": ["h", "min", "s"]}
    t_ns, events = read(tmp_path, "Y,M,D,h,min,s,x", [f"{date},{clock},1"] * 9, columns, scale="gps")
    assert set(t_ns.tolist()) == {ns_of(dt.datetime(2025, 9, 24, 9, 4, 3, 500_000))} and not events


@pytest.mark.parametrize("day", ["3", "03", "003", "3.0", " 3"])
@pytest.mark.parametrize(
    ("clock", "header", "keys"),
    [
        ("32643.5", "sod", {"time": "sod", "unit": "s"}),
        ("09:04:03.5", "t", {"time": "t"}),
        ("9,4,3.5", "h,min,s", {"time": ["h", "min", "s"]}),
    ],
)
def test_year_and_day_of_the_year_may_have_a_column_each(
    tmp_path: Path, day: str, clock: str, header: str, keys: dict[str, str]
) -> None:
    columns = {"date": ["year", "doy"], "time": keys["time"]}
    unit = {key: value for key, value in keys.items() if key == "unit"}
    rows = [f"2023,365,{clock},1", f"2024,{day},{clock},1", f"2024,60,{clock},1", f"2023,366,{clock},1"]
    t_ns, events = read(tmp_path, f"year,doy,{header},x", rows, columns, scale="gps", **unit)
    days = ((2023, 12, 31), (2024, 1, 3), (2024, 2, 29))
    assert t_ns.tolist() == [ns_of(dt.datetime(*each, 9, 4, 3, 500_000)) for each in days]
    assert ["log.csv:5" in event.detail for event in events] == [True]  # 2023 has no such day


@pytest.mark.parametrize("name", ["DOY", "day_of_year", "Day of the Year", "yday", "julian day", "#2"])
def test_days_of_the_year_are_named_as_such_or_declared(tmp_path: Path, name: str) -> None:
    declared = {"date_order": "yd"} if name == "#2" else {}
    log = LogTable.model_validate(
        {
            "columns": {"date": ["year", name], "time": "t"},
            "time": {"origin": "calendar", "scale": "gps", **declared},
        }
    )
    assert log.columns.date_names == ("year", name)


def test_declared_days_of_the_year_need_no_such_name(tmp_path: Path) -> None:
    columns = {"date": ["jahr", "tag"], "time": "t"}
    t_ns, _ = read(tmp_path, "jahr,tag,t,x", ["2024,60,09:00:00,1"], columns, scale="gps", date_order="yd")
    assert t_ns.tolist() == [ns_of(dt.datetime(2024, 2, 29, 9))]


@pytest.mark.parametrize(
    ("date", "order", "told"),
    [
        (["year", "month"], None, "'month' does not say"),
        (["year", "day"], None, "three columns: years, months, days"),
        (["#1", "#2"], None, "time.date_order = 'yd'"),
        (["year", "doy"], "dmy", "leave date_order out"),
        (["year", "month", "day"], "yd", "to two columns"),
        ("day", "yd", "to two columns"),
    ],
)
def test_two_columns_of_a_date_that_do_not_say_what_they_count_are_refused(
    date: list[str] | str, order: str | None, told: str
) -> None:
    time = {"origin": "calendar", "scale": "gps"} | ({} if order is None else {"date_order": order})
    with pytest.raises(ValidationError, match=told):
        LogTable.model_validate({"columns": {"date": date, "time": "t"}, "time": time})


def test_hour_minute_and_second_columns_go_with_a_declared_date_or_one_column_of_dates(
    tmp_path: Path,
) -> None:
    rows = ["23,59,59.75,1", "0,0,0,1", "0,0,0.25,1"]
    first = ns_of(dt.datetime(2025, 9, 24, 23, 59, 59, 750_000), 18)
    wanted = [first + k * 250_000_000 for k in range(3)]
    t_ns, events = read(tmp_path, "h,m,s,x", rows, {"time": ["h", "m", "s"]}, scale="utc", date="2025-09-24")
    assert t_ns.tolist() == wanted and "midnight_crossover" in {event.kind for event in events}
    dated = [f"{'24.09.2025' if row[0] == '2' else '25.09.2025'},{row}" for row in rows]
    columns = {"date": "day", "time": ["h", "m", "s"]}
    t_ns, _ = read(tmp_path, "day,h,m,s,x", dated, columns, scale="utc", date_order="dmy")
    assert t_ns.tolist() == wanted


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"date": ["Y"], "time": "t"}, "two or three different ones"),
        ({"date": "day", "time": ["h", "m"]}, "or three different ones"),
        ({"date": ["Y", "M", "M"], "time": "t"}, "three different ones"),
        ({"time": ["h", "m", "s"]}, "needs a date"),
        ({"date": ["Y", "M", "D"], "time": ["h", "m", "Y"]}, "'Y' is named for two things"),
    ],
)
def test_parts_of_a_date_that_do_not_make_one_are_refused(columns: dict[str, object], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        LogTable.model_validate({"columns": columns, "time": {"origin": "calendar", "scale": "utc"}})


@pytest.mark.parametrize(
    "bad", ["2025,13,24,9,4,3.5", "2025,9,31,9,4,3.5", "2025,9,24,9,60,3.5", "2025,9,24,,4,3"]
)
def test_impossible_part_of_a_date_refuses_its_row_and_names_all_columns(tmp_path: Path, bad: str) -> None:
    columns = {"date": ["Y", "M", "D"], "time": ["h", "m", "s"]}
    rows = [*["2025,9,24,9,4,3.5,1"] * 20, f"{bad},1"]
    t_ns, events = read(tmp_path, "Y,M,D,h,m,s,x", rows, columns, scale="gps")
    told = [event.detail for event in events if event.kind == "bad_row"]
    assert len(t_ns) == 20 and len(told) == 1 and "log.csv:22, column 'Y' and 'M' and 'D' and 'h'" in told[0]


@pytest.mark.parametrize("cell", ["2012025 093442", "9092025 093442", "10925 093442", "2025:366:09:34:42"])
def test_digits_with_a_zero_left_out_are_no_other_date(cell: str) -> None:
    for order in ("ymd", "dmy", "mdy"):
        _, readable = Calendar(("t",), order, "gps", None, is_order_declared=True).to_gps([pa.array([cell])])
        assert not readable[0]


@pytest.mark.parametrize(
    "cell", ["2025-08-28T17:30:22Z", "2025-08-28 17:30:22.5+02", "28-Aug-2025 17:30 UTC"]
)
def test_zone_where_gps_time_is_declared_is_an_error_that_names_the_key(tmp_path: Path, cell: str) -> None:
    rows = ["2025-08-28 17:30:21,1"] * 3 + [f"{cell},1"]
    with pytest.raises(TimeError, match=r"log.csv:5, column 't', key 'time.scale': .* has a zone") as caught:
        read(tmp_path, "t,x", rows, {"time": "t"}, scale="gps")
    assert "scale = 'utc'" in caught.value.advice


def test_zone_in_a_column_of_times_contradicts_gps_time(tmp_path: Path) -> None:
    with pytest.raises(TimeError, match="'day' and 'clock'"):
        read(tmp_path, "day,clock,x", ["2025-08-28,17:30Z,1"], {"time": "clock", "date": "day"}, scale="gps")


@pytest.mark.parametrize(
    ("day", "clock", "advice"),
    [
        ("2025-09-24", "34482.000", "time.unit = 's'"),
        ("240925", "093442.000", "'dmy' if this is 2025-09-24"),
        ("24092025", "093442.000", "'dmy' if this is 2025-09-24"),
        ("24-Okt-2025", "09:34:42", "English names"),
    ],
)
def test_dates_of_two_columns_are_refused_with_the_key_that_reads_them(
    tmp_path: Path, day: str, clock: str, advice: str
) -> None:
    with pytest.raises(ColumnError) as caught:
        read(
            tmp_path, "day,clock,x", [f"{day},{clock},1"] * 20, {"time": "clock", "date": "day"}, scale="gps"
        )
    assert advice in caught.value.advice


@pytest.mark.parametrize(
    ("time", "cell", "advice"),
    [
        ({"origin": "calendar", "scale": "utc"}, "1756402222.961", "these are numbers"),
        ({"origin": "calendar", "scale": "utc"}, "17:30:22.961", "columns.date"),
        ({"origin": "calendar", "scale": "utc"}, "2025-08-28", "no time of day"),
        ({"origin": "calendar", "scale": "utc"}, "28.08.2025 17:30:22", "date_order"),
        ({"origin": "calendar", "scale": "utc", "date_order": "dmy"}, "2025-08-28T17:30:22", "'ymd'"),
        ({}, "2025-08-28T17:30:22.961Z", "origin = 'calendar' and scale = 'utc'"),
        ({"origin": "unix_epoch"}, "2025-08-28 17:30:22", "origin = 'calendar' and scale = 'utc'"),
        ({}, "17:30:22.961", "columns.date"),
        ({}, "2025-08-28", "columns.date"),
        ({"origin": "calendar", "scale": "utc"}, "45924.3991", "days since 1899-12-30"),
        ({"origin": "calendar", "scale": "utc"}, "24-Sep-2025", "no time of day"),
        ({"origin": "calendar", "scale": "utc"}, "24092025", "no time of day"),
        ({"origin": "calendar", "scale": "utc"}, "24/09/25 17:30:22", "'dmy' if this is 2025-09-24"),
        ({}, "24-Sep-2025 09:34:42.000", "origin = 'calendar' and scale = 'utc'"),
        ({}, "2025:267:09:34:42.0", "origin = 'calendar' and scale = 'utc'"),
        ({}, "24.09.2025 09:34:42", "origin = 'calendar', date_order = 'dmy' and scale = 'utc'"),
        ({}, "24-Sep-2025", "columns.date"),
        ({}, "abc", "which column holds what"),
    ],
)
def test_times_of_another_form_are_an_error_that_names_the_keys(
    tmp_path: Path, time: dict[str, str], cell: str, advice: str
) -> None:
    log = LogTable.model_validate({"columns": {"time": "t"}, "time": time})
    path = write_lines(tmp_path / "log.csv", ["x,t", *(f"1,{cell}" for _ in range(20))])
    with pytest.raises(ColumnError) as caught:
        read_timed_table(path, log, ColumnSelection(numeric=("x",)), WEEK)
    assert (caught.value.line, caught.value.column) == (2, "t")
    assert advice in caught.value.advice
    assert "decimal comma" not in str(caught.value) and "thousands" not in str(caught.value)


def test_dates_before_gps_time_began_are_an_error(tmp_path: Path) -> None:
    with pytest.raises(TimeError, match="1980"):
        read(tmp_path, "t,x", ["1975-01-01T00:00:00Z,1"] * 5, {"time": "t"}, scale="utc")


@pytest.mark.parametrize(
    ("settings", "word"),
    [
        ({"time": {"origin": "calendar"}}, "scale = 'utc'"),
        ({"time": {"origin": "calendar", "scale": "utc", "unit": "ms"}}, "unit applies to numbers"),
        ({"time": {"date_order": "dmy"}}, "origin = 'calendar'"),
        ({"columns": {"date": "d"}}, "time.origin = 'calendar'"),
        ({"columns": {"week": "w"}, "time": {"origin": "unix_epoch"}}, "time.origin = 'gps_week'"),
        ({"columns": {"time": 0}}, "counted from 1"),
    ],
)
def test_declarations_that_contradict_each_other_are_an_error(settings: dict[str, object], word: str) -> None:
    with pytest.raises(ValueError, match=word):
        LogTable.model_validate(settings)
