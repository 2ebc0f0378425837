"""A run as NMEA 0183: RMC, GGA, VTG, HDT and GST at every row."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.report.solution import NavSolution, solution
from insgnss.runs.result import Run
from insgnss.tables import Bool, Float64
from insgnss.units import SI_PER_UNIT

_KNOT_MPS: Final = SI_PER_UNIT["kn"]
_KMH_MPS: Final = SI_PER_UNIT["km/h"]
_TALKER: Final = "GN"  # several satellite systems, or inertial besides one


def as_nmea(run: Run) -> bytes:
    """Return the run as NMEA 0183: UTC to the millisecond, height above mean sea level (EGM96), true heading.

    A row without satellites is dead reckoning (GGA quality 6, mode E). HDT is empty while the heading is not known,
    the course of RMC and VTG while the speed is below its sigma.
    """
    s = solution(run)
    # readers take the date of a GGA from the RMC before
    sentences = (_rmc(s), _gga(s), _vtg(s), _hdt(s), _gst(s))
    signed = [_with_checksum(texts) for texts in sentences]
    return "".join(text for row in zip(*signed, strict=True) for text in row).encode("ascii")


def _with_checksum(bodies: list[str]) -> list[str]:
    """Return sentences from the text between $ and *: the checksum is the exclusive or of its bytes."""
    table = np.array([text.encode("ascii") for text in bodies])
    letters = table.view(np.uint8).reshape(len(bodies), -1)  # filled up by zeros, which change nothing
    sums = np.bitwise_xor.reduce(letters, axis=1).tolist()
    return [f"${text}*{value:02X}\r\n" for text, value in zip(bodies, sums, strict=True)]


def _gga(s: NavSolution) -> list[str]:
    quality = np.where(s.dead_reckoning, 6, 2 if s.differential else 1).tolist()
    hdop = ["" if value != value else f"{min(value, 99.9):.1f}" for value in s.hdop.tolist()]
    columns = zip(
        _clock(s),
        _places(s),
        quality,
        s.satellites.tolist(),
        hdop,
        *s.columns("h_msl_m", "geoid_m"),
        strict=True,
    )
    return [
        f"{_TALKER}GGA,{clock},{place},{q},{n:02d},{dop},{h:.2f},M,{geoid:.2f},M,,"
        for clock, place, q, n, dop, h, geoid in columns
    ]


def _rmc(s: NavSolution) -> list[str]:
    speed, course = _speed_course(s)
    columns = zip(_clock(s), _places(s), speed.tolist(), course, _days(s), _modes(s), strict=True)
    return [
        f"{_TALKER}RMC,{clock},A,{place},{v / _KNOT_MPS:.3f},{way},{day},,,{mode}"
        for clock, place, v, way, day, mode in columns
    ]


def _vtg(s: NavSolution) -> list[str]:
    speed, course = _speed_course(s)
    return [
        f"{_TALKER}VTG,{way},T,,M,{v / _KNOT_MPS:.3f},N,{v / _KMH_MPS:.3f},K,{mode}"
        for v, way, mode in zip(speed.tolist(), course, _modes(s), strict=True)
    ]


def _hdt(s: NavSolution) -> list[str]:
    heading = _directions(s.nav["heading_deg"].to_numpy(), s.heading_known)
    return [f"{_TALKER}HDT,{text},T" for text in heading]


def _gst(s: NavSolution) -> list[str]:
    """Return the sigmas of latitude, longitude and height; the error ellipse is not in the navigation table."""
    columns = zip(_clock(s), *s.columns("sd_n_m", "sd_e_m", "sd_d_m"), strict=True)
    return [f"{_TALKER}GST,{clock},,,,,{n:.3f},{e:.3f},{d:.3f}" for clock, n, e, d in columns]


def _dates(s: NavSolution) -> npt.NDArray[np.str_]:
    rounded = (s.utc + np.timedelta64(500, "us")).astype("datetime64[ms]")
    return np.datetime_as_string(rounded)


def _clock(s: NavSolution) -> list[str]:
    """Return the times of day: hhmmss.sss."""
    return [f"{text[11:13]}{text[14:16]}{text[17:]}" for text in _dates(s).tolist()]


def _days(s: NavSolution) -> list[str]:
    """Return the dates: ddmmyy."""
    return [f"{text[8:10]}{text[5:7]}{text[2:4]}" for text in _dates(s).tolist()]


def _modes(s: NavSolution) -> list[str]:
    modes: list[str] = np.where(s.dead_reckoning, "E", "D" if s.differential else "A").tolist()
    return modes


def _places(s: NavSolution) -> list[str]:
    """Return latitude and longitude in degrees and minutes, to 2 mm: 'ddmm.mmmmmm,N,dddmm.mmmmmm,E'."""
    lat, lon = s.nav["lat_deg"].to_numpy(), s.nav["lon_deg"].to_numpy()
    hemispheres = zip(np.where(lat < 0.0, "S", "N"), np.where(lon < 0.0, "W", "E"), strict=True)
    parts = zip(_minutes(lat, 2), _minutes(lon, 3), hemispheres, strict=True)
    return [f"{north},{ns},{east},{ew}" for north, east, (ns, ew) in parts]


def _minutes(angle_deg: Float64, digits: int) -> list[str]:
    """Return angles as degrees of so many digits and minutes: '4500.123456'."""
    # whole micro-minutes, so that 59.9999999 minutes are the next degree
    degrees, rest = np.divmod(np.rint(np.abs(angle_deg) * 60e6).astype(np.int64), 60_000_000)
    return [
        f"{deg:0{digits}d}{part // 1_000_000:02d}.{part % 1_000_000:06d}"
        for deg, part in zip(degrees.tolist(), rest.tolist(), strict=True)
    ]


def _speed_course(s: NavSolution) -> tuple[Float64, list[str]]:
    """Return the speed over ground [m/s], and the course where the speed is above its sigma."""
    vn, ve = s.nav["vn_mps"].to_numpy(), s.nav["ve_mps"].to_numpy()
    speed = np.hypot(vn, ve)
    known = speed > np.hypot(s.nav["sd_vn_mps"].to_numpy(), s.nav["sd_ve_mps"].to_numpy())
    return speed, _directions(np.degrees(np.arctan2(ve, vn)), known)


def _directions(angle_deg: Float64, known: Bool) -> list[str]:
    """Return directions from 000.00 to 359.99, empty where they are not known."""
    hundredths = np.rint(angle_deg * 100.0).astype(np.int64) % 36_000
    return [
        f"{value // 100:03d}.{value % 100:02d}" if ok else ""
        for value, ok in zip(hundredths.tolist(), known.tolist(), strict=True)
    ]
