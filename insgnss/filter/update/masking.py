"""Attitude-aware masking inside the filter: hidden satellites are not used; compiled.

A pseudorange of a satellite that the antenna cannot see is a reflection or a false lock. With C_b^n of the state the
line of sight is known in body axes, with the covariance how well; the stage of ``antenna.visibility`` decides.
                                                                                  [Sokolov & Yurchenko 2015, 3]
If the attitude is too uncertain to decide, a row may stay with more noise (``DEWEIGHT``): it is that of a hidden
satellite with the probability p, so its error has the variance R + p b^2, b the rms of a false lock's error.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from insgnss.antenna.installation import Installation, no_antenna
from insgnss.antenna.visibility import (
    DEWEIGHT,
    IS_UNCERTAIN,
    IS_VISIBLE,
    VisibilityLimits,
    attitude_covariance,
    look_at,
    variance_along,
)
from insgnss.config.filter import Visibility
from insgnss.filter.output.writing import MASKING_UNCERTAIN, event_in_words
from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import EpochWorkspace, Line
from insgnss.filter.state import PSI, Bank, StateRecord
from insgnss.gnss.observation_rows import (
    CARRIER,
    N_BANDS,
    N_KINDS,
    N_SATELLITE_SLOTS,
    PSEUDORANGE,
    RANGE_RATE,
    Observations,
)
from insgnss.kernels.jit import kernel
from insgnss.status import USED
from insgnss.tables import Event, Float64, Int8, Int64

# values of ``Parameters.visibility``: no masking; hidden satellites are not used; they are, and the ledger has the gain
OFF, MASK, LOOK = 0, 1, 2


NO_LIMITS: Final = VisibilityLimits(-math.inf, 0.0, 0.0, math.inf)


_BECAME: Final = {
    "keep": "; those in use before stay in use",
    "hide": "; not used",
    "deweight": "; those in use before stay so, with more noise",
}


class MaskingStage(NamedTuple):
    """The antennas and limits of the stage."""

    installation: Installation  # the vehicle's antennas; none: nothing is masked
    limits: VisibilityLimits
    P_b: Float64  # (3, 3) scratch: covariance of the attitude, body axes [rad^2]
    # (N_SATELLITE_SLOTS + 1,) in which pass each satellite was counted last; the last: which it is
    counted: Int64


def new_masking(
    installation: Installation | None = None, limits: VisibilityLimits = NO_LIMITS
) -> MaskingStage:
    """Return the stage for a vehicle's antennas."""
    antennas = no_antenna() if installation is None else installation
    return MaskingStage(antennas, limits, np.zeros((3, 3)), np.zeros(N_SATELLITE_SLOTS + 1, np.int64))


def became_of_uncertain(settings: Visibility) -> str:
    """Return in words the treatment of satellites whose visibility is uncertain."""
    return _BECAME[settings.uncertain]


def still_uncertain(bank: Bank | None, settings: Visibility) -> list[Event]:
    """Return the event of satellites whose visibility was uncertain recently, and is not reported yet."""
    if bank is None or bank.head[0].uncertain == 0:
        return []
    head, words = bank.head[0], became_of_uncertain(settings)
    return [event_in_words(int(head.uncertain_ns), int(MASKING_UNCERTAIN), float(head.uncertain), words)]


@kernel(inline=True)
def is_usable(line: Line) -> bool:
    """Return whether a row has something that nothing has refused yet."""
    for kind in range(N_KINDS):
        if line.status[kind] == USED:
            return True
    return False


@kernel(inline=True)
def deweight(line: Line, doubt: float, interval_s: float, limits: VisibilityLimits) -> None:
    """Add to the variances of a row what it may be off by as that of a hidden satellite.

    Equation: R + p b^2, the variance of an error that is b with the probability p; a carrier difference is off by the
    range rate's error over the epochs' interval.
    """
    line.doubt = doubt
    if line.status[PSEUDORANGE] == USED:
        line.variance[PSEUDORANGE] += doubt * limits.false_range2
    if line.status[RANGE_RATE] == USED:
        line.variance[RANGE_RATE] += doubt * limits.false_rate2
    if line.status[CARRIER] == USED:
        line.variance[CARRIER] += doubt * limits.false_rate2 * interval_s * interval_s


@kernel(apart=True)
def mask_hidden(
    m: StateRecord,
    P: Float64,
    par: Parameters,
    observation: Observations,
    s: EpochWorkspace,
    seen: Int8,
    masking: MaskingStage,
    since_last: float,
) -> None:
    """Look at every satellite of an epoch and refuse all kinds of the hidden ones' rows.

    ``m.mask_uncertain`` becomes the number of satellites in use whose decision was uncertain.

    Parameters
    ----------
    observation : (k,) rows of the epoch
    s : its work space, the lines of sight and the place's C_ne filled
    seen : (slots,) the decision on each satellite so far, carried on
    since_last : time since the epoch before [s]
    """
    P_b, limits, lines, a = masking.P_b, masking.limits, s.lines, s.antenna[0]
    attitude_covariance(P, PSI, m.C_eb, P_b)
    C, C_ne = m.C_eb, a.C_ne
    d0 = C[0, 0] * C_ne[2, 0] + C[1, 0] * C_ne[2, 1] + C[2, 0] * C_ne[2, 2]
    d1 = C[0, 1] * C_ne[2, 0] + C[1, 1] * C_ne[2, 1] + C[2, 1] * C_ne[2, 2]
    d2 = C[0, 2] * C_ne[2, 0] + C[1, 2] * C_ne[2, 1] + C[2, 2] * C_ne[2, 2]
    # down in body axes: along it the attitude's variance is the heading's
    waits = not variance_along(P_b, d0, d1, d2) <= limits.heading_variance
    m.mask_waits = 1 if waits else 0
    m.mask_uncertain = 0
    counted = masking.counted
    counted[N_SATELLITE_SLOTS] += 1
    for j in range(observation.shape[0]):
        row, line = observation[j], lines[j]
        line.doubt = 0.0
        if row.no_satellite != 0:
            continue
        own = row.slot // N_BANDS
        look = look_at(line.u_b, P_b, waits, masking.installation, limits, seen[own])
        seen[own] = look.decision
        line.gain = look.gain_dbic
        if par.visibility != MASK or not is_usable(line):
            continue
        if look.decision & IS_UNCERTAIN and not waits and counted[own] != counted[N_SATELLITE_SLOTS]:
            counted[own] = counted[N_SATELLITE_SLOTS]
            m.mask_uncertain += 1
        if look.decision & IS_VISIBLE and look.doubt > 0.0 and limits.uncertain == DEWEIGHT:
            deweight(line, look.doubt, since_last, limits)
        if look.reason != USED:
            for kind in range(N_KINDS):
                if line.status[kind] == USED:
                    line.status[kind] = look.reason
