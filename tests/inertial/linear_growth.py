"""Errors carried by the linear model along a flight, beside the flight itself."""

from __future__ import annotations

import numpy as np

from insgnss.geodesy.rotations import matrix_to_quaternion, quaternion_to_matrix
from insgnss.inertial.error_dynamics import COUPLING_DTYPE, apply_transition, transition_step
from insgnss.inertial.mechanization import mechanize
from insgnss.kernels.jit import kernel

ERRORS = 17
NO_COUPLINGS = np.zeros(0, COUPLING_DTYPE)


@kernel
def _carry_errors(
    dt: float,
    per_step: int,
    w: np.ndarray,
    f: np.ndarray,
    q: np.ndarray,
    C: np.ndarray,
    r: np.ndarray,
    v: np.ndarray,
    time_s: float,
    errors: np.ndarray,
    couplings: np.ndarray,
) -> None:
    g = np.zeros(3)
    sum_dv, sum_C, carried = np.zeros(3), np.zeros((3, 3)), np.zeros_like(errors)
    keep = np.ones(len(errors))
    for k in range(len(w)):
        sum_C += 0.5 * dt * C
        dv_x, dv_y, dv_z = mechanize(q, C, r, v, w[k], f[k], dt, g)
        sum_C += 0.5 * dt * C
        sum_dv[0] += dv_x
        sum_dv[1] += dv_y
        sum_dv[2] += dv_z
        if (k + 1) % per_step == 0:
            step = transition_step(per_step * dt, sum_dv[0], sum_dv[1], sum_dv[2], r)
            keep[9:15] = np.exp(-per_step * dt / time_s)
            apply_transition(step, sum_C, couplings, keep, errors, carried)
            errors[:] = carried
            sum_dv[:] = 0.0
            sum_C[:] = 0.0


def linear_growth(
    dt: float,
    per_step: int,
    w: np.ndarray,
    f: np.ndarray,
    C_eb: np.ndarray,
    r_e: np.ndarray,
    v_e: np.ndarray,
    errors: np.ndarray,
    time_s: float = np.inf,
) -> np.ndarray:
    """Return what the linear model makes of ``errors`` (17, 17), one error state per column, along a flight.

    ``per_step`` samples of ``dt`` [s] go into one step of the transition; ``time_s`` is the biases' correlation time.
    """
    C, q, carried = C_eb.copy(), np.zeros(4), errors.copy()
    matrix_to_quaternion(C, q)
    quaternion_to_matrix(q, C)
    _carry_errors(dt, per_step, w, f, q, C, r_e.copy(), v_e.copy(), time_s, carried, NO_COUPLINGS)
    return carried
