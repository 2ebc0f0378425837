"""Aiding as it is computed: to a function, or as lines of text over UDP or TCP to hardware in the loop.

The message, version 1: one line for each output time, a JSON object without line breaks, ASCII, ended by a newline;
over UDP one datagram holds one line. Its keys, always in this order:

| key | what |
|-----|------|
| aiding | version of the message, 1 |
| n | number of the message, from 0 on; a dropped message leaves a gap |
| week, time_s | GPS week and its seconds, the time of use |
| age_s | time of use less the inertial sample |
| satellites | array, one array of numbers for each satellite as ``FIELDS`` names them, the name first |

``FIELDS`` with units: sv; range_rate [m/s], range_acceleration [m/s^2], doppler [Hz], doppler_rate [Hz/s] at the
carrier, RINEX sign; pseudorange [m]; code_delay_rate [s/s]; then one sigma of range rate, range acceleration, Doppler,
Doppler rate, pseudorange, units as before. A number that is not known is null. The version rises with any change of
key, order or unit; a reader ignores further keys at the end.

The filter never waits: sockets do not block. A datagram that the system does not take, and a line for a TCP reader
whose backlog is full, is dropped whole, counted, and reported by an event when dropping begins. Lines are never cut in
two.
"""

from __future__ import annotations

import json
import math
import socket
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt

from insgnss.aiding.table import AidingTable
from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.errors import ConfigError
from insgnss.tables import Event

VERSION: Final = 1
FIELDS: Final = (
    "sv",
    "range_rate_mps",
    "range_acceleration_mps2",
    "doppler_hz",
    "doppler_rate_hz_per_s",
    "pseudorange_m",
    "code_delay_rate_s_per_s",
    "sd_range_rate_mps",
    "sd_range_acceleration_mps2",
    "sd_doppler_hz",
    "sd_doppler_rate_hz_per_s",
    "sd_pseudorange_m",
)
BACKLOG_BYTES: Final = 65_536  # of one TCP reader: half a second of 12 satellites at 100 Hz
_DIGITS: Final = 12  # of a number: 1e-5 m of a pseudorange, 1e-9 m/s of a rate

Message = dict[str, Any]
Address = tuple[str, int]
Protocol = Literal["udp", "tcp"]


def messages_of(table: AidingTable, week: int, first_number: int = 0) -> list[Message]:
    """Return the messages of a table, one for each of its times that has a satellite."""
    columns = table.columns(week)
    names = np.array(table.sv_names, dtype=object)[columns["sv"]]
    values = [_rounded(columns[name]) for name in FIELDS[1:]]
    rows_of_time = np.repeat(np.diff(table.spans.first_satellite), np.diff(table.spans.first_time))
    first = np.concatenate([[0], np.cumsum(rows_of_time)])
    messages: list[Message] = []
    for begin, end in pairwise(first.tolist()):
        if begin == end:
            continue
        satellites = [[names[i], *(column[i] for column in values)] for i in range(begin, end)]
        message = {
            "aiding": VERSION,
            "n": first_number + len(messages),
            "week": week,
            "time_s": round(float(columns["time_s"][begin]), 9),
            "age_s": round(float(columns["age_s"][begin]), 9),
            "satellites": satellites,
        }
        messages.append(message)
    return messages


def _rounded(values: npt.NDArray[Any]) -> list[float | None]:
    """Return numbers of as many digits as they have, None for those not known."""
    return [float(f"{v:.{_DIGITS}g}") if math.isfinite(v) else None for v in values.tolist()]


def encode(message: Message) -> bytes:
    """Return the line of a message."""
    return json.dumps(message, separators=(",", ":"), allow_nan=False).encode("ascii") + b"\n"


def decode(line: bytes) -> Message:
    """Return the message of a line.

    Raises
    ------
    ConfigError : it is not a message, or has another version
    """
    try:
        message = json.loads(line)
    except ValueError as error:
        raise ConfigError(
            "this line is not an aiding message", advice="read whole lines: one ends at each newline"
        ) from error
    if not isinstance(message, dict) or message.get("aiding") != VERSION:
        raise ConfigError(f"this line is not an aiding message of version {VERSION}")
    return message


@dataclass
class _Reader:
    """A TCP reader and its pending bytes."""

    connection: socket.socket
    backlog: bytearray = field(default_factory=bytearray)


class AidingStream:
    """Sends each output: ``stream.send(table, week)`` from a live filter, ``stream.close()`` at its end.

    With a function, it is called with each message; what it raises is counted as a drop. With an address, the lines are
    sent there by UDP, or TCP readers that connect there (at any time, any number) get them from then on. ``events``
    says when dropping began and how many were dropped, ``dropped`` counts the messages (of TCP: summed over the
    readers).
    """

    def __init__(
        self,
        to: Callable[[Message], None] | Address,
        protocol: Protocol = "udp",
        backlog_bytes: int = BACKLOG_BYTES,
    ) -> None:
        """Open the stream.

        Parameters
        ----------
        to : a function, or host and port; port 0 lets the system choose the TCP port (see ``address``)
        protocol : "udp" or "tcp", of an address
        backlog_bytes : the most that a slow TCP reader may be behind

        Raises
        ------
        ConfigError : the address cannot be used
        """
        self.events: list[Event] = []
        self.dropped = 0
        self.sent = 0
        self._dropping = False
        self._backlog_bytes = backlog_bytes
        self._readers: list[_Reader] = []
        self._call = to if callable(to) else None
        self._socket: socket.socket | None = None
        self._protocol = protocol
        if not callable(to):
            self._socket = _opened(to, protocol)
            self.address: Address = to if protocol == "udp" else self._socket.getsockname()[:2]

    def __enter__(self) -> AidingStream:
        """Return the stream itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the stream."""
        self.close()

    def send(self, table: AidingTable, week: int) -> None:
        """Send all times of a table; returns at once, whatever the readers do."""
        for message in messages_of(table, week, self.sent):
            self.sent += 1
            dropped = self._hand_on(message)
            self.dropped += dropped
            if dropped and not self._dropping:
                t_ns = int(table.t_ns[0])
                self.events.append(
                    Event(t_ns, "aiding_dropped", f"message {message['n']} was not taken: dropped")
                )
            self._dropping = dropped > 0

    def close(self) -> None:
        """Close the sockets; bytes still pending for TCP readers are lost. Reports the number of dropped messages."""
        for reader in self._readers:
            reader.connection.close()
        self._readers = []
        if self._socket is not None:
            self._socket.close()
            self._socket = None
        if self.dropped:
            detail = f"{self.dropped} of {self.sent} aiding messages were dropped"
            self.events.append(Event(None, "aiding_dropped", detail))

    def _hand_on(self, message: Message) -> int:
        """Return how many readers did not get the message."""
        if self._call is not None:
            try:
                self._call(message)
            except Exception as error:  # the reader's fault must not end the filter
                self.events.append(
                    Event(_time_ns(message), "aiding_callback", f"{type(error).__name__}: {error}")
                )
                return 1
            return 0
        if self._socket is None:
            return 1
        line = encode(message)
        return self._datagram(line) if self._protocol == "udp" else self._lines(line)

    def _datagram(self, line: bytes) -> int:
        assert self._socket is not None
        try:
            self._socket.send(line)
        except OSError:  # no listener, no room, or longer than a datagram can be
            return 1
        return 0

    def _lines(self, line: bytes) -> int:
        """Append the line to each reader's backlog that has room, and send as much as possible."""
        self._accept()
        dropped = 0
        for reader in list(self._readers):
            if not self._flush(reader):
                continue
            if len(reader.backlog) + len(line) > self._backlog_bytes:
                dropped += 1
                continue
            reader.backlog += line
            self._flush(reader)
        return dropped

    def _accept(self) -> None:
        """Take all readers that wait to be let in."""
        assert self._socket is not None
        while True:
            try:
                connection, peer = self._socket.accept()
            except OSError:  # no reader is waiting
                return
            connection.setblocking(False)
            self._readers.append(_Reader(connection))
            self.events.append(
                Event(None, "aiding_reader", f"{peer[0]}:{peer[1]} connected to read the aiding")
            )

    def _flush(self, reader: _Reader) -> bool:
        """Send as much of the backlog as the system takes; return whether the reader is still there."""
        try:
            while reader.backlog:
                del reader.backlog[: reader.connection.send(reader.backlog)]
        except BlockingIOError:
            return True
        except OSError:
            reader.connection.close()
            self._readers.remove(reader)
            self.events.append(Event(None, "aiding_reader", "a reader of the aiding disconnected"))
            return False
        return True


def _time_ns(message: Message) -> int | None:
    """Return the time of use of a message, GPS time."""
    week_ns = int(message["week"]) * NS_PER_WEEK
    return week_ns + round(float(message["time_s"]) * NS_PER_S)


def _opened(address: Address, protocol: Protocol) -> socket.socket:
    """Return a socket that does not block: connected to a UDP address, or listening at a TCP one."""
    kind = socket.SOCK_DGRAM if protocol == "udp" else socket.SOCK_STREAM
    opened = socket.socket(socket.AF_INET, kind)
    try:
        if protocol == "udp":
            opened.connect(address)
        else:
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            opened.bind(address)
            opened.listen()
        opened.setblocking(False)
    except (OSError, OverflowError) as error:
        opened.close()
        raise ConfigError(
            f"the aiding cannot be sent to {address[0]}:{address[1]} ({protocol}): {error}",
            advice="name a free port of this machine, such as 127.0.0.1:5555",
        ) from error
    return opened
