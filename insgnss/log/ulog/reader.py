"""PX4's ULog files become tables: samples of its sensors, the autopilot's solution or its fixes, raw UBX where dumped.

``pyulog`` reads the file. PX4 logs raw measurements in ``gps_dump`` alone (parameter GPS_DUMP_COMM), as the receiver
sent them: UBX is read there. Everything else is counted by its topic. Times count from the autopilot's start; the GPS
messages tie them to UTC (see ``insgnss.log.boot_time``).
"""

from __future__ import annotations

import contextlib
import io
import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from insgnss.errors import InputError
from insgnss.log.boot_time import BootClock, boot_clock
from insgnss.log.events import counted, listed
from insgnss.log.files import file_buffer
from insgnss.log.further_samples import BAROMETER, MAGNETOMETER, FurtherKind, FurtherSamples, further_samples
from insgnss.log.receiver import ReceiverLog, assembled
from insgnss.log.sensor_pairs import paired
from insgnss.log.ubx.reader import read_ubx_bytes
from insgnss.log.ulog.definitions import check_definitions, sound_messages
from insgnss.log.ulog.solution import FIXES, SOLUTION, TRUTH, UlogSolution, sampled_us, solution
from insgnss.tables import Event, Float64, ImuTable, Int64

INERTIAL: Final = ("vehicle_imu", "sensor_combined", "sensor_gyro")
DUMP: Final = "gps_dump"
# Topics of further sensors, what they measure, their columns, and the unit in that of ``FurtherSamples``
FURTHER: Final[Mapping[str, tuple[FurtherKind, tuple[str, ...], float]]] = {
    "vehicle_air_data": (BAROMETER, ("baro_pressure_pa",), 0.01),
    "vehicle_magnetometer": (MAGNETOMETER, tuple(f"magnetometer_ga[{k}]" for k in "012"), 100.0),
}
_USED: Final = frozenset((*INERTIAL, "sensor_accel", DUMP, *FIXES, *SOLUTION, *TRUTH, *FURTHER))
_RELATIVE_MISSING: Final = 2**31 - 1
_TO_DEVICE: Final = 0x80  # bit of a dump's length: sent to the receiver, not by it
_AXES: Final = "012"


def read_ulog(path: Path, topics: Mapping[str, str] | None = None) -> ReceiverLog:
    """Read a ULog file (plain or gzipped).

    Inertial samples are those of the topic that has most of them (vehicle_imu, sensor_combined, or sensor_gyro with
    sensor_accel), first instance, in the autopilot's body axes. The reference is a simulator's truth
    (quality 1), else the autopilot's own solution or its receiver's fixes: no truth, quality 2.

    Parameters
    ----------
    topics : "imu", "gnss", "reference" -> topic, with an instance where it is not the first ("vehicle_imu:1")

    Raises
    ------
    InputError : pyulog is not installed, the file is not a ULog, has a damaged header, or holds no usable data
    """
    log, events = _load(path)
    data = {(d.name, d.multi_id): d.data for d in log.data_list if "timestamp" in d.data}
    with np.errstate(all="ignore"):  # of numbers that are none, which are looked for everywhere
        return _tables(data, events, dict(topics or {}), path)


def _tables(
    data: Mapping[tuple[str, int], Any], events: list[Event], wanted: dict[str, str], path: Path
) -> ReceiverLog:
    """Return the content of the topics; ``events`` are those of the file itself."""
    fixes = [d for (name, _), d in data.items() if name in FIXES and "time_utc_usec" in d]
    clock, more_events = boot_clock(max(fixes, key=lambda d: len(d["timestamp"]), default=None))
    events += more_events
    raw, more_events = _raw(data, path)
    events += more_events
    imu, solved = None, UlogSolution()
    samples: list[FurtherSamples] = []
    if clock is None:
        events.append(
            Event(None, "ulog_time_unknown", "no GPS message with UTC: inertial samples cannot be dated")
        )
    else:
        imu, more_events = _inertial(data, clock, wanted.get("imu"))
        events += more_events
        solved = solution(data, clock, wanted.get("reference"))
        events += solved.events
        samples, more_events = _further(data, clock)
        events += more_events
    events += _not_read(wanted, data)
    advice = "log sensor_combined and vehicle_gps_position; for raw measurements gps_dump (GPS_DUMP_COMM = 1)"
    log = assembled(path, raw, imu, solved.table, events, further=samples, holder="ULog", advice=advice)
    return replace(
        log, imu_is_mean=True, solution_point="imu", solution_from=solved.source, fixes=solved.fixes
    )


def _load(path: Path) -> tuple[Any, list[Event]]:
    """Return the file as ``pyulog`` reads it, and the events of damage."""
    try:
        from pyulog import ULog
    except ImportError as error:
        raise InputError(
            "ULog files need pyulog, which is not installed", file=path, advice="pip install 'insgnss[ulog]'"
        ) from error
    content, events = sound_messages(file_buffer(path).to_pybytes())
    check_definitions(content, path)
    try:
        with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            log = ULog(io.BytesIO(content), None, True)
    except (
        Exception
    ) as error:  # damaged files end in struct.error, KeyError, IndexError, TypeError, its own, ...
        raise InputError(
            f"the ULog cannot be read: {type(error).__name__}: {error}",
            file=path,
            advice="the header may be damaged: copy the file from the vehicle again",
        ) from error
    if log.file_corruption:
        events.append(Event(None, "ulog_damaged", "damaged messages left out"))
    if log.dropouts:
        seconds = sum(dropout.duration for dropout in log.dropouts) / 1000.0
        events += counted(
            "ulog_dropouts", len(log.dropouts), f"dropouts, {seconds:.2f} s in total, reported by PX4"
        )
    return log, events


def _not_read(wanted: Mapping[str, str], data: Mapping[tuple[str, int], Any]) -> list[Event]:
    counts = {name: len(d["timestamp"]) for (name, _), d in data.items() if name not in _USED}
    for part, topic in wanted.items():
        if part != "gnss" and _split(topic) not in data:
            names = sorted({f"{name}:{k}" if k else name for name, k in data if name in _USED})
            raise InputError(
                f"the ULog has no topic '{topic}'", key=f"--topic {part}", advice=f"it has {', '.join(names)}"
            )
    return listed("ulog_not_used", "topics not read", dict(sorted(counts.items())))


def _split(topic: str) -> tuple[str, int]:
    name, _, instance = topic.partition(":")
    return name, int(instance) if instance.isdigit() else 0


# ---------------------------------------------------------------------------------------------------------- inertial


def _inertial(
    data: Mapping[tuple[str, int], Any], clock: BootClock, wanted: str | None
) -> tuple[ImuTable | None, list[Event]]:
    """Return the samples of the topic that is named or has most of them."""
    choices = [key for key in data if key[0] in INERTIAL and (wanted is None or key == _split(wanted))]
    if wanted is None:
        choices = [key for key in choices if key[1] == min(k for name, k in choices if name == key[0])]
    if not choices:
        return None, []
    chosen = max(choices, key=lambda key: (len(data[key]["timestamp"]), -INERTIAL.index(key[0])))
    rows = data[chosen]
    events: list[Event] = []
    try:
        if chosen[0] == "vehicle_imu":
            samples = _increments(rows)
        elif chosen[0] == "sensor_combined":
            samples = _combined(rows)
        else:
            accel = data.get(("sensor_accel", chosen[1]), {})
            samples = (sampled_us(rows), _vectors(rows, "xyz"), sampled_us(accel), _vectors(accel, "xyz"))
    except KeyError as error:
        return None, [Event(None, "imu_not_used", f"{chosen[0]} without the column {error}")]
    gyro_us, w, accel_us, f = samples
    gyro, accel = clock.is_near(gyro_us), clock.is_near(accel_us)
    if not (gyro.all() and accel.all()):
        events.append(Event(None, "imu_time_unknown", f"{chosen[0]}: samples with damaged times left out"))
    gyro_us, w, accel_us, f = gyro_us[gyro], w[gyro], accel_us[accel], f[accel]
    imu, more_events = paired(clock.gps_ns(gyro_us), w, clock.gps_ns(accel_us), f, f"{chosen[0]}:{chosen[1]}")
    events += more_events
    others = sorted(
        f"{len(data[key]['timestamp'])} {key[0]}:{key[1]}"
        for key in data
        if key[0] in INERTIAL and key != chosen
    )
    if others:
        detail = f"samples are of {chosen[0]}:{chosen[1]}; not read: {', '.join(others)}"
        events.append(Event(None, "ulog_imu_chosen", detail))
    return imu, events


def _vectors(rows: Any, names: str | tuple[str, ...]) -> Float64:
    return np.column_stack([np.asarray(rows[name], np.float64) for name in names])


def _increments(rows: Any) -> tuple[Int64, Float64, Int64, Float64]:
    w, f = (  # increments over their times, which may be zero
        _vectors(rows, tuple(f"delta_{what}[{k}]" for k in _AXES))
        / (np.asarray(rows[f"delta_{what}_dt"], np.float64)[:, None] * 1e-6)
        for what in ("angle", "velocity")
    )
    return sampled_us(rows), w, sampled_us(rows), f


def _combined(rows: Any) -> tuple[Int64, Float64, Int64, Float64]:
    t = np.asarray(rows["timestamp"]).astype(np.int64)
    relative = np.asarray(rows["accelerometer_timestamp_relative"]).astype(np.int64)
    has_accel = relative != _RELATIVE_MISSING
    w = _vectors(rows, tuple(f"gyro_rad[{k}]" for k in _AXES))
    f = _vectors(rows, tuple(f"accelerometer_m_s2[{k}]" for k in _AXES))
    return t, w, (t + relative)[has_accel], f[has_accel]


def _further(
    data: Mapping[tuple[str, int], Any], clock: BootClock
) -> tuple[list[FurtherSamples], list[Event]]:
    """Return the samples of barometers and magnetometers, a table for each instance."""
    tables: list[FurtherSamples] = []
    events: list[Event] = []
    for (name, instance), rows in data.items():
        if name not in FURTHER:
            continue
        kind, columns, unit = FURTHER[name]
        missing = [column for column in columns if column not in rows]
        if missing:
            detail = f"topics not read: {name}, without the column '{missing[0]}'"
            events.append(Event(None, "ulog_not_used", detail))
            continue
        t_us, values = sampled_us(rows), unit * _vectors(rows, columns)
        near = clock.is_near(t_us)
        samples, more_events = further_samples(kind, f"{name}:{instance}", clock.gps_ns(t_us), values, near)
        tables += samples
        events += more_events
    return tables, events


# --------------------------------------------------------------------------------------------------------------- raw


def _raw(data: Mapping[tuple[str, int], Any], path: Path) -> tuple[ReceiverLog | None, list[Event]]:
    """Return the content of the receiver's own bytes, None if none were dumped or they are not UBX."""
    rows = [d for (name, _), d in data.items() if name == DUMP]
    if not rows:
        return None, []
    streams: dict[int, bytes] = {}
    for dump in rows:
        width = sum(name.startswith("data[") for name in dump)
        if not {"len", *(f"data[{k}]" for k in range(width))} <= set(dump) or not width:
            return None, [Event(None, "ulog_damaged", "gps_dump without its columns")]
        values = np.column_stack([np.asarray(dump[f"data[{k}]"]) for k in range(width)]).astype(np.uint8)
        sent = np.asarray(dump["len"]).astype(np.int64)
        number = np.asarray(dump.get("instance", np.zeros(len(sent)))).astype(np.int64)
        inside = (np.arange(width) < (sent & ~_TO_DEVICE)[:, None]) & (sent & _TO_DEVICE == 0)[:, None]
        for instance in np.unique(number).tolist():
            mine = number == instance
            streams[instance] = streams.get(instance, b"") + values[mine][inside[mine]].tobytes()
    longest = max(streams, key=lambda k: len(streams[k]))
    others = {k: len(v) for k, v in streams.items() if k != longest and v}
    events = [
        Event(None, "ulog_not_used", f"gps_dump of receiver {k}, {n} bytes, not read")
        for k, n in others.items()
    ]
    try:
        return read_ubx_bytes([(path, streams[longest])]), events
    except InputError as error:
        detail = f"gps_dump of receiver {longest}, {len(streams[longest])} bytes, not read: {error.message}"
        return None, [*events, Event(None, "ulog_not_used", detail)]
