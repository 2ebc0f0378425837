"""The check of a flight before it is replayed: everything is read, and each defect is reported with advice."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final, TypeVar

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.errors import InsGnssError
from insgnss.gnss.signals import CHANNELS
from insgnss.log.checks.antennas_on_demand import antenna_findings
from insgnss.log.checks.declaration import vehicle_findings
from insgnss.log.checks.gnss import ephemeris_findings, gnss_findings, ionosphere_findings
from insgnss.log.checks.imu import imu_findings
from insgnss.log.checks.report import CheckReport, Finding, from_error, from_events
from insgnss.log.flight import Flight
from insgnss.log.gnss_log import missing_navigation, read_receiver, with_files
from insgnss.log.imu.csv_log import read_imu
from insgnss.log.imu.faults import DEAD
from insgnss.log.overlap import check_navigation_time, check_overlap, epochs_outside
from insgnss.log.phone_satellites import states_beside, with_slots
from insgnss.log.receiver import ReceiverLog
from insgnss.log.reference import read_reference
from insgnss.tables import Event, GnssTable, ImuTable, NavigationData, ReferenceTable

Table = TypeVar("Table")

LONG_LEVER_ARM_M: Final = 30.0  # longer ones exist on ships; more often millimetres were taken for metres
QUALITIES_SHOWN: Final = 5
# Events that say how a log was read and report no defect
NOTICES: Final = frozenset(
    {
        "columns_not_read",
        "csv_delimiter",
        "csv_encoding",
        "csv_header_in_comment",
        "csv_lines_skipped",
        "android_code_type",
        "android_lines_not_read",
        "android_range_not_used",
        "glonass_slot_found",
        "imu_drift_taken_off",
        "imu_increment_over_long_step",
        "leap_seconds_by_date",
        "midnight_crossover",
        "navigation_not_used",
        "navigation_repeated",
        "reference_rows_left_out",
        "rinex_event",
        "rows_of_other_logs",
        "satellite_states_beside",
        "sbf_not_used",
        "sensor_samples_not_used",
        "signal_assumed",
        "time_mark",
        "ubx_foreign_bytes",
        "ubx_not_used",
        "week_crossover",
    }
)


@dataclass(frozen=True)
class ReadLogs:
    """The logs of a flight as far as they could be read."""

    imu: ImuTable | None  # None: refused, or its units contradict the numbers
    receiver: ReceiverLog | None
    navigation: NavigationData | None  # messages of files and receiver


def read_and_check(flight: Flight) -> tuple[CheckReport, ReadLogs]:
    """Read all logs of a flight; return the findings on each, and the logs.

    Reports rates, gaps, overlaps, gravity and tilt at rest, suspicions of units and axes, satellites and ephemerides
    per epoch, the sign of the range rates, clock jumps, repeated rows, an ambiguous lever arm, and of several antennas
    where they stand and what their logs share. A log that cannot be
    read is an error in the report, not an exception; the others are still looked at.
    """
    config = flight.config
    shared = config.columns_by_file()
    findings: list[Finding] = []
    imu: ImuTable | None = None
    if config.imu is None:
        findings.append(Finding("warning", "imu", "no inertial log", "describe it under [imu] for a replay"))
    else:
        declared = config.imu
        imu = _attempt(findings, "imu", lambda: read_imu(declared, config.gps_week, flight.imu_grade, shared))
        if imu is not None:
            findings += imu_findings(imu, config.gps_week, accel_unit=declared.accel_unit)
    receiver = None
    if config.gnss.files:
        receiver = _attempt(findings, "gnss", lambda: _with_events(flight))
    else:
        findings.append(
            Finding("ok", "gnss", "no raw GNSS data: position fixes of [[sensor]] carry the filter")
        )
    of_messages: list[Finding] = []
    navigation = _read_messages(of_messages, flight, receiver)
    gnss = None
    if receiver is not None:
        gnss, events = with_slots(receiver.gnss, navigation)
        if config.gnss.format == "android":
            gnss, beside = states_beside(gnss, navigation, bool(config.gnss.precise))
            events += beside
        receiver = replace(receiver, gnss=gnss)
        findings += from_events("gnss", events, NOTICES)
        findings += gnss_findings(gnss, config, _channels(flight, gnss, navigation))
    findings += of_messages
    _check_navigation(findings, flight, receiver, navigation)
    if config.reference is not None:
        reference_config = config.reference
        reference = _attempt(
            findings, "reference", lambda: read_reference(reference_config, config.gps_week, shared)
        )
        if reference is not None:
            findings += _reference_findings(reference, imu, reference_config.quality_max)
    if imu is not None and gnss is not None:
        findings += _overlap_findings(flight, imu, gnss)
    if config.gnss.files:
        findings.append(_lever_arm_finding(flight))
    if config.vehicle is not None:
        findings += vehicle_findings(config.vehicle)
    if config.attitude is not None:
        findings += antenna_findings(flight, gnss)
    return CheckReport(flight.name, tuple(findings)), ReadLogs(imu, receiver, navigation)


def _attempt(
    findings: list[Finding], topic: str, read: Callable[[], tuple[Table, list[Event]]]
) -> Table | None:
    """Return the result of ``read``, its events turned into findings; None after an error, which is a finding too."""
    try:
        table, events = read()
    except InsGnssError as error:
        findings.append(from_error(topic, error))
        return None
    findings += from_events(topic, events, NOTICES, frozenset({DEAD}))
    return table


def _with_events(flight: Flight) -> tuple[ReceiverLog, list[Event]]:
    """Return the GNSS log of a flight and its events."""
    config = flight.config
    log = read_receiver(config.gnss, config.gps_week, config.columns_by_file())
    return log, log.events


def _read_messages(
    findings: list[Finding], flight: Flight, receiver: ReceiverLog | None
) -> NavigationData | None:
    """Return the messages of the navigation files and of the receiver's own log, None without any."""
    own = None if receiver is None else receiver.navigation
    stated = receiver is not None and receiver.gnss.sat is not None
    navigation = _attempt(
        findings, "navigation", lambda: with_files(own, flight.config.gnss.navigation, stated)
    )
    return own if navigation is None else navigation


def _channels(flight: Flight, gnss: GnssTable, navigation: NavigationData | None) -> dict[str, int]:
    """Return the GLONASS channels from messages, flight file or log, in this order of trust."""
    states = None if navigation is None else navigation.state_vectors
    channels = {} if states is None else dict(zip(states.sv_names, states.channel.tolist(), strict=True))
    known = {name: channel for name, channel in channels.items() if channel in CHANNELS}
    return gnss.glonass_channels | flight.config.gnss.glonass_channels | known


def _check_navigation(
    findings: list[Finding], flight: Flight, receiver: ReceiverLog | None, navigation: NavigationData | None
) -> None:
    """Report on the messages against the observations."""
    if receiver is None:
        return
    files = flight.config.gnss.navigation
    if receiver.gnss.sat is not None:
        findings.append(Finding("ok", "navigation", "the GNSS log has satellite states"))
    if navigation is not None and navigation.has_messages:
        findings += ephemeris_findings(receiver.gnss, navigation)
        _attempt(
            findings,
            "navigation",
            lambda: (
                None,
                check_navigation_time(navigation, receiver.gnss.t_ns, files or flight.config.gnss.files),
            ),
        )
    elif receiver.gnss.sat is None and not flight.config.gnss.precise and (navigation or not files):
        findings.append(from_error("navigation", missing_navigation(flight.path)))
        return
    findings += ionosphere_findings(navigation)


def _overlap_findings(flight: Flight, imu: ImuTable, gnss: GnssTable) -> list[Finding]:
    try:
        check_overlap(imu.t_ns, gnss.t_ns, flight.config)
    except InsGnssError as error:
        return [from_error("flight", error)]
    start, end = max(imu.t_ns[0], gnss.t_ns[0]), min(imu.t_ns[-1], gnss.t_ns[-1])
    findings = [Finding("ok", "flight", f"IMU and GNSS overlap for {(end - start) / NS_PER_S:.1f} s")]
    before, after = epochs_outside(imu.t_ns, gnss.t_ns)
    if before or after:
        text = f"{before} GNSS epoch(s) before the IMU begins, {after} after it ends: not used"
        findings.append(Finding("warning" if after else "ok", "flight", text))
    return findings


def _reference_findings(
    reference: ReferenceTable, imu: ImuTable | None, quality_max: float | None
) -> list[Finding]:
    findings = [Finding("ok", "reference", f"{len(reference.t_ns)} rows")]
    values, counts = np.unique(reference.quality, return_counts=True)
    if len(values) > 1 and quality_max is None:
        shown = [f"{value:g} in {count}" for value, count in zip(values, counts, strict=True)]
        more = ", ..." if len(shown) > QUALITIES_SHOWN else ""
        text = (
            f"rows of several qualities ({', '.join(shown[:QUALITIES_SHOWN])}{more}): all are compared with"
        )
        advice = f"reference.quality_max = {values[0]:g} leaves the poorer ones out"
        findings.append(Finding("warning", "reference", text, advice))
    if imu is not None and (reference.t_ns[-1] < imu.t_ns[0] or reference.t_ns[0] > imu.t_ns[-1]):
        text = "does not overlap the inertial log in time"
        findings.append(Finding("warning", "reference", text, "check reference.time and gps_week"))
    return findings


def _lever_arm_finding(flight: Flight) -> Finding:
    lever = flight.config.gnss.lever_b
    if lever is None:
        text = "the lever arm from IMU to antenna is not given"
        return Finding(
            "warning", "flight", text, "measure it; write [0, 0, 0] only if it is zero: gnss.lever_arm_m"
        )
    length = float(np.linalg.norm(lever))
    shown = f"lever arm ({lever[0]:g}, {lever[1]:g}, {lever[2]:g}) m forward, right, down"
    if length > LONG_LEVER_ARM_M:
        return Finding("warning", "flight", f"{shown} is {length:.0f} m long", "declare it in metres")
    if lever[2] > 0.0 and length > 0.0:
        return Finding("ok", "flight", f"{shown}: the antenna is below the IMU")
    return Finding("ok", "flight", shown)
