"""Writes ephemerides as a RINEX 3.04 navigation file, GPS's and QZSS's, and rounds them to the file's digits.

The truth is computed from the rounded values, so the file is exact.
"""

from __future__ import annotations

import dataclasses
import datetime as dt
from pathlib import Path

import numpy as np

from insgnss.constants import NS_PER_WEEK
from insgnss.gpstime import ns_to_datetime
from insgnss.tables import EphemerisTable, Float64, NavigationData

_INTEGER_FIELDS = ("sv_names", "message", "toe_ns", "toc_ns")
_TRANSMITTED_BEFORE_TOE_S = 7200.0  # the usual age of a message whose reference time is still ahead


def _d19(value: float) -> str:
    """Return a number in the field D19.12: 13 significant digits."""
    return f"{value:19.12E}"


def _d12(value: float) -> str:
    """Return a number in the field D12.4 of the header: five significant digits."""
    return f"{value:12.4E}"


def as_written(navigation: NavigationData) -> NavigationData:
    """Return the navigation data with each number rounded to the digits that the file has for it."""
    eph = navigation.ephemerides
    rounded = {
        f.name: np.vectorize(lambda value: float(_d19(value)), otypes=[float])(getattr(eph, f.name))
        for f in dataclasses.fields(EphemerisTable)
        if f.name not in _INTEGER_FIELDS
    }
    klobuchar = navigation.klobuchar
    if klobuchar is not None:
        klobuchar = np.array([float(_d12(value)) for value in klobuchar])
    return NavigationData(dataclasses.replace(eph, **rounded), klobuchar, navigation.leap_seconds)


def write_rinex_navigation(path: Path, navigation: NavigationData, created: dt.datetime) -> None:
    """Write the file; ``created`` is the date put into its header."""
    lines = _header(navigation, created)
    for row in range(len(navigation.ephemerides.sv_names)):
        lines += _record(navigation.ephemerides, row)
    path.write_bytes(("\n".join(lines) + "\n").encode("ascii"))


def _labelled(content: str, label: str) -> str:
    return f"{content:<60}{label}"


def _header(navigation: NavigationData, created: dt.datetime) -> list[str]:
    origin = f"{'insgnss':<20}{'simulation':<20}{created:%Y%m%d %H%M%S} UTC"
    systems = {name[0] for name in navigation.ephemerides.sv_names}
    system = "G: GPS" if systems <= {"G"} else "M: MIXED"
    lines = [
        _labelled(f"     3.04           N: GNSS NAV DATA    {system}", "RINEX VERSION / TYPE"),
        _labelled(origin, "PGM / RUN BY / DATE"),
        _labelled("simulated satellites, not those of this date", "COMMENT"),
    ]
    if navigation.klobuchar is not None:
        for name, values in (("GPSA", navigation.klobuchar[:4]), ("GPSB", navigation.klobuchar[4:])):
            lines.append(_labelled(f"{name} " + "".join(_d12(value) for value in values), "IONOSPHERIC CORR"))
    if navigation.leap_seconds is not None:
        lines.append(_labelled(f"{navigation.leap_seconds:6d}", "LEAP SECONDS"))
    return [*lines, _labelled("", "END OF HEADER")]


def _record(eph: EphemerisTable, row: int) -> list[str]:
    """Return the eight lines of one message [RINEX 3.04, table A6]."""

    def of(values: Float64) -> float:
        return float(values[row])

    week = float(eph.toe_ns[row] // NS_PER_WEEK)
    fit_h = of(eph.fit_interval_s) / 3600.0
    when = ns_to_datetime(int(eph.toc_ns[row]))
    first = f"{eph.sv_names[row]} {when:%Y %m %d %H %M %S}"
    orbit = (
        (of(eph.issue), of(eph.crs), of(eph.delta_n), of(eph.m0)),
        (of(eph.cuc), of(eph.e), of(eph.cus), of(eph.sqrt_a)),
        (of(eph.toe_sow_s), of(eph.cic), of(eph.omega0), of(eph.cis)),
        (of(eph.i0), of(eph.crc), of(eph.omega), of(eph.omega_dot)),
        (of(eph.idot), 1.0, week, 0.0),
        (of(eph.accuracy_m), of(eph.health), float(eph.group_delay_s[row, 0]), of(eph.issue)),
        (of(eph.toe_sow_s) - _TRANSMITTED_BEFORE_TOE_S, fit_h),
    )
    clock = first + "".join(_d19(value) for value in (of(eph.af0), of(eph.af1), of(eph.af2)))
    return [clock] + ["    " + "".join(_d19(value) for value in line) for line in orbit]
