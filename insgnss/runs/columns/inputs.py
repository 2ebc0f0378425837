"""The columns of the CSV logs that come in; any of their names can be mapped in the flight file."""

from __future__ import annotations

from typing import Final

from insgnss.runs.columns.sheet import Sheet

_IMU = """
time_s: time of the sample; `[imu.time]` states unit, origin and scale. `columns.date` names a column of dates
  beside one of times of day, `columns.week` one of GPS weeks
gyro_x gyro_y gyro_z: angular rate or angle increment along the sensor's axes, in the unit declared by
  `gyro_unit`
accel_x accel_y accel_z: specific force or velocity increment along the sensor's axes, in the unit declared
  by `accel_unit`; at rest it points up
"""
_GNSS = """
time_s: receiver time tag of the epoch; `[gnss.time]` states unit, origin and scale; dates and weeks as in
  `imu.csv`
sv: satellite: constellation's letter or name and number, as G05 or GPS 5. Bare numbers need the column
  that `columns.system` names (letters, names as GPS, or codes that `system_codes` explains), or `gnss.system`
signal: RINEX code, as C1C, or a name that `gnss.signal_codes` explains; where the column is missing each
  constellation's usual first signal is assumed, with an event
pseudorange_m: code pseudorange
doppler_hz: RINEX sign: positive when the distance shrinks
range_rate_mps: in place of the Doppler: positive when the distance grows
carrier_phase_cycles: RINEX sign; optional
lli: RINEX loss-of-lock indicator: bit 0 slip, bit 1 half cycle unresolved; optional
cn0_dbhz: carrier to noise density ratio; optional
sigma_pseudorange_m sigma_range_rate_mps: the receiver's own sigmas; optional
sat_x_m sat_y_m sat_z_m: satellite position at the time of transmission, ECEF; optional, replaces navigation
  files
sat_vx_mps sat_vy_mps sat_vz_mps: its velocity
sat_clock_m sat_clock_drift_mps: its clock against system time, and its rate
"""
_REFERENCE = """
time_s: seconds; `[reference.time]` states unit, origin and scale; dates and weeks as in `imu.csv`
lat_deg lon_deg h_m: position, WGS-84, height above the ellipsoid
vn ve vd: velocity north, east, down, m/s; optional
roll_deg pitch_deg yaw_deg: attitude; optional
quality: the reference's own mark; optional
sd_n_m sd_e_m sd_d_m sd_vn_mps sd_ve_mps sd_vd_mps sd_roll_deg sd_pitch_deg sd_yaw_deg: its one sigma of each; optional
"""
_RECEIVER_EVENTS = """
time_s: seconds, in the time of the GNSS log
sv: satellite
event: lock, loss, search or detection
"""
_SENSOR = """
time_s: seconds; `time` of the entry states unit, origin and scale; dates and weeks as in `imu.csv`
speed: odometer: speed of the wheel, m/s unless `unit` says otherwise; with `metres_per_count` a count of pulses
sd_speed: its one sigma, in the same unit; optional, as every sigma here
pressure_hpa: barometer: static pressure, or with `unit` m or ft the pressure altitude
sd_altitude_m: one sigma of the altitude
mag_x mag_y mag_z: magnetometer: field along the sensor's axes, uT unless `unit` says otherwise
heading_deg sd_heading_deg: heading: clockwise from north, and its one sigma
roll_deg pitch_deg yaw_deg: attitude of the device
sd_roll_deg sd_pitch_deg sd_yaw_deg: one sigma of each
lat_deg lon_deg h_m: position: WGS-84; x, y, z [m] with `frame` ecef
sd_n_m sd_e_m sd_d_m: one sigma north, east, down
vn_mps ve_mps vd_mps: velocity: north, east, down; with `axes` enu name the columns of east, north, up in this order
sd_vn_mps sd_ve_mps sd_vd_mps: one sigma of each
"""
INPUT_SHEETS: Final = (
    Sheet(
        "imu.csv",
        "sample",
        _IMU,
        "`[imu.columns]` maps other names; a number is a column of a file without a header, counted from 1.",
    ),
    Sheet(
        "gnss.csv",
        "satellite, signal and epoch",
        _GNSS,
        "`[gnss.columns]` maps other names. An empty cell is a missing value.",
    ),
    Sheet("reference.csv", "time", _REFERENCE, "`[reference.columns]` maps other names."),
    Sheet(
        "sensor.csv",
        "reading of a further sensor",
        _SENSOR,
        "The files of a `[[sensor]]`, each with the columns of its kind. `columns` maps other names; `none` stands for"
        " a column that the log lacks.",
    ),
    Sheet("receiver_events.csv", "event", _RECEIVER_EVENTS, "The file that `gnss.receiver_events` names."),
)
