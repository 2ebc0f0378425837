"""ESF-RAW and ESF-MEAS: values in SI units, and sensor time laid on GPS time by the order of the messages."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from insgnss.constants import NS_PER_S
from insgnss.log.receiver import ReceiverLog
from insgnss.log.ubx.reader import read_ubx
from tests.log.test_ubx_observations import START_NS
from tests.log.ubx_writing import TOW_S, frame, rawx

TYPES = (14, 13, 5, 16, 17, 18)  # rates x y z, forces x y z
VALUES = (4096, -8192, 123, -1024, 5, 10_035)
RATES_RADPS = np.radians([1.0, -2.0, 123 / 4096])
FORCES_MPS2 = np.array([-1.0, 5 / 1024, 10_035 / 1024])
TICK_S = 39.0625e-6
Timed = tuple[float, bytes]


def word(kind: int, value: int) -> int:
    return kind << 24 | (value & 0xFFFFFF)


def raw_frame(tag: int, values: Iterable[int] = VALUES, types: Iterable[int] = TYPES) -> bytes:
    pairs = [word(k, v) for k, v in zip(types, values, strict=True)] + [word(12, 2500)]
    return frame(0x1003, b"\0" * 4 + b"".join(struct.pack("<II", w, tag % (1 << 32)) for w in pairs))


def meas_frame(
    tag_ms: int, types: Iterable[int] = TYPES, values: Iterable[int] = VALUES, calibrated: bool = False
) -> bytes:
    data = [word(k, v) for k, v in zip(types, values, strict=True)]
    flags = len(data) << 11 | calibrated << 3
    payload = struct.pack("<IHH", tag_ms % (1 << 32), flags, 0) + struct.pack(f"<{len(data)}I", *data)
    return frame(0x1002, payload + (struct.pack("<I", word(14, 12_345)) if calibrated else b""))


def read(folder: Path, timed: list[Timed]) -> ReceiverLog:
    """Read frames in the order in which they left the receiver."""
    path = folder / "log.ubx"
    path.write_bytes(b"".join(data for _, data in sorted(timed, key=lambda entry: entry[0])))
    return read_ubx([path])


def epochs(count: int = 60, delay_s: float = 0.06) -> list[Timed]:
    return [(k + delay_s, rawx(TOW_S + k)) for k in range(count)]


def samples(
    rate_hz: float, seconds: float, tick_s: float, first_tag: int, delay_s: float = 0.0
) -> list[Timed]:
    times = np.arange(0.1, seconds, 1.0 / rate_hz)
    return [(t + delay_s, raw_frame(first_tag + round(t / tick_s))) for t in times]


@pytest.mark.parametrize("first_tag", [1000, (1 << 32) - 500_000])
def test_raw_samples_get_times_to_the_delay_of_the_messages(tmp_path: Path, first_tag: int) -> None:
    # the sensor's clock is 40 ppm off, and its 32 bits overflow in the second case
    log = read(tmp_path, epochs() + samples(100.0, 59.0, TICK_S * (1 + 40e-6), first_tag))
    assert log.imu is not None

    assert len(log.imu.t_ns) == 5890
    t = (log.imu.t_ns - START_NS) / NS_PER_S
    # epochs left 60 ms late, samples at once: the tags come out 60 ms early, and to half a sample
    np.testing.assert_allclose(t - 0.1 - np.arange(5890) / 100.0, -0.06, atol=0.006)
    assert np.polyfit(np.arange(5890) / 100.0, t, 1)[0] == pytest.approx(1.0, abs=2e-5)
    assert (np.diff(log.imu.t_ns) > 0).all()
    np.testing.assert_allclose(log.imu.w_ib_b, np.tile(RATES_RADPS, (5890, 1)), rtol=1e-14)
    np.testing.assert_array_equal(log.imu.f_b, np.tile(FORCES_MPS2, (5890, 1)))
    assert any(event.kind == "imu_time_estimated" for event in log.events)


@pytest.mark.parametrize("calibrated", [False, True])
def test_meas_samples_in_milliseconds_are_read(tmp_path: Path, calibrated: bool) -> None:
    timed = epochs() + [(k / 10, meas_frame(7000 + 100 * k, calibrated=calibrated)) for k in range(1, 590)]
    log = read(tmp_path, timed)

    assert log.imu is not None and len(log.imu.t_ns) == 589
    np.testing.assert_allclose((log.imu.t_ns - START_NS) / NS_PER_S, np.arange(1, 590) / 10, atol=0.11)
    np.testing.assert_array_equal(log.imu.f_b[0], FORCES_MPS2)
    np.testing.assert_allclose(log.imu.w_ib_b[0], RATES_RADPS, rtol=1e-14)
    # the receiver's own time at the end is no rate
    assert not any(event.kind == "imu_repeated" for event in log.events)


def test_rates_and_forces_in_messages_of_their_own_are_brought_to_one_time(tmp_path: Path) -> None:
    timed = epochs()
    for k in range(1, 590):
        timed.append((k / 10, meas_frame(100 * k, TYPES[:3], (4096 * k, 0, 0))))
        timed.append((k / 10 + 0.05, meas_frame(100 * k + 50, TYPES[3:], (1024 * k, 0, 0))))
    log = read(tmp_path, timed)

    assert log.imu is not None and len(log.imu.t_ns) == 588
    # at the time of rate k the force lies half way between k - 1 and k
    np.testing.assert_allclose(np.degrees(log.imu.w_ib_b[:, 0]) - log.imu.f_b[:, 0], 0.5, atol=1e-9)
    assert any(event.kind == "imu_interpolated" for event in log.events)


def test_raw_is_preferred_to_meas(tmp_path: Path) -> None:
    timed = (
        epochs() + samples(100.0, 59.0, TICK_S, 0) + [(k / 10, meas_frame(100 * k)) for k in range(1, 590)]
    )
    log = read(tmp_path, timed)

    assert log.imu is not None and len(log.imu.t_ns) == 5890


def test_repeated_tags_are_left_out_and_counted(tmp_path: Path) -> None:
    once = samples(10.0, 59.0, TICK_S, 0)
    log = read(tmp_path, epochs() + once + [(t + 0.001, data) for t, data in once[:50]])

    assert log.imu is not None and len(log.imu.t_ns) == len(once)
    assert any(event.kind == "imu_repeated" and "300" in event.detail for event in log.events)


@pytest.mark.parametrize(
    ("timed", "words"),
    [
        (epochs(2) + samples(10.0, 1.0, TICK_S, 0), "too few epochs"),
        (epochs() + [(k / 10, meas_frame(100 * k, (14,), (1,))) for k in range(50)], "all three rates"),
        ([*epochs(), (0.5, frame(0x1003, b"\0" * 7))], "all three rates"),
        ([*epochs(), (0.5, frame(0x1002, b"\0" * 3))], "all three rates"),
    ],
)
def test_sensor_data_that_cannot_be_used_are_told(tmp_path: Path, timed: list[Timed], words: str) -> None:
    log = read(tmp_path, timed)

    assert log.imu is None
    assert words in next(event.detail for event in log.events if event.kind == "imu_not_used")


def test_log_without_sensor_has_no_inertial_table(tmp_path: Path) -> None:
    assert read(tmp_path, epochs(3)).imu is None
