"""Names of columns that several tables and programs share: position, velocity, attitude, their errors, events."""

from __future__ import annotations

from typing import Final

PLACE: Final = ("lat_deg", "lon_deg", "h_m")
VELOCITY: Final = ("vn_mps", "ve_mps", "vd_mps")
ATTITUDE: Final = ("roll_deg", "pitch_deg", "yaw_deg")
POSITION: Final = ("n_m", "e_m", "d_m")  # of an error (d_) or a sigma (sd_)
COMPONENTS: Final = (*POSITION, *VELOCITY, *ATTITUDE)  # each with d_ and sd_
EVENT: Final = ("time_s", "kind", "detail")
