"""Constellations to order: satellites placed where a scenario wants them, and an evenly filled sky.

Orbits are nominal GPS orbits. Every other quantity of a message (eccentricity, harmonic corrections, clock, group
delay) gets a value of its usual size, none is zero, so that an error in any term shows.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from insgnss.constants import GPS_OMEGA_RADPS, NS_PER_S, NS_PER_WEEK
from insgnss.geodesy.directions import directions
from insgnss.geodesy.ellipsoid import geodetic_to_ecef
from insgnss.geodesy.local_level import ecef_to_ned_matrix
from insgnss.simulation.constellation import mean_motion, satellite_states
from insgnss.simulation.rinex_nav import as_written
from insgnss.tables import EphemerisTable, Float64, NavigationData
from insgnss.units import deg_to_rad

SEMI_MAJOR_AXIS_M = 26_559_710.0  # IS-GPS-200N, 20.3.3.4.3: nominal, half a sidereal day
INCLINATION_DEG = 55.0
# A usual day's coefficients of the single-frequency ionosphere (GPS, about 10 TECU at night, 40 at noon)
KLOBUCHAR = (1.1176e-8, 1.4901e-8, -5.9605e-8, -5.9605e-8, 9.0112e4, 1.6384e4, -1.9661e5, -6.5536e4)
LEAP_SECONDS = 18
GOLDEN = 0.6180339887498949


@dataclass(frozen=True)
class SkyTrack:
    """A satellite's direction at the start and at the end of a scenario [deg]."""

    number: int
    azimuth_deg: tuple[float, float]
    elevation_deg: tuple[float, float]


# Sokolov and Yurchenko (2015), the scenario of 20 minutes with 11 GPS satellites
PAPER_SKY = (
    SkyTrack(1, (76.0, 68.0), (23.0, 26.0)),
    SkyTrack(2, (320.0, 314.0), (20.0, 26.0)),
    SkyTrack(4, (282.0, 270.0), (42.0, 41.0)),
    SkyTrack(10, (294.0, 294.0), (19.0, 28.0)),
    SkyTrack(13, (240.0, 244.0), (50.0, 59.0)),
    SkyTrack(16, (106.0, 100.0), (13.0, 20.0)),
    SkyTrack(20, (144.0, 144.0), (50.0, 41.0)),
    SkyTrack(23, (172.0, 116.0), (82.0, 79.0)),
    SkyTrack(30, (88.0, 80.0), (22.0, 26.0)),
    SkyTrack(31, (46.0, 44.0), (24.0, 17.0)),
    SkyTrack(32, (126.0, 128.0), (27.0, 19.0)),
)


def nominal_constellation(toe_ns: int, planes: int = 6, per_plane: int = 5) -> NavigationData:
    """Return an evenly filled GPS-like constellation (Walker pattern): 8 to 12 satellites anywhere on the Earth."""
    plane, slot = np.divmod(np.arange(planes * per_plane), per_plane)
    node = 2.0 * np.pi * plane / planes
    latitude = 2.0 * np.pi * (slot / per_plane + plane / (planes * per_plane))
    names = tuple(f"G{number:02d}" for number in range(1, planes * per_plane + 1))
    return _navigation(_messages(names, toe_ns, toe_ns, node, latitude))


def constellation_over(
    place: tuple[float, float, float],
    tracks: tuple[SkyTrack, ...],
    start_ns: int,
    duration_s: float,
    toe_ns: int,
) -> NavigationData:
    """Return satellites that start where the tracks say, on whichever orbit is nearer at the end.

    Parameters
    ----------
    place : latitude, longitude [deg], height [m]
    start_ns : GPS time at which the start of the tracks holds; the end is ``duration_s`` later
    toe_ns : reference time of the messages
    """
    r_e, C_ne = np.empty(3), np.empty((3, 3))
    geodetic_to_ecef(deg_to_rad(place[0]), deg_to_rad(place[1]), place[2], r_e)
    ecef_to_ned_matrix(deg_to_rad(place[0]), deg_to_rad(place[1]), C_ne)
    towards = _directions(tracks, 0) @ C_ne
    names = tuple(f"G{track.number:02d}" for track in tracks)
    choices = []
    for rising in (True, False):
        node, latitude = _orbit_through(r_e, towards, rising)
        choices.append(_messages(names, start_ns, toe_ns, node, latitude))
    miss = [_angle_off(eph, start_ns, duration_s, r_e, _directions(tracks, 1) @ C_ne) for eph in choices]
    nearer = np.argmin(miss, axis=0)
    return _navigation(_pick(choices, nearer))


def _directions(tracks: tuple[SkyTrack, ...], moment: int) -> Float64:
    """Return unit vectors (n, 3) towards the tracks' start (0) or end (1), north-east-down."""
    angles = [(track.azimuth_deg[moment], track.elevation_deg[moment]) for track in tracks]
    return directions(*np.transpose(angles))


def _orbit_through(r_e: Float64, towards: Float64, rising: bool) -> tuple[Float64, Float64]:
    """Return longitude of the node and argument of latitude (n,) of circular orbits, seen from ``r_e`` there.

    ``towards`` (n, 3) are the directions in ECEF axes, ``rising`` chooses the northbound half of the orbit. A point
    north of the inclination is replaced by the orbit's northernmost one.
    """
    along = towards @ r_e
    distance = -along + np.sqrt(along**2 - r_e @ r_e + SEMI_MAJOR_AXIS_M**2)
    point = (r_e + distance[:, None] * towards) / SEMI_MAJOR_AXIS_M
    inclination = deg_to_rad(INCLINATION_DEG)
    northern = np.arcsin(np.clip(point[:, 2] / np.sin(inclination), -1.0, 1.0))
    latitude = northern if rising else np.pi - northern
    from_node = np.arctan2(np.cos(inclination) * np.sin(latitude), np.cos(latitude))
    return np.arctan2(point[:, 1], point[:, 0]) - from_node, latitude


def _angle_off(eph: EphemerisTable, start_ns: int, after_s: float, r_e: Float64, towards: Float64) -> Float64:
    """Return the angle (n,) between wanted and real directions ``after_s`` after the start [rad]."""
    position = satellite_states(eph, start_ns, np.full((1, len(towards)), after_s)).r_e[0] - r_e
    unit = position / np.linalg.norm(position, axis=1)[:, None]
    return np.asarray(np.arccos(np.clip(np.sum(unit * towards, axis=1), -1.0, 1.0)))


def _pick(choices: list[EphemerisTable], which: np.ndarray) -> EphemerisTable:
    """Return the table whose row k is taken from ``choices[which[k]]``; only node and anomaly differ."""
    rows = np.arange(len(which))
    omega0 = np.stack([eph.omega0 for eph in choices])[which, rows]
    m0 = np.stack([eph.m0 for eph in choices])[which, rows]
    return dataclasses.replace(choices[0], omega0=omega0, m0=m0)


def _spread(count: int, seed: int, size: float) -> Float64:
    """Return ``count`` different values, evenly spread within +- ``size`` and never zero."""
    fraction = np.modf((np.arange(count) + 1.0) * GOLDEN * (2 * seed + 1) + 0.37)[0]
    return np.asarray(size * np.where(np.abs(2.0 * fraction - 1.0) < 0.05, 0.5, 2.0 * fraction - 1.0))


def _messages(
    names: tuple[str, ...], start_ns: int, toe_ns: int, node: Float64, latitude: Float64
) -> EphemerisTable:
    """Return messages of satellites that have this longitude of node and argument of latitude [rad] at the start."""
    n = len(names)
    e = 0.011 + _spread(n, 1, 0.006)
    omega = _spread(n, 2, np.pi)
    omega_dot = -8.0e-9 + _spread(n, 3, 5e-10)
    sqrt_a = np.sqrt(SEMI_MAJOR_AXIS_M + _spread(n, 7, 900.0))
    delta_n = 4.5e-9 + _spread(n, 9, 5e-10)
    toe_sow = (toe_ns % NS_PER_WEEK) / NS_PER_S
    true = latitude - omega
    E = np.arctan2(np.sqrt(1.0 - e**2) * np.sin(true), e + np.cos(true))
    to_start = (start_ns - toe_ns) / NS_PER_S
    eph = EphemerisTable(
        sv_names=names,
        message=("LNAV",) * n,
        toe_ns=np.full(n, toe_ns, dtype=np.int64),
        toc_ns=np.full(n, toe_ns, dtype=np.int64),
        toe_sow_s=np.full(n, toe_sow),
        af0=_spread(n, 4, 4e-4),
        af1=_spread(n, 5, 1e-11),
        af2=_spread(n, 6, 5e-17),
        sqrt_a=sqrt_a,
        e=e,
        i0=deg_to_rad(INCLINATION_DEG) + _spread(n, 8, 2e-3),
        # the node is a longitude at the start; the message counts it from the equinox at the start of the week
        omega0=_wrapped(node - (omega_dot - GPS_OMEGA_RADPS) * to_start + GPS_OMEGA_RADPS * toe_sow),
        omega=omega,
        m0=_wrapped(E - e * np.sin(E) - mean_motion(sqrt_a, delta_n) * to_start),
        delta_n=delta_n,
        omega_dot=omega_dot,
        idot=_spread(n, 10, 3e-10),
        cuc=_spread(n, 11, 3e-6),
        cus=_spread(n, 12, 9e-6),
        crc=220.0 + _spread(n, 13, 90.0),
        crs=_spread(n, 14, 80.0),
        cic=_spread(n, 15, 1.5e-7),
        cis=_spread(n, 16, 1.5e-7),
        group_delay_s=np.column_stack([_spread(n, 17, 1.2e-8), np.zeros(n)]),
        health=np.zeros(n),
        accuracy_m=np.full(n, 2.0),
        issue=21.0 + np.arange(n, dtype=np.float64) % 200.0,
        fit_interval_s=np.full(n, 4.0 * 3600.0),
    )
    return as_written(NavigationData(eph, None, None)).ephemerides


def _wrapped(angle: Float64) -> Float64:
    """Return the angle within +- pi."""
    return np.asarray(np.arctan2(np.sin(angle), np.cos(angle)))


def _navigation(eph: EphemerisTable) -> NavigationData:
    return as_written(NavigationData(eph, np.array(KLOBUCHAR), LEAP_SECONDS))
