"""PX4 ULog files, written by a writer of our own, become tables with those numbers."""

from __future__ import annotations

import builtins
import datetime as dt
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import insgnss
from insgnss.cli.main import app
from insgnss.errors import ConfigError, InputError
from insgnss.gpstime import utc_to_ns
from insgnss.log.convert import convert
from insgnss.log.detect import detect_format
from insgnss.log.receiver import ReceiverLog
from insgnss.log.reference import read_reference
from insgnss.log.ulog.reader import read_ulog
from tests.log.test_convert import read_again, same
from tests.log.test_messages_lnav import subframes
from tests.log.ubx_writing import rawx
from tests.log.ulog_writer import COMBINED, DUMP, GPS, VEHICLE_IMU, Ulog, message, rows

UTC = dt.datetime(2025, 8, 28, 17, 30, 21)
UTC_US = int(UTC.replace(tzinfo=dt.UTC).timestamp()) * 1_000_000
BOOT_US = 50_000_000  # of the autopilot, at UTC
RATE = 20e-6  # by which the autopilot's clock is slow


def boot_us(after_s: float) -> int:
    return BOOT_US + round(after_s * 1e6 * (1 - RATE))


def flown(seconds: int = 100, dump: bool = True) -> Ulog:
    log = Ulog()
    log.topic("sensor_combined", COMBINED)
    log.topic("vehicle_imu", VEHICLE_IMU)
    log.topic("vehicle_gps_position", GPS)
    log.topic("battery_status", [("float", "voltage_v")])
    if dump:
        log.topic("gps_dump", DUMP)
    for k in range(seconds):
        log.sync()
        utc = UTC_US + k * 1_000_000
        log.row("vehicle_gps_position", boot_us(k), utc, 47.0, 8.0 + 1e-6 * k, 500.0, 547.5, 0.2, 1.5, 2.5, 1.0, 2.0,
                -0.5, 0, 3)  # fmt: skip
        for j in range(10):
            t = boot_us(k + j / 10)
            log.row(
                "sensor_combined", t, (0.1, -0.2, 0.3), 100_000, -5000 if j else 0, (0.0, 0.5, -9.8), 100_000
            )
        log.row("vehicle_imu", boot_us(k), boot_us(k), (0.01, 0.0, 0.0), (0.0, 0.0, -0.98), 100_000, 100_000)
        log.row("battery_status", boot_us(k), 12.0)
    if dump:
        stream = b"".join(rawx(408_639.0 + k) for k in range(5))
        for at in range(0, len(stream), 79):
            piece = stream[at : at + 79]
            log.row("gps_dump", boot_us(1), 0, len(piece), piece.ljust(79, b"\xee"))
            log.row("gps_dump", boot_us(1), 0, 0x80 | 10, b"to the receiver".ljust(79))
    return log


def read(folder: Path, data: bytes, **topics: str) -> ReceiverLog:
    pytest.importorskip("pyulog", reason="the extra 'ulog' is not installed")
    path = folder / "log"
    path.write_bytes(data)
    return read_ulog(path, topics)


def test_samples_are_dated_by_the_messages_of_the_receiver(tmp_path: Path) -> None:
    log = read(tmp_path, flown().data)
    assert log.imu is not None and log.imu_is_mean
    first = np.flatnonzero(log.imu.t_ns >= utc_to_ns(UTC) + 90 * 10**9 - 10**6)[0]
    assert log.imu.t_ns[first] == pytest.approx(utc_to_ns(UTC) + 90 * 10**9, abs=5000)
    assert log.imu.w_ib_b[7] == pytest.approx([0.1, -0.2, 0.3], rel=1e-6)
    assert log.imu.f_b[7] == pytest.approx([0.0, 0.5, -9.8], rel=1e-6)
    told = {event.kind: event.detail for event in log.events}
    assert "100 battery_status" in told["ulog_not_used"] and "100 vehicle_imu:0" in told["ulog_imu_chosen"]
    assert "scatter 0.000 s" in told["imu_time_estimated"]


def test_pressure_and_field_are_the_logs_further_samples(tmp_path: Path) -> None:
    log = flown()
    log.topic("vehicle_air_data", [("uint64_t", "timestamp_sample"), ("float", "baro_pressure_pa")])
    log.topic("vehicle_magnetometer", [("float[3]", "magnetometer_ga")])
    for k in range(100):
        log.row("vehicle_air_data", boot_us(k) + 700, boot_us(k), 95_012.5 + k)
        log.row("vehicle_magnetometer", boot_us(k), (0.25, -0.5, 0.375))
    found = {samples.kind: samples for samples in read(tmp_path, log.data).further}
    pressure, field = found["barometer"], found["magnetometer"]
    assert pressure.t_ns[5] == pytest.approx(utc_to_ns(UTC) + 5 * 10**9, abs=5000)
    assert pressure.values[5, 0] == pytest.approx(950.175, abs=1e-9) and len(pressure.t_ns) == 100
    assert field.values[7].tolist() == [25.0, -50.0, 37.5]


def test_topic_is_the_named_one(tmp_path: Path) -> None:
    log = read(tmp_path, flown().data, imu="vehicle_imu")
    assert log.imu is not None and len(log.imu.t_ns) == 100
    assert log.imu.w_ib_b[3] == pytest.approx([0.1, 0.0, 0.0], rel=1e-6)
    assert log.imu.f_b[3] == pytest.approx([0.0, 0.0, -9.8], rel=1e-6)
    with pytest.raises(InputError, match=r"vehicle_imu:1(.|\n)*sensor_combined"):
        read(tmp_path, flown().data, imu="vehicle_imu:1")


def test_accelerometer_and_gyro_of_their_own_topics(tmp_path: Path) -> None:
    log = Ulog()
    for name in ("sensor_gyro", "sensor_accel"):
        log.topic(name, [("uint64_t", "timestamp_sample"), ("float", "x"), ("float", "y"), ("float", "z")])
    log.topic("sensor_gps", GPS)
    for k, t in rows(BOOT_US, 100_000, 50).items():
        log.row("sensor_gyro", t + 300, t, 0.1, 0.2, 0.3)
        log.row("sensor_accel", t + 300, t, 1.0, 2.0, -9.0)
        log.row("sensor_gps", t, UTC_US + k * 100_000, 47.0, 8.0, 1.0, 1.0, 1, 1, 1, 0, 0, 0, 0, 3)
    imu = read(tmp_path, log.data).imu
    assert imu is not None and len(imu.t_ns) == 50 and imu.f_b[4].tolist() == [1.0, 2.0, -9.0]


def test_fixes_are_the_reference_where_there_is_no_solution(tmp_path: Path) -> None:
    own = read(tmp_path, flown().data).solution
    assert own is not None and len(own.t_ns) == 100 and (own.quality == 2.0).all()
    assert own.t_ns[5] == utc_to_ns(UTC) + 5 * 10**9
    assert (own.lat_deg[0], own.h_m[0]) == (47.0, 547.5) and own.v_n[0].tolist() == [1.0, 2.0, -0.5]
    assert own.sigma is not None and own.sigma[0, :3].tolist() == [1.5, 1.5, 2.5]


def test_autopilots_solution_has_attitude_and_heights_above_the_ellipsoid(tmp_path: Path) -> None:
    log = flown(20)
    log.topic(
        "vehicle_global_position", [("double", "lat"), ("double", "lon"), ("float", "alt"), ("float", "eph")]
    )
    log.topic("vehicle_local_position", [("float", "vx"), ("float", "vy"), ("float", "vz")])
    log.topic("vehicle_attitude", [("float[4]", "q")])
    half = np.radians(30.0) / 2
    for k in range(20):
        log.row("vehicle_global_position", boot_us(k), 47.0, 8.0, 500.0, 0.5)
        log.row("vehicle_local_position", boot_us(k) + 2000, 1.0, 2.0, 3.0)
        log.row("vehicle_attitude", boot_us(k) - 1000, (np.cos(half), 0.0, 0.0, np.sin(half)))
    own = read(tmp_path, log.data).solution
    assert own is not None and own.h_m[0] == 547.5 and own.v_n[3].tolist() == [1.0, 2.0, 3.0]
    assert own.rpy_deg[3] == pytest.approx([0.0, 0.0, 30.0], abs=1e-4)
    fixes = read(tmp_path, log.data, reference="vehicle_gps_position").solution
    assert fixes is not None and np.isnan(fixes.rpy_deg).all()


def simulated() -> Ulog:
    """Return a log with the solution's topics and, moved by 1e-5 deg and 1 m/s, those of the truth."""
    log = flown(20)
    for k, ending in enumerate(("", "_groundtruth")):
        place = [("double", "lat"), ("double", "lon"), ("float", "alt"), ("float", "alt_ellipsoid")]
        log.topic(f"vehicle_global_position{ending}", place)
        log.topic(f"vehicle_local_position{ending}", [("float", "vx"), ("float", "vy"), ("float", "vz")])
        log.topic(f"vehicle_attitude{ending}", [("float[4]", "q")])
        for j in range(20):
            log.row(f"vehicle_global_position{ending}", boot_us(j), 47.0 + 1e-5 * k, 8.0, 500.0, 0.0)
            log.row(f"vehicle_local_position{ending}", boot_us(j), 1.0 + k, 2.0, 3.0)
            log.row(f"vehicle_attitude{ending}", boot_us(j), (float(1 - k), 0.0, 0.0, float(k)))
    return log


def test_truth_of_a_simulator_is_the_reference(tmp_path: Path) -> None:
    log = read(tmp_path, simulated().data)
    true = log.solution
    assert true is not None and log.solution_from == "truth" and (true.quality == 1.0).all()
    assert true.lat_deg[4] == 47.00001 and true.h_m[4] == 547.5 and true.v_n[4].tolist() == [2.0, 2.0, 3.0]
    assert abs(true.rpy_deg[4, 2]) == 180.0 and true.sigma is not None and np.isnan(true.sigma).all()
    told = {event.kind: event.detail for event in log.events}
    assert "simulator's truth (vehicle_global_position_groundtruth" in told["reference_truth"]
    assert "groundtruth" not in told["ulog_not_used"] and "reference_own" not in told


def test_solution_of_a_simulated_flight_is_the_reference_where_it_is_named(tmp_path: Path) -> None:
    log = read(tmp_path, simulated().data, reference="vehicle_global_position")
    assert log.solution is not None and log.solution_from == "filter" and log.solution.lat_deg[0] == 47.0
    assert (log.solution.quality == 2.0).all()
    fixes = log.satellite_fixes()
    assert fixes is not None and np.isnan(fixes.rpy_deg).all() and fixes.h_m[0] == 547.5
    absent = read(tmp_path, simulated().data, reference="vehicle_attitude")
    assert absent.solution is None and absent.satellite_fixes() is absent.fixes is not None


def test_flight_file_of_a_simulation_calls_the_reference_truth(tmp_path: Path) -> None:
    pytest.importorskip("pyulog", reason="the extra 'ulog' is not installed")
    (tmp_path / "log").write_bytes(simulated().data)
    told = CliRunner().invoke(app, ["convert", str(tmp_path / "log"), "-o", str(tmp_path / "out")]).output
    text = (tmp_path / "out" / "flight.toml").read_text()
    assert "20 rows of the simulator's truth" in told
    assert "# The truth of the simulator.\n[reference]" in text and "not independent" not in text
    assert not (tmp_path / "out" / "fixes.csv").exists()  # the raw measurements hold more


def standing(seconds: int) -> Ulog:
    """Return a log of PX4 without raw measurements: a vehicle at rest, level, and PX4's own solution, 1 m north."""
    log = Ulog()
    log.topic("sensor_combined", COMBINED)
    log.topic("vehicle_gps_position", GPS)
    log.topic("vehicle_global_position", [("double", "lat"), ("double", "lon"), ("float", "alt")])
    log.topic("vehicle_attitude", [("float[4]", "q")])
    rng = np.random.default_rng(11)
    for k in range(seconds):
        utc = UTC_US + k * 1_000_000
        log.row(
            "vehicle_gps_position",
            boot_us(k),
            utc,
            47.0,
            8.0,
            500.0,
            547.5,
            0.2,
            1.5,
            2.5,
            0.0,
            0.0,
            0.0,
            0,
            3,
        )
        log.row("vehicle_global_position", boot_us(k), 47.0 + 9e-6, 8.0, 500.0)
        log.row("vehicle_attitude", boot_us(k), (1.0, 0.0, 0.0, 0.0))
        for j in range(50):
            rate, force = rng.normal(0.0, 1e-3, 3), rng.normal([0.0, 0.0, -9.807], 0.01)
            log.row("sensor_combined", boot_us(k + j / 50), tuple(rate), 20_000, 0, tuple(force), 20_000)
    return log


def test_autopilots_log_without_raw_measurements_is_replayed_with_its_receivers_fixes(tmp_path: Path) -> None:
    pytest.importorskip("pyulog", reason="the extra 'ulog' is not installed")
    (tmp_path / "log").write_bytes(standing(30).data)
    told = CliRunner().invoke(app, ["convert", str(tmp_path / "log"), "-o", str(tmp_path / "out")]).output
    assert "no raw measurements: 30 fixes of the receiver take their place" in told
    text = (tmp_path / "out" / "flight.toml").read_text()
    assert text.count('files = ["fixes.csv"]') == 2 and 'file = "reference.csv"' in text
    assert (
        "The filter's own solution" in text and "computed from the same fixes, not independent truth" in text
    )
    run = insgnss.replay(tmp_path / "out" / "flight.toml")
    used = run.status_counts().loc["used"]
    assert used["position"] > 60 and used["velocity"] > 60
    assert "columns_not_read" not in set(run.events["kind"])  # convert wrote the files itself
    last = run.nav.iloc[-1]
    assert abs(last["lat_deg"] - 47.0) * 111e3 < last["sd_n_m"] and abs(last["h_m"] - 547.5) < last["sd_d_m"]
    assert last["sd_yaw_deg"] > 90.0  # rest does not show the heading
    assert run.errors is not None and run.errors["d_n_m"].median() == pytest.approx(-1.0, abs=0.2)


def test_replay_of_less_than_a_second_of_fixes_asks_for_a_higher_rate(tmp_path: Path) -> None:
    pytest.importorskip("pyulog", reason="the extra 'ulog' is not installed")
    log = Ulog()
    log.topic("sensor_combined", COMBINED)
    log.topic("vehicle_gps_position", GPS)
    # a start needs a second of samples, then half a second of fixes: the filter runs from 0.1 to 0.88 s of a second
    for k in range(-90, 40):
        after_s = 0.1 + k / 50
        if k >= -25 and k % 5 == 0:
            utc = UTC_US + round(after_s * 1e6)
            log.row("vehicle_gps_position", boot_us(after_s), utc, 47.0, 8.0, 500.0, 547.5, 0.2, 1.5, 2.5, 0.0, 0.0,
                    0.0, 0, 3)  # fmt: skip
        log.row("sensor_combined", boot_us(after_s), (0.0, 0.0, 1e-4), 20_000, 0, (0.0, 0.0, -9.807), 20_000)
    (tmp_path / "log").write_bytes(log.data)
    convert([tmp_path / "log"], tmp_path / "out")
    with pytest.raises(ConfigError, match=r"no time at 1 Hz(.|\n)*--rate 10"):
        insgnss.replay(tmp_path / "out" / "flight.toml")
    assert len(insgnss.replay(tmp_path / "out" / "flight.toml", output=10.0).nav) >= 3


def test_dumped_bytes_of_the_receiver_give_raw_measurements(tmp_path: Path) -> None:
    log = read(tmp_path, flown().data)
    assert len(np.unique(log.gnss.t_ns)) == 5 and log.gnss.sv_names == ("G05",)
    assert len(subframes()) == 3
    bad = flown(5, dump=False)
    bad.topic("gps_dump", DUMP)
    bad.row("gps_dump", boot_us(0), 0, 20, b"$GNGGA,1,2,3*00\r\n   ".ljust(79))
    told = read(tmp_path, bad.data)
    assert not len(told.gnss.t_ns) and any("gps_dump" in event.detail for event in told.events)


def test_cut_and_damaged_logs_give_what_they_hold(tmp_path: Path) -> None:
    data = flown(60).data
    cut = read(tmp_path, data[: len(data) // 2])
    assert cut.imu is not None and 200 < len(cut.imu.t_ns) < 400
    assert "ends within a message" in {event.kind: event.detail for event in cut.events}["ulog_cut"]
    spoilt = bytearray(data)
    spoilt[len(data) // 3 : len(data) // 3 + 40] = b"\xff" * 40
    log = read(tmp_path, bytes(spoilt))
    assert log.imu is not None and len(log.imu.t_ns) > 500
    told = [event.detail for event in log.events if event.kind == "ulog_damaged"]
    assert any("no message begins" in detail for detail in told)


def test_wrong_size_of_one_definition_costs_that_definition_alone(tmp_path: Path) -> None:
    data = bytearray(flown(60).data)
    info = message("I", b"\x0cchar[4] nameabcd")
    head = 16 + 3 + 40
    data[head:head] = info + info
    whole = read(tmp_path, bytes(data))
    data[head + 1] ^= 0x20  # 8192 bytes longer than it is
    log = read(tmp_path, bytes(data))
    assert whole.imu is not None and log.imu is not None
    assert np.array_equal(log.imu.t_ns, whole.imu.t_ns) and len(log.gnss.t_ns) == len(whole.gnss.t_ns)
    (told,) = [event.detail for event in log.events if event.kind == "ulog_damaged"]
    assert f"reading goes on at byte {head + len(info)}" in told


@pytest.mark.skipif(not hasattr(signal, "SIGALRM"), reason="no alarm on this system")
def test_data_before_the_first_topic_that_would_hold_the_library_for_ever_are_left_out(
    tmp_path: Path,
) -> None:
    # 30 000 bytes of no topic; the library steps into them and finds there a size that leads beyond the file's end
    data = flown(5).data
    plain = read(tmp_path, data)
    with_data = data[: 16 + 43] + message("D", b"\xff\xff\x75" * 10_000) + data[16 + 43 :]
    before = signal.signal(signal.SIGALRM, lambda *_: pytest.fail("the reading does not end"))
    signal.alarm(20)
    try:
        log = read(tmp_path, with_data)
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
    assert log.imu is not None and plain.imu is not None and np.array_equal(log.imu.t_ns, plain.imu.t_ns)
    assert any(event.kind == "ulog_damaged" for event in log.events)


def test_dropouts_are_told(tmp_path: Path) -> None:
    log = flown(10)
    log.dropout(250)
    assert "0.25 s" in {e.kind: e.detail for e in read(tmp_path, log.data).events}["ulog_dropouts"]


def test_log_without_the_time_says_so(tmp_path: Path) -> None:
    log = Ulog()
    log.topic("sensor_combined", COMBINED)
    log.row("sensor_combined", BOOT_US, (0.1, -0.2, 0.3), 4000, 0, (0.0, 0.5, -9.8), 4000)
    with pytest.raises(InputError, match=r"cannot be dated(.|\n)*vehicle_gps_position"):
        read(tmp_path, log.data)


@pytest.mark.parametrize(
    "texts",
    [(b"a:uint8_t[999999999] x;",), (b"a:b[9000] x;", b"b:c[9000] x;", b"c:uint8_t[99] y;"), (b"a:a x;",)],
)
def test_definitions_that_would_fill_the_memory_are_refused(tmp_path: Path, texts: tuple[bytes, ...]) -> None:
    formats = b"".join(message("F", text) for text in texts)
    data = flown(2).data
    with pytest.raises(InputError, match="more fields than"):
        read(tmp_path, data[:16] + formats + data[16:])


def test_converted_log_is_a_flight(tmp_path: Path) -> None:
    pytest.importorskip("pyulog", reason="the extra 'ulog' is not installed")
    path = tmp_path / "log.bin"
    path.write_bytes(flown().data)
    assert detect_format(path) == "ulog"
    done = convert([path], tmp_path / "out")
    assert [p.name for p in done.written] == ["gnss_obs.csv", "imu.csv", "reference.csv", "flight.toml"]
    flight, table = read_again(tmp_path / "out")
    same(done.log.gnss, table)
    assert flight.config.reference is not None
    assert len(read_reference(flight.config.reference, flight.config.gps_week)[0].t_ns) == 100


def test_without_the_library_the_error_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = builtins.__import__

    def missing(name: str, *rest: Any, **named: Any) -> Any:
        if name.split(".")[0] == "pyulog":
            raise ImportError(name)
        return real(name, *rest, **named)

    monkeypatch.setattr(builtins, "__import__", missing)
    path = tmp_path / "log.ulg"
    path.write_bytes(flown(2).data)
    with pytest.raises(InputError, match=r"pip install 'insgnss\[ulog\]'"):
        read_ulog(path)


def test_topics_of_the_command_are_named_by_their_parts(tmp_path: Path) -> None:
    (tmp_path / "log").write_bytes(flown(5).data)
    asked = ["convert", str(tmp_path / "log"), "-o", str(tmp_path / "out"), "--topic"]
    refused = CliRunner().invoke(app, [*asked, "gyro=sensor_combined"])
    assert refused.exit_code == 2 and "imu, gnss, reference" in refused.output


SMALL = flown(4).data
