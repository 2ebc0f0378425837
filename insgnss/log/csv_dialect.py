"""How a CSV file is written: its delimiter, its header line, and how many lines stand before the data."""

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
FALLBACK_ENCODING = "cp1252"  # of text that is no UTF-8: what spreadsheets write
_HEAD_BYTES = 1 << 16  # more than any header with its comments


@dataclass(frozen=True)
class Dialect:
    """The shape of a CSV file; white space as delimiter means any run of blanks or tabs."""

    delimiter: str
    columns: tuple[str, ...]
    header_line: int  # 1-based
    skip: int  # lines before the data
    header_in_comment: bool = False
    header_is_utf8: bool = True


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
    """Return the text and whether it is UTF-8; what is not is read in the encoding of Western Windows."""
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


def is_number(cell: str) -> bool:
    """Return whether a cell of the first line is a number, so that the line can hardly be a header."""
    try:
        float(cell)
    except ValueError:
        return False
    return True


def detect_dialect(data: memoryview, wanted: Collection[str], path: Path) -> Dialect:
    """Return the dialect of a CSV file from its first lines.

    The header is the first line that is neither blank nor a comment. When that line names none of the wanted
    columns, a comment line before it that does is the header ("# time_s, gyro_x, ...").

    Raises
    ------
    InputError : there is no header line, or the file is binary or UTF-16
    """
    head = bytes(data[:_HEAD_BYTES])
    if len(data) > _HEAD_BYTES:
        head = head[: head.rfind(b"\n") + 1] or bytes(data)
    if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise InputError("the file is UTF-16", file=path, advice="save it as CSV in UTF-8")
    lines = re.split(rb"\r\n|\n|\r", head.removeprefix(codecs.BOM_UTF8))
    comment: Dialect | None = None
    for number, raw in enumerate(lines, start=1):
        line, is_utf8 = decoded(raw)
        line = line.strip()
        if not line:
            continue
        if is_comment(line):
            text = line.lstrip("#%/ \t")
            delimiter = _best_delimiter(text, wanted)
            columns = tuple(split_cells(text, delimiter))
            if len(set(columns) & set(wanted)) >= 2:
                comment = Dialect(delimiter, columns, number, number, True, is_utf8)
            continue
        delimiter = _best_delimiter(line, wanted)
        cells = split_cells(line, delimiter)
        if "\0" in line:
            raise InputError("this is a binary file, not CSV", file=path)
        if comment is not None and not set(cells) & set(wanted):
            return replace(comment, skip=number - 1)
        return Dialect(delimiter, tuple(cells), number, number, False, is_utf8)
    raise InputError(
        "the file holds no header line", file=path, advice="the first line must name the columns"
    )
