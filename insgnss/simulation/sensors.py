"""Simulated readings of further sensors: the truth along the trajectory, each sensor's errors, and faults on command.

    odometer      x . (C_be v_e + w_eb x l) (1 + scale) + noise
    barometer     h / (1 + scale) + offset, its pressure in the standard atmosphere
    magnetometer  C_bn (H cos D, H sin D, Z) + hard iron + noise
    heading       yaw + offset + noise; attitude, position (at C_eb l) and velocity: truth and noise

Scale, offset, declination and hard iron are drawn once; the barometer's offset drifts as a Gauss-Markov process.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from insgnss.config import simulated_sensors as told
from insgnss.constants import NS_PER_S, WGS84_A_M
from insgnss.geodesy.local_level import geodetic, ned_axes
from insgnss.geodesy.magnetic_dipole import down_sign
from insgnss.simulation.imu import gauss_markov
from insgnss.simulation.trajectory import Trajectory, TrajectoryState
from insgnss.tables import Float64, SensorTable
from insgnss.units import RAD_PER_DEG

_M_PER_HPA: Final = 8.43  # of height in the standard atmosphere at sea level
_USUAL_DOWN_UT: Final = 43.0


class _Errors:
    """The draws of one sensor, all zero without a generator."""

    def __init__(self, config: told.SimulatedSensor, count: int, rng: np.random.Generator | None) -> None:
        self._config, self._count, self._rng = config, count, rng

    def once(self, sigma: float, size: int = 1) -> Float64:
        """Return values that stay, (size,)."""
        return np.zeros(size) if self._rng is None else sigma * self._rng.standard_normal(size)

    def noise(self, sigmas: Sequence[float]) -> Float64:
        """Return noise (n, k), white or as long as the sensor's noise lasts."""
        sigma, time_s = np.asarray(sigmas, np.float64), self._config.noise_time_s
        if self._rng is None:
            return np.zeros((self._count, len(sigma)))
        if time_s == 0.0:
            return np.asarray(sigma * self._rng.standard_normal((self._count, len(sigma))))
        return sigma * self.drift(1.0, time_s)[:, : len(sigma)]

    def drift(self, sigma: float, time_s: float) -> Float64:
        """Return three Gauss-Markov series (n, 3)."""
        if self._rng is None:
            return np.zeros((self._count, 3))
        return gauss_markov(self._count, 1.0 / self._config.rate_hz, sigma, time_s, self._rng)


def draw_sensor(
    config: told.SimulatedSensor,
    trajectory: Trajectory,
    duration_s: float,
    start_ns: int,
    rng: np.random.Generator | None,
    faults: Sequence[told.SensorFault] = (),
) -> SensorTable:
    """Return one realisation of a sensor's log, in the units of ``SensorTable``; without a generator free of errors.

    ``faults`` may be of other sensors, too.
    """
    t_s = np.arange(int(duration_s * config.rate_hz + 1e-9) + 1) / config.rate_hz
    motion = trajectory.motion(t_s)
    values = _TRUTHS[config.kind](config, motion, _Errors(config, len(t_s), rng))
    for fault in (one for one in faults if one.sensor == config.label):
        values = _with_fault(fault, config.kind, t_s, values)
    t_ns = start_ns + np.rint((t_s + config.time_offset_s) * NS_PER_S).astype(np.int64)
    none = 0 if config.kind == "magnetometer" else values.shape[1]
    return SensorTable(config.label, t_ns, values, np.full((len(t_s), none), np.nan))


def _odometer(config: Any, motion: TrajectoryState, errors: _Errors) -> Float64:
    scale = errors.once(config.scale_sigma)
    v_b = np.einsum("nji,nj->ni", motion.C_eb, motion.v_e)
    forward = (v_b + np.cross(motion.w_eb_b, np.array(config.lever_arm_m)))[:, :1]
    return np.asarray((1.0 + scale) * forward + errors.noise([config.noise_mps]))


def _barometer(config: Any, motion: TrajectoryState, errors: _Errors) -> Float64:
    offset, scale = errors.once(config.offset_sigma_m), errors.once(config.scale_sigma)
    height = geodetic(_point(motion, config.lever_arm_m))[:, 2:]
    weather = errors.drift(config.drift_sigma_m, config.drift_time_s)[:, :1]
    weather = weather - weather[0]  # what the day begins with is the offset
    return np.asarray(height / (1.0 + scale) + offset + weather + errors.noise([config.noise_m]))


def _magnetometer(config: Any, motion: TrajectoryState, errors: _Errors) -> Float64:
    D = RAD_PER_DEG * (config.declination_deg + errors.once(config.declination_sigma_deg)[0])
    H = config.horizontal_ut * (1.0 + errors.once(config.horizontal_share)[0])
    lat, lon, _ = geodetic(motion.r_e[:1])[0].tolist()
    down = _USUAL_DOWN_UT * down_sign(lat, lon) if config.down_ut is None else config.down_ut
    field_n = np.array([H * np.cos(D), H * np.sin(D), down])
    field_b = np.einsum("nji,j->ni", _attitudes(motion), field_n)
    iron = errors.once(config.hard_iron_sigma_ut, 3)
    return np.asarray(field_b + iron + errors.noise([config.noise_ut] * 3))


def _heading(config: Any, motion: TrajectoryState, errors: _Errors) -> Float64:
    offset = errors.once(config.offset_sigma_deg)
    yaw = _angles(motion)[:, 2:]
    turned = yaw + RAD_PER_DEG * (offset + errors.noise([config.noise_deg]))
    return np.asarray(np.mod(turned, 2.0 * np.pi))


def _attitude(config: Any, motion: TrajectoryState, errors: _Errors) -> Float64:
    return np.asarray(_angles(motion) + RAD_PER_DEG * errors.noise(config.noise_deg))


def _position(config: Any, motion: TrajectoryState, errors: _Errors) -> Float64:
    r_e = _point(motion, config.lever_arm_m)
    C_ne = ned_axes(geodetic(r_e))
    return geodetic(r_e + np.einsum("nji,nj->ni", C_ne, errors.noise(config.noise_m)))


def _velocity(config: Any, motion: TrajectoryState, errors: _Errors) -> Float64:
    turning_b = np.cross(motion.w_eb_b, np.array(config.lever_arm_m))
    v_e = motion.v_e + np.einsum("nij,nj->ni", motion.C_eb, turning_b)
    v_n = np.einsum("nij,nj->ni", ned_axes(geodetic(motion.r_e)), v_e)
    return np.asarray(v_n + errors.noise(config.noise_mps))


_TRUTHS: Final[dict[str, Callable[[Any, TrajectoryState, _Errors], Float64]]] = {
    "odometer": _odometer,
    "barometer": _barometer,
    "magnetometer": _magnetometer,
    "heading": _heading,
    "attitude": _attitude,
    "position": _position,
    "velocity": _velocity,
}


def _point(motion: TrajectoryState, lever_b: Sequence[float]) -> Float64:
    """Return the way of a point of the body, ECEF (n, 3)."""
    return np.asarray(motion.r_e + motion.C_eb @ np.array(lever_b))


def _attitudes(motion: TrajectoryState) -> Float64:
    """Return C_nb (n, 3, 3)."""
    return np.asarray(ned_axes(geodetic(motion.r_e)) @ motion.C_eb)


def _angles(motion: TrajectoryState) -> Float64:
    """Return roll, pitch, yaw (n, 3) [rad]."""
    return np.asarray(Rotation.from_matrix(_attitudes(motion)).as_euler("ZYX")[:, ::-1])


def _with_fault(fault: told.SensorFault, kind: str, t_s: Float64, values: Float64) -> Float64:
    """Return readings with a fault between its two times."""
    inside = (t_s >= fault.from_s) & (t_s < fault.end_s)
    values = values.copy()
    match fault:
        case told.Slip():
            values[inside] *= 1.0 + fault.share
        case told.Draught():
            values[inside] -= _M_PER_HPA * fault.size_hpa
        case told.MagneticDisturbance():
            values[inside] += fault.field_ut
        case told.FrozenSensor():
            values[inside] = values[max(int(np.argmax(inside)) - 1, 0)]
        case told.SensorSilence():
            values[inside] = np.nan
        case told.SensorStep():
            values[inside] += _step(kind, fault.size, values[inside])
    return values


def _step(kind: str, size: Sequence[float], values: Float64) -> Float64:
    """Return a step in the units of the readings (n, k)."""
    step = np.array(size, np.float64)
    if kind in ("heading", "attitude"):
        return step * RAD_PER_DEG
    if kind == "position":
        n, e, d = step
        lat, lon = n / WGS84_A_M, e / (WGS84_A_M * np.cos(values[:, 0]))
        return np.column_stack([np.full(len(values), lat), lon, np.full(len(values), -d)])
    return step
