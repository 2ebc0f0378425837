"""The columns of a run's tables, from navigation and ledger to aiding and supervision, and of a point run's."""

from __future__ import annotations

from typing import Final

from insgnss.runs.columns.sheet import Sheet

_NAV = """
time_s: GPS seconds of the week stated in the flight file; beyond 604 800 after a week crossover
lat_deg lon_deg: position of the IMU, WGS-84
h_m: height of the IMU above the ellipsoid
vn_mps ve_mps vd_mps: velocity against the Earth: north, east, down
roll_deg pitch_deg yaw_deg: attitude of the body (forward, right, down) against north, east, down; yaw
  clockwise from north
sd_n_m sd_e_m sd_d_m: one sigma of position: north, east, down
sd_vn_mps sd_ve_mps sd_vd_mps: one sigma of velocity
sd_roll_deg sd_pitch_deg sd_yaw_deg: one sigma of attitude
accel_bias_x_mps2 accel_bias_y_mps2 accel_bias_z_mps2: estimated accelerometer bias along forward, right, down
gyro_bias_x_radps gyro_bias_y_radps gyro_bias_z_radps: estimated gyro bias along forward, right, down
sd_accel_bias_x_mps2 sd_accel_bias_y_mps2 sd_accel_bias_z_mps2: one sigma of the accelerometer bias
sd_gyro_bias_x_radps sd_gyro_bias_y_radps sd_gyro_bias_z_radps: one sigma of the gyro bias
clock_bias_m clock_drift_mps: receiver clock against GPS time, and its rate
sd_clock_bias_m sd_clock_drift_mps: one sigma of the receiver clock
n_used: pseudorange rows used in the latest epoch; a satellite counts once for each of its bands
n_hypotheses: headings still possible: 1 as soon as the heading is known
offset_*_m: clock offset of each further constellation, and of each further band of one, where estimated; that of
  QZSS begins as that of GPS's same band, with a sigma of `process.qzss_offset_sigma_m`
glonass_bias_m_per_channel: delay that grows with the GLONASS frequency channel, where estimated
zenith_delay_m: residual tropospheric delay at the zenith, where estimated
ionosphere_m: residual ionospheric delay at the zenith on L1, where estimated (carriers of one band)
lever_arm_x_m lever_arm_y_m lever_arm_z_m: estimated correction to the antenna's lever arm in the flight file,
  forward, right, down; with `process.lever_arm_sigma_m`
sd_lever_arm_x_m sd_lever_arm_y_m sd_lever_arm_z_m: one sigma of these
imu_time_offset_s: estimated correction to the IMU's tags, to be added to them
sd_imu_time_offset_s: one sigma of it
range_rate_lag_s: estimated time by which range rates lag behind the motion, to be added to `gnss.range_rate_lag_s`, or
  to the number of the last event `rates_late`
sd_range_rate_lag_s: one sigma of it
mounting_pitch_deg mounting_yaw_deg: pitch and yaw of the IMU against the vehicle, beyond those in the flight file; with
  the rows `non_holonomic` of `[vehicle]`
leeway_deg: lasting angle from heading to course, due to leeway, current or wind; with the rows `course` of `[vehicle]`
sd_mounting_pitch_deg sd_mounting_yaw_deg sd_leeway_deg: one sigma of these
sd_offset_*_m sd_glonass_bias_m_per_channel sd_zenith_delay_m sd_ionosphere_m: one sigma of these
gyro_scale_factor_*_ppm accel_scale_factor_*_ppm gyro_misalignment_*_mrad accel_misalignment_*_mrad
  gyro_g_sensitivity_*_deg_per_h_per_g: further errors of the sensors by their axis, and the axis of the rate or force
  that they go with; with `process.sensor_error_columns`
sd_gyro_scale_factor_*_ppm sd_accel_scale_factor_*_ppm sd_gyro_misalignment_*_mrad sd_accel_misalignment_*_mrad
  sd_gyro_g_sensitivity_*_deg_per_h_per_g: one sigma of these
*_scale_percent: scale factor of an odometer, or of a barometer's heights; this and the next five of a [[sensor]],
  whose name comes first, each with its one sigma under sd_
*_offset_m: height of a barometer's zero: its reading minus the height above the ellipsoid
*_iron_x_ut *_iron_y_ut *_iron_z_ut: magnetic field of the vehicle itself at a magnetometer, along forward, right, down
*_strength_ut: horizontal intensity of the Earth's field beyond `horizontal_ut`
*_declination_deg: declination beyond `declination_deg`
*_offset_deg: reading of a heading sensor minus the heading, beyond `offset_deg`
sd_slow_n_m sd_slow_e_m sd_slow_d_m: part of sd_n_m sd_e_m sd_d_m that slowly varying errors cause through the filter's
  gains (broadcast orbits and clocks, residual ionosphere and troposphere, multipath), with the sizes in `[slow_errors]`
  and those that the residuals show; absent with `process.range_bias_states`, which estimates these errors
hpl_m vpl_m: protection levels, horizontal and vertical: the risk in `[integrity]` is the probability that the error
  exceeds them without an alert; infinite where a solution without one of the satellites does not exist, and where two
  faults at once use up the risk; with `--integrity`
q_nb_w q_nb_x q_nb_y q_nb_z: attitude as a quaternion, body to north-east-down, scalar first and not negative;
  with `--quaternion`
cov_n_n_m2 cov_n_e_m2 cov_n_d_m2 cov_e_e_m2 cov_e_d_m2 cov_d_d_m2: covariance of position north, east, down; this
  and the next two with `--covariance`
cov_vn_vn_m2ps2 cov_vn_ve_m2ps2 cov_vn_vd_m2ps2 cov_ve_ve_m2ps2 cov_ve_vd_m2ps2 cov_vd_vd_m2ps2: covariance of
  velocity north, east, down
cov_turn_n_turn_n_deg2 cov_turn_n_turn_e_deg2 cov_turn_n_turn_d_deg2 cov_turn_e_turn_e_deg2
  cov_turn_e_turn_d_deg2 cov_turn_d_turn_d_deg2: covariance of the attitude error: the small rotations about north, east
  and down from the true attitude to the estimated one
point_lat_deg point_lon_deg point_h_m: position of the point of the body, WGS-84; this and the next three lines
  with `--point`
point_vn_mps point_ve_mps point_vd_mps: its velocity against the Earth: north, east, down
sd_point_n_m sd_point_e_m sd_point_d_m: one sigma of its position
sd_point_vn_mps sd_point_ve_mps sd_point_vd_mps: one sigma of its velocity
cov_point_n_n_m2 cov_point_n_e_m2 cov_point_n_d_m2 cov_point_e_e_m2 cov_point_e_d_m2 cov_point_d_d_m2: covariance of
  its position; this and the next with `--point` and `--covariance`
cov_point_vn_vn_m2ps2 cov_point_vn_ve_m2ps2 cov_point_vn_vd_m2ps2 cov_point_ve_ve_m2ps2 cov_point_ve_vd_m2ps2
  cov_point_vd_vd_m2ps2: covariance of its velocity
"""
_EXPORT = """
utc: UTC date of time_s in ISO 8601; in NetCDF the coordinate time, of `run.nav_with(utc=True)` the index
gps_week: GPS week that time_s counts from
h_msl_m: height of the IMU above mean sea level, by the geoid of EGM96
geoid_m: height of that geoid above the ellipsoid: h_m is the sum of both
heading_deg: yaw clockwise from true north, 0 to below 360
posix_s: seconds of UTC since 1970, in MAT files
"""
_MEASUREMENTS = """
time_s: receiver time tag, seconds of the GPS week
sv: satellite, as G05; empty for a further sensor or a user's own measurement
signal: RINEX code, as C1C; empty for a user's own measurement
kind: pseudorange, range_rate, carrier_difference or, with several antennas, attitude_difference; the name of a further
  sensor ([[sensor]]) or of a user's own measurement; of `[vehicle]` in the flight file non_holonomic, course,
  zero_velocity, zero_rate
antenna: with several antennas, the antenna of an attitude difference
innovation: measured minus predicted, at the prior; in m, for a range rate in m/s, for a user's own measurement in its
  unit; this and the next two columns are empty where nothing was predicted: before the filter starts, without satellite
  data, below a mask, while the filter is lost
sd_innovation: predicted sigma of the innovation, measurement noise included, in the same unit; the gate adds the slow
  errors that are not yet in the state
nis: square of innovation over sd_innovation: 1 on average if filter and noise agree
status: used, or why not: see the list at the end
"""
_SATELLITES = """
time_s: receiver time tag, seconds of the GPS week
sv: satellite
az_deg el_deg: direction from the local level: azimuth clockwise from north, elevation
body_az_deg body_el_deg: direction from the airframe: azimuth from forward to the right, elevation against
  the body's own horizon
gain_dbi: gain of the best antenna towards it, for circular polarisation; empty where no antenna is described
cn0_dbhz: C/N0 of the signal that was used, else of the satellite's first signal; empty where the log has none
state: tracked, or why not: see the list at the end; absent: no measurement in this epoch
sd_range_m sd_range_rate_mps: sigmas of the range and range rate predicted before the update: sqrt(h P h^T);
  empty where nothing was predicted
"""
EVENTS: Final = Sheet(
    "events",
    "event: a gap, a reset, a clock jump, the heading known",
    """
time_s: seconds of the GPS week; empty if the event concerns a whole file
kind: one word: imu_gap, heading_known, clock_jump, start_waits (for half a minute or more, and why), ...;
  installation_known (lever arm, IMU time, lag of the range rates or mounting, where
  its sigma has fallen to a fifth of the declared one); of further sensors sensor_refused (for ten
  seconds and more), sensor_agrees (again), sensor_stepped (its own error, a barometer's offset),
  sensor_frozen, sensor_beyond_sigma (an error of four times what the flight file declares),
  sensor_bad_values, sensor_no_overlap, sensor_readings_left_out, sensor_rows_without_reading (other
  logs share the file), ...; filter_doubted
  (without raw GNSS data: the fixes show three times the inertial noise of the grade), filter_agrees (again)
detail: the event in a sentence, with numbers
""",
)
ERRORS: Final = Sheet(
    "errors",
    "navigation row inside the reference",
    """
time_s: seconds of the GPS week
quality: quality number of the reference, 1 where it has none
d_n_m d_e_m d_d_m: estimate minus reference: position north, east, down
d_vn_mps d_ve_mps d_vd_mps: estimate minus reference: velocity
d_roll_deg d_pitch_deg d_yaw_deg: estimate minus reference: attitude, within a half circle
sd_n_m sd_e_m sd_d_m: the estimate's one sigma of position
sd_slow_n_m sd_slow_e_m sd_slow_d_m: part of this sigma that slowly varying errors cause, as in the navigation table
sd_vn_mps sd_ve_mps sd_vd_mps: the estimate's one sigma of velocity
sd_roll_deg sd_pitch_deg sd_yaw_deg: the estimate's one sigma of attitude
sd_reference_n_m sd_reference_e_m sd_reference_d_m: the reference's own one sigma, where it states any
sd_reference_vn_mps sd_reference_ve_mps sd_reference_vd_mps: its sigma of velocity
sd_reference_roll_deg sd_reference_pitch_deg sd_reference_yaw_deg: its sigma of attitude
""",
    "Only where the flight file names a reference; quantities that it lacks are empty. A point solution has no"
    " attitude and no sd_slow_*.",
)
_AIDING = """
time_s: time of use, seconds of the GPS week
sv: satellite
range_rate_mps: range rate of the antenna's phase centre, receiver clock drift included; positive when the
  distance grows
range_acceleration_mps2 range_jerk_mps3: its first and second derivative
doppler_hz doppler_rate_hz_per_s: at the carrier; RINEX sign, positive when the distance shrinks
pseudorange_m: predicted, the receiver clock included
code_delay_rate_s_per_s: rate of the code delay
sd_range_rate_mps sd_range_acceleration_mps2 sd_range_jerk_mps3: one sigma at the time of use
sd_doppler_hz sd_doppler_rate_hz_per_s: one sigma at the time of use
sd_pseudorange_m sd_code_delay_rate_s_per_s: one sigma at the time of use
age_s: time since the inertial sample it was predicted from
"""
_BUDGET = """
time_s: time at which the sigmas were computed, seconds of the GPS week
sv: satellite
sd_rate_velocity_mps: part of the range rate's sigma caused by the uncertainty of the velocity
sd_rate_attitude_mps: part caused by attitude and lever arm
sd_rate_accelerometer_mps: part caused by the accelerometer
sd_rate_gyro_mps: part caused by the gyro
sd_rate_clock_mps: part caused by the receiver clock
sd_rate_satellite_mps: part caused by the satellite's orbit and clock
sd_rate_motion_mps: part caused by the motion since the last inertial sample
cross_rate_m2ps2: contribution of the correlations between the parts to the variance; usually negative
sd_acceleration_velocity_mps2 sd_acceleration_attitude_mps2 sd_acceleration_accelerometer_mps2: the same
  parts of the acceleration's sigma
sd_acceleration_gyro_mps2 sd_acceleration_clock_mps2 sd_acceleration_satellite_mps2
  sd_acceleration_motion_mps2: the same parts of the acceleration's sigma
cross_acceleration_m2ps4: contribution of the correlations between the parts to the acceleration's variance
"""
_SUPERVISION = """
time_s: seconds of the GPS week
sv: satellite
state: what the receiver should do: track, hold, control_detection, resume, search, lost; absent without a
  prediction
decision: visible from the antennas past the airframe: visible, hidden, or either while uncertain
receiver: whether the receiver's log has a pseudorange: present, missing, not_known
el_deg: elevation above the local level
gain_dbi sd_gain_db: gain of the best antenna, for circular polarisation, and its sigma due to the attitude
cn0_dbhz: expected C/N0
pseudorange_m doppler_hz: what the receiver would measure, its clock included
sd_range_m sd_range_rate_mps: sigmas of the predicted range and range rate: sqrt(D), D = h P h^T of the prior
within_aperture: whether three sigmas stay inside the discriminator's aperture
delay_half_width_chips doppler_half_width_hz: half widths of the search window
delay_cells doppler_bins: cells of the window in delay and Doppler
accumulation_s search_s: time of one accumulation and of the whole search; infinite where none suffices
"""
_TRANSITIONS = """
time_s: seconds of the GPS week
sv: satellite
from_state to_state: state of the channel before and after
reason: reason of the change: hidden, visible_again, signal_lost, detected, pulled_in, ...
pseudorange_m doppler_hz: predicted at the transition, the receiver clock included
sd_range_m sd_doppler_hz: sigmas of these predictions
accumulation_s: time of one accumulation; infinite where none suffices
delay_cells doppler_bins: cells of the search window in delay and Doppler
search_s: time of the whole search; infinite where none suffices
"""
_SEARCH = """
sv: satellite
predicted_s: time with a prediction
hold_s: time held while hidden
control_s search_s: time spent on detections at the predicted delay and Doppler, and on searches
in_vain_s: part of both that failed or was broken off
unsupervised_s unsupervised_in_vain_s: search time of a receiver without attitude, and the part of it during which
  there was no signal to find
n_events n_agree n_differ n_not_covered: events in the receiver's own log, and how they compare; only with
  such a log
receiver_search_s receiver_inhibited_s receiver_needless_s: search time in the receiver's own log, and the parts of it
  while the satellite was hidden, and while the signal was expected at the predicted delay and Doppler; only with such a
  log
"""
_RECEIVER = """
time_s: seconds of the GPS week
sv: satellite
event: lock, loss, search or detection
supervisor: the supervisor's state at that moment
verdict: agrees, not_covered, or how they differ
lag_s: delay of the receiver's event after the supervisor's change of state
"""
_FILTERED = """
time_s: seconds of the GPS week
lat_deg lon_deg h_m: position, as in the navigation table, estimated by the filter alone
vn_mps ve_mps vd_mps: velocity
roll_deg pitch_deg yaw_deg: attitude
sd_n_m sd_e_m sd_d_m sd_vn_mps sd_ve_mps sd_vd_mps sd_roll_deg sd_pitch_deg sd_yaw_deg: one sigma of each
"""
_IMU = """
time_s: seconds of the GPS week: the first sample of a stretch of the log
gyro_x_min_degps gyro_y_min_degps gyro_z_min_degps gyro_x_max_degps gyro_y_max_degps gyro_z_max_degps: smallest
  and largest rate in it, as logged, along forward, right, down
accel_x_min_mps2 accel_y_min_mps2 accel_z_min_mps2 accel_x_max_mps2 accel_y_max_mps2 accel_z_max_mps2: the same for
  the specific force
"""
_SPECTRUM = """
frequency_hz: frequency, up to half of the sampling rate
gyro_x_degps_per_sqrt_hz gyro_y_degps_per_sqrt_hz gyro_z_degps_per_sqrt_hz: amplitude spectral density of the
  rate, along forward, right, down
accel_x_mps2_per_sqrt_hz accel_y_mps2_per_sqrt_hz accel_z_mps2_per_sqrt_hz: amplitude
  spectral density of the specific force
"""
_INTEGRITY: Final = """
fault: what the sub-filter excludes: a satellite, a constellation (its letter) or two constellations ("E+G")
probability: probability of the fault, from `[integrity]`; for a constellation, faults of two of its satellites included
time_s: time at which the separation was largest relative to its limit, seconds of the GPS week
axis: axis of this separation: n, e or d
separation_m: solution of the sub-filter minus the full solution, at that time and along that axis
limit_m: limit of the separation: without a fault it is exceeded with the probability of a false alert
alert_rows: navigation rows in which a separation was beyond its limit
rows_without: navigation rows for which the sub-filter has no solution
"""
RUN_SHEETS: Final = (
    Sheet("nav", "output time", _NAV),
    Sheet(
        "export",
        "output time",
        _EXPORT,
        "In addition to the columns of nav in the CSV, MAT and NetCDF files of `insgnss export`;"
        " `run.nav_with(utc=True, sea_level=True, heading=True)` has utc, heights and heading.",
    ),
    Sheet(
        "measurements",
        "satellite, signal, epoch and kind: every value of the log; row of a user's own measurement",
        _MEASUREMENTS,
    ),
    Sheet("satellites", "satellite and epoch", _SATELLITES),
    EVENTS,
    ERRORS,
    Sheet(
        "filtered",
        "navigation row of a smoothed run, as the filter had it",
        _FILTERED,
        "Only of a smoothed run.",
    ),
    Sheet("imu", "stretch of the inertial log, at most 1500", _IMU),
    Sheet(
        "imu_spectrum", "frequency", _SPECTRUM, "Empty where the log is too short or its steps are uneven."
    ),
    Sheet("aiding", "time and satellite above the horizon", _AIDING, "Only with `--aiding`."),
    Sheet("aiding_budget", "satellite, whenever its sigmas are recomputed", _BUDGET, "Only with `--aiding`."),
    Sheet("supervision", "satellite above the horizon and epoch", _SUPERVISION, "Only with `--supervise`."),
    Sheet("transitions", "change of a channel's state", _TRANSITIONS, "Only with `--supervise`."),
    Sheet("search_times", "satellite", _SEARCH, "Only with `--supervise`."),
    Sheet(
        "receiver_events",
        "event in the receiver's own log",
        _RECEIVER,
        "Only with `--supervise` and `receiver_events` in the flight file.",
    ),
    Sheet(
        "integrity",
        "satellite, and constellation where there are two",
        _INTEGRITY,
        "Only with `--integrity`.",
    ),
)


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
