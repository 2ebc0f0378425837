"""The first flight file of a converted log, with comments for the entries that only its user knows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from insgnss.config.flight import ReferenceColumns
from insgnss.constants import NS_PER_WEEK
from insgnss.gpstime import ns_to_datetime
from insgnss.log.further_samples import BAROMETER, HEADING, FurtherSamples
from insgnss.log.own_solution import OWN_SOLUTION
from insgnss.log.receiver import ReceiverLog
from insgnss.log.satellites import channel_of_name
from insgnss.tables import ReferenceTable

GNSS_FILE: Final = "gnss_obs.csv"
IMU_FILE: Final = "imu.csv"
REFERENCE_FILE: Final = "reference.csv"
FIXES_FILE: Final = "fixes.csv"  # of sensors, where there are no measurements
NAVIGATION_FILE: Final = "navigation.rnx"
FLIGHT_FILE: Final = "flight.toml"

_LEVER_ARM: Final = "# lever_arm_m = [0.0, 0.0, 0.0]  # DECLARE: IMU to antenna, body axes forward-right-down"
_SAMPLING: Final = {
    False: 'sampling = "instant"  # rates at their time tags; "mean" for a sensor that averages over its interval',
    True: 'sampling = "mean"  # the sensor sends the mean since its last sample',
}


def flight_text(sources: Sequence[Path], log: ReceiverLog, written: Sequence[str]) -> str:
    """Return the flight file.

    Parameters
    ----------
    sources : the inputs
    log : what they hold
    written : names of the files in the same folder
    """
    first_ns = log.span_ns()[0]
    when = f"{ns_to_datetime(first_ns):%Y-%m-%d %H:%M:%S} GPS time"
    named = "".join(c if c.isprintable() else "?" for c in ", ".join(path.name for path in sources))
    others = {GNSS_FILE, IMU_FILE, REFERENCE_FILE, FIXES_FILE, *(samples.file for samples in log.further)}
    lines = [
        f"# First flight file, from {named} ({when}).",
        "# DECLARE marks what no log states: complete each of them before you trust a result.",
        f"gps_week = {first_ns // NS_PER_WEEK}",
        "",
        *_imu_lines(log),
        "",
        *_gnss_lines(log, [name for name in written if name not in others]),
        *_fixes_lines(log),
        *_reference_lines(log),
        *(line for samples in log.further for line in _sensor_lines(samples, log)),
    ]
    return "\n".join(lines) + "\n"


def _imu_lines(log: ReceiverLog) -> list[str]:
    axes = ", ".join(f'"{axis}"' for axis in log.imu_axes)
    lines = [
        "[imu]",
        f'files = ["{IMU_FILE}"]',
        f"axes = [{axes}]  # DECLARE: which sensor axis points forward, right, down",
        'grade = "mems_consumer"  # DECLARE: the sensor\'s grade, a name of the library or a table of numbers',
        _SAMPLING[log.imu is not None and log.imu_is_mean],
        'gyro_unit = "rad/s"',
        'accel_unit = "m/s^2"',
    ]
    if log.imu is not None:
        return ["# The log's own samples, in the sensor's axes.", *lines]
    return [
        "# The log has no inertial samples: 'insgnss point' needs none.",
        "# For a replay put your sensor's CSV beside this file and describe it here.",
        *(f"# {line}" for line in lines),
    ]


def _gnss_lines(log: ReceiverLog, navigation: Sequence[str]) -> list[str]:
    """Return the entry of the measurements; as comments where positions take their place."""
    has_gnss = len(log.gnss.t_ns) > 0
    lines = [
        "[gnss]",
        f'files = ["{GNSS_FILE}"]{"" if has_gnss else "  # DECLARE: this file does not exist yet"}',
        _navigation_line(navigation, log),
        _LEVER_ARM,
        'oscillator = "tcxo"  # DECLARE when you know better',
    ]
    if not has_gnss:
        return [
            f"# DECLARE: the log has no raw measurements, {GNSS_FILE} does not exist. Convert the file that holds them",
            "# in one call with this one, into a new folder, or name another log of the same flight under [gnss].",
            *(_as_comments(lines) if _fixes_in_place(log) is not None else lines),
        ]
    known = {sv: k for sv, k in log.gnss.glonass_channels.items() if channel_of_name(sv) is None}
    if known:
        listed = ", ".join(f"{sv} = {channel}" for sv, channel in sorted(known.items()))
        lines.append(f"glonass_channels = {{ {listed} }}  # as the log states them")
    return lines


def _fixes_in_place(log: ReceiverLog) -> ReferenceTable | None:
    """Return the receiver's fixes where they are the log's only data from satellites, else None.

    Positions of a filter with inertial data do not count: they hold these samples already.
    """
    return None if len(log.gnss.t_ns) else log.satellite_fixes()


def _fixes_lines(log: ReceiverLog) -> list[str]:
    """Return the receiver's fixes as sensors of position and velocity, in place of measurements."""
    fixes = _fixes_in_place(log)
    if fixes is None:
        return []
    file = f'files = ["{FIXES_FILE}"]'
    lines = [
        "",
        "# The receiver's fixes are used in place of raw measurements: remove them when you have a [gnss].",
        *("[[sensor]]", 'kind = "position"', file, _LEVER_ARM),
    ]
    sigma = np.full((len(fixes.t_ns), 6), np.nan) if fixes.sigma is None else fixes.sigma[:, :6]
    if np.isnan(sigma[:, :3]).any():
        lines.append("sigma_m = [5.0, 5.0, 10.0]  # DECLARE: north, east, down, where the log states none")
    measured = [bool(np.isfinite(component).any()) for component in fixes.v_n.T]
    if any(measured):
        known = zip(ReferenceColumns().velocity, measured, strict=True)
        names = ", ".join(f'"{name}"' if is_measured else '"none"' for name, is_measured in known)
        lines += [
            "",
            "[[sensor]]",
            'kind = "velocity"',
            file,
            f"columns = {{ velocity = [{names}] }}",
            _LEVER_ARM,
        ]
        if np.isnan(sigma[:, 3:][:, measured]).any():
            lines.append(
                "sigma_mps = [0.3, 0.3, 0.5]  # DECLARE: north, east, down, where the log states none"
            )
    return lines


def _navigation_line(names: Sequence[str], log: ReceiverLog) -> str:
    if names:
        listed = ", ".join(f'"{_escaped(name)}"' for name in names)
        return f"navigation = [{listed}]"
    if log.gnss.sat is not None:
        return "# The log states where its satellites were: no navigation file is needed."
    return '# navigation = ["..."]  # DECLARE: the log has no broadcast messages; the day\'s RINEX navigation file'


def _sensor_lines(samples: FurtherSamples, log: ReceiverLog) -> list[str]:
    """Return the entry of a further sensor as comments: what disturbs it or how it is mounted, its user knows."""
    lines = ["[[sensor]]", f'kind = "{samples.kind}"', f'files = ["{samples.file}"]']
    if samples.kind == BAROMETER:
        why = "Remove the marks below unless the cabin is pressurised."
    elif samples.kind == HEADING:
        why = "Remove the marks below and declare how its antennas lie in the vehicle."
        lines.append("offset_deg = 0.0  # DECLARE: the vehicle's heading minus that of the log")
        if not samples.has_sigmas:
            lines.append("sigma_deg = 1.0  # DECLARE: the log states none")
    else:
        why = "Remove the marks below and declare the field, unless steel or motors are near."
        axes = ", ".join(f'"{axis}"' for axis in log.imu_axes)
        lines += [
            f"axes = [{axes}]  # DECLARE: as under [imu]",
            "declination_deg = 0.0  # DECLARE: of the place and year, by the World Magnetic Model",
            "horizontal_ut = 20.0  # DECLARE: horizontal intensity, from the same model",
        ]
    return ["", f"# The log has a {samples.kind} ({samples.source}). {why}", *(f"# {line}" for line in lines)]


def _reference_lines(log: ReceiverLog) -> list[str]:
    """Return the entry of the receiver's own solution, not independent truth, or of a simulator's truth."""
    if log.solution is None:
        return []
    # a phone's is not scored tightly
    mark = " (quality 2: a rough reference)" if (log.solution.quality >= OWN_SOLUTION).all() else ""
    lines = [
        "[reference]",
        f'file = "{REFERENCE_FILE}"',
        f'point = "{log.solution_point}"  # DECLARE: the point that the receiver is configured to report',
    ]
    own = (
        f"# The receiver's own solution with its sigmas{mark}: computed from the same signals, not independent"
        " truth."
    )
    if log.solution_from == "truth":
        own = "# The truth of the simulator."
    elif log.solution_from == "filter" and log.fixes is not None:
        own = f"# The filter's own solution with its sigmas{mark}: computed from the same fixes, not independent truth."
    elif _fixes_in_place(log) is not None:
        own = "# While the fixes are a sensor they are not a reference: a result must not be compared with its input."
        lines = _as_comments(lines)
    return ["", own, *lines]


def _as_comments(lines: Sequence[str]) -> list[str]:
    return [line if line.startswith("#") else f"# {line}" for line in lines]


def _escaped(name: str) -> str:
    """Return a file's name as it stands within a TOML string."""
    return "".join(
        f"\\u{ord(c):04X}" if c in '"\\' or (not c.isprintable() and ord(c) < 65536) else c for c in name
    )
