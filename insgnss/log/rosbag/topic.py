"""A topic of a bag: its messages as objects with the fields of their type, and their times."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.gpstime import unix_to_gps_ns
from insgnss.tables import Event, Int64

Decoded = list[tuple[int, Any]]  # log time [ns], message
_EARLIEST_S: Final = 1_000_000_000  # Unix time of the year 2001: earlier stamps count from a start
_LATEST_S: Final = 6_000_000_000


@dataclass
class Topic:
    """One topic: the name of its messages' type, and the messages that were asked for."""

    name: str
    kind: str  # "sensor_msgs/msg/Imu"; of messages that hold one in a field, the field's
    decode: Callable[[bytes], Any] | None  # None where the messages' encoding is unknown
    count: int = 0
    messages: list[tuple[int, bytes]] = field(default_factory=list)  # log time [ns], content

    def take(self, t_ns: int, data: bytes | memoryview) -> None:
        """Count a message, and keep it if it can be decoded."""
        self.count += 1
        if self.decode is not None:
            self.messages.append((t_ns, bytes(data)))

    def decoded(self, events: list[Event]) -> Decoded:
        """Return the messages as objects with the fields of their type; those that cannot be are counted."""
        messages, failed = [], 0
        for t_ns, data in self.messages:
            try:
                messages.append((t_ns, None if self.decode is None else self.decode(data)))
            except Exception:  # what damaged bytes raise within a library is of every kind
                failed += 1
        if failed:
            events.append(
                Event(None, "mcap_damaged", f"{self.name}: {failed} message(s) not decoded left out")
            )
        return [(t_ns, message) for t_ns, message in messages if message is not None]


def full_kind(kind: str) -> str:
    """Return a type's name as ROS 2 writes it: "sensor_msgs/Imu" is "sensor_msgs/msg/Imu"."""
    package, _, plain = kind.rpartition("/")
    return f"{package.removesuffix('/msg')}/msg/{plain}" if package else kind


def kind_within(
    definition: str, kind: str, wanted: Collection[str], within: Collection[str]
) -> tuple[str, str]:
    """Return the type to read in messages of a type, and the field that holds it ("" for the message itself).

    Parameters
    ----------
    definition : of the message's type, those of its fields' types below
    within : types that are also read where a message of another type holds one in a field of its own
    """
    if kind in wanted:
        return kind, ""
    own = definition.split("\n===")[0]
    lines = (line.partition("#")[0].split() for line in own.splitlines())
    fields = [(full_kind(words[0]), words[1]) for words in lines if len(words) == 2]
    fitting = [(part, name) for part, name in fields if part in within]
    return fitting[0] if len(fitting) == 1 else (kind, "")


def decoder_of(decode: Callable[[bytes], Any], part: str) -> Callable[[bytes], Any]:
    """Return the decoder of a field of messages, of the messages themselves where none is named."""
    return partial(_part, decode, part) if part else decode


def _part(decode: Callable[[bytes], Any], name: str, data: bytes) -> Any:
    """Return a field of a message, with the message's stamp where it has none of its own."""
    message = decode(data)
    value = getattr(message, name)
    if not (value.header.stamp.sec or value.header.stamp.nanosec) and hasattr(message, "header"):
        value.header = message.header
    return value


def stamps(topic: Topic, messages: Decoded, events: list[Event]) -> Int64:
    """Return the GPS time of each message's stamp, -1 for an invalid date."""
    seconds = np.array([m.header.stamp.sec for _, m in messages], np.int64)
    nanos = np.array([m.header.stamp.nanosec for _, m in messages], np.int64)
    good = (seconds > _EARLIEST_S) & (seconds < _LATEST_S) & (nanos < NS_PER_S)
    if not good.all():
        detail = f"{topic.name}: {int((~good).sum())} message(s) with an invalid time stamp (simulated time?) left out"
        events.append(Event(None, "mcap_time_unknown", detail))
    t_ns = np.full(len(messages), -1, np.int64)
    t_ns[good] = unix_to_gps_ns(seconds[good] * NS_PER_S + nanos[good])
    return t_ns
