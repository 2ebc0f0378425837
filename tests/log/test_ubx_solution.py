"""NAV-PVT of u-blox files becomes a reference, and the fixes that a log without raw measurements is replayed with."""

from __future__ import annotations

import io
import math
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyubx2 import UBXReader

from insgnss.config.flight import Reference
from insgnss.constants import NS_PER_WEEK
from insgnss.errors import InputError
from insgnss.geodesy.ellipsoid import geodetic_to_ecef
from insgnss.log.convert import convert
from insgnss.log.flight import Flight
from insgnss.log.imu.sensor_csv import read_sensor
from insgnss.log.receiver import ReceiverLog
from insgnss.log.reference import read_reference
from insgnss.log.ubx.reader import read_ubx
from tests.log.ubx_writing import frame, rawx

NOON_MS = (4 * 24 + 12) * 3_600_000  # Thursday 28 August 2025, GPS time
T0 = 2381 * NS_PER_WEEK + NOON_MS * 1_000_000


def pvt(
    after_ms: int = 0,
    *,
    fix: int = 3,
    flags: int = 1,
    valid: int = 7,
    date: tuple[int, int, int] = (2025, 8, 28),
    level_mm: int = 1500,
    lat: int = -473_000_000,
) -> bytes:
    """Return a NAV-PVT of 92 bytes, its fields placed by the interface description's table of offsets."""
    body = bytearray(92)
    struct.pack_into("<IHBB", body, 0, NOON_MS + after_ms, *date)
    struct.pack_into("<B", body, 11, valid)
    struct.pack_into("<BB", body, 20, fix, flags)
    struct.pack_into("<iiii", body, 24, 85_000_001, lat, 612_345, 564_000)
    struct.pack_into("<II", body, 40, level_mm, 2500)
    struct.pack_into("<iii", body, 48, 1250, -2, 30)
    struct.pack_into("<I", body, 68, 70)
    return frame(0x0107, bytes(body))


def pvat(after_ms: int = 0, *, flags: int = 0x39, fix: int = 4) -> bytes:
    """Return a NAV-PVAT of 116 bytes: the place and motion of ``pvt``; roll 1.5, pitch -2.25, heading 275 deg."""
    body = bytearray(116)
    struct.pack_into("<IxBHBB", body, 0, NOON_MS + after_ms, 7, 2025, 8, 28)
    struct.pack_into("<BBxxiiii", body, 24, fix, flags, 85_000_001, -473_000_000, 612_345, 564_000)
    struct.pack_into("<IIiii", body, 44, 1500, 2500, 1250, -2, 30)
    struct.pack_into("<I", body, 68, 70)
    struct.pack_into("<iii", body, 72, 150_000, -225_000, 27_500_000)
    struct.pack_into("<HHH", body, 88, 20, 30, 150)
    return frame(0x0117, bytes(body))


def sol(after_ms: int = 0, *, fix: int = 3, flags: int = 0x0D) -> bytes:
    """Return a NAV-SOL of 52 bytes: 45 deg east on the equator, 100 m high, going 5 m/s north, 3 up."""
    body = bytearray(52)
    struct.pack_into("<IihBB", body, 0, NOON_MS + after_ms, 250, 2381, fix, flags)
    xy_cm = round((6_378_137.0 + 100.0) * 100.0 / math.sqrt(2.0))
    v_cmps = round(300.0 / math.sqrt(2.0))
    struct.pack_into("<iiiI", body, 12, xy_cm, xy_cm, 0, 250)
    struct.pack_into("<iiiI", body, 28, v_cmps, v_cmps, 500, 12)
    return frame(0x0106, bytes(body))


def hpposllh(after_ms: int = 0, *, flags: int = 0, lat: int = -473_000_000) -> bytes:
    """Return a NAV-HPPOSLLH of 36 bytes: the place of ``pvt`` with more digits."""
    body = bytearray(36)
    struct.pack_into("<BxxBI", body, 0, 0, flags, NOON_MS + after_ms)
    struct.pack_into("<iii", body, 8, 85_000_001, lat, 612_345)
    struct.pack_into("<bbb", body, 24, 37, -42, 6)
    struct.pack_into("<II", body, 28, 123, 456)
    return frame(0x0114, bytes(body))


FIXES = b"".join(pvt(250 * k) for k in range(6))


def read(folder: Path, *frames: bytes) -> ReceiverLog:
    (folder / "log.ubx").write_bytes(b"".join(frames))
    return read_ubx([folder / "log.ubx"])


def test_solution_has_place_velocity_and_sigmas(tmp_path: Path) -> None:
    log = read(tmp_path, pvt(), pvt(250, level_mm=2**32 - 1), pvt(250))
    own = log.solution
    assert own is not None and own.sigma is not None and log.solution_from == "satellites"
    assert own.t_ns.tolist() == [T0, T0 + 250_000_000]  # of a repeated time the first
    assert (own.lat_deg[0], own.lon_deg[0], own.h_m[0]) == pytest.approx(
        (-47.3, 8.5000001, 612.345), abs=1e-9
    )
    assert own.v_n[0] == pytest.approx([1.25, -0.002, 0.03], abs=1e-12)
    assert own.sigma[0, :6] == pytest.approx([1.5, 1.5, 2.5, 0.07, 0.07, 0.07], abs=1e-12)
    assert np.isnan(own.sigma[1, :2]).all() and own.sigma[1, 2] == 2.5  # the largest number states nothing
    assert np.isnan(own.rpy_deg).all() and (own.quality == 2.0).all()
    assert "receiver's fixes" in {event.kind: event.detail for event in log.events}["reference_own"]


def test_attitude_of_nav_pvat_is_read_as_far_as_it_is_valid(tmp_path: Path) -> None:
    without_heading = 0x19
    log = read(tmp_path, pvt(), pvt(500), pvat(), pvat(1000, flags=without_heading))
    own, alone = log.solution, read(tmp_path, pvt(), pvt(1000)).solution
    assert own is not None and own.sigma is not None and alone is not None and log.solution_from == "filter"
    assert own.t_ns.tolist() == [T0, T0 + 10**9]  # NAV-PVT beside it is not read
    assert own.lat_deg.tolist() == alone.lat_deg.tolist() and own.v_n.tolist() == alone.v_n.tolist()
    assert own.rpy_deg[0] == pytest.approx([1.5, -2.25, 275.0]) and np.isnan(own.rpy_deg[1, 2])
    assert own.sigma[0] == pytest.approx([1.5, 1.5, 2.5, 0.07, 0.07, 0.07, 0.2, 0.3, 1.5])
    assert "NAV-PVAT of" in {event.kind: event.detail for event in log.events}["reference_own"]

    _, parsed = UBXReader(io.BytesIO(pvat())).read()
    assert parsed is not None and parsed.identity == "NAV-PVAT"
    assert (parsed.vehRoll, parsed.vehPitch, parsed.vehHeading) == pytest.approx((1.5, -2.25, 275.0))
    assert (parsed.accRoll, parsed.accPitch, parsed.accHeading) == pytest.approx((0.2, 0.3, 1.5))
    assert (parsed.velN, parsed.sAcc, parsed.vehHeadingValid) == (1250, 70, 1)


def test_solutions_that_are_no_fix_are_left_out(tmp_path: Path) -> None:
    others = [
        pvt(1000, fix=2),  # without a height
        pvt(2000, fix=1),  # dead reckoning
        pvt(3000, flags=0),  # beyond the receiver's own limits
        pvt(4000, valid=1),  # no time
        pvt(5000, date=(2025, 2, 31)),
        pvt(5500, lat=910_000_000),
        frame(0x0107, b"\0" * 20),
    ]
    own = read(tmp_path, pvt(), *others, pvt(6000)).solution
    assert own is not None and own.t_ns.tolist() == [T0, T0 + 6 * 10**9]
    assert read(tmp_path, pvt(), *others, rawx()).solution is None  # a track needs two fixes


def test_date_beside_the_end_of_the_week_is_that_of_the_nearest_week(tmp_path: Path) -> None:
    # 18 leap seconds: Saturday 23:59:50 UTC is in the next week of GPS time
    frames = [pvt(k * 1000 - NOON_MS + 8000, date=(2025, 8, 30)) for k in range(2)]
    own = read(tmp_path, *frames).solution
    assert own is not None and own.t_ns[0] == 2382 * NS_PER_WEEK + 8 * 10**9


def test_solution_with_the_receivers_inertial_sensor_stands_for_no_measurements(tmp_path: Path) -> None:
    log = read(tmp_path, pvt(), pvt(1000, fix=4), pvt(2000, fix=4))
    assert log.solution_from == "filter" and log.satellite_fixes() is None
    assert log.solution is not None and len(log.solution.t_ns) == 3
    assert "with its inertial sensor" in {e.kind: e.detail for e in log.events}["reference_own"]


def test_file_of_fixes_alone_gives_sensors_of_position_and_velocity(tmp_path: Path) -> None:
    read(tmp_path, *(pvt(1000 * k) for k in range(5)))
    done = convert([tmp_path / "log.ubx"], tmp_path / "out")
    assert [path.name for path in done.written] == ["reference.csv", "fixes.csv", "flight.toml"]
    text = (tmp_path / "out" / "flight.toml").read_text()
    assert 'kind = "velocity"\nfiles = ["fixes.csv"]\ncolumns = { velocity = ["vn", "ve", "vd"] }' in text
    assert "sigma_m" not in text and "sigma_mps" not in text
    flight = Flight.load(tmp_path / "out" / "flight.toml")
    assert [sensor.kind for sensor in flight.config.sensor] == ["position", "velocity"]
    assert flight.config.reference is None  # a result must not be compared with its input
    columns = flight.config.columns_by_file()
    for sensor in flight.config.sensor:  # every column of our own file is read
        table, events = read_sensor(sensor, flight.config.gps_week, columns)
        assert len(table.t_ns) == 5 and events == []


def test_file_with_one_fix_and_nothing_else_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no raw measurement, no inertial sample and no solution"):
        read(tmp_path, pvt())


@pytest.mark.real_data
def test_real_solution_is_the_published_one(data_root: Path) -> None:
    folder = data_root / "walk_boulder_20250828"
    own = read_ubx([folder / "raw" / "gnss_1730.ubx"]).solution
    published, _ = read_reference(Reference(file=folder / "reference.csv"), 2381)
    assert own is not None and np.array_equal(own.t_ns, published.t_ns) and len(own.t_ns) == 536
    for name, digit in (("lat_deg", 1e-7), ("lon_deg", 1e-7), ("h_m", 1e-3), ("v_n", 1e-3)):
        apart = np.abs(getattr(own, name) - getattr(published, name))
        assert apart.max() < 0.51 * digit, name


@settings(max_examples=60, deadline=None)
@given(st.lists(st.binary(min_size=70, max_size=96), min_size=1, max_size=4))
def test_solutions_of_any_content_with_a_sound_check_sum_are_read_or_left_out(
    tmp_path_factory: pytest.TempPathFactory, bodies: list[bytes]
) -> None:
    own = read(tmp_path_factory.mktemp("pvt"), FIXES, *(frame(0x0107, body) for body in bodies)).solution
    assert own is not None and len(own.t_ns) >= 6 and (np.diff(own.t_ns) > 0).all()
    assert np.isfinite([own.lat_deg, own.lon_deg, own.h_m]).all() and np.isfinite(own.v_n).all()
    assert np.abs(own.lat_deg).max() <= 90.0


def test_solution_of_an_older_receiver_is_along_the_axes_of_the_earth(tmp_path: Path) -> None:
    log = read(tmp_path, sol(), sol(200), sol(400, fix=2), sol(600, flags=0x01), sol(800, fix=4, flags=0x0C))
    own = log.solution
    assert own is not None and own.sigma is not None and log.solution_from == "satellites"
    assert own.t_ns.tolist() == [T0, T0 + 200_000_000]
    assert (own.lat_deg[0], own.lon_deg[0]) == pytest.approx((0.0, 45.0), abs=1e-9)
    assert own.h_m[0] == pytest.approx(100.0, abs=0.01)
    assert own.v_n[0] == pytest.approx([5.0, 0.0, -3.0], abs=0.01)
    assert own.sigma[0, :6] == pytest.approx([2.5] * 3 + [0.12] * 3)
    assert "NAV-SOL" in {event.kind: event.detail for event in log.events}["reference_own"]
    parsed = UBXReader.parse(sol())
    assert (parsed.week, parsed.ecefVZ, parsed.pAcc, parsed.sAcc) == (2381, 500, 250, 12)


def test_newer_solution_is_preferred(tmp_path: Path) -> None:
    own = read(tmp_path, sol(), FIXES, sol(200)).solution
    assert own is not None and len(own.t_ns) == 6


def test_further_digits_of_a_place_are_used(tmp_path: Path) -> None:
    log = read(tmp_path, FIXES, hpposllh(250), hpposllh(500, flags=1), hpposllh(750, lat=-473_000_100))
    own = log.solution
    assert own is not None and own.sigma is not None
    ((_, parsed),) = UBXReader(io.BytesIO(hpposllh(250)))
    assert (own.lat_deg[1], own.lon_deg[1]) == pytest.approx((parsed.lat, parsed.lon), abs=1e-12)
    assert own.h_m[1] == pytest.approx(parsed.height * 1e-3, abs=1e-7)
    assert own.sigma[1, :3] == pytest.approx([0.0123, 0.0123, 0.0456])
    # one that is not valid, one of another place, and none
    assert own.lat_deg[[0, 2, 3, 4]].tolist() == pytest.approx([-47.3] * 4, abs=1e-12)
    assert own.sigma[2, :3] == pytest.approx([1.5, 1.5, 2.5])
    assert "ubx_not_used" not in {event.kind for event in log.events}


@pytest.mark.real_data
def test_real_solution_of_an_older_receiver_is_its_place_in_another_message(data_root: Path) -> None:
    path = data_root / "ubx_inertial" / "ublox-neo-m8t.log"
    own = read_ubx([path]).solution
    with path.open("rb") as stream:
        others = [m for _, m in UBXReader(stream, quitonerror=0) if m.identity == "NAV-POSECEF"]
    assert own is not None and own.sigma is not None and len(own.t_ns) == len(others)
    r_e = np.empty(3)
    for k, other in enumerate(others):
        geodetic_to_ecef(math.radians(own.lat_deg[k]), math.radians(own.lon_deg[k]), own.h_m[k], r_e)
        assert r_e == pytest.approx(np.array([other.ecefX, other.ecefY, other.ecefZ]) / 100.0, abs=1e-6)
