"""The dialect of a CSV file: its delimiter, its header line, and the number of lines before the data."""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path

from insgnss.errors import InputError

COMMENT_MARKS = ("#", "%", "//")
DELIMITERS = (",", ";", "\t", "|", " ")
DELIMITER_NAMES = {",": "comma", ";": "semicolon", "\t": "tab", "|": "bar", " ": "white space"}
FALLBACK_ENCODING = "cp1252"  # for text that is not UTF-8: spreadsheets write this encoding
UTF16_MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)  # with which a text in UTF-16 begins
_HEAD_BYTES = 1 << 16  # more than any header with its comments
_HEADER_WITHIN = 100  # lines: no logger writes a longer preamble
# a first line that names the delimiter, of Excel
_SPREADSHEETS_MARK = re.compile(r'"?sep=."?', re.IGNORECASE)
_BY_NUMBER = re.compile(r"#([1-9]\d*)")
_NUMBER_OR_DATE = re.compile(r"[+-]?[.,]?\d")


@dataclass(frozen=True)
class Dialect:
    """The shape of a CSV file; white space as delimiter means any run of blanks or tabs."""

    delimiter: str
    columns: tuple[str, ...]  # of a file without a header: "#1", "#2", ...
    header_line: int  # 1-based; without a header the first line of data
    skip: int  # lines before the data
    header_in_comment: bool = False
    header_is_utf8: bool = True
    lines_above: int = 0  # lines above the header that are neither blank nor comments

    def place(self, name: str) -> int | None:
        """Return where a column stands, from 0, by its name or by its number, None when it is not there."""
        if name in self.columns:
            return self.columns.index(name)
        number = column_number(name)
        return None if number is None or number > len(self.columns) else number - 1


def column_number(name: str) -> int | None:
    """Return the number given in place of a column's name, as in "#3", None when it is a name."""
    match = _BY_NUMBER.fullmatch(name)
    return int(match[1]) if match else None


def is_comment(line: str) -> bool:
    """Return whether a line, stripped of white space, is a comment."""
    return line.startswith(COMMENT_MARKS)


def split_cells(line: str, delimiter: str) -> list[str]:
    """Return the cells of a header line, without quotes and white space; a delimiter inside quotes parts nothing."""
    if delimiter == " ":
        line = " ".join(line.split())
    cells = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])
    return [cell.strip().strip("\"'").strip() for cell in cells]


def decoded(text: bytes) -> tuple[str, bool]:
    """Return the text and whether it is UTF-8; other text is read in the encoding of Western Windows."""
    try:
        return text.decode("utf-8"), True
    except UnicodeDecodeError:
        return text.decode(FALLBACK_ENCODING, "replace"), False


def _best_delimiter(line: str, wanted: Collection[str]) -> str:
    """Return the delimiter under which most of the wanted columns appear; ties go to the one that splits most."""

    def score(delimiter: str) -> tuple[int, int]:
        cells = split_cells(line, delimiter)
        return len(set(cells) & set(wanted)), 0 if delimiter == " " else len(cells)

    return max(DELIMITERS, key=score)


def is_data(cell: str) -> bool:
    """Return whether a cell of the first line is a number or a date, so that the line can hardly be a header."""
    return _NUMBER_OR_DATE.match(cell) is not None


def _without_names(line: str, number: int, numbers: Collection[int], decimal: str, is_utf8: bool) -> Dialect:
    """Return the dialect of a file whose columns are given by number, from its first line.

    The delimiter is the first that gives as many cells as are needed. A first line without a number or a date in any
    of the wanted columns is a header.
    """
    fitting = [d for d in ("\t", ";", "|", ",", " ") if d != decimal or '"' in line]
    delimiter = max(fitting, key=lambda d: min(len(split_cells(line, d)), max(numbers)))
    cells = split_cells(line, delimiter)
    if any(is_data(cells[k - 1]) for k in numbers if k <= len(cells)):
        names = tuple(f"#{k}" for k in range(1, len(cells) + 1))
        return Dialect(delimiter, names, number, number - 1)
    return Dialect(delimiter, tuple(cells), number, number, False, is_utf8)


def detect_dialect(
    data: memoryview, wanted: Collection[str], required: Collection[str], decimal: str, path: Path
) -> Dialect:
    """Return the dialect of a CSV file from its first lines.

    The header is the first line that is neither blank nor a comment. When that line names none of the wanted
    columns, a comment line before it that does is the header ("# time_s, gyro_x, ..."). Where a required column is
    missing in it, the header is the first of the first 100 lines that has all of them: a logger may write its name and
    serial number above. Where columns are given by number the file needs no header.

    Raises
    ------
    InputError : there is no header line, or the file is binary or UTF-16
    """
    lines = _first_lines(data, path)
    dialect = _by_the_first_line(lines, wanted, decimal, path)
    if not any(column_number(name) for name in wanted) and not set(required) <= set(dialect.columns):
        dialect = _by_a_later_line(lines, dialect, wanted, required)
    above = (decoded(raw)[0].strip() for raw in lines[: dialect.header_line - 1])
    return replace(dialect, lines_above=sum(bool(line) and not is_comment(line) for line in above))


def _first_lines(data: memoryview, path: Path) -> list[bytes]:
    """Return the lines at the head of a file, whole ones."""
    head = bytes(data[:_HEAD_BYTES])
    if len(data) > _HEAD_BYTES:
        head = head[: head.rfind(b"\n") + 1] or bytes(data)
    if head.startswith(UTF16_MARKS):
        raise InputError("the file is UTF-16", file=path, advice="save it as CSV in UTF-8")
    return re.split(rb"\r\n|\n|\r", head.removeprefix(codecs.BOM_UTF8))


def _by_the_first_line(lines: list[bytes], wanted: Collection[str], decimal: str, path: Path) -> Dialect:
    """Return the dialect whose header is the first line, or a comment above it."""
    numbers = {k for name in wanted if (k := column_number(name)) is not None}
    comment: Dialect | None = None
    for number, raw in enumerate(lines, start=1):
        text, is_utf8 = decoded(raw)
        line = text.strip()
        if not line or _SPREADSHEETS_MARK.fullmatch(line):
            continue
        if is_comment(line):
            named = _as_header(line, number, wanted, is_utf8)
            if len(set(named.columns) & set(wanted)) >= 2:
                comment = named
            continue
        if "\0" in line:
            raise InputError("this is a binary file, not CSV", file=path)
        if numbers:
            return _without_names(text, number, numbers, decimal, is_utf8)
        header = _as_header(line, number, wanted, is_utf8)
        if comment is not None and not set(header.columns) & set(wanted):
            return replace(comment, skip=number - 1)
        return header
    raise InputError(
        "the file holds no header line", file=path, advice="the first line must name the columns"
    )


def _by_a_later_line(
    lines: list[bytes], first: Dialect, wanted: Collection[str], required: Collection[str]
) -> Dialect:
    """Return the dialect of the first line that has all required columns, else of the one that has most of them.

    In that last case the file is refused, and the error names the columns of the line that is most like a header.
    """
    headers = [first]
    for number in range(first.header_line + 1, min(len(lines), _HEADER_WITHIN) + 1):
        text, is_utf8 = decoded(lines[number - 1])
        if text.strip():
            headers.append(_as_header(text.strip(), number, wanted, is_utf8))
    return max(headers, key=lambda header: len(set(required) & set(header.columns)))


def _as_header(line: str, number: int, wanted: Collection[str], is_utf8: bool) -> Dialect:
    """Return the dialect of a file with this header line; a comment's mark does not belong to the first name."""
    in_comment = is_comment(line)
    named = line.lstrip("#%/ \t") if in_comment else line
    delimiter = _best_delimiter(named, wanted)
    return Dialect(delimiter, tuple(split_cells(named, delimiter)), number, number, in_comment, is_utf8)
