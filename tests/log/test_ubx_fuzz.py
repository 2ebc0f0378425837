"""Whatever happens to a UBX file, reading gives tables that hold together or an error of the package's own."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insgnss.constants import NS_PER_S
from insgnss.errors import InsGnssError
from insgnss.log.ubx.reader import read_ubx
from tests.log.sound import check_log
from tests.log.test_messages_beidou import d1_frame
from tests.log.test_messages_glonass import strings
from tests.log.test_ubx import NMEA, RTCM, SET
from tests.log.test_ubx_imu import TICK_S, meas_frame, raw_frame
from tests.log.ubx_writing import TOW_S, WEEK, frame, measurement, rawx, sfrbx

SLICE = 40_000
PIECES = st.one_of(
    st.binary(min_size=1, max_size=16),
    st.sampled_from(
        [b"\xb5\x62", b"\xb5", NMEA, RTCM, b"\xb5\x62\x02\x15\xff\xff", b"\0" * 40, b"\xff" * 40, rawx()]
    ),
)
DAMAGES = st.lists(
    st.tuples(st.sampled_from(["over", "into", "end", "start", "flip"]), st.floats(0.0, 1.0), PIECES),
    max_size=8,
)
KINDS = st.sampled_from([0x0215, 0x0213, 0x1003, 0x1002, 0x0D03, 0x0107])


def small_log() -> bytes:
    """Return a log with every kind of message that is read."""
    pieces = [NMEA]
    glonass = [
        sfrbx(6, 7, 0, [*struct.unpack(">III", (s << 11).to_bytes(12, "big")), 5], freq=12) for s in strings()
    ]
    for k in range(8):
        rows = [measurement(sv=n, lock=1000 * k) for n in range(1, 4)] + [measurement(gnss=6, sv=7, freq=12)]
        pieces.append(rawx(TOW_S + k, rows))
        pieces += [raw_frame(round((k + j / 5) / TICK_S)) for j in range(5)]
        pieces += [meas_frame(1000 * k), RTCM]
        pieces.append(glonass[k % 4])
        for n, subframe in enumerate(d1_frame()):
            info = [subframe >> 198 & 0x3FFFFFF, *[subframe >> 22 * (8 - j) & 0x3FFFFF for j in range(9)]]
            pieces.append(sfrbx(3, 21 + n % 2, 0, [info[0] << 4, *[word << 8 for word in info[1:]]]))
    pieces.append(frame(0x0D03, struct.pack("<BBHHH5I", 0, 212, 3, WEEK, WEEK, 1, 2, 3, 4, 5)))
    pieces.append(
        frame(0x0107, struct.pack("<IHBBBBBB", 408_640_000, 2025, 8, 28, 17, 30, 22, 3) + b"\0" * 80)
    )
    return b"".join(pieces)


SMALL = small_log()


def damaged(data: bytes, damages: list[tuple[str, float, bytes]]) -> bytes:
    for kind, share, piece in damages:
        at = int(share * len(data))
        if kind == "end":
            data = data[:at]
        elif kind == "start":
            data = data[at:]
        elif kind == "flip" and at < len(data):
            data = data[:at] + bytes([data[at] ^ 1 << piece[0] % 8]) + data[at + 1 :]
        else:
            data = data[:at] + piece + data[at + (len(piece) if kind == "over" else 0) :]
    return data


def assert_sound(path: Path) -> None:
    """Read the file; what comes must be tables that every user of them can take."""
    try:
        log = read_ubx([path])
    except InsGnssError:
        return
    check_log(log)
    assert log.gnss.carrier_cycles is not None and log.gnss.lli is not None
    assert (log.gnss.t_ns > 0).all() and (log.gnss.lli <= 3).all()


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz") / "log.ubx"


@pytest.fixture(scope="module")
def real(data_root: Path) -> Path:
    """Return the file, not its bytes: a report of a failure would print them."""
    file = data_root / SET / "raw" / "gnss_1730.ubx"
    if not file.is_file():
        pytest.skip(f"no real UBX file: {file} does not exist")
    return file


def test_undamaged_small_log_holds_everything(path: Path) -> None:
    path.write_bytes(SMALL)
    log = read_ubx([path])

    assert len(log.gnss.t_ns) == 32 and log.imu is not None and log.navigation is not None
    assert log.navigation.state_vectors is not None
    assert log.navigation.state_vectors.channel.tolist() == [5]
    assert log.gnss.glonass_channels == {"R07": 5}
    assert {event.kind for event in log.events} >= {"time_mark", "imu_time_estimated", "ubx_foreign_bytes"}


@pytest.mark.real_data
@settings(max_examples=75)
@given(start=st.floats(0.0, 1.0), damages=DAMAGES)
def test_slices_of_the_real_log(
    path: Path, real: Path, start: float, damages: list[tuple[str, float, bytes]]
) -> None:
    data = real.read_bytes()
    at = int(start * len(data))
    path.write_bytes(damaged(data[at : at + SLICE], damages))
    assert_sound(path)


@settings(max_examples=200)
@given(frames=st.lists(st.tuples(KINDS, st.binary(max_size=120)), max_size=12))
def test_any_payload_with_a_right_check_sum(path: Path, frames: list[tuple[int, bytes]]) -> None:
    path.write_bytes(SMALL[: len(SMALL) // 2] + b"".join(frame(*f) for f in frames) + rawx(TOW_S + 100.0))
    assert_sound(path)


@settings(max_examples=150)
@given(
    hits=st.lists(
        st.tuples(st.integers(0, 200), st.integers(0, 119), st.integers(0, 255)), min_size=1, max_size=20
    )
)
def test_damaged_payloads_with_a_right_check_sum(path: Path, hits: list[tuple[int, int, int]]) -> None:
    pieces = SMALL.split(b"\xb5\x62")[1:]
    frames = [
        (struct.unpack_from(">H", p)[0], bytearray(p[4 : 4 + struct.unpack_from("<H", p, 2)[0]]))
        for p in pieces
    ]
    for which, place, value in hits:
        payload = frames[which % len(frames)][1]
        if payload:
            payload[place % len(payload)] = value
    path.write_bytes(b"".join(frame(kind, bytes(payload)) for kind, payload in frames))
    assert_sound(path)


@settings(max_examples=100)
@given(
    words=st.lists(st.integers(0, (1 << 32) - 1), max_size=12), gnss=st.integers(0, 7), sig=st.integers(0, 10)
)
def test_any_words_of_a_broadcast_message(path: Path, words: list[int], gnss: int, sig: int) -> None:
    path.write_bytes(rawx() + sfrbx(gnss, 7, sig, words) * 2)
    assert_sound(path)


def test_messages_without_any_epoch_take_the_time_of_the_solution(path: Path) -> None:
    # a GLONASS frame tells the time of the day alone
    messages = b"".join(
        sfrbx(6, 7, 0, [*struct.unpack(">III", (s << 11).to_bytes(12, "big")), 5]) for s in strings()
    )
    solution = frame(0x0107, struct.pack("<IHBBBBBB", 408_640_000, 2025, 8, 28, 17, 30, 22, 3) + b"\0" * 80)
    navigation_part, epoch_part = path.with_name("nav.ubx"), path.with_name("obs.ubx")
    navigation_part.write_bytes(solution + messages)
    epoch_part.write_bytes(rawx())
    log = read_ubx([navigation_part, epoch_part])

    assert log.navigation is not None and log.navigation.state_vectors is not None
    t_ns = int(log.navigation.state_vectors.t_ns[0])
    assert abs(t_ns - int(log.gnss.t_ns[0])) <= 12 * 3600 * NS_PER_S
