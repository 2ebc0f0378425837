"""The check of an inertial log before any filter runs: its rate, its gaps, gravity at rest, tilt, and the axes."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from insgnss.config.imu import ImuGrade
from insgnss.constants import NS_PER_S, SIGMA_PER_MEDIAN, STANDARD_GRAVITY_MPS2, WGS84_OMEGA_RADPS
from insgnss.gpstime import ns_to_week_seconds
from insgnss.inertial.alignment import LARGEST_BIAS_RADPS
from insgnss.log.checks.imu_rate import rate_change_findings
from insgnss.log.checks.report import VERTICAL_AXIS, Finding
from insgnss.log.imu.time import IMU_GAP_STEPS
from insgnss.log.imu.units import alike_accel_unit
from insgnss.log.imu.windows import ImuWindows, imu_windows
from insgnss.tables import Bool, Float64, ImuTable, Int64

REST_DIRECTION_RAD: Final = np.deg2rad(0.5)  # f turns less than this from second to second at rest ...
REST_RATE_CHANGE_RADPS: Final = np.deg2rad(0.5)  # ... and the mean rate changes less than this
REST_NEAR_G: Final = 0.1
MIN_REST_WINDOWS: Final = 3
# as [start] of the filter has it: range rates of a receiver at rest scatter by less
REST_SPEED_MPS: Final = 0.5
REST_SIGMAS: Final = 3.0
SPEED_NEAR_S: Final = 5.0  # between two epochs, for a speed between them
SLOW_HZ: Final = 20.0  # below: coning and vibration pass between the samples
# Gravity varies by 0.5 % over the Earth; the rest is accelerometer bias and scale
GRAVITY_TOLERANCE: Final = 0.01
NOISY: Final = 3.0  # noise over that of the grade
BIASED: Final = 5.0  # biases of the grade beyond which a gyro that does not turn reads too much
EARTH_RATE_DEGPS: Final = np.rad2deg(WGS84_OMEGA_RADPS)
STRAIGHT_DEGPS: Final = 0.5  # a course that turns more slowly is straight ...
STRAIGHT_S: Final = 5.0  # ... over such a time ...
STRAIGHT_MPS: Final = 5.0  # ... and at such a speed
MIN_STRAIGHT_WINDOWS: Final = 10
SETTLED: Final = 3.0  # biases of the grade by which a gyro's bias may still change
SETTLED_SIGMAS: Final = 6.0
MIN_SETTLING_WINDOWS: Final = 20
LONGEST_DISTURBANCE_S: Final = 5.0
MIN_NOISE_PAIRS: Final = 10  # of neighbouring windows: their median is known to a fifth
LEVEL_TILT_DEG: Final = 20.0  # vehicles park flatter than this


class GroundVelocity(NamedTuple):
    """The vehicle's velocity by the satellites: inertial sensors cannot distinguish rest from steady motion."""

    t_ns: Int64  # (m,) GPS time, rising
    v_e: Float64  # (m, 3) ECEF [m/s]
    sd_mps: Float64  # (m,) of one component

    def at(self, t_ns: Int64, values: Float64) -> Float64:
        """Return values (m,) of the epochs at other times, interpolated."""
        wanted_s, known_s = ((each - self.t_ns[0]) / NS_PER_S for each in (t_ns, self.t_ns))
        return np.asarray(np.interp(wanted_s, known_s, values))


def imu_findings(
    imu: ImuTable,
    week: int,
    velocity: GroundVelocity | None = None,
    grade: ImuGrade | None = None,
    *,
    accel_unit: str = "m/s^2",
) -> list[Finding]:
    """Return the findings on an inertial log: rate and jitter, gravity and noise at rest, tilt, suspicion of axes.

    Parameters
    ----------
    velocity : by the GNSS log; without it, and where it has no common time, a steady motion looks like rest
    grade : the declared one; the noise is compared with it where the speed shows rest
    accel_unit : the declared one
    """
    step_s = np.diff(imu.t_ns) / NS_PER_S
    median_s = float(np.median(step_s))
    mean_s = float(step_s[step_s < IMU_GAP_STEPS * median_s].mean())
    first, last = ns_to_week_seconds(imu.t_ns[[0, -1]], week)
    findings = [
        Finding(
            "ok",
            "imu",
            f"{len(imu.t_ns)} samples, {first:.3f} to {last:.3f} s of week {week} ({last - first:.1f} s),"
            f" {1.0 / mean_s:.4g} Hz, steps {1e3 * step_s.min():.4g} to {1e3 * step_s.max():.4g} ms",
        )
    ]
    if 1.0 / mean_s < SLOW_HZ:
        findings.append(Finding("warning", "imu", f"only {1.0 / mean_s:.3g} Hz: fast motion is lost"))
    findings += rate_change_findings(imu, week)
    windows = imu_windows(imu, median_s * NS_PER_S)
    if windows is None:
        findings.append(
            Finding("warning", "imu", "shorter than four seconds: too short to judge rest and axes")
        )
        return findings
    steady = _resting(windows)
    known, mps, sd_mps = _speed_at(windows, velocity)
    resting = steady & (mps - REST_SIGMAS * sd_mps < REST_SPEED_MPS) if known.any() else steady
    if resting.sum() >= MIN_REST_WINDOWS:
        where = "at rest" if known.any() else "at rest or in steady motion"
        by_grade = [] if grade is None or not known.any() else _at_rest_by_grade(windows, resting, grade)
        return findings + _rest_findings(windows, resting, where, accel_unit) + by_grade
    moving = steady & known
    if moving.sum() >= MIN_REST_WINDOWS:
        where = f"in steady motion at {np.median(mps[moving]):.3g} m/s"
        findings += _rest_findings(windows, moving, where, accel_unit)
        if grade is not None and velocity is not None:
            straight = moving & _straight(windows, velocity)
            if straight.sum() >= MIN_STRAIGHT_WINDOWS:
                findings += _bias_findings(windows, straight, "on a straight", grade, STRAIGHT_DEGPS)
        return findings
    text = "never at rest: units, axes and tilt cannot be judged by gravity"
    return [*findings, Finding("ok", "imu", text)]


def _speed_at(windows: ImuWindows, velocity: GroundVelocity | None) -> tuple[Bool, Float64, Float64]:
    """Return at which windows (m,) the speed is known, by epochs near enough on both sides, the speed and its sigma."""
    n = len(windows.t_ns)
    if velocity is None or len(velocity.t_ns) < 2:
        return np.zeros(n, np.bool_), np.full(n, np.nan), np.full(n, np.nan)
    epoch_ns = velocity.t_ns
    at = np.clip(np.searchsorted(epoch_ns, windows.t_ns), 1, len(epoch_ns) - 1)
    near = epoch_ns[at] - epoch_ns[at - 1] <= SPEED_NEAR_S * NS_PER_S
    known = near & (windows.t_ns >= epoch_ns[0]) & (windows.t_ns <= epoch_ns[-1])
    mps = velocity.at(windows.t_ns, np.linalg.norm(velocity.v_e, axis=1))
    return known, np.where(known, mps, np.nan), velocity.at(windows.t_ns, velocity.sd_mps)


def _resting(windows: ImuWindows) -> Bool:
    """Return (m,) which windows are at rest: f near g and steady in size and direction, rates steady."""
    turn, _ = windows.turns()
    size = np.linalg.norm(windows.f_b, axis=1) / STANDARD_GRAVITY_MPS2
    near = np.abs(size - 1.0) < REST_NEAR_G
    rate_change = np.linalg.norm(np.diff(windows.w_ib_b, axis=0), axis=1)
    still = (np.linalg.norm(turn, axis=1) < REST_DIRECTION_RAD) & (rate_change < REST_RATE_CHANGE_RADPS)
    pairs = windows.pairs & still & near[:-1] & near[1:] & windows.same_side()
    return np.concatenate((pairs, [False])) | np.concatenate(([False], pairs))


def _rest_findings(windows: ImuWindows, resting: Bool, where: str, accel_unit: str) -> list[Finding]:
    f_b = np.median(windows.f_b[resting], axis=0)
    w = np.rad2deg(np.median(windows.w_ib_b[resting], axis=0))
    size = float(np.median(np.linalg.norm(windows.f_b[resting], axis=1)))
    off = size / STANDARD_GRAVITY_MPS2 - 1.0
    seconds = resting.sum() * windows.length_s
    severity = "ok" if abs(off) <= GRAVITY_TOLERANCE else "warning"
    advice = (
        "" if severity == "ok" else "accelerometer bias or scale error: choose a grade that allows for it"
    )
    alike = None if severity == "ok" else alike_accel_unit(accel_unit, size)
    gravity = f"{where} for {seconds:.0f} s: |f| = {size:.4f} m/s^2 ({100.0 * off:+z.2f} % of g)"
    if alike is not None:
        gravity += f", as if the column were in {alike}"
        advice = f"if it is, write imu.accel_unit = '{alike}' in place of '{accel_unit}'; else {advice}"
    rates = f"{where} the gyros show {w[0]:+.4f} {w[1]:+.4f} {w[2]:+.4f} deg/s"
    findings = [
        Finding("warning" if severity == "warning" else "ok", "imu", gravity, advice),
        Finding("ok", "imu", rates),
    ]
    return [*findings, _tilt_finding(f_b, where)]


def _at_rest_by_grade(windows: ImuWindows, resting: Bool, grade: ImuGrade) -> list[Finding]:
    return [
        *_noise_findings(windows, resting, grade),
        *_settling_findings(windows, resting, grade),
        *_bias_findings(windows, resting, "at rest", grade, EARTH_RATE_DEGPS),
    ]


def _straight(windows: ImuWindows, velocity: GroundVelocity) -> Bool:
    """Return (m,) in which windows, all within the epochs, the course stays as it is until some seconds later."""
    later_ns = windows.t_ns + round(STRAIGHT_S * NS_PER_S)
    now, later = (
        np.column_stack([velocity.at(t_ns, v) for v in velocity.v_e.T]) for t_ns in (windows.t_ns, later_ns)
    )
    sizes = np.linalg.norm(now, axis=1), np.linalg.norm(later, axis=1)
    turns_by = np.deg2rad(STRAIGHT_DEGPS) * STRAIGHT_S * sizes[0] * sizes[1]
    straight = np.linalg.norm(np.cross(now, later), axis=1) < turns_by
    return np.asarray(straight & (np.minimum(*sizes) > STRAIGHT_MPS) & (later_ns <= velocity.t_ns[-1]))


def _bias_findings(
    windows: ImuWindows, still: Bool, where: str, grade: ImuGrade, turning_degps: float
) -> list[Finding]:
    """Return a warning if the gyros read far more than their grade's bias where the vehicle does not turn.

    ``turning_degps`` is the rate of a turn that is possible all the same.
    """
    rates = np.rad2deg(np.median(windows.w_ib_b[still], axis=0))
    bias = _gyro_bias_degps(grade)
    axis = int(np.argmax(np.abs(rates)))
    if not BIASED * bias + turning_degps < abs(rates[axis]) < np.rad2deg(LARGEST_BIAS_RADPS):
        return []  # a faster one is a roll along the straight
    text = f"{where} the {'xyz'[axis]} gyro reads {rates[axis]:+.2g} deg/s; its grade has a bias of {bias:.2g} deg/s"
    advice = (
        "a gyro whose calibration is not applied, or another sensor: subtract its bias, or declare"
        f" gyro_bias_deg_per_h = {3600.0 * abs(rates[axis]):.2g} in [imu.grade]"
    )
    return [Finding("warning", "imu", text, advice)]


def _gyro_bias_degps(grade: ImuGrade) -> float:
    return grade.gyro_bias_deg_per_h / 3600.0


def _settling_findings(windows: ImuWindows, resting: Bool, grade: ImuGrade) -> list[Finding]:
    """Return a warning if the gyros' rates at the log's first rest begin far from where they settle.

    The filter takes the bias that it finds at the start for the bias of the minutes after it.
    """
    at = np.flatnonzero(resting)
    pauses_s = np.diff(windows.t_ns[at]) / NS_PER_S - windows.length_s
    rest = at[: 1 + int(np.argmax(np.append(pauses_s > LONGEST_DISTURBANCE_S, True)))]
    if len(rest) < MIN_SETTLING_WINDOWS:
        return []
    rates = np.rad2deg(windows.w_ib_b[rest])
    later = rates[len(rates) // 2 :]
    off = np.abs(rates - np.median(later, axis=0))
    noise = SIGMA_PER_MEDIAN * np.median(off[len(rates) // 2 :], axis=0)
    limit = np.maximum(SETTLED * _gyro_bias_degps(grade), SETTLED_SIGMAS * noise)
    beyond = (off > limit).any(axis=1)
    if not beyond[0] or beyond[len(rates) // 2 :].any():
        return []
    settled = rest[int(np.flatnonzero(beyond)[-1]) + 1]
    seconds = (windows.t_ns[settled] - windows.t_ns[0]) / NS_PER_S
    axis = int(np.argmax(off[0]))
    text = (
        f"at rest the rate of the {'xyz'[axis]} gyro changes by {off[0, axis]:.2g} deg/s until {seconds:.0f} s after"
        f" the first sample; its grade has a bias of {_gyro_bias_degps(grade):.2g} deg/s"
    )
    advice = f"a sensor that warms up or calibrates itself: leave out the first {seconds:.0f} s of the inertial log"
    return [Finding("warning", "imu", text, advice)]


def _noise_findings(windows: ImuWindows, resting: Bool, grade: ImuGrade) -> list[Finding]:
    """Return a warning for each sensor with more noise at rest than its grade states.

    Means over a second are compared, by Allan's deviation at that time: vibration averages out and does not count.
    """
    both = windows.pairs & resting[:-1] & resting[1:]
    if both.sum() < MIN_NOISE_PAIRS:
        return []
    findings = []
    for sensor, means, unit, key in (
        ("gyros", np.rad2deg(windows.w_ib_b), "deg/sqrt(h)", "gyro_arw_deg_per_sqrt_h"),
        ("accelerometers", windows.f_b, "m/s/sqrt(h)", "accel_vrw_mps_per_sqrt_h"),
    ):
        steps = np.abs(np.diff(means, axis=0)[both])
        deviation = SIGMA_PER_MEDIAN * float(np.median(steps, axis=0).max()) / np.sqrt(2.0)
        noise = 60.0 * deviation * np.sqrt(windows.length_s)  # an hour is the square of 60 s
        stated = float(getattr(grade, key))
        if noise > NOISY * stated:
            text = f"at rest the {sensor} have a noise of {noise:.2g} {unit}, the grade {stated:.2g}"
            advice = f"a vibrating mount or another sensor: choose a grade that allows for it, or {key} in [imu.grade]"
            findings.append(Finding("warning", "imu", text, advice))
    return findings


def _tilt_finding(f_b: Float64, where: str) -> Finding:
    """Judge the axes by f at rest or in steady motion: in forward-right-down axes (0, 0, -g) when level."""
    roll = float(np.rad2deg(np.arctan2(-f_b[1], -f_b[2])))
    pitch = float(np.rad2deg(np.arctan2(f_b[0], np.hypot(f_b[1], f_b[2]))))
    axis = int(np.argmax(np.abs(f_b)))
    shown = f"f {where} ({f_b[0]:+.2f}, {f_b[1]:+.2f}, {f_b[2]:+.2f}) m/s^2"
    if axis == 2 and f_b[2] > 0.0:
        advice = (
            "turn the sensor's axes into forward-right-down with imu.axes, e.g. ['+x', '-y', '-z'] for z up"
        )
        text = f"{shown} points along +z: upside down, or the z axis points up"
        return Finding("warning", "imu", text, advice, kind=VERTICAL_AXIS)
    if axis != 2:
        side = "+" if f_b[axis] > 0.0 else "-"
        text = f"{shown}: the {side}{'xyz'[axis]} axis points up (roll {roll:.1f}, pitch {pitch:.1f} deg)"
        advice = "correct for a vehicle on its tail or side; otherwise exchange imu.axes"
        return Finding("warning", "imu", text, advice, kind=VERTICAL_AXIS)
    text = f"{shown}: roll {roll:.2f}, pitch {pitch:.2f} deg"
    if max(abs(roll), abs(pitch)) > LEVEL_TILT_DEG:
        advice = "if the mounting is fixed, declare it as imu.mounting_matrix"
        return Finding("warning", "imu", f"{text}: tilted {where}", advice, kind=VERTICAL_AXIS)
    return Finding("ok", "imu", text, kind=VERTICAL_AXIS)
