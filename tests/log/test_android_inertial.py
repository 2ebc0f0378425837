"""GnssLogger files of inertial data alone: what dates the samples, and what is refused."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from insgnss.errors import InputError
from insgnss.log.android.reader import read_android
from insgnss.log.convert import convert
from insgnss.log.detect import detect_format
from insgnss.log.flight import Flight
from insgnss.log.imu.csv_log import inertial, read_imu
from tests.log.android_generator import (
    BOOT_FULL_BIAS_NS,
    COLUMNS,
    ELAPSED_MINUS_TIME_NS,
    HEADER,
    epoch,
    sensor,
)
from tests.log.test_android import GPS_5, T

START = T + ELAPSED_MINUS_TIME_NS
FIX = (
    "# Fix,Provider,LatitudeDegrees,LongitudeDegrees,AltitudeMeters,SpeedMps,AccuracyMeters,BearingDegrees,"
    "UnixTimeMillis,elapsedRealtimeNanos,VerticalAccuracyMeters\n"
)


def samples(count: int = 300) -> str:
    return "".join(
        sensor(kind, START + k * 10_000_000, (0.0, 0.0, 9.8))
        for k in range(count)
        for kind in ("UncalGyro", "UncalAccel")
    )


def fixes(provider: str, error_ms: int = 0, vertical: str = "4.0") -> str:
    """Return fixes at whole seconds since the first sample, stamped ``error_ms`` too late."""
    gps_ms = (T - BOOT_FULL_BIAS_NS) // 10**6
    return "".join(
        f"Fix,{provider},48.0,11.0,500.0,0.0,3.0,,{gps_ms + 1000 * k + 315_964_800_000 - 18_000 + error_ms},"
        f"{START + k * 10**9},{vertical}\n"
        for k in range(4)
    )


def written(folder: Path, text: str) -> Path:
    path = folder / "gnss_log.txt"
    path.write_text(text)
    return path


def test_samples_without_measurements_carry_utc_and_an_event(tmp_path: Path) -> None:
    log = read_android(written(tmp_path, HEADER + samples()))
    assert not len(log.gnss.t_ns) and log.imu is not None and len(log.imu.t_ns) == 300
    assert abs(log.imu.t_ns[0] - (T - BOOT_FULL_BIAS_NS)) <= 10**6
    assert [event.kind for event in log.events] == ["imu_time_uncertain"]


@pytest.mark.parametrize(("provider", "off_ms"), [("gps", 0), ("GPS", 0), ("fused", 500)])
def test_fixes_of_the_phones_receiver_date_the_samples_in_place_of_a_wrong_utc(
    tmp_path: Path, provider: str, off_ms: int
) -> None:
    later = re.sub(r"^(Uncal\w+),(\d+)", lambda m: f"{m[1]},{int(m[2]) + 500}", samples(), flags=re.M)
    log = read_android(written(tmp_path, HEADER + FIX + later + fixes(provider)))
    assert log.imu is not None
    assert abs(log.imu.t_ns[0] - (T - BOOT_FULL_BIAS_NS) - off_ms * 10**6) <= 10**6
    kind = "imu_time_uncertain" if off_ms else "imu_time_estimated"
    assert [event.kind for event in log.events] == [kind]


def test_measurements_date_the_samples_before_fixes_do(tmp_path: Path) -> None:
    log = read_android(written(tmp_path, HEADER + FIX + epoch(T, [GPS_5]) + samples() + fixes("gps", 9)))
    assert log.imu is not None and abs(log.imu.t_ns[0] - (T - BOOT_FULL_BIAS_NS)) < 1000
    assert log.events == []


def test_file_without_the_header_of_raw_measurements_is_known_and_read(tmp_path: Path) -> None:
    header = "".join(line for line in HEADER.splitlines(True) if not line.startswith("# Raw"))
    path = written(tmp_path, header + samples())
    assert detect_format(path) == "android"
    assert read_android(path).imu is not None


def test_file_with_neither_measurements_nor_samples_is_refused_with_advice(tmp_path: Path) -> None:
    path = written(tmp_path, HEADER + FIX + fixes("gps") + sensor("UncalGyro", START, (0.0, 0.0, 0.0)))
    with pytest.raises(InputError, match="no specific forces") as found:
        read_android(path)
    assert "no measurement and no inertial sample" in found.value.message
    assert "Raw measurements" in found.value.advice


def test_measurements_without_their_header_are_not_passed_over(tmp_path: Path) -> None:
    header = "".join(line for line in HEADER.splitlines(True) if not line.startswith("# Raw"))
    with pytest.raises(InputError, match="no header"):
        read_android(written(tmp_path, header + epoch(T, [GPS_5]) + samples()))


@pytest.mark.parametrize("vertical", ["4.0", ""])
def test_samples_and_fixes_become_a_flight_that_can_be_read(tmp_path: Path, vertical: str) -> None:
    done = convert(
        [written(tmp_path, HEADER + FIX + samples() + fixes("gps", vertical=vertical))], tmp_path / "out"
    )
    assert [path.name for path in done.written] == ["imu.csv", "reference.csv", "fixes.csv", "flight.toml"]
    flight = Flight.load(tmp_path / "out" / "flight.toml")
    assert flight.config.gnss.files == () and flight.config.reference is None
    logs = flight.read()
    assert len(logs.imu.t_ns) == 300 and flight.config.sensor[0].kind == "position"
    assert len(logs.sensors[0].t_ns) == 4 and "columns_not_read" not in {e.kind for e in logs.events}
    # height without a stated sigma takes that of the flight file
    given = flight.config.sensor[0].model_dump()["sigma_m"]
    assert (given is None) == bool(vertical)


def test_samples_alone_become_a_flight_file_that_says_what_is_missing(tmp_path: Path) -> None:
    convert([written(tmp_path, HEADER + samples())], tmp_path / "out")
    text = (tmp_path / "out" / "flight.toml").read_text()
    assert "# DECLARE: the log has no raw measurements" in text
    assert 'files = ["gnss_obs.csv"]  # DECLARE' in text
    flight = Flight.load(tmp_path / "out" / "flight.toml")
    imu, _ = read_imu(inertial(flight.config), flight.config.gps_week, flight.imu_grade)
    assert len(imu.t_ns) == 300 and np.allclose(imu.f_b, (0.0, 0.0, -9.8))


# ------------------------------------------------------------------------------------------- tables made of one log

COMMON = "MessageType,utcTimeMillis,elapsedRealtimeNanos,MeasurementX,MeasurementY,MeasurementZ,BiasX,BiasY,BiasZ\n"
DRIFT = (0.01, -0.02, 0.03)


def table_of_sensors(folder: Path) -> Path:
    lines = [COMMON]
    for k in range(300):
        lines += [
            sensor("UncalGyro", START + k * 10_000_000, (0.11, 0.18, 0.33), DRIFT),
            sensor("UncalAccel", START + k * 10_000_000, (0.1, 0.2, 9.8)),
            sensor("UncalMag", START + k * 10_000_000, (20.0, 5.0, -40.0)),
        ]
    path = folder / "device_imu.csv"
    path.write_text("".join(lines))
    return path


def table_of_measurements(folder: Path) -> Path:
    path = folder / "device_gnss.csv"
    rows = epoch(T, [GPS_5]) + epoch(T + 10**9, [GPS_5])
    path.write_text(f"MessageType,{COLUMNS}\n{rows}")
    return path


def test_table_with_the_same_columns_for_all_sensors_is_read(tmp_path: Path) -> None:
    path = table_of_sensors(tmp_path)
    assert detect_format(path) == "android"
    log = read_android(path)
    assert log.imu is not None and len(log.imu.t_ns) == 300
    assert log.imu.f_b[0].tolist() == pytest.approx([0.1, 0.2, 9.8])
    assert log.imu.w_ib_b[0].tolist() == pytest.approx([0.1, 0.2, 0.3])
    assert [one.values[0].tolist() for one in log.further] == [[20.0, 5.0, -40.0]]


def test_tables_of_one_log_share_the_clock_of_its_measurements(tmp_path: Path) -> None:
    done = convert([table_of_sensors(tmp_path), table_of_measurements(tmp_path)], tmp_path / "out")
    assert len(done.log.gnss.t_ns) == 2 and done.log.imu is not None
    assert abs(done.log.imu.t_ns[0] - (T - BOOT_FULL_BIAS_NS)) < 1000  # UTC would be off by the milliseconds
    assert not [event for event in done.events if event.kind.startswith("imu_time")]


def test_two_logs_in_one_call_are_refused_with_the_file_named(tmp_path: Path) -> None:
    one, other = table_of_measurements(tmp_path), written(tmp_path, HEADER + epoch(T, [GPS_5]))
    with pytest.raises(InputError, match="with Raw lines in more than one") as found:
        read_android(one, other)
    assert found.value.file == str(other) and "one by one" in found.value.advice
