"""The stream of messages: its form, and that no reader can hold up the filter."""

from __future__ import annotations

import json
import socket
import time
from functools import cache
from typing import Any

import numpy as np
import pytest

from insgnss.aiding.stream import FIELDS, VERSION, AidingStream, decode, encode, messages_of
from insgnss.aiding.table import AidingTable, compute_aiding
from insgnss.errors import ConfigError
from tests.aiding.exact import correlated_covariance, exact_run, one_covariance, setup, sky_arcs, turning
from tests.runs.scenes import START_S, WEEK

LOOPBACK = "127.0.0.1"
TIMES_S = 14.0 + 0.01 * np.arange(20)


@cache
def aided(**changes: Any) -> AidingTable:
    """Return 20 times of 11 satellites."""
    run = exact_run(turning(), TIMES_S)
    return compute_aiding(
        setup(**changes), sky_arcs(), run.trace, run.imu, one_covariance(run, correlated_covariance())
    )


def test_message_holds_what_the_table_holds_in_the_documented_order() -> None:
    columns = aided().columns(WEEK)
    messages = [decode(encode(m)) for m in messages_of(aided(), WEEK)]

    assert list(messages[0]) == ["aiding", "n", "week", "time_s", "age_s", "satellites"]
    assert [m["n"] for m in messages] == list(range(20))
    assert messages[3]["time_s"] == pytest.approx(START_S + 14.03, abs=1e-6)
    rows = [row for m in messages for row in m["satellites"]]
    assert [row[0] for row in rows] == [aided().sv_names[k] for k in columns["sv"]]
    for i, name in enumerate(FIELDS[1:], 1):
        np.testing.assert_allclose([row[i] for row in rows], columns[name], rtol=1e-11)


def test_number_not_known_is_null() -> None:
    run = exact_run(turning(), TIMES_S[:1])
    late = one_covariance(run, correlated_covariance(), age_s=-1.0)
    table = compute_aiding(setup(), sky_arcs(), run.trace, run.imu, late)
    (message,) = messages_of(table, WEEK)

    row = dict(zip(FIELDS, message["satellites"][0], strict=True))
    assert row["sd_range_rate_mps"] is None
    assert b"NaN" not in encode(message)


def test_function_gets_every_message_and_cannot_end_the_filter() -> None:
    taken: list[Any] = []

    def difficult(message: Any) -> None:
        if message["n"] == 5:
            raise RuntimeError("no")
        taken.append(message["n"])

    with AidingStream(difficult) as stream:
        stream.send(aided(), WEEK)
        stream.send(aided(), WEEK)

    assert taken == [*range(5), *range(6, 40)]
    assert stream.dropped == 1
    assert [e.kind for e in stream.events] == ["aiding_callback", "aiding_dropped", "aiding_dropped"]


def test_udp_reader_gets_one_line_in_each_datagram() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as reader:
        reader.bind((LOOPBACK, 0))
        reader.settimeout(5.0)
        with AidingStream(reader.getsockname()) as stream:
            stream.send(aided(), WEEK)
            lines = [reader.recv(65_536) for _ in range(20)]

    assert [json.loads(line)["n"] for line in lines] == list(range(20))
    assert all(line.count(b"\n") == 1 and line.endswith(b"\n") for line in lines)
    assert json.loads(lines[0])["aiding"] == VERSION
    assert stream.dropped == 0


def test_udp_without_a_reader_drops_and_does_not_wait() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as closed:
        closed.bind((LOOPBACK, 0))
        address = closed.getsockname()
    messages_of(aided(), WEEK)  # compiled and warm
    with AidingStream(address) as stream:
        begin = time.perf_counter()
        for _ in range(5):
            stream.send(aided(), WEEK)
        took_s = time.perf_counter() - begin

    # the system tells of a refused datagram with the next one: every second is lost for sure
    assert 50 <= stream.dropped <= 100
    assert stream.events[0].kind == "aiding_dropped"
    assert f"{stream.dropped} of 100" in stream.events[-1].detail
    assert took_s < 2.0


def test_tcp_readers_get_whole_lines_from_when_they_connect() -> None:
    with AidingStream((LOOPBACK, 0), "tcp") as stream:
        stream.send(aided(), WEEK)  # nobody there: nothing to drop
        with (
            socket.create_connection(stream.address) as first,
            socket.create_connection(stream.address) as second,
        ):
            stream.send(aided(), WEEK)
            lines = [read_lines(reader, 20) for reader in (first, second)]

    for of_reader in lines:
        assert [decode(line)["n"] for line in of_reader] == list(range(20, 40))
    assert stream.dropped == 0


def read_lines(reader: socket.socket, count: int) -> list[bytes]:
    """Return that many lines."""
    reader.settimeout(5.0)
    with reader.makefile("rb") as file:
        return [file.readline() for _ in range(count)]


def test_slow_tcp_reader_loses_whole_messages_and_holds_up_nobody() -> None:
    with AidingStream((LOOPBACK, 0), "tcp", backlog_bytes=8192) as stream:
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as slow:
            slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            slow.connect(stream.address)
            begin = time.perf_counter()
            while stream.dropped == 0 and stream.sent < 20_000:
                stream.send(aided(), WEEK)
            took_s = time.perf_counter() - begin
            sent = stream.sent
            assert stream.dropped > 0
            assert "aiding_dropped" in [e.kind for e in stream.events]
            numbers = [-1]
            slow.settimeout(1.0)
            with slow.makefile("rb") as file:
                # while it reads, the next messages come through again, behind a hole
                while len(numbers) <= sent + 100 and np.diff(numbers[-2:]).max(initial=1) == 1:
                    numbers.append(decode(file.readline())["n"])
                    if len(numbers) % 20 == 0:
                        stream.send(aided(), WEEK)

    assert took_s < 1.0 + sent * 2e-3  # the encoding alone
    assert numbers[:-1] == list(range(-1, len(numbers) - 2)), "whole lines in their order up to the hole"
    assert numbers[-1] > numbers[-2] + 1, "what was dropped leaves a hole in the numbers"


def test_reader_that_goes_is_told_and_forgotten() -> None:
    with AidingStream((LOOPBACK, 0), "tcp") as stream:
        reader = socket.create_connection(stream.address)
        stream.send(aided(), WEEK)
        reader.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\x01\x00\x00\x00\x00\x00\x00\x00")
        reader.close()
        for _ in range(20):
            stream.send(aided(), WEEK)

    details = [e.detail for e in stream.events if e.kind == "aiding_reader"]
    assert len(details) == 2
    assert details[1].endswith("disconnected")


def test_address_in_use_is_an_error_with_advice() -> None:
    with AidingStream((LOOPBACK, 0), "tcp") as stream, pytest.raises(ConfigError, match="free port"):
        AidingStream(stream.address, "tcp")


def test_line_of_another_version_is_refused() -> None:
    with pytest.raises(ConfigError, match="version 1"):
        decode(b'{"aiding":2}\n')
    with pytest.raises(ConfigError, match="not an aiding message"):
        decode(b'{"aiding":1,')
