"""The satellite of each row of a table: from a column of names, or from numbers and their constellations."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from insgnss.config.flight import ObservationLog
from insgnss.errors import ColumnError
from insgnss.log.csv.table import CsvTable
from insgnss.log.satellites import bare_number, normalised_name, numbered_name, system_letter
from insgnss.tables import Event, Int16, Int64

_BARE_KEY: Final = re.compile(r"[A-Za-z0-9_-]+")


class _SatelliteCell(NamedTuple):
    """A satellite as the table writes it; ``system`` is None without a column of constellations."""

    satellite: str
    system: str | None

    def __str__(self) -> str:
        of = "" if self.system is None else f" of constellation '{self.system}'"
        return f"'{self.satellite}'{of}"


def read_satellites(
    table: CsvTable, config: ObservationLog, path: Path
) -> tuple[Int16, tuple[str, ...], list[Event]]:
    """Return each row's index into the satellites' names, -1 where the cells name none, and an event of such cells.

    Raises
    ------
    ColumnError : no row names a satellite
    """
    codes, written = _distinct(table, config)
    named = [_name(cells, config) for cells in written]
    distinct = tuple(dict.fromkeys(name for name in named if name is not None))
    if not distinct:
        raise _nameless(written[0], config, path)
    index = {name: i for i, name in enumerate(distinct)}
    of_code = np.array([-1 if name is None else index[name] for name in named], dtype=np.int16)
    events = []
    for code, (cells, name) in enumerate(zip(written, named, strict=True)):
        if name is None:
            count = int(np.count_nonzero(codes == code))
            unknown = cells.system is not None and system_letter(cells.system, config.system_codes) is None
            more = (
                "; declare its constellation in gnss.system_codes"
                if unknown
                else _contradiction(cells, config)
            )
            events.append(
                Event(None, "bad_row", f"{path}: {cells} names no satellite; {count} row(s) refused{more}")
            )
    return of_code[codes], distinct, events


def _distinct(table: CsvTable, config: ObservationLog) -> tuple[Int64, list[_SatelliteCell]]:
    """Return each row's index into the distinct cells."""
    column, system = table.text[config.columns.sv], table.text.get(config.columns.system)
    if system is None:
        return column.codes.astype(np.int64), [_SatelliteCell(word, None) for word in column.words]
    pairs = column.codes.astype(np.int64) * len(system.words) + system.codes
    used, codes = np.unique(pairs, return_inverse=True)
    cells = [divmod(pair, len(system.words)) for pair in used.tolist()]
    return codes, [_SatelliteCell(column.words[i], system.words[k]) for i, k in cells]


def _name(written: _SatelliteCell, config: ObservationLog) -> str | None:
    """Return the satellite's name; if both columns state the constellation, they must agree."""
    own, number = normalised_name(written.satellite), bare_number(written.satellite)
    if written.system is None:
        return own or (numbered_name(config.system, number) if config.system and number is not None else None)
    letter = system_letter(written.system, config.system_codes)
    if own is not None or letter is None or number is None:
        return own if own is not None and own[0] == letter else None
    return numbered_name(letter, number)


def _nameless(first: _SatelliteCell, config: ObservationLog, path: Path) -> ColumnError:
    names = config.columns
    column, advice = names.sv, "write satellites as in RINEX 3, the system's letter and the number: G05, E11"
    if first.system is not None and system_letter(first.system, config.system_codes) is None:
        column = names.system
        advice = f"say what its cells mean: gnss.system_codes = {{ {toml_key(first.system)} = 'G', ... }}"
    elif contradiction := _contradiction(first, config):
        advice = f"{contradiction[2:]}: correct the one that is wrong, or leave columns.system out"
    elif first.system is None and config.system is None and bare_number(first.satellite) is not None:
        advice = (
            "these are bare numbers: name the column of their constellations as gnss.columns.system, declare one for"
            " all of them (gnss.system = 'G'), or write G05, E11"
        )
    return ColumnError(f"no cell names a satellite: {first}, ...", file=path, column=column, advice=advice)


def _contradiction(written: _SatelliteCell, config: ObservationLog) -> str:
    """Return that name and column state different constellations, "" where they do not."""
    own = normalised_name(written.satellite)
    letter = None if written.system is None else system_letter(written.system, config.system_codes)
    if own is None or letter is None or own[0] == letter:
        return ""
    return f"; its name says {own[0]}, the column '{config.columns.system}' says {letter}"


def toml_key(text: str) -> str:
    """Return text as a key of TOML, in quotes where it needs them."""
    return text if _BARE_KEY.fullmatch(text) else json.dumps(text, ensure_ascii=False)
