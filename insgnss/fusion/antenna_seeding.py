"""From the heading hypotheses of a bank to the attitudes that a search looks at, and from its result to one filter."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from insgnss.attitude.cycle_search import Prior
from insgnss.attitude.small_rotation import rotation_matrix
from insgnss.fusion.state import BA, BG, PSI, Bank, select_members
from insgnss.geodesy.ellipsoid import ecef_to_geodetic
from insgnss.geodesy.local_level import ecef_to_ned_matrix
from insgnss.geodesy.rotations import matrix_to_quaternion
from insgnss.tables import Float64

_LEVEL_FLOOR_RAD: Final = math.radians(0.3)  # what levelling may be wrong by beyond the filter's sigma
_REACH_SIGMAS: Final = 4.0  # of a heading that one filter has
_BANK_SIGMAS: Final = 2.5  # of one of several: neighbours stand two apart
_REACH_FLOOR_RAD: Final = math.radians(3.0)
_AGREES_SIGMAS: Final = 3.0
_NARROW_RAD: Final = math.radians(10.0)  # of so many sigmas: the update is linear enough


def priors_of(bank: Bank, *, anywhere: bool = False) -> tuple[list[Prior], Float64]:
    """Return each hypothesis' attitude with the headings around it, and C_ne (3, 3) at the leader.

    Parameters
    ----------
    anywhere : all headings are looked at, whatever the filter believes
    """
    lat, lon, _ = ecef_to_geodetic(bank.state[bank.head[0].leader].r_e)
    C_ne = np.zeros((3, 3))
    ecef_to_ned_matrix(lat, lon, C_ne)
    priors = []
    single = len(bank.state) == 1
    for m, P in zip(bank.state, bank.P, strict=True):
        P_n = C_ne @ P[PSI : PSI + 3, PSI : PSI + 3] @ C_ne.T
        level = math.hypot(math.sqrt(max(P_n[0, 0], P_n[1, 1])), _LEVEL_FLOOR_RAD)
        reach = (_REACH_SIGMAS if single else _BANK_SIGMAS) * math.sqrt(P_n[2, 2])
        reach = math.pi if anywhere else min(max(reach, _REACH_FLOOR_RAD), math.pi)
        priors.append(Prior(C_ne @ m.C_eb, level, reach))
    return priors[:1] if anywhere else priors, C_ne


def seeded(bank: Bank, member: int, C_nb: Float64, C_ne: Float64) -> Bank:
    """Return one hypothesis alone, turned about the vertical to the heading of ``C_nb``.

    What it knows of tilt, velocity and position stays as it is in the level frame, so the body's axes of the biases
    turn under it: P -> T P T^T with T = C_new^T C_old in the blocks of both biases. A turn beyond the heading's own
    sigma widens it. A heading that is known and agrees is left to the update.
    """
    one = select_members(bank, np.array([member], np.int64))
    m, P = one.state[0], one.P[0]
    old = C_ne @ m.C_eb
    turn = math.remainder(_heading(C_nb) - _heading(old), 2.0 * math.pi)
    down = C_ne[2]
    variance = float(down @ P[PSI : PSI + 3, PSI : PSI + 3] @ down)
    if len(bank.state) == 1 and turn**2 < _AGREES_SIGMAS**2 * variance < _NARROW_RAD**2:
        return one
    C_eb = C_ne.T @ rotation_matrix([0.0, 0.0, turn]) @ old
    T = np.eye(len(P))
    for at in (BA, BG):
        T[at : at + 3, at : at + 3] = C_eb.T @ m.C_eb
    P[:] = T @ P @ T.T
    P[PSI : PSI + 3, PSI : PSI + 3] += max(turn**2 - variance, 0.0) * np.outer(down, down)
    P[:] = 0.5 * (P + P.T)
    m.C_eb[:] = C_eb
    matrix_to_quaternion(np.ascontiguousarray(C_eb), m.q_eb)
    return one


def _heading(C_nb: Float64) -> float:
    return math.atan2(C_nb[1, 0], C_nb[0, 0])
