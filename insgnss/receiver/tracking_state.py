"""The states of a satellite's tracking channel as the supervisor sees it, and its memory of each satellite.

The rules that lead from state to state are in ``tracking_rules``. Times are integer nanoseconds, so that sums of them
have no rounding.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.tables import Bool, Float64, Int8, Int64

# Whether the receiver itself sees the signal where it was predicted
NOT_KNOWN: Final = -1
MISSING: Final = 0
PRESENT: Final = 1

# States
ABSENT: Final = 0  # nothing is predicted for the satellite
TRACK: Final = 1
HOLD: Final = 2
CONTROL_DETECTION: Final = 3
RESUME: Final = 4
SEARCH: Final = 5
LOST: Final = 6
TRY: Final = 7  # no state: a control detection or a search, as the prediction is
STATE_NAMES: Final = ("absent", "track", "hold", "control_detection", "resume", "search", "lost")

# Reasons of a transition
NONE: Final = 0
REASON_NAMES: Final = (
    "none",
    "tracked_at_start",
    "hidden_at_start",
    "appeared",
    "prediction_ended",
    "hidden",
    "below_cn0",
    "lost_while_uncertain",
    "signal_lost",
    "visible_again",
    "aperture_exceeded",
    "detected",
    "pulled_in",
    "control_failed",
    "found",
    "search_failed",
    "held_too_long",
    "tried_again",
)
(
    TRACKED_AT_START,
    HIDDEN_AT_START,
    APPEARED,
    PREDICTION_ENDED,
    HIDDEN_BY_ANTENNA,
    BELOW_CN0,
    LOST_WHILE_UNCERTAIN,
    SIGNAL_LOST,
    VISIBLE_AGAIN,
    APERTURE_EXCEEDED,
    DETECTED,
    PULLED_IN,
    CONTROL_FAILED,
    FOUND,
    SEARCH_FAILED,
    HELD_TOO_LONG,
    TRIED_AGAIN,
) = range(1, 18)

NEVER: Final = -(2**63)  # a clock that does not run


class Rules(NamedTuple):
    """The settings as the kernel needs them (``insgnss.config.search.Guards``)."""

    threshold_cn0_dbhz: float
    hysteresis_db: float
    fall_ns: int
    rise_ns: int
    loss_ns: int
    pull_in_ns: int
    retry_ns: int
    max_hold_ns: int
    control_attempts: int
    max_sweeps: int
    half_sweep_ns: int  # what an unsupervised receiver needs on average for a signal that is there


class View(NamedTuple):
    """The inputs on each satellite at each epoch, (n, m)."""

    decision: Int8  # UNDECIDED (no prediction), HIDDEN, VISIBLE, ... of ``insgnss.antenna.visibility``
    cn0_dbhz: Float64
    within_aperture: Bool
    search_ns: Int64  # of one look through the window
    present: Int8  # NOT_KNOWN, MISSING, PRESENT


# What is carried from epoch to epoch for each satellite
MEMORY: Final = np.dtype(
    [
        ("state", np.int8),
        ("below", np.bool_),  # below the threshold: to come back takes the hysteresis more
        ("last_ns", np.int64),  # time of the epoch before
        ("since_ns", np.int64),  # when the state was entered
        ("seen_since_ns", np.int64),  # visible without a break
        ("hidden_since_ns", np.int64),
        ("missing_since_ns", np.int64),  # not seen by the receiver
        ("end_ns", np.int64),  # of the detection or sweep in progress
        ("attempt_ns", np.int64),  # spent in it so far
        ("failures", np.int64),  # of detections, since the satellite was tracked, or of sweeps in this search
        ("unsupervised_ns", np.int64),  # what the unsupervised receiver still needs; 0: it tracks
    ],
    align=True,
)

# Time in integer nanoseconds, for each satellite
SPENT: Final = np.dtype(
    [
        ("hold", np.int64),
        ("control", np.int64),
        ("search", np.int64),
        ("in_vain", np.int64),  # of control and search: what failed, or was broken off
        ("unsupervised", np.int64),  # the receiver without a supervisor, searching
        ("unsupervised_in_vain", np.int64),  # of it: while there was no signal to be found
    ]
)
Records = npt.NDArray[np.void]  # (m,)
Record = Any  # one of them: np.void has no types of its fields


def new_memory(m: int) -> Records:
    """Return the memory of m satellites before the first epoch, of type ``MEMORY``."""
    memory = np.zeros(m, MEMORY)
    for clock in ("last_ns", "since_ns", "seen_since_ns", "hidden_since_ns", "missing_since_ns"):
        memory[clock] = NEVER
    return memory


def new_spent(m: int) -> Records:
    """Return the sums of m satellites before the first epoch, of type ``SPENT``."""
    return np.zeros(m, SPENT)
