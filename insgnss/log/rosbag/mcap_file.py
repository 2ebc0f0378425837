"""MCAP files' messages by their topics, read by the library ``mcap``; a cut or damaged file gives the messages before.

Chunks are unpacked here, so that one cannot grow beyond belief: at most a hundredfold, and more than 64 MB.
"""

from __future__ import annotations

import contextlib
import io
import re
from collections import Counter
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final

from insgnss.errors import InputError
from insgnss.log.files import MOST_TIMES, file_buffer, largest_unpacked
from insgnss.log.first_events import shortened
from insgnss.tables import Event

INSTALL: Final = "pip install 'insgnss[mcap]'"
_RECORD_LIMIT: Final = 1 << 30
# "pkg/Type name"
_FIELD: Final = re.compile(r"^[ \t]*(\w+/[\w/]+)[ \t]+(\w+)[ \t]*(?:#.*)?\r?$", re.MULTILINE)


@dataclass
class Topic:
    """One topic: the name of its messages' type, and the messages that were asked for."""

    name: str
    kind: str  # "sensor_msgs/msg/Imu"; of messages that hold one in a field, the field's
    decode: Callable[[bytes], Any] | None  # None where the messages' encoding is not ROS 2's
    count: int = 0
    messages: list[tuple[int, bytes]] = field(default_factory=list)  # log time [ns], content

    def decoded(self, events: list[Event]) -> list[tuple[int, Any]]:
        """Return the messages as objects with the fields of their type; those that cannot be are counted."""
        found, failed = [], 0
        for t_ns, data in self.messages:
            try:
                found.append((t_ns, None if self.decode is None else self.decode(data)))
            except Exception:  # what damaged bytes raise within the library is of every kind
                failed += 1
        if failed:
            events.append(
                Event(None, "mcap_damaged", f"{self.name}: {failed} message(s) not decoded left out")
            )
        return [(t_ns, message) for t_ns, message in found if message is not None]


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
    try:
        from mcap.stream_reader import StreamReader
        from mcap_ros2.decoder import DecoderFactory
    except ImportError as error:
        raise InputError("MCAP files need mcap and mcap-ros2-support, which are not installed", file=path,
                         advice=INSTALL) from error  # fmt: skip
    stream = io.BytesIO(file_buffer(path).to_pybytes())
    gathered = _RecordCollector(wanted, within, DecoderFactory())
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


class _RecordCollector:
    """Collects topics and messages from records as they come."""

    def __init__(self, wanted: Collection[str], within: Collection[str], factory: Any) -> None:
        self.topics: dict[str, Topic] = {}
        self.events: list[Event] = []
        self._wanted, self._within, self._factory = wanted, within, factory
        self._schemas: dict[int, Any] = {}
        self._channels: dict[int, Topic] = {}
        self._unknown: Counter[int] = Counter()

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
            topic = self._channels[record.channel_id]
            topic.count += 1
            if topic.decode is not None:
                topic.messages.append((record.log_time, record.data))

    def _channel(self, record: Any) -> None:
        schema = self._schemas.get(record.schema_id)
        kind, part, decode = "" if schema is None else schema.name, "", None
        if schema is not None and kind not in self._wanted:
            part, kind = _only_field(schema, self._within) or ("", kind)
        if schema is not None and kind in self._wanted:
            try:
                with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
                    decode = self._factory.decoder_for(record.message_encoding, schema)
            except Exception as error:
                detail = f"{record.topic}: unknown message type: {type(error).__name__}"
                self.events.append(Event(None, "mcap_damaged", detail))
        if decode is not None and part:
            decode = partial(_part, decode, part)
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


def _only_field(schema: Any, kinds: Collection[str]) -> tuple[str, str] | None:
    """Return name and type of the one field of a type's definition that is of these kinds, None for none or several."""
    own = schema.data.decode("utf-8", "replace").split("\n===")[0]
    found = []
    for kind, name in _FIELD.findall(own):
        package, _, plain = kind.rpartition("/")
        full = f"{package.removesuffix('/msg')}/msg/{plain}"
        if full in kinds:
            found.append((name, full))
    return found[0] if len(found) == 1 else None


def _part(decode: Callable[[bytes], Any], name: str, data: bytes) -> Any:
    """Return a field of a message, with the message's stamp where it has none of its own."""
    message = decode(data)
    found = getattr(message, name)
    if not (found.header.stamp.sec or found.header.stamp.nanosec) and hasattr(message, "header"):
        found.header = message.header
    return found


def _unpacked(chunk: Any) -> bytes:
    """Return a chunk's bytes.

    Raises
    ------
    ValueError : it would grow beyond belief, or is packed in an unknown way
    """
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
