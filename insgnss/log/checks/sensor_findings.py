"""Further sensors compared with GNSS: rate and gaps, unit, sign, mounting and time of each.

GNSS alone gives the antenna's position, velocity and, in motion, its course. Each sensor is compared with the one that
it measures: a factor, an offset or a rotation beyond the noise is reported with the key that corrects it. Lever arms
are neglected: metres and tenths of m/s.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, Final, NamedTuple, get_args

import numpy as np

from insgnss.config.sensors import Sensor, SpeedUnit
from insgnss.constants import NS_PER_S
from insgnss.errors import InsGnssError
from insgnss.geodesy.local_level import geodetic, ned_axes
from insgnss.geodesy.magnetic_dipole import EARTH_FIELD_UT, down_sign
from insgnss.geodesy.sea_level import geoid_height
from insgnss.gpstime import nearest
from insgnss.log.checks.magnetic_field import (
    fitting_axes,
    fitting_units,
    wrong_vertical,
)
from insgnss.log.checks.report import Finding, Severity, from_error, from_events
from insgnss.log.checks.track import GnssTrack, between_epochs
from insgnss.log.csv.columns import FileColumns
from insgnss.log.flight import Flight
from insgnss.log.imu.sensor_csv import read_sensor
from insgnss.log.imu.time import IMU_GAP_STEPS
from insgnss.tables import Bool, Float64, ImuTable, SensorTable
from insgnss.units import RAD_PER_DEG, SI_PER_UNIT

_NOTICES: Final = frozenset({"columns_not_read", "csv_delimiter", "sensor_rows_without_reading"})
_LEAST_POINTS: Final = 10
_MOVING_MPS: Final = 3.0
_FACTOR: Final = 1.1  # of an odometer: tyres differ by less
_SHIFTS_S: Final = np.arange(-30, 31) / 10.0
_SURE_SHIFT: Final = 0.5  # the residual's variance falls at least to this share
_LEAST_SHIFT_S: Final = 0.2
_CLIMB_M: Final = 30.0  # least change of height that shows a barometer's slope
_FITS: Final = 0.3  # of the angles against the course with what is declared
_TURN_DEG: Final = 20.0  # a heading further from the course than a vehicle crabs
_STRAIGHT_MPS2: Final = 1.0  # acceleration of a vehicle that banks by less than 6 deg
_STRAY_M: Final = 30.0
_STRAY_MPS: Final = 1.0


class _LocalTrack(NamedTuple):
    """The track, local level."""

    t_s: Float64  # (n,) after the track's origin
    v_n: Float64  # (n, 3)
    place: Float64  # (n, 3) latitude, longitude [rad], height [m]

    def ground_speed(self, t_s: Float64) -> Float64:
        """Return the horizontal speed at given times."""
        return np.asarray(np.interp(t_s, self.t_s, np.linalg.norm(self.v_n[:, :2], axis=1)))


class _SampledTrack(NamedTuple):
    """GNSS at the times of a sensor's readings."""

    t_s: Float64  # (m,) of the readings, after the track's origin
    values: Float64  # (m, k)
    v_n: Float64  # (m, 3)
    place: Float64  # (m, 3) latitude, longitude [rad], height [m]
    gnss: _LocalTrack

    @property
    def speed(self) -> Float64:
        return np.asarray(np.linalg.norm(self.v_n[:, :2], axis=1))


class SensorLogRead(NamedTuple):
    """A further sensor's log, read, and what reading has found."""

    config: Sensor
    table: SensorTable | None  # None: no log, or it cannot be read
    findings: list[Finding]


def read_sensor_logs(flight: Flight) -> list[SensorLogRead]:
    """Read the log of each further sensor; one that cannot be read is a finding."""
    shared = flight.config.columns_by_file()
    return [_read(config, flight.config.gps_week, shared) for config in flight.config.sensor]


def _read(config: Sensor, week: int, shared: FileColumns) -> SensorLogRead:
    if not config.files:
        no_log = Finding("ok", config.label, "has no log: its values come live")
        return SensorLogRead(config, None, [no_log])
    try:
        table, events = read_sensor(config, week, shared)
    except InsGnssError as error:
        return SensorLogRead(config, None, [from_error(config.label, error)])
    findings = from_events(config.label, events, _NOTICES)
    return SensorLogRead(config, table, [*findings, _rate(config, table)])


def sensor_findings(
    logs: Iterable[SensorLogRead], track: GnssTrack | None, imu: ImuTable | None
) -> list[Finding]:
    """Return the findings on each further sensor, with those of reading its log."""
    gnss = None
    if track is not None and len(track.t_s) >= _LEAST_POINTS:
        place = geodetic(track.r_e)
        gnss = _LocalTrack(track.t_s, np.einsum("kij,kj->ki", ned_axes(place), track.v_e), place)
    findings = []
    for config, table, of_reading in logs:
        findings += of_reading
        if table is None:
            continue
        if imu is not None and (table.t_ns[-1] < imu.t_ns[0] or table.t_ns[0] > imu.t_ns[-1]):
            text = "no time in common with the inertial log"
            findings.append(Finding("warning", config.label, text, "check its time.unit, origin, offset_s"))
        elif gnss is not None and track is not None:
            common = _common(table, gnss, track.origin_ns)
            if len(common.t_s) >= _LEAST_POINTS:
                findings += _CHECKS[config.kind](config, common)
    return findings


def _at(gnss: _LocalTrack, t_s: Float64, of: Float64) -> Float64:
    return np.column_stack([np.interp(t_s, gnss.t_s, of[:, k]) for k in range(3)])


def _common(table: SensorTable, gnss: _LocalTrack, origin_ns: int) -> _SampledTrack:
    """Return the readings within two seconds of a GNSS epoch and in no gap, and GNSS at their times."""
    t_s = (table.t_ns - origin_ns) / NS_PER_S
    away = np.abs(gnss.t_s[nearest(gnss.t_s, t_s)] - t_s)
    good = np.isfinite(table.values[:, :2]).all(axis=1) & (away < 2.0)
    good &= between_epochs(gnss.t_s, t_s)
    t_s = t_s[good]
    return _SampledTrack(t_s, table.values[good], _at(gnss, t_s, gnss.v_n), _at(gnss, t_s, gnss.place), gnss)


def _part(common: _SampledTrack, which: Bool) -> _SampledTrack:
    names = ("t_s", "values", "v_n", "place")
    return common._replace(**{name: getattr(common, name)[which] for name in names})


def _rate(config: Sensor, table: SensorTable) -> Finding:
    """Return how many readings there are, how often, and the longest gap."""
    text = f"{len(table.t_ns)} readings"
    if len(table.t_ns) < 3:
        return Finding("warning", config.label, text)
    step_s = np.diff(table.t_ns) / NS_PER_S
    usual, longest = float(np.median(step_s)), float(step_s.max())
    text += f" at {1.0 / usual:.3g} Hz, longest gap {longest:.3g} s"
    severity: Severity = "warning" if longest > max(IMU_GAP_STEPS * usual, 1.0) else "ok"
    return Finding(severity, config.label, text)


def _shift(common: _SampledTrack, measured: Float64, of: Callable[[Float64], Float64]) -> list[str]:
    """Return the time offset that fits far better than none, in words: the correction of the tags."""
    seen = np.all([between_epochs(common.gnss.t_s, common.t_s + shift) for shift in _SHIFTS_S], axis=0)
    if seen.sum() < _LEAST_POINTS:
        return []
    measured, t_s = measured[seen], common.t_s[seen]
    rms = [float(np.std(measured - of(t_s + shift))) for shift in _SHIFTS_S]
    best, none = int(np.argmin(rms)), rms[len(_SHIFTS_S) // 2]
    if abs(_SHIFTS_S[best]) < _LEAST_SHIFT_S or rms[best] ** 2 > _SURE_SHIFT * none**2:
        return []
    return [f"its time tags are off: add {_SHIFTS_S[best]:+.1f} s to time.offset_s"]


def _odometer(config: Any, common: _SampledTrack) -> list[Finding]:
    moving = common.speed > _MOVING_MPS
    if moving.sum() < _LEAST_POINTS:
        return [Finding("ok", config.label, "the vehicle does not move: not compared with GNSS")]
    z, speed = common.values[moving, 0], common.speed[moving]
    factor = float(np.median(z / speed))
    remarks = []
    if not 1.0 / _FACTOR < abs(factor) < _FACTOR:
        units = get_args(SpeedUnit) if config.metres_per_count is None else ()
        fits = [u for u in units if abs(abs(factor) * SI_PER_UNIT[u] / SI_PER_UNIT[config.unit] - 1.0) < 0.05]
        remarks.append(f"the unit fits {' or '.join(fits)}" if fits else "check its unit or metres_per_count")
    if factor < 0.0 or (np.abs(z).sum() > 2.0 * np.abs(z.sum())):
        remarks.append("its sign is opposite to the motion: is it mounted or counted backwards?")
    remarks += _shift(common, np.abs(common.values[:, 0] / factor), common.gnss.ground_speed)
    return [_judged(config, f"{factor:.3f} times the GNSS speed", remarks)]


def _barometer(config: Any, common: _SampledTrack) -> list[Finding]:
    z, h = common.values[:, 0], common.place[:, 2]
    offset = float(np.median(z - h))
    text = f"{offset:+.0f} m from the GNSS height"
    remarks = []
    if np.ptp(h) > _CLIMB_M:
        slope = float(np.polyfit(h, z, 1)[0])
        text += f", {slope:.2f} m per metre"
        if not 0.8 < slope < 1.25:
            remarks.append("its height does not follow: check its unit (hPa, Pa, kPa, m, ft) and its sign")
        remarks += _shift(common, z, lambda t: np.interp(t, common.gnss.t_s, common.gnss.place[:, 2]))
    if abs(offset) > 4.0 * config.offset_sigma_m:
        remarks.append("the offset is beyond its sigma: check its unit, or give a larger offset_sigma_m")
    return [_judged(config, text, remarks)]


def _heading_against_course(
    config: Any,
    common: _SampledTrack,
    heading: Float64,
    declared: str,
    sigma_deg: float,
    in_radians: Float64 | None = None,
) -> list[Finding]:
    """Compare headings with the course, ``sigma_deg`` that of a fixed turn as the flight file declares it.

    ``in_radians`` are the headings if the log, declared in degrees, is in radians.

    Wind and current turn a vehicle by an angle that goes with the sine of its course: the mean over the courses is at
    most the largest angle times the mean of their unit vectors, none on a circle. What is more is the device's.
    """
    moving = common.speed > _MOVING_MPS
    if moving.sum() < _LEAST_POINTS:
        return [Finding("ok", config.label, "the vehicle does not move: not compared with the course")]
    course = np.arctan2(common.v_n[moving, 1], common.v_n[moving, 0])
    away, spread = _mean_turn(heading[moving] - course)
    _, reversed_spread = _mean_turn(-heading[moving] - course)
    text = f"{away:+.1f} deg from the GNSS course, spread {spread:.1f} deg"
    crabs_deg = _TURN_DEG * float(abs(np.mean(np.exp(1j * course))))
    remarks, most_deg = [], min(_TURN_DEG, crabs_deg + 4.0 * sigma_deg + 2.0 * spread)
    rms = float(np.hypot(away, spread))
    if in_radians is not None and np.hypot(*_mean_turn(in_radians[moving] - course)) < _FITS * rms:
        remarks.append("unit = 'rad' fits")
    elif reversed_spread < _FITS * spread:
        remarks.append("it turns in the opposite direction: check its sign or axes")
    elif spread > 2.0 * _TURN_DEG:
        remarks.append("it does not follow the course: check its unit, axes and time")
    elif abs(away) > most_deg:
        remarks.append(f"a constant offset: {declared}, or the vehicle moves backwards")
    return [_judged(config, text, remarks)]


def _mean_turn(turn: Float64) -> tuple[float, float]:
    """Return mean and spread [deg] of angles on a circle."""
    mean = np.angle(np.mean(np.exp(1j * turn)))
    rest = np.angle(np.exp(1j * (turn - mean)))
    return float(np.degrees(mean)), float(np.degrees(np.sqrt(np.mean(rest**2))))


def _heading(config: Any, common: _SampledTrack) -> list[Finding]:
    declared = "declare it as offset_deg, or as declination_deg if the heading is from magnetic north"
    added = RAD_PER_DEG * (config.declination_deg + config.offset_deg)
    heading = common.values[:, 0]
    in_radians = (heading - added) / RAD_PER_DEG + added if config.unit == "deg" else None
    return _heading_against_course(config, common, heading, declared, config.offset_sigma_deg, in_radians)


def _attitude(config: Any, common: _SampledTrack) -> list[Finding]:
    good = np.isfinite(common.values[:, 2])
    if not good.any():
        return []
    track = _part(common, good)
    heading = track.values[:, 2]
    in_radians = heading / RAD_PER_DEG if config.unit == "deg" else None
    return _heading_against_course(
        config, track, heading, "declare it as mounting_rpy_deg", config.sigma_deg[2], in_radians
    )


def _magnetometer(config: Any, common: _SampledTrack) -> list[Finding]:
    """Compare the level heading where the vehicle does not bank, and the size of the field.

    Roll and pitch that are left are neglected: 2 deg for each degree where the field dips by 63 deg.
    """
    known = np.asarray(np.isfinite(common.values).all(axis=1))
    if not known.any():
        return []
    common = _part(common, known)
    gnss, m = common.gnss, common.values
    acceleration = _at(gnss, common.t_s, np.gradient(gnss.v_n, gnss.t_s, axis=0))
    straight = np.hypot(acceleration[:, 0], acceleration[:, 1]) < _STRAIGHT_MPS2
    total = float(np.median(np.linalg.norm(m, axis=1)))
    remarks, text, findings = [], f"total field {total:.1f} uT", []
    if not EARTH_FIELD_UT[0] < total < EARTH_FIELD_UT[1]:
        units = " or ".join(f"'{unit}'" for unit in fitting_units(config, total))
        remedy = f"unit = {units} fits" if units else "check its unit and calibration"
        remarks.append(f"the Earth's field is 22 to 67 uT: {remedy}")
    if straight.sum() >= _LEAST_POINTS:
        level_track, level_m = _part(common, straight), m[straight]
        heading = np.arctan2(-level_m[:, 1], level_m[:, 0]) + np.radians(config.declination_deg)
        sigma_deg = np.degrees(config.hard_iron_sigma_ut / config.horizontal_ut)
        sigma_deg = float(np.hypot(config.declination_sigma_deg, sigma_deg))
        declared = "check axes and declination_deg"
        findings = _heading_against_course(config, level_track, heading, declared, sigma_deg)
        level = float(np.median(np.hypot(level_m[:, 0], level_m[:, 1])))
        text = (
            f"horizontal field {level:.1f} uT, declared {config.horizontal_ut:g}; total field {total:.1f} uT"
        )
        if not remarks and not 0.5 < level / config.horizontal_ut < 2.0:
            remarks.append("check its unit, axes and horizontal_ut")
        sign = down_sign(*level_track.place[0, :2].tolist())
        moving = level_track.speed > _MOVING_MPS
        course = np.arctan2(level_track.v_n[:, 1], level_track.v_n[:, 0])
        remarks += filter(None, [wrong_vertical(level_m, sign)])
        if moving.sum() >= _LEAST_POINTS:
            remarks += filter(None, [fitting_axes(config, level_m[moving], course[moving], sign)])
    return [*findings, _judged(config, text, remarks)]


def _position(config: Any, common: _SampledTrack) -> list[Finding]:
    radius = 6.371e6
    lat, lon, h = (common.values - common.place).T
    apart = np.column_stack([lat * radius, lon * radius * np.cos(common.place[:, 0])])
    n, e = np.median(apart, axis=0)
    up = float(np.nanmedian(h)) if np.isfinite(h).any() else np.nan
    text = f"{n:+.1f} m north, {e:+.1f} m east, {up:+.1f} m up from the pseudorange solution"
    remarks = []
    speed2 = np.sum(common.v_n[:, :2] ** 2, axis=1)
    moving = speed2 > _MOVING_MPS**2
    if moving.sum() >= _LEAST_POINTS:
        late_s = float(np.median(np.sum(apart * common.v_n[:, :2], axis=1)[moving] / speed2[moving]))
        across = apart[moving] - late_s * common.v_n[moving, :2]
        if abs(late_s) > 0.5 and np.median(np.abs(across)) < 0.5 * np.median(np.abs(apart[moving])):
            remarks.append(f"its time tags are off: add {late_s:+.1f} s to time.offset_s")
    if not remarks and np.hypot(n, e) > _STRAY_M:
        remarks.append("check the order of its columns, its frame and its datum")
    geoid = float(geoid_height(*np.degrees(common.place[:1, :2].T))[0])
    if abs(up) > 10.0 and abs(up + geoid) < 0.5 * abs(up):
        remarks.append("its heights are above sea level: height = 'sea_level'")
    return [_judged(config, text, remarks)]


def _velocity(config: Any, common: _SampledTrack) -> list[Finding]:
    apart = common.values - common.v_n
    rms = float(np.sqrt(np.nanmedian(apart[:, :2] ** 2)))
    swapped = float(np.sqrt(np.nanmedian((common.values[:, (1, 0)] - common.v_n[:, :2]) ** 2)))
    remarks = []
    if rms > _STRAY_MPS:
        other = "enu" if config.axes == "ned" else "ned"
        advice = "check its axes, unit and time"
        remarks.append(f"axes = '{other}' fits" if swapped < 0.3 * rms else advice)
    if np.isfinite(common.values[:, :2]).all():
        level = np.linalg.norm(common.values[:, :2], axis=1)
        remarks += _shift(common, level, common.gnss.ground_speed)
    return [_judged(config, f"{rms:.2f} m/s from the range-rate velocity (median, horizontal)", remarks)]


def _judged(config: Any, text: str, remarks: list[str]) -> Finding:
    return Finding("warning" if remarks else "ok", config.label, text, "; ".join(remarks))


_CHECKS: Final[dict[str, Callable[[Any, _SampledTrack], list[Finding]]]] = {
    "odometer": _odometer,
    "barometer": _barometer,
    "magnetometer": _magnetometer,
    "heading": _heading,
    "attitude": _attitude,
    "position": _position,
    "velocity": _velocity,
}
