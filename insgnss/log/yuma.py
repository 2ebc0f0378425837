"""YUMA almanacs: a text block for each satellite, as the US Coast Guard publishes them, becomes navigation data.

An almanac knows the orbit to a kilometre or two and the clock to some 100 m: enough to say who is in the sky.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import numpy as np

from insgnss.config.files import existing_file
from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.errors import InputError
from insgnss.tables import EphemerisTable, Float64, NavigationData

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
    return NavigationData(_table([block for _, block in blocks], near_week), None, None)


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


def _table(blocks: list[dict[str, float]], near_week: int) -> EphemerisTable:
    count = len(blocks)

    def of(name: str) -> Float64:
        return np.array([block[name] for block in blocks], np.float64)

    cycles = np.rint((near_week - of("week")) / _WEEKS_OF_A_CYCLE)
    week = (of("week") + _WEEKS_OF_A_CYCLE * cycles).astype(np.int64)
    toa_ns = week * NS_PER_WEEK + np.rint(of("toa") * NS_PER_S).astype(np.int64)
    zero = np.zeros(count)
    return EphemerisTable(
        sv_names=tuple(f"G{int(block['id']):02d}" for block in blocks),
        message=("LNAV",) * count,
        toe_ns=toa_ns,
        toc_ns=toa_ns,
        toe_sow_s=(toa_ns % NS_PER_WEEK) / NS_PER_S,
        af0=of("af0"),
        af1=of("af1"),
        sqrt_a=of("sqrt_a"),
        e=of("e"),
        i0=of("i0"),
        omega0=of("omega0"),
        omega=of("omega"),
        m0=of("m0"),
        omega_dot=of("omega_dot"),
        health=of("health"),
        group_delay_s=np.zeros((count, 2)),
        accuracy_m=np.full(count, np.nan),
        issue=zero,
        fit_interval_s=np.full(count, np.nan),
        **{name: zero for name in ("af2", "delta_n", "idot", "cuc", "cus", "crc", "crs", "cic", "cis")},
    )
