"""Which satellites airframe and pattern hide from each of several antennas, in the attitude of the moment.

The stage of ``antenna.visibility`` looks through one antenna at a time: what one antenna does not see may be used
between the others. No decision is carried from epoch to epoch: near the threshold a satellite comes and goes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insgnss.antenna.installation import Installation
from insgnss.antenna.visibility import DEWEIGHT, VisibilityLimits, look_at_all, new_looks
from insgnss.filter.state import PSI
from insgnss.status import USED
from insgnss.tables import Float64, Int8


@dataclass(frozen=True)
class AntennaMasking:
    """The antennas, each an installation of its own, and the stage's settings."""

    installations: tuple[Installation, ...]
    limits: VisibilityLimits


def hidden_reasons(
    hiding: AntennaMasking, antenna: Int8, u_n: Float64, C_nb: Float64, C_eb: Float64, P: Float64
) -> tuple[Int8, Float64]:
    """Return for each row USED, or by what its antenna does not see the satellite, and the doubt of those kept, (n,).

    The doubt is the probability that a satellite is hidden that is kept with more noise; else zero.

    Parameters
    ----------
    antenna : (n,)
    u_n : (n, 3) unit vectors to the satellites, north-east-down
    C_nb, C_eb : (3, 3) attitude
    P : covariance of the filter
    """
    P_b = C_eb.T @ P[PSI : PSI + 3, PSI : PSI + 3] @ C_eb
    reasons, doubt = np.zeros(len(antenna), np.int8), np.zeros(len(antenna))
    for number, installed in enumerate(hiding.installations):
        own = np.flatnonzero(antenna == number)
        if not len(own):
            continue
        looks = new_looks(1, len(own), with_doubt=True)
        look_at_all(
            np.ascontiguousarray(C_nb)[None], np.ascontiguousarray(P_b)[None],
            np.ascontiguousarray(u_n[own])[None], installed, hiding.limits, looks,
        )  # fmt: skip
        reasons[own] = looks.reason[0]
        if hiding.limits.uncertain == DEWEIGHT:
            doubt[own] = np.where(looks.reason[0] == USED, looks.gain[0, :, 2], 0.0)
    return reasons, doubt
