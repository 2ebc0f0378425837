"""RINEX observation text with damage: a bad number costs its own value, a damaged epoch the epoch, never the file."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from insgnss.gnss import sidereon_on_demand as sidereon
from insgnss.log.rinex.text import EPOCH_2, EPOCH_3, LABEL_COLUMN, ObservationText, version_of, without_tabs
from insgnss.tables import Event

# RINEX 2.11, table A2; RINEX 3.05, table A3: each observation is F14.3, I1, I1
_CELL: Final = 16
_NUMBER: Final = 14
_WRITTEN: Final = re.compile(r" *[-+]?\d*\.\d{3}")
_NAME: Final = re.compile(r"[A-Z ][ \d]\d")
_MOST_CELLS_2: Final = 99  # a header that states more is damaged
_FURTHER_NAMES: Final = re.compile(r" {32}(?:[A-Z ][ \d]\d)+ *")
_NAMES_2, _NAMES_PER_LINE_2, _CELLS_PER_LINE_2 = 32, 12, 5
_TYPES_2: Final = re.compile(r"^ *(\d+) .*# / TYPES OF OBSERV", re.MULTILINE)


class DamagedCell(NamedTuple):
    """A cell that holds no number."""

    line: int  # of the file, from 1
    sv: str
    place: int  # among the satellite's observations, as the header lists their codes
    text: str


class ParsedStretch(NamedTuple):
    """Epochs read together; one that was mended stands alone, with the cells that it lost."""

    product: Any
    damaged_cells: tuple[DamagedCell, ...] = ()


@dataclass
class ParsedText:
    """The readable part of a text, in order, and the file line and reason of each epoch that could not."""

    stretches: list[ParsedStretch] = field(default_factory=list)
    refused: list[tuple[int, str]] = field(default_factory=list)


def observations_without_tabs(text: str, path: str) -> tuple[str, list[Event]]:
    """Return an observation text with blanks for its tabs, as of ``without_tabs``: all cells are written as F14.3."""
    with_names = version_of(text) >= 3.0
    name_width = 3 if with_names else 0
    return without_tabs(text, path, lambda line: _is_in_columns(line, with_names), name_width, "observations")


def _is_in_columns(line: str, with_names: bool) -> bool:
    """Return whether a line is one of an epoch or a header, or of cells as ``without_damaged_cells`` wants them."""
    is_epoch = EPOCH_3.match(line) if with_names else (EPOCH_2.match(line) or _FURTHER_NAMES.fullmatch(line))
    if is_epoch or line[LABEL_COLUMN:].strip()[:1].isalpha():
        return True
    starts = range(3 if with_names else 0, len(line), _CELL)
    cells = [line[start : start + _NUMBER] for start in starts]
    return all(not cell.strip() or (len(cell) == _NUMBER and _WRITTEN.fullmatch(cell)) for cell in cells)


class _CellLine(NamedTuple):
    """A line of cells: its number in the epoch, its satellite, the place of its first cell and where that begins."""

    line: int
    sv: str
    place: int
    column: int


def parse_around_damage(text: ObservationText) -> ParsedText:
    """Parse all epochs that can be parsed, halving the stretch around each one that cannot, and mending that one."""
    parsed = ParsedText()
    stretches = [(0, len(text.epochs))]
    while stretches:
        start, end = stretches.pop()
        try:
            parsed.stretches.append(ParsedStretch(sidereon.parse_rinex_obs(text.part(start, end))))
        except sidereon.SidereonError as problem:
            if end - start > 1:
                middle = (start + end) // 2
                stretches += [(middle, end), (start, middle)]
            elif end > start:
                _parse_mended(text, start, parsed, str(problem))
    return parsed


def _parse_mended(text: ObservationText, index: int, parsed: ParsedText, problem: str) -> None:
    """Add a damaged epoch to ``parsed``, read without its damaged cells or refused."""
    header = text.header_at(index)
    mended, cells = without_damaged_cells(text.epochs[index], header, text.lines[index])
    try:
        parsed.stretches.append(ParsedStretch(sidereon.parse_rinex_obs(header + mended), cells))
    except sidereon.SidereonError:
        why = _wrong_length(text.epochs[index], header) or problem
        parsed.refused.append((text.lines[index], why))


def _wrong_length(epoch: str, header: str) -> str:
    """Return by how much the number of an epoch's lines is wrong in RINEX 2, empty where it is right or not known."""
    lines = epoch.rstrip("\n").split("\n")
    shape = None if version_of(header) >= 3.0 else _shape_2(lines, header)
    if shape is None or shape.n_cells > _MOST_CELLS_2 or lines[0][28:29] not in "01":
        return ""
    wanted, n_lines = shape.n_first + shape.n_names * shape.per_satellite, len(lines)
    if wanted == n_lines:
        return ""
    detail = f"{shape.n_names} satellite(s) of {shape.n_cells} observation(s) need {wanted}"
    return f"the epoch has {n_lines} line(s), {detail}"


def without_damaged_cells(epoch: str, header: str, first_line: int) -> tuple[str, tuple[DamagedCell, ...]]:
    """Return the text of an epoch, its cells blanked that are neither blank nor written as F14.3, and what these were.

    Meant for an epoch that cannot be read as it stands. A number of another form counts as damaged there, since it may
    be a cell's part only, where a character of the line is lost.
    """
    lines = epoch.split("\n")
    stretches = _stretches_3(lines) if version_of(header) >= 3.0 else _stretches_2(lines, header)
    cells = []
    for line, sv, place, column in stretches:
        text = lines[line]
        for k, start in enumerate(range(column, len(text), _CELL)):
            cell = text[start : start + _NUMBER]
            if cell.strip() and not (len(cell) == _NUMBER and _WRITTEN.fullmatch(cell)):
                cells.append(DamagedCell(first_line + line, sv, place + k, cell.strip()))
                text = text[:start] + " " * _CELL + text[start + _CELL :]
        lines[line] = text
    return "\n".join(lines), tuple(cells)


def _stretches_3(lines: list[str]) -> Iterator[_CellLine]:
    """Yield the line of each satellite, RINEX 3 and 4."""
    for k, line in enumerate(lines[1:], start=1):
        if _NAME.fullmatch(line[:3]):
            yield _CellLine(k, _full_name(line[:3], "G"), 0, 3)


def _stretches_2(lines: list[str], header: str) -> Iterator[_CellLine]:
    """Yield the lines of each satellite, RINEX 2; its epoch names all satellites before the first number."""
    shape = _shape_2(lines, header)
    if shape is None:
        return
    n_first, n_names, per_satellite, _ = shape
    names = "".join(line[_NAMES_2 : _NAMES_2 + 3 * _NAMES_PER_LINE_2] for line in lines[:n_first])
    own_system = header[40:41].strip().replace("M", "") or "G"
    for line in range(n_first, min(n_first + n_names * per_satellite, len(lines))):
        i, k = divmod(line - n_first, per_satellite)
        name = names[3 * i : 3 * i + 3]
        if _NAME.fullmatch(name):
            yield _CellLine(line, _full_name(name, own_system), k * _CELLS_PER_LINE_2, 0)


class _Shape(NamedTuple):
    """How many lines an epoch of RINEX 2 has."""

    n_first: int  # lines with the names of the satellites
    n_names: int
    per_satellite: int  # lines
    n_cells: int  # of each satellite


def _shape_2(lines: list[str], header: str) -> _Shape | None:
    """Return the shape that an epoch states, None where it cannot be read."""
    types, count = _TYPES_2.search(header), lines[0][29:32].strip()
    if types is None or not count.isdigit() or int(types[1]) == 0:
        return None
    n_names, n_cells = int(count), int(types[1])
    return _Shape(-(-n_names // _NAMES_PER_LINE_2), n_names, -(-n_cells // _CELLS_PER_LINE_2), n_cells)


def _full_name(name: str, own_system: str) -> str:
    """Return a satellite's name with its system, the file's own where that is blank, and two digits."""
    return f"{name[0].strip() or own_system}{int(name[1:]):02d}"
