"""Where the simulated satellites are: Keplerian orbits and clocks of a GPS ephemeris, position and velocity.

Written on its own from IS-GPS-200N, 20.3.3.4.3, and on purpose shares nothing with the engine's orbit code: one is the
other's test.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insgnss.constants import C_MPS, GPS_MU_M3PS2, GPS_OMEGA_RADPS, NS_PER_S
from insgnss.tables import EphemerisTable, Float64

KEPLER_STEPS = 6  # Newton doubles the digits at each step: from e = 0.02 three are enough, from 0.3 six
RELATIVITY_F = -2.0 * np.sqrt(GPS_MU_M3PS2) / C_MPS**2  # [s/sqrt(m)], IS-GPS-200N, 20.3.3.3.3.1


@dataclass(frozen=True)
class ConstellationStates:
    """Satellites at times of their own, ECEF of the same moment; clock without group delay, relativity included."""

    r_e: Float64  # (m, n, 3) [m]
    v_e: Float64  # (m, n, 3) relative to the Earth [m/s]
    clock_s: Float64  # (m, n)
    clock_rate: Float64  # (m, n) [s/s]


@dataclass(frozen=True)
class _InPlane:
    """Motion in the orbit's plane, with its derivative by time: radius, argument of latitude, inclination."""

    radius: Float64
    radius_rate: Float64
    latitude: Float64
    latitude_rate: Float64
    inclination: Float64
    inclination_rate: Float64


def since(start_ns: int, reference_ns: np.ndarray, t_s: Float64) -> Float64:
    """Return seconds from each of ``reference_ns`` (n,) to ``t_s`` (m, n) seconds after ``start_ns``."""
    return np.asarray((np.int64(start_ns) - reference_ns) / NS_PER_S + t_s)


def mean_motion(sqrt_a: Float64, delta_n: Float64) -> Float64:
    """Return the corrected mean motion (n,) [rad/s]: ``n = sqrt(mu / a^3) + delta n``."""
    return np.asarray(np.sqrt(GPS_MU_M3PS2) / sqrt_a**3 + delta_n)


def eccentric_anomaly(mean: Float64, e: Float64) -> Float64:
    """Return E of Kepler's equation ``E - e sin E = M`` [rad], by Newton's method."""
    E = mean + e * np.sin(mean)
    for _ in range(KEPLER_STEPS):
        E = E - (E - e * np.sin(E) - mean) / (1.0 - e * np.cos(E))
    return np.asarray(E)


def satellite_states(eph: EphemerisTable, start_ns: int, t_s: Float64) -> ConstellationStates:
    """Return the state of each ephemeris's satellite at its own times.

    Parameters
    ----------
    eph : n ephemerides, one per satellite
    start_ns : GPS time of t = 0
    t_s : (m, n) times, one column per satellite [s]
    """
    tk = since(start_ns, eph.toe_ns, t_s)
    n = mean_motion(eph.sqrt_a, eph.delta_n)
    E = eccentric_anomaly(eph.m0 + n * tk, eph.e)
    E_rate = n / (1.0 - eph.e * np.cos(E))
    r_e, v_e = _to_ecef(eph, tk, _in_plane(eph, tk, E, E_rate))
    dt = since(start_ns, eph.toc_ns, t_s)
    relativity = RELATIVITY_F * eph.e * eph.sqrt_a
    clock = eph.af0 + dt * (eph.af1 + dt * eph.af2) + relativity * np.sin(E)
    rate = eph.af1 + 2.0 * eph.af2 * dt + relativity * np.cos(E) * E_rate
    return ConstellationStates(r_e, v_e, np.asarray(clock), np.asarray(rate))


def _in_plane(eph: EphemerisTable, tk: Float64, E: Float64, E_rate: Float64) -> _InPlane:
    """Return radius, argument of latitude and inclination with their second-harmonic corrections."""
    root = np.sqrt(1.0 - eph.e**2)
    phi = np.arctan2(root * np.sin(E), np.cos(E) - eph.e) + eph.omega
    phi_rate = root * E_rate / (1.0 - eph.e * np.cos(E))
    sine, cosine = np.sin(2.0 * phi), np.cos(2.0 * phi)
    # d/dt (s sin 2 phi + c cos 2 phi) = 2 phi' (s cos 2 phi - c sin 2 phi)
    along = 1.0 + 2.0 * (eph.cus * cosine - eph.cuc * sine)
    axis = eph.sqrt_a**2
    return _InPlane(
        radius=axis * (1.0 - eph.e * np.cos(E)) + eph.crs * sine + eph.crc * cosine,
        radius_rate=axis * eph.e * np.sin(E) * E_rate + 2.0 * phi_rate * (eph.crs * cosine - eph.crc * sine),
        latitude=phi + eph.cus * sine + eph.cuc * cosine,
        latitude_rate=phi_rate * along,
        inclination=eph.i0 + eph.idot * tk + eph.cis * sine + eph.cic * cosine,
        inclination_rate=eph.idot + 2.0 * phi_rate * (eph.cis * cosine - eph.cic * sine),
    )


def _to_ecef(eph: EphemerisTable, tk: Float64, plane: _InPlane) -> tuple[Float64, Float64]:
    """Return ECEF position and velocity.

    Equation: ``r = R3(-node) R1(-i) (radius cos u, radius sin u, 0)`` and its derivative by time.
    """
    node_rate = eph.omega_dot - GPS_OMEGA_RADPS
    node = eph.omega0 + node_rate * tk - GPS_OMEGA_RADPS * eph.toe_sow_s
    cos_u, sin_u = np.cos(plane.latitude), np.sin(plane.latitude)
    x, y = plane.radius * cos_u, plane.radius * sin_u
    x_rate = plane.radius_rate * cos_u - y * plane.latitude_rate
    y_rate = plane.radius_rate * sin_u + x * plane.latitude_rate
    cos_i, sin_i = np.cos(plane.inclination), np.sin(plane.inclination)
    # the plane tilted by i: (x, p, q)
    p, q = y * cos_i, y * sin_i
    p_rate = y_rate * cos_i - q * plane.inclination_rate
    q_rate = y_rate * sin_i + p * plane.inclination_rate
    cos_n, sin_n = np.cos(node), np.sin(node)
    X, Y = x * cos_n - p * sin_n, x * sin_n + p * cos_n
    r_e = np.stack([X, Y, q], axis=-1)
    v_e = np.stack(
        [
            x_rate * cos_n - p_rate * sin_n - Y * node_rate,
            x_rate * sin_n + p_rate * cos_n + X * node_rate,
            q_rate,
        ],
        axis=-1,
    )
    return r_e, v_e
