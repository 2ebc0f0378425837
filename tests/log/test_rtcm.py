"""RTCM 3 streams, written by an encoder of our own from the standard's tables, become tables with those numbers."""

from __future__ import annotations

import datetime as dt
import functools
import math
import operator
import struct
from pathlib import Path

import numpy as np
import pymap3d
import pyrtcm
import pytest
from typer.testing import CliRunner

from insgnss.cli.main import app
from insgnss.errors import InputError, TimeError
from insgnss.gpstime import datetime_to_ns
from insgnss.log.convert import convert
from insgnss.log.detect import detect_format
from insgnss.log.flight import Flight
from insgnss.log.receiver import LogDeclarations, ReceiverLog
from insgnss.log.receiver_files import read_receiver
from insgnss.log.rinex.navigation import read_navigation
from insgnss.log.rtcm.reader import read_rtcm
from tests.log.rtcm_encoder import (
    Cell,
    Orbit,
    beidou_ephemeris,
    galileo_ephemeris,
    glonass_ephemeris,
    gps_1004,
    gps_ephemeris,
    msm,
    station,
)
from tests.log.sound import check_table
from tests.log.test_convert import read_again, same
from tests.log.ubx_writing import frame

C_MPS = 299_792_458.0
WEEK, TOW_S = 2392, 381_845
T0_NS = (WEEK * 604_800 + TOW_S) * 10**9
L1, L2 = 1575.42e6, 1227.6e6
LEAP_S = 18
STATION_M = (-3869297.5138, 3436571.3345, 3717369.3757)  # ECEF


def gps_cells(k: int = 0) -> list[Cell]:
    return [
        Cell(5, 2, 21_123_456.789 + 100 * k, 21_123_457.123 + 100 * k, 100.25, 44.5),
        Cell(5, 10, 21_123_460.5 + 100 * k, 21_123_461.0 + 100 * k, 100.2501, 30.25, half=True),
        Cell(17, 2, 24_000_000.0, None, None, 38.0),
    ]


def small_stream() -> bytes:
    parts = [station(7, *STATION_M)]
    for k in range(4):
        tow_ms = (TOW_S + k) * 1000
        day_ms = (tow_ms - LEAP_S * 1000 + 3 * 3_600_000) % 86_400_000
        parts += [
            msm("G", 7, tow_ms, gps_cells(k), more=True),
            msm("R", 7, 3 << 27 | day_ms, [Cell(3, 2, 2.0e7, 2.0e7 + 1, -500.5)], {3: -5}, more=True),
            msm("E", 4, tow_ms, [Cell(11, 2, 2.4e7, 2.4e7, cn0=40, lock=9)], more=True),
            msm("C", 6, tow_ms - 14_000, [Cell(20, 2, 2.2e7, 2.2e7 - 2)]),
        ]
        if k == 1:
            parts += [
                gps_ephemeris(5, WEEK, Orbit()),
                galileo_ephemeris(11, WEEK - 1024, Orbit(toe_s=381_600)),
                beidou_ephemeris(20, WEEK - 1356, Orbit(toe_s=381_600)),
                glonass_ephemeris(3, -5, 51),
            ]
    return b"".join(parts)


STREAM = small_stream()


def read(folder: Path, data: bytes, date: dt.date | None = None) -> ReceiverLog:
    path = folder / "stream"
    path.write_bytes(data)
    return read_rtcm([path], date)


def row(log: ReceiverLog, sv: str, code: str, t_ns: int = T0_NS) -> int:
    gnss = log.gnss
    found = [
        k
        for k in np.flatnonzero(gnss.t_ns == t_ns)
        if gnss.sv_names[gnss.sv[k]] == sv and gnss.signal_names[gnss.signal[k]] == code
    ]
    assert len(found) == 1
    return int(found[0])


def test_what_the_encoder_writes_is_what_another_library_reads() -> None:
    message = pyrtcm.RTCMReader.parse(msm("G", 7, TOW_S * 1000, gps_cells()))
    rough_ms = message.DF397_01 + message.DF398_01  # it scales fields by their resolution
    assert message.identity == "1077" and message.DF004 == TOW_S * 1000
    assert (rough_ms + message.DF405_01) * C_MPS / 1e3 == pytest.approx(21_123_456.789, abs=1e-3)
    assert (rough_ms + message.DF406_01) * C_MPS / 1e3 == pytest.approx(21_123_457.123, abs=3e-4)
    assert message.DF399_01 + message.DF404_01 == pytest.approx(100.25, abs=1e-4)
    assert message.DF408_01 == 44.5


def test_observations_have_the_numbers_that_were_sent(tmp_path: Path) -> None:
    log = read(tmp_path, STREAM)
    gnss = log.gnss
    check_table(gnss)
    assert np.unique(gnss.t_ns).tolist() == [T0_NS + k * 10**9 for k in range(4)]
    first, second, bare = (row(log, *key) for key in (("G05", "C1C"), ("G05", "C2W"), ("G17", "C1C")))
    resolution_m = C_MPS / 1e3 * 2.0**-29
    assert gnss.pseudorange_m[first] == pytest.approx(21_123_456.789, abs=resolution_m)
    assert gnss.carrier_cycles is not None and gnss.lli is not None
    assert gnss.carrier_cycles[first] * C_MPS / L1 == pytest.approx(21_123_457.123, abs=resolution_m / 4)
    assert gnss.carrier_cycles[second] * C_MPS / L2 == pytest.approx(21_123_461.0, abs=resolution_m / 4)
    assert gnss.doppler_hz[first] == pytest.approx(-100.25 * L1 / C_MPS, abs=1e-3)
    assert gnss.cn0_dbhz[first] == 44.5 and gnss.lli[second] == 2 and gnss.lli[first] == 0
    assert np.isnan(gnss.carrier_cycles[bare]) and np.isnan(gnss.doppler_hz[bare])
    glonass = row(log, "R03", "C1C")
    assert gnss.doppler_hz[glonass] == pytest.approx(500.5 * (1602e6 - 5 * 562.5e3) / C_MPS, abs=1e-3)
    assert gnss.glonass_channels == {"R03": -5}
    assert gnss.pseudorange_m[row(log, "E11", "C1C")] == pytest.approx(2.4e7, abs=0.02)
    assert gnss.pseudorange_m[row(log, "C20", "C2I")] == pytest.approx(2.2e7, abs=resolution_m)


def test_ephemerides_have_the_elements_that_were_sent(tmp_path: Path) -> None:
    navigation = read(tmp_path, STREAM).navigation
    assert navigation is not None and navigation.state_vectors is not None
    table, sent = navigation.ephemerides, Orbit()
    assert table.sv_names == ("C20", "E11", "G05") and table.message == ("D1", "INAV", "LNAV")
    toe_ns = (WEEK * 604_800 + 381_600) * 10**9
    assert table.toe_ns.tolist() == [toe_ns + 14 * 10**9, toe_ns, toe_ns]
    assert np.array_equal(table.toe_ns, table.toc_ns)
    for name in ("i0", "omega0", "omega", "m0", "delta_n", "omega_dot", "idot"):
        assert getattr(table, name) == pytest.approx(
            getattr(sent, name) * math.pi,
            abs=math.pi * 2.0 ** (-43 if name in "delta_n omega_dot idot" else -31),
        )
    assert table.sqrt_a == pytest.approx(sent.sqrt_a, abs=1e-6) and table.e == pytest.approx(sent.e, abs=1e-9)
    assert table.af0 == pytest.approx(sent.af0, abs=3e-10) and table.crs == pytest.approx(sent.radial)
    assert table.group_delay_s[:, 0] == pytest.approx(sent.group_delay_s, abs=3e-10)
    assert table.group_delay_s[:2, 1] == pytest.approx(2 * sent.group_delay_s, abs=3e-10)
    assert table.health.tolist() == [1.0, float(1 | 2 << 1 | 1 << 7), 0.0]
    states = navigation.state_vectors
    assert states.sv_names == ("R03",) and states.channel.tolist() == [-5]
    moscow = dt.datetime(2025, 11, 13, 12, 45)  # the 51st quarter of an hour
    assert states.t_ns[0] == datetime_to_ns(moscow - dt.timedelta(hours=3)) + LEAP_S * 10**9
    assert states.r_e[0] == pytest.approx([1e7, -2e7, 5e6]) and states.v_e[0] == pytest.approx(
        [1e3, 2e3, -3e3]
    )
    assert states.clock_s[0] == pytest.approx(3e-5, abs=1e-9)


def test_older_messages_unwrap_the_phase_and_tell_the_slip(tmp_path: Path) -> None:
    ranges = [21_000_000.0 + 700.0 * k for k in range(6)]
    phases = [r * L1 / C_MPS + 500.0 * k for k, r in enumerate(ranges)]  # drifts over a wrap of 1500 cycles
    frames = [
        gps_1004((TOW_S + k) * 1000, 5, r, phase, r + 3.0, lock=127 if k != 4 else 3)
        for k, (r, phase) in enumerate(zip(ranges, phases, strict=True))
    ]
    log = read(tmp_path, b"".join(frames), dt.date(2025, 11, 13))
    gnss = log.gnss
    one, two = (gnss.signal == gnss.signal_names.index(code) for code in ("C1C", "C2W"))
    assert gnss.pseudorange_m[one] == pytest.approx(ranges, abs=0.011)
    assert gnss.pseudorange_m[two] == pytest.approx([r + 3.0 for r in ranges], abs=0.03)
    assert gnss.carrier_cycles is not None and gnss.lli is not None
    assert np.diff(gnss.carrier_cycles[one]) == pytest.approx(np.diff(phases), abs=0.02)
    assert gnss.lli[one].tolist() == [0, 0, 0, 0, 1, 0]


@pytest.mark.parametrize(
    "kept", [galileo_ephemeris(11, WEEK - 1024, Orbit()), beidou_ephemeris(20, WEEK - 1356, Orbit())]
)
def test_week_is_that_of_the_ephemerides(tmp_path: Path, kept: bytes) -> None:
    log = read(tmp_path, msm("G", 7, TOW_S * 1000, gps_cells()) + kept)
    assert log.gnss.t_ns[0] == T0_NS
    assert "rtcm_week_assumed" not in {event.kind for event in log.events}


def test_glonass_date_tells_the_week(tmp_path: Path) -> None:
    days = (dt.date(2025, 11, 13) - dt.date(2024, 1, 1)).days + 1
    log = read(tmp_path, msm("G", 7, TOW_S * 1000, gps_cells()) + glonass_ephemeris(3, -5, 51, days, 8))
    assert log.gnss.t_ns[0] == T0_NS


def test_gps_week_alone_is_told_as_assumed(tmp_path: Path) -> None:
    log = read(tmp_path, msm("G", 7, TOW_S * 1000, gps_cells()) + gps_ephemeris(5, WEEK, Orbit()))
    assert log.gnss.t_ns[0] == T0_NS
    assert "--date" in next(event.detail for event in log.events if event.kind == "rtcm_week_assumed")


def test_stream_without_a_date_says_what_to_declare(tmp_path: Path) -> None:
    bare = msm("G", 7, TOW_S * 1000, gps_cells())
    with pytest.raises(TimeError, match="--date"):
        read(tmp_path, bare)
    assert read(tmp_path, bare, dt.date(2025, 11, 13)).gnss.t_ns[0] == T0_NS
    with pytest.raises(TimeError, match=r"Monday(.|\n)*--date 2025-11-20"):
        read(tmp_path, bare, dt.date(2025, 11, 17))


def test_week_crossover_goes_on(tmp_path: Path) -> None:
    frames = [msm("G", 7, tow * 1000 % 604_800_000, gps_cells()) for tow in (604_798, 604_799, 604_800)]
    frames.append(msm("R", 7, 7 << 27 | ((3 * 3600 - LEAP_S) * 1000 + 1000), [Cell(3, 2, 2.0e7)], {3: 1}))
    log = read(tmp_path, b"".join(frames), dt.date(2025, 11, 15))
    assert np.diff(np.unique(log.gnss.t_ns)).tolist() == [10**9] * 3


def test_other_messages_stations_and_repetitions_are_told(tmp_path: Path) -> None:
    coarse = msm("G", 4, TOW_S * 1000, [Cell(5, 2, 21_123_456.8, cn0=44, lock=9)])
    other = msm("G", 7, TOW_S * 1000, gps_cells()[:1], station=9)
    unknown = msm("G", 7, TOW_S * 1000, [Cell(5, 7, 2.1e7)])
    log = read(
        tmp_path,
        STREAM
        + coarse
        + other
        + unknown
        + bytes.fromhex("d300133ed7d30202980edeef34b4bd62ac0941986f33360b98"),
    )
    told = {event.kind: event.detail for event in reversed(log.events)}
    assert "station 7 are used" in told["rtcm_other_station"] and "1 of 9" in told["rtcm_other_station"]
    assert told["rtcm_repeated"].count("1 observation(s)") == 1
    assert "1 of G05 signal 7" in told["rtcm_signal_unknown"]
    assert "-3869297.5138" in told["rtcm_station"]
    resolution_m = C_MPS / 1e3 * 2.0**-29
    assert log.gnss.pseudorange_m[row(log, "G05", "C1C")] == pytest.approx(21_123_456.789, abs=resolution_m)


def test_ranges_modulo_a_millisecond_alone_are_refused_by_name(tmp_path: Path) -> None:
    modulo = msm("G", 3, TOW_S * 1000, [Cell(5, 2, 2.1e7, lock=9)])
    with pytest.raises(InputError, match=r"1 of 1073(.|\n)*MSM4 to MSM7"):
        read(tmp_path, galileo_ephemeris(11, WEEK - 1024, Orbit()) + modulo)
    with pytest.raises(InputError, match="no RTCM 3 message"):
        read(tmp_path, b"\xd3\x00\x13 nothing")


def test_damaged_and_cut_frames_are_told_and_the_rest_read(tmp_path: Path) -> None:
    whole = read(tmp_path, STREAM)
    spoilt = bytearray(STREAM)
    spoilt[60] ^= 0x10
    log = read(tmp_path, bytes(spoilt[:-30]))
    assert len(whole.gnss.t_ns) - 5 < len(log.gnss.t_ns) < len(whole.gnss.t_ns)
    kinds = [event.kind for event in log.events]
    assert "rtcm_damaged" in kinds and "rtcm_foreign_bytes" in kinds


def test_converted_stream_reads_again_the_same(tmp_path: Path) -> None:
    path = tmp_path / "base.bin"
    path.write_bytes(b"$GNGGA,1*00\r\n" + STREAM)
    assert detect_format(path) == "rtcm"
    done = convert([path], tmp_path / "out", LogDeclarations(date=dt.date(2025, 11, 13)))
    assert [p.name for p in done.written] == ["gnss_obs.csv", "navigation.rnx", "flight.toml"]
    flight, table = read_again(tmp_path / "out")
    same(done.log.gnss, table)
    assert read_navigation(flight.config.gnss.navigation)[0].ephemerides.sv_names == ("C20", "E11", "G05")
    assert Flight.load(tmp_path / "out" / "flight.toml").config.gps_week == WEEK


def own_fixes(at: tuple[float, float, float]) -> bytes:
    """Return four NAV-PVT frames of a u-blox receiver at a place (ECEF, m) and the times of ``STREAM``."""
    lat, lon, h_m = pymap3d.ecef2geodetic(*at)
    frames = []
    for k in range(4):
        body = bytearray(92)
        body[4:12] = struct.pack("<HBBxxxB", 2025, 11, 13, 7)
        body[0:4] = struct.pack("<I", (TOW_S + k) * 1000)
        body[20:22] = bytes((3, 1))
        body[24:40] = struct.pack("<iiii", round(lon * 1e7), round(lat * 1e7), round(h_m * 1e3), 0)
        body[40:48] = struct.pack("<II", 1500, 2500)
        frames.append(frame(0x0107, bytes(body)))
    return b"".join(frames)


def test_measurements_that_a_receiver_sends_as_rtcm_beside_its_own_fixes_are_read(tmp_path: Path) -> None:
    """A base station's receiver: NAV-PVT, and its measurements as RTCM alone."""
    path = tmp_path / "base.ubx"
    path.write_bytes(own_fixes(STATION_M) + STREAM)
    assert detect_format(path) == "ubx"

    log = read_receiver("ubx", [path], LogDeclarations())

    same(read(tmp_path, STREAM).gnss, log.gnss)
    assert log.navigation is not None and log.solution is not None and len(log.solution.t_ns) == 4
    (told,) = (event.detail for event in log.events if event.kind == "rtcm_read")
    assert "station is 0 m from the fixes" in told and "[gnss.base]" in told and "RXM-RAWX" in told


def test_corrections_of_a_distant_base_are_no_measurements_of_the_receiver(tmp_path: Path) -> None:
    path = tmp_path / "rover.ubx"
    path.write_bytes(own_fixes((STATION_M[0], STATION_M[1] + 2000.0, STATION_M[2])) + STREAM)

    log = read_receiver("ubx", [path], LogDeclarations())

    assert not len(log.gnss.t_ns) and log.solution is not None
    told = [event.detail for event in log.events if event.kind == "rtcm_of_base"]
    assert len(told) == 1 and "station 2 km away, a base: not read" in told[0]


def test_measurements_without_a_station_are_read_with_what_to_do_if_they_are_a_bases(tmp_path: Path) -> None:
    path = tmp_path / "rover.ubx"
    stream = b"".join(msm("G", 7, (TOW_S + k) * 1000, gps_cells()) for k in range(4))
    path.write_bytes(own_fixes(STATION_M) + stream)

    log = read_receiver("ubx", [path], LogDeclarations())

    assert len(log.gnss.t_ns) == 12
    (told,) = (event.detail for event in log.events if event.kind == "rtcm_read")
    assert "do not say whose they are" in told and "[gnss.base]" in told and "lat_deg" in told


def test_measurements_declared_a_bases_leave_the_receivers_fixes(tmp_path: Path) -> None:
    path = tmp_path / "rover.ubx"
    stream = b"".join(msm("G", 7, (TOW_S + k) * 1000, gps_cells()) for k in range(4))
    path.write_bytes(own_fixes(STATION_M) + stream)
    asked = ["convert", str(path), "-o", str(tmp_path / "out"), "--rtcm"]

    done = CliRunner().invoke(app, [*asked, "base"])

    assert done.exit_code == 0 and "rtcm_of_base" in done.output and "as declared" in done.output
    assert "4 fixes of the receiver take their place" in done.output
    flight = Flight.load(tmp_path / "out" / "flight.toml")
    assert [sensor.kind for sensor in flight.config.sensor] == ["position", "velocity"]
    refused = CliRunner().invoke(app, [*asked, "rover"])
    assert refused.exit_code != 0 and "'rover' is neither 'own' nor 'base'" in refused.output
    # without a date the stream is not read, which does not matter if it is another's
    path.write_bytes(frame(0x0501, b"\x06\x8a") + stream)
    with pytest.raises(InputError, match="no raw measurement"):
        read_receiver("ubx", [path], LogDeclarations(rtcm="base"))


def test_measurements_of_a_distant_station_are_the_receivers_own_if_declared(tmp_path: Path) -> None:
    """A base that sends a surveyed place, and itself has no good fix."""
    path = tmp_path / "base.ubx"
    path.write_bytes(own_fixes((STATION_M[0], STATION_M[1] + 200.0, STATION_M[2])) + STREAM)
    (refused,) = (
        e for e in read_receiver("ubx", [path], LogDeclarations()).events if e.kind == "rtcm_of_base"
    )
    assert "--rtcm own" in refused.detail

    log = read_receiver("ubx", [path], LogDeclarations(rtcm="own"))

    same(read(tmp_path, STREAM).gnss, log.gnss)
    assert "as declared" in {event.kind: event.detail for event in log.events}["rtcm_read"]


def sentences(at: tuple[float, float, float]) -> bytes:
    """Return NMEA of a receiver at a place (ECEF, m) and the times of ``STREAM``."""
    lat, lon, h_m = pymap3d.ecef2geodetic(*at)
    lines = []
    for k in range(4):
        time = f"{dt.datetime(2025, 11, 13, 10, 3, 47) + dt.timedelta(seconds=k):%H%M%S.00}"
        north, east = (f"{int(abs(x)):0{n}d}{60 * (abs(x) % 1):09.6f}" for x, n in ((lat, 2), (lon, 3)))
        lines += [f"GPRMC,{time},A,{north},N,{east},E,0.0,,131125,,,A"]
        lines += [f"GPGGA,{time},{north},N,{east},E,1,09,1.0,{h_m:.3f},M,0.0,M,,"]
    return b"".join(
        f"${line}*{functools.reduce(operator.xor, line.encode()):02X}\r\n".encode() for line in lines
    )


def test_corrections_between_the_sentences_of_a_receiver_are_no_measurements_of_it(tmp_path: Path) -> None:
    path = tmp_path / "serial.log"
    path.write_bytes(sentences((STATION_M[0], STATION_M[1] + 2000.0, STATION_M[2])) + STREAM)
    assert detect_format(path) == "rtcm"

    done = convert([path], tmp_path / "out")

    assert [p.name for p in done.written] == ["navigation.rnx", "reference.csv", "fixes.csv", "flight.toml"]
    assert "2 km away" in {event.kind: event.detail for event in done.events}["rtcm_of_base"]
    # those of a base that logs its own stream are its own, without a word
    path.write_bytes(sentences(STATION_M) + STREAM)
    log = read_receiver("rtcm", [path], LogDeclarations())
    assert len(log.gnss.t_ns) and not {"rtcm_of_base", "rtcm_read"} & {event.kind for event in log.events}
    path.write_bytes(STREAM)
    with pytest.raises(InputError, match=r"declared a base station's(.|\n)*leave the option out"):
        read_receiver("rtcm", [path], LogDeclarations(rtcm="base"))


def test_sentences_beside_a_stream_tell_its_date(tmp_path: Path) -> None:
    path = tmp_path / "serial.log"
    stream = b"".join(msm("G", 7, (TOW_S + k) * 1000, gps_cells()) for k in range(4))
    path.write_bytes(sentences(STATION_M) + stream)

    log = read_receiver("rtcm", [path], LogDeclarations())

    assert log.gnss.t_ns[0] == T0_NS and log.solution is not None and log.solution.t_ns[0] == T0_NS
    assert "do not say whose they are" in {event.kind: event.detail for event in log.events}["rtcm_read"]


def test_rtcm_among_messages_without_a_fix_needs_a_date(tmp_path: Path) -> None:
    path = tmp_path / "log.ubx"
    path.write_bytes(frame(0x0501, b"\x06\x8a") + msm("G", 7, TOW_S * 1000, gps_cells()))

    with pytest.raises(TimeError, match="does not say its date"):
        read_receiver("ubx", [path], LogDeclarations())
    dated = read_receiver("ubx", [path], LogDeclarations(date=dt.date(2025, 11, 13)))

    assert len(dated.gnss.t_ns) == 3 and dated.gnss.t_ns[0] == T0_NS


def test_date_is_an_option_of_the_command(tmp_path: Path) -> None:
    (tmp_path / "base").write_bytes(msm("G", 7, TOW_S * 1000, gps_cells()))
    asked = ["convert", str(tmp_path / "base"), "-o", str(tmp_path / "out")]
    refused = CliRunner().invoke(app, asked)
    assert refused.exit_code == 3 and "--date" in refused.output
    assert CliRunner().invoke(app, [*asked, "--date", "2025-11-13"]).exit_code == 0
