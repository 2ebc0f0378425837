"""The CSV reader: clean files of any dialect give the same numbers, and no bad row is dropped silently."""

from __future__ import annotations

import gzip
import time
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from insgnss.errors import ColumnError, InputError, MissingFileError
from insgnss.log.csv import table as csv_fast
from insgnss.log.csv.cells import integers
from insgnss.log.csv.columns import ColumnSelection
from insgnss.log.csv.table import CsvTable, read_csv_table
from tests.log.writing import write_lines

WANTED = ColumnSelection(numeric=("time_s", "x"), optional=("y",), text=("name",))
HEADER = "time_s,x,y,name"
ROWS = [f"{k}.5,{k * 0.25},{-k},n{k % 3}" for k in range(100)]


def read(path: Path, lines: list[str], end: str = "\n") -> CsvTable:
    return read_csv_table(write_lines(path / "log.csv", lines, end), WANTED)


def assert_complete(table: CsvTable, rows: int = 100) -> None:
    assert table.n == rows
    assert np.array_equal(table.columns["time_s"], np.arange(rows) + 0.5)
    assert np.array_equal(table.columns["x"], np.arange(rows) * 0.25)
    assert np.array_equal(table.columns["y"], -np.arange(rows, dtype=float))
    names = table.text["name"]
    assert [names.words[code] for code in names.codes[:4]] == ["n0", "n1", "n2", "n0"]


def swapped(delimiter: str) -> list[str]:
    return [line.replace(",", delimiter) for line in (HEADER, *ROWS)]


@pytest.mark.parametrize(
    "lines",
    [
        [HEADER, *ROWS],
        ["# a comment", "% another", "// and a third", "", HEADER, *ROWS],
        [HEADER, *ROWS[:50], "# a comment, in, the, middle", "% another", "// and a third", *ROWS[50:]],
        [HEADER, "", *ROWS[:50], "   ", *ROWS[50:], "", ""],
        [" time_s , x , y , name ", *(row.replace(",", " ,  ") for row in ROWS)],
        ['"time_s","x","y","name"', *ROWS],
        [HEADER, *(row + "," for row in ROWS)],
        [HEADER, *(f'"{row.split(",")[0]}",{row.split(",", 1)[1]}' for row in ROWS)],
        [HEADER, *("+" + row for row in ROWS)],
        ["# " + HEADER, "# seconds, metres", *ROWS],
    ],
    ids=[
        "plain",
        "comment_first",
        "comments",
        "blank",
        "spaces",
        "quoted_names",
        "trailing",
        "quoted",
        "plus",
        "in_comment",
    ],
)
def test_harmless_variants_read_the_same(tmp_path: Path, lines: list[str]) -> None:
    table = read(tmp_path, lines)
    assert_complete(table)
    assert not [event for event in table.events if event.kind == "bad_row"]


@pytest.mark.parametrize(
    ("above", "count"),
    [
        (["sep=,"], 1),
        (["# logger v1", "Serial: 123", "", "Date: 2025,,,", "a,b,c,d"], 3),
        (["; a comment of another language", "// logger"], 1),
        (["line"] * 99, 99),
    ],
)
@pytest.mark.parametrize("header", [HEADER, "# " + HEADER])
def test_lines_above_the_header_are_skipped_and_told_once(
    tmp_path: Path, above: list[str], count: int, header: str
) -> None:
    table = read(tmp_path, [*above, header, *ROWS])
    assert_complete(table)
    told = [event.detail for event in table.events if event.kind == "csv_lines_skipped"]
    assert told == [
        f"{tmp_path / 'log.csv'}: {count} line(s) above the header in line {len(above) + 1} skipped"
    ]
    assert not [event for event in table.events if event.kind == "bad_row"]
    assert table.line[0] == len(above) + 2


def test_first_of_two_lines_that_could_be_the_header_is_taken(tmp_path: Path) -> None:
    table = read(tmp_path, ["Serial: 1", HEADER, *ROWS[:50], HEADER, *ROWS[50:]])
    assert table.dialect.header_line == 2 and table.n == 100
    assert [event.kind for event in table.events][:2] == ["csv_lines_skipped", "bad_row"]


def test_line_by_number_follows_excel_s_mark(tmp_path: Path) -> None:
    wanted = ColumnSelection(numeric=("#1", "#2"))
    table = read_csv_table(write_lines(tmp_path / "log.csv", ["sep=;", "1.5;2.5", "2.5;3.5"]), wanted)
    assert table.n == 2 and [event.kind for event in table.events] == ["csv_delimiter", "csv_lines_skipped"]


def test_without_a_header_the_error_names_what_stands_there(tmp_path: Path) -> None:
    with pytest.raises(ColumnError, match="reads 'Serial: 123', and no line below it"):
        read(tmp_path, ["Serial: 123", *ROWS])
    with pytest.raises(ColumnError, match="nearest: 'time'; the file has time, x, y, name"):
        read(tmp_path, ["Serial: 123", "Date: 2025", "time,x,y,name", *ROWS])
    with pytest.raises(ColumnError, match="reads 'line'"):
        read(tmp_path, [*["line"] * 100, HEADER, *ROWS])  # more than a preamble


@pytest.mark.parametrize("delimiter", [";", "\t", "|", "   "])
def test_other_delimiters_are_recognised_and_told(tmp_path: Path, delimiter: str) -> None:
    table = read(tmp_path, swapped(delimiter))
    assert_complete(table)
    assert [event.kind for event in table.events] == ["csv_delimiter"]


@pytest.mark.parametrize("delimiter", [",", ";", "\t", "|", " "])
def test_quoted_names_that_hold_the_delimiter_are_found(tmp_path: Path, delimiter: str) -> None:
    names = (
        [f"time{delimiter}s", f"x{delimiter}of {delimiter}sensor", "y"]
        if delimiter != " "
        else ["t s", "x m", "y"]
    )
    header = delimiter.join(f'"{name}"' for name in (*names, 'the ""last"" one'))
    rows = [row.replace(",", delimiter) for row in ROWS]
    wanted = ColumnSelection(numeric=names[:2], optional=names[2:], text=('the "last" one',))
    table = read_csv_table(write_lines(tmp_path / "log.csv", [header, *rows]), wanted)
    assert table.n == 100 and np.array_equal(table.columns[names[1]], np.arange(100) * 0.25)
    assert [event.kind for event in table.events] == (["csv_delimiter"] if delimiter != "," else [])


@pytest.mark.parametrize("bad_row", [False, True])
@pytest.mark.parametrize("encoding", ["cp1252", "utf-8", "utf-8-sig"])
def test_degree_signs_and_powers_in_names_are_found(tmp_path: Path, encoding: str, bad_row: bool) -> None:
    names = ("time_s", "gyro_x [°/s]", "acc_x [m/s²]")
    path = tmp_path / "log.csv"
    rows = [*ROWS[:50], "x,1,1,Ü", *ROWS[50:]] if bad_row else ROWS
    path.write_bytes("\n".join([",".join((*names, "name")), *rows, ""]).encode(encoding))
    table = read_csv_table(path, ColumnSelection(numeric=names, optional_text=("name",)))
    assert table.n == 100 and np.array_equal(table.columns["gyro_x [°/s]"], np.arange(100) * 0.25)
    assert (table.lines is not None) == bad_row
    told = [event for event in table.events if event.kind == "csv_encoding"]
    assert len(told) == (encoding == "cp1252")
    assert all("log.csv:1: the header is not UTF-8, read as cp1252" in event.detail for event in told)


def test_missing_column_of_a_header_in_cp1252_is_named_with_the_nearest(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes("\n".join(["time_s,gyro_x [°/s]", "1,2", "2,3", ""]).encode("cp1252"))
    with pytest.raises(ColumnError, match=r"nearest: 'gyro_x \[°/s\]'"):
        read_csv_table(path, ColumnSelection(numeric=("time_s", "gyro_x [deg/s]")))


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_line_ends_do_not_matter(tmp_path: Path, end: str) -> None:
    assert_complete(read(tmp_path, [HEADER, *ROWS], end))


def test_mixed_line_ends_do_not_matter(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(
        "\r\n".join([HEADER, *ROWS[:50]]).encode() + b"\n" + "\n".join(ROWS[50:]).encode() + b"\r\n"
    )
    assert_complete(read_csv_table(path, WANTED))


def test_byte_order_mark_does_not_matter(tmp_path: Path) -> None:
    assert_complete(read(tmp_path, ["\ufeff" + HEADER, *ROWS]))


def test_gzipped_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "log.csv.gz"
    path.write_bytes(gzip.compress("\n".join([HEADER, *ROWS, ""]).encode()))
    assert_complete(read_csv_table(path, WANTED))


def test_column_order_does_not_matter(tmp_path: Path) -> None:
    rows = [",".join(reversed([*row.split(","), "9"])) for row in ROWS]
    assert_complete(read(tmp_path, ["extra,name,y,x,time_s", *rows]))


def test_last_line_without_an_end_is_kept_when_it_is_complete(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("\n".join([HEADER, *ROWS]))
    assert_complete(read_csv_table(path, WANTED))


@pytest.mark.parametrize("cut", ["99.5,24.7", "99.5,24.75,-", "9"])
def test_truncated_last_line_is_refused_with_an_event(tmp_path: Path, cut: str) -> None:
    path = tmp_path / "log.csv"
    path.write_text("\n".join([HEADER, *ROWS[:99], cut]))
    table = read_csv_table(path, WANTED)
    assert_complete(table, 99)
    assert [event.kind for event in table.events] == ["bad_row"]
    assert ":101" in table.events[0].detail


@pytest.mark.parametrize("delimiter", [",", " "])
@pytest.mark.parametrize(
    ("usual", "last", "kept"),
    [
        ("1.2345e-05", "1.23456789e-0", 99),  # longer than the others, and still without an exponent's digit
        ("1.2345e-05", "1.23456789e-06", 100),
        ("1.2345e-5", "1.23456789e-6", 100),
        ("-0.0123", "1234567.8e-7", 100),  # no other line tells how exponents are written
        ("1000.25", "100.2", 99),  # shorter than every last cell before, though its line is not
        ("1000.25", "100.252", 100),
    ],
)
def test_last_cell_without_a_line_end_is_held_against_those_before(
    tmp_path: Path, delimiter: str, usual: str, last: str, kept: int
) -> None:
    path = tmp_path / "log.csv"
    rows = [("t", "x"), *((f"{k}.5", usual) for k in range(99)), ("99.5000000000", last)]
    text = "\n".join(delimiter.join(row) for row in rows)
    path.write_text(text)
    table = read_csv_table(path, ColumnSelection(numeric=("t", "x")))
    assert table.n == kept
    refused = [event.detail for event in table.events if event.kind == "bad_row"]
    assert len(refused) == 100 - kept and all("ends in the middle" in detail for detail in refused)
    path.write_text(text + "\n")
    assert read_csv_table(path, ColumnSelection(numeric=("t", "x"))).n == 100


@pytest.mark.parametrize(("end", "kept"), [("", 99), ("\n", 100)])
def test_last_number_that_may_be_cut_is_refused(tmp_path: Path, end: str, kept: int) -> None:
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["t,x", *(f"{k}.5,{k + 1000}.25" for k in range(99)), "99.5,1"]) + end)
    table = read_csv_table(path, ColumnSelection(numeric=("t", "x")))
    assert table.n == kept
    assert [event.kind for event in table.events] == ["bad_row"] * (100 - kept)


@pytest.mark.parametrize(
    "cell", ["abc", "", "nan", "NaN", "inf", "-inf", "1e999", "0x10", "1_0", "--1", "1.2.3", "5 5"]
)
def test_bad_cell_of_a_required_column_refuses_its_row_by_line_and_column(tmp_path: Path, cell: str) -> None:
    lines = [HEADER, *ROWS]
    lines[40] = f"39.5,{cell},-39,n0"
    table = read(tmp_path, lines)
    assert table.n == 99
    assert 39.5 not in table.columns["time_s"]
    assert len(table.events) == 1
    event = table.events[0]
    assert event.kind == "bad_row"
    assert "log.csv:41, column 'x'" in event.detail
    assert (repr(cell) in event.detail) or (cell == "" and "empty cell" in event.detail)


def test_bad_row_lines_count_comments_and_blank_lines(tmp_path: Path) -> None:
    table = read(tmp_path, ["# one", "", HEADER, *ROWS[:10], "# two", "", "x,x,x,x", *ROWS[10:]])
    assert "log.csv:16" in table.events[0].detail
    assert table.line[9] == 13 and table.line[10] == 17


def test_line_of_each_row_skips_blank_lines_in_the_fast_path(tmp_path: Path) -> None:
    table = read(tmp_path, ["# one", HEADER, *ROWS[:10], "", *ROWS[10:]])
    assert table.lines is None
    assert table.line[0] == 3 and table.line[9] == 12 and table.line[10] == 14


@pytest.mark.parametrize("row", ["1,2,3", "1,2,3,4,5", "1,2\0,3,n", "\0\0\0"])
def test_row_with_a_wrong_number_of_cells_is_refused(tmp_path: Path, row: str) -> None:
    table = read(tmp_path, [HEADER, *ROWS, row])
    assert_complete(table)
    assert [event.kind for event in table.events] == ["bad_row"]


def test_optional_column_may_be_empty_absent_or_unreadable(tmp_path: Path) -> None:
    lines = [HEADER, *ROWS]
    lines[1] = "0.5,0,,n0"
    lines[2] = "1.5,0.25,inf,n1"
    lines[3] = "2.5,0.5,bad,n2"
    table = read(tmp_path, lines)
    assert table.n == 100
    assert np.isnan(table.columns["y"][:3]).all() and np.isfinite(table.columns["y"][3:]).all()
    assert table.bad_cells["y"].tolist() == [1, 2]
    assert [event.kind for event in table.events] == ["bad_cell", "bad_cell"]
    assert "y" not in read(tmp_path, ["time_s,x,name", "1,2,a"]).columns


def test_delimiter_behind_the_first_row_alone_is_not_a_column_of_another_log(tmp_path: Path) -> None:
    wanted = ColumnSelection(numeric=("t", "x"), measured=("x",))
    path = write_lines(tmp_path / "log.csv", ["t,x,y", "1,2,,", "2,,5", "3,4,"])
    table = read_csv_table(path, wanted)
    assert table.columns["x"].tolist() == [2.0, 4.0]
    assert [event.kind for event in table.events] == ["columns_not_read", "rows_of_other_logs"]


def test_infinite_optional_cell_alone_is_found(tmp_path: Path) -> None:
    table = read(tmp_path, [HEADER, *ROWS[:50], "50.5,0,inf,n0", *ROWS[51:]])
    assert np.isnan(table.columns["y"][50])
    assert table.bad_cells["y"].tolist() == [50]


def test_empty_and_odd_words_stay_words(tmp_path: Path) -> None:
    table = read(tmp_path, [HEADER, "1,2,3,", "2,2,3,nan", "3,2,3, a b ", "4,2,3,a b"])
    assert [table.text["name"].words[code] for code in table.text["name"].codes] == ["", "nan", "a b", "a b"]
    assert len(table.text["name"].words) == 3


def test_twenty_bad_rows_are_told_each_and_the_rest_counted(tmp_path: Path) -> None:
    rows = [f"{k}.5,{'?' if k < 30 else k},0,n" for k in range(1000)]
    table = read(tmp_path, [HEADER, *rows])
    assert table.n == 970
    assert len(table.events) == 21
    assert "30 in all" in table.events[-1].detail


def test_too_many_bad_rows_are_an_error_naming_the_first(tmp_path: Path) -> None:
    rows = [f"{k}.5,{'?' if k < 60 else k},0,n" for k in range(1000)]
    with pytest.raises(ColumnError, match=r"60 of 1000 rows.*line 2 'x'") as caught:
        read(tmp_path, [HEADER, *rows])
    assert (caught.value.line, caught.value.column) == (2, "x")


@pytest.mark.parametrize(
    "lines",
    [
        [line.replace(",", ";").replace(".", ",") for line in (HEADER, *ROWS)],
        [HEADER, *ROWS[:90], *(f'{k}.5,"1,234.5",0,n' for k in range(90, 100))],
        [HEADER.replace(",", ";"), *(row.replace(",", ";") for row in ROWS[:5]), *["5.5;1'234.5;0;n"] * 4],
        [HEADER.replace(",", ";"), "1.5;2,5;0;n"],
        [HEADER.replace(",", "\t"), *(f"{k}.5\t1\t\tn" for k in range(90)), *["90.5\t1\t0,25\tn"] * 6],
    ],
)
def test_decimal_commas_and_thousands_separators_are_an_error_with_advice(
    tmp_path: Path, lines: list[str]
) -> None:
    with pytest.raises(ColumnError, match="decimal point"):
        read(tmp_path, lines)


@pytest.mark.parametrize("cell", ["-0,0001766", "1_000", "1'234.5"])
@pytest.mark.parametrize("delimiter", [";", "\t"])
@pytest.mark.parametrize("column", [1, 2])
def test_few_cells_with_a_comma_cost_their_rows_and_not_the_file(
    tmp_path: Path, cell: str, delimiter: str, column: int
) -> None:
    """A flipped bit makes a comma of a point: only a file written so throughout has decimal commas."""
    lines = swapped(delimiter)
    for k in (7, 60):
        cells = lines[k].split(delimiter)
        cells[column] = cell
        lines[k] = delimiter.join(cells)
    table = read(tmp_path, lines)
    kind = {1: "bad_row", 2: "bad_cell"}[column]
    events = [event.detail for event in table.events if event.kind == kind]
    assert len(events) == 2 and f"log.csv:8, column '{'xy'[column - 1]}': '{cell}'" in events[0]
    assert table.n == (98 if column == 1 else 100)


def test_rows_refused_for_commas_in_several_columns_are_refused_with_that_advice(tmp_path: Path) -> None:
    lines = swapped(";")
    for k in range(4, 9):
        lines[k] = f"{k},5;1.0;0;n"
        lines[k + 20] = f"{k + 20}.5;1,0;0;n"
    with pytest.raises(ColumnError, match="10 of 100 rows") as caught:
        read(tmp_path, lines)
    assert "decimal = ','" in caught.value.advice


def test_missing_column_names_the_nearest_and_those_present(tmp_path: Path) -> None:
    with pytest.raises(ColumnError) as caught:
        read(tmp_path, ["time,x,y,name", *ROWS])
    assert caught.value.column == "time_s"
    assert "nearest: 'time'" in caught.value.advice and "time, x, y, name" in caught.value.advice


def test_file_without_a_header_says_so(tmp_path: Path) -> None:
    with pytest.raises(ColumnError, match="header line"):
        read(tmp_path, ["1,2,3,4", "5,6,7,8"])


def test_column_named_twice_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ColumnError, match="twice"):
        read(tmp_path, ["time_s,x,x,name", *ROWS])


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"time_s,x,y,name\n",
        b"time_s,x,y,name",
        b"\n\n",
        b"# only a comment\n",
        "time_s,x,y,name\n1,2,3,a\n".encode("utf-16"),
        b"\x00\x01\x02\x03" * 50,
        gzip.compress(b"time_s,x,y,name\n1,2,3,a\n", mtime=0)[:-6],
    ],
)
def test_file_without_readable_rows_is_a_typed_error(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(content)
    with pytest.raises(InputError):
        read_csv_table(path, WANTED)


def test_missing_file_names_the_nearest(tmp_path: Path) -> None:
    (tmp_path / "imu_log.csv").write_text("a")
    with pytest.raises(MissingFileError, match=r"imu_log\.csv"):
        read_csv_table(tmp_path / "imu_lag.csv", WANTED)


def test_exact_column_keeps_each_nanosecond_on_both_paths(tmp_path: Path) -> None:
    wanted = ColumnSelection(numeric=("x",), exact={"t": 9})
    rows = [f"1700000000.{k:09d},1" for k in range(1, 200)]
    expected = 1_700_000_000 * 10**9 + np.arange(1, 200)
    path = write_lines(tmp_path / "a.csv", ["t,x", *rows])
    assert np.array_equal(read_csv_table(path, wanted).exact["t"], expected)
    rows[0] = "1700000000.0000000009,1"  # more digits than are kept: rounded
    assert np.array_equal(read_csv_table(write_lines(path, ["t,x", *rows]), wanted).exact["t"], expected)
    path = write_lines(tmp_path / "b.csv", ["t,x", *rows, "# exact path", "1.7e9,1"])
    table = read_csv_table(path, wanted)
    assert table.lines is not None
    assert np.array_equal(table.exact["t"], [*expected, 1_700_000_000 * 10**9])


def test_large_file_reads_the_same_with_threads(tmp_path: Path, rng: np.random.Generator) -> None:
    values = rng.normal(0.0, 1e3, (150_000, 3))
    lines = [f"{a!r},{b!r},{c!r},n" for a, b, c in values.tolist()]
    path = write_lines(tmp_path / "big.csv", [HEADER, *lines])
    assert path.stat().st_size > 8 << 20
    table = read_csv_table(path, WANTED)
    assert np.array_equal(np.column_stack([table.columns[name] for name in ("time_s", "x", "y")]), values)


@pytest.fixture
def small_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have files parsed in pieces of a few lines."""
    monkeypatch.setattr(csv_fast, "PIECE_BYTES", 64)


@pytest.mark.usefixtures("small_pieces")
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_file_in_many_pieces_is_read_whole_and_in_order(tmp_path: Path, end: str) -> None:
    table = read(tmp_path, [HEADER, *ROWS], end)

    assert_complete(table)
    assert table.events == []


@pytest.mark.usefixtures("small_pieces")
def test_rows_that_become_shorter_find_room(tmp_path: Path) -> None:
    wide = [f"{k}.500000000000,{k * 0.25:020.12f},{-k},n{k % 3}" for k in range(10)]

    assert_complete(read(tmp_path, [HEADER, *wide, *ROWS[10:]]))


@pytest.mark.usefixtures("small_pieces")
def test_bad_cell_in_a_late_piece_is_reported_with_its_line(tmp_path: Path) -> None:
    table = read(tmp_path, [HEADER, *ROWS[:90], "90.5,oops,1,n0", *ROWS[91:]])

    assert table.n == 99
    assert any(":92" in event.detail and "oops" in event.detail for event in table.events)


@pytest.mark.usefixtures("small_pieces")
def test_word_that_first_appears_in_a_late_piece_keeps_its_name(tmp_path: Path) -> None:
    column = read(tmp_path, [HEADER, *ROWS[:90], "90.5,1,1, late ", *ROWS[91:]]).text["name"]

    assert column.words[column.codes[90]] == "late"
    assert len(column.words) == 4


def test_numbers_beyond_any_integer_are_clipped_without_writing_out_their_digits() -> None:
    """An integer of a million digits takes half a second; a damaged log has many such cells."""
    began = time.process_time()
    values, readable = integers(pa.array(["1e999000", "-2E999000", "0e99999", "1.5"] * 20), 9, ".")

    assert time.process_time() - began < 2.0
    assert values[:4].tolist() == [2**63 - 1, -(2**63 - 1), 0, 1_500_000_000]
    assert readable.all()
