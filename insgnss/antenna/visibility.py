"""The visibility stage, compiled: whether an antenna of the vehicle sees a satellite, in the attitude it has.

The line of sight is turned into the body, then into each antenna's frame; the gain there is held against a threshold.
A decision changes only when the gain is beyond the threshold by ``margin_sigma`` of the gain's uncertainty due to
attitude, and a hidden satellite needs ``hysteresis_db`` more to return, so nothing flickers. The airframe's edges
are treated the same way: within ``margin_sigma`` of an edge the decision stays. Of several antennas the best one
counts.

What is to happen within the margin is a setting: a satellite that was visible before stays so (KEEP), stays so with the
more noise the likelier it is hidden (DEWEIGHT), or is hidden (HIDE). One that was hidden stays hidden in all three.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from insgnss.antenna.gain_pattern import gain_at
from insgnss.antenna.installation import Installation, clearance_at
from insgnss.geodesy.directions import directions
from insgnss.kernels.jit import kernel
from insgnss.status import MASKED_GAIN, MASKED_OBSTRUCTION, USED
from insgnss.tables import Float64, Int8

# A satellite's decision. Bit 0: it counts as visible; bit 1: that is uncertain, and what was decided before stays.
HIDDEN: Final = 0
VISIBLE: Final = 1
UNCERTAIN_HIDDEN: Final = 2
UNCERTAIN_VISIBLE: Final = 3
UNDECIDED: Final = -1  # nothing was decided yet; it counts as visible (bit 0 is set)
IS_VISIBLE: Final = 1  # the bit: ``decision & IS_VISIBLE``
IS_UNCERTAIN: Final = 2
# The treatment of a satellite within the margin, ``VisibilityLimits.uncertain``
KEEP: Final = 0
HIDE: Final = 1
DEWEIGHT: Final = 2
DECISIONS: Final = ("hidden", "visible", "uncertain_hidden", "uncertain_visible")


class VisibilityLimits(NamedTuple):
    """The stage's settings, as the kernels read them."""

    threshold_dbic: float  # least gain
    hysteresis_db: float  # more than that, for a hidden satellite to return
    margin_sigma: float  # of the gain's sigma: nearer to the threshold is uncertain
    heading_variance: float  # of a heading that is too uncertain to mask by [rad^2]
    uncertain: int = KEEP  # KEEP, HIDE or DEWEIGHT
    false_range2: float = 0.0  # mean square error of a hidden satellite's pseudorange [m^2]
    false_rate2: float = 0.0  # and of its range rate [m^2/s^2]


class Look(NamedTuple):
    """The stage's result for one satellite."""

    decision: int  # HIDDEN ... UNCERTAIN_VISIBLE
    gain_dbic: float  # of the antenna that decided
    sigma_db: float  # of the gain, by the attitude's uncertainty
    reason: int  # USED, MASKED_GAIN or MASKED_OBSTRUCTION
    antenna: int  # the one that decided, -1 without any
    doubt: float  # probability that it is hidden, where that is uncertain; else 0


class Looks(NamedTuple):
    """The stage's results for s satellites at n attitudes; the fields are those of ``Look``."""

    decision: Int8  # (n, s)
    reason: Int8
    antenna: Int8
    gain: Float64  # (n, s, 2) or (n, s, 3): gain [dBic], its sigma [dB] and, where there is room, the doubt


def new_looks(n: int, s: int, *, with_doubt: bool = False) -> Looks:
    """Return room for s satellites at n attitudes."""
    decision, reason, antenna = (np.zeros((n, s), np.int8) for _ in range(3))
    return Looks(decision, reason, antenna, np.zeros((n, s, 3 if with_doubt else 2)))


@kernel(inline=True)
def attitude_covariance(P: Float64, at: int, C_eb: Float64, P_b: Float64) -> None:
    """Write the covariance (3, 3) of the attitude error in body axes, C_be P_psi C_eb, into ``P_b`` [rad^2].

    Parameters
    ----------
    P : (n, n) covariance of the filter, the attitude error psi_e from row ``at`` on
    """
    for i in range(3):
        for j in range(3):
            total = 0.0
            for a in range(3):
                for b in range(3):
                    total += C_eb[a, i] * P[at + a, at + b] * C_eb[b, j]
            P_b[i, j] = total


@kernel(inline=True)
def variance_along(P_b: Float64, x: float, y: float, z: float) -> float:
    """Return d^T P d of d = (x, y, z): of the rotation about d where d has length one.

    Towards the centre of the Earth this is the heading's variance, in any attitude.
    """
    first = x * (P_b[0, 0] * x + 2.0 * P_b[0, 1] * y + 2.0 * P_b[0, 2] * z)
    return float(first + y * (P_b[1, 1] * y + 2.0 * P_b[1, 2] * z) + z * P_b[2, 2] * z)


@kernel(inline=True)
def compare(excess: float, margin: float) -> int:
    """Return 1 where ``excess`` reaches the margin, -1 where it falls short of zero by more than it, 0 between.

    An excess that is not a number counts as hidden: a false lock is worse than a missed satellite.
    """
    if excess >= margin:
        return 1
    return 0 if excess >= -margin else -1


@kernel(inline=True)
def sigmas_above(excess: float, sigma: float) -> float:
    """Return by how many sigmas an excess is above zero; without uncertainty it is endless or nothing."""
    if sigma > 0.0:
        return excess / sigma
    return math.inf if excess >= 0.0 else -math.inf


@kernel(inline=True)
def gain_of_antenna(
    antennas: Installation, k: int, x: float, y: float, z: float, P_b: Float64
) -> tuple[float, float]:
    """Return gain [dBic] and its sigma [dB] of antenna ``k`` towards (x, y, z), body axes."""
    C = antennas.C_ab
    c00, c01, c02 = C[k, 0, 0], C[k, 0, 1], C[k, 0, 2]
    c10, c11, c12 = C[k, 1, 0], C[k, 1, 1], C[k, 1, 2]
    c20, c21, c22 = C[k, 2, 0], C[k, 2, 1], C[k, 2, 2]
    gain, a0, a1, a2 = gain_at(
        antennas.pattern,
        k,
        c00 * x + c01 * y + c02 * z,
        c10 * x + c11 * y + c12 * z,
        c20 * x + c21 * y + c22 * z,
    )
    b0 = c00 * a0 + c10 * a1 + c20 * a2
    b1 = c01 * a0 + c11 * a1 + c21 * a2
    b2 = c02 * a0 + c12 * a1 + c22 * a2
    variance = variance_along(P_b, b1 * z - b2 * y, b2 * x - b0 * z, b0 * y - b1 * x)
    return gain, math.sqrt(max(variance, 0.0))


@kernel(inline=True)
def look_at(
    u_b: Float64, P_b: Float64, waits: bool, antennas: Installation, limits: VisibilityLimits, before: int
) -> Look:
    """Return whether a satellite is seen, by which antenna, and at which gain.

    Equation: u_a = C_ab u_b; a rotation error phi of the body turns u_b by u_b x phi, so
    dg/dphi = grad_b g x u_b and sigma_g^2 = (dg/dphi) P_b (dg/dphi)^T    [first order]; within the margin it is hidden
    with the probability Phi(-z), z = (g - threshold) / sigma_g, or the clearance of the frame over its sigma
    Neglects: the bend of the pattern over the attitude's uncertainty, so an edge in a pattern that is narrower than
    that has no margin (as an obstruction it has one); the parallax between antennas (1e-7 rad).

    Parameters
    ----------
    u_b : (3,) unit line of sight to the satellite, body axes
    P_b : (3, 3) covariance of the attitude error, body axes [rad^2]
    waits : whether the heading is still too uncertain to mask anything
    before : the satellite's decision so far, UNDECIDED at first
    """
    x, y, z = u_b[0], u_b[1], u_b[2]
    needed = limits.threshold_dbic + (0.0 if before & IS_VISIBLE else limits.hysteresis_db)
    off2 = P_b[0, 0] + P_b[1, 1] + P_b[2, 2] - variance_along(P_b, x, y, z)
    off = math.sqrt(max(off2, 0.0))
    best, best_gain, best_sigma, reason, chosen, above = -2, math.nan, 0.0, USED, -1, 0.0
    for k in range(len(antennas.lever_b)):
        gain, sigma = gain_of_antenna(antennas, k, x, y, z, P_b)
        by_gain = compare(gain - needed, limits.margin_sigma * sigma)
        by_frame, z_k = 1, sigmas_above(gain - needed, sigma)
        if antennas.is_obstructed[k]:
            clearance = clearance_at(antennas.clearance_deg, k, x, y, z)
            by_frame = compare(clearance, limits.margin_sigma * off)
            z_k = min(z_k, sigmas_above(clearance, off))
        seen = min(by_gain, by_frame)
        if seen > best or (seen == best and (gain > best_gain or math.isnan(best_gain))):
            best, best_gain, best_sigma, chosen, above = seen, gain, sigma, k, z_k
            reason = MASKED_OBSTRUCTION if by_frame < by_gain else MASKED_GAIN
    decision, doubt = VISIBLE, 0.0
    if waits:
        decision = UNCERTAIN_VISIBLE
    elif best == 0:
        decision = IS_UNCERTAIN
        if limits.uncertain != HIDE:
            decision |= before & IS_VISIBLE
        doubt = 0.5 * math.erfc(above * math.sqrt(0.5))
    elif best == -1:
        decision = HIDDEN
    return Look(decision, best_gain, best_sigma, USED if decision & IS_VISIBLE else reason, chosen, doubt)


@kernel
def look_at_all(
    C_nb: Float64,
    P_b: Float64,
    u_n: Float64,
    antennas: Installation,
    limits: VisibilityLimits,
    out: Looks,
) -> None:
    """Take the decisions for n attitudes, one after another, and s satellites.

    A satellite whose direction is NaN is undecided from then on.

    Parameters
    ----------
    C_nb : (n, 3, 3)
    P_b : (n, 3, 3) covariance of the attitude error, body axes [rad^2]
    u_n : (n, s, 3) unit lines of sight, north-east-down
    out : ``new_looks``; its decisions may be (n + 1, s), the first row what was decided before
    """
    decision, reason, antenna, gain = out
    n, s = u_n.shape[0], u_n.shape[1]
    earlier = decision.shape[0] - n
    u_b = np.empty(3)
    for t in range(n):
        C, P, row = C_nb[t], P_b[t], t + earlier
        # the third row of C_nb is down in body axes
        waits = not variance_along(P, C[2, 0], C[2, 1], C[2, 2]) <= limits.heading_variance
        for i in range(s):
            decision[row, i], reason[t, i], antenna[t, i] = UNDECIDED, USED, -1
            gain[t, i, 0] = gain[t, i, 1] = math.nan
            n0, n1, n2 = u_n[t, i, 0], u_n[t, i, 1], u_n[t, i, 2]
            if not math.isfinite(n0):
                continue
            for k in range(3):
                u_b[k] = C[0, k] * n0 + C[1, k] * n1 + C[2, k] * n2
            before = decision[row - 1, i] if row > 0 else UNDECIDED
            look = look_at(u_b, P, waits, antennas, limits, before)
            decision[row, i], reason[t, i], antenna[t, i] = look.decision, look.reason, look.antenna
            gain[t, i, 0], gain[t, i, 1] = look.gain_dbic, look.sigma_db
            if gain.shape[2] > 2:
                gain[t, i, 2] = look.doubt


def gain_map(
    antennas: Installation, limits: VisibilityLimits, azimuth_deg: Float64, down_deg: Float64
) -> Float64:
    """Return the gain of the best antenna towards directions in body axes [dBic]; NaN where the airframe hides them.

    Parameters
    ----------
    azimuth_deg : (m,) from forward to the right
    down_deg : (n,) from straight up, 0, over the body's horizon, 90, to straight down, 180

    Returns
    -------
    (n, m)
    """
    u_n = directions(azimuth_deg[None, :], 90.0 - down_deg[:, None]).reshape(1, -1, 3)
    looks = new_looks(*u_n.shape[:2])
    level, known = np.eye(3)[None], np.zeros((1, 3, 3))
    look_at_all(level, known, u_n, antennas, limits, looks)
    shown = np.where(looks.reason[0] == MASKED_OBSTRUCTION, np.nan, looks.gain[0, :, 0])
    return np.asarray(shown.reshape(len(down_deg), len(azimuth_deg)))
