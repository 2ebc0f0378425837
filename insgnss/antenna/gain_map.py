"""The gain of a vehicle's best antenna over the whole sphere of its body: the background of sky plots."""

from __future__ import annotations

import numpy as np

from insgnss.antenna.installation import Installation
from insgnss.antenna.visibility import VisibilityLimits, look_at_all, new_looks
from insgnss.geodesy.directions import directions
from insgnss.status import MASKED_OBSTRUCTION
from insgnss.tables import Float64


def gain_map(
    antennas: Installation, limits: VisibilityLimits, azimuth_deg: Float64, down_deg: Float64
) -> Float64:
    """Return the gain of the best antenna towards directions in body axes [dBic]; NaN where the airframe hides them.

    Parameters
    ----------
    antennas : of the vehicle
    limits : of the visibility stage
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
