"""Tables as people write them: decimal commas, no header, weeks and bare PRNs give the table of the usual form."""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from insgnss.config.flight import Base, FlightConfig, Reference
from insgnss.config.strict import load_toml
from insgnss.errors import ColumnError, ConfigError, InputError, TimeError
from insgnss.log.csv.columns import ColumnSelection
from insgnss.log.csv.table import read_csv_table
from insgnss.log.gnss_csv import read_gnss
from insgnss.log.gnss_log import read_base
from insgnss.log.imu.csv_log import read_imu
from insgnss.log.reference import read_reference
from insgnss.log.satellites import normalised_name, numbered_name, system_letter
from insgnss.tables import Event
from tests.log.writing import (
    GNSS_HEADER,
    IMU_HEADER,
    WEEK,
    gnss_config,
    gnss_lines,
    imu_config,
    lines_of,
    rest,
    write_lines,
)

START_S = 385_980.0  # Thursday 11:13 GPS
WEEK_BEGIN = dt.datetime(1980, 1, 6) + dt.timedelta(weeks=WEEK)
IMU_NUMBERS = {"time": 1, "gyro": [2, 3, 4], "accel": [5, 6, 7]}


def unread(events: list[Event]) -> list[str]:
    return [event.detail for event in events if event.kind == "columns_not_read"]


@pytest.fixture
def rows(rng: np.random.Generator) -> list[list[str]]:
    """Return the cells of an inertial log."""
    return [line.split(",") for line in lines_of(rest(rng, n=60, start_s=START_S))]


def iso(cells: list[str], leap: int = 0) -> str:
    """Return the date of an inertial row's seconds of the week; its tags are whole milliseconds."""
    return f"{WEEK_BEGIN + dt.timedelta(milliseconds=round(float(cells[0]) * 1000) - leap * 1000):%Y-%m-%dT%H:%M:%S.%f}"


def with_comma(line: str, delimiter: str) -> str:
    return line.replace(",", delimiter).replace(".", ",")


Form = tuple[list[str], dict[str, Any]]  # lines and settings


def plain(rows: list[list[str]]) -> list[str]:
    return [",".join(row) for row in rows]


def iso_form(rows: list[list[str]]) -> Form:
    lines = [",".join([iso(row, 18) + "Z", *row[1:]]) for row in rows]
    return [IMU_HEADER, *lines], {"time": {"origin": "calendar", "scale": "utc"}}


def two_columns_form(rows: list[list[str]]) -> Form:
    lines = [";".join([*iso(row).split("T"), *row[1:]]) for row in rows]
    settings = {
        "columns": {"date": "day", "time": "clock"},
        "time": {"origin": "calendar", "scale": "gps"},
    }
    return [IMU_HEADER.replace("time_s", "day,clock").replace(",", ";"), *lines], settings


def week_form(rows: list[list[str]]) -> Form:
    lines = [f"{WEEK}\t" + "\t".join(row) for row in rows]
    return ["week\t" + IMU_HEADER.replace(",", "\t"), *lines], {"columns": {"week": "week"}}


def comma_form(delimiter: str) -> Callable[[list[list[str]]], Form]:
    def form(rows: list[list[str]]) -> Form:
        lines = [with_comma(line, delimiter) for line in plain(rows)]
        return [IMU_HEADER.replace(",", delimiter), *lines], {"decimal": ","}

    return form


def headerless_form(delimiter: str) -> Callable[[list[list[str]]], Form]:
    return lambda rows: ([delimiter.join(row) for row in rows], {"columns": IMU_NUMBERS})


def headerless_comma_form(rows: list[list[str]]) -> Form:
    return [with_comma(line, ";") for line in plain(rows)], {"columns": IMU_NUMBERS, "decimal": ","}


def numbered_form(rows: list[list[str]]) -> Form:
    """Columns by number of a file that has a header, in another order and with a column more."""
    lines = [",".join(["on", *reversed(row)]) for row in rows]
    columns = {"time": 8, "gyro": [7, 6, 5], "accel": [4, 3, 2]}
    return ["state,az,ay,ax,gz,gy,gx,t", *lines], {"columns": columns}


def blanks_with_dates_form(rows: list[list[str]]) -> Form:
    """Dates and times parted by blanks, as positioning programs write them, under a header in a comment."""
    lines = [" ".join([*iso(row).replace("-", "/").split("T"), *row[1:]]) for row in rows]
    settings = {
        "columns": {"date": 1, "time": 2, "gyro": [3, 4, 5], "accel": [6, 7, 8]},
        "time": {"origin": "calendar", "scale": "gps"},
    }
    return ["%  GPST   gx gy gz ax ay az", *lines], settings


FORMS: dict[str, Callable[[list[list[str]]], Form]] = {
    "iso": iso_form,
    "date and time": two_columns_form,
    "week and seconds": week_form,
    "decimal comma, semicolon": comma_form(";"),
    "decimal comma, tab": comma_form("\t"),
    "decimal comma, blanks": comma_form("   "),
    "no header": headerless_form(","),
    "no header, tab": headerless_form("\t"),
    "no header, blanks": headerless_form("  "),
    "no header, decimal comma": headerless_comma_form,
    "by number": numbered_form,
    "blanks, dates": blanks_with_dates_form,
}


@pytest.mark.parametrize("bad_row", [False, True])
@pytest.mark.parametrize("form", FORMS)
def test_inertial_log_of_each_form_is_that_of_the_usual_form(
    tmp_path: Path, rows: list[list[str]], form: str, bad_row: bool
) -> None:
    """With a bad row too, which sends the file the exact way."""
    usual, _ = read_imu(imu_config(write_lines(tmp_path / "usual.csv", [IMU_HEADER, *plain(rows)])), WEEK)
    lines, settings = FORMS[form](rows)
    lines = [*lines, "garbage"] if bad_row else lines
    table, events = read_imu(imu_config(write_lines(tmp_path / "imu.csv", lines), **settings), WEEK)
    assert np.array_equal(table.t_ns, usual.t_ns)
    assert np.array_equal(table.w_ib_b, usual.w_ib_b) and np.array_equal(table.f_b, usual.f_b)
    bad = [event.detail for event in events if event.kind == "bad_row"]
    assert len(bad) == bad_row and all(f"imu.csv:{len(lines)}:" in detail for detail in bad)


def test_bad_cell_of_each_time_column_is_told_with_its_line(tmp_path: Path, rows: list[list[str]]) -> None:
    lines, settings = two_columns_form(rows)
    lines[5] = lines[5].replace(":", "x", 1)
    _, events = read_imu(imu_config(write_lines(tmp_path / "imu.csv", lines), **settings), WEEK)
    assert any("imu.csv:6, column 'day' and 'clock': '2023-" in event.detail for event in events)
    lines, settings = week_form(rows)
    lines[5] = lines[5].replace(str(WEEK), f"{WEEK}.5", 1)
    lines[7] = lines[7].replace(str(WEEK), "-1", 1)
    _, events = read_imu(imu_config(write_lines(tmp_path / "imu.csv", lines), **settings), WEEK)
    told = [event.detail for event in events if event.kind == "bad_row"]
    assert [f"imu.csv:{line}, column 'week' and 'time_s'" in told[k] for k, line in enumerate((6, 8))] == [
        True
    ] * 2


def test_week_column_counts_over_the_weeks_end(tmp_path: Path, rows: list[list[str]]) -> None:
    cells = [[f"{(604_799.8 + 0.01 * k) % 604_800:.9f}", *row[1:]] for k, row in enumerate(rows)]
    lines, settings = week_form(cells)
    lines[1:] = [
        line.replace(str(WEEK), str(WEEK + 1), 1) if float(line.split("\t")[1]) < 1e5 else line
        for line in lines[1:]
    ]
    table, events = read_imu(imu_config(write_lines(tmp_path / "imu.csv", lines), **settings), WEEK - 3)
    assert set(np.diff(table.t_ns).tolist()) == {10_000_000}
    assert table.t_ns[20] == (WEEK + 1) * 604_800 * 10**9
    assert [event.kind for event in events] == ["csv_delimiter"]


def test_column_of_weeks_without_weeks_is_an_error(tmp_path: Path, rows: list[list[str]]) -> None:
    lines = [f"{k * 0.1:.1f}," + ",".join(row) for k, row in enumerate(rows)]
    path = write_lines(tmp_path / "imu.csv", ["week," + IMU_HEADER, *lines])
    with pytest.raises(TimeError, match="column 'week' and 'time_s'"):
        read_imu(imu_config(path, columns={"week": "week"}), WEEK)


def test_decimal_commas_that_are_not_declared_are_an_error_that_names_the_key(
    tmp_path: Path, rows: list[list[str]]
) -> None:
    lines, _ = comma_form(";")(rows)
    with pytest.raises(ColumnError, match="decimal = ','"):
        read_imu(imu_config(write_lines(tmp_path / "imu.csv", lines)), WEEK)


def test_decimal_points_in_a_file_declared_with_commas_are_an_error(
    tmp_path: Path, rows: list[list[str]]
) -> None:
    path = write_lines(tmp_path / "imu.csv", [IMU_HEADER, *plain(rows)])
    with pytest.raises(ColumnError, match="has a decimal point") as caught:
        read_imu(imu_config(path, decimal=","), WEEK)
    assert (caught.value.line, caught.value.column) == (2, "time_s")


def test_quoted_decimal_commas_between_commas_are_read(tmp_path: Path) -> None:
    path = write_lines(tmp_path / "log.csv", ['"t","x"', '"1,5","-2,25"', '"2,5","+1,0e1"'])
    table = read_csv_table(path, ColumnSelection(numeric=("t", "x"), decimal=","))
    assert table.columns["t"].tolist() == [1.5, 2.5] and table.columns["x"].tolist() == [-2.25, 10.0]


@pytest.mark.parametrize("bad_row", [[], ["x;1"]])
def test_exact_times_keep_each_nanosecond_behind_a_decimal_comma(tmp_path: Path, bad_row: list[str]) -> None:
    rows = [f"1700000000,{k:09d};1" for k in range(1, 100)]
    path = write_lines(tmp_path / "log.csv", ["t;x", *rows, *bad_row])
    table = read_csv_table(path, ColumnSelection(numeric=("x",), exact={"t": 9}, decimal=","))
    assert np.array_equal(table.exact["t"], 1_700_000_000 * 10**9 + np.arange(1, 100))


@pytest.mark.parametrize("bad_row", [[], ["x,1"]])
@pytest.mark.parametrize("cell", ["1756402222961000000", "-1756402222961000000"])
def test_number_beyond_all_dates_does_not_wrap_into_one(
    tmp_path: Path, cell: str, bad_row: list[str]
) -> None:
    path = write_lines(tmp_path / "log.csv", ["t,x", *[f"{cell},1"] * 50, *bad_row])
    table = read_csv_table(path, ColumnSelection(numeric=("x",), exact={"t": 9}))
    assert (np.abs(table.exact["t"]) == 2**63 - 1).all()


def test_file_without_a_header_is_told_how_to_be_declared(tmp_path: Path, rows: list[list[str]]) -> None:
    with pytest.raises(ColumnError, match=r"give every column by its number \(time = 1"):
        read_imu(imu_config(write_lines(tmp_path / "imu.csv", plain(rows))), WEEK)


def test_observations_without_a_header_are_told_how_to_be_declared(tmp_path: Path) -> None:
    with pytest.raises(ColumnError, match=r"give every column by its number \(time = 1"):
        read_gnss(gnss_config(write_lines(tmp_path / "gnss.csv", gnss_lines())), WEEK)


def test_number_beyond_the_columns_is_an_error(tmp_path: Path, rows: list[list[str]]) -> None:
    path = write_lines(tmp_path / "imu.csv", plain(rows))
    with pytest.raises(ColumnError, match="has 7 columns") as caught:
        read_imu(imu_config(path, columns=IMU_NUMBERS | {"accel": [5, 6, 8]}), WEEK)
    assert caught.value.column == "#8" and caught.value.line == 1


def test_first_line_without_a_header_is_a_row_like_any(tmp_path: Path, rows: list[list[str]]) -> None:
    lines = plain(rows)
    lines[0] = lines[0].replace("0.", "o.", 1)
    _, events = read_imu(imu_config(write_lines(tmp_path / "imu.csv", lines), columns=IMU_NUMBERS), WEEK)
    assert [event.kind for event in events] == ["bad_row"] and "imu.csv:1, column '#" in events[0].detail


def test_empty_file_of_numbered_columns_is_a_typed_error(tmp_path: Path) -> None:
    with pytest.raises(InputError):
        read_imu(imu_config(write_lines(tmp_path / "imu.csv", ["# nothing"]), columns=IMU_NUMBERS), WEEK)


FLIGHT = """
gps_week = 2381
[imu]
files = ["imu.txt"]
grade = "mems_consumer"
decimal = ","
columns = { date = 1, time = 2, gyro = [3, 4, 5], accel = [6, 7, 8] }
time = { origin = "calendar", date_order = "dmy", scale = "utc" }
[gnss]
files = ["gnss.txt"]
system_codes = { 1 = "G", 6 = "E" }
columns = { week = "Week", time = "TOW", system = "Sys", sv = "PRN" }
[gnss.base]
files = ["base.csv"]
format = "csv"
system = "G"
lat_deg = 1.0
lon_deg = 2.0
h_m = 3.0
columns = { time = 1 }
"""


def test_flight_file_declares_tables_of_any_form(tmp_path: Path) -> None:
    path = tmp_path / "flight.toml"
    path.write_text(FLIGHT)
    config = load_toml(path, FlightConfig)
    assert config.imu.columns.gyro == ("#3", "#4", "#5") and config.imu.columns.chosen_names()[0] == "#2"
    assert config.gnss.system_codes == {"1": "G", "6": "E"}
    assert config.gnss.base is not None and config.gnss.base.columns.time == "#1"


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("date = 1", "date = 0", "imu.columns.date"),
        (', scale = "utc"', "", "imu.time"),
        ('origin = "calendar", date_order = "dmy", ', "", "imu"),
        ('6 = "E"', '6 = "X"', "gnss.system_codes.6"),
        ('system = "Sys", ', "", "gnss"),
        ('files = ["gnss.txt"]', 'files = ["gnss.txt"]\nsystem = "G"', "gnss"),
    ],
)
def test_declaration_that_cannot_be_names_its_key(tmp_path: Path, old: str, new: str, key: str) -> None:
    path = tmp_path / "flight.toml"
    path.write_text(FLIGHT.replace(old, new, 1))
    with pytest.raises(ConfigError) as caught:
        load_toml(path, FlightConfig)
    assert caught.value.key == key and caught.value.line is not None


# ------------------------------------------------------------------------------------------------ satellites


def gnss(folder: Path, lines: list[str], **settings: object) -> tuple[list[str], list[Event]]:
    table, events = read_gnss(gnss_config(write_lines(folder / "gnss.csv", lines), **settings), WEEK)
    return [table.sv_names[index] for index in table.sv], events


NAMES = ("G05", "E07", "R13", "C30")
CODES = {"G": "0", "E": "2", "R": "6", "C": "3"}


def bare(system: Callable[[str], str], number: Callable[[int], str] = str) -> list[str]:
    """Return a log whose satellites are numbers beside a column of constellations."""
    lines = []
    for line in gnss_lines(5, NAMES):
        time, name, signal, *others = line.split(",")
        signal = "C2I" if name[0] == "C" else signal
        lines.append(",".join([time, system(name[0]), number(int(name[1:])), signal, *others]))
    return [GNSS_HEADER.replace("sv", "sys,prn"), *lines]


WORDS = {"G": "GPS", "E": "Galileo", "R": "glonass", "C": "BeiDou"}


@pytest.mark.parametrize(
    ("lines", "settings"),
    [
        (bare(lambda letter: letter), {}),
        (bare(lambda letter: f" {letter.lower()} "), {}),
        (bare(WORDS.__getitem__), {}),
        (bare(CODES.__getitem__), {"system_codes": {code: letter for letter, code in CODES.items()}}),
        (
            bare(lambda letter: CODES[letter] + ".0", lambda number: f"{number}.0"),
            {"system_codes": {code: letter for letter, code in CODES.items()}},
        ),
        (bare(lambda letter: letter, lambda number: f"{number:03d}"), {}),
    ],
    ids=["letters", "small letters", "words", "numbers", "floats", "zeros"],
)
def test_bare_numbers_with_their_constellation_name_the_satellites(
    tmp_path: Path, lines: list[str], settings: dict[str, object]
) -> None:
    names, events = gnss(tmp_path, lines, columns={"sv": "prn", "system": "sys"}, **settings)
    assert names == list(NAMES) * 5 and events == []


@pytest.mark.parametrize("before", ["", "PRN", "PRN ", "prn-"])
def test_bare_numbers_of_a_declared_constellation_name_the_satellites(tmp_path: Path, before: str) -> None:
    lines = [GNSS_HEADER, *(line.replace(",G", f",{before}") for line in gnss_lines(5))]
    names, events = gnss(tmp_path, lines, system="G")
    assert names == ["G05", "G07", "G13", "G30"] * 5 and events == []


def test_bare_numbers_without_a_constellation_are_an_error_that_names_the_keys(tmp_path: Path) -> None:
    lines = [GNSS_HEADER, *(line.replace(",G", ",") for line in gnss_lines(5))]
    with pytest.raises(ColumnError, match=r"gnss\.columns\.system.*gnss\.system = 'G'"):
        gnss(tmp_path, lines)


def test_codes_of_constellations_that_nobody_declares_are_an_error_that_names_the_key(tmp_path: Path) -> None:
    with pytest.raises(ColumnError, match=r"gnss\.system_codes = \{ 0 = 'G'") as caught:
        gnss(tmp_path, bare(CODES.__getitem__), columns={"sv": "prn", "system": "sys"})
    assert caught.value.column == "sys"


@pytest.mark.parametrize(
    ("code", "key"), [("GPS L1", '"GPS L1" ='), ("", '"" ='), ("1.5", '"1.5" ='), ("g_1", "g_1 =")]
)
def test_proposed_key_has_the_quotes_that_toml_needs(tmp_path: Path, code: str, key: str) -> None:
    with pytest.raises(ColumnError) as caught:
        gnss(tmp_path, bare(lambda _: code), columns={"sv": "prn", "system": "sys"})
    assert f"gnss.system_codes = {{ {key} 'G'" in caught.value.advice


def test_names_that_all_contradict_the_constellation_are_an_error_that_says_so(tmp_path: Path) -> None:
    lines = bare(lambda _: "R", lambda number: f"G{number:02d}")
    with pytest.raises(ColumnError, match="its name says G, the column 'sys' says R"):
        gnss(tmp_path, lines, columns={"sv": "prn", "system": "sys"})


def test_one_constellation_and_a_column_of_them_contradict_each_other() -> None:
    with pytest.raises(ValueError, match=r"system = 'G' declares one constellation.*columns.system = 'sys'"):
        gnss_config(Path("gnss.csv"), system="G", columns={"system": "sys"})


def test_rows_of_a_code_that_is_not_declared_are_refused_with_the_key(tmp_path: Path) -> None:
    codes = {code: letter for letter, code in CODES.items() if letter != "E"}
    columns = {"sv": "prn", "system": "sys"}
    names, events = gnss(tmp_path, bare(CODES.__getitem__), columns=columns, system_codes=codes)
    assert names == ["G05", "R13", "C30"] * 5
    assert [event.kind for event in events] == ["bad_row"]
    assert "'7' of constellation '2'" in events[0].detail and "gnss.system_codes" in events[0].detail


def test_rows_whose_two_columns_contradict_each_other_are_refused_with_an_event(tmp_path: Path) -> None:
    lines = bare(lambda letter: letter, lambda number: f"G{number:02d}")
    names, events = gnss(tmp_path, lines, columns={"sv": "prn", "system": "sys"})
    assert names == ["G05"] * 5
    assert [event.kind for event in events] == ["bad_row"] * 3
    assert "'G07' of constellation 'E' names no satellite; 5 row(s) refused" in events[0].detail
    assert "its name says G, the column 'sys' says E" in events[0].detail


@pytest.mark.parametrize(
    ("system", "number", "name"),
    [
        ("J", 193, "J01"),
        ("S", 120, "S20"),
        ("R", 65, "R01"),
        ("R", 24, "R24"),
        ("G", 0, None),
        ("E", 51, None),
    ],
)
def test_prns_of_each_constellation_are_counted_as_in_rinex(
    system: str, number: int, name: str | None
) -> None:
    assert numbered_name(system, number) == name
    assert normalised_name(f"{system}{number}") == name


def test_code_of_a_constellation_goes_before_its_name() -> None:
    assert (
        system_letter("E", {}) == "E" and system_letter("gal", {}) == "E" and system_letter("7", {}) is None
    )
    assert system_letter("E", {"E": "S"}) == "S" and system_letter("01", {"1": "G"}) == "G"


# ------------------------------------------------------------------------------------- the other tables, unread columns


def test_observations_of_all_forms_at_once_are_those_of_the_usual_form(tmp_path: Path) -> None:
    usual, _ = read_gnss(gnss_config(write_lines(tmp_path / "u.csv", [GNSS_HEADER, *gnss_lines()])), WEEK)
    lines = []
    for line in gnss_lines():
        time, name, *others = line.split(",")
        clock = f"{WEEK_BEGIN + dt.timedelta(seconds=float(time)):%d/%m/%Y;%H:%M:%S,%f}"
        lines.append(";".join([clock, "1", name[1:], *(cell.replace(".", ",") for cell in others)]))
    columns = {
        "date": 1,
        "time": 2,
        "system": 3,
        "sv": 4,
        "signal": 5,
        "pseudorange": 6,
        "doppler": 7,
        "cn0": 8,
    }
    time = {"origin": "calendar", "date_order": "dmy", "scale": "gps"}
    settings = {"columns": columns, "time": time, "decimal": ",", "system_codes": {"1": "G"}}
    path = write_lines(tmp_path / "gnss.csv", lines)
    table, _ = read_gnss(gnss_config(path, **settings), WEEK)
    for name in ("t_ns", "sv", "pseudorange_m", "doppler_hz", "cn0_dbhz"):
        assert np.array_equal(getattr(table, name), getattr(usual, name))
    base = Base.model_validate(
        {"files": [path], "format": "csv", "lat_deg": 1, "lon_deg": 2, "h_m": 3, **settings}
    )
    assert np.array_equal(read_base(base, WEEK).gnss.t_ns, usual.t_ns)


def test_reference_of_dates_without_a_header_is_read(tmp_path: Path) -> None:
    lines = ["2023/06/29 11:13:00.000 48,5 9,25 300,5 1", "2023/06/29 11:13:01.000 48,6 9,25 300,5 2"]
    columns = {"date": 1, "time": 2, "position": [3, 4, 5], "quality": 6}
    config = Reference.model_validate(
        {
            "file": write_lines(tmp_path / "reference.pos", lines),
            "columns": columns,
            "time": {"origin": "calendar", "scale": "gps"},
            "decimal": ",",
        }
    )
    table, _ = read_reference(config, WEEK)
    first = (dt.datetime(2023, 6, 29, 11, 13) - dt.datetime(1980, 1, 6)) // dt.timedelta(seconds=1) * 10**9
    assert table.t_ns.tolist() == [first, first + 10**9]
    assert table.lat_deg.tolist() == [48.5, 48.6] and table.quality.tolist() == [1.0, 2.0]


def test_columns_that_nothing_reads_are_told_once_a_file(tmp_path: Path, rows: list[list[str]]) -> None:
    lines = [line + ",23.5,1" for line in plain(rows)]
    path = write_lines(tmp_path / "imu.csv", [IMU_HEADER + ",temperature,", *lines])
    _, events = read_imu(imu_config(path), WEEK)
    assert [event.kind for event in events] == ["columns_not_read"]
    assert unread(events)[0].endswith("imu.csv has further columns: temperature, #9")


def test_unread_columns_of_observations_name_the_keys_of_cn0_and_carrier(tmp_path: Path) -> None:
    header = GNSS_HEADER.replace("cn0_dbhz", "snr") + ",adr"
    names, events = gnss(tmp_path, [header, *(line + ",1.5" for line in gnss_lines(5))])
    assert len(names) == 20 and len(unread(events)) == 1
    assert "has further columns: snr, adr" in unread(events)[0]
    assert "gnss.columns.cn0 or gnss.columns.carrier" in unread(events)[0]
    columns = {"cn0": "snr", "carrier": "adr"}
    assert (
        unread(gnss(tmp_path, [header, *(line + ",1.5" for line in gnss_lines(5))], columns=columns)[1]) == []
    )
