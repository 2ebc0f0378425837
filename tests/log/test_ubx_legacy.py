"""RXM-RAW and RXM-SFRB of u-blox receivers before RXM-RAWX, and files of inertial samples alone."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.errors import InputError
from insgnss.log.ubx.reader import read_ubx
from tests.log.test_messages_lnav import PARAMS, subframes
from tests.log.test_ubx_imu import FORCES_MPS2, RATES_RADPS, TICK_S, raw_frame
from tests.log.ubx_writing import WEEK, frame

TOW_MS = 408_639_000
START_NS = WEEK * NS_PER_WEEK + TOW_MS * 1_000_000


def old(sv: int, quality: int = 7, lli: int = 0, pr: float = 2.1e7) -> bytes:
    return struct.pack("<ddfBbbB", 1.1e8, pr, -1234.5, sv, quality, 42, lli)


def raw(seconds: float, *rows: bytes, week: int = WEEK) -> bytes:
    head = struct.pack("<ihBB", TOW_MS + round(1000 * seconds), week, len(rows), 0)
    return frame(0x0210, head + b"".join(rows))


def test_old_raw_measurements_become_rows(tmp_path: Path) -> None:
    path = tmp_path / "log.ubx"
    path.write_bytes(
        raw(0.0, old(5), old(122)) + raw(1.0, old(5, lli=1), old(9, quality=4), old(11, quality=3))
    )
    gnss = read_ubx([path]).gnss
    rows = list(
        zip(((gnss.t_ns - START_NS) // NS_PER_S).tolist(), np.array(gnss.sv_names)[gnss.sv], strict=True)
    )
    assert rows == [(0, "G05"), (0, "S22"), (1, "G05"), (1, "G09"), (1, "G11")]
    assert gnss.signal_names == ("C1C",) and gnss.doppler_hz.tolist() == [-1234.5] * 5
    assert np.isnan(gnss.pseudorange_m).tolist() == [False, False, False, False, True]
    assert gnss.carrier_cycles is not None and gnss.lli is not None
    assert np.isnan(gnss.carrier_cycles).tolist() == [False, False, False, True, True]
    assert gnss.lli.tolist() == [0, 0, 1, 0, 0]


def test_old_subframes_become_an_ephemeris(tmp_path: Path) -> None:
    def sfrb(sv: int, bits: int) -> bytes:
        words = [bits >> 24 * (9 - k) & 0xFFFFFF for k in range(10)]
        return frame(0x0211, struct.pack("<BB10I", 3, sv, *words))

    parts = [sfrb(10, bits) for bits in subframes()]
    path = tmp_path / "log.ubx"
    path.write_bytes(b"".join([raw(0.0, old(10)), *parts, sfrb(77, 0), parts[0][:20]]))
    log = read_ubx([path])
    assert log.navigation is not None
    table = log.navigation.ephemerides
    assert table.sv_names == ("G10",) and table.sqrt_a[0] == PARAMS["sqrt_a"] and table.m0[0] == PARAMS["m0"]


def test_undated_and_cut_old_epochs_are_told(tmp_path: Path) -> None:
    path = tmp_path / "log.ubx"
    cut = frame(0x0210, struct.pack("<ihBB", TOW_MS, WEEK, 3, 0) + old(5))
    path.write_bytes(raw(0.0, old(5)) + raw(1.0, old(5), week=0) + cut)
    log = read_ubx([path])
    assert len(log.gnss.t_ns) == 1
    assert [e.detail.split(": ")[1][:1] for e in log.events if e.kind == "ubx_damaged"] == ["2"]


def time_gps(second: int, valid: int = 7) -> bytes:
    return frame(0x0120, struct.pack("<IihbBI", TOW_MS + 1000 * second, 250, WEEK, 18, valid, 20))


def test_samples_alone_are_dated_by_the_receivers_times(tmp_path: Path) -> None:
    timed = [(k + 0.05, time_gps(k)) for k in range(1, 20)] + [(0.5, time_gps(9, valid=1))]
    timed += [(t, raw_frame(500 + round(t / TICK_S))) for t in np.arange(0.0, 20.0, 0.01)]
    path = tmp_path / "imu.ubx"
    path.write_bytes(b"".join(data for _, data in sorted(timed, key=lambda pair: pair[0])))
    log = read_ubx([path])
    assert len(log.gnss.t_ns) == 0 and log.imu is not None and len(log.imu.t_ns) == 2000
    assert np.allclose(log.imu.w_ib_b, RATES_RADPS) and np.allclose(log.imu.f_b, FORCES_MPS2)
    late_s = (log.imu.t_ns - START_NS) / 1e9 - np.arange(0.0, 20.0, 0.01)
    assert np.abs(late_s + 0.05).max() < 0.02  # the receiver's output delay, which no message tells


def test_samples_that_nothing_dates_are_an_error_that_says_so(tmp_path: Path) -> None:
    path = tmp_path / "imu.ubx"
    path.write_bytes(b"".join(raw_frame(500 + 256 * k) for k in range(100)))
    with pytest.raises(InputError, match="cannot be related to GPS time") as caught:
        read_ubx([path])
    assert "UBX-RXM-RAW " in caught.value.advice
