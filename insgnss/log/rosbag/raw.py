"""Raw GNSS in a bag: messages of u-blox drivers are converted back into UBX frames, raw bytes are read directly."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from insgnss.errors import InputError
from insgnss.log.receiver import ReceiverLog
from insgnss.log.rosbag.mcap_file import Topic
from insgnss.log.rtcm.reader import read_rtcm_bytes
from insgnss.log.ubx.frames import SYNC
from insgnss.log.ubx.messages import SFRBX
from insgnss.log.ubx.observations import RAWX
from insgnss.log.ubx.reader import read_ubx_bytes
from insgnss.tables import Event

RAW_KINDS: Final = ("ublox_msgs/msg/RxmRAWX", "ublox_ubx_msgs/msg/UBXRxmRawx")
SUBFRAME_KINDS: Final = ("ublox_msgs/msg/RxmSFRBX", "ublox_ubx_msgs/msg/UBXRxmSfrbx")
# Types of bytes, and the field that holds them
BYTES: Final = {
    "std_msgs/msg/UInt8MultiArray": "data",
    "std_msgs/msg/ByteMultiArray": "data",
    "rtcm_msgs/msg/Message": "message",
    "mavros_msgs/msg/RTCM": "data",
}
_RTCM_PREAMBLE: Final = b"\xd3\x00"  # with the six reserved bits of most messages
_TRACKING: Final = ("pr_valid", "cp_valid", "half_cyc", "sub_half_cyc")  # bits of trkStat from the lowest on


def is_stream(topic: Topic) -> bool:
    """Say whether the bytes of a topic may be UBX or RTCM 3."""
    stream = _stream(topic, [])
    return SYNC in stream or _RTCM_PREAMBLE in stream


def is_rtcm(topic: Topic) -> bool:
    """Say whether a topic of raw measurements is one of bytes that are read as RTCM 3."""
    return topic.kind in BYTES and not _begins_as_ubx(_stream(topic, []))


def _begins_as_ubx(stream: bytes) -> bool:
    return SYNC in stream[:4096]


def _stream(topic: Topic, events: list[Event]) -> bytes:
    return b"".join(bytes(getattr(m, BYTES[topic.kind])) for _, m in topic.decoded(events))


def raw_log(topic: Topic, subframes: Sequence[Topic], path: Path, events: list[Event]) -> ReceiverLog | None:
    """Return the measurements of a topic and the related messages, None if they cannot be read.

    Parameters
    ----------
    topic : of raw measurements or bytes
    subframes : topics of broadcast messages, for raw measurements
    """
    try:
        if topic.kind in BYTES:
            stream = _stream(topic, events)
            if _begins_as_ubx(stream):
                return read_ubx_bytes([(path, stream)])
            return read_rtcm_bytes(stream, str(path))
        frames = [(t_ns, _rawx(m)) for t_ns, m in topic.decoded(events)]
        for other in subframes:
            frames += [(t_ns, _sfrbx(m)) for t_ns, m in other.decoded(events)]
        return read_ubx_bytes([(path, b"".join(frame for _, frame in sorted(frames, key=lambda f: f[0])))])
    except InputError as error:
        events.append(Event(None, "mcap_not_used", f"{topic.name} ({topic.kind}) not read: {error.message}"))
    except (AttributeError, struct.error, TypeError, ValueError, OverflowError) as error:
        detail = f"{topic.name} ({topic.kind}) not read: its fields are not the driver's: {error}"
        events.append(Event(None, "mcap_not_used", detail))
    return None


def _first(message: Any, *names: str) -> Any:
    """Return the field that the message has of several names; drivers' versions differ."""
    for name in names:
        if hasattr(message, name):
            return getattr(message, name)
    raise AttributeError(f"no field {' or '.join(names)}")


def _rawx(message: Any) -> bytes:
    rows = list(_first(message, "meas", "rawx_data"))
    status = _first(message, "rec_stat")
    if not isinstance(status, int):
        status = int(status.leap_sec) | int(status.clk_reset) << 1
    head = struct.pack("<dHbBBB2x", message.rcv_tow, message.week, message.leap_s, len(rows), status, 1)
    return _frame(RAWX, head + b"".join(map(_measurement, rows)))


def _measurement(row: Any) -> bytes:
    tracking = row.trk_stat
    if not isinstance(tracking, int):
        tracking = sum(int(getattr(tracking, name)) << bit for bit, name in enumerate(_TRACKING))
    return struct.pack(
        "<ddfBBBBHBBBBBB",
        *(row.pr_mes, row.cp_mes, row.do_mes, row.gnss_id, row.sv_id),
        _first(row, "sig_id", "reserved0"),
        *(row.freq_id, row.locktime, max(_first(row, "cno", "c_no"), 0), 0, 0, 0, tracking, 0),
    )


def _sfrbx(message: Any) -> bytes:
    words = [int(word) for word in message.dwrd]
    signal = _first(message, "sig_id", "reserved0")
    head = struct.pack("<8B", message.gnss_id, message.sv_id, signal, message.freq_id, len(words), 0, 2, 0)
    return _frame(SFRBX, head + struct.pack(f"<{len(words)}I", *words))


def _frame(kind: int, payload: bytes) -> bytes:
    """Return a payload in a UBX frame."""
    body = struct.pack(">H", kind) + struct.pack("<H", len(payload)) + payload
    a = b = 0
    for byte in body:
        a = a + byte & 255
        b = b + a & 255
    return SYNC + body + bytes((a, b))
