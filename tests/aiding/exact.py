"""Exact states along a simulated motion, as the aiding reads them, and the true range by an independent computation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from insgnss.aiding.satellite_arcs import SatelliteArcs, broadcast_arcs
from insgnss.aiding.table import AidingSetup
from insgnss.aiding.trace import Covariances, Trace, TraceSamples
from insgnss.config.aiding import AidingConfig
from insgnss.constants import C_MPS, NS_PER_S, WGS84_OMEGA_RADPS
from insgnss.filter.state import BA, BG, CLOCK, DR, DRIFT, DV, OFFSETS, PSI
from insgnss.gnss.orbits.ephemeris_choice import broadcast_messages
from insgnss.inertial.clock_model import clock_model
from insgnss.inertial.sensor_model import sensor_model
from insgnss.simulation.constellation import satellite_states
from insgnss.simulation.sample_trajectories import airborne_turns
from insgnss.simulation.trajectory import EARTH_RATE_E, Trajectory
from insgnss.tables import Float64
from tests.runs.scenes import START_NS, TACTICAL, TCXO, paper_sky

SIGNALS = {"G": "C1C"}
LEVER_B = (0.8, 0.4, -1.1)
SPIN_DEGPS = 1000.0


@cache
def turning() -> Trajectory:
    """Return an aircraft in turns of 35 deg of bank."""
    return airborne_turns(60.0)


@cache
def spinning() -> Trajectory:
    """Return a body that flies straight at 100 m/s and rolls at 1000 deg/s."""
    flight = airborne_turns(20.0)
    t = np.arange(0.0, 8.0, 0.01)
    roll = Rotation.from_rotvec(np.outer(np.radians(SPIN_DEGPS) * t, [1.0, 0.0, 0.0]))
    return Trajectory.from_knots(t, flight.position_e(t), flight.rotation_eb(t) * roll)


@cache
def sky_arcs() -> SatelliteArcs:
    """Return the 11 satellites over the airfield."""
    return broadcast_arcs(broadcast_messages(paper_sky()), SIGNALS, START_NS, START_NS + 120 * NS_PER_S)


def setup(lever_b: tuple[float, float, float] = LEVER_B, **changes: Any) -> AidingSetup:
    """Return a setup without air; ``changes`` are keys of the settings."""
    config = AidingConfig(**{"signals": SIGNALS, "horizon_deg": -90.0, "slope_samples": 1} | changes)
    return AidingSetup(config, sensor_model(TACTICAL), clock_model(TCXO), lever_b, troposphere=False)


@dataclass(frozen=True)
class ExactRun:
    """A trace of exact states, and samples whose slopes are exact too."""

    trace: Trace
    imu: TraceSamples


def exact_run(motion: Trajectory, t_s: Float64, step_s: float = 0.005) -> ExactRun:
    """Return the states at ``t_s`` (whole nanoseconds), three samples of its own for each time.

    A sample is a mean over its interval, so the two before the time t are x - x' dt/2 and x - 3 x' dt/2.
    """
    n = len(t_s)
    state = motion.motion(t_s)
    w, w1 = motion.angular_rate_b(t_s), angular_acceleration(motion, t_s)
    f, f1 = motion.specific_force_b(t_s), derivative(motion.specific_force_b, t_s, 2e-3)
    t_ns = START_NS + np.rint(t_s * NS_PER_S).astype(np.int64)
    back_ns = np.array([2, 1, 0]) * round(step_s * NS_PER_S)
    back_s = np.array([2.5, 1.5, 0.5])[None, :, None] * step_s
    imu = TraceSamples(
        (t_ns[:, None] - back_ns).ravel(),
        np.ascontiguousarray((w[:, None] - back_s * w1[:, None]).reshape(-1, 3)),
        np.ascontiguousarray((f[:, None] - back_s * f1[:, None]).reshape(-1, 3)),
    )
    zero = np.zeros((n, 3))
    trace = Trace(
        t_ns, 3 * np.arange(n) + 2, state.r_e, state.v_e, state.C_eb, zero, zero, np.zeros((n, 2)), np.zeros((n, 0))
    )  # fmt: skip
    return ExactRun(trace, imu)


def with_clock(run: ExactRun, bias_m: float, drift_mps: float) -> ExactRun:
    """Return the run with a receiver clock."""
    clock = np.tile([bias_m, drift_mps], (len(run.trace.t_ns), 1))
    return replace(run, trace=run.trace._replace(clock=clock))


def angular_acceleration(motion: Trajectory, t_s: Float64) -> Float64:
    """Return d w_ib_b / dt (n, 3): of the rotation spline, and of the Earth's rate seen from the turning body."""
    earth_b = motion.rotation_eb(t_s).apply(EARTH_RATE_E, inverse=True)
    return np.asarray(motion.attitude(t_s, 2)) - np.cross(motion.rate_eb_b(t_s), earth_b)


def derivative(function: Any, t_s: Float64, h: float) -> Float64:
    """Return the first derivative by five points."""
    f = [function(t_s + k * h) for k in (-2, -1, 1, 2)]
    return np.asarray((f[0] - 8.0 * f[1] + 8.0 * f[2] - f[3]) / (12.0 * h))


def grid(t_s: Float64) -> Float64:
    """Return the nearest multiples of 2^-9 s: whole nanoseconds, and exact in binary."""
    return np.rint(t_s * 2.0**9) / 2.0**9


def true_range(motion: Trajectory, t_s: Float64, lever_b: tuple[float, float, float]) -> Float64:
    """Return |S(t - rho / c) - R(t)| (n, s) [m] in the inertial frame of t = 0, in extended precision.

    Differences of it over milliseconds are wanted: 64 bits would leave 4e-9 m of rounding, 4e-6 m/s over 1 ms.
    """
    eph = paper_sky().ephemerides
    t = np.asarray(t_s, np.longdouble)
    r_e = motion.origin_e.astype(np.longdouble) + motion.offset_e(t_s)
    r_e = r_e + motion.rotation_eb(t_s).apply(lever_b)
    r_i = _turned(r_e, t)[:, None]
    rho = np.full((len(t), len(eph.sv_names)), 2.2e7, np.longdouble)
    for _ in range(6):
        sent = t[:, None] - rho / C_MPS
        sat = satellite_states(eph, START_NS, sent).r_e
        rho = np.sqrt(np.sum((_turned(sat, sent) - r_i) ** 2, axis=-1))
    return rho


def _turned(r_e: Any, t: Any) -> Any:
    """Return vectors (..., 3) turned about z by omega t."""
    angle = np.longdouble(WGS84_OMEGA_RADPS) * t
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = r_e[..., 0], r_e[..., 1], r_e[..., 2]
    return np.stack([c * x - s * y, s * x + c * y, z], axis=-1)


def true_derivatives(
    motion: Trajectory, t_s: Float64, lever_b: tuple[float, float, float]
) -> tuple[Float64, Float64, Float64]:
    """Return range rate, acceleration and jerk (n, s) by central differences of the true range, at times of ``grid``.

    The steps are powers of two, so that t + h is exact: 4e-15 s of rounding would be 2e-5 m/s^2.
    """
    h = 2.0**-10
    rho = {k: true_range(motion, t_s + k * h, lever_b) for k in range(-4, 5)}
    rate = (rho[-2] - 8 * rho[-1] + 8 * rho[1] - rho[2]) / (12 * h)
    acceleration = (-rho[-2] + 16 * rho[-1] - 30 * rho[0] + 16 * rho[1] - rho[2]) / (12 * h**2)
    jerk = (rho[4] - 2 * rho[2] + 2 * rho[-2] - rho[-4]) / (2 * (2 * h) ** 3)
    return rate.astype(np.float64), acceleration.astype(np.float64), jerk.astype(np.float64)


def correlated_covariance(n: int = OFFSETS, seed: int = 4) -> Float64:
    """Return a covariance with strong correlations and sigma of the usual size of each state."""
    rng = np.random.default_rng(seed)
    sigma = np.zeros(n)
    for first, size in ((DR, 2.0), (DV, 0.02), (PSI, 2e-3), (BA, 5e-3), (BG, 2e-5)):
        sigma[first : first + 3] = size
    sigma[CLOCK], sigma[DRIFT], sigma[OFFSETS:] = 3.0, 0.03, 5.0
    half = np.eye(n) + 0.5 * rng.standard_normal((n, n))
    P = half @ half.T
    scale = sigma / np.sqrt(np.diag(P))
    return np.asarray(P * np.outer(scale, scale))


def one_covariance(run: ExactRun, P: Float64, age_s: float = 0.0) -> Covariances:
    """Return one covariance, ``age_s`` before the first time."""
    return Covariances(run.trace.t_ns[:1] - round(age_s * NS_PER_S), P[None])
