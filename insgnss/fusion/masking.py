"""Attitude-aware masking inside the filter: what the airframe hides is not used, compiled.

A pseudorange of a satellite that the antenna cannot see is a reflection or a false lock. With C_b^n of the state the
line of sight is known in body axes, with the covariance how well; the stage of ``antenna.visibility`` decides.
                                                                                  [Sokolov & Yurchenko 2015, 3]
"""

from __future__ import annotations

from typing import Final

from insgnss.antenna.visibility import attitude_covariance, look_at, variance_along
from insgnss.fusion.lines import Epoch
from insgnss.fusion.parameters import Parameters
from insgnss.fusion.state import PSI, StateRecord
from insgnss.gnss.observation_rows import N_KINDS, Rows
from insgnss.jit import inlined
from insgnss.status import USED
from insgnss.tables import Float64, Int8

OFF: Final = 0  # values of ``Parameters.visibility``: nothing is looked at,
MASK: Final = 1  # what is hidden is not used,
LOOK: Final = 2  # or it is, and the ledger tells its gain


@inlined
def mask_hidden(
    m: StateRecord, P: Float64, par: Parameters, rows: Rows, epoch: int, n_rows: int, seen: Int8, s: Epoch
) -> None:
    """Look at every satellite of an epoch and refuse all kinds of the hidden ones' rows.

    Parameters
    ----------
    seen : (slots,) the decision on each satellite so far, carried on
    s : the work space, its lines of sight filled
    """
    if par.visibility == OFF:
        return
    attitude_covariance(P, PSI, m.C_eb, s.P_b)
    C, C_ne = m.C_eb, s.antenna[0].C_ne
    d0 = C[0, 0] * C_ne[2, 0] + C[1, 0] * C_ne[2, 1] + C[2, 0] * C_ne[2, 2]
    d1 = C[0, 1] * C_ne[2, 0] + C[1, 1] * C_ne[2, 1] + C[2, 1] * C_ne[2, 2]
    d2 = C[0, 2] * C_ne[2, 0] + C[1, 2] * C_ne[2, 1] + C[2, 2] * C_ne[2, 2]
    # down in body axes: along it the attitude's variance is the heading's
    waits = not variance_along(s.P_b, d0, d1, d2) <= s.limits.heading_variance
    m.mask_waits = 1 if waits else 0
    for j in range(n_rows):
        row = rows.observation[rows.first[epoch] + j]
        line = s.lines[j]
        if row.no_satellite != 0:
            continue
        look = look_at(line.u_b, s.P_b, waits, s.installation, s.limits, seen[row.slot])
        seen[row.slot] = look.decision
        line.gain = look.gain_dbic
        if look.reason != USED and par.visibility == MASK:
            for kind in range(N_KINDS):
                if line.status[kind] == USED:
                    line.status[kind] = look.reason
