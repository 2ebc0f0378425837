"""Writes broadcast messages as a RINEX 3.05 navigation file, all systems in one.

RINEX 3.05, tables A5 (header) and A6 to A20 (messages): numbers with 13 significant digits. Fields that the tables do
not hold are left blank or get the document's value for "not known": the time of transmission (0.9999E9), the codes on
L2, IODC (written as the issue of the ephemeris).
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from insgnss.constants import M_PER_KM, NS_PER_S, NS_PER_WEEK
from insgnss.errors import InputError
from insgnss.gnss.signals import UNKNOWN_CHANNEL
from insgnss.gpstime import BDT_MINUS_GPST_S, BDT_WEEK_OFFSET, leap_seconds, ns_to_datetime
from insgnss.tables import EphemerisTable, NavigationData, StateVectorTable

VERSION: Final = 3.05
_TRANSMISSION_UNKNOWN: Final = 0.9999e9
# Galileo data sources (table A8): I/NAV of E1 and E5b with the E1/E5b clock, F/NAV of E5a with the E1/E5a clock
_GALILEO_SOURCES: Final = {"INAV": 0b10_0000_0101, "FNAV": 0b01_0000_0010}
_NO_ACCURACY: Final = {"E": -1.0}  # "no accuracy prediction available"
_UNKNOWN_URA: Final = 15.0
# Ionosphere: names of the header lines for each set of coefficients
_IONOSPHERE: Final = {
    "gps": ("GPSA", "GPSB"),
    "galileo": ("GAL ",),
    "beidou": ("BDSA", "BDSB"),
    "qzss": ("QZSA", "QZSB"),
    "navic": ("IRNA", "IRNB"),
}


def write_rinex_navigation(path: Path, navigation: NavigationData, created: dt.datetime) -> int:
    """Write the file and return the number of its messages; ``created`` is the date put into its header.

    Raises
    ------
    InputError : the file cannot be written
    """
    lines = _header(navigation, created)
    table, states = navigation.ephemerides, navigation.state_vectors
    for row in range(len(table.sv_names)):
        lines += _keplerian(table, row)
    n_states = 0 if states is None else len(states.sv_names)
    for row in range(n_states):
        assert states is not None
        lines += _state_vector(states, row, navigation.leap_seconds)
    try:
        path.write_text("\n".join(lines) + "\n", encoding="ascii", newline="\n")
    except OSError as error:
        raise InputError(f"cannot be written: {error}", file=path) from error
    return len(table.sv_names) + n_states


def _header(navigation: NavigationData, created: dt.datetime) -> list[str]:
    lines = [
        _labelled(f"{VERSION:9.2f}{'':11}{'N: GNSS NAV DATA':<20}{'M: MIXED':<20}", "RINEX VERSION / TYPE"),
        _labelled(f"{'insgnss':<20}{'':20}{created:%Y%m%d %H%M%S} UTC", "PGM / RUN BY / DATE"),
    ]
    ionosphere = dict(navigation.ionosphere)
    if navigation.klobuchar is not None:
        ionosphere["gps"] = navigation.klobuchar
    for system, names in _IONOSPHERE.items():
        values = ionosphere.get(system)
        for part, name in enumerate(names if values is not None else ()):
            assert values is not None
            numbers = "".join(f"{value:12.4E}" for value in values[4 * part : 4 * part + 4])
            lines.append(_labelled(f"{name} {numbers}", "IONOSPHERIC CORR"))
    if navigation.leap_seconds is not None:
        lines.append(_labelled(f"{navigation.leap_seconds:6d}", "LEAP SECONDS"))
    return [*lines, _labelled("", "END OF HEADER")]


def _labelled(content: str, label: str) -> str:
    return f"{content:<60}{label}"


def _numbers(values: Sequence[float | None]) -> str:
    """Return numbers in fields D19.12, blank for None and NaN."""
    return "".join(" " * 19 if value is None or np.isnan(value) else f"{value:19.12E}" for value in values)


def _date(when: dt.datetime) -> str:
    return f"{when:%Y %m %d %H %M %S}"


def _keplerian(table: EphemerisTable, row: int) -> list[str]:
    sv = table.sv_names[row]
    shift_ns = BDT_MINUS_GPST_S * NS_PER_S if sv[0] == "C" else 0  # to the system's own time
    toc = ns_to_datetime(int(table.toc_ns[row]) + shift_ns)
    week = float(
        (int(table.toe_ns[row]) + shift_ns) // NS_PER_WEEK - (BDT_WEEK_OFFSET if sv[0] == "C" else 0)
    )

    def of(*names: str) -> list[float | None]:
        return [float(getattr(table, name)[row]) for name in names]

    accuracy = float(table.accuracy_m[row])
    accuracy = _NO_ACCURACY.get(sv[0], accuracy) if np.isnan(accuracy) else accuracy
    delays = [float(value) for value in table.group_delay_s[row]]
    issue = float(table.issue[row])
    fit_h = float(table.fit_interval_s[row]) / 3600.0
    after_delay = {"E": delays[1], "C": delays[1], "G": issue, "J": issue}.get(sv[0])
    sources = {"E": float(_GALILEO_SOURCES.get(table.message[row], 0)), "G": 0.0, "J": 0.0}.get(sv[0])
    last = {"G": fit_h, "J": 0.0 if np.isnan(fit_h) or fit_h <= 2.0 else 1.0, "C": issue}.get(sv[0])
    orbit = [
        of("issue", "crs", "delta_n", "m0"),
        of("cuc", "e", "cus", "sqrt_a"),
        of("toe_sow_s", "cic", "omega0", "cis"),
        of("i0", "crc", "omega", "omega_dot"),
        [*of("idot"), sources, week, 0.0 if sv[0] in "GJ" else None],
        [accuracy, *of("health"), delays[0], after_delay],
        [_TRANSMISSION_UNKNOWN, last],
    ]
    head = f"{sv} {_date(toc)}{_numbers(of('af0', 'af1', 'af2'))}"
    return [head, *(f"    {_numbers(values)}".rstrip() for values in orbit)]


def _state_vector(states: StateVectorTable, row: int, leap: int | None) -> list[str]:
    """Return a GLONASS message (its time is UTC) or one of SBAS (GPS time)."""
    sv, glonass = states.sv_names[row], states.sv_names[row][0] == "R"
    when = ns_to_datetime(int(states.t_ns[row]))
    if glonass:
        when -= dt.timedelta(seconds=leap_seconds(when) if leap is None else leap)
    seconds_of_week = float(int(states.t_ns[row]) % NS_PER_WEEK // NS_PER_S)
    channel = int(states.channel[row])
    ends: list[float | None] = [float(states.health[row]), None, None]
    if glonass:
        ends = [float(states.health[row] != 0), None if channel == UNKNOWN_CHANNEL else channel, 0.0]
    head = [float(states.clock_s[row]), float(states.clock_rate[row]), seconds_of_week]
    lines = [f"{sv} {_date(when)}{_numbers(head)}"]
    for axis, end in enumerate(ends):
        vectors = [float(v[row, axis]) / M_PER_KM for v in (states.r_e, states.v_e, states.a_e)]
        lines.append(f"    {_numbers([*vectors, end])}".rstrip())
    if glonass:
        unhealthy = float(int(states.health[row]) >> 1 & 1)
        lines.append(
            f"    {_numbers([0.0, float(states.group_delay_s[row]), _UNKNOWN_URA, unhealthy])}".rstrip()
        )
    return lines
