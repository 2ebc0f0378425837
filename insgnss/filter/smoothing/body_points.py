"""Further outputs of a navigation row: quaternion, full covariances, and any point of the body.

A point at l from the IMU in body axes, C = C_eb:

    r_p = r + C l                 dr_p = dr - [C l x] psi
    v_p = v + s - w_ie x C l      dv_p = dv - ([s x] - [w_ie x] [C l x]) psi + C [l x] (db_g - n)

with s = C (w_ib x l), w_ib the gyros' rate less its bias, n their noise, and C_hat = (I + [psi x]) C. In the local
level of its own place, as the row's sigmas are: d r_n = C_ne dr_p, d v_n = C_ne dv_p + v_n x theta, theta = T dr_p; the
attitude's errors are phi = C_ne psi - T dr (``nav_sigmas``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.filter.imu.sensor_outage import MOTION_TIME_S
from insgnss.filter.output.further_columns import COVARIANCES, PAIRS, POINT, POINT_COVARIANCES, QUATERNION
from insgnss.filter.output.nav_sigmas import level_turn
from insgnss.filter.output.total_sigmas import slow_covariances
from insgnss.filter.output.writing import NAV_COLUMNS, Table
from insgnss.filter.prediction import ImuSamples
from insgnss.filter.state import BG, DR, DV, PSI
from insgnss.geodesy.ellipsoid import ecef_to_geodetic, geodetic_to_ecef
from insgnss.geodesy.local_level import ecef_to_ned_matrix
from insgnss.geodesy.rotations import EARTH_RATE_E, cross_matrix, euler_to_matrix, matrix_to_quaternion
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64, Int64

_VELOCITY: Final = slice(NAV_COLUMNS.index("vn_mps"), NAV_COLUMNS.index("vd_mps") + 1)
_ATTITUDE: Final = slice(NAV_COLUMNS.index("roll_deg"), NAV_COLUMNS.index("yaw_deg") + 1)
_BIAS: Final = NAV_COLUMNS.index("gyro_bias_x_radps")
_N: Final = BG + 3  # error states that matter here


@dataclass(frozen=True)
class PointColumns:
    """The requested columns besides those of every row."""

    lever_b: tuple[float, float, float] | None = None  # IMU to the point, body axes [m]; None: no point
    quaternion: bool = False
    covariance: bool = False

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns, in their order."""
        names: tuple[str, ...] = QUATERNION if self.quaternion else ()
        names += COVARIANCES if self.covariance else ()
        if self.lever_b is None:
            return names
        return names + POINT + (POINT_COVARIANCES if self.covariance else ())


@dataclass
class PointColumnValues:
    """These columns of a log's navigation rows, filled as the rows are."""

    wanted: PointColumns
    values: Float64 = field(default_factory=lambda: np.zeros((0, 0)))  # (n_nav, k)

    def room(self, n_nav: int) -> None:
        """Make room for ``n_nav`` rows."""
        self.values = np.zeros((n_nav, len(self.wanted.columns)))

    def write(self, rows: slice, nav: Table, P: Float64, imu: ImuSamples, par: Any) -> None:
        """Write the columns of navigation ``rows`` with covariances ``P`` (m, q, q)."""
        t_ns, value = nav["t_ns"][rows], nav["value"][rows]
        rates, variances = rates_at(imu, t_ns, par)
        rates -= value[:, _BIAS : _BIAS + 3]
        total = P[:, :_N, :_N].copy()
        total[:, DR : DR + 3, DR : DR + 3] += slow_covariances(nav[rows], places_of(value[:, :3])[1])
        self.values[rows] = further_values(self.wanted, value, total, rates, variances)


def rates_at(imu: ImuSamples, t_ns: Int64, par: Any) -> tuple[Float64, Float64]:
    """Return the gyros' rate (m, 3) [rad/s] at times inside the samples, and the variance (m,) of its noise.

    A sample is the mean over its interval: the rate between the middles of two is interpolated.
    """
    step = np.diff(imu.t_ns, prepend=2 * imu.t_ns[0] - imu.t_ns[1])
    twice = 2 * (imu.t_ns - imu.t_ns[0]) - step
    at = 2 * (t_ns - imu.t_ns[0])
    after = np.clip(np.searchsorted(twice, at), 1, len(twice) - 1)
    share = np.clip((at - twice[after - 1]) / (twice[after] - twice[after - 1]), 0.0, 1.0)
    rate = (1.0 - share)[:, None] * imu.w_ib_b[after - 1] + share[:, None] * imu.w_ib_b[after]
    variance = np.zeros(len(t_ns))
    for k, weight in ((after - 1, 1.0 - share), (after, share)):
        variance += weight**2 * float(par.gyro_density) * NS_PER_S / step[k]
        if len(imu.unknown):
            variance += weight * imu.unknown[k, 0] / (2.0 * MOTION_TIME_S)
    return rate, variance


def further_values(
    wanted: PointColumns, value: Float64, P: Float64, w_ib_b: Float64, noise: Float64
) -> Float64:
    """Return the columns that are wanted (m, k).

    Parameters
    ----------
    value : (m, N_NAV) navigation rows, ``NAV_COLUMNS``
    P : (m, 15, 15) covariance of position, velocity, attitude and biases, as in ``filter.state``
    w_ib_b : (m, 3) angular rate, its bias removed [rad/s]
    noise : (m,) variance of its noise, of an axis [rad^2/s^2]
    """
    m = len(value)
    row = _rows_of(value[:, :3], value[:, _ATTITUDE])
    parts: list[Float64] = [row.q_nb] if wanted.quaternion else []
    if wanted.covariance:
        own = np.broadcast_to(np.eye(6, _N), (m, 6, _N))
        turns = np.zeros((m, 3, _N))
        turns[:, :, PSI : PSI + 3], turns[:, :, DR : DR + 3] = row.C_ne, -row.T
        of_position, of_velocity = _level_errors(own, row.C_ne, row.T, value[:, _VELOCITY])
        parts += [_upper(_covariance(of_position, P)), _upper(_covariance(of_velocity, P))]
        parts.append(math.degrees(1.0) ** 2 * _upper(_covariance(turns, P)))
    if wanted.lever_b is not None:
        parts += _of_point(wanted, row, value[:, _VELOCITY], P, w_ib_b, noise)
    return np.concatenate(parts, axis=1)


def places_of(geodetic: Float64) -> tuple[Float64, Float64]:
    """Return positions in ECEF (m, 3) and C_ne (m, 3, 3) of latitude, longitude [deg] and height [m] (m, 3)."""
    return _rows_of(geodetic, np.zeros_like(geodetic))[:2]


def attitudes_of(rpy_deg: Float64) -> Float64:
    """Return C_nb (m, 3, 3) of roll, pitch and yaw (m, 3) [deg]."""
    return _rows_of(np.zeros_like(rpy_deg), rpy_deg).C_nb


def local_levels_of(r_e: Float64) -> tuple[Float64, Float64]:
    """Return latitude, longitude [deg] and height [m] (m, 3) of positions in ECEF (m, 3), and their C_ne (m, 3, 3)."""
    geodetic, C_ne = np.zeros(r_e.shape), np.zeros((len(r_e), 3, 3))
    place_points(r_e, geodetic, C_ne, np.zeros_like(C_ne))
    return geodetic, C_ne


def _rows_of(geodetic: Float64, rpy_deg: Float64) -> _BodyAxes:
    m = len(geodetic)
    row = _BodyAxes(*(np.zeros((m, *shape)) for shape in ((3,), (3, 3), (3, 3), (3, 3), (4,))))
    place_rows(np.ascontiguousarray(geodetic), np.ascontiguousarray(rpy_deg), *row)
    return row


class _BodyAxes(NamedTuple):
    """Where the vehicle is and how it stands, row by row."""

    r_e: Float64  # (m, 3)
    C_ne: Float64  # (m, 3, 3)
    T: Float64  # (m, 3, 3) of ``level_turn``
    C_nb: Float64  # (m, 3, 3)
    q_nb: Float64  # (m, 4)


def _of_point(
    wanted: PointColumns, row: _BodyAxes, v_n: Float64, P: Float64, w_ib_b: Float64, noise: Float64
) -> list[Float64]:
    """Return position, velocity, their sigmas and, where wanted, covariances of the point."""
    l_b, m = np.array(wanted.lever_b), len(v_n)
    C_en = row.C_ne.transpose(0, 2, 1)
    C_eb = C_en @ row.C_nb
    l_e, swung = C_eb @ l_b, _turned(C_eb, np.cross(w_ib_b, l_b))
    v_e = _turned(C_en, v_n) + swung - np.cross(EARTH_RATE_E, l_e)
    geodetic, C_ne, T = np.zeros((m, 3)), np.zeros((m, 3, 3)), np.zeros((m, 3, 3))
    place_points(row.r_e + l_e, geodetic, C_ne, T)
    v_n = _turned(C_ne, v_e)
    J = np.zeros((m, 6, _N))
    J[:, :, : DV + 3] = np.eye(6)
    J[:, :3, PSI : PSI + 3] = -cross_matrix(l_e)
    J[:, 3:, PSI : PSI + 3] = cross_matrix(EARTH_RATE_E) @ cross_matrix(l_e) - cross_matrix(swung)
    J[:, 3:, BG : BG + 3] = C_eb @ cross_matrix(l_b)
    of_position, of_velocity = _level_errors(J, C_ne, T, v_n)
    by_rate = C_ne @ J[:, 3:, BG : BG + 3]
    position, velocity = _covariance(of_position, P), _covariance(of_velocity, P)
    velocity += noise[:, None, None] * (by_rate @ by_rate.transpose(0, 2, 1))
    sd = [np.sqrt(np.maximum(np.diagonal(each, axis1=1, axis2=2), 0.0)) for each in (position, velocity)]
    return [geodetic, v_n, *sd, *([_upper(position), _upper(velocity)] if wanted.covariance else [])]


def _level_errors(J: Float64, C_ne: Float64, T: Float64, v_n: Float64) -> tuple[Float64, Float64]:
    """Return the Jacobians of position and velocity north, east, down by the state's errors, (m, 3, 15) each.

    ``J`` (m, 6, 15) maps them to ECEF.
    """
    return C_ne @ J[:, :3], C_ne @ J[:, 3:] + cross_matrix(v_n) @ T @ J[:, :3]


def _covariance(J: Float64, P: Float64) -> Float64:
    return J @ P @ J.transpose(0, 2, 1)


def _turned(C: Float64, v: Float64) -> Float64:
    """Return vectors (m, 3) turned by matrices (m, 3, 3)."""
    return np.asarray(np.einsum("kij,kj->ki", C, v))


def _upper(C: Float64) -> Float64:
    """Return the six different elements of symmetric matrices (m, 3, 3), row by row (m, 6)."""
    return np.column_stack([C[:, i, j] for i, j in PAIRS])


@kernel
def place_rows(
    geodetic: Float64, rpy_deg: Float64, r_e: Float64, C_ne: Float64, T: Float64, C_nb: Float64, q_nb: Float64
) -> None:
    """Write positions, local levels and attitudes of latitude, longitude [deg], height [m], and angles (m, 3) [deg]."""
    for k in range(geodetic.shape[0]):
        lat, lon, h = math.radians(geodetic[k, 0]), math.radians(geodetic[k, 1]), geodetic[k, 2]
        geodetic_to_ecef(lat, lon, h, r_e[k])
        ecef_to_ned_matrix(lat, lon, C_ne[k])
        level_turn(lat, h, C_ne[k], T[k])
        angles = rpy_deg[k]
        euler_to_matrix(math.radians(angles[0]), math.radians(angles[1]), math.radians(angles[2]), C_nb[k])
        matrix_to_quaternion(C_nb[k], q_nb[k])


@kernel
def place_points(r_e: Float64, geodetic: Float64, C_ne: Float64, T: Float64) -> None:
    """Write latitude, longitude [deg] and height [m] of points ``r_e`` (m, 3), and their local levels."""
    for k in range(r_e.shape[0]):
        lat, lon, h = ecef_to_geodetic(r_e[k])
        ecef_to_ned_matrix(lat, lon, C_ne[k])
        level_turn(lat, h, C_ne[k], T[k])
        geodetic[k, 0], geodetic[k, 1], geodetic[k, 2] = math.degrees(lat), math.degrees(lon), h
