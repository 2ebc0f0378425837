"""A true motion: splines of position and attitude, and what a perfect inertial sensor moving along feels.

The position is ``r_i(t) = R(omega t) (origin_e + d_e(t))`` with ``d_e`` a quintic spline (continuous to the fourth
derivative) and the attitude ``C_ib(t) = R(omega t) C_eb(t)`` with ``C_eb`` a rotation spline (continuous angular
acceleration). The rigid turn ``R(omega t)`` into the inertial frame is differentiated in closed form: a spline of
``r_i`` itself would differentiate the rounding of 6.4e6 m twice (4e-7 m/s^2 for knots 0.1 s apart).
No latitude or longitude enters: poles, orbits and any attitude are as good as any other place.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline
from scipy.spatial.transform import Rotation, RotationSpline

from insgnss.constants import NS_PER_S
from insgnss.errors import ConfigError
from insgnss.geodesy.gravity import normal_gravity_ecef
from insgnss.geodesy.local_level import geodetic, ned_axes
from insgnss.geodesy.rotations import EARTH_RATE_E
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64, ReferenceTable

SPLINE_DEGREE = 5
GAUSS_NODES = 5  # exact for polynomials of degree 9 inside one sampling interval
INTERVALS_AT_ONCE = 20_000  # bounds the memory of the quadrature to about 50 MB


@kernel
def gravity_along(r_e: Float64, g_e: Float64) -> None:
    """Write normal gravity [m/s^2] at each of the ECEF positions ``r_e`` (n, 3) [m] into ``g_e`` (n, 3)."""
    for k in range(len(r_e)):
        normal_gravity_ecef(r_e[k], g_e[k])


def earth_turn(t_s: Float64) -> Rotation:
    """Return R(omega t), from ECEF to the inertial frame that coincides with it at t = 0."""
    return Rotation.from_rotvec(np.multiply.outer(np.asarray(t_s, dtype=np.float64), EARTH_RATE_E))


@dataclass(frozen=True)
class TrajectoryState:
    """The state of a trajectory at given times; velocity is relative to the Earth."""

    t_s: Float64  # (n,)
    r_e: Float64  # (n, 3) [m]
    v_e: Float64  # (n, 3) [m/s]
    C_eb: Float64  # (n, 3, 3)
    w_eb_b: Float64  # (n, 3) angular rate relative to the Earth [rad/s]


@dataclass(frozen=True)
class InertialIncrements:
    """Exact integrals over sampling intervals, in body axes: what ideal integrating sensors would report."""

    edges_s: Float64  # (n + 1,) ends of the intervals
    angle: Float64  # (n, 3) integral of w_ib_b [rad]
    velocity: Float64  # (n, 3) integral of f_b [m/s]

    def mean_rate(self) -> Float64:
        """Return the mean angular rate over each interval, (n, 3) [rad/s]."""
        return self.angle / np.diff(self.edges_s)[:, None]

    def mean_specific_force(self) -> Float64:
        """Return the mean specific force over each interval, (n, 3) [m/s^2]."""
        return self.velocity / np.diff(self.edges_s)[:, None]


@dataclass(frozen=True)
class Trajectory:
    """Smooth position and attitude of a vehicle from ``first_s`` to ``last_s``, seconds from an epoch of its own."""

    first_s: float
    last_s: float
    origin_e: Float64
    offset_e: BSpline
    attitude: RotationSpline

    @classmethod
    def from_knots(cls, t_s: Float64, r_e: Float64, C_eb: Rotation) -> Trajectory:
        """Return the motion that passes through ECEF positions ``r_e`` (n, 3) [m] and attitudes ``C_eb`` (n rotations).

        Knots should be 0.02 to 0.2 s apart, well below the fastest change of motion; successive attitudes must differ
        by less than 180 deg.
        """
        origin = np.array(r_e[0], dtype=np.float64)
        offset = make_interp_spline(t_s, r_e - origin, k=SPLINE_DEGREE)
        return cls(float(t_s[0]), float(t_s[-1]), origin, offset, RotationSpline(t_s, C_eb))

    def position_e(self, t_s: Float64) -> Float64:
        """Return ECEF positions (n, 3) [m]."""
        return np.asarray(self.origin_e + self.offset_e(t_s))

    def velocity_e(self, t_s: Float64) -> Float64:
        """Return velocities relative to the Earth in ECEF axes (n, 3) [m/s]."""
        return np.asarray(self.offset_e(t_s, 1))

    def rotation_eb(self, t_s: Float64) -> Rotation:
        """Return the attitudes C_eb (n rotations)."""
        return self.attitude(t_s)

    def rate_eb_b(self, t_s: Float64) -> Float64:
        """Return angular rates relative to the Earth in body axes (n, 3) [rad/s]."""
        return np.asarray(self.attitude(t_s, 1))

    def motion(self, t_s: Float64) -> TrajectoryState:
        """Return position, velocity, attitude and angular rate relative to the Earth at the times ``t_s`` (n,)."""
        t = self._covered(t_s)
        C_eb = np.asarray(self.rotation_eb(t).as_matrix())
        return TrajectoryState(t, self.position_e(t), self.velocity_e(t), C_eb, self.rate_eb_b(t))

    def inertial_acceleration_e(self, t_s: Float64) -> Float64:
        """Return the second derivative of r_i, expressed in ECEF axes (n, 3) [m/s^2].

        Equation: ``R^T r_i'' = d'' + 2 w x d' + w x (w x r_e)``, w the Earth's rate: the derivatives of R(w t) r_e.
        """
        w, v = EARTH_RATE_E, self.velocity_e(t_s)
        centripetal = np.cross(w, np.cross(w, self.position_e(t_s)))
        return np.asarray(self.offset_e(t_s, 2)) + 2.0 * np.cross(w, v) + centripetal

    def gravitation_e(self, t_s: Float64) -> Float64:
        """Return gravitation, normal gravity less the centrifugal acceleration, in ECEF axes (n, 3) [m/s^2]."""
        r = np.ascontiguousarray(self.position_e(t_s))
        gravity = np.empty_like(r)
        gravity_along(r, gravity)
        return gravity + np.cross(EARTH_RATE_E, np.cross(EARTH_RATE_E, r))

    def specific_force_b(self, t_s: Float64, C_eb: Rotation | None = None) -> Float64:
        """Return what accelerometers feel, ``f_b = C_bi (r_i'' - gravitation)`` (n, 3) [m/s^2].

        ``C_eb``: the attitudes at these times, where they are known already.
        """
        f_e = self.inertial_acceleration_e(t_s) - self.gravitation_e(t_s)
        return np.asarray((self.rotation_eb(t_s) if C_eb is None else C_eb).apply(f_e, inverse=True))

    def angular_rate_b(self, t_s: Float64, C_eb: Rotation | None = None) -> Float64:
        """Return what gyros feel, ``w_ib_b = w_eb_b + C_be w_ie`` (n, 3) [rad/s]; ``C_eb`` as above."""
        earth = (self.rotation_eb(t_s) if C_eb is None else C_eb).apply(EARTH_RATE_E, inverse=True)
        return np.asarray(self.rate_eb_b(t_s) + earth)

    def increments(self, edges_s: Float64) -> InertialIncrements:
        """Return the exact integrals of angular rate and specific force between successive ``edges_s`` (n + 1,).

        Five-point Gauss-Legendre quadrature on each interval. Neglects: the tenth derivative inside an interval; below
        rounding for intervals up to 20 ms of any vehicle's motion.
        """
        edges = self._covered(edges_s)
        parts = [self._integrals(edges[block]) for block in _blocks(len(edges) - 1)]
        angle = np.concatenate([part[0] for part in parts])
        velocity = np.concatenate([part[1] for part in parts])
        return InertialIncrements(edges, angle, velocity)

    def _covered(self, t_s: Float64) -> Float64:
        t = np.asarray(t_s, dtype=np.float64)
        if len(t) and (t.min() < self.first_s or t.max() > self.last_s):
            raise ConfigError(
                f"the trajectory covers {self.first_s:.3f} to {self.last_s:.3f} s, not {t.min():.3f} to {t.max():.3f} s"
            )
        return t

    def _integrals(self, edges: Float64) -> tuple[Float64, Float64]:
        nodes, weights = np.polynomial.legendre.leggauss(GAUSS_NODES)
        half = 0.5 * np.diff(edges)
        t = ((edges[:-1] + half)[:, None] + half[:, None] * nodes).ravel()
        shape, C_eb = (len(half), GAUSS_NODES, 3), self.rotation_eb(t)
        w, f = self.angular_rate_b(t, C_eb).reshape(shape), self.specific_force_b(t, C_eb).reshape(shape)
        angle = half[:, None] * np.einsum("j,kjc->kc", weights, w)
        velocity = half[:, None] * np.einsum("j,kjc->kc", weights, f)
        return angle, velocity


def _blocks(count: int) -> Iterator[slice]:
    """Yield slices of edges that cover ``count`` intervals, neighbours sharing one edge."""
    for first in range(0, count, INTERVALS_AT_ONCE):
        yield slice(first, min(first + INTERVALS_AT_ONCE, count) + 1)


def reference_table(motion: TrajectoryState, start_ns: int) -> ReferenceTable:
    """Return the motion of the IMU as a reference of the best quality; ``start_ns`` is the GPS time of its t = 0."""
    place = geodetic(motion.r_e)
    C_ne = ned_axes(place)
    yaw_pitch_roll = Rotation.from_matrix(C_ne @ motion.C_eb).as_euler("ZYX", degrees=True)
    return ReferenceTable(
        t_ns=start_ns + np.rint(motion.t_s * NS_PER_S).astype(np.int64),
        lat_deg=np.rad2deg(place[:, 0]),
        lon_deg=np.rad2deg(place[:, 1]),
        h_m=place[:, 2],
        v_n=np.einsum("nij,nj->ni", C_ne, motion.v_e),
        rpy_deg=yaw_pitch_roll[:, ::-1],
        quality=np.ones(len(place)),
    )
