"""The true signals of a receiver that closes its loops through a navigation filter, at the middles of integrations.

The middle of an integration is the instant at which a receiver's observations hold: a discriminator sees the mean of
its offset over the integration. So truth, satellites and clock are given there, T apart.

    sky = orbits_towards(r_e, azimuth_deg, elevation_deg)
    truth = closed_loop_truth(trajectory, sky, 5e-3, first_s=2.0, count=40_000)
    told = told_motion(inertial_truth(trajectory, truth, step_s=5e-3), truth, grade, rng)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.config.flight import ImuGrade
from insgnss.constants import C_MPS, WGS84_GM_M3PS2
from insgnss.errors import ConfigError
from insgnss.geodesy.directions import directions
from insgnss.geodesy.local_level import geodetic, ned_axes
from insgnss.geodesy.rotations import EARTH_RATE_E
from insgnss.gnss.line_of_sight import line_of_sight
from insgnss.kernels.jit import kernel
from insgnss.simulation.imu import accelerometer_model, gyro_model, measure
from insgnss.simulation.trajectory import Trajectory, earth_turn
from insgnss.tables import Float64, Int64
from insgnss.tracking.admissible import require_within

GPS_RADIUS_M: Final = 26_560e3
GLONASS_RADIUS_M: Final = 25_510e3
LONGEST_LATENCY_S: Final = 0.1
_GOLDEN_DEG: Final = 137.50776405  # between the courses of two satellites, so that none is like another
_SAMPLES_BEFORE: Final = 3  # that an inertial system has sent when a receiver begins


@dataclass(frozen=True)
class Orbits:
    """Circular orbits of m satellites, in the inertial axes that are those of ECEF at t = 0."""

    outward: Float64  # (m, 3) unit vectors of the places at t = 0
    ahead: Float64  # (m, 3) unit vectors of the velocities
    radius_m: float

    def states(self, t_s: Float64) -> Float64:
        """Return positions [m] and velocities [m/s], ECEF, at times that broadcast to (n, m), as (n, m, 6)."""
        t = np.broadcast_to(t_s, (len(t_s), len(self.outward)))
        rate = math.sqrt(WGS84_GM_M3PS2 / self.radius_m**3)
        c, s = np.cos(rate * t)[..., None], np.sin(rate * t)[..., None]
        r_i = self.radius_m * (c * self.outward + s * self.ahead)
        v_i = self.radius_m * rate * (c * self.ahead - s * self.outward)
        to_earth = earth_turn(t.ravel()).inv()
        r_e = to_earth.apply(r_i.reshape(-1, 3))
        v_e = to_earth.apply(v_i.reshape(-1, 3)) - np.cross(EARTH_RATE_E, r_e)
        return np.concatenate([r_e, v_e], axis=1).reshape(*t.shape, 6)


def orbits_towards(
    r_e: Float64,
    azimuth_deg: npt.ArrayLike,
    elevation_deg: npt.ArrayLike,
    radius_m: float = GPS_RADIUS_M,
) -> Orbits:
    """Return orbits whose satellites are in given directions at t = 0.

    Equation: |r + d u| = R, d = -r.u + sqrt((r.u)^2 + R^2 - r^2); the courses are 137.5 deg apart

    Parameters
    ----------
    r_e : (3,) of the user [m]
    azimuth_deg, elevation_deg : (m,)

    Raises
    ------
    ConfigError : no satellite, one below the horizon, numbers that are none, or an orbit below the user
    """
    azimuth, elevation = (np.atleast_1d(np.asarray(x, float)) for x in (azimuth_deg, elevation_deg))
    fits = azimuth.shape == elevation.shape and azimuth.ndim == 1 and len(azimuth) > 0
    if not (fits and np.isfinite(azimuth).all() and (elevation > 0.0).all() and (elevation <= 90.0).all()):
        raise ConfigError(
            "azimuths and elevations are not a valid sky",
            key="elevation_deg",
            advice="give an azimuth and an elevation above 0 deg for each satellite",
        )
    r2 = float(r_e @ r_e)
    if not radius_m**2 > r2:
        raise ConfigError(
            f"an orbit of {radius_m:g} m is below the user", key="radius_m", advice="give it in metres"
        )
    u = directions(azimuth, elevation) @ ned_axes(geodetic(r_e[None]))[0]
    along = u @ r_e
    place = r_e + (np.sqrt(along**2 + radius_m**2 - r2) - along)[:, None] * u
    outward = place / radius_m
    east = np.cross([0.0, 0.0, 1.0], outward)
    east /= np.linalg.norm(east, axis=1)[:, None]
    north = np.cross(outward, east)
    course = np.radians(_GOLDEN_DEG * np.arange(len(u)))[:, None]
    return Orbits(outward, np.cos(course) * north + np.sin(course) * east, radius_m)


@dataclass(frozen=True)
class ClosedLoopTruth:
    """Truth at the middles of n integrations, m satellites."""

    step_s: float
    t_s: Float64  # (n,) of the trajectory
    r_e: Float64  # (n, 3)
    v_e: Float64  # (n, 3)
    C_eb: Float64  # (n, 3, 3)
    satellites: Float64  # (n, m, 6) at transmission, as ``line_of_sight`` takes them
    ranges: Float64  # (n, m) without clocks [m]
    rates: Float64  # (n, m) [m/s]

    def directions(self, at: Int64 | slice) -> Float64:
        """Return unit vectors from the user to the satellites at some of the middles, (k, m, 3)."""
        sight = self.satellites[at, :, :3] - self.r_e[at, None]
        return np.asarray(sight / np.linalg.norm(sight, axis=2, keepdims=True))


@kernel
def lines_of_sight(satellites: Float64, r_e: Float64, v_e: Float64, ranges: Float64, rates: Float64) -> None:
    """Write ranges and range rates (n, m) of users (n, 3) to satellites (n, m, 6)."""
    u, g = r_e[0].copy(), r_e[0].copy()
    for k in range(ranges.shape[0]):
        for c in range(ranges.shape[1]):
            ranges[k, c], rates[k, c] = line_of_sight(satellites[k], c, r_e[k], v_e[k], u, g)


def closed_loop_truth(
    trajectory: Trajectory, sky: Orbits, step_s: float, first_s: float, count: int
) -> ClosedLoopTruth:
    """Return truth at ``count`` middles, the first integration beginning at ``first_s`` of the trajectory."""
    t = np.asarray(first_s + step_s * (np.arange(count) + 0.5), np.float64)
    motion = trajectory.motion(t)
    r_e, v_e = np.ascontiguousarray(motion.r_e), np.ascontiguousarray(motion.v_e)
    satellites = np.ascontiguousarray(sky.states(t[:, None] - trajectory.first_s))
    ranges, rates = np.empty(satellites.shape[:2]), np.empty(satellites.shape[:2])
    lines_of_sight(satellites, r_e, v_e, ranges, rates)
    # twice: a satellite moves by 0.3 m while its signal travels the metres that its own way has changed
    for _ in range(2):
        satellites = np.ascontiguousarray(sky.states(t[:, None] - trajectory.first_s - ranges / C_MPS))
        lines_of_sight(satellites, r_e, v_e, ranges, rates)
    return ClosedLoopTruth(step_s, t, r_e, v_e, np.ascontiguousarray(motion.C_eb), satellites, ranges, rates)


@dataclass(frozen=True)
class InertialAiding:
    """An inertial system's aiding of a receiver."""

    rate_b: Float64  # (n, 3) effective rates from each middle before to it [rad/s]
    force_b: Float64  # (n, 3) effective specific forces [m/s^2]
    ahead_b: Float64  # (n, 6) by how much a replica is wrong, led on from the newest sample: place [m], velocity [m/s]


@dataclass(frozen=True)
class InertialTruth:
    """The true increments over the samples of an inertial system: the same in all runs along one trajectory."""

    step_s: float
    first_s: float
    rate_b: Float64  # (k, 3) mean over each sample [rad/s]
    force_b: Float64  # (k, 3) [m/s^2]


def inertial_truth(
    trajectory: Trajectory, truth: ClosedLoopTruth, step_s: float, latency_s: float = 0.0
) -> InertialTruth:
    """Return the means over samples ``step_s`` apart, one of which ends in the middle of the first integration.

    Raises
    ------
    ConfigError : a latency that no receiver stands, or a trajectory that begins too late for it
    """
    require_within(
        0.0, LONGEST_LATENCY_S, "an inertial system is at most a tenth of a second late", latency_s=latency_s
    )
    before = math.ceil((latency_s + truth.step_s) / step_s - 1e-9) + _SAMPLES_BEFORE
    after = math.ceil((truth.t_s[-1] - truth.t_s[0]) / step_s - 1e-9)
    edges = truth.t_s[0] + step_s * np.arange(-before, after + 1)
    if edges[0] < trajectory.first_s or edges[-1] > trajectory.last_s:
        raise ConfigError(
            f"the trajectory covers {trajectory.first_s:g} to {trajectory.last_s:g} s, not {edges[0]:g} to"
            f" {edges[-1]:g} s",
            key="duration_s",
            advice="fly for less time, or lay a longer course",
        )
    increments = trajectory.increments(edges)
    return InertialTruth(step_s, edges[0], increments.mean_rate(), increments.mean_specific_force())


def told_motion(
    true: InertialTruth,
    truth: ClosedLoopTruth,
    grade: ImuGrade,
    rng: np.random.Generator,
    latency_s: float = 0.0,
) -> InertialAiding:
    """Return the aiding of a receiver by sensors of a grade.

    The filter gets every sample. A replica is set when its integration begins, and its middle lies behind the newest
    sample, known ``latency_s`` after its end, which is led on to it:

        S(t) = S_j + s_j (t - t_j),   R(t) = R_j + S_j (t - t_j) + s_j (t - t_j)^2 / 2

    S and R the first and second integral of the samples s in body axes. Neglects: that increments of different
    attitudes are added, of second order in the time that is led on; and that a correction waits for a late sample.
    """
    gyro = measure(true.rate_b, true.step_s, gyro_model(grade), rng, force=true.force_b).value
    force = measure(true.force_b, true.step_s, accelerometer_model(grade), rng).value
    since = truth.t_s - true.first_s
    turned, gained, moved = (_integral(x, true.step_s) for x in (gyro, force, _means(force, true.step_s)))
    inside = np.minimum((since / true.step_s + 1e-6).astype(np.int64), len(gyro) - 1)
    known = ((since - 0.5 * truth.step_s - latency_s) / true.step_s + 1e-6).astype(np.int64)
    S, T = _led_on(gained, force, inside, inside, since, true.step_s), truth.step_s
    angle = _led_on(turned, gyro, inside, inside, since, true.step_s)
    ahead = _led_on(gained, force, known, known - 1, since, true.step_s) - S
    place = _led_twice(moved, gained, force, known, known - 1, since, true.step_s)
    place -= _led_twice(moved, gained, force, inside, inside, since, true.step_s)
    rates = [np.ascontiguousarray(np.diff(x, axis=0, prepend=x[:1]) / T) for x in (angle, S)]
    return InertialAiding(rates[0], rates[1], np.ascontiguousarray(np.hstack([place, ahead])))


def _integral(samples: Float64, step_s: float) -> Float64:
    """Return the sums at the samples' edges, (k + 1, 3)."""
    return np.vstack([np.zeros(3), np.cumsum(samples, axis=0) * step_s])


def _means(samples: Float64, step_s: float) -> Float64:
    """Return the mean over each sample of its sum so far, (k, 3)."""
    sums = _integral(samples, step_s)
    return np.asarray(0.5 * (sums[1:] + sums[:-1]))


def _led_on(
    sums: Float64, samples: Float64, edge: Int64, sample: Int64, t_s: Float64, step_s: float
) -> Float64:
    """Return the sums (n, 3) at times from an edge on, by one sample."""
    return np.asarray(sums[edge] + samples[sample] * (t_s - step_s * edge)[:, None])


def _led_twice(
    twice: Float64,
    sums: Float64,
    samples: Float64,
    edge: Int64,
    sample: Int64,
    t_s: Float64,
    step_s: float,
) -> Float64:
    """Return the second sums (n, 3) at times from an edge on, by one sample."""
    ahead = (t_s - step_s * edge)[:, None]
    return np.asarray(twice[edge] + sums[edge] * ahead + 0.5 * samples[sample] * ahead**2)
