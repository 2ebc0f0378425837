"""Ionosphere coefficients in RINEX navigation files: header lines of RINEX 3, messages of RINEX 4.

Of several sets of one system the first counts. A set of zeros is one that was never filled in, and counts as none.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from insgnss.log.rinex.text import numbers_in
from insgnss.tables import Float64

# Names of the header lines (RINEX 3.05, table A5): the two of Klobuchar's form, or the one of Galileo
_PAIRS: Final = {"GPSA": "GPSB", "BDSA": "BDSB", "QZSA": "QZSB", "IRNA": "IRNB"}
_SYSTEMS: Final = {"GPSA": "gps", "BDSA": "beidou", "QZSA": "qzss", "IRNA": "navic", "GAL": "galileo"}
# Messages of RINEX 4 with the same coefficients, and how many (RINEX 4.01, tables A33 to A37)
_MESSAGES: Final = {
    ("G", "LNAV"): ("gps", 8),
    ("C", "D1D2"): ("beidou", 8),
    ("J", "LNAV"): ("qzss", 8),
    ("J", "CNVX"): ("qzss", 8),
    ("I", "LNAV"): ("navic", 8),
    ("E", "IFNV"): ("galileo", 3),
}


def read_ionosphere(text: str) -> dict[str, Float64]:
    """Return the coefficients of ``NavigationData.ionosphere``, SI units, and GPS's; a damaged set is left out."""
    by_system: dict[str, Float64] = {}
    for system, values in (*_from_header(text), *_from_messages(text)):
        coefficients = np.array(values, dtype=np.float64)
        if np.isfinite(coefficients).all() and coefficients.any():
            by_system.setdefault(system, coefficients)
    return by_system


def _from_header(text: str) -> Iterator[tuple[str, list[float]]]:
    sets: dict[str, list[float]] = {}
    for line in text.split("END OF HEADER", 1)[0].splitlines():
        if line[60:].startswith("IONOSPHERIC CORR"):
            values = _numbers(line, 5, 12, 4)
            if values is not None:
                sets.setdefault(line[:4].strip(), values)
    for name, values in sets.items():
        if name == "GAL":
            yield "galileo", values[:3]
        elif name in _PAIRS and _PAIRS[name] in sets:
            yield _SYSTEMS[name], values + sets[_PAIRS[name]]


def _from_messages(text: str) -> Iterator[tuple[str, list[float]]]:
    if "> ION" not in text:
        return
    lines = text.splitlines()
    for k, line in enumerate(lines):
        if not line.startswith("> ION"):
            continue
        system, n = _MESSAGES.get((line[6:7], line[10:14].strip()), ("", 0))
        values = _numbers(lines[k + 1], 23, 19, min(n, 3)) if n and k + 1 < len(lines) else None
        for further in lines[k + 2 : k + 4]:
            if values is not None and len(values) < n:
                more = _numbers(further, 4, 19, min(n - len(values), 4))
                values = None if more is None else values + more
        if values is not None and len(values) == n:
            yield system, values


def _numbers(line: str, start: int, width: int, n: int) -> list[float] | None:
    """Return the numbers of ``numbers_in``, None when one cannot be read."""
    try:
        return numbers_in(line, start, width, n)
    except ValueError:
        return None
