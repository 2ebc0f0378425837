"""A table's description: the meaning of a row, and each column's unit and meaning."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

# endings of column names, the longest first: "mps2" before "mps"
UNITS: Final[dict[str, str]] = {
    "degps_per_sqrt_hz": "°/s/√Hz",
    "mps2_per_sqrt_hz": "m/s²/√Hz",
    "deg_per_h_per_g": "°/h/g",
    "m_per_channel": "m/channel",
    "hz_per_s": "Hz/s",
    "s_per_s": "s/s",
    "m2ps2": "m²/s²",
    "m2ps4": "m²/s⁴",
    "m2": "m²",
    "deg2": "°²",
    "mps3": "m/s³",
    "mps2": "m/s²",
    "mps": "m/s",
    "radps": "rad/s",
    "degps": "°/s",
    "mrad": "mrad",
    "ppm": "ppm",
    "deg": "°",
    "dbhz": "dB-Hz",
    "dbic": "dBic",
    "dbi": "dBic",  # of circular polarisation, as every gain here: gain_dbi keeps its former name
    "db": "dB",
    "hz": "Hz",
    "percent": "%",
    "hpa": "hPa",
    "ut": "µT",
    "chips": "chips",
    "cycles": "cycles",
    "m": "m",
    "s": "s",
}


class Column(NamedTuple):
    """One column, or one family of columns where its name has a ``*``."""

    name: str
    unit: str  # "" without one
    meaning: str


@dataclass(frozen=True)
class Sheet:
    """The description of one table."""

    name: str
    row: str  # the meaning of one row
    text: str  # a line for each meaning: the columns it holds for, a colon, the meaning; indented: goes on
    intro: str = ""

    def lines(self) -> list[tuple[list[Column], str]]:
        """Return the columns that share a meaning, and the meaning, in the table's order."""
        lines = []
        whole = self.text.replace("\n  ", " ")  # an indented line goes on with the one before
        for line in filter(None, map(str.strip, whole.splitlines())):
            names, _, meaning = line.partition(":")
            columns = [Column(name, unit_of(name), meaning.strip()) for name in names.split()]
            lines.append((columns, meaning.strip()))
        return lines

    def columns(self) -> list[Column]:
        """Return all columns."""
        return [column for columns, _ in self.lines() for column in columns]


def unit_of(name: str) -> str:
    """Return the unit that a column's name ends in, "" where it has none."""
    return next((unit for ending, unit in UNITS.items() if name.endswith(f"_{ending}")), "")
