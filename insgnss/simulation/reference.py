"""The truth as a reference trajectory: latitude, longitude, height, velocity north-east-down, roll, pitch, yaw."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from insgnss.constants import NS_PER_S
from insgnss.geodesy.local_level import geodetic, ned_axes
from insgnss.simulation.trajectory import TrajectoryState
from insgnss.tables import ReferenceTable


def reference_table(motion: TrajectoryState, start_ns: int) -> ReferenceTable:
    """Return the motion of the IMU as a reference of the best quality; ``start_ns`` is the GPS time of its t = 0."""
    place = geodetic(motion.r_e)
    C_ne = ned_axes(place)
    yaw_pitch_roll = Rotation.from_matrix(C_ne @ motion.C_eb).as_euler("ZYX", degrees=True)
    return ReferenceTable(
        t_ns=start_ns + np.rint(motion.t_s * NS_PER_S).astype(np.int64),
        lat_deg=np.rad2deg(place[:, 0]),
        lon_deg=np.rad2deg(place[:, 1]),
        h_m=place[:, 2],
        v_n=np.einsum("nij,nj->ni", C_ne, motion.v_e),
        rpy_deg=yaw_pitch_roll[:, ::-1],
        quality=np.ones(len(place)),
    )
