"""The error of the IMU's time tags: s seconds to be added to them, a constant of the installation that motion shows.

The state is at the IMU's tag t, so it is the vehicle's at GPS time t + s. An antenna received at t - clock / c is
s + clock / c earlier than the state: its position is r_a - v s, its velocity v_a - a s (``update.prior_rows``). Without
a change of velocity s cannot be separated from a shift of the position along the track; at constant speed not from one
of the lever arm, even in turns. Navigation rows hold the state at GPS time (``output.gps_time``).
Further antennas and sensors on GPS time: ``receiver_time``. Sensors on the IMU's clock have its tags, as have the
vehicle's own constraints and a user's own rows that do not ask for GPS time: their rows do not depend on s.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from insgnss.filter.layout import Layout, StateBlock
from insgnss.filter.state import DR, DV, OFFSETS, Bank, StateRecord, forget_state
from insgnss.filter.states.wanted import StateInputs
from insgnss.geodesy.gravity import normal_gravity_ecef
from insgnss.tables import Float64

IMU_TIME: Final = "imu_time"
_COLUMNS: Final = ("imu_time_offset_s",)
ARRIVAL_SIGMA_S: Final = 0.02  # of tags by a logger that takes the time when a sample arrives
# of a filter that has found the tags to be off
UNKNOWN_IMU_TIME: Final = StateBlock(IMU_TIME, _COLUMNS, "s", 0.1, shown=False)


def imu_time(wanted: StateInputs) -> StateBlock | None:
    """Return the block where the settings doubt the IMU's tags; what has to be added to them, as in the flight file."""
    declared = wanted.config.process.imu_time_sigma_s
    sigma = ARRIVAL_SIGMA_S if declared is None else declared
    return StateBlock(IMU_TIME, _COLUMNS, "s", sigma) if sigma > 0.0 else None


def doubt_imu_time(bank: Bank, layout: Layout) -> None:
    """Let the offset be unknown, and the place with it, as tags that have changed leave them; its value stays."""
    at = layout.at(IMU_TIME)
    forget_state(bank, 0, at, UNKNOWN_IMU_TIME.variance)
    _move_in_time(bank.state[0], bank.P[0], at, 0.0, True)


def to_imu_time(m: StateRecord, P: Float64, layout: Layout, *, with_velocity: bool = True) -> None:
    """Carry a state that was set by a fix from the fix's time to the IMU's, with its covariance.

    Without a velocity in the fix the state has kept its own, which is of the IMU's time already.
    """
    at = layout.at(IMU_TIME)
    if at >= 0:
        _move_in_time(m, P, at, float(m.optional[at - OFFSETS]), with_velocity)


def _move_in_time(m: StateRecord, P: Float64, at: int, s: float, with_velocity: bool) -> None:
    """Move a state by ``s`` of an uncertain time.

    Equation: r <- r + v s, dr <- dr + v ds; v <- v + a s, P_v <- P_v + a a^T sigma_s^2, a = C f + g. A moment's a may
    be a tilt, so its product with ds counts as noise of the velocity and is not correlated with ds.
    """
    gravity = np.zeros(3)
    normal_gravity_ecef(m.r_e, gravity)
    acceleration = m.f_near + gravity
    m.r_e[:] += s * m.v_e
    if with_velocity:
        m.v_e[:] += s * acceleration
        P[DV : DV + 3, DV : DV + 3] += P[at, at] * np.outer(acceleration, acceleration)
    m.v_shown[:] = m.v_corrected[:] = m.v_e
    T = np.eye(len(P))
    T[DR : DR + 3, at] = m.v_e
    P[:] = T @ P @ T.T
