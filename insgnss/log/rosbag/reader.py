"""ROS 2 bags (MCAP) become tables: messages of sensor_msgs, raw GNSS in messages of u-blox drivers or as bytes.

Of sensor_msgs Imu, NavSatFix, FluidPressure and MagneticField are read, of the last two the topic with most messages.
GPSFix (gps_msgs) is read in place of NavSatFix, or gives the velocities of its fixes.
Raw measurements are read from ublox_msgs/RxmRAWX with RxmSFRBX, ublox_ubx_msgs/UBXRxmRawx with UBXRxmSfrbx, and from
bytes (std_msgs/UInt8MultiArray, rtcm_msgs/Message, mavros_msgs/RTCM) that are UBX or RTCM 3. All other topics are
named. An Imu or NavSatFix may also be a field of a driver's own message. Stamps are the computer's UTC: how far they
are from the receiver's time no bag says. Axes are ROS's, forward, left, up (REP-103), unless gravity shows z downwards.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np

from insgnss.errors import InputError
from insgnss.log.further_samples import BAROMETER, MAGNETOMETER, FurtherKind, FurtherSamples, further_samples
from insgnss.log.receiver import ReceiverLog, RtcmOrigin, SolutionFrom, assembled
from insgnss.log.rosbag.fixes import GPSFIX, NAVSATFIX, fixes
from insgnss.log.rosbag.mcap_file import Topic, read_topics, stamps
from insgnss.log.rosbag.raw import BYTES, RAW_KINDS, SUBFRAME_KINDS, is_rtcm, is_stream, raw_log
from insgnss.log.rtcm.origin import judged_origin
from insgnss.log.sensor_pairs import paired
from insgnss.tables import Event, ImuTable, ReferenceTable

IMU: Final = "sensor_msgs/msg/Imu"
PRESSURE: Final = "sensor_msgs/msg/FluidPressure"
FIELD: Final = "sensor_msgs/msg/MagneticField"
_READ: Final = frozenset((IMU, NAVSATFIX, GPSFIX, PRESSURE, FIELD, *RAW_KINDS, *SUBFRAME_KINDS, *BYTES))
_AXES: Final = ("+x", "-y", "-z")  # forward, left, up -> forward, right, down
_AXES_DOWN: Final = ("+x", "+y", "+z")
_UPSIDE_DOWN_MPS2: Final = 5.0  # half of gravity
_NOT_MEASURED: Final = -1.0  # first element of a covariance
_Table = TypeVar("_Table")


def read_rosbag(
    path: Path, topics: Mapping[str, str] | None = None, rtcm: RtcmOrigin | None = None
) -> ReceiverLog:
    """Read a bag (plain or gzipped).

    Parameters
    ----------
    topics : "imu", "gnss", "reference" -> topic, where several would do
    rtcm : whose the measurements of an RTCM topic are, None if unknown; this receiver's if the topic is named in
        ``topics``

    Raises
    ------
    InputError : the libraries are not installed, the file is not a bag or holds no usable data, or several topics
        would do and none is named
    """
    by_name, events = read_topics(path, _READ, (IMU, NAVSATFIX))
    if not events and not any(topic.count for topic in by_name.values()):
        advice = "nothing was published while it was recorded: compare with 'ros2 topic hz' before the next recording"
        raise InputError("the bag holds no message", file=path, advice=advice)
    wanted = dict(topics or {})
    for part, name in wanted.items():
        if name not in by_name:
            raise InputError(
                f"the bag has no topic '{name}'",
                file=path,
                key=f"--topic {part}",
                advice=f"it has {_listed(by_name.values())}",
            )
    with np.errstate(all="ignore"):
        imu_topic = _one(by_name, "imu", (IMU,), wanted, path)
        imu = _sound(imu_topic, events, lambda topic: _inertial(topic, events))
        raw_topic = _one(by_name, "gnss", (*RAW_KINDS, *BYTES), wanted, path)
        subframes = [topic for topic in by_name.values() if topic.kind in SUBFRAME_KINDS]
        raw = None if raw_topic is None else raw_log(raw_topic, subframes, path, events)
        fix_topic, beside = _fix_topics(by_name, wanted, path)
        solved = _sound(fix_topic, events, lambda topic: fixes(topic, beside, events))
        own, inertial = solved or (None, False)
        if raw is not None and raw_topic is not None and is_rtcm(raw_topic):
            declared = rtcm or ("own" if "gnss" in wanted else None)
            raw = _of_the_receiver(raw, own, declared, raw_topic, events)
        further = [_sound(topic, events, lambda topic: _further(topic, events)) for topic in by_name.values()]
        samples = [each for some in further for each in some or []]
    topics_read = (imu_topic, raw_topic, fix_topic, beside, *subframes)
    used = {topic.name for topic in topics_read if topic is not None} | {each.source for each in samples}
    others = [topic for topic in by_name.values() if topic.name not in used and topic.count]
    if others:
        events.append(Event(None, "mcap_not_used", f"topics not read: {_listed(others)}"))
    advice = f"record {IMU}, {NAVSATFIX}, ublox_msgs/msg/RxmRAWX with RxmSFRBX, or the receiver's bytes"
    log = assembled(path, raw, imu, own, events, further=samples, holder="bag", advice=advice)
    source: SolutionFrom = "filter" if inertial else "satellites"
    return replace(log, imu_axes=_axes(imu, imu_topic, log.events), solution_from=source)


def _sound(topic: Topic | None, events: list[Event], read: Callable[[Topic], _Table]) -> _Table | None:
    """Return what a topic is read as; None without one, or, with an event, where its messages belie their type."""
    if topic is None:
        return None
    try:
        return read(topic)
    except (AttributeError, IndexError, TypeError, ValueError, OverflowError) as error:
        detail = f"{topic.name} ({topic.kind}) not read: its fields are not those of its type: {error}"
        events.append(Event(None, "mcap_not_used", detail))
    return None


def _listed(topics: Any) -> str:
    return ", ".join(f"{topic.count} {topic.name} ({topic.kind or 'no type'})" for topic in topics)


def _one(
    by_name: Mapping[str, Topic], part: str, kinds: tuple[str, ...], wanted: Mapping[str, str], path: Path
) -> Topic | None:
    """Return the topic of these types that is named or alone."""
    if part in wanted:
        topic = by_name[wanted[part]]
        if topic.kind not in kinds:
            raise InputError(
                f"the topic '{topic.name}' is of the type {topic.kind or 'unknown'}, which is not read as {part}",
                file=path,
                key=f"--topic {part}",
                advice=f"name a topic of {', '.join(kinds)}",
            )
        return topic
    fitting = [topic for topic in by_name.values() if topic.kind in kinds and topic.messages]
    if len(fitting) > 1:
        fitting = [topic for topic in fitting if topic.kind not in BYTES or is_stream(topic)]
    if len(fitting) > 1:
        raise InputError(
            f"{len(fitting)} topics could be the {part}: {_listed(fitting)}",
            file=path,
            advice=f"name the one to read: --topic {part}={fitting[0].name}",
        )
    return fitting[0] if fitting else None


def _fix_topics(
    by_name: Mapping[str, Topic], wanted: Mapping[str, str], path: Path
) -> tuple[Topic | None, Topic | None]:
    """Return the topic of fixes, and one of GPSFix beside it that states the velocities of the same fixes.

    NavSatFix comes first: its heights are above the ellipsoid.

    Raises
    ------
    InputError : there are several of one type, and none is named
    """
    if "reference" in wanted:
        topic = _one(by_name, "reference", (NAVSATFIX, GPSFIX), wanted, path)
    else:
        topic = _one(by_name, "reference", (NAVSATFIX,), wanted, path) or _one(
            by_name, "reference", (GPSFIX,), wanted, path
        )
    others = [each for each in by_name.values() if each.kind == GPSFIX and each.messages]
    if topic is None or topic.kind != NAVSATFIX or len(others) != 1:
        return topic, None
    return topic, others[0]


def _of_the_receiver(
    raw: ReceiverLog,
    fixes: ReferenceTable | None,
    declared: RtcmOrigin | None,
    topic: Topic,
    events: list[Event],
) -> ReceiverLog | None:
    """Return the measurements of an RTCM topic, None if they are a base station's."""
    name = f"{topic.name} ({topic.kind}): its RTCM messages"
    origin, event = judged_origin(
        raw, fixes, declared, name, "ublox_msgs/msg/RxmRAWX or the receiver's bytes"
    )
    if not (origin == "own" and declared == "own"):  # a topic that is named needs no event
        events.append(event)
    return raw if origin == "own" else None


def _inertial(topic: Topic, events: list[Event]) -> ImuTable | None:
    messages = topic.decoded(events)
    rates = [m for m in messages if m[1].angular_velocity_covariance[0] != _NOT_MEASURED]
    forces = [m for m in messages if m[1].linear_acceleration_covariance[0] != _NOT_MEASURED]
    parts = []
    for chosen, name in ((rates, "angular_velocity"), (forces, "linear_acceleration")):
        vectors = [getattr(m, name) for _, m in chosen]
        values = np.array([(v.x, v.y, v.z) for v in vectors], np.float64).reshape(-1, 3)
        t_ns = (
            stamps(topic, chosen, events if name == "angular_velocity" else [])
            if chosen
            else np.zeros(0, np.int64)
        )
        parts.append((t_ns[t_ns >= 0], values[t_ns >= 0]))
    if messages and not (rates or forces):
        detail = f"{topic.name}: by its covariances, {len(messages)} message(s) hold neither rates nor forces"
        events.append(Event(None, "imu_incomplete", detail))
    imu, more_events = paired(*parts[0], *parts[1], topic.name)
    events += more_events
    if imu is not None:
        detail = (
            f"{topic.name}: stamps of the computer's clock (UTC); its offset from the receiver's is unknown"
        )
        events.append(Event(int(imu.t_ns[0]), "imu_time_estimated", detail))
    return imu


def _further(topic: Topic, events: list[Event]) -> list[FurtherSamples]:
    """Return the samples of a topic of pressures or magnetic fields, none for another topic."""
    if topic.kind not in (PRESSURE, FIELD):
        return []
    messages = topic.decoded(events)
    t_ns = stamps(topic, messages, events)
    kind: FurtherKind
    if topic.kind == PRESSURE:
        kind, values = BAROMETER, 0.01 * np.array([[m.fluid_pressure] for _, m in messages], np.float64)
    else:
        fields = [m.magnetic_field for _, m in messages]
        kind, values = MAGNETOMETER, 1e6 * np.array([(v.x, v.y, v.z) for v in fields], np.float64)
    dated = t_ns >= 0  # the others have been told
    samples, more_events = further_samples(
        kind, topic.name, t_ns[dated], values.reshape(len(t_ns), -1)[dated]
    )
    events += more_events
    return samples


def _axes(imu: ImuTable | None, topic: Topic | None, events: list[Event]) -> tuple[str, str, str]:
    """Return the sensor axes that point forward, right, down: by REP-103, unless gravity shows z downwards."""
    if imu is None or topic is None or float(np.median(imu.f_b[:, 2])) > -_UPSIDE_DOWN_MPS2:
        return _AXES
    detail = f"{topic.name}: the specific force points along -z: taken for forward, right, down, not for REP-103's axes"
    events.append(Event(int(imu.t_ns[0]), "imu_axes_downwards", detail))
    return _AXES_DOWN
