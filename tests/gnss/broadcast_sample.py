"""Self-made broadcast messages of every orbit kind, as a RINEX 3 file and as the table that the file gives."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from insgnss.gpstime import week_seconds_to_ns
from insgnss.log.rinex.navigation import read_navigation
from insgnss.tables import EphemerisTable, GnssTable

WEEK = 2268
TOE_SOW = 385_200.0  # Thursday 2023-06-29 11:00:00
TOE_NS = int(week_seconds_to_ns(WEEK, TOE_SOW))

# e, sqrt(a) [sqrt m], i0, omega, m0, idot and harmonics after real messages; one line per kind of orbit
ORBITS: dict[str, tuple[float, float, float, float, float]] = {
    "G01": (0.0, 5153.6, 0.96, 0.3, -2.9),
    "G02": (1.0e-9, 5153.7, 0.97, -1.0, 0.1),
    "G03": (0.012, 5153.8, 0.95, 2.6, 3.05),
    "G04": (0.024, 5153.6, 0.98, -2.9, 1.4),
    "E14": (0.166, 5289.6, 0.87, 0.8, -1.3),  # the two Galileo satellites in a wrong orbit
    "E02": (2.0e-4, 5440.6, 0.98, -0.6, 2.2),
    "C19": (7.0e-4, 5282.6, 0.96, -0.2, -0.7),  # medium orbit
    "C08": (0.004, 6493.4, 1.02, -2.8, 0.9),  # inclined geosynchronous
    "C03": (5.0e-4, 6493.5, 0.09, 1.2, 2.0),  # geostationary
    "J02": (0.075, 6493.1, 0.71, -1.57, -0.4),  # quasi-zenith
}
GROUP_DELAY_S = {"G": (5.1e-9, 0.0), "J": (-4.2e-9, 0.0), "E": (2.3e-9, 2.8e-9), "C": (1.2e-8, 3.0e-9)}


def navigation_text(satellites: Iterable[str] = tuple(ORBITS)) -> str:
    """Return a RINEX 3.04 navigation file with one message of each satellite."""
    lines = [
        "     3.04           N: GNSS NAV DATA    M: MIXED            RINEX VERSION / TYPE",
        "".ljust(60) + "END OF HEADER",
    ]
    for sv in satellites:
        values = _message(sv)
        clock = "10 59 46" if sv[0] == "C" else "11 00 00"  # BeiDou time is 14 s behind
        lines.append(f"{sv} 2023 06 29 {clock}" + "".join(map(_number, values[:3])))
        lines += ["    " + "".join(map(_number, values[i : i + 4])) for i in range(3, len(values), 4)]
    return "\n".join(lines) + "\n"


def navigation_table(folder: Path, satellites: Iterable[str] = tuple(ORBITS)) -> EphemerisTable:
    """Return the messages of ``navigation_text`` as the package reads them."""
    path = folder / "self_made.rnx"
    path.write_text(navigation_text(satellites))
    data, _ = read_navigation([path])
    return data.ephemerides


def _number(value: float) -> str:
    return f"{value:19.12E}"


def _message(sv: str) -> list[float]:
    """Return the 31 numbers of a message in the order of RINEX 3."""
    e, sqrt_a, i0, omega, m0 = ORBITS[sv]
    first, second = GROUP_DELAY_S[sv[0]]
    own_week = WEEK - 1356 if sv[0] == "C" else WEEK
    toe = TOE_SOW - 14.0 if sv[0] == "C" else TOE_SOW
    still = sv == "C03"
    health = 0.0
    # SV accuracy, health, then the two delays; Galileo: BGD E5a, E5b; the word 517 says I/NAV from E1-B
    tail = {
        "G": [2.0, health, first, 12.0, toe - 3000.0, 4.0],
        "J": [2.0, health, first, 12.0, toe - 3000.0, 0.0],
        "E": [3.12, health, first, second, toe, 0.0],
        "C": [2.0, health, first, second, toe, 0.0],
    }[sv[0]]
    return [
        *(-3.2e-4, 4.5e-12, 2.0e-18),
        *(12.0, -40.5, 4.6e-9, m0),
        *(-2.1e-6, e, 7.7e-6, sqrt_a),
        *(toe, 1.1e-7, -1.9, -9.3e-8),
        *(i0, 236.4, omega, -2.0e-9 if still else -8.1e-9),
        *(3.1e-10, 517.0 if sv[0] == "E" else 0.0, float(own_week if sv[0] == "C" else WEEK), 0.0),
        *tail,
    ]


def copies(table: EphemerisTable, row: int, **changes: Iterable[Any]) -> EphemerisTable:
    """Return as many copies of one message as the changed columns have values."""
    n = len(list(next(iter(changes.values()))))
    repeated = {
        name: np.repeat(value[row : row + 1], n, axis=0)
        if isinstance(value, np.ndarray)
        else (value[row],) * n
        for name, value in vars(table).items()
    }
    given = {
        name: tuple(values) if name in ("sv_names", "message") else np.array(list(values))
        for name, values in changes.items()
    }
    return EphemerisTable(**(repeated | given))


def observations(
    sv_names: tuple[str, ...],
    t_ns: Iterable[int],
    pseudorange_m: Iterable[float],
    *,
    sv: Iterable[int] | None = None,
    code: str = "C1C",
) -> GnssTable:
    """Return a log of one signal; row k belongs to satellite k unless ``sv`` says otherwise."""
    t = np.array(list(t_ns), np.int64)
    n = len(t)
    nothing = np.full(n, np.nan)
    return GnssTable(
        t_ns=t,
        sv=np.array(list(range(n) if sv is None else sv), np.int16),
        signal=np.zeros(n, np.int16),
        pseudorange_m=np.array(list(pseudorange_m), dtype=np.float64),
        doppler_hz=nothing.copy(),
        range_rate_mps=nothing.copy(),
        cn0_dbhz=nothing.copy(),
        sv_names=sv_names,
        signal_names=(code,),
    )


def with_signals(log: GnssTable, codes: tuple[str, ...], signal: Iterable[int]) -> GnssTable:
    """Return the log with another signal in each row."""
    return replace(log, signal_names=codes, signal=np.array(list(signal), np.int16))
