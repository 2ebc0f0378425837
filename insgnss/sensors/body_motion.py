"""How the body turns and how its points move against the Earth, from one estimate of the filter."""

from __future__ import annotations

import numpy as np

from insgnss.filter.own_rows.state_estimate import InertialWindow, StateEstimate
from insgnss.geodesy.rotations import EARTH_RATE_E
from insgnss.geodesy.vectors import cross_product
from insgnss.tables import Float64


def rate_eb_b(state: StateEstimate) -> Float64:
    """Return the rate of the body against the Earth, body axes [rad/s]."""
    return np.asarray(state.w_ib_b - state.C_eb.T @ EARTH_RATE_E)


def mean_rate(state: StateEstimate, window: InertialWindow) -> tuple[Float64, dict[str, Float64]]:
    """Return the mean rate w_ib_b of a window (3,) [rad/s], the gyros' error removed, and how that error grows.

    The error is that of the mean rate under the mean force: it is linear in both.
    """
    w, f = window.w_ib_b.mean(axis=0), window.f_b.mean(axis=0)
    error, grows = state.gyro_error(w, f)
    return w - error, grows


def velocity_of(state: StateEstimate, lever_b: Float64) -> tuple[Float64, Float64]:
    """Return the velocity of a point of the body against the Earth, and the part by which the IMU's differs, ECEF."""
    turning = state.C_eb @ cross_product(rate_eb_b(state), lever_b)
    return state.v_e + turning, turning
