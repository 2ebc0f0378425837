"""MCAP files' messages by their topics, read by the library ``mcap``; a cut or damaged file gives the messages before.

Chunks are unpacked here, so that one cannot grow beyond belief: at most a hundredfold, and more than 64 MB.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.errors import InputError
from insgnss.gpstime import unix_to_gps_ns
from insgnss.log.events import counted, shortened
from insgnss.log.files import MOST_TIMES, file_buffer, largest_unpacked
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
        events += counted("mcap_damaged", failed, "message(s) not decoded left out", self.name)
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
    what = "message(s) with an invalid time stamp (simulated time?) left out"
    events += counted("mcap_time_unknown", ~good, what, topic.name)
    t_ns = np.full(len(messages), -1, np.int64)
    t_ns[good] = unix_to_gps_ns(seconds[good] * NS_PER_S + nanos[good])
    return t_ns


INSTALL: Final = "pip install 'insgnss[mcap]'"
_RECORD_LIMIT: Final = 1 << 30


def read_topics(
    path: Path, wanted: Collection[str], within: Collection[str] = ()
) -> tuple[dict[str, Topic], list[Event]]:
    """Return the topics of a file (plain or gzipped), with the messages of the types that are wanted.

    Parameters
    ----------
    within : types that are also wanted where a message of another type holds one in a field of its own, as drivers do

    Raises
    ------
    InputError : the libraries are not installed, or the file is not an MCAP file
    """
    factory = _decoders(path)
    from mcap.stream_reader import StreamReader

    stream = io.BytesIO(file_buffer(path).to_pybytes())
    gathered = _RecordCollector(wanted, within, factory)
    try:
        for record in StreamReader(stream, emit_chunks=True, record_size_limit=_RECORD_LIMIT).records:
            gathered.take(record)
    except Exception as error:  # besides the library's own, struct.error, UnicodeDecodeError, ...
        if not gathered.topics:
            raise InputError(f"the MCAP file cannot be read: {type(error).__name__}: {error}", file=path,
                             advice="was the recording interrupted? try 'mcap recover'") from error  # fmt: skip
        place = f"byte {stream.tell()} of {len(stream.getbuffer())}: not read further: {type(error).__name__}"
        gathered.events.append(Event(None, "mcap_cut", place))
    return gathered.topics, shortened(gathered.events, "chunks")


def _decoders(path: Path) -> Any:
    """Return what makes decoders of ROS 2 types."""
    try:
        from mcap_ros2.decoder import DecoderFactory  # needs mcap itself
    except ImportError as error:
        raise InputError("MCAP files need mcap and mcap-ros2-support, which are not installed", file=path,
                         advice=INSTALL) from error  # fmt: skip
    return DecoderFactory()


def _decoder(
    factory: Any, topic: str, encoding: str, schema: Any, events: list[Event]
) -> Callable[[bytes], Any] | None:
    """Return the decoder of a topic's messages; None, with an event, if there is none.

    Parameters
    ----------
    schema : the name, the encoding and the data of the type's definition
    """
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            decode: Callable[[bytes], Any] | None = factory.decoder_for(encoding, schema)
    except Exception as error:  # what a damaged definition raises within the library is of every kind
        detail = f"{topic}: unknown message type: {type(error).__name__}"
        events.append(Event(None, "mcap_damaged", detail))
        return None
    if decode is None:
        detail = (
            f"{topic}: messages encoded as '{encoding}' with a definition in '{schema.encoding}' are not read"
        )
        events.append(Event(None, "mcap_not_used", detail))
    return decode


class _RecordCollector:
    """Collects topics and messages from records as they come."""

    def __init__(self, wanted: Collection[str], within: Collection[str], factory: Any) -> None:
        self.topics: dict[str, Topic] = {}
        self.events: list[Event] = []
        self._wanted, self._within, self._factory = wanted, within, factory
        self._schemas: dict[int, Any] = {}
        self._channels: dict[int, Topic] = {}

    def take(self, record: Any) -> None:
        """Take one record; a chunk's own records one by one."""
        kind = type(record).__name__
        if kind == "Chunk":
            self._chunk(record)
        elif kind == "Schema":
            self._schemas[record.id] = record
        elif kind == "Channel":
            self._channel(record)
        elif kind == "Message" and record.channel_id in self._channels:
            self._channels[record.channel_id].take(record.log_time, record.data)

    def _channel(self, record: Any) -> None:
        schema = self._schemas.get(record.schema_id)
        kind, decode = "", None
        if schema is not None:
            definition = schema.data.decode("utf-8", "replace")
            kind, part = kind_within(definition, full_kind(schema.name), self._wanted, self._within)
            if kind in self._wanted:
                decode = _decoder(self._factory, record.topic, record.message_encoding, schema, self.events)
            if decode is not None:
                decode = decoder_of(decode, part)
        self._channels[record.id] = self.topics.setdefault(record.topic, Topic(record.topic, kind, decode))

    def _chunk(self, chunk: Any) -> None:
        from mcap.stream_reader import breakup_chunk

        try:
            chunk.data, chunk.compression = _unpacked(chunk), ""
            records = breakup_chunk(chunk, validate_crc=True)
        except Exception as error:  # of three libraries
            detail = f"a chunk of {chunk.uncompressed_size} bytes left out: {type(error).__name__}: {error}"
            self.events.append(Event(None, "mcap_damaged", detail))
            return
        for record in records:
            self.take(record)


def _unpacked(chunk: Any) -> bytes:
    """Return a chunk's bytes."""
    size, most = chunk.uncompressed_size, largest_unpacked(len(chunk.data))
    if size > most:
        raise ValueError(f"it expands to more than {MOST_TIMES} times its size")
    if chunk.compression == "":
        return bytes(chunk.data)
    if chunk.compression == "lz4":
        import lz4.frame

        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size))
    if chunk.compression == "zstd":
        import zstandard

        return bytes(zstandard.ZstdDecompressor().stream_reader(chunk.data).read(size))
    raise ValueError(f"packed with '{chunk.compression}'")
