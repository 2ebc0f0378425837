"""The examination of a flight: each log by itself, then the logs against each other, and the proposed declarations.

A log is examined with what was found so far already mended in memory: units first, then the GNSS log's rates and time,
then the inertial log against the motion that the satellites show, solved as the point solution and the filter's
settings have it. Nothing is written.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from insgnss.config.library import filter_config
from insgnss.config.sensors import PositionSensor, VelocitySensor
from insgnss.constants import NS_PER_S, S_PER_WEEK, STANDARD_GRAVITY_MPS2
from insgnss.errors import InsGnssError
from insgnss.gnss.orbits.satellite_state import range_rates, row_wavelengths
from insgnss.log.checks.clock import clock_findings, oscillator_findings
from insgnss.log.checks.corrected_file import corrected_flight
from insgnss.log.checks.declaration import AxesDeclaration, declared_log
from insgnss.log.checks.each_log import ReadLogs, read_and_check
from insgnss.log.checks.fixes_track import fixes_track
from insgnss.log.checks.gap_cost import gap_findings
from insgnss.log.checks.gnss_time import gnss_time_findings
from insgnss.log.checks.imu import GroundVelocity, imu_findings
from insgnss.log.checks.imu_rate import at_full_rate
from insgnss.log.checks.motion_findings import match_of, motion_findings
from insgnss.log.checks.rate_lag import KnownLag, known_lag
from insgnss.log.checks.report import (
    AXES_FIT,
    CLOCK_LEAPS,
    RATES_CONTRADICT,
    VERTICAL_AXIS,
    CheckReport,
    Finding,
    Proposal,
)
from insgnss.log.checks.sensor_findings import read_sensor_logs, sensor_findings
from insgnss.log.checks.time_offset import HOUR_S, NO_RATES, overlapping_shifts, time_proposals
from insgnss.log.checks.track import GnssTrack, track_of
from insgnss.log.flight import Flight, FlightLogs
from insgnss.log.gnss_log import read_receiver
from insgnss.log.imu.csv_log import inertial
from insgnss.log.imu.faults import DEAD
from insgnss.log.imu.units import fitting_accel_units, keys_of_accel_unit
from insgnss.log.precise import read_precise
from insgnss.runs.first_run import compiled
from insgnss.runs.point import solve_rows
from insgnss.runs.setup import setup_filter
from insgnss.tables import GnssTable, ImuTable, Int64, NavigationData

LEAST_G: Final = 0.5  # the median of |f| in any vehicle that flies, drives or swims
MOST_G: Final = 2.0
MIN_TRACK: Final = 8  # epochs
MOST_SHIFTS: Final = 8  # whole hours that are tried where the logs do not overlap
FILTER: Final = "tight"  # its signals, masks and noise


def examine(flight: Flight | str | Path, progress: Callable[[str], None] | None = None) -> CheckReport:
    """Check each log of a flight, then the logs against each other; return the findings, with proposals for its file.

    A log that cannot be read is a finding, not an error.

    Parameters
    ----------
    flight : the flight or its file
    progress : receives a message while the compiler runs

    Raises
    ------
    ConfigError : the flight file cannot be read
    """
    if not isinstance(flight, Flight):
        flight = Flight.load(flight)
    with compiled(progress or (lambda _: None)) as compilation:
        report, logs = read_and_check(flight)
    findings = list(report.findings)
    mended = corrected_flight(flight, report.proposals)
    try:
        more, confirmed = _against_each_other(mended, logs, findings, flight.config.gps_week)
    except InsGnssError as error:
        more, confirmed = (
            [Finding("warning", "motion", f"not examined: {error.message}", error.advice)],
            False,
        )
    if confirmed:
        findings = [_cleared(finding) for finding in findings]
    return CheckReport(report.name, tuple(findings + more), compilation.waited_s)


def _against_each_other(
    flight: Flight, logs: ReadLogs, findings: list[Finding], week: int
) -> tuple[list[Finding], bool]:
    """Return further findings, and whether the motion bears out the declared axes.

    Parameters
    ----------
    flight : with the proposals of the findings so far taken
    findings : of each log by itself; those of rest are replaced once the speed is known
    week : that the inertial log was read with
    """
    if logs.receiver is None:
        return _against_fixes(flight, logs, findings, week)
    more: list[Finding] = []
    gnss = logs.receiver.gnss
    if any(p.key.startswith("gnss.") for finding in findings for p in finding.proposals):
        gnss = read_receiver(flight.config.gnss, flight.config.gps_week).gnss
    contradict = any(finding.kind == RATES_CONTRADICT for finding in findings)
    gnss = _without_rates(gnss) if contradict else gnss
    solve = partial(solve_track, flight, navigation=logs.navigation)
    time = gnss_time_findings(flight, gnss, logs.navigation, logs.imu, solve)
    more += time
    flight = _with(flight, time)
    if any(finding.proposals for finding in time):
        gnss = read_receiver(flight.config.gnss, flight.config.gps_week).gnss
        gnss = _without_rates(gnss) if contradict else gnss
    track = solve_track(flight, gnss, logs.navigation)
    if track is not None:
        leaps = any(finding.kind == CLOCK_LEAPS for finding in findings)  # by the range rates
        more += [f for f in clock_findings(track) if not (leaps and f.kind == CLOCK_LEAPS)]
        more += oscillator_findings(track, flight.oscillator)
    lag = _rate_lag(flight, gnss)
    more += [] if lag is None else lag.findings
    of_epochs = track if track is None or lag is None else lag.at_epochs(track)
    more += sensor_findings(read_sensor_logs(flight), of_epochs, logs.imu)
    changed = any(p.key.startswith(("imu.", "gps_week")) for f in [*findings, *time] for p in f.proposals)
    of_imu, confirmed = _inertial_log(
        flight, logs, findings, week, track, gnss.t_ns, changed=changed, lag=lag
    )
    if any(finding.severity == "error" and not finding.proposals for finding in time):
        of_imu = [_doubted_offset(finding) for finding in of_imu]
    return more + of_imu, confirmed


def _rate_lag(flight: Flight, gnss: GnssTable) -> KnownLag | None:
    """Return what is known of the lag of the log's range rates, None without any."""
    channels = gnss.glonass_channels | flight.config.gnss.glonass_channels
    rates, phases = range_rates(gnss, channels), gnss.carrier_cycles
    if not np.isfinite(rates).any():
        return None
    carriers_m = None if phases is None else row_wavelengths(gnss, channels) * phases
    return known_lag(gnss, rates, carriers_m, flight.config.gnss.range_rate_lag_s)


def _doubted_offset(finding: Finding) -> Finding:
    """Return a sure offset between the logs as a likely one of the inertial log: no position fits the GNSS tags."""
    if not any(p.key.startswith("imu.time.") for p in finding.proposals):
        return finding
    return replace(
        finding, sure="likely: the pseudoranges fit no position, so the GNSS tags may be the wrong ones"
    )


def _without_rates(gnss: GnssTable) -> GnssTable:
    """Return the log without range rates: wrong ones give a wrong velocity, and positions give another."""
    nothing = np.full(len(gnss.t_ns), np.nan)
    return replace(gnss, range_rate_mps=nothing, doppler_hz=nothing)


def _against_fixes(
    flight: Flight, logs: ReadLogs, findings: list[Finding], week: int
) -> tuple[list[Finding], bool]:
    """Return the findings on a flight without raw GNSS data: its position fixes say how the vehicle moved."""
    sensors = read_sensor_logs(flight)
    of_fixes = [log for log in sensors if isinstance(log.config, PositionSensor | VelocitySensor)]
    others = [log for log in sensors if not isinstance(log.config, PositionSensor | VelocitySensor)]
    result = fixes_track(of_fixes)
    more = sensor_findings(of_fixes, None, logs.imu)
    more += sensor_findings(others, None if result is None else result.track, logs.imu)
    if result is None:
        return more, False
    track, lever_b, of_velocities = result
    more += of_velocities
    gnss = flight.config.gnss.model_copy(update={"lever_arm_m": lever_b})
    flight = replace(flight, config=flight.config.model_copy(update={"gnss": gnss}))
    changed = any(p.key.startswith(("imu.", "gps_week")) for f in findings for p in f.proposals)
    t_ns = track.origin_ns + np.rint(track.t_s * NS_PER_S).astype(np.int64)
    of_imu, confirmed = _inertial_log(flight, logs, findings, week, track, t_ns, changed=changed)
    return more + of_imu, confirmed


def _inertial_log(
    flight: Flight,
    logs: ReadLogs,
    findings: list[Finding],
    week: int,
    track: GnssTrack | None,
    epoch_ns: Int64,
    *,
    changed: bool,
    lag: KnownLag | None = None,
) -> tuple[list[Finding], bool]:
    """Return what the vehicle's track says of the inertial log, and whether it bears out the declared axes.

    Parameters
    ----------
    epoch_ns : (m,) times of the log that the track is from
    changed : whether the inertial log has to be read again, with what was proposed so far
    lag : of the range rates that the track's velocities are from
    """
    if flight.config.imu is None:
        return [], False
    if track is not None:
        _judge_rest_by_speed(flight, findings, week, logs.imu, track)
    declared = declared_log(flight, None if changed else logs.imu)
    units = _accelerometer_findings(flight, declared, findings)
    if any(finding.proposals for finding in units):
        flight = _with(flight, units)
        declared = declared_log(flight)
    more = [*units, *gap_findings(declared.imu, epoch_ns, flight.imu_grade, flight.config.gps_week)]
    size = float(np.median(np.linalg.norm(declared.imu.f_b, axis=1))) / STANDARD_GRAVITY_MPS2
    if not LEAST_G < size < MOST_G:
        text = (
            f"the specific force is {size:.3g} g in the middle of the log: not compared with the satellites"
        )
        return [*more, Finding("warning", "motion", text, "its unit must be known first")], False
    if any(finding.kind == DEAD for finding in findings):
        text = "a sensor holds its values for most of the log: not compared with the satellites"
        return [*more, Finding("warning", "motion", text)], False
    if track is None or len(track.t_s) < MIN_TRACK:
        text = "too few epochs with a position: the inertial log cannot be compared with the satellites"
        return [*more, Finding("warning", "motion", text)], False
    motion = _motion(flight, declared, track, epoch_ns, lag)
    return more + motion, any(finding.kind == AXES_FIT for finding in motion)


def _judge_rest_by_speed(
    flight: Flight, findings: list[Finding], week: int, imu: ImuTable | None, track: GnssTrack
) -> None:
    """Replace the findings on the inertial log that were made without the vehicle's speed."""
    if imu is None:
        return
    t_ns = track.origin_ns + np.rint(track.t_s * NS_PER_S).astype(np.int64)
    order = np.argsort(t_ns, kind="stable")
    velocity = GroundVelocity(t_ns[order], track.v_e[order], track.sd_v_mps[order])
    accel_unit = inertial(flight.config).accel_unit
    before = imu_findings(imu, week, accel_unit=accel_unit)
    at = min(findings.index(finding) for finding in before)
    findings[:] = [finding for finding in findings if finding not in before]
    findings[at:at] = imu_findings(imu, week, velocity, flight.imu_grade, accel_unit=accel_unit)


def _with(flight: Flight, findings: list[Finding]) -> Flight:
    return corrected_flight(flight, [p for finding in findings for p in finding.proposals])


def _accelerometer_findings(
    flight: Flight, declared: AxesDeclaration, findings: list[Finding]
) -> list[Finding]:
    """Return the accelerometers' unit where the reader could not take the log and did not name one."""
    if any(p.key == "imu.accel_unit" for finding in findings for p in finding.proposals):
        return []
    config = inertial(flight.config)
    units = fitting_accel_units(declared.imu, config)
    if not units or units[0] == config.accel_unit:
        return []
    text = f"|f| is g in the middle of the log if the accelerometers' unit is {' or '.join(units)}"
    if len(units) > 1:
        return [Finding("error", "imu", text)]
    why = "the specific force is near g in the middle of the log"
    proposals = tuple(Proposal(key, value, why) for key, value in keys_of_accel_unit(units[0], config))
    return [Finding("error", "imu", text, "", "sure: no other unit does", proposals)]


def _motion(
    flight: Flight, declared: AxesDeclaration, track: GnssTrack, epoch_ns: Int64, lag: KnownLag | None
) -> list[Finding]:
    rates = NO_RATES if lag is None else lag.in_time
    track = track if lag is None else lag.velocities(track)
    imu_ns = (int(declared.imu.t_ns[0]), int(declared.imu.t_ns[-1]))
    declared = declared._replace(imu=at_full_rate(declared.imu))
    shifts = overlapping_shifts(imu_ns, (int(epoch_ns[0]), int(epoch_ns[-1])))[:MOST_SHIFTS]
    if not shifts:
        return motion_findings(flight, declared, track, rates=rates)
    peaks = [(match_of(flight, declared, track, float(shift)), shift) for shift in shifts]
    matches = [(match.contrast, shift) for match, shift in peaks if match is not None]
    if matches:
        return motion_findings(flight, declared, track, float(max(matches)[1]), rates)
    return [_unmoved(flight, shifts)]


def _unmoved(flight: Flight, shifts: list[int]) -> Finding:
    """Return the findings from the logs' time spans alone, without motion."""
    shift = shifts[0]
    hours = round((shift - round(shift / S_PER_WEEK) * S_PER_WEEK) / HOUR_S)
    text = f"IMU and GNSS overlap if {shift} s are added to the IMU tags: {_words(shift)}"
    if not hours:
        proposals = time_proposals(flight.config, round(shift / S_PER_WEEK), 0, 0, 0.0)
        return Finding("error", "flight", text, "", "sure: whole weeks", proposals)
    listed = " or ".join(str(s) for s in shifts)
    advice = f"suspected imu.time.offset_s = {listed}; a log with motion decides"
    return Finding("error", "flight", text, advice)


def _words(shift_s: int) -> str:
    weeks = round(shift_s / S_PER_WEEK)
    hours = round((shift_s - weeks * S_PER_WEEK) / HOUR_S)
    words = [f"{weeks:+d} week(s)"] if weeks else []
    return " and ".join(words + ([f"{hours:+d} hour(s)"] if hours else []))


def _cleared(finding: Finding) -> Finding:
    """Return a doubt about axes, raised by gravity at rest alone, as a fact: the motion bears the axes out."""
    if finding.severity != "warning" or finding.kind != VERTICAL_AXIS:
        return finding
    return replace(finding, severity="ok", advice="the motion confirms the axes")


def solve_track(flight: Flight, gnss: GnssTable, navigation: NavigationData | None) -> GnssTrack | None:
    """Return the track of a GNSS log, None where there is nothing to solve it with.

    Raises
    ------
    InsGnssError : the settings ask for something that the log has not
    """
    config = flight.config.gnss
    products = read_precise(config.precise)[0] if config.precise else None
    has_messages = navigation is not None and navigation.has_messages
    if gnss.sat is None and not has_messages and products is None:
        return None
    no_imu = ImuTable(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3)))
    logs = FlightLogs(no_imu, gnss, navigation, None, [], {}, products)
    setup = replace(setup_filter(flight, logs, filter_config(FILTER), several=False), with_carrier=False)
    if not setup.clock_groups:
        return None
    rows = setup.rows(gnss, setup.navigation)
    _, _, out = solve_rows(setup, rows)
    return track_of(rows.epoch_ns, out)
