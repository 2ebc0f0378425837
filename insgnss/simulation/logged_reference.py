"""A trajectory that follows a logged reference: smooth splines through positions and attitudes that carry noise.

Least-squares splines of degree five with knots ``smoothing_s`` apart: what is faster than two knots is left out. Where
the log has no attitude, the nose follows the velocity and the bank is that of a coordinated turn.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import pymap3d
from scipy.interpolate import BSpline, make_lsq_spline
from scipy.spatial.transform import Rotation

from insgnss.constants import NS_PER_S, STANDARD_GRAVITY_MPS2
from insgnss.errors import ConfigError
from insgnss.geodesy.local_level import geodetic, ned_axes
from insgnss.simulation.trajectory import SPLINE_DEGREE, Trajectory
from insgnss.tables import Float64, ReferenceTable

LEAST_SPEED_MPS: Final = 1.0  # below it a velocity says nothing of where the nose points
_KNOTS_PER_SMOOTHING: Final = 4  # of the trajectory's own splines, which pass through the smooth ones


def follow_reference(reference: ReferenceTable, smoothing_s: float, start_ns: int) -> Trajectory:
    """Return the trajectory of a reference, its time counted from ``start_ns``.

    Raises
    ------
    ConfigError : the reference is too short, or has a gap that the spline would have to invent
    """
    t = (reference.t_ns - start_ns) / NS_PER_S
    _check_times(t, smoothing_s)
    x, y, z = pymap3d.geodetic2ecef(reference.lat_deg, reference.lon_deg, reference.h_m)
    r_e = np.column_stack([x, y, z])
    count = int((t[-1] - t[0]) / (smoothing_s / _KNOTS_PER_SMOOTHING))
    knots = np.linspace(t[0], t[-1], count + 1)
    path = _smooth(t, r_e - r_e[0], smoothing_s)
    place = r_e[0] + path(knots)
    C_ne = ned_axes(geodetic(place))
    if np.isfinite(reference.rpy_deg).all():
        attitude = _logged_attitude(reference, t, knots, smoothing_s)
    else:
        attitude = _coordinated_attitude(C_ne, path(knots, 1), path(knots, 2), knots, smoothing_s)
    return Trajectory.from_knots(knots, place, Rotation.from_matrix(C_ne).inv() * attitude)


def _check_times(t: Float64, smoothing_s: float) -> None:
    if len(t) < 2 or t[-1] - t[0] < 6.0 * smoothing_s:
        raise ConfigError(
            "the reference is too short for its smoothing",
            advice="take a longer one, or a smaller smoothing_s",
        )
    gap = float(np.max(np.diff(t)))
    if gap > smoothing_s:
        at = t[int(np.argmax(np.diff(t)))]
        raise ConfigError(
            f"the reference has a gap of {gap:.3g} s at {at:.1f} s of the scenario",
            advice=f"give smoothing_s of at least {gap:.3g}, or a span without it (from_s, to_s)",
        )


def _smooth(t: Float64, values: Float64, smoothing_s: float) -> BSpline:
    """Return the least-squares spline through ``values`` (n, k) with even knots."""
    inner = np.linspace(t[0], t[-1], max(int((t[-1] - t[0]) / smoothing_s), 1) + 1)[1:-1]
    ends = np.repeat([t[0], t[-1]], SPLINE_DEGREE + 1)
    knots = np.concatenate([ends[: SPLINE_DEGREE + 1], inner, ends[SPLINE_DEGREE + 1 :]])
    return make_lsq_spline(t, values, knots, SPLINE_DEGREE)


def _logged_attitude(reference: ReferenceTable, t: Float64, knots: Float64, smoothing_s: float) -> Rotation:
    """Return smooth C_nb at the knots: quaternions of one sign, smoothed by component and normalised again."""
    q = Rotation.from_euler("ZYX", reference.rpy_deg[:, ::-1], degrees=True).as_quat()
    turned_over = np.concatenate([[1.0], np.cumprod(np.sign(np.sum(q[1:] * q[:-1], axis=1)))])
    return Rotation.from_quat(_smooth(t, q * turned_over[:, None], smoothing_s)(knots))


def _coordinated_attitude(
    C_ne: Float64, v_e: Float64, a_e: Float64, t: Float64, smoothing_s: float
) -> Rotation:
    """Return C_nb with the nose along the velocity and the specific force in the plane of nose and down.

    Equation: ``tan(roll) = a_right / g``; at rest the last heading stays.
    """
    v_n, a_n = (np.einsum("nij,nj->ni", C_ne, vector) for vector in (v_e, a_e))
    speed = np.hypot(v_n[:, 0], v_n[:, 1])
    moving = speed > LEAST_SPEED_MPS
    if not moving.any():
        raise ConfigError("the reference never moves and has no attitude", advice="give it an attitude")
    yaw = np.interp(t, t[moving], np.unwrap(np.arctan2(v_n[moving, 1], v_n[moving, 0])))
    right = np.column_stack([-np.sin(yaw), np.cos(yaw)])
    level = np.where(moving, np.sum(right * a_n[:, :2], axis=1), 0.0)
    pitch = np.where(moving, np.arctan2(-v_n[:, 2], np.maximum(speed, LEAST_SPEED_MPS)), 0.0)
    angles = np.column_stack([yaw, pitch, np.arctan2(level, STANDARD_GRAVITY_MPS2)])
    return Rotation.from_euler("ZYX", _smooth(t, angles, smoothing_s)(t))
