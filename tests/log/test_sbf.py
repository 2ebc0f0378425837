"""Septentrio files: measurements, messages and inertial samples from blocks written here, field by field."""

from __future__ import annotations

import math
import struct
from pathlib import Path

import numpy as np
import pymap3d
import pytest
from pysbf2 import SBFReader

from insgnss.errors import InputError
from insgnss.log.receiver import ReceiverLog
from insgnss.log.sbf.reader import read_sbf
from insgnss.tables import GnssTable
from tests.log.sbf_encoder import C_MPS, WEEK, Channel, block, epoch, ins_solution, satellite, sensor, time

L1, L2, L5, E5B, B1, B3 = 1575.42e6, 1227.6e6, 1176.45e6, 1207.14e6, 1561.098e6, 1268.52e6
START_NS = WEEK * 604_800 * 10**9


def at(tow_s: float) -> int:
    return START_NS + round(tow_s * 1000) * 10**6


def signal(
    number: int, hz: float, m: float = 2.3e7, doppler: float = -1234.5678, **more: float | None
) -> Channel:
    values: dict[str, float | None] = {"cycles": m * hz / C_MPS + 321.125, "cn0_dbhz": 42.25} | more
    return Channel(number, hz, m, doppler, **values)  # type: ignore[arg-type]


def read(folder: Path, *blocks: bytes) -> ReceiverLog:
    path = folder / "log.sbf"
    path.write_bytes(b"".join(blocks))
    return read_sbf(path)


def rows(table: GnssTable) -> dict[tuple[int, str, str], tuple[float, ...]]:
    assert table.carrier_cycles is not None and table.lli is not None
    columns = (table.pseudorange_m, table.doppler_hz, table.carrier_cycles, table.cn0_dbhz, table.lli)
    keys = zip(table.t_ns.tolist(), table.sv.tolist(), table.signal.tolist(), strict=True)
    values = zip(*(column.tolist() for column in columns), strict=True)
    return {
        (t, table.sv_names[s], table.signal_names[c]): v for (t, s, c), v in zip(keys, values, strict=True)
    }


@pytest.mark.parametrize("padding", [0, 4])
def test_measurements_come_back_within_the_steps_of_the_format(tmp_path: Path, padding: int) -> None:
    glonass_hz = 1602e6 - 4 * 562.5e3
    sky = {
        ("G05", "C1C"): signal(0, L1),
        ("G05", "C2W"): signal(2, L2, 2.3e7 - 7.125, -961.9875),
        ("G05", "C5Q"): signal(4, L5, 2.3e7 + 210.5, -921.0 + 30.0),
        ("R02", "C1C"): signal(8, glonass_hz, 2.1e7, 3000.25),
        ("R02", "C2C"): signal(11, 1246e6 - 4 * 437.5e3, 2.1e7 + 3.5, 2333.5),
        ("E36", "C7Q"): signal(21, E5B, 2.6e7, 10.0),
        ("C45", "C2I"): signal(28, B1, 4.3e7, -10.5),
        ("J01", "C1L"): signal(32, L1, 3.9e7, 0.5),
        ("S40", "C1C"): signal(24, L1, 3.8e7, -280.0),
    }
    order = list(sky.values())
    groups = [(5, order[:3], 0), (39, order[3:5], -4), (106, order[5:6], 0), (227, order[6:7], 0)]
    groups += [(181, order[7:8], 0), (140, order[8:], 0)]
    body = [satellite(svid, channels, glonass, padding) for svid, channels, glonass in groups]
    log = read(tmp_path, epoch(345_600.25, body, padding=padding))
    found = rows(log.gnss)
    assert {key[1:] for key in found} == set(sky) and log.events == []
    assert log.gnss.glonass_channels == {"R02": -4}
    for key, sent in sky.items():
        code, doppler, cycles, cn0, lli = found[at(345_600.25), *key]
        assert abs(code - sent.pseudorange_m) <= 0.51e-3 and abs(doppler - sent.doppler_hz) <= 1.01e-4
        assert (
            sent.cycles is not None
            and abs(cycles - sent.cycles) <= 0.51e-3 + 0.51e-3 * sent.carrier_hz / C_MPS
        )
        assert cn0 == sent.cn0_dbhz and lli == 0


def test_missing_values_are_empty_cells(tmp_path: Path) -> None:
    first = bytearray(satellite(5, [signal(0, L1, cycles=None), signal(2, L2, cycles=None)]))
    first[8:12] = struct.pack("<i", -(2**31))
    first[15], first[20 + 2] = 255, 255
    first[20 + 3] = 0b10000_100
    first[26:28] = first[30:32] = b"\0\0"
    log = read(tmp_path, epoch(1.0, [bytes(first), satellite(6, [signal(0, L1)])]))
    found = {key[1:]: value for key, value in rows(log.gnss).items()}
    assert ("G05", "C2W") not in found
    assert found["G05", "C1C"][0] == 2.3e7 and np.isnan(found["G05", "C1C"][1:4]).all()


def test_lock_time_that_falls_or_is_younger_than_the_gap_marks_a_slip(tmp_path: Path) -> None:
    locks = [(0.0, 50, 50), (1.0, 51, 51), (2.0, 0, 52), (3.0, 1, 53), (40.0, 38, 3)]
    blocks = [
        epoch(tow, [satellite(5, [signal(0, L1, lock_s=one), signal(2, L2, lock_s=two)])])
        for tow, one, two in locks
    ]
    found = rows(read(tmp_path, *blocks).gnss)
    assert [found[at(tow), "G05", "C1C"][4] for tow, _, _ in locks] == [0, 0, 1, 0, 0]
    assert [found[at(tow), "G05", "C2W"][4] for tow, _, _ in locks] == [0, 0, 0, 0, 1]


def test_lock_that_began_within_a_gap_marks_a_slip_although_it_is_longer(tmp_path: Path) -> None:
    blocks = [
        epoch(t, [satellite(5, [signal(0, L1, lock_s=lock)])])
        for t, lock in ((0.0, 1), (50.0, 10), (51.0, 11))
    ]
    table = read(tmp_path, *blocks).gnss
    assert table.lli is not None and table.lli.tolist() == [0, 1, 0]


def test_lock_time_at_its_largest_value_is_no_slip(tmp_path: Path) -> None:
    second = [satellite(5, [signal(0, L1, lock_s=70), signal(2, L2, lock_s=250 + 10 * k)]) for k in range(3)]
    table = read(tmp_path, *(epoch(300.0 * k, [part]) for k, part in enumerate(second))).gnss
    assert table.lli is not None and table.lli[table.signal == table.signal_names.index("C2W")].tolist() == [
        0,
        0,
        0,
    ]


def test_half_cycle_ambiguity_sets_the_second_bit(tmp_path: Path) -> None:
    log = read(tmp_path, epoch(1.0, [satellite(5, [signal(0, L1, half_cycle=True), signal(2, L2)])]))
    assert [value[4] for value in rows(log.gnss).values()] == [2, 0]


def test_other_antennas_and_unknown_signals_are_told_and_left_out(tmp_path: Path) -> None:
    parts = [
        satellite(5, [signal(0, L1), signal(0, L1, antenna=1)]),
        satellite(62, [signal(0, L1)]),
        satellite(6, [signal(18, L1)]),
        satellite(71, [signal(0, L1)]),
    ]
    log = read(tmp_path, epoch(1.0, parts))
    assert len(log.gnss.t_ns) == 1
    assert [(e.kind, e.detail.split(": ")[1].split(" ")[0]) for e in log.events] == [
        ("sbf_other_antenna", "1"),
        ("sbf_signal_unknown", "3"),
    ]


def test_galileo_e6_is_named_by_the_blocks_flag(tmp_path: Path) -> None:
    e6 = satellite(71, [signal(19, 1278.75e6)])
    log = read(tmp_path, epoch(1.0, [e6]), epoch(2.0, [e6], flags=0x40))
    assert [key[2] for key in rows(log.gnss)] == ["C6C", "C6B"]


def test_clock_jump_is_told_with_its_size(tmp_path: Path) -> None:
    sky = [satellite(5, [signal(0, L1)])]
    log = read(tmp_path, epoch(1.0, sky), epoch(2.0, sky, jumps_ms=-1), epoch(3.0, sky, jumps_ms=-1))
    assert [(event.t_ns, event.kind) for event in log.events] == [(at(2.0), "receiver_clock_jump")]
    assert "-1 ms" in log.events[0].detail


KEPLER = {
    "af2": 0.0,
    "af1": 2.0**-43,
    "af0": 2.0**-20,
    "crs": 12.5,
    "delta_n": 2.0**-30,
    "m0": 0.4123,
    "cuc": 2.0**-20,
}
KEPLER |= {"e": 0.0123, "cus": 2.0**-21, "sqrt_a": 5153.7, "toe": 345_600, "cic": 2.0**-25, "omega0": -0.7}
KEPLER |= {
    "cis": -(2.0**-26),
    "i0": 0.31,
    "crc": 210.25,
    "omega": 0.55,
    "omega_dot": -(2.0**-28),
    "idot": 2.0**-32,
}
ANGLES = ("delta_n", "m0", "omega0", "i0", "omega", "omega_dot", "idot")


def kepler() -> bytes:
    return struct.pack("<fffffdfdfdIfdfdfdffHH", *KEPLER.values(), WEEK % 1024, WEEK % 1024)


def gps_nav(number: int = 5891, svid: int = 5) -> bytes:
    head = struct.pack("<BBHBBBBHBBBB", svid, 0, WEEK % 1024, 1, 2, 0, 0, 0x155, 0x55, 0x55, 0, 0)
    return block(number, time(340_000.0) + head + struct.pack("<fI", -(2.0**-28), 345_616) + kepler())


def bds_nav(svid: int = 160) -> bytes:
    head = struct.pack("<BBHBBBBH", svid, 0, WEEK - 1356, 0, 1, 3, 4, 0)
    return block(4081, time(340_000.0) + head + struct.pack("<ffI", 2.0**-28, -2e10, 345_600) + kepler())


def gal_nav(source: int, health: int) -> bytes:
    k = KEPLER
    body = struct.pack("<BB6d", 106, source, k["sqrt_a"], k["m0"], k["e"], k["i0"], k["omega"], k["omega0"])
    names = ("omega_dot", "idot", "delta_n", "cuc", "cus", "crc", "crs", "cic", "cis")
    body += struct.pack("<9f", *(k[name] for name in names))
    body += struct.pack("<IIffd", int(k["toe"]), 345_660, k["af2"], k["af1"], k["af0"])
    body += struct.pack(
        "<HHHHBBBBfffB", WEEK, WEEK, 77, health, 0, 107, 80, 255, 2.0**-29, 2.0**-30, -2e10, 0
    )
    return block(4002, time(340_000.0) + body)


def test_keplerian_messages_come_back_in_radians_and_gps_time(tmp_path: Path) -> None:
    sky = epoch(340_000.0, [satellite(5, [signal(0, L1)])])
    sent = [
        sky,
        gps_nav(),
        gps_nav(4095, 183),
        gps_nav(),
        bds_nav(),
        gal_nav(2, 0b0110_0001_0011),
        gal_nav(16, 0b1101 << 8),
    ]
    navigation = read(tmp_path, *sent).navigation
    assert navigation is not None
    table = navigation.ephemerides
    assert list(zip(table.sv_names, table.message, strict=True)) == [
        ("C20", "D1"),
        ("E36", "FNAV"),
        ("E36", "INAV"),
        ("G05", "LNAV"),
        ("J03", "LNAV"),
    ]
    assert table.toe_ns.tolist() == [
        at(345_614.0),
        at(345_600.0),
        at(345_600.0),
        at(345_600.0),
        at(345_600.0),
    ]
    assert table.toc_ns.tolist() == [
        at(345_614.0),
        at(345_660.0),
        at(345_660.0),
        at(345_616.0),
        at(345_616.0),
    ]
    for name, value in KEPLER.items():
        expected = value * math.pi if name in ANGLES else value
        assert np.allclose(
            getattr(table, "toe_sow_s" if name == "toe" else name), expected, rtol=1e-15, atol=0.0
        )
    assert table.group_delay_s.tolist() == [
        [2.0**-28, 0.0],
        [2.0**-29, 2.0**-30],
        [2.0**-29, 2.0**-30],
        [-(2.0**-28), 0.0],
        [-(2.0**-28), 0.0],
    ]
    # F/NAV: E5a valid, DVS 0, HS 3 -> bits 4, 5; I/NAV: E1 valid, DVS 1, HS 0; E5b valid, HS 0; E5a not said
    assert table.health.tolist() == [1.0, float(0b110 << 3), 1.0, 0.0, 0.0]
    assert table.issue.tolist() == [4.0, 77.0, 77.0, 85.0, 85.0]
    assert np.allclose(table.accuracy_m, [2.0, 3.12, 1.2, 4.0, 4.0])


def test_glonass_message_becomes_a_state_in_metres(tmp_path: Path) -> None:
    numbers = (18173.5, -6740.25, 16606.125, 2.5, -0.0625, -2.5, 0.0, 2.0**-30, -(2.0**-29))
    body = struct.pack("<BB3d6f", 57, 10, *numbers)
    body += struct.pack(
        "<fffIHBBBBHBBB", 2.0**-40, 2.0**-13, 2.0**-28, 409_518, WEEK % 1024, 30, 1, 0, 4, 1245, 1, 3, 0
    )
    body += struct.pack("<BHHB", 0, 508, 400, 1)
    sky = epoch(409_600.0, [satellite(5, [signal(0, L1)])])
    navigation = read(tmp_path, sky, block(4004, time(409_608.0) + body)).navigation
    assert navigation is not None and navigation.state_vectors is not None
    state = navigation.state_vectors
    assert (
        state.sv_names == ("R20",)
        and state.t_ns.tolist() == [at(409_518.0)]
        and state.channel.tolist() == [2]
    )
    assert state.r_e[0].tolist() == [18173500.0, -6740250.0, 16606125.0]
    assert state.v_e[0].tolist() == [2500.0, -62.5, -2500.0]
    assert state.a_e[0].tolist() == [0.0, 1000 * 2.0**-30, -1000 * 2.0**-29]
    assert (state.clock_s[0], state.clock_rate[0], state.group_delay_s[0]) == (
        -(2.0**-13),
        2.0**-40,
        2.0**-28,
    )
    assert state.health.tolist() == [1.0]


def test_ionosphere_and_leap_seconds_are_kept(tmp_path: Path) -> None:
    eight = (1e-8, 2e-8, -6e-8, -1e-7, 104448.0, 131072.0, -65536.0, -458752.0)
    sky = epoch(1.0, [satellite(5, [signal(0, L1)])])
    log = read(
        tmp_path,
        sky,
        block(5893, time(1.0) + struct.pack("<BB8f", 9, 0, *eight)),
        block(4120, time(1.0) + struct.pack("<BB8f", 145, 0, *(2 * x for x in eight))),
        block(4030, time(1.0) + struct.pack("<BB3fB", 77, 2, 40.25, 0.125, -0.001, 0)),
        block(5894, time(1.0) + struct.pack("<BBfdIBbBBb", 9, 0, 0.0, 0.0, 0, 63, 18, 0, 7, 18)),
    )
    assert log.navigation is not None and log.navigation.klobuchar is not None
    assert np.allclose(log.navigation.klobuchar, eight, rtol=1e-7) and log.navigation.leap_seconds == 18
    assert np.allclose(log.navigation.ionosphere["beidou"], 2 * np.array(eight), rtol=1e-7)
    assert np.allclose(log.navigation.ionosphere["galileo"], [40.25, 0.125, -0.001], rtol=1e-7)


def test_inertial_samples_are_in_si_units(tmp_path: Path) -> None:
    sky = epoch(1.0, [satellite(5, [signal(0, L1)])])
    samples = [sensor(1.0 + k / 100, (180.0, 0.0, -90.0), (0.5 * k, 0.0, -9.8)) for k in range(5)]
    imu = read(tmp_path, sky, *samples).imu
    assert imu is not None and imu.t_ns.tolist() == [at(1.0 + k / 100) for k in range(5)]
    assert np.allclose(imu.w_ib_b, [math.pi, 0.0, -math.pi / 2]) and imu.f_b[:, 0].tolist() == [
        0.5 * k for k in range(5)
    ]


def test_damaged_blocks_cost_only_themselves(tmp_path: Path) -> None:
    good = [epoch(float(k), [satellite(5, [signal(0, L1)])]) for k in range(5)]
    bad = bytearray(good[2])
    bad[20] ^= 1
    log = read(tmp_path, b"$GPGGA,1*00\r\n$@noise", good[0], bytes(bad), b"$@", good[3], good[4][:30])
    assert np.unique(log.gnss.t_ns).tolist() == [at(0.0), at(3.0)]
    assert [event.kind for event in log.events] == ["sbf_damaged"]


@pytest.mark.parametrize("data", [b"\0" * 100, b"$@" * 50, block(4007, time(1.0) + b"\0" * 40), gps_nav()])
def test_file_without_measurements_is_a_typed_error(tmp_path: Path, data: bytes) -> None:
    with pytest.raises(InputError):
        read(tmp_path, data)


def test_fields_agree_with_the_independent_parser(tmp_path: Path) -> None:
    blocks = [gps_nav(), gal_nav(2, 1), bds_nav()]
    parsed = [SBFReader.parse(one, scaling=False) for one in blocks]
    sky = epoch(340_000.0, [satellite(5, [signal(0, L1), signal(2, L2)])])
    log = read(tmp_path, sky, *blocks)
    assert log.navigation is not None
    table = log.navigation.ephemerides
    for name, message in zip(("G05", "E36", "C20"), parsed, strict=True):
        row = table.sv_names.index(name)
        fields = {
            "sqrt_a": "SQRT_A",
            "e": "e",
            "crs": "C_rs",
            "cic": "C_ic",
            "af0": "a_f0",
            "toe_sow_s": "t_oe",
        }
        for ours, theirs in fields.items():
            assert getattr(table, ours)[row] == getattr(message, theirs)
        assert table.m0[row] == message.M_0 * math.pi and table.i0[row] == message.i_0 * math.pi
    measured = SBFReader.parse(sky, scaling=False)
    assert measured.N1 == 1 and measured.CodeLSB_01 == 2.3e7 * 1000 - (int(2.3e10) >> 32 << 32)


def test_receivers_own_solution_becomes_a_reference_with_sigmas(tmp_path: Path) -> None:
    sky = epoch(409_600.0, [satellite(5, [signal(0, L1)])])
    blocks = [
        ins_solution(409_600.0),
        ins_solution(409_600.1, error=3),
        ins_solution(409_600.2, parts=0b01010),
    ]
    log = read(tmp_path, sky, *blocks)
    own = log.solution
    assert own is not None and own.t_ns.tolist() == [at(409_600.0), at(409_600.2)]
    assert np.degrees([0.5, -1.5]).tolist() == pytest.approx([own.lat_deg[0], own.lon_deg[0]], rel=1e-15)
    assert own.v_n.tolist() == [[4.0, 3.0, 0.5]] * 2 and own.rpy_deg.tolist() == [[1.5, -2.0, 45.0]] * 2
    assert own.sigma is not None
    expected = [0.3, 0.25, 0.5, 0.046875, 0.03125, 0.0546875, 0.0625, 0.125, 0.2]
    assert own.sigma[0].tolist() == pytest.approx(expected, rel=1e-6) and np.isnan(own.sigma[1]).all()
    assert [e.kind for e in log.events] == ["sbf_no_solution"]


@pytest.mark.real_data
def test_real_solution_agrees_with_its_own_motion(data_root: Path) -> None:
    own = read_sbf(data_root / "sbf_inertial" / "sbf_binary.sbf").solution
    assert own is not None and own.sigma is not None and len(own.t_ns) == 5565
    north, east, down = pymap3d.geodetic2ned(
        *(own.lat_deg, own.lon_deg, own.h_m), *(own.lat_deg[0], own.lon_deg[0], own.h_m[0])
    )
    t_s = (own.t_ns - own.t_ns[0]) / 1e9
    moved = np.gradient(np.column_stack([north, east, down]), t_s, axis=0)
    # positions step by centimetres where satellites correct them
    assert (np.median(np.abs(moved - own.v_n), axis=0) < 0.02).all()
    fast = np.hypot(own.v_n[:, 0], own.v_n[:, 1]) > 2.0
    course = np.degrees(np.arctan2(own.v_n[fast, 1], own.v_n[fast, 0]))
    assert np.median(np.abs((own.rpy_deg[fast, 2] - course + 180.0) % 360.0 - 180.0)) < 10.0
    assert (own.sigma > 0.0).all() and own.sigma.max() < 3.0
