"""Attitude-aware masking inside the filter: what the airframe hides is not used, compiled.

A pseudorange of a satellite that the antenna cannot see is a reflection or a false lock. With C_b^n of the state the
line of sight is known in body axes, with the covariance how well; the stage of ``antenna.visibility`` decides.
                                                                                  [Sokolov & Yurchenko 2015, 3]
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from insgnss.antenna.installation import Installation, no_antenna
from insgnss.antenna.visibility import Limits, attitude_covariance, look_at, variance_along
from insgnss.apart import apart
from insgnss.fusion.lines import Antenna, Lines
from insgnss.fusion.parameters import Parameters
from insgnss.fusion.state import PSI, StateRecord
from insgnss.gnss.observation_rows import N_BANDS, N_KINDS, Observations
from insgnss.status import USED
from insgnss.tables import Float64, Int8

OFF: Final = 0  # values of ``Parameters.visibility``: nothing is looked at,
MASK: Final = 1  # what is hidden is not used,
LOOK: Final = 2  # or it is, and the ledger tells its gain


NO_LIMITS: Final = Limits(-math.inf, 0.0, 0.0, math.inf)


class Masking(NamedTuple):
    """What the stage looks with."""

    installation: Installation  # the vehicle's antennas; none: nothing is masked
    limits: Limits
    P_b: Float64  # (3, 3) scratch: covariance of the attitude, body axes [rad^2]


def new_masking(installation: Installation | None = None, limits: Limits = NO_LIMITS) -> Masking:
    """Return the stage for a vehicle's antennas."""
    return Masking(no_antenna() if installation is None else installation, limits, np.zeros((3, 3)))


@apart
def mask_hidden(
    m: StateRecord,
    P: Float64,
    par: Parameters,
    observation: Observations,
    lines: Lines,
    a: Antenna,
    seen: Int8,
    masking: Masking,
) -> None:
    """Look at every satellite of an epoch and refuse all kinds of the hidden ones' rows.

    Parameters
    ----------
    observation, lines : (k,) of the epoch, the lines of sight filled
    a : the place, its C_ne
    seen : (slots,) the decision on each satellite so far, carried on
    """
    P_b, limits = masking.P_b, masking.limits
    attitude_covariance(P, PSI, m.C_eb, P_b)
    C, C_ne = m.C_eb, a.C_ne
    d0 = C[0, 0] * C_ne[2, 0] + C[1, 0] * C_ne[2, 1] + C[2, 0] * C_ne[2, 2]
    d1 = C[0, 1] * C_ne[2, 0] + C[1, 1] * C_ne[2, 1] + C[2, 1] * C_ne[2, 2]
    d2 = C[0, 2] * C_ne[2, 0] + C[1, 2] * C_ne[2, 1] + C[2, 2] * C_ne[2, 2]
    # down in body axes: along it the attitude's variance is the heading's
    waits = not variance_along(P_b, d0, d1, d2) <= limits.heading_variance
    m.mask_waits = 1 if waits else 0
    for j in range(lines.shape[0]):
        row, line = observation[j], lines[j]
        if row.no_satellite != 0:
            continue
        own = row.slot // N_BANDS
        look = look_at(line.u_b, P_b, waits, masking.installation, limits, seen[own])
        seen[own] = look.decision
        line.gain = look.gain_dbic
        if look.reason != USED and par.visibility == MASK:
            for kind in range(N_KINDS):
                if line.status[kind] == USED:
                    line.status[kind] = look.reason
