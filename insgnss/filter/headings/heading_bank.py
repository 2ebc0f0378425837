"""The bank of headings: members that have become one are merged, members that have grown wide are split.

Both keep the first two moments of the bank. A member is deleted only when its weight is negligible.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from insgnss.filter.headings.headings import (
    heading_variance,
    is_prunable,
    same_heading,
    turn_about,
    yaw_variance,
)
from insgnss.filter.layout import Layout
from insgnss.filter.state import (
    BA,
    BG,
    CLOCK,
    DR,
    DRIFT,
    DV,
    OFFSETS,
    PSI,
    Bank,
    StateRecord,
    select_members,
)
from insgnss.filter.states.lever_arm import lever_of, lever_rows
from insgnss.geodesy.local_level import level_axes, up_direction
from insgnss.geodesy.rotations import (
    EARTH_RATE_E,
    cross_matrix,
    matrix_to_euler,
    matrix_to_quaternion,
    rotation_matrix,
    rotation_vector,
)
from insgnss.tables import Float64, Int64

_WIDE: Final = 1.2  # sigmas of a window
_MEANS: Final = (
    *("noise_factor", "drift_moved", "weak_shown", "weak_rows", "motion_response", "f_mean"),
    *("dv_late", "swing_late"),
)


def attitude(m: StateRecord) -> tuple[float, float, float]:
    """Return roll, pitch and yaw of a hypothesis [rad]."""
    roll, pitch, yaw = matrix_to_euler(np.ascontiguousarray(level_axes(m.r_e) @ m.C_eb))
    return float(roll), float(pitch), float(yaw)


def heading_deg(bank: Bank) -> tuple[float, float]:
    """Return the leader's heading, 0 to 360, and the sigma of all hypotheses about it [deg]."""
    _, _, yaw = attitude(bank.state[bank.head[0].leader])
    return math.degrees(yaw) % 360.0, math.degrees(math.sqrt(heading_variance(bank)))


def pruned(bank: Bank, drop: float, layout: Layout) -> Bank:
    """Return the bank without members of negligible weight, those of one heading merged into the heavier.

    ``drop`` is the logarithm of the weight that is negligible.
    """
    weight = bank.state["log_weight"]
    order = np.argsort(weight, kind="stable")
    gone = set()
    for i in map(int, order[:-1]):
        if not is_prunable(bank, i, drop):
            continue
        gone.add(i)
        heavier = same_heading(bank, i)
        if weight[i] >= drop and heavier >= 0:
            merge_into(bank, heavier, i, layout)
    return select_members(bank, np.array([i for i in range(len(weight)) if i not in gone], np.int64))


def merge_into(bank: Bank, j: int, i: int, layout: Layout) -> None:
    """Give member ``j`` the weight, mean and covariance of itself and member ``i`` together.

    Equation: w = w_i + w_j, x = x_j + p d, P = p (P_i + (d - p d)(d - p d)^T) + (1 - p) (P_j + p^2 d d^T),
              p = w_i / w, d = x_i - x_j, its attitude part the rotation vector from j to i
    """
    m, other = bank.state[j], bank.state[i]
    total = float(np.logaddexp(m.log_weight, other.log_weight))
    p = math.exp(other.log_weight - total)
    d = difference(other, m, bank.P.shape[1], layout)
    own, rest = p * d, (1.0 - p) * d
    bank.P[j] = p * (bank.P[i] + np.outer(rest, rest)) + (1.0 - p) * (bank.P[j] + np.outer(own, own))
    add_to_state(m, own, layout)
    for name in _MEANS:
        m[name] = p * other[name] + (1.0 - p) * m[name]
    m.log_weight = total


def difference(m: StateRecord, of: StateRecord, n: int, layout: Layout) -> Float64:
    """Return the state ``m`` minus the state ``of`` as an error state (n,)."""
    d = np.zeros(n)
    d[DR : DR + 3], d[DV : DV + 3] = m.r_e - of.r_e, m.v_e - of.v_e
    d[PSI : PSI + 3] = rotation_vector(m.C_eb @ of.C_eb.T)
    d[BA : BA + 3], d[BG : BG + 3] = m.b_a - of.b_a, m.b_g - of.b_g
    d[[CLOCK, DRIFT]] = m.clock - of.clock
    end = OFFSETS + layout.n_values
    d[OFFSETS:end] = (m.optional - of.optional)[: layout.n_values]
    if layout.clone:
        d[end : end + 3] = m.r_clone - of.r_clone
        d[end + 3] = m.clock_clone - of.clock_clone
    return d


def add_to_state(m: StateRecord, d: Float64, layout: Layout) -> None:
    """Add an error state (n,) to a state, the attitude by its rotation vector."""
    m.r_e[:] += d[DR : DR + 3]
    m.v_e[:] += d[DV : DV + 3]
    m.v_corrected[:] += d[DV : DV + 3]  # the sensors have measured none of it
    m.b_a[:] += d[BA : BA + 3]
    m.b_g[:] += d[BG : BG + 3]
    m.clock[:] += d[[CLOCK, DRIFT]]
    end = OFFSETS + layout.n_values
    m.optional[: layout.n_values] += d[OFFSETS:end]
    if layout.clone:
        m.r_clone[:] += d[end : end + 3]
        m.clock_clone += d[end + 3]
    set_attitude(m, rotation_matrix(d[PSI : PSI + 3]) @ m.C_eb)


def set_attitude(m: StateRecord, C_eb: Float64) -> None:
    """Set both forms of the attitude; that of the epoch before and the lag turn too: no vehicle has rotated."""
    turned = C_eb @ m.C_eb.T
    m.C_swung[:] = turned @ m.C_swung
    m.dv_late[:], m.swing_late[:] = m.dv_late @ turned.T, turned @ m.swing_late
    m.C_eb[:] = C_eb
    matrix_to_quaternion(np.ascontiguousarray(C_eb), m.q_eb)


def split(bank: Bank, n_headings: int, drop: float, lever_b: Float64, layout: Layout) -> Bank:
    """Return the bank with wide members replaced by members of ``n_headings`` around the circle.

    Gaussian windows a spacing apart, with half of it as their sigma s, add up to a constant (to 1.4 %). A wide member
    times a window is a member again: the update by a heading psi_k of variance s^2. What all of them have in one window
    is merged. So mean and variance of every state stay, of the gyro bias above all, which has made them wide, and of
    members that lie beside each other none keeps a correlation of heading and bias that they do not have together.
    Members not much wider than a window stay as they are; what is of negligible weight (logarithm below ``drop``) is
    left out.
    Equation: w_ik ~ w_i N(psi_k - psi_i; sigma_i^2 + s^2), sum_k w_ik = w_i, mean psi_i + (psi_k - psi_i) sigma_i^2 /
              (sigma_i^2 + s^2), variance sigma_i^2 s^2 / (sigma_i^2 + s^2)
    """
    spacing = 2.0 * math.pi / n_headings
    sigma = np.array([math.sqrt(yaw_variance(m, P)) for m, P in zip(bank.state, bank.P, strict=True)])
    lead, centres = bank.state[bank.head[0].leader], spacing * np.arange(n_headings)
    shares = []
    for i in map(int, np.flatnonzero(sigma > _WIDE * 0.5 * spacing)):
        away = np.remainder(centres - turn_about(lead, bank.state[i]) + math.pi, 2.0 * math.pi) - math.pi
        both = sigma[i] ** 2 + (0.5 * spacing) ** 2
        weight = -0.5 * away**2 / both
        weight += bank.state[i].log_weight - np.logaddexp.reduce(weight)
        gain, left = sigma[i] ** 2 / both, sigma[i] * 0.5 * spacing / math.sqrt(both)
        shares += [
            _WindowShare(i, int(k), gain * float(away[k]), left, float(weight[k]))
            for k in np.flatnonzero(weight > drop)
        ]
    narrow = np.flatnonzero(sigma <= _WIDE * 0.5 * spacing)
    members = np.array([*narrow, *(part.member for part in shares)], np.int64)
    # without what they remember of satellites, the most of a member: the few that stay have it from where they came
    split_bank = select_members(bank._replace(seen=bank.seen[:, :0], memory=bank.memory[:, :0]), members)
    split_bank.state["log_weight"][: len(narrow)] = bank.state["log_weight"][narrow]
    for at, part in enumerate(shares, start=len(narrow)):
        split_bank.state[at].log_weight = part.log_weight
        turn_member(split_bank.state[at], split_bank.P[at], part.turn, part.sigma, lever_b, layout)
    stay = _merged_by_window(split_bank, len(narrow), [part.window for part in shares], layout)
    return select_members(split_bank, stay)._replace(
        seen=bank.seen[members[stay]], memory=bank.memory[members[stay]]
    )


class _WindowShare(NamedTuple):
    """A wide member's part in a window."""

    member: int
    window: int
    turn: float  # from the member's heading [rad]
    sigma: float  # [rad]
    log_weight: float


def _merged_by_window(bank: Bank, n_kept: int, window: list[int], layout: Layout) -> Int64:
    """Merge the members from ``n_kept`` on that have the same window; return those that stay."""
    first: dict[int, int] = {}
    keep = list(range(n_kept))
    for i, k in sorted(enumerate(window, start=n_kept), key=lambda pair: -bank.state[pair[0]].log_weight):
        if k in first:
            merge_into(bank, first[k], i, layout)
        else:
            first[k] = i
            keep.append(i)
    return np.array(sorted(keep), np.int64)


def turn_member(
    m: StateRecord, P: Float64, turn: float, sigma: float, lever_b: Float64, layout: Layout
) -> None:
    """Condition a member on its heading being ``turn`` [rad] farther on, with ``sigma`` [rad] left.

    Equation: g = P u / sigma_u^2 with sigma_u^2 = u^T P u, u the vertical among the attitude's errors; x <- x + g turn,
    P <- P - g g^T (sigma_u^2 - sigma^2), then P <- T P T^T for the axes of the new heading (``turned_axes``).
    What the measurements know is the antenna, to millimetres from its clone: it is the antenna that moves by g, and the
    gyro bias plus the Earth's rate. Neglects: the same of a turning body's antenna velocity, 4 cm/s for half a radian,
    0.5 m and 30 deg/s.
    """
    up, J = np.array(up_direction(m.r_e)), lever_rows(layout, len(P))
    u = np.zeros(len(P))
    u[PSI : PSI + 3] = up
    variance = float(u @ P @ u)
    g = P @ u / variance
    P -= np.outer(g, g) * (variance - sigma**2)
    C_before, R = m.C_eb.copy(), rotation_matrix(turn * up)
    l_e, rate = C_before @ lever_of(m, lever_b, layout), EARTH_RATE_E
    antenna, apparent = m.r_e + l_e, m.b_g + C_before.T @ rate
    d = g * turn
    antenna += d[DR : DR + 3] + np.cross(d[PSI : PSI + 3], l_e) + C_before @ J @ d
    apparent += d[BG : BG + 3] + C_before.T @ np.cross(rate, turn * up)
    d[PSI : PSI + 3] -= turn * up  # the tilt that belongs to it
    add_to_state(m, d, layout)
    set_attitude(m, R @ m.C_eb)
    m.r_e[:] = antenna - m.C_eb @ lever_of(m, lever_b, layout)
    m.b_g[:] = apparent - m.C_eb.T @ rate
    T = turned_axes(len(P), R, C_before, l_e)
    T[DR : DR + 3] += (C_before - R @ C_before) @ J  # the antenna stays for every lever arm
    P[:] = T @ P @ T.T
    P[:] = 0.5 * (P + P.T)
    m.motion_response[:] = 0.0


def turned_axes(n: int, R: Float64, C_eb: Float64, l_e: Float64) -> Float64:
    """Return T (n, n) that takes the errors of a state to those of one whose heading was turned by ``R`` (3, 3).

    The attitude's errors turn with the body; antenna position and apparent gyro bias keep theirs.
    Equation: psi' = R psi, dr' + psi' x R l = dr + psi x l, db' + C^T R^T (w x psi') = db + C^T (w x psi)

    Parameters
    ----------
    C_eb, l_e : attitude and lever arm (3,) [m], ECEF, before the turn
    """
    rate = EARTH_RATE_E
    T = np.eye(n)
    T[PSI : PSI + 3, PSI : PSI + 3] = R
    T[DR : DR + 3, PSI : PSI + 3] = cross_matrix(R @ l_e) @ R - cross_matrix(l_e)
    T[BG : BG + 3, PSI : PSI + 3] = C_eb.T @ cross_matrix(rate - R.T @ rate)
    return T
