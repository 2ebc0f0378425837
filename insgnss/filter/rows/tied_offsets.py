"""Clock offsets that are known to be equal within metres: QZSS's against GPS's of the same band."""

from __future__ import annotations

from insgnss.filter.state import OFFSETS, StateRecord
from insgnss.tables import Float64


def tie_offsets(m: StateRecord, P: Float64, home: tuple[int, ...], sigma_m: float) -> None:
    """Give each tied clock the offset of its home, with ``sigma_m`` more; what an epoch said of it is dropped.

    Equation: o_j = o_i + d, d = 0 with sigma_m: P_jj = P_ii + sigma_m^2, P_ji = P_ii; the reference clock has o_i = 0.

    Parameters
    ----------
    m, P : a hypothesis whose offsets share no covariance yet
    home : of each clock group the earlier one to which it is tied, else -1
    """
    for group, other in enumerate(home):
        if other < 0:
            continue
        j, i = OFFSETS + group - 1, OFFSETS + other - 1
        P[j, :] = 0.0
        P[:, j] = 0.0
        m.optional[group - 1] = m.optional[other - 1] if other > 0 else 0.0
        P[j, j] = (P[i, i] if other > 0 else 0.0) + sigma_m**2
        if other > 0:
            P[j, i] = P[i, j] = P[i, i]
