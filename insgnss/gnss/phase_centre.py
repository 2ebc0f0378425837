"""Where a satellite's antenna is: precise orbits give the centre of mass, the signal leaves the phase centre.

The body axes follow from the Sun by the nominal attitude: z to the Earth's centre, y along the solar panels' axis, x
towards the side of the Sun [Montenbruck et al. 2015, Adv. Space Res. 56(6)]. The offset is that of the pair of signals
to which the precise clock refers, for all signals: a broadcast group delay is measured against the same pair, and
holds the difference of the single signals' offsets (below 0.2 m).
Neglects: noon and midnight turns and orbit-normal mode (0.3 m across the line of sight, 7 cm of range), and the
variation with the nadir angle (1 cm).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from insgnss.constants import NS_PER_S, S_PER_DAY
from insgnss.gpstime import leap_seconds, ns_to_datetime
from insgnss.tables import Bool, Float64, Int64

ASTRONOMICAL_UNIT_M: Final = 149_597_870_700.0  # IAU 2012, resolution B2
_J2000_S: Final = 630_763_200.0  # 2000-01-01 12:00, 7300.5 days after the start of GPS time


@dataclass(frozen=True)
class SatelliteAntennas:
    """Phase-centre offsets, one row for each satellite and span of time, in body axes."""

    sv_names: tuple[str, ...]  # of each row
    from_ns: Int64  # (n,) GPS time
    until_ns: Int64  # (n,)
    offset_b: Float64  # (n, 3) centre of mass to phase centre of the reference pair, body x, y, z [m]


def sun_position(t_ns: Int64) -> Float64:
    """Return the Sun's position (n, 3), ECEF [m].

    Equation: mean longitude L = 280.460 + 0.9856474 d, anomaly g = 357.528 + 0.9856003 d [deg],
    ecliptic longitude L + 1.915 sin g + 0.020 sin 2g, d days since J2000    [The Astronomical Almanac, section C]
    Neglects: 0.01 deg of direction between 1950 and 2050, the equation of equinoxes (5e-3 deg) and UT1 - UTC.

    Parameters
    ----------
    t_ns : (n,) GPS time
    """
    t_ns = np.asarray(t_ns, dtype=np.int64)
    leap = leap_seconds(ns_to_datetime(int(t_ns[0]))) if len(t_ns) else 0
    days = (t_ns / NS_PER_S - leap - _J2000_S) / S_PER_DAY  # of universal time
    anomaly = np.radians(357.528 + 0.9856003 * days)
    longitude = np.radians(
        280.460 + 0.9856474 * days + 1.915 * np.sin(anomaly) + 0.020 * np.sin(2.0 * anomaly)
    )
    obliquity = np.radians(23.439 - 4e-7 * days)
    distance = ASTRONOMICAL_UNIT_M * (1.00014 - 0.01671 * np.cos(anomaly) - 0.00014 * np.cos(2.0 * anomaly))
    # right ascension less the Earth's rotation: Greenwich mean sidereal time
    x, y = np.cos(longitude), np.cos(obliquity) * np.sin(longitude)
    turned = np.radians(280.46062 + 360.985647366 * days)
    sine, cosine = np.sin(turned), np.cos(turned)
    direction = [cosine * x + sine * y, cosine * y - sine * x, np.sin(obliquity) * np.sin(longitude)]
    return np.asarray(distance[:, None] * np.column_stack(direction))


def body_axes(r_e: Float64, sun_e: Float64) -> Float64:
    """Return C_eb (n, 3, 3), columns x, y, z of the satellite's body in ECEF, by the nominal attitude.

    Equation: z = -r / |r|, y = z x s / |z x s|, x = y x z, s towards the Sun.

    Parameters
    ----------
    r_e, sun_e : (n, 3) satellite and Sun, ECEF [m]
    """
    z = -_unit(r_e)
    y = _unit(np.cross(z, _unit(sun_e - r_e)))
    return np.stack([np.cross(y, z), y, z], axis=-1)


def phase_centre_offsets(antennas: SatelliteAntennas, sv: str, t_ns: Int64, r_e: Float64) -> Float64:
    """Return what to add to a satellite's centre of mass (n, 3), ECEF [m]; zero where no antenna is known.

    Parameters
    ----------
    antennas : of all satellites
    sv : the satellite's name
    t_ns : (n,) GPS time
    r_e : (n, 3) centre of mass, ECEF [m]
    """
    offset_b, known = offsets_of(antennas, sv, t_ns)
    if not known.any():
        return np.zeros((len(t_ns), 3))
    return np.asarray(np.einsum("nij,nj->ni", body_axes(r_e, sun_position(t_ns)), offset_b))


def offsets_of(antennas: SatelliteAntennas, sv: str, t_ns: Int64) -> tuple[Float64, Bool]:
    """Return the offset in body axes (n, 3) at each time, zero where none is known, and where one is."""
    offset_b, known = np.zeros((len(t_ns), 3)), np.zeros(len(t_ns), np.bool_)
    for row, name in enumerate(antennas.sv_names):
        if name == sv:
            within = (t_ns >= antennas.from_ns[row]) & (t_ns <= antennas.until_ns[row])
            offset_b[within], known[within] = antennas.offset_b[row], True
    return offset_b, known


def _unit(vectors: Float64) -> Float64:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300))
