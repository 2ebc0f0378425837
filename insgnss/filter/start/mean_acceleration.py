"""The mean acceleration between two fixes, by which a vehicle in motion is levelled.

Levelling takes f = a - g, a from two velocities. With few satellites in a street a velocity may be wrong by 20 m/s, and
the vehicle would be levelled on its back. Two things are known without any satellite:

    - whatever the attitude, f is as long as the accelerometers measure: |a - g| = |f_b|
    - in a level turn |a|^2 = |f_b|^2 - g^2, and a vehicle that changes its speed adds a few m/s^2
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.filter.prediction import ImuSamples
from insgnss.filter.start.fix import Fix
from insgnss.geodesy.gravity import normal_gravity_ecef
from insgnss.inertial.alignment import AlignmentWindow, inertial_window
from insgnss.tables import Float64

_USUAL_MPS2: Final = 2.0  # rms change of a vehicle's speed, all axes together
_MOST_SIGMAS: Final = 3.0  # by which |a - g| may differ from |f_b| ...
_NOT_GNSS_MPS2: Final = 0.7  # ... and by so much more, for the accelerometers' errors and a turn's mean
_UNUSUAL_SIGMAS: Final = 5.0  # of the prior and the velocities: upside down f is as long


class MeanAcceleration(NamedTuple):
    """An acceleration between two fixes."""

    a_e: Float64  # (3,) ECEF [m/s^2]
    sigma: float  # root of the trace of its covariance [m/s^2]
    excess: float  # sigmas by which the velocities contradict |f_b|; 1: they do not


def levelling_motion(
    imu: ImuSamples, fix: Fix, earlier: Fix | None, v_a: Float64, P_v: Float64, window: AlignmentWindow
) -> tuple[AlignmentWindow, MeanAcceleration]:
    """Return the samples to level a moving vehicle by, and its acceleration over them.

    These are the samples since the ``earlier`` fix, where there is one and the log reaches back to it; ``window`` else.
    """
    longer = None if earlier is None else inertial_window(*imu[:3], earlier.t_ns, fix.t_ns)
    if earlier is None or longer is None:
        return window, unknown_acceleration(fix.r_a, window.f_b)
    return longer, mean_acceleration(fix, earlier, v_a, P_v, longer.f_b)


def unknown_acceleration(r_e: Float64, f_b: Float64) -> MeanAcceleration:
    """Return zero, with the sigma of a usual change of motion: for a vehicle without two velocities."""
    return MeanAcceleration(np.zeros(3), math.sqrt(3.0 * _prior_variance(r_e, f_b)), 1.0)


def mean_acceleration(fix: Fix, earlier: Fix, v_a: Float64, P_v: Float64, f_b: Float64) -> MeanAcceleration:
    """Return the mean acceleration from an ``earlier`` fix to ``fix``, or what is known if the velocities are wrong.

    Equation: d = (v - v') / T, S = (P_v + P_v') / T^2; a = K d, K = A (A I + S)^-1, covariance A (I - K), with the
    prior variance A per axis, 3 A = (2 m/s^2)^2 + ||f_b|^2 - g^2|

    Parameters
    ----------
    v_a, P_v : (3,) velocity at ``fix`` [m/s] and its (3, 3) covariance, ECEF
    f_b : (3,) mean specific force between both, in the body axes at the end [m/s^2]
    """
    assert earlier.v_a is not None  # for the type checker: the caller asks for one with a velocity
    interval = (fix.t_ns - earlier.t_ns) / NS_PER_S
    change = (v_a - earlier.v_a) / interval
    S = (P_v + earlier.P_v[:3, :3]) / interval**2
    g_e = np.zeros(3)
    normal_gravity_ecef(fix.r_a, g_e)
    force = change - g_e
    length = float(np.linalg.norm(force))
    sigma = math.sqrt(float(force @ S @ force)) / length
    off = abs(length - float(np.linalg.norm(f_b)))
    A = _prior_variance(fix.r_a, f_b)
    weight = np.linalg.inv(A * np.eye(3) + S)
    unusual = math.sqrt(float(change @ weight @ change))
    if off > _MOST_SIGMAS * sigma + _NOT_GNSS_MPS2 or unusual > _UNUSUAL_SIGMAS:
        sigmas = max(off / sigma, float(np.linalg.norm(change)) / math.sqrt(float(np.trace(S))))
        return unknown_acceleration(fix.r_a, f_b)._replace(excess=max(sigmas, 1.0))
    K = A * weight
    return MeanAcceleration(K @ change, math.sqrt(A * (3.0 - float(np.trace(K)))), 1.0)


def _prior_variance(r_e: Float64, f_b: Float64) -> float:
    g_e = np.zeros(3)
    normal_gravity_ecef(r_e, g_e)
    return (_USUAL_MPS2**2 + abs(float(f_b @ f_b) - float(g_e @ g_e))) / 3.0
