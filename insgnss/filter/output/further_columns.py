"""The columns of ``nav`` that are written on request: quaternion, full covariances, a point of the body."""

from __future__ import annotations

from typing import Final

# the entries of a symmetric (3, 3) matrix that are columns
PAIRS: Final = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
_AXES: Final = "ned"

QUATERNION: Final = ("q_nb_w", "q_nb_x", "q_nb_y", "q_nb_z")


def _of_pairs(before: str, of: str, unit: str) -> tuple[str, ...]:
    return tuple(f"{before}_{of}{_AXES[i]}_{of}{_AXES[j]}_{unit}" for i, j in PAIRS)


COVARIANCES: Final = (
    *_of_pairs("cov", "", "m2"),
    *_of_pairs("cov", "v", "m2ps2"),
    *_of_pairs("cov", "turn_", "deg2"),
)
POINT: Final = (
    *("point_lat_deg", "point_lon_deg", "point_h_m", "point_vn_mps", "point_ve_mps", "point_vd_mps"),
    *(
        "sd_point_n_m",
        "sd_point_e_m",
        "sd_point_d_m",
        "sd_point_vn_mps",
        "sd_point_ve_mps",
        "sd_point_vd_mps",
    ),
)
POINT_COVARIANCES: Final = (*_of_pairs("cov_point", "", "m2"), *_of_pairs("cov_point", "v", "m2ps2"))
