"""The columns of a point solution's tables."""

from __future__ import annotations

from typing import Final

from insgnss.runs.columns.sheet import Sheet

_POINT = """
time_s: receiver time tag, seconds of the GPS week
x_m y_m z_m: position of the antenna, ECEF, WGS-84; empty where the epoch has no solution
lat_deg lon_deg h_m: the same as latitude, longitude and height above the ellipsoid
vn_mps ve_mps vd_mps: velocity north, east, down
sd_n_m sd_e_m sd_d_m: one sigma of position, from the measurements' sigmas; larger where their residuals scatter more
cov_ne_m2 cov_nd_m2 cov_ed_m2: covariances of position
sd_vn_mps sd_ve_mps sd_vd_mps: one sigma of velocity, computed in the same way
cov_vne_m2ps2 cov_vnd_m2ps2 cov_ved_m2ps2: covariances of velocity
clock_*_m sd_clock_*_m: receiver clock against each constellation's time, and its sigma; QZSS's differs from GPS's by
  zero with a sigma of `process.qzss_offset_sigma_m`
clock_drift_mps sd_clock_drift_mps: rate of the receiver clock, and its sigma
gdop pdop hdop vdop tdop: dilution of precision: all, position, horizontal, vertical, time
hpl_m vpl_m: protection levels, horizontal and vertical
n_used n_velocity_used: number of rows in the position solution, and in the velocity solution
n_redundant n_velocity_redundant: number of redundant rows in each
test_statistic velocity_test_statistic: weighted sum of the squared residuals
test_limit velocity_test_limit: above it a fault is detected
verdict velocity_verdict: ok, fault excluded (with its satellites), not identified, not tested, not enough
  satellites, bad geometry
"""
_RESIDUALS = """
time_s: receiver time tag, seconds of the GPS week
sv: satellite
signal: RINEX code
kind: pseudorange or range_rate
residual: measured minus predicted by the solution, also for rows that it does not use; m or m/s
sd: the measurement's sigma; m or m/s
normalised: residual over its own sigma; empty where no other row tests it
az_deg el_deg: direction from the local level
status: used, or why not: see the list at the end
"""
POINT_SHEETS: Final = (
    Sheet("point", "epoch", _POINT),
    Sheet("residuals", "value in the log", _RESIDUALS),
)
