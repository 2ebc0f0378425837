"""Which satellites airframe and pattern hide from each of several antennas, in the attitude of the moment.

The stage of ``antenna.visibility`` looks through one antenna at a time: what one antenna does not see may be used
between the others. No decision is carried from epoch to epoch: near the threshold a satellite comes and goes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insgnss.antenna.installation import Installation
from insgnss.antenna.visibility import Limits, look_at_all
from insgnss.fusion.state import PSI
from insgnss.tables import Float64, Int8


@dataclass(frozen=True)
class Hiding:
    """The antennas, each an installation of its own, and the stage's settings."""

    installations: tuple[Installation, ...]
    limits: Limits


def hidden_reasons(
    hiding: Hiding, antenna: Int8, u_n: Float64, C_nb: Float64, C_eb: Float64, P: Float64
) -> Int8:
    """Return for each row USED, or by what its antenna does not see the satellite, (n,).

    Parameters
    ----------
    antenna : (n,)
    u_n : (n, 3) unit vectors to the satellites, north-east-down
    C_nb, C_eb : (3, 3) attitude
    P : covariance of the filter
    """
    P_b = C_eb.T @ P[PSI : PSI + 3, PSI : PSI + 3] @ C_eb
    reasons = np.zeros(len(antenna), np.int8)
    for number, installed in enumerate(hiding.installations):
        own = np.flatnonzero(antenna == number)
        if not len(own):
            continue
        decision, reason, chosen = (np.zeros((1, len(own)), np.int8) for _ in range(3))
        gain = np.zeros((1, len(own), 2))
        look_at_all(
            np.ascontiguousarray(C_nb)[None], np.ascontiguousarray(P_b)[None],
            np.ascontiguousarray(u_n[own])[None], installed, hiding.limits, decision, reason, chosen, gain,
        )  # fmt: skip
        reasons[own] = reason[0]
    return reasons
