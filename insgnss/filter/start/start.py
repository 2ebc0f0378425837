"""How a filter starts: from a given state, or by itself from one epoch's fix, levelling, and a bank of headings."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from insgnss.config.filter import FilterConfig
from insgnss.config.flight import GivenStart, ImuGrade
from insgnss.constants import STANDARD_GRAVITY_MPS2, WGS84_OMEGA_RADPS
from insgnss.filter.layout import SYSTEM_OFFSETS, Layout
from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.clock_offsets import place_clocks, tie_offsets
from insgnss.filter.sensor_errors import whole_error_rows
from insgnss.filter.start.fix import Fix, sigma_beyond_m
from insgnss.filter.start.rest import rate_in_doubt, reading_sigma
from insgnss.filter.state import BA, BG, DR, DRIFT, DV, OFFSETS, PSI, Bank, StateRecord, new_bank
from insgnss.filter.states.imu_time import to_imu_time
from insgnss.filter.states.lever_arm import lever_rows
from insgnss.geodesy.ellipsoid import ecef_to_geodetic, geodetic_to_ecef
from insgnss.geodesy.gravity import normal_gravity_ecef
from insgnss.geodesy.local_level import ecef_to_ned_matrix, level_axes
from insgnss.geodesy.rotations import cross_matrix, euler_to_matrix, matrix_to_quaternion
from insgnss.inertial.alignment import AlignmentWindow, earth_rate_in_body, level
from insgnss.inertial.sensor_model import SensorModel, sensor_model
from insgnss.tables import Float64

_COURSE_WEIGHT = 0.7  # prior probability that a moving vehicle points along its velocity
_COURSE_SPEED_MPS = 3.0  # from here on the velocity has a direction worth that weight
_COURSE_SIGMA = 4.0  # of the velocity: with less its direction is not known to the sigma of a hypothesis
_BEYOND_GRADE = 5.0  # sigmas at which a resting gyro contradicts its grade
LEVEL_FLOOR_RAD = math.radians(0.2)
_ANY_TILT_RAD = math.pi / 3.0  # sigma of a tilt of which nothing is known
_EARTH_TURN = WGS84_OMEGA_RADPS * np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])  # [w_ie x]
# of an error of the accelerometers in n, where they level: psi_N = e_E / g, psi_E = -e_N / g
TILT_OF_FORCE: Final = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]) / STANDARD_GRAVITY_MPS2
_GYRO_BIASES = (np.arange(BG, BG + 3), np.arange(BG, BG + 3))  # their variances in P
_DRIFT_SIGMA_UNKNOWN_MPS = 300.0  # of a clock without range rates: a 1 ppm oscillator


class StartHeading(NamedTuple):
    """One heading that a bank begins with."""

    yaw: float  # [rad]
    sigma: float  # [rad]
    weight: float


@dataclass(frozen=True)
class StartAttitude:
    """One hypothesis of the attitude at the start, and the gyro bias with its covariance."""

    roll: float
    pitch: float
    yaw: float
    sd_level: float
    sd_yaw: float
    weight: float
    b_g: Float64  # (3,) [rad/s], with what further errors add in this attitude
    sd_b_g: float | None  # of the gyros' whole error (``sensor_errors``); None: as it is of such sensors
    level_from_bias: bool  # the tilt error is the accelerometer bias' doing ...
    sd_motion: float = 0.0  # ... but for so much that a motion at the start may have to do with it [rad]
    # (3, 3) covariance of what the gyros read at rest and may be a turn [rad^2/s^2]
    b_in_doubt: Float64 = field(default_factory=lambda: np.zeros((3, 3)))


@dataclass(frozen=True)
class Kinematics:
    """Position and motion of the antenna at the start, with covariances."""

    t_ns: int
    r_a: Float64
    v_a: Float64
    P_r: Float64  # (3, 3)
    P_v: Float64  # (3, 3)
    clocks: Float64  # (g,) NaN where not known
    drift: float
    sd_clock: float  # of the first that is known
    sd_drift: float
    of_imu: bool = False  # the sigmas are the IMU's own: no lever arm is involved


def kinematics_from_fix(fix: Fix, v_a: Float64, P_v: Float64, config: FilterConfig) -> Kinematics:
    """Return the start values of a fix and a velocity."""
    beyond = sigma_beyond_m(config.process.range_bias_states)
    first = int(np.flatnonzero(np.isfinite(fix.clocks))[0])
    with_drift = math.isfinite(fix.drift)
    return Kinematics(
        t_ns=fix.t_ns,
        r_a=fix.r_a,
        v_a=v_a,
        P_r=fix.P[:3, :3] + beyond**2 * np.eye(3),
        P_v=P_v,
        clocks=fix.clocks,
        drift=fix.drift if with_drift else 0.0,
        sd_clock=math.hypot(math.sqrt(fix.clock_variance(first)), beyond),
        sd_drift=math.sqrt(fix.drift_variance) if with_drift else _DRIFT_SIGMA_UNKNOWN_MPS,
    )


def attitudes_at_start(
    window: AlignmentWindow,
    r_e: Float64,
    v_e: Float64,
    a_e: Float64 | None,
    sd_a: float,
    config: FilterConfig,
    grade: ImuGrade,
    headings: list[StartHeading],
) -> list[StartAttitude]:
    """Return the attitude hypotheses of an automatic start.

    Parameters
    ----------
    window : inertial samples up to the start
    r_e, v_e : position and velocity, ECEF
    a_e : mean acceleration over the window, ECEF [m/s^2]; None at rest
    sd_a : its sigma [m/s^2], at rest that of the end of a brake
    headings : those to level for
    """
    sensor = sensor_model(grade)
    lat, _, _ = ecef_to_geodetic(r_e)
    f_e = np.zeros(3)
    normal_gravity_ecef(r_e, f_e)
    f_e = -f_e
    if a_e is not None:
        f_e += a_e + 2.0 * WGS84_OMEGA_RADPS * np.array([-v_e[1], v_e[0], 0.0])
    f_n = level_axes(r_e) @ f_e
    sd_motion = sd_a / STANDARD_GRAVITY_MPS2
    if a_e is not None:
        sd_motion = math.hypot(math.radians(config.start.sd_level_moving_deg), sd_motion)
    turn, in_doubt = rate_in_doubt(window, grade) if a_e is None else (np.zeros(3), np.zeros((3, 3)))
    sd_level = math.hypot(sensor.accel_bias.sigma / STANDARD_GRAVITY_MPS2, LEVEL_FLOOR_RAD, sd_motion)
    if a_e is not None:  # near free fall a force of any direction is within the error
        felt = float(np.linalg.norm(window.f_b)) / STANDARD_GRAVITY_MPS2
        sd_level = min(sd_level / max(min(felt, 1.0), 1e-6), max(sd_level, _ANY_TILT_RAD))
    attitudes = []
    for yaw, sd_yaw, weight in headings:
        roll, pitch = level(window.still_f_b if a_e is None else window.f_b, f_n, yaw)
        not_bias = earth_rate_in_body(lat, roll, pitch, yaw) + turn
        b_g, sd_b_g = _gyro_bias(window, a_e is None, not_bias, sensor)
        attitudes.append(
            StartAttitude(
                *(roll, pitch, yaw, sd_level, sd_yaw, weight),
                *(b_g, sd_b_g, a_e is None, sd_motion, in_doubt),
            )
        )
    return attitudes


def open_headings(r_e: Float64, v_e: Float64, P_v: Float64, config: FilterConfig) -> list[StartHeading]:
    """Return the headings of a bank over the whole circle, the first along the velocity when there is one.

    Parameters
    ----------
    r_e, v_e, P_v : (3,) position, (3,) velocity and its (3, 3) covariance, ECEF
    """
    v_n = level_axes(r_e) @ v_e
    n = config.heading.hypotheses
    doubt = _COURSE_SIGMA * math.sqrt(float(np.linalg.eigvalsh(P_v[:3, :3])[-1]))
    moving = math.hypot(v_n[0], v_n[1]) > max(_COURSE_SPEED_MPS, doubt)
    course = math.atan2(v_n[1], v_n[0]) if moving else 0.0
    if n == 1:
        return [StartHeading(course, math.pi / 3.0 if moving else math.pi / math.sqrt(3.0), 1.0)]
    first = _COURSE_WEIGHT if moving else 1.0 / n
    return headings_around(course, [first] + [(1.0 - first) / (n - 1)] * (n - 1))


def headings_around(yaw: float, weights: list[float]) -> list[StartHeading]:
    """Return a heading for each weight, evenly around the circle from ``yaw`` [rad] on.

    The sigma is half the spacing: neighbours meet at one sigma, so the circle is covered without gaps.
    """
    spacing = 2.0 * math.pi / len(weights)
    return [
        StartHeading(math.remainder(yaw + i * spacing, 2.0 * math.pi), 0.5 * spacing, weight)
        for i, weight in enumerate(weights)
    ]


def _gyro_bias(
    window: AlignmentWindow, at_rest: bool, turn_b: Float64, sensor: SensorModel
) -> tuple[Float64, float | None]:
    """Return the gyro bias and its sigma: at rest the grade's prior combined with the gyros' readings, else none.

    ``turn_b`` (3,) [rad/s] is what the gyros read without it being their error.
    """
    prior = sensor.gyro_bias.sigma
    if not at_rest:
        return np.zeros(3), None
    # a sensor far worse than its grade: its readings at rest count rather than the grade
    prior = max(prior, float(np.abs(window.w_ib_b - turn_b).max()) / _BEYOND_GRADE)
    read = reading_sigma(window, sensor)
    share = prior**2 / (prior**2 + read**2)
    return share * (window.w_ib_b - turn_b), prior * math.sqrt(1.0 - share) if share < 1.0 else read


def open_bank(
    kin: Kinematics,
    attitudes: list[StartAttitude],
    w_ib_b: Float64,
    par: Parameters,
    config: FilterConfig,
    grade: ImuGrade,
    t_imu_ns: np.ndarray,
    layout: Layout,
) -> Bank:
    """Return the bank at the start: one filter for each attitude."""
    bank = new_bank(len(attitudes), layout.n_optional)
    bank.head["now_ns"] = kin.t_ns
    bank.head["next"] = np.searchsorted(t_imu_ns, kin.t_ns, side="right")
    bank.head["heading_open"] = 1
    bank.head["leader"] = int(np.argmax([a.weight for a in attitudes]))
    sensor, C_ne = sensor_model(grade, layout.names), level_axes(kin.r_a)
    for i, attitude in enumerate(attitudes):
        m, P = bank.state[i], bank.P[i]
        _place_state(m, kin, attitude, C_ne, w_ib_b, par)
        _place_variances(P, kin, C_ne @ m.C_eb, sensor)
        apart = np.full(len(kin.clocks), (2.0 * kin.sd_clock) ** 2)
        place_clocks(m, P, kin.clocks, kin.sd_clock**2, apart, config.process.inter_system_sigma_m)
        _place_further(P, layout)
        _share_out_gyro_errors(m, P, attitude, layout)
        _place_attitude_covariance(m, P, attitude, C_ne, layout)
        P[:] = 0.5 * (P + P.T)
        tie_offsets(m, P, layout.home, config.process.qzss_offset_sigma_m)
        if not kin.of_imu:
            _hang_on_antenna(m, P, par.lever_b, layout)
        to_imu_time(m, P, layout)
        P[:] = 0.5 * (P + P.T)
    return bank


def _place_state(
    m: StateRecord, kin: Kinematics, attitude: StartAttitude, C_ne: Float64, w_ib_b: Float64, par: Parameters
) -> None:
    """Write the state of one hypothesis: the IMU's position and velocity from the antenna's by the lever arm."""
    C_nb = np.zeros((3, 3))
    euler_to_matrix(attitude.roll, attitude.pitch, attitude.yaw, C_nb)
    C_eb = C_ne.T @ C_nb
    m.C_eb[:] = C_eb
    matrix_to_quaternion(C_eb, m.q_eb)
    l_e = C_eb @ par.lever_b
    m.r_e[:] = kin.r_a - l_e
    turning = C_eb @ np.cross(w_ib_b - attitude.b_g, par.lever_b)
    m.v_e[:] = kin.v_a - turning + WGS84_OMEGA_RADPS * np.array([-l_e[1], l_e[0], 0.0])
    m.b_g[:] = attitude.b_g
    g_e = np.zeros(3)
    normal_gravity_ecef(m.r_e, g_e)
    m.f_smooth[:] = m.f_near[:] = -g_e  # no motion before
    m.f_last[:], m.w_last[:] = C_eb.T @ -g_e, w_ib_b - attitude.b_g
    m.clock[1] = kin.drift
    m.log_weight = math.log(attitude.weight)


def _place_further(P: Float64, layout: Layout) -> None:
    """Write the variances of the further states, but of the clock offsets, of which the start knows more."""
    for block in layout.blocks:
        for i in range(block.size if block.name != SYSTEM_OFFSETS else 0):
            P[layout.at(block.name) + i, layout.at(block.name) + i] = block.variance


def _place_variances(P: Float64, kin: Kinematics, C_nb: Float64, sensor: SensorModel) -> None:
    """Write the variance of each state by itself, position and velocity being the antenna's; biases as of a sensor."""
    P[DR : DR + 3, DR : DR + 3] = kin.P_r
    P[DV : DV + 3, DV : DV + 3] = kin.P_v
    P[BA : BA + 3, BA : BA + 3] = np.diag(sensor.accel_bias_variances(C_nb[2]))
    P[BG : BG + 3, BG : BG + 3] = sensor.gyro_bias.sigma**2 * np.eye(3)
    P[DRIFT, DRIFT] = kin.sd_drift**2


def _share_out_gyro_errors(m: StateRecord, P: Float64, attitude: StartAttitude, layout: Layout) -> None:
    """Update every part of the gyros' error from their readings at rest, each by its variance.

    Equation: of e = J x with cov(e) = A = J P J^T, now known as e_0 with S: G = P J^T A^-1, x = G e_0 and
              P <- P - G (A - S) G^T, with which J x = e_0 and J P J^T = S

    What the grade cannot explain is the bias' alone: its variance is raised until A holds S and e_0.
    """
    if attitude.sd_b_g is None:
        return
    J = whole_error_rows(m, layout, "gyro", len(P))
    least = np.maximum(attitude.sd_b_g, np.abs(attitude.b_g) / _BEYOND_GRADE) ** 2
    P[_GYRO_BIASES] += np.maximum(least - (J @ P @ J.T).diagonal(), 0.0)
    A = J @ P @ J.T
    # no gain for an axis without any error, as of a perfect sensor
    gain = (np.linalg.pinv(A, hermitian=True) @ J @ P).T
    shares = gain @ attitude.b_g
    m.b_g[:] = shares[BG : BG + 3]
    for at in layout.sensor_states:
        m.optional[at - OFFSETS] = shares[at]
    P -= gain @ (A - attitude.sd_b_g**2 * np.eye(3)) @ gain.T
    P[BG : BG + 3, BG : BG + 3] += attitude.b_in_doubt


def _place_attitude_covariance(
    m: StateRecord, P: Float64, attitude: StartAttitude, C_ne: Float64, layout: Layout
) -> None:
    """Write the covariance of the attitude.

    When the accelerometers levelled it at rest, tilt and the accelerometers' error are one: with C f_b = (0, 0, -g),
    psi_N = e_E / g and psi_E = -e_N / g, e = estimated minus true error in n.
    """
    tilt = math.hypot(LEVEL_FLOOR_RAD, attitude.sd_motion) if attitude.level_from_bias else attitude.sd_level
    psi = slice(PSI, PSI + 3)
    if attitude.level_from_bias:
        from_error = (
            C_ne.T @ TILT_OF_FORCE @ C_ne @ m.C_eb @ whole_error_rows(m, layout, "accelerometer", len(P))
        )
        P[psi] = from_error @ P
        P[:, psi] = P[psi].T
        P[psi, psi] = P[psi] @ from_error.T
    P[psi, psi] += C_ne.T @ np.diag([tilt**2, tilt**2, attitude.sd_yaw**2]) @ C_ne


def _hang_on_antenna(m: StateRecord, P: Float64, lever_b: Float64, layout: Layout) -> None:
    """Turn the antenna's position and velocity errors in the covariance into the IMU's, which hangs on the lever arm.

    Equation: r = r_a - C l, v = v_a - C (w x l) + w_ie x C l, so with a = C (w x l), w = w_ib - e, e the gyros' error

        d r = d r_a + l_e x psi,   d v = d v_a + a x psi - w_ie x (l_e x psi) - C (l x d e)

    and with an error dl of the lever arm that is a state: - C dl, - C (w x dl) + w_ie x C dl.

    Parameters
    ----------
    m : the state; ``m.w_last`` is w_ib_b without the gyros' errors [rad/s]
    lever_b : (3,) IMU to antenna [m]
    """
    C = m.C_eb
    l_e = cross_matrix(C @ lever_b)
    T = np.eye(len(P))
    T[DV : DV + 3] -= C @ cross_matrix(lever_b) @ whole_error_rows(m, layout, "gyro", len(P))
    T[DR : DR + 3, PSI : PSI + 3] = l_e
    T[DV : DV + 3, PSI : PSI + 3] = cross_matrix(C @ np.cross(m.w_last, lever_b)) - _EARTH_TURN @ l_e
    J = lever_rows(layout, len(P))
    T[DR : DR + 3] -= C @ J
    T[DV : DV + 3] -= (C @ cross_matrix(m.w_last) - _EARTH_TURN @ C) @ J
    P[:] = T @ P @ T.T


def given_kinematics(
    start: GivenStart, t_ns: int, clocks: Float64, drift: float, w_ib_b: Float64, par: Parameters
) -> Kinematics:
    """Return the start values of a given state: the antenna's, as ``open_bank`` expects them.

    Parameters
    ----------
    clocks, drift : of the receiver as the first epoch shows them from there, (g,) [m], NaN where not known; [m/s]
    w_ib_b : (3,) the body's rate at the start [rad/s]
    """
    r_e, C_ne, C_nb = np.zeros(3), np.zeros((3, 3)), np.zeros((3, 3))
    lat, lon = math.radians(start.lat_deg), math.radians(start.lon_deg)
    geodetic_to_ecef(lat, lon, start.h_m, r_e)
    ecef_to_ned_matrix(lat, lon, C_ne)
    roll, pitch, yaw = (math.radians(a) for a in start.rpy_deg)
    euler_to_matrix(roll, pitch, yaw, C_nb)
    C_eb = C_ne.T @ C_nb
    l_e = C_eb @ par.lever_b
    turning = C_eb @ np.cross(w_ib_b, par.lever_b) - WGS84_OMEGA_RADPS * np.array([-l_e[1], l_e[0], 0.0])
    return Kinematics(
        t_ns=t_ns,
        r_a=r_e + l_e,
        v_a=C_ne.T @ np.array(start.v_ned_mps) + turning,
        P_r=start.sd_position_m**2 * np.eye(3),
        P_v=start.sd_velocity_mps**2 * np.eye(3),
        clocks=clocks,
        drift=drift,
        sd_clock=2.0 * start.sd_position_m + 30.0,
        sd_drift=2.0 * start.sd_velocity_mps + 3.0,
        of_imu=True,
    )


def given_attitudes(start: GivenStart, config: FilterConfig) -> list[StartAttitude]:
    """Return the attitude of a given state; a bank around it when its heading sigma is too wide for one filter."""
    roll, pitch, yaw = (math.radians(a) for a in start.rpy_deg)
    sd_level = math.radians(start.sd_roll_pitch_deg)
    sd_yaw = math.radians(start.sd_yaw_deg)
    n = config.heading.hypotheses
    if start.sd_yaw_deg <= config.heading.unknown_above_deg or n == 1:
        yaws, sd_yaw, weights = [yaw], min(sd_yaw, math.pi), [1.0]
    else:
        # headings around the given one, weighed by its sigma, over at most the whole circle
        spacing = 2.0 * math.pi / n
        away = [math.remainder(i * spacing, 2.0 * math.pi) for i in range(n)]
        yaws = [yaw + a for a in away]
        raw = [math.exp(-0.5 * (a / sd_yaw) ** 2) for a in away]
        weights = [w / sum(raw) for w in raw]
        sd_yaw = 0.5 * spacing
    return [
        StartAttitude(roll, pitch, y, sd_level, sd_yaw, w, np.zeros(3), None, False)
        for y, w in zip(yaws, weights, strict=True)
    ]
