"""From the heading hypotheses of a bank to the attitudes that a search looks at, and from its result to one filter."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from insgnss.attitude.cycle_search import Prior
from insgnss.filter.antennas.rows import Antennas, Differences, wind_up
from insgnss.filter.headings.heading_bank import set_attitude
from insgnss.filter.state import BA, BG, DR, DV, PSI, Bank, select_members
from insgnss.geodesy.local_level import level_axes
from insgnss.geodesy.rotations import cross_matrix, rotation_matrix
from insgnss.tables import Float64

_LEVEL_FLOOR_RAD: Final = math.radians(0.3)  # what levelling may be wrong by beyond the filter's sigma
_REACH_SIGMAS: Final = 4.0  # of a heading that one filter has
_BANK_SIGMAS: Final = 2.5  # of one of several: neighbours stand two apart
_REACH_FLOOR_RAD: Final = math.radians(3.0)
_PIECE_RAD: Final = math.radians(5.0)
_AGREES_SIGMAS: Final = 3.0
_NARROW_RAD: Final = math.radians(10.0)  # of so many sigmas: the update is linear enough


def priors_of(bank: Bank, *, anywhere: bool = False) -> tuple[list[Prior], Float64]:
    """Return each hypothesis' attitude with the headings around it, and C_ne (3, 3) at the leader.

    Parameters
    ----------
    anywhere : all headings are searched, whatever the filter's heading
    """
    C_ne = level_axes(bank.state[bank.head[0].leader].r_e)
    priors = []
    single = len(bank.state) == 1
    for m, P in zip(bank.state, bank.P, strict=True):
        P_n = C_ne @ P[PSI : PSI + 3, PSI : PSI + 3] @ C_ne.T
        level = math.hypot(math.sqrt(max(P_n[0, 0], P_n[1, 1])), _LEVEL_FLOOR_RAD)
        reach = (_REACH_SIGMAS if single else _BANK_SIGMAS) * math.sqrt(P_n[2, 2])
        reach = math.pi if anywhere else min(max(reach, _REACH_FLOOR_RAD), math.pi)
        priors.append(Prior(C_ne @ m.C_eb, level, reach))
    return priors[:1] if anywhere else priors, C_ne


def wound_up(priors: list[Prior], d: Differences, antennas: Antennas, C_ne: Float64) -> list[Prior]:
    """Return the priors with the wind-up of tilted antennas, in pieces of headings over which it hardly changes.

    Neglects: its change over half a piece, 1 mm where antennas are tilted by 25 deg.
    """
    if not antennas.winds_up:
        return priors
    pieces = []
    for prior in priors:
        count = math.ceil(prior.reach / _PIECE_RAD)
        half = prior.reach / count
        for k in range(count):
            C_nb = rotation_matrix([0.0, 0.0, (2 * k + 1 - count) * half]) @ prior.C_nb
            pieces.append(Prior(C_nb, prior.sd_level, half, wind_up(d, C_ne.T @ C_nb, antennas)))
    return pieces


def seeded(bank: Bank, C_nb: Float64, C_ne: Float64, lever_b: Float64, w_eb_b: Float64) -> Bank:
    """Return the hypothesis nearest in heading alone, turned about the vertical to the heading of ``C_nb``.

    It is the main antenna's position and velocity that were measured: they stay, and the IMU's turn about them. The
    hypothesis keeps its tilt in the level frame, so the body's axes of the biases turn under it:
        r' = r + (C_old - C_new) l, v' = v + (C_old - C_new) (w x l), P' = T P T^T,
        T = C_new^T C_old in the blocks of both biases, [(l_new - l_old) x] from attitude to position, and the same for
        velocity.
    A turn beyond the heading's own sigma widens it. A heading that is known and agrees is left to the update.

    Parameters
    ----------
    lever_b : (3,) IMU to main antenna [m]
    w_eb_b : (3,) rate of the body [rad/s]
    """
    turns = [math.remainder(_heading(C_nb) - _heading(C_ne @ m.C_eb), 2.0 * math.pi) for m in bank.state]
    member = int(np.argmin(np.abs(turns)))
    one, turn = select_members(bank, np.array([member], np.int64)), turns[member]
    m, P = one.state[0], one.P[0]
    old = C_ne @ m.C_eb
    down = C_ne[2]
    variance = float(down @ P[PSI : PSI + 3, PSI : PSI + 3] @ down)
    if len(bank.state) == 1 and turn**2 < _AGREES_SIGMAS**2 * variance < _NARROW_RAD**2:
        return one
    C_eb = C_ne.T @ rotation_matrix([0.0, 0.0, turn]) @ old
    T = np.eye(len(P))
    for at in (BA, BG):
        T[at : at + 3, at : at + 3] = C_eb.T @ m.C_eb
    for at, arm_b in ((DR, lever_b), (DV, np.cross(w_eb_b, lever_b))):
        T[at : at + 3, PSI : PSI + 3] = cross_matrix((C_eb - m.C_eb) @ arm_b)
    m.r_e += (m.C_eb - C_eb) @ lever_b
    about_antenna = (m.C_eb - C_eb) @ np.cross(w_eb_b, lever_b)
    m.v_e += about_antenna
    m.v_corrected += about_antenna
    P[:] = T @ P @ T.T
    P[PSI : PSI + 3, PSI : PSI + 3] += max(turn**2 - variance, 0.0) * np.outer(down, down)
    P[:] = 0.5 * (P + P.T)
    set_attitude(m, C_eb)
    return one


def _heading(C_nb: Float64) -> float:
    return math.atan2(C_nb[1, 0], C_nb[0, 0])
