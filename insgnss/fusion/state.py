"""The filter's state: its layout, with names for every index, and the arrays that hold it.

A bank holds one filter for each heading that is still possible (one filter when the heading is known): one record and
one covariance per hypothesis. Copying the three arrays of a bank copies the filter.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from insgnss.tables import Float64, Int64

# error state (estimate minus truth), in this order
DR: Final = 0  # position, ECEF [m]
DV: Final = 3  # velocity, ECEF [m/s]
PSI: Final = 6  # attitude, C_eb_hat = (I + [psi x]) C_eb [rad]
BA: Final = 9  # accelerometer bias, body [m/s^2]
BG: Final = 12  # gyro bias, body [rad/s]
CLOCK: Final = 15  # receiver clock bias [m]
DRIFT: Final = 16  # receiver clock drift [m/s]
OFFSETS: Final = 17  # inter-system clock offsets [m], as many as there are further constellations
MAX_OFFSETS: Final = 6

STATE_NAMES: Final = (
    *(f"{name}_{axis}" for name in ("dr_e", "dv_e", "psi_e") for axis in "xyz"),
    *(f"{name}_{axis}" for name in ("b_a", "b_g") for axis in "xyz"),
    "clock_bias",
    "clock_drift",
)

STATE_DTYPE: Final = np.dtype(
    (
        np.record,
        [
            ("q_eb", np.float64, (4,)),  # attitude, body to ECEF
            ("C_eb", np.float64, (3, 3)),  # the same as a matrix
            ("r_e", np.float64, (3,)),  # position of the IMU, ECEF [m]
            ("v_e", np.float64, (3,)),  # [m/s]
            ("b_a", np.float64, (3,)),  # accelerometer bias [m/s^2]
            ("b_g", np.float64, (3,)),  # gyro bias [rad/s]
            ("clock", np.float64, (2,)),  # receiver clock bias [m] and drift [m/s]
            ("offsets", np.float64, (MAX_OFFSETS,)),  # inter-system offsets [m]
            # sums since the covariance was last carried on
            ("sum_dt", np.float64),  # time [s]
            ("sum_dv", np.float64, (3,)),  # velocity increment of the specific force, ECEF [m/s]
            ("sum_C", np.float64, (3, 3)),  # integral of C_eb [s]
            ("sum_gyro_q", np.float64),  # attitude variance to add [rad^2]
            ("sum_accel_q", np.float64),  # velocity variance to add [m^2/s^2]
            # found noise levels: factors on the variances of pseudoranges, range rates, and on the clock's densities
            ("noise_factor", np.float64, (3,)),
            ("adapted_ns", np.int64),  # when they were last moved
            ("adapted_count", np.int64),
            ("log_weight", np.float64),  # natural logarithm of the hypothesis' probability
        ],
    )
)
HEAD_DTYPE: Final = np.dtype(
    (
        np.record,
        [
            ("now_ns", np.int64),  # time of the state
            ("next", np.int64),  # index of the inertial sample whose interval the state stands in
            ("leader", np.int64),  # the hypothesis of the largest weight
            ("epoch_ns", np.int64),  # time of the last epoch; 0 before the first
            ("locked_out", np.int64),  # consecutive epochs with most rows of a kind refused
            ("silent_ns", np.int64),  # time since when no measurement was used; 0 when there are some
            (
                "strained_ns",
                np.int64,
            ),  # time since when the innovations are far too large; 0 when they are not
            ("heading_open", np.int64),  # 1 until the heading has been told to be known
        ],
    )
)

StateRecord: TypeAlias = Any  # one element of STATE_DTYPE
StateArray: TypeAlias = npt.NDArray[Any]
HeadRecord: TypeAlias = Any  # one element of HEAD_DTYPE


class Bank(NamedTuple):
    """All hypotheses: one record and one covariance each, and what they have in common."""

    state: StateArray  # (m,) of STATE_DTYPE
    P: Float64  # (m, n, n) covariance of the error state
    head: StateArray  # (1,) of HEAD_DTYPE


def new_bank(n_hypotheses: int, n_offsets: int) -> Bank:
    """Return an empty bank: zero states, equal weights."""
    n = OFFSETS + n_offsets
    state = np.zeros(n_hypotheses, STATE_DTYPE)
    state["log_weight"] = -np.log(n_hypotheses)
    state["noise_factor"] = 1.0
    return Bank(state, np.zeros((n_hypotheses, n, n)), np.zeros(1, HEAD_DTYPE))


def copy_bank(bank: Bank) -> Bank:
    """Return a copy that shares nothing with ``bank``."""
    return Bank(*(array.copy() for array in bank))


def select_members(bank: Bank, keep: Int64) -> Bank:
    """Return a bank of the hypotheses ``keep`` (indices), weights normalised, the heaviest leading."""
    state = bank.state[keep]
    weight = state["log_weight"]
    top = weight.max()
    state["log_weight"] = weight - top - np.log(np.sum(np.exp(weight - top)))
    head = bank.head.copy()
    head["leader"] = int(np.argmax(weight))
    return Bank(state, np.ascontiguousarray(bank.P[keep]), head)
