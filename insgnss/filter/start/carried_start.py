"""A start after a gap in the inertial samples: the fix says where the vehicle is, the filter before the gap the rest.

A gap changes neither biases nor inter-system offsets nor noise levels. The heading that is left depends on how far the
vehicle can have turned: not at all when it stood on both sides; else as far as the rates at both ends of the gap allow,
and from the course if the vehicle has shown that its nose follows it (``sideslip``). Roll and pitch come from
the specific force, biases removed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from insgnss.config.filter import FilterConfig
from insgnss.constants import NS_PER_S, STANDARD_GRAVITY_MPS2
from insgnss.filter.headings.heading_bank import attitude
from insgnss.filter.headings.headings import yaw_variance
from insgnss.filter.headings.sideslip import LEAST_SPEED_MPS, sideslip
from insgnss.filter.imu.inertial_stream import Cut
from insgnss.filter.imu.sensor_outage import MOTION_TIME_S
from insgnss.filter.layout import Layout
from insgnss.filter.parameters import Parameters
from insgnss.filter.prediction import ImuSamples, bias_decays, carry_bank, new_scratch, predict_covariance
from insgnss.filter.sensor_errors import whole_error_rows, whole_errors_of
from insgnss.filter.setup import FilterSetup
from insgnss.filter.start.fix import Fix
from insgnss.filter.start.mean_acceleration import levelling_motion
from insgnss.filter.start.start import (
    LEVEL_FLOOR_RAD,
    TILT_OF_FORCE,
    StartAttitude,
    StartHeading,
    attitudes_at_start,
    headings_around,
    kinematics_from_fix,
    open_bank,
    open_headings,
)
from insgnss.filter.state import BA, BG, OFFSETS, PSI, Bank, HeadRecord, StateRecord, copy_bank
from insgnss.filter.states.gnss_time import forget_gnss_time, gnss_time_of
from insgnss.geodesy.local_level import level_axes
from insgnss.inertial.alignment import AlignmentWindow, inertial_window
from insgnss.tables import Event, Float64

_STILL_MPS: Final = 0.5  # GNSS speed of a vehicle that stands
_STILL_M: Final = 5.0  # by which two fixes of a standing vehicle may differ beyond three sigma
_STILL_TILT_RAD: Final = math.radians(1.0)  # passengers and the wind tilt a parked vehicle by less
_PARKED_YAW_RAD: Final = math.radians(0.3)  # what a parked vehicle may turn
_VIOLENT_RADPS: Final = math.radians(45.0)  # twice the rate of a car in a street corner
_LEAST_LOAD, _MOST_LOAD = 0.5, 2.0  # of the mean specific force in g: level turns of 60 deg of bank
_LONGEST_WAY_S: Final = 5.0  # from the first sample to the start, over which the gyros are followed
_SEEN_S: Final = 10.0  # of motion in which the angle between nose and course has been watched
_LEAST_SLIP_WALK: Final = math.radians(0.5) ** 2  # [rad^2/s]
_ALONE_S: Final = 10.0  # after a longer gap the course is not believed alone
_ALONE_RAD: Final = math.radians(10.0)  # nor if it gives less than that
_COURSE_WEIGHT: Final = 0.9  # of the course then, against all other headings
_AGREE2: Final = 9.0  # squared sigmas within which course and rates agree
_OFFSET_SIGMAS: Final = 5.0  # by which a fix contradicts an offset that was carried


@dataclass(frozen=True)
class CarriedState:
    """A filter's state when its samples ended."""

    bank: Bank  # carried to the last sample
    w_b: Float64  # (3,) rate in the last sample, errors removed [rad/s]
    f_b: Float64  # (3,) mean specific force before the end, errors removed [m/s^2]
    parked: bool
    cut: Cut  # what came then
    errors: tuple[Float64, Float64]  # of accelerometers and gyros then, (3,) each

    @property
    def state(self) -> Any:
        """The leader's state at the last sample."""
        return self.bank.state[int(self.bank.head[0].leader)]

    @property
    def P(self) -> Float64:
        """Its covariance."""
        covariance: Float64 = self.bank.P[int(self.bank.head[0].leader)]
        return covariance


def left_behind(
    bank: Bank, imu: ImuSamples, setup: FilterSetup, parameters: npt.NDArray[Any]
) -> CarriedState:
    """Return the carried start at the end of a filter's samples ``imu``."""
    last, config = copy_bank(bank), setup.config
    scratch = new_scratch(last.P.shape[1])
    carry_bank(last, int(imu.t_ns[-1]), imu, parameters[0], scratch)
    for state, P in zip(last.state, last.P, strict=True):
        predict_covariance(state, P, parameters[0], scratch)
    m = last.state[int(last.head[0].leader)]
    last_ns = int(imu.t_ns[-1])
    window = inertial_window(*imu[:3], last_ns - int(config.start.window_s * NS_PER_S), last_ns)
    f_b = imu.f_b[-1] if window is None else window.f_b
    accel, gyro = whole_errors_of(m, setup.layout)
    parked = window is not None and np.linalg.norm(m.v_e) < _STILL_MPS and _steady(window, gyro, config)
    open_end = Cut(last_ns, last_ns, 0.0)
    return CarriedState(last, imu.w_ib_b[-1] - gyro, f_b - accel, bool(parked), open_end, (accel, gyro))


def kept_over(carried: CarriedState | None, cut: Cut) -> CarriedState | None:
    """Return the state kept over a cut; two cuts without a start between them become one."""
    if carried is None:
        return None
    first = carried.cut.next_ns == carried.cut.last_ns
    return replace(carried, cut=cut if first else Cut(carried.cut.last_ns, cut.next_ns, math.inf))


def is_violent(window: AlignmentWindow) -> bool:
    """Return whether a vehicle rolls or loops too fast to be levelled by the mean of its velocity's change."""
    g = float(np.linalg.norm(window.f_b)) / STANDARD_GRAVITY_MPS2
    return float(np.linalg.norm(window.w_ib_b)) > _VIOLENT_RADPS or not _LEAST_LOAD < g < _MOST_LOAD


def _steady(window: AlignmentWindow, error: Float64, config: FilterConfig) -> bool:
    """Return whether a window of samples is that of a vehicle which stands."""
    start = config.start
    rate = math.degrees(float(np.abs(window.w_ib_b - error).max()))
    spread = math.degrees(window.spread_w)
    return max(rate, spread) < start.rest_rate_degps and window.spread_f < start.rest_accel_mps2


def open_carried(
    carried: CarriedState,
    setup: FilterSetup,
    imu: ImuSamples,
    fix: Fix,
    window: AlignmentWindow,
    motion: tuple[Float64, Float64],
    earlier: Fix | None,
    par: Parameters,
) -> tuple[Bank, list[Event]] | None:
    """Return the bank that goes on after a gap, and its event.

    None where several headings were open and the vehicle did not stay where it was: their biases differ.

    Parameters
    ----------
    window, motion : samples up to the fix; velocity of the antenna and its covariance
    earlier : a fix with a velocity, at least a window older; None: the acceleration is not known
    """
    v_a, P_v = motion
    config, several = setup.config, len(carried.bank.state) > 1
    parked = carried.parked and _still_there(carried, window, fix, v_a, config)
    if several and not parked:
        return None
    a_e, sd_a = None, 0.0
    if not parked:
        window, mean = levelling_motion(imu, fix, earlier, v_a, P_v, window)
        a_e, sd_a, P_v = mean.a_e, mean.sigma, P_v * mean.excess**2
    C_ne = level_axes(fix.r_a)
    attitudes: list[StartAttitude] = []
    members: list[int] = []
    for i, m in enumerate(carried.bank.state):
        accel, gyro = whole_errors_of(m, setup.layout)
        own = window.without(accel, gyro)
        headings = _parked_heading(carried.bank, i)
        if not parked:
            headings = _headings(carried, imu, fix, C_ne @ v_a, float(np.trace(P_v)) / 3.0, config)
        headings = headings or open_headings(fix.r_a, v_a, P_v, config)
        starts = attitudes_at_start(own, fix.r_a, v_a, a_e, sd_a, config, setup.grade, headings)
        attitudes += [_without_errors(one, gyro, parked) for one in starts]
        members += [i] * len(starts)
    w = imu.w_ib_b[int(np.searchsorted(imu.t_ns, fix.t_ns, side="right")) - 1]
    kin = kinematics_from_fix(fix, v_a, P_v, config)
    bank = open_bank(kin, attitudes, w, par, config, setup.grade, imu.t_ns, setup.layout)
    bank.head["from_fix"] = 1
    for state, P, i in zip(bank.state, bank.P, members, strict=True):
        _carry_sensor_errors(carried, i, state, P, par, fix, setup.layout)
        _carry_values(carried, i, state, P, par, fix, setup.layout)
    for name in ("slip", "slip_variance", "slip_ns", "slip_walk", "slip_s"):
        bank.head[name] = carried.bank.head[name]
    return bank, [Event(fix.t_ns, "start", _in_words(carried, fix, attitudes, parked))]


def _parked_heading(bank: Bank, i: int) -> list[StartHeading] | None:
    """Return the heading of a hypothesis as it was before the gap."""
    m: StateRecord = bank.state[i]
    sigma = math.sqrt(yaw_variance(m, bank.P[i]) + _PARKED_YAW_RAD**2)
    return [StartHeading(attitude(m)[2], sigma, math.exp(m.log_weight))]


def _in_words(carried: CarriedState, fix: Fix, attitudes: list[StartAttitude], parked: bool) -> str:
    away = (fix.t_ns - carried.cut.last_ns) / NS_PER_S
    how = "parked before and after" if parked else "position, velocity and clock from a fix"
    yaw = f"heading sigma {math.degrees(attitudes[0].sd_yaw):.0f} deg"
    if len(attitudes) > 1:
        yaw = f"{len(attitudes)} heading hypotheses"
    detail = (
        f"{away:.1f} s after the last sample before; {how}; {fix.n_used} pseudoranges; biases kept; {yaw}"
    )
    return f"carried over, {detail}"


def _without_errors(attitude: StartAttitude, gyro: Float64, parked: bool) -> StartAttitude:
    """Return an attitude that was levelled without the accelerometers' errors, those of the gyros as they were."""
    sd_level = LEVEL_FLOOR_RAD if parked else attitude.sd_level
    return replace(attitude, b_g=gyro, sd_b_g=None, sd_level=sd_level, level_from_bias=False)


def _still_there(
    carried: CarriedState, window: AlignmentWindow, fix: Fix, v_a: Float64, config: FilterConfig
) -> bool:
    """Return whether a parked vehicle still stands as it stood: place, velocity, rates and the direction of gravity."""
    m, P = carried.state, carried.P
    accel, gyro = carried.errors
    if np.linalg.norm(v_a) > _STILL_MPS or not _steady(window, gyro, config):
        return False
    away = float(np.linalg.norm(fix.r_a - m.r_e))
    sigma = math.sqrt(np.trace(P[:3, :3]) + np.trace(fix.P[:3, :3]))
    f_b = window.f_b - accel
    across = np.cross(carried.f_b, f_b) / (np.linalg.norm(carried.f_b) * np.linalg.norm(f_b))
    return bool(away < _STILL_M + 3.0 * sigma and np.linalg.norm(across) < _STILL_TILT_RAD)


def _headings(
    carried: CarriedState, imu: ImuSamples, fix: Fix, v_n: Float64, variance_v: float, config: FilterConfig
) -> list[StartHeading] | None:
    """Return the remaining knowledge of the heading; None: the whole circle is open."""
    by_rates = _by_rates(
        carried, imu, fix, attitude(carried.state)[2], yaw_variance(carried.state, carried.P)
    )
    by_course = _by_course(carried, fix, v_n, variance_v)
    n, unknown = config.heading.hypotheses, math.radians(config.heading.unknown_above_deg)
    gap_s = (fix.t_ns - carried.cut.last_ns) / NS_PER_S
    if by_course is not None:
        apart = math.remainder(by_course.yaw - by_rates.yaw, 2.0 * math.pi)
        agree = apart**2 < _AGREE2 * (by_course.sigma**2 + by_rates.sigma**2)
        if n == 1 or (agree and gap_s <= _ALONE_S + _LONGEST_WAY_S and by_course.sigma < _ALONE_RAD):
            share = by_course.sigma**2 / (by_course.sigma**2 + by_rates.sigma**2) if agree else 0.0
            return [
                StartHeading(by_course.yaw - share * apart, by_course.sigma * math.sqrt(1.0 - share), 1.0)
            ]
        others = headings_around(by_course.yaw, [(1.0 - _COURSE_WEIGHT) / n] * n)
        return [StartHeading(by_course.yaw, by_course.sigma, _COURSE_WEIGHT), *others]
    if by_rates.sigma < unknown or (n == 1 and by_rates.sigma < math.pi):
        return [by_rates]
    if by_rates.sigma < math.pi / 2.0:
        raw = [
            math.exp(-0.5 * (math.remainder(math.tau * i / n, math.tau) / by_rates.sigma) ** 2)
            for i in range(n)
        ]
        return headings_around(by_rates.yaw, [one / sum(raw) for one in raw])
    return None


def _by_rates(carried: CarriedState, imu: ImuSamples, fix: Fix, yaw: float, variance: float) -> StartHeading:
    """Return the heading at the fix by the rates at both ends of the gap and the samples after it."""
    cut, (_, gyro) = carried.cut, carried.errors
    if fix.t_ns - cut.next_ns > _LONGEST_WAY_S * NS_PER_S:
        return StartHeading(yaw, math.inf, 1.0)
    down = -carried.f_b / np.linalg.norm(carried.f_b)
    first, last = np.searchsorted(imu.t_ns, [cut.next_ns, fix.t_ns], side="right")
    rate = (imu.w_ib_b - gyro) @ down
    inside = min(0.5 * (cut.next_ns - cut.last_ns) / NS_PER_S, MOTION_TIME_S)
    turned = inside * float(carried.w_b @ down + rate[max(int(first) - 1, 0)])
    turned += float(rate[first:last] @ np.diff(imu.t_ns[first - 1 : last])) / NS_PER_S
    return StartHeading(math.remainder(yaw + turned, 2.0 * math.pi), math.sqrt(variance + cut.rotation), 1.0)


def _by_course(carried: CarriedState, fix: Fix, v_n: Float64, variance_v: float) -> StartHeading | None:
    """Return the heading at the fix by the course, None where the vehicle has not shown that it keeps to it."""
    head: HeadRecord = carried.bank.head[0]
    speed = math.hypot(v_n[0], v_n[1])
    if head.slip_s < _SEEN_S or speed < LEAST_SPEED_MPS:
        return None
    angle, variance, t_ns = head.slip, head.slip_variance, int(head.slip_ns)
    now, variance_now = sideslip(carried.state, carried.P)
    if math.isfinite(variance_now):
        angle, variance, t_ns = now, variance_now, carried.cut.last_ns
    walk = max(float(head.slip_walk), _LEAST_SLIP_WALK) * (fix.t_ns - t_ns) / NS_PER_S
    sigma = math.sqrt(walk + variance + variance_v / speed**2)
    if sigma > math.pi / 4.0:
        return None
    return StartHeading(math.remainder(math.atan2(v_n[1], v_n[0]) + angle, 2.0 * math.pi), sigma, 1.0)


def errors_in_a_gap(
    m: StateRecord, par: Parameters, seconds: float, layout: Layout
) -> tuple[list[int], Float64, Float64]:
    """Return the sensors' errors (k,) by index, the share of each that remains and the variance added over a gap."""
    errors = [*range(BA, BG + 3), *layout.sensor_states]
    keep, grown = np.ones(len(errors)), np.zeros(len(errors))
    keep[:6] = np.repeat(bias_decays(m, par, seconds), 3)
    grown[:6] = np.repeat([par.accel_bias_density, par.gyro_bias_density], 3) * seconds
    return errors, keep, grown


def _carry_sensor_errors(
    carried: CarriedState, i: int, m: StateRecord, P: Float64, par: Parameters, fix: Fix, layout: Layout
) -> None:
    """Give a hypothesis the earlier sensor errors, and the tilt its share of their uncertainty.

    Equation: psi = ``TILT_OF_FORCE`` e, as in ``start``: the levelled tilt is off by what the accelerometers are
    """
    old, seconds = carried.bank.state[i], (fix.t_ns - carried.cut.last_ns) / NS_PER_S
    errors, keep, grown = errors_in_a_gap(old, par, seconds, layout)
    m.failed[:] = old.failed
    cov = carried.bank.P[i][np.ix_(errors, errors)] * np.outer(keep, keep) + np.diag(grown)
    m.b_a[:], m.b_g[:] = keep[:3] * old.b_a, keep[3:6] * old.b_g
    for at in layout.sensor_states:
        m.optional[at - OFFSETS] = old.optional[at - OFFSETS]
    C_ne, attitude = level_axes(fix.r_a), slice(PSI, PSI + 3)
    tilt = C_ne.T @ TILT_OF_FORCE @ C_ne @ m.C_eb @ whole_error_rows(m, layout, "accelerometer", len(P))
    P[errors, :] = 0.0
    P[:, errors] = 0.0
    P[np.ix_(errors, errors)] = cov
    P[attitude, errors] = tilt[:, errors] @ cov
    P[errors, attitude] = P[attitude, errors].T
    P[attitude, attitude] += P[attitude, errors] @ tilt[:, errors].T


def _carry_values(
    carried: CarriedState, i: int, m: StateRecord, P: Float64, par: Parameters, fix: Fix, layout: Layout
) -> None:
    """Give a hypothesis the clock offsets of before, unless the fix contradicts them, and the noise levels."""
    old, seconds = carried.bank.state[i], (fix.t_ns - carried.cut.last_ns) / NS_PER_S
    for value in range(layout.n_values):
        at = OFFSETS + value
        if at in layout.sensor_states:
            continue
        variance = carried.bank.P[i][at, at] + par.optional_density[value] * seconds
        apart2 = (m.optional[value] - old.optional[value]) ** 2
        agrees = value >= layout.n_offsets or apart2 < _OFFSET_SIGMAS**2 * (P[at, at] + variance)
        if agrees and P[at, at] > variance:
            P[at, :] = P[:, at] = 0.0  # a tie that the carried value replaces
            m.optional[value], P[at, at] = old.optional[value], variance
    forget_gnss_time(m, P, layout, gnss_time_of(old, layout))
    m.noise_factor[:], m.level_epochs[:] = old.noise_factor, old.level_epochs
    m.adapted_count, m.adapted_ns = old.adapted_count, old.adapted_ns
    m.weak_shown, m.weak_rows = old.weak_shown, old.weak_rows
    m.cn0_level, m.cn0_level_ns = old.cn0_level, old.cn0_level_ns
