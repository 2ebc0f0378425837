"""NovAtel OEM logs, written by an encoder of our own from the manual's tables, become tables with those numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from insgnss.cli.main import app
from insgnss.errors import InputError
from insgnss.log.convert import convert
from insgnss.log.detect import detect_format
from insgnss.log.flight import Flight
from insgnss.log.imu.csv_log import inertial, read_imu
from insgnss.log.novatel.imu import SCALES
from insgnss.log.novatel.reader import read_novatel
from insgnss.log.receiver import ReceiverLog
from insgnss.log.reference import read_reference
from tests.log.novatel_encoder import (
    TOW_S,
    WEEK,
    Channel,
    bestpos,
    bestvel,
    bestxyz,
    gloephemeris,
    heading2,
    inav,
    inspvas,
    inspvax,
    message,
    range_b,
    rangecmp,
    rangecmp2,
    rawephem,
    rawimus,
    rawimusx,
    short,
)
from tests.log.sound import check_table
from tests.log.test_convert import read_again, same
from tests.log.test_messages_lnav import PARAMS, SENT_NS, subframes
from tests.log.test_messages_lnav import WEEK as LNAV_WEEK

C_MPS = 299_792_458.0
T0_NS = (WEEK * 604_800 + int(TOW_S)) * 10**9
SKY = [
    Channel(5),
    Channel(5, 22_000_003.5, 9.0e7, -962.0, 38.0, system=0, signal=9, parity=False),
    Channel(40, 2.1e7, 1.1e8, 500.25, 41.0, system=1, channel=-4),
    Channel(131, 3.8e7, 2.0e8, 1.0, 39.0, system=2),
    Channel(11, 2.5e7, 1.3e8, 2.0, 44.0, system=3, signal=12),
    Channel(20, 2.3e7, 1.2e8, 3.0, 43.0, system=4, signal=2),
    Channel(194, 3.6e7, 1.9e8, 4.0, 42.0, system=5, signal=14),
]
NAMES = ["G05 C1C", "G05 C2W", "R03 C1C", "S31 C1C", "E11 C5Q", "C20 C6I", "J02 C5Q"]


def small_log() -> bytes:
    parts = [gloephemeris(3, -4, 512_100.0), inav(11, 512_400), *(rawephem(7, subframes(), 410_400),)]
    for k in range(4):
        parts.append(range_b([Channel(5, lock_s=100.0 + k), *SKY[1:]], TOW_S + k))
        parts.append(inspvax(TOW_S + k))
        parts += [rawimusx(TOW_S + k + j / 100, (1000, -2000, 3000), (100, 200, -50_000)) for j in range(100)]
    return b"".join(parts)


LOG = small_log()


def read(folder: Path, data: bytes, scales: tuple[float, float] | None = None) -> ReceiverLog:
    path = folder / "log.gps"
    path.write_bytes(data)
    return read_novatel([path], scales)


def named(log: ReceiverLog) -> list[str]:
    gnss = log.gnss
    return [f"{gnss.sv_names[a]} {gnss.signal_names[b]}" for a, b in zip(gnss.sv, gnss.signal, strict=True)]


def test_range_has_the_numbers_that_were_sent(tmp_path: Path) -> None:
    gnss = (log := read(tmp_path, range_b(SKY))).gnss
    check_table(gnss)
    assert sorted(named(log)) == sorted(NAMES) and set(gnss.t_ns.tolist()) == {T0_NS}
    assert gnss.carrier_cycles is not None and gnss.lli is not None
    for k, name in enumerate(named(log)):
        sent = SKY[NAMES.index(name)]
        assert gnss.pseudorange_m[k] == sent.range_m and gnss.carrier_cycles[k] == sent.cycles
        assert gnss.doppler_hz[k] == np.float32(sent.doppler_hz) and gnss.cn0_dbhz[k] == sent.cn0
        assert gnss.lli[k] == (0 if sent.parity else 2)
    assert gnss.glonass_channels == {"R03": -4}


def test_compressed_range_has_the_same_numbers_to_its_resolution(tmp_path: Path) -> None:
    # phases near their ranges, as the wraps of 2^23 cycles need it
    glonass = Channel(40, 2.1e7, 2.1e7 * 1599.75e6 / C_MPS, 7.0, system=1, channel=-4)
    sky = [Channel(5, 2.2e7, 2.2e7 * 1575.42e6 / C_MPS + 1234.5), SKY[1], glonass]
    log = read(tmp_path, rangecmp(sky))
    gnss = log.gnss
    assert gnss.carrier_cycles is not None
    for name, sent in (("G05 C1C", sky[0]), ("R03 C1C", sky[2])):
        k = named(log).index(name)
        assert gnss.pseudorange_m[k] == pytest.approx(sent.range_m, abs=1 / 256)
        assert gnss.carrier_cycles[k] == pytest.approx(sent.cycles, abs=1 / 512)
        assert gnss.doppler_hz[k] == pytest.approx(sent.doppler_hz, abs=1 / 512)


def test_further_compressed_range_is_scaled_by_its_carrier(tmp_path: Path) -> None:
    base_m, doppler_l1 = 22_000_000, -1234.5
    signals = [
        (1, Channel(7, base_m + 10.25, lock_s=20.0), base_m + 11.5, doppler_l1),
        (4, Channel(7, base_m + 14.0, cn0=35.0), base_m + 15.0, doppler_l1 + 0.25),
    ]
    log = read(
        tmp_path,
        rangecmp2(0, 7, 0, base_m, -1230, signals)
        + rangecmp2(6, 21, 0, base_m, -1230, [(3, *signals[0][1:])]),
    )
    gnss = log.gnss
    assert gnss.carrier_cycles is not None
    one, two, beidou = (named(log).index(name) for name in ("G07 C1C", "G07 C2W", "C21 C7I"))
    assert gnss.pseudorange_m[[one, two]].tolist() == [base_m + 10.25, base_m + 14.0]
    assert gnss.carrier_cycles[one] * C_MPS / 1575.42e6 == pytest.approx(base_m + 11.5, abs=1e-3)
    assert gnss.carrier_cycles[beidou] * C_MPS / 1207.14e6 == pytest.approx(base_m + 11.5, abs=1e-3)
    assert gnss.doppler_hz[one] == pytest.approx(doppler_l1, abs=0.003)
    assert gnss.doppler_hz[two] == pytest.approx((doppler_l1 + 0.25) * 1227.6 / 1575.42, abs=0.003)
    assert gnss.cn0_dbhz[two] == 35.0


def test_compressed_messages_are_those_of_the_vendors_library(tmp_path: Path) -> None:
    oem = pytest.importorskip("novatel_edie.oem", reason="NovAtel's own library is not installed")
    sky = [
        Channel(k, 2.2e7 + 1e5 * k, (2.2e7 + 1e5 * k) * 1575.42e6 / C_MPS + k, 10.0 * k, lock_s=50.0)
        for k in range(1, 9)
    ]
    signals = [(1, Channel(7, 22_000_010.25, lock_s=20.0), 22_000_011.5, -1234.5)]
    for data in (rangecmp(sky), rangecmp2(1, 3, -4, 22_000_000, -1230, signals)):
        parser = oem.Parser()
        parser.decompress_range_cmp = True
        parser.write(data)
        theirs = read(tmp_path, b"".join(m.to_binary().message for m in parser)).gnss
        ours = read(tmp_path, data).gnss
        assert ours.sv_names == theirs.sv_names and np.array_equal(ours.t_ns, theirs.t_ns)
        for name in ("pseudorange_m", "doppler_hz", "carrier_cycles", "cn0_dbhz"):
            assert getattr(ours, name) == pytest.approx(getattr(theirs, name), abs=1e-6, rel=1e-8), name


def test_invalid_and_repeated_measurements_are_left_out(tmp_path: Path) -> None:
    rows = [
        Channel(5, code_lock=False, phase_lock=False),
        Channel(6, code_lock=False),
        Channel(7, phase_lock=False),
    ]
    rows += [Channel(8, signal=30), Channel(99)]
    log = read(tmp_path, range_b([*rows, *SKY[:1]]) + rangecmp(SKY[:1]) + range_b(SKY[2:3]) * 2)
    assert named(log) == ["G05 C1C", "G06 C1C", "G07 C1C", "R03 C1C"]
    assert np.isnan(log.gnss.pseudorange_m[1]) and np.isfinite(log.gnss.doppler_hz[1])
    assert log.gnss.carrier_cycles is not None and np.isnan(log.gnss.carrier_cycles[2])
    told = {event.kind: event.detail for event in log.events}
    assert "2 measurements of unknown" in told["novatel_signal_unknown"]
    assert "1 repeated" in told["gnss_epoch_repeated"]


def test_lock_that_began_anew_and_half_cycles_are_slips(tmp_path: Path) -> None:
    locks = [10.0, 11.0, 0.5, 1.5, 2.5]
    epochs = [range_b([Channel(5, lock_s=lock, half=k == 4)], TOW_S + k) for k, lock in enumerate(locks)]
    gnss = read(tmp_path, b"".join(epochs)).gnss
    assert gnss.lli is not None and gnss.lli.tolist() == [0, 0, 1, 0, 1]


def test_second_antenna_and_times_not_known_are_told(tmp_path: Path) -> None:
    log = read(tmp_path, range_b(SKY) + range_b(SKY, TOW_S + 1, form=1) + range_b(SKY, TOW_S + 2, status=20))
    assert set(log.gnss.t_ns.tolist()) == {T0_NS}
    assert {"novatel_other_antenna", "novatel_time_unknown"} <= {event.kind for event in log.events}


def test_ephemerides_have_the_elements_that_were_sent(tmp_path: Path) -> None:
    frames = [
        rawephem(7, subframes(), 410_400),
        inav(11, 512_400),
        gloephemeris(3, -4, 512_100.2),
        range_b(SKY),
    ]
    navigation = read(tmp_path, b"".join(frames)).navigation
    assert navigation is not None and navigation.state_vectors is not None
    table = navigation.ephemerides
    # the subframes' week contradicts the log's: refused; see the next test
    assert table.sv_names == ("E11",) and table.message == ("INAV",)
    assert table.toe_ns.tolist() == [(WEEK * 604_800 + 512_400) * 10**9]
    assert (table.m0[0], table.sqrt_a[0], table.omega_dot[0], table.cis[0]) == (0.5, 5440.6, -5e-9, -1e-8)
    assert table.group_delay_s.tolist() == [[-4e-9, -5e-9]] and table.health[0] == float(1 << 7 | 2 << 1 | 1)
    states = navigation.state_vectors
    assert states.sv_names == ("R03",) and states.channel.tolist() == [-4]
    assert states.t_ns.tolist() == [(WEEK * 604_800 + 512_100) * 10**9]
    assert states.r_e[0].tolist() == [1e7, -2e7, 5e6] and states.clock_s[0] == 3e-5


def test_subframes_of_gps_give_the_elements(tmp_path: Path) -> None:
    tow_s = SENT_NS / 1e9 - LNAV_WEEK * 604_800
    data = bytearray(rawephem(7, subframes(), 410_400))
    data = bytearray(message(41, bytes(data[28:-4]), tow_s, LNAV_WEEK))
    navigation = read(tmp_path, bytes(data) + inspvax(TOW_S) + inspvax(TOW_S + 1)).navigation
    assert navigation is not None and navigation.ephemerides.sv_names == ("G07",)
    assert navigation.ephemerides.m0[0] == pytest.approx(PARAMS["m0"], rel=1e-12)
    assert navigation.ephemerides.toe_ns.tolist() == [(LNAV_WEEK * 604_800 + 410_400) * 10**9]


def test_inertial_counts_become_rates_in_the_sensors_axes(tmp_path: Path) -> None:
    imu = (log := read(tmp_path, LOG)).imu
    assert imu is not None and log.imu_is_mean and len(imu.t_ns) == 400
    angle, velocity = SCALES[58]
    assert imu.w_ib_b[7] == pytest.approx(np.array([1000, -2000, 3000]) * angle * 100.0)
    assert imu.f_b[7] == pytest.approx(np.array([100, 200, -50_000]) * velocity * 100.0)


def test_scales_are_those_of_the_type_or_declared(tmp_path: Path) -> None:
    samples = [rawimusx(TOW_S + k / 100, (1, 2, 3), (4, 5, 6), kind=99) for k in range(20)]
    with pytest.raises(InputError, match=r"of type 99(.|\n)*--imu-scale"):
        read(tmp_path, b"".join(samples))
    imu = read(tmp_path, b"".join(samples), (1e-6, 1e-5)).imu
    assert imu is not None and imu.w_ib_b[0] == pytest.approx(np.array([1, 2, 3]) * 1e-4)
    plain = b"".join(rawimus(TOW_S + k / 100, (1, 2, 3), (4, 5, 6)) for k in range(20))
    with pytest.raises(InputError, match="of unknown type"):
        read(tmp_path, plain)
    imu = read(tmp_path, plain + message(1945, (26).to_bytes(4, "little") + bytes(40))).imu
    assert imu is not None and imu.f_b[0] == pytest.approx(np.array([4, 5, 6]) * 2e-8 * 100.0)
    log = read(tmp_path, plain + range_b(SKY))
    assert log.imu is None and "imu_not_used" in {event.kind for event in log.events}


def test_samples_in_error_are_left_out_and_told(tmp_path: Path) -> None:
    samples = [rawimusx(TOW_S + k / 100, (1, 2, 3), (4, 5, 6), info=int(k == 3)) for k in range(20)]
    log = read(tmp_path, b"".join(samples))
    assert log.imu is not None and len(log.imu.t_ns) == 19
    assert "imu_faulty" in {event.kind for event in log.events}


@pytest.mark.parametrize("one", [inspvax, inspvas])
def test_inertial_solution_is_a_reference(tmp_path: Path, one: object) -> None:
    states = {0: 1, 1: 3, 2: 6, 3: 3}
    log = read(tmp_path, b"".join(one(TOW_S + k, status) for k, status in states.items()))  # type: ignore[operator]
    own = log.solution
    assert own is not None and own.quality.tolist() == [1.0, 2.0, 1.0] and log.solution_point == "imu"
    assert (own.lat_deg[0], own.lon_deg[0], own.h_m[0]) == (51.15, -114.03, 1063.0)
    assert own.v_n[0].tolist() == [1.0, 2.0, -0.5] and own.rpy_deg[0].tolist() == [-1.5, 2.5, 90.0]
    if one is inspvax:
        assert own.sigma is not None and own.sigma[0] == pytest.approx([0.1 * k for k in range(1, 10)])
    assert "novatel_no_solution" in {event.kind for event in log.events}


def test_best_position_takes_the_velocity_of_its_time(tmp_path: Path) -> None:
    data = b"".join(
        bestpos(TOW_S + k) + (bestvel(TOW_S + k, 10.0, 90.0, 0.5) if k else b"") for k in range(3)
    )
    own = (log := read(tmp_path, data)).solution
    assert own is not None and log.solution_point == "antenna" and len(own.t_ns) == 3
    assert np.isnan(own.v_n[0]).all() and own.v_n[1] == pytest.approx([0.0, 10.0, -0.5], abs=1e-12)


def test_position_along_the_axes_of_the_earth_is_read_where_there_is_no_other(tmp_path: Path) -> None:
    """On the equator at 90 deg east north is z, east is -x, down is -y."""
    on_equator = (0.0, 6_378_137.0 + 250.0, 0.0)
    data = b"".join(bestxyz(TOW_S + k, on_equator, (-2.0, -0.5, 1.0)) for k in range(3))
    lost = bestxyz(TOW_S + 3, on_equator, (0.0, 0.0, 0.0), status=1)
    own = (log := read(tmp_path, data + lost)).solution
    assert own is not None and own.t_ns.tolist() == [(WEEK * 604_800 + TOW_S + k) * 10**9 for k in range(3)]
    assert (own.lat_deg[0], own.lon_deg[0], own.h_m[0]) == pytest.approx((0.0, 90.0, 250.0), abs=1e-8)
    assert own.v_n[0] == pytest.approx([1.0, 2.0, 0.5], abs=1e-12)
    assert log.solution_point == "antenna" and log.satellite_fixes() is own
    kinds = {event.kind: event.detail for event in log.events}
    assert "1 row(s)" in kinds["novatel_no_solution"] and "novatel_not_used" not in kinds
    # BESTPOS holds its sigmas too
    both = read(tmp_path, data + b"".join(bestpos(TOW_S + k) for k in range(3))).solution
    assert both is not None and both.lat_deg[0] == 51.15


def test_damage_cuts_and_other_messages_are_told(tmp_path: Path) -> None:
    whole = read(tmp_path, LOG)
    spoilt = bytearray(b"<OK\r\n" + LOG + message(83, bytes(40)) + message(2050, bytes(20)) + LOG[-60:-20])
    spoilt[LOG.index(range_b([Channel(5, lock_s=101.0), *SKY[1:]], TOW_S + 1)) + 60] ^= 4
    log = read(tmp_path, bytes(spoilt))
    assert len(log.gnss.t_ns) == len(whole.gnss.t_ns) - 7
    told = {event.kind: event.detail for event in log.events}
    assert "wrong checksum" in told["novatel_checksum"] and "novatel_cut" in told
    assert "1 of 83" in told["novatel_not_used"] and "1 RANGECMP4" in told["novatel_compressed"]
    assert "bytes are not NovAtel" in told["novatel_foreign_bytes"]


def test_a_log_of_nothing_that_is_read_says_what_to_log(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"RANGECMP4(.|\n)*RANGEB"):
        read(tmp_path, message(2050, bytes(20)))
    with pytest.raises(InputError, match="messages not read, by number: 2 of 93"):
        read(tmp_path, 2 * message(93, bytes(20)))
    with pytest.raises(InputError, match="no NovAtel message"):
        read(tmp_path, b"\xaa\x44\x12 nothing of the kind")


def test_converted_log_is_a_whole_flight(tmp_path: Path) -> None:
    path = tmp_path / "flight.csv"
    path.write_bytes(LOG)
    assert detect_format(path) == "novatel"
    done = convert([path], tmp_path / "out")
    names = ["gnss_obs.csv", "navigation.rnx", "imu.csv", "reference.csv", "flight.toml"]
    assert [p.name for p in done.written] == names
    flight, table = read_again(tmp_path / "out")
    same(done.log.gnss, table)
    samples, _ = read_imu(inertial(flight.config), flight.config.gps_week, flight.imu_grade)
    assert done.log.imu is not None and samples.t_ns[-1] == done.log.imu.t_ns[-1]
    config = Flight.load(tmp_path / "out" / "flight.toml").config
    assert config.reference is not None and config.reference.point == "imu"
    assert config.imu is not None and 'sampling = "mean"' in (tmp_path / "out" / "flight.toml").read_text()
    assert len(read_reference(config.reference, config.gps_week)[0].t_ns) == 4


def test_scale_is_an_option_of_the_command(tmp_path: Path) -> None:
    samples = [rawimusx(TOW_S + k / 100, (1, 2, 3), (4, 5, 6), kind=99) for k in range(20)]
    (tmp_path / "log").write_bytes(b"".join(samples))
    asked = ["convert", str(tmp_path / "log"), "-o", str(tmp_path / "out")]
    assert "--imu-scale" in CliRunner().invoke(app, asked).output
    assert CliRunner().invoke(app, [*asked, "--imu-scale", "1e-6,zero"]).exit_code == 2
    assert CliRunner().invoke(app, [*asked, "--imu-scale", "1e-6,1e-5"]).exit_code == 0


def test_ascii_without_a_sound_check_sum_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "log").write_text(
        "#BESTPOSA,COM1,0,70.5,FINESTEERING,1919,228459.000,00000020,b1f6,32768;SOL*aa\r\n" * 9
    )
    with pytest.raises(InputError, match="NovAtel ASCII"):
        detect_format(tmp_path / "log")


FUZZED = b"".join(
    [
        *(range_b(SKY, TOW_S + k) for k in range(2)),
        *(rangecmp(SKY, TOW_S + k) for k in (2, 3)),
        rangecmp2(
            0, 7, 0, 22_000_000, -1230, [(1, Channel(7, 22_000_010.25, lock_s=2.0), 22_000_011.5, -1234.5)]
        ),
        *(rawimusx(TOW_S + k / 100, (1, 2, 3), (4, 5, 6)) for k in range(5)),
        *(gloephemeris(3, -4, 512_100.0), inav(11, 512_400), rawephem(7, subframes(), 410_400)),
        *(inspvax(TOW_S + k) for k in range(3)),
        *(bestpos(TOW_S) + bestvel(TOW_S, 1.0, 2.0, 3.0), short(508, bytes(88))),
        bestxyz(TOW_S, (0.0, 6_378_137.0, 0.0), (1.0, 2.0, 3.0)),
        *(heading2(TOW_S + k, 45.0) for k in range(2)),
    ]
)
