"""Files of gain patterns: ``models/antennas/*.csv`` or the user's own, read strictly.

Lines ``# key: value`` first: ``frame`` (``antenna_forward_right_down``: x forward, y right, z down, elevation towards
the boresight -z), ``frequency_hz``, ``polarisation``, ``source``, and ``name`` if it is not the file's; a comment
without a colon is free text. Then a table parted by commas. Its header is ``elevation_deg`` and the azimuths in
degrees, from 0, or ``elevation_deg,gain_dbic`` where the gain depends on elevation alone; each row is an elevation,
from -90 to 90, and the gains in dBic.
"""

from __future__ import annotations

import difflib
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from insgnss.antenna.gain_pattern import GainTable, even_step_deg
from insgnss.config.files import existing_file
from insgnss.errors import ConfigError
from insgnss.tables import Event, Float64

FRAME: Final = "antenna_forward_right_down"
POLARISATIONS: Final = ("RHCP", "LHCP", "linear", "none")
_REQUIRED: Final = ("frame", "frequency_hz", "polarisation", "source")
_KEYS: Final = (*_REQUIRED, "name")
_GAINS_DBIC: Final = (
    -100.0,
    60.0,
)  # a number outside is not a gain in dBic: a linear value, or another column
_MOST_NODES: Final = 4_000_000  # of the even grid, 32 MB
_POLE_SPREAD_DB: Final = 1e-9  # values of one pole that differ by more are averaged, and said to be


@dataclass(frozen=True)
class _PatternLine:
    number: int
    cells: tuple[str, ...]


def read_pattern(path: Path) -> tuple[GainTable, list[Event]]:
    """Read a pattern file; a pole whose azimuths have different gains gets their mean, with an event.

    Raises
    ------
    MissingFileError : no such file
    ConfigError : a header line is missing, unknown, twice or wrong; the grid is not increasing or does not cover the
        sphere; a gain is missing, no number, or no gain. File, line and column are named
    """
    try:
        text = existing_file(path).read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ConfigError("the file is not UTF-8 text", file=path, advice="save the file in UTF-8") from error
    header, lines = _header(text, path)
    if len(lines) < 3:
        advice = "a header of azimuths and at least the rows -90 and 90 are needed"
        raise ConfigError("the table has no rows", file=path, advice=advice)
    azimuth = _azimuths(lines[0], path)
    elevation = _elevations(lines[1:], path)
    names = lines[0].cells
    gain = np.array([_gains(line, names, path) for line in lines[1:]])
    events = _level_poles(gain, path)
    nodes = (180.0 / even_step_deg(elevation)) * (360.0 / even_step_deg(np.append(azimuth, 360.0)))
    if nodes > _MOST_NODES:
        advice = "let the steps of elevation and azimuth be multiples of 0.1 deg"
        raise ConfigError("the grid is too uneven to be refined", file=path, advice=advice)
    table = GainTable(
        header.get("name", path.stem),
        float(header["frequency_hz"]),
        header["polarisation"],
        header["source"],
        elevation,
        azimuth,
        gain,
    )
    return table, events


def _header(text: str, path: Path) -> tuple[dict[str, str], list[_PatternLine]]:
    """Return the checked header and the lines of the table."""
    header: dict[str, str] = {}
    places: dict[str, int] = {}
    lines: list[_PatternLine] = []
    for number, line in enumerate(text.splitlines(), 1):
        found = re.fullmatch(r"#\s*(\w+)\s*:\s*(.*)", line.strip())
        if found:
            key, value = found[1], found[2].strip()
            _check_key(key, header, path, number)
            header[key], places[key] = value, number
        elif line.strip() and not line.startswith("#"):
            lines.append(_PatternLine(number, tuple(cell.strip() for cell in line.split(","))))
    for key in _REQUIRED:
        if not header.get(key):
            advice = f"write a line '# {key}: ...' above the table"
            raise ConfigError("a line of the header is missing", file=path, key=key, advice=advice)
    _check_header(header, places, path)
    return header, lines


def _check_key(key: str, header: dict[str, str], path: Path, number: int) -> None:
    if key not in _KEYS:
        near = difflib.get_close_matches(key, _KEYS, n=1, cutoff=0.5)
        advice = f"nearest valid key: '{near[0]}'" if near else f"valid here: {', '.join(_KEYS)}"
        raise ConfigError("unknown key", file=path, line=number, key=key, advice=advice)
    if key in header:
        raise ConfigError(
            "the key appears twice", file=path, line=number, key=key, advice="leave one of them"
        )


def _check_header(header: dict[str, str], places: dict[str, int], path: Path) -> None:
    if header["frame"] != FRAME:
        raise ConfigError(
            f"the frame '{header['frame']}' is not known",
            file=path,
            line=places["frame"],
            key="frame",
            advice=f"turn the pattern into '{FRAME}' (x forward, y right, z down, boresight -z)",
        )
    if not _number(header["frequency_hz"]) > 0.0:
        raise ConfigError(
            f"'{header['frequency_hz']}' is not a frequency",
            file=path,
            line=places["frequency_hz"],
            key="frequency_hz",
            advice="give it in hertz, as in 1575.42e6",
        )
    if header["polarisation"] not in POLARISATIONS:
        raise ConfigError(
            f"the polarisation '{header['polarisation']}' is not known",
            file=path,
            line=places["polarisation"],
            key="polarisation",
            advice=f"write one of {', '.join(POLARISATIONS)}",
        )


def _azimuths(line: _PatternLine, path: Path) -> Float64:
    """Return the azimuths of the table's header, a single zero where the gain depends on elevation alone."""
    if line.cells[0] != "elevation_deg" or len(line.cells) < 2:
        advice = (
            "the first line of the table is 'elevation_deg' and the azimuths, or 'elevation_deg,gain_dbic'"
        )
        raise ConfigError("the table has no header", file=path, line=line.number, advice=advice)
    if line.cells[1:] == ("gain_dbic",):
        return np.zeros(1)
    azimuth = np.array([_cell(line, k, line.cells, path) for k in range(1, len(line.cells))])
    back = np.flatnonzero(np.diff(azimuth) < 0.0005)
    if len(back):
        column = line.cells[int(back[0]) + 2]
        advice = "azimuths increase by at least 0.001 deg from column to column"
        raise ConfigError(
            "the azimuths do not increase", file=path, line=line.number, column=column, advice=advice
        )
    gaps = np.append(np.diff(azimuth), 360.0 - azimuth[-1])
    if azimuth[0] != 0.0 or gaps[-1] <= 0.0 or (len(gaps) > 1 and gaps[-1] > gaps[:-1].max() + 1e-9):
        advice = "they start at 0 and go on to one step before 360; 360 itself is 0 again"
        raise ConfigError("the azimuths do not go once around", file=path, line=line.number, advice=advice)
    return azimuth


def _elevations(lines: list[_PatternLine], path: Path) -> Float64:
    elevation = np.array([_cell(line, 0, ("elevation_deg",), path) for line in lines])
    back = np.flatnonzero(np.diff(elevation) < 0.0005)
    if len(back):
        advice = "elevations increase by at least 0.001 deg from row to row"
        raise ConfigError(
            "the elevations do not increase",
            file=path,
            line=lines[int(back[0]) + 1].number,
            column="elevation_deg",
            advice=advice,
        )
    for row, pole in ((0, -90.0), (-1, 90.0)):
        if elevation[row] != pole:
            raise ConfigError(
                f"the table {'starts' if row == 0 else 'ends'} at elevation {elevation[row]:g} deg",
                file=path,
                line=lines[row].number,
                column="elevation_deg",
                advice=f"the whole sphere is needed: add rows up to {pole:g}, with the gains of the back",
            )
    return elevation


def _gains(line: _PatternLine, names: tuple[str, ...], path: Path) -> list[float]:
    """Return the gains of one row."""
    if len(line.cells) > len(names):
        advice = f"there are {len(names)} columns"
        raise ConfigError(f"the row has {len(line.cells)} cells", file=path, line=line.number, advice=advice)
    return [_cell(line, k, names, path, _GAINS_DBIC) for k in range(1, len(names))]


def _cell(
    line: _PatternLine,
    k: int,
    names: tuple[str, ...],
    path: Path,
    bounds: tuple[float, float] = (-math.inf, math.inf),
) -> float:
    text = line.cells[k] if k < len(line.cells) else ""
    value = _number(text)
    if math.isfinite(value) and bounds[0] <= value <= bounds[1]:
        return value
    if not text:
        what, advice = "a hole: the cell is empty", "give the gain of every direction"
    elif not math.isfinite(value):
        what, advice = (
            f"'{text}' is not a finite number",
            "write a number with a point; -100 where nothing gets through",
        )
    else:
        what, advice = (
            f"{text} is not a gain in dBic",
            f"gains lie between {bounds[0]:g} and {bounds[1]:g} dBic",
        )
    raise ConfigError(what, file=path, line=line.number, column=names[k] or str(k + 1), advice=advice)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _level_poles(gain: Float64, path: Path) -> list[Event]:
    """Give each pole one value: all azimuths meet there."""
    events = []
    for row, pole in ((0, -90), (-1, 90)):
        spread = float(np.ptp(gain[row]))
        if spread > _POLE_SPREAD_DB:
            detail = f"{path}: gains at elevation {pole} deg differ by {spread:.3g} dB over azimuth: averaged"
            events.append(Event(None, "pattern_pole_averaged", detail))
        gain[row] = float(gain[row].mean()) if spread > _POLE_SPREAD_DB else gain[row, 0]
    return events
