"""YUMA almanacs: a text block for each satellite, as the US Coast Guard publishes them, becomes navigation data.

An almanac knows the orbit to a kilometre or two and the clock to some 100 m: enough to say who is in the sky.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Final

from insgnss.config.files import existing_file
from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.errors import InputError
from insgnss.log.messages.broadcast import ELEMENTS, Ephemeris, ephemeris_table
from insgnss.tables import NavigationData

# Beginning of each line's label, lower case, and what it holds
_LABELS: Final = {
    "id": "id",
    "health": "health",
    "eccentricity": "e",
    "time of applicability": "toa",
    "orbital inclination": "i0",
    "rate of right ascen": "omega_dot",
    "sqrt(a)": "sqrt_a",
    "right ascen at week": "omega0",
    "argument of perigee": "omega",
    "mean anom": "m0",
    "af0": "af0",
    "af1": "af1",
    "week": "week",
}
_WEEKS_OF_A_CYCLE: Final = 1024  # almanacs may count weeks from the last rollover
# Of the numbers that are computed with at once; the others may be as large as float32 has them
_LIMITS: Final = {"id": (1, 999), "week": (0, 9999), "toa": (0, 1e6), "e": (0, 0.999), "sqrt_a": (1.0, 1e5)}
_LARGEST: Final = 3.4e38
_LINE: Final = re.compile(r"^\s*([^:*]+?)\s*:\s*(\S+)\s*$")


def read_yuma(path: Path, near_week: int) -> NavigationData:
    """Return the satellites of an almanac; its week is taken in the cycle of 1024 nearest to ``near_week``.

    Raises
    ------
    MissingFileError : no such file
    InputError : no almanac, a number that is none, or a satellite whose block lacks a line; file and line are named
    """
    blocks = _blocks(existing_file(path), path)
    for number, block in blocks:
        lacking = [label for label, name in _LABELS.items() if name not in block]
        if lacking:
            raise InputError(
                f"the satellite's block has no line '{lacking[0]}'",
                file=path,
                line=number,
                advice="copy it whole",
            )
    if not blocks:
        raise InputError("not a YUMA almanac: no line begins with 'ID:'", file=path)
    return NavigationData(ephemeris_table(_ephemeris(block, near_week) for _, block in blocks), None, None)


def _blocks(path: Path, shown: Path) -> list[tuple[int, dict[str, float]]]:
    """Return the satellites, each with the line on which it begins."""
    blocks: list[tuple[int, dict[str, float]]] = []
    for number, line in enumerate(path.read_text(encoding="ascii", errors="replace").splitlines(), 1):
        match = _LINE.match(line)
        label = match[1].lower() if match else ""
        name = next((_LABELS[begin] for begin in _LABELS if label.startswith(begin)), None)
        if match is None or name is None:
            continue
        try:
            value = float(match[2])
            least, most = _LIMITS.get(name, (-_LARGEST, _LARGEST))
            if not least <= value <= most:
                raise ValueError(value)
        except ValueError:
            raise InputError(
                f"'{match[2]}' is not a valid almanac value",
                file=shown,
                line=number,
                column=match[1],
                advice="copy the file again",
            ) from None
        if name == "id":
            blocks.append((number, {}))
        if blocks:
            blocks[-1][1][name] = value
    return blocks


def _ephemeris(block: dict[str, float], near_week: int) -> Ephemeris:
    """Return a satellite's message; what an almanac does not state is zero, its accuracy and interval not known."""
    cycles = round((near_week - block["week"]) / _WEEKS_OF_A_CYCLE)
    toa_ns = (int(block["week"]) + _WEEKS_OF_A_CYCLE * cycles) * NS_PER_WEEK + round(block["toa"] * NS_PER_S)
    elements = {"toe_sow_s": (toa_ns % NS_PER_WEEK) / NS_PER_S, **block}
    return Ephemeris(
        *(f"G{int(block['id']):02d}", "LNAV", toa_ns, toa_ns, (0.0, 0.0), block["health"]),
        *(math.nan, 0.0, math.nan, tuple(elements.get(name, 0.0) for name in ELEMENTS)),
    )
