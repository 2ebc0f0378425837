"""Receivers' files converted and read again through the flight file that was written: the same numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from insgnss.cli.command import OwnCommand
from insgnss.cli.convert import convert as command
from insgnss.errors import ConfigError, InputError
from insgnss.log.android.reader import COEFFICIENTS
from insgnss.log.convert import convert
from insgnss.log.flight import Flight
from insgnss.log.gnss_csv import read_gnss
from insgnss.log.gnss_log import read_gnss_logs
from insgnss.log.imu.csv_log import inertial, read_imu
from insgnss.log.reference import read_reference
from insgnss.log.rinex.navigation import read_navigation
from insgnss.tables import GnssTable
from tests.log.android_generator import ELAPSED_MINUS_TIME_NS
from tests.log.android_generator import HEADER as ANDROID_HEADER
from tests.log.android_generator import epoch as android_epoch
from tests.log.android_generator import sensor as android_sensor
from tests.log.sbf_encoder import Channel, epoch, ins_solution, satellite, sensor
from tests.log.test_android import SKY, T
from tests.log.test_rinex_navigation import HEADER as NAV_HEADER
from tests.log.test_rinex_navigation import message
from tests.log.test_rinex_observations import HEADER as OBS_HEADER
from tests.log.test_rinex_observations import epoch as rinex_epoch
from tests.log.test_sbf import bds_nav, gal_nav, gps_nav

APP = typer.Typer()
APP.command(cls=OwnCommand)(command)


def same(a: GnssTable, b: GnssTable) -> None:
    assert np.array_equal(a.t_ns, b.t_ns)
    for name in ("pseudorange_m", "doppler_hz", "cn0_dbhz", "carrier_cycles", "lli"):
        one, other = getattr(a, name), getattr(b, name)
        assert (one is None) == (other is None)
        assert one is None or np.array_equal(one, other, equal_nan=True), name
    assert [a.sv_names[k] for k in a.sv] == [b.sv_names[k] for k in b.sv]
    assert [a.signal_names[k] for k in a.signal] == [b.signal_names[k] for k in b.signal]


def read_again(folder: Path) -> tuple[Flight, GnssTable]:
    flight = Flight.load(folder / "flight.toml")
    table, events = read_gnss(flight.config.gnss, flight.config.gps_week)
    assert events == []
    return flight, table


def sbf_file(folder: Path) -> Path:
    sky = [satellite(k, [Channel(0, 1575.42e6, 2.3e7 + k / 7, -0.1 * k, None, 40.0)]) for k in range(1, 9)]
    blocks = [epoch(340_000.0 + k / 10, sky) for k in range(20)]
    blocks += [sensor(340_000.0 + k / 100, (1.0, 0.0, -k), (0.5 * k, 0.0, -9.8)) for k in range(200)]
    path = folder / "receiver.bin"
    path.write_bytes(b"".join([*blocks, gps_nav(), bds_nav(), gal_nav(2, 1)]))
    return path


@pytest.mark.real_data
@pytest.mark.parametrize(
    "name",
    [
        "walk_boulder_20250828/raw/gnss_1730.ubx",
        "instinct_static_20230629/reach_m2_static_10min.23O.gz",
    ],
)
def test_real_file_converted_gives_the_same_measurements(data_root: Path, tmp_path: Path, name: str) -> None:
    done = convert([data_root / name], tmp_path / "out")
    flight, table = read_again(tmp_path / "out")
    same(done.log.gnss, table)
    if done.log.navigation is not None:
        again, events = read_navigation(flight.config.gnss.navigation)
        assert events == [] and len(again.ephemerides.sv_names) == len(
            done.log.navigation.ephemerides.sv_names
        )
    assert bool(flight.config.gnss.navigation) == (done.log.navigation is not None)


@pytest.mark.real_data
def test_real_u_blox_log_holds_what_another_decoder_found_in_it(data_root: Path, tmp_path: Path) -> None:
    convert([data_root / "walk_boulder_20250828" / "raw" / "gnss_1730.ubx"], tmp_path / "out")
    flight, table = read_again(tmp_path / "out")
    theirs = data_root / "walk_boulder_20250828" / "nav_decoded_from_ubx.rnx"
    expected = read_navigation([theirs])[0].ephemerides
    found = read_navigation(flight.config.gnss.navigation)[0].ephemerides
    rows = {(sv, int(toe)): k for k, (sv, toe) in enumerate(zip(found.sv_names, found.toe_ns, strict=True))}
    assert table.t_ns[0] == (2381 * 604_800 + 408_639) * 10**9 + 748_000_000
    for k, key in enumerate(zip(expected.sv_names, expected.toe_ns.tolist(), strict=True)):
        for name in ("sqrt_a", "e", "m0", "omega0", "crs", "af0"):
            ours, other = getattr(found, name)[rows[key]], getattr(expected, name)[k]
            assert ours == pytest.approx(other, rel=1e-11), (key, name)


def test_septentrio_log_becomes_a_whole_flight(tmp_path: Path) -> None:
    done = convert([sbf_file(tmp_path)], tmp_path / "out")
    assert [path.name for path in done.written] == [
        "gnss_obs.csv",
        "navigation.rnx",
        "imu.csv",
        "flight.toml",
    ]
    flight, table = read_again(tmp_path / "out")
    same(done.log.gnss, table)
    logs, _ = read_imu(inertial(flight.config), flight.config.gps_week, flight.imu_grade)
    assert done.log.imu is not None and logs.t_ns[-1] == done.log.imu.t_ns[-1]
    assert read_navigation(flight.config.gnss.navigation)[0].ephemerides.sv_names == ("C20", "E36", "G05")


def test_phone_log_becomes_measurements_and_samples(tmp_path: Path) -> None:
    texts = [android_epoch(T + k * 10**9, SKY.values()) for k in range(3)]
    start = T + ELAPSED_MINUS_TIME_NS
    for kind in ("UncalGyro", "UncalAccel"):
        texts += [android_sensor(kind, start + k * 5_000_000, (0.0, 0.1, 9.8)) for k in range(100)]
    path = tmp_path / "log"
    path.write_text(ANDROID_HEADER + "".join(texts))
    done = convert([path], tmp_path / "out")
    same(done.log.gnss, read_again(tmp_path / "out")[1])
    text = (tmp_path / "out" / "flight.toml").read_text()
    assert "# navigation" in text and "DECLARE" in text and "# lever_arm_m" in text
    # CSV has no place for the channels, the flight file has
    flight = Flight.load(tmp_path / "out" / "flight.toml")
    assert flight.config.gnss.glonass_channels == {"R02": -4}
    # it lies flat: gravity's reaction is along its z, out of the screen, which is upwards
    body = read_imu(inertial(flight.config), flight.config.gps_week, flight.imu_grade)[0]
    assert np.allclose(body.f_b, (0.1, 0.0, -9.8), rtol=0, atol=1e-9)


def test_log_without_samples_becomes_a_flight_that_needs_none(tmp_path: Path) -> None:
    (tmp_path / "obs").write_text(OBS_HEADER + rinex_epoch())
    convert([tmp_path / "obs"], tmp_path / "out")
    flight = Flight.load(tmp_path / "out" / "flight.toml")
    assert flight.config.imu is None and flight.inertial_files() == ()
    with pytest.raises(ConfigError, match="no inertial log"):
        flight.read()


def test_satellite_states_of_a_phone_are_written_where_no_message_serves(tmp_path: Path) -> None:
    names = [f"SvPositionEcef{a}Meters" for a in "XYZ"] + [f"SvVelocityEcef{a}MetersPerSecond" for a in "XYZ"]
    names += ["SvClockBiasMeters", "SvClockDriftMetersPerSecond"]
    header = ANDROID_HEADER.replace(
        ",ChipsetElapsedRealtimeNanos", ",ChipsetElapsedRealtimeNanos," + ",".join(names)
    )
    line = android_epoch(T, [SKY["G05", "C1C"]]).rstrip() + ",1.5e7,1.6e7,1.7e7,10.0,20.0,30.0,1000.0,0.01\n"
    (tmp_path / "log").write_text(header + line)
    convert([tmp_path / "log"], tmp_path / "out")
    assert read_again(tmp_path / "out")[1].sat is not None
    of_the_day = {"toc": "2024 05 17 16 00 00", "toe": 489_600.0, "week": 2314.0}
    for case, entry in (("served", of_the_day), ("another_day", {})):
        (tmp_path / "brdc.rnx").write_text(NAV_HEADER + message(**entry))
        done = convert([tmp_path / "log", tmp_path / "brdc.rnx"], tmp_path / case)
        sat, kinds = read_again(tmp_path / case)[1].sat, [e.kind for e in done.events]
        if case == "served":
            assert sat is None and kinds == ["satellite_states_not_used"]
        else:
            assert sat is not None and sat[0, :3].tolist() == [1.5e7, 1.6e7, 1.7e7]
            assert kinds == ["satellite_states_beside"] and "1 rows of G" in done.events[0].detail


def test_coefficients_of_a_phone_are_written_with_its_states(tmp_path: Path) -> None:
    names = [f"SvPositionEcef{a}Meters" for a in "XYZ"] + [f"SvVelocityEcef{a}MetersPerSecond" for a in "XYZ"]
    names += ["SvClockBiasMeters", "SvClockDriftMetersPerSecond", *COEFFICIENTS]
    header = ANDROID_HEADER.replace(
        ",ChipsetElapsedRealtimeNanos", ",ChipsetElapsedRealtimeNanos," + ",".join(names)
    )
    told = "1.5e-8,0.0,-1.25e-7,1.25e-7,122880.0,-32768.0,-196608.0,-65536.0"
    states = "1.5e7,1.6e7,1.7e7,10.0,20.0,30.0,1000.0,0.01"
    lines = [
        android_epoch(T + k * 10**9, [SKY["G05", "C1C"]]).rstrip() + f",{states},{cells}\n"
        for k, cells in enumerate([",".join(["0.0"] * 8), told, told, "," * 7])
    ]
    (tmp_path / "log").write_text(header + "".join(lines))
    assert not convert([tmp_path / "log"], tmp_path / "out").events
    flight = Flight.load(tmp_path / "out" / "flight.toml")
    logs = read_gnss_logs(flight.config.gnss, flight.config.gps_week, flight.path)
    assert logs.navigation is not None and logs.navigation.klobuchar is not None
    assert logs.navigation.klobuchar == pytest.approx([float(x) for x in told.split(",")], rel=1e-4)
    assert logs.gnss.sat is not None and not logs.navigation.has_messages


def test_septentrio_log_of_samples_and_solution_alone_is_converted(tmp_path: Path) -> None:
    blocks = [sensor(340_000.0 + k / 100, (1.0, 0.0, -k), (0.5 * k, 0.0, -9.8)) for k in range(200)]
    blocks += [ins_solution(340_000.0 + k / 10) for k in range(20)]
    path = tmp_path / "ins.sbf"
    path.write_bytes(b"".join(blocks))
    done = convert([path], tmp_path / "out")
    assert [p.name for p in done.written] == ["imu.csv", "reference.csv", "flight.toml"]
    flight = Flight.load(tmp_path / "out" / "flight.toml")
    assert flight.config.reference is not None and flight.config.reference.point == "antenna"
    reference, events = read_reference(flight.config.reference, flight.config.gps_week)
    assert events == [] and reference.sigma is not None and done.log.solution is not None
    assert done.log.solution.sigma is not None
    assert np.array_equal(reference.rpy_deg, done.log.solution.rpy_deg)
    assert np.array_equal(reference.sigma, done.log.solution.sigma)
    assert len(read_imu(inertial(flight.config), flight.config.gps_week, flight.imu_grade)[0].t_ns) == 200
    with pytest.raises(InputError, match=r"gnss_obs\.csv"):
        flight.read()


def test_septentrio_measurements_and_samples_in_two_files_make_one_flight(tmp_path: Path) -> None:
    whole = sbf_file(tmp_path).read_bytes()
    cut = whole.index(sensor(340_000.0, (1.0, 0.0, 0.0), (0.0, 0.0, -9.8)))
    (tmp_path / "a").write_bytes(whole[cut:])
    (tmp_path / "b").write_bytes(whole[:cut])
    done = convert([tmp_path / "a", tmp_path / "b"], tmp_path / "out")
    assert [p.name for p in done.written] == ["gnss_obs.csv", "navigation.rnx", "imu.csv", "flight.toml"]


def test_command_says_that_a_log_of_samples_needs_its_measurements(tmp_path: Path) -> None:
    path = tmp_path / "ins.sbf"
    path.write_bytes(
        b"".join(sensor(340_000.0 + k / 100, (1.0, 0.0, 0.0), (0.0, 0.0, -9.8)) for k in range(200))
    )
    result = CliRunner().invoke(APP, [str(path), "--output", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    assert "no raw measurements" in result.output and "200 inertial samples" in result.output


@pytest.mark.real_data
@pytest.mark.parametrize(
    ("name", "samples", "solution"),
    [
        ("ubx_inertial/ublox-neo-m8l.log", 210, 19),
        ("ubx_inertial/ublox-neo-m8u.log", 290, 3),
        ("sbf_inertial/sbf_binary.sbf", 5564, 5565),
    ],
)
def test_real_file_of_inertial_data_alone_is_converted(
    data_root: Path, tmp_path: Path, name: str, samples: int, solution: int
) -> None:
    done = convert([data_root / name], tmp_path / "out")
    flight = Flight.load(tmp_path / "out" / "flight.toml")
    imu, _ = read_imu(inertial(flight.config), flight.config.gps_week, flight.imu_grade)
    assert len(imu.t_ns) == samples and done.messages == 0
    assert (0 if done.log.solution is None else len(done.log.solution.t_ns)) == solution


def test_navigation_file_given_is_copied_and_named(tmp_path: Path) -> None:
    (tmp_path / "obs").write_text(OBS_HEADER + rinex_epoch())
    (tmp_path / "brdc.rnx").write_text(NAV_HEADER + message())
    convert([tmp_path / "brdc.rnx", tmp_path / "obs"], tmp_path / "out")
    flight = Flight.load(tmp_path / "out" / "flight.toml")
    assert [path.name for path in flight.config.gnss.navigation] == ["brdc.rnx"]
    assert flight.config.gnss.navigation[0].read_text() == NAV_HEADER + message()


def test_flight_file_that_is_there_is_kept(tmp_path: Path) -> None:
    path = sbf_file(tmp_path)
    convert([path], tmp_path / "out")
    (tmp_path / "out" / "flight.toml").write_text("mine")
    done = convert([path], tmp_path / "out")
    assert (tmp_path / "out" / "flight.toml").read_text() == "mine" and done.kept != ()


def test_command_says_what_it_read_and_wrote(tmp_path: Path) -> None:
    result = CliRunner().invoke(APP, [str(sbf_file(tmp_path)), "--output", str(tmp_path / "out")])
    assert result.exit_code == 0
    for word in (
        "Septentrio SBF",
        "160 measurements of 8 satellites",
        "3 broadcast messages",
        "flight.toml",
        " s in all",
    ):
        assert word in result.output


@pytest.mark.parametrize(
    ("content", "code"), [(None, 3), (b"nothing of the kind", 3), (OBS_HEADER.encode(), 3), (b"", 3)]
)
def test_command_ends_with_the_exit_code_of_an_input_error(
    tmp_path: Path, content: bytes | None, code: int
) -> None:
    path = tmp_path / "file"
    if content is not None:
        path.write_bytes(content)
    result = CliRunner().invoke(APP, [str(path), "-o", str(tmp_path / "out")])
    assert result.exit_code == code and "error: " in result.stderr
    assert not (tmp_path / "out").exists()


def test_command_ends_with_the_code_of_a_result_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file where the folder should be")
    result = CliRunner().invoke(APP, [str(sbf_file(tmp_path)), "-o", str(tmp_path / "out")])
    assert result.exit_code == 5
