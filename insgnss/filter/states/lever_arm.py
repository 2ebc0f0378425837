"""The error of the antenna's lever arm: a constant of the installation, observable when the vehicle turns.

The antenna is at r_e + C_eb (l + dl), l of the flight file and dl the state; it moves with C_eb (w x (l + dl)). A flat
turn shows the horizontal part of dl, its vertical part takes roll or pitch. At constant attitude dl is one with the
position and nothing shows it: its sigma then stays and adds to the IMU's position, not to the antenna's.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from insgnss.filter.layout import Layout, StateBlock
from insgnss.filter.state import DR, DV, OFFSETS, StateRecord
from insgnss.filter.states.wanted import StateInputs
from insgnss.geodesy.rotations import cross_matrix
from insgnss.tables import Float64

LEVER_ARM: Final = "lever_arm"
_COLUMNS: Final = ("lever_arm_x_m", "lever_arm_y_m", "lever_arm_z_m")
# of a filter that has found the lever arm of the flight file to be wrong
UNKNOWN_LEVER_ARM: Final = StateBlock(LEVER_ARM, _COLUMNS, "m", 3.0, shown=False)


def lever_arm(wanted: StateInputs) -> StateBlock | None:
    """Return the block where the settings doubt the lever arm; body axes forward, right, down."""
    sigma = wanted.config.process.lever_arm_sigma_m
    if sigma <= 0.0:
        return None
    return StateBlock(LEVER_ARM, _COLUMNS, "m", sigma)


def lever_of(m: StateRecord, lever_b: Float64, layout: Layout) -> Float64:
    """Return the lever arm of a hypothesis (3,) [m]: ``lever_b`` of the flight file, and its error as it was found."""
    at = layout.at(LEVER_ARM)
    return lever_b if at < 0 else lever_b + m.optional[at - OFFSETS : at - OFFSETS + 3]


def hang_from_antenna(m: StateRecord, P: Float64, w_b: Float64 | None, layout: Layout) -> None:
    """Let position and velocity share the lever arm's error, where it is a state: the antenna's are what was measured.

    Equation: P <- T P T^T with dr = dr_a - C dl, dv = dv_a - C (w x dl), w the body's rate ``w_b`` [rad/s]; without it
    the velocity is not the antenna's
    """
    J = lever_rows(layout, len(P))
    hangs = np.eye(len(P))
    hangs[DR : DR + 3] -= m.C_eb @ J
    if w_b is not None:
        hangs[DV : DV + 3] -= m.C_eb @ cross_matrix(w_b) @ J
    P[:] = hangs @ P @ hangs.T


def lever_rows(layout: Layout, n: int) -> Float64:
    """Return the rows (3, n) that take the lever arm's error out of the error state; zero where it is not estimated."""
    rows, at = np.zeros((3, n)), layout.at(LEVER_ARM)
    if at >= 0:
        rows[:, at : at + 3] = np.eye(3)
    return rows
