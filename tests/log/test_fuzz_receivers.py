"""Receivers' files cut, overwritten and with bits turned: a sound table, or an error of the package's own."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import sidereon
from hypothesis import given, settings
from hypothesis import strategies as st

from insgnss.errors import InsGnssError
from insgnss.log.android.reader import read_android
from insgnss.log.convert import convert
from insgnss.log.detect import detect_format
from insgnss.log.receiver import ReceiverLog
from insgnss.log.rinex.observations import read_rinex_obs
from insgnss.log.sbf.reader import read_sbf
from tests.log.android_generator import ELAPSED_MINUS_TIME_NS
from tests.log.android_generator import HEADER as ANDROID_HEADER
from tests.log.android_generator import epoch as android_epoch
from tests.log.android_generator import sensor as android_sensor
from tests.log.sbf_encoder import (
    Channel,
    attitude,
    attitude_covariance,
    block,
    covariances,
    epoch,
    fix,
    satellite,
    sensor,
    time,
)
from tests.log.sound import check_log
from tests.log.test_android import SKY, T
from tests.log.test_rinex_observations import HEADER as OBS_HEADER
from tests.log.test_rinex_observations import RINEX_2_MANY
from tests.log.test_rinex_observations import epoch as rinex_epoch
from tests.log.test_sbf import bds_nav, gal_nav, gps_nav

EXAMPLES = 75
RINEX_3 = OBS_HEADER + "".join(rinex_epoch(f"{42 + k}.0000000") for k in range(6))
TEXTS = {
    "rinex 3": RINEX_3,
    "rinex 2": RINEX_2_MANY,
    "hatanaka 3": sidereon.encode_crinex(RINEX_3),
    "hatanaka 1": sidereon.encode_crinex(RINEX_2_MANY),
}
START = T + ELAPSED_MINUS_TIME_NS
ANDROID = ANDROID_HEADER + "".join(
    android_epoch(T + k * 10**9, SKY.values(), count=k // 2)
    + android_sensor("UncalGyro", START + k * 10**8, (0.1, 0.0, 0.0))
    + android_sensor("UncalAccel", START + k * 10**8, (0.0, 0.0, 9.8))
    for k in range(4)
)
SATELLITES = [
    satellite(
        k, [Channel(0, 1575.42e6, 2.3e7, 1.0, None, 40.0), Channel(2, 1227.6e6, 2.3e7, 1.0, None, 30.0)]
    )
    for k in (3, 7, 31)
]
SBF_BLOCKS = [
    *(epoch(float(k), SATELLITES) for k in range(3)),
    *(sensor(k / 10, (1.0, 0.0, 0.0), (0.0, 0.0, 9.8)) for k in range(3)),
    *(gps_nav(), bds_nav(), gal_nav(2, 1)),
    *(fix(float(k), accuracies_cm=(100, 150)) for k in range(2)),
    *(covariances(number, 0.0, (0.5, 0.25, 1.0)) for number in (5906, 5908)),
    *(attitude(float(k), 359.5) + attitude_covariance(float(k), 0.0625) for k in range(2)),
]
# A place as a share of the file, and what is put over the byte there
FLIPS = st.lists(st.tuples(st.floats(0.0, 1.0), st.integers(0, 255)), max_size=8)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz") / "file"


def check_result(read: Callable[[], ReceiverLog]) -> None:
    try:
        log = read()
    except InsGnssError:
        return
    check_log(log)


def turned(data: bytes, flips: list[tuple[float, int]], cut: float) -> bytes:
    changed = bytearray(data)
    for share, value in flips:
        changed[min(int(share * len(data)), len(data) - 1)] = value
    return bytes(changed[: int(cut * len(data)) + 1])


@settings(max_examples=EXAMPLES)
@given(
    cells=st.lists(
        st.tuples(
            st.integers(0, 38),
            st.sampled_from(
                [
                    "",
                    "-1",
                    "0",
                    "9223372036854775807",
                    "-9223372036854775808",
                    "1e300",
                    "nan",
                    "inf",
                    "x",
                    "99",
                    "1.5",
                ]
            ),
        ),
        min_size=1,
        max_size=4,
    )
)
def test_android_cells_of_any_value(path: Path, cells: list[tuple[int, str]]) -> None:
    lines = android_epoch(T, SKY.values()).splitlines()
    for k, line in enumerate(lines):
        row = line.split(",")
        for column, text in cells:
            if (k + column) % 3 and column < len(row):
                row[column] = text
        lines[k] = ",".join(row)
    path.write_text(ANDROID_HEADER + "\n".join(lines) + "\n")
    check_result(lambda: read_android(path))


@settings(max_examples=EXAMPLES)
@given(
    flips=FLIPS,
    number=st.sampled_from(
        [4027, 4050, 5891, 4095, 4002, 4004, 4081, 5893, 4120, 4030, 5894, 4007, 5906, 5908, 5938, 5939]
    ),
    size=st.integers(0, 200),
    fill=st.integers(0, 255),
)
def test_sbf_blocks_of_any_content_with_a_sound_check_sum(
    path: Path, flips: list[tuple[float, int]], number: int, size: int, fill: int
) -> None:
    body = turned(bytes([fill]) * (size + 1), flips, 1.0)
    whole = [turned(one[8:], flips, 1.0) for one in SBF_BLOCKS[:1]]
    path.write_bytes(
        SBF_BLOCKS[1] + block(number, time(1.0) + body) + block(4027, whole[0]) + block(number, body)
    )
    check_result(lambda: read_sbf(path))


@settings(max_examples=EXAMPLES)
@given(data=st.binary(max_size=300), head=st.sampled_from([b"", b"\xb5\x62", b"$@", b"# Raw,", b"\x1f\x8b"]))
def test_any_bytes_have_a_format_or_none(path: Path, data: bytes, head: bytes) -> None:
    path.write_bytes(head + data)
    try:
        assert detect_format(path)
    except InsGnssError as error:
        assert str(path) in str(error)


def test_bytes_made_of_sync_words_are_refused_soon(path: Path) -> None:
    for word in (b"\xb5\x62", b"\xb5\x62\x02\x15\x00\x10", b"$@", b"$@\x00\x00\xbb\x0f\x40\x00"):
        path.write_bytes(word * (60_000 // len(word)))
        with pytest.raises(InsGnssError):
            detect_format(path)


@pytest.mark.real_data
def test_real_rinex_file_cut_or_with_bits_turned(data_root: Path, path: Path) -> None:
    packed = (data_root / "instinct_static_20230629" / "reach_m2_static_10min.23O.gz").read_bytes()
    plain = gzip.decompress(packed)
    start = plain.index(b"> 2023")
    end = plain.index(b"> 2023", start + 150_000)  # some forty epochs
    text = plain[:end]
    rng = np.random.default_rng(7)
    for data in (text, sidereon.encode_crinex(text.decode()).encode(), gzip.compress(text)):
        for _ in range(12):
            changed = bytearray(data[: int(rng.uniform(0.2, 1.0) * len(data))])
            for _ in range(int(rng.integers(0, 6))):
                changed[int(rng.integers(len(changed)))] ^= 1 << int(rng.integers(8))
            path.write_bytes(changed)
            check_result(lambda: ReceiverLog(read_rinex_obs([path])[0]))


@pytest.mark.parametrize("cut", [0.3, 0.7, 0.999])
def test_converted_file_that_was_cut_still_gives_a_flight(tmp_path: Path, cut: float) -> None:
    data = b"".join(SBF_BLOCKS)
    (tmp_path / "log").write_bytes(data[: int(cut * len(data))])
    done = convert([tmp_path / "log"], tmp_path / "out")
    assert (tmp_path / "out" / "flight.toml") in done.written and done.events
