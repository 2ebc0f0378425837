"""The receiver clock and its offsets as a fix shows them, and offsets that are known to be equal within metres."""

from __future__ import annotations

import numpy as np

from insgnss.filter.state import CLOCK, OFFSETS, StateRecord
from insgnss.tables import Float64


def place_clocks(
    m: StateRecord, P: Float64, clocks: Float64, variance: float, apart: Float64, sigma_m: float
) -> None:
    """Write the clock and the offsets that a fix shows; what they shared with other states is dropped.

    Equation: c = z_r - o_r and o_i = z_i - z_r + o_r, r the first group that has a satellite. Of the reference o_r is
    zero. Where it has no satellite, o_r = 0 with ``sigma_m``: the sum c + o_r is known, each by itself is not.

    Parameters
    ----------
    clocks : (g,) of each group z [m], NaN without satellites; of none the clock begins at zero
    variance : of z_r [m^2]
    apart : (g,) of z_i - z_r [m^2]
    sigma_m : of an offset that is not known
    """
    shown = np.isfinite(clocks)
    first = int(np.argmax(shown))
    own = np.where(shown, apart, sigma_m**2)
    own[first], own[0] = 0.0, variance
    along = shown.astype(float)  # how the error of o_r enters
    along[0] = -1.0
    at = np.array([CLOCK, *range(OFFSETS, OFFSETS + len(clocks) - 1)])
    P[at, :] = P[:, at] = 0.0
    P[np.ix_(at, at)] = np.diag(own) + np.outer(along, along) * (sigma_m**2 if first > 0 else 0.0)
    m.clock[0] = clocks[first] if shown[first] else 0.0
    m.optional[: len(clocks) - 1] = np.where(shown, clocks - m.clock[0], 0.0)[1:]


def tie_offsets(m: StateRecord, P: Float64, home: tuple[int, ...], sigma_m: float) -> None:
    """Give each tied clock the offset of its home, with ``sigma_m`` more; what an epoch said of it is dropped.

    Equation: o_j = o_i + d, d = 0 with sigma_m: P_j = P_i, P_jj = P_ii + sigma_m^2; the reference clock has o_i = 0.

    Parameters
    ----------
    m, P : a hypothesis whose offsets share covariance with the clock and each other alone
    home : of each clock group the earlier one to which it is tied, else -1
    """
    for group, other in enumerate(home):
        if other < 0:
            continue
        j, i = OFFSETS + group - 1, OFFSETS + other - 1
        P[j, :] = P[i, :] if other > 0 else 0.0
        P[:, j] = P[j, :]
        P[j, j] = (P[i, i] if other > 0 else 0.0) + sigma_m**2
        m.optional[group - 1] = m.optional[other - 1] if other > 0 else 0.0
