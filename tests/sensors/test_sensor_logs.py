"""Logs of further sensors: units, axes, counts, gaps, bad cells, and the flight file's own mistakes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from insgnss.config.flight import FlightConfig
from insgnss.config.sensors import Sensor
from insgnss.config.strict import load_toml
from insgnss.errors import ColumnError, ConfigError, InputError
from insgnss.geodesy.sea_level import geoid_height
from insgnss.geodesy.standard_atmosphere import pressure_altitude, standard_pressure
from insgnss.log.imu.sensor_csv import read_sensor
from insgnss.tables import Event, SensorTable

WEEK = 2385


def read(folder: Path, text: str, kind: str, **keys: Any) -> tuple[SensorTable, list[Event]]:
    path = folder / "log.csv"
    path.write_text(text)
    needed = {"declination_deg": 2.0, "horizontal_ut": 20.0} if kind == "magnetometer" else {}
    config = TypeAdapter(Sensor).validate_python({"kind": kind, "files": [path], **needed, **keys})
    return read_sensor(config, WEEK)


def test_pressure_altitude_is_that_of_the_standard_atmosphere() -> None:
    """ICAO Doc 7488/3, table of geometric altitudes."""
    for altitude_m, pressure_hpa in ((0.0, 1013.25), (1000.0, 898.76), (5000.0, 540.48), (20_000.0, 55.293)):
        assert float(standard_pressure(altitude_m)) == pytest.approx(pressure_hpa, rel=2e-5)
        assert float(pressure_altitude(pressure_hpa)) == pytest.approx(altitude_m, abs=0.2)


@pytest.mark.parametrize(
    ("unit", "value"), [("m/s", 10.0), ("km/h", 36.0), ("mph", 22.369363), ("kn", 19.438445)]
)
def test_odometer_speaks_every_unit(tmp_path: Path, unit: str, value: float) -> None:
    table, _ = read(tmp_path, f"time_s,speed\n1.0,{value}\n2.0,{value}\n", "odometer", unit=unit)
    np.testing.assert_allclose(table.values[:, 0], 10.0, rtol=1e-6)


def test_counts_become_mean_speeds_at_the_middle_of_their_time(tmp_path: Path) -> None:
    text = "time_s,pulses\n1.0,100\n1.5,110\n2.0,120\n2.5,3\n3.0,13\n"
    columns = {"speed": "pulses"}
    table, _ = read(tmp_path, text, "odometer", columns=columns, metres_per_count=0.5)
    np.testing.assert_allclose(table.values[:, 0], [10.0, 10.0, np.nan, 10.0])  # the counter began anew
    np.testing.assert_allclose(np.diff(table.t_ns) / 1e9, 0.5)
    assert (table.t_ns[0] / 1e9) % 604_800 == pytest.approx(1.25)


def test_magnetometer_is_turned_into_the_body(tmp_path: Path) -> None:
    table, _ = read(
        tmp_path,
        "time_s,mag_x,mag_y,mag_z\n1,100,200,300\n",
        "magnetometer",
        unit="mG",
        axes=["y", "x", "-z"],
    )
    np.testing.assert_allclose(table.values, [[20.0, 10.0, -30.0]])


def test_left_handed_magnetometer_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="not a rotation"):
        read(tmp_path, "time_s,mag_x,mag_y,mag_z\n1,1,2,3\n", "magnetometer", axes=["+y", "+x", "+z"])


def test_heights_above_the_sea_become_those_above_the_ellipsoid(tmp_path: Path) -> None:
    text = "time_s,lat_deg,lon_deg,h_m\n1,48.0,11.0,500.0\n"
    table, _ = read(tmp_path, text, "position", height="sea_level", sigma_m=[1.0, 1.0, 1.0])
    assert table.values[0, 2] == pytest.approx(500.0 + float(geoid_height([48.0], [11.0])[0]))


def test_ecef_fixes_are_the_places_they_name(tmp_path: Path) -> None:
    text = "time_s,x,y,z\n1,6378137.0,0.0,0.0\n"
    columns = {"position": ["x", "y", "z"]}
    table, _ = read(tmp_path, text, "position", frame="ecef", columns=columns, sigma_m=[1.0, 1.0, 1.0])
    np.testing.assert_allclose(table.values, [[0.0, 0.0, 0.0]], atol=1e-8)


@pytest.mark.parametrize("axes", ["enu", "neu"])
def test_components_in_another_order_become_north_east_down(tmp_path: Path, axes: str) -> None:
    values, sigmas = {"n": "1.0", "e": "2.0", "u": "-3.0"}, {"n": "0.1", "e": "0.2", "u": "0.3"}
    names, stated = [f"v{k}" for k in axes], [f"s{k}" for k in axes]
    cells = [values[k] for k in axes] + [sigmas[k] for k in axes]
    text = f"time_s,{','.join([*names, *stated])}\n1,{','.join(cells)}\n"
    table, _ = read(tmp_path, text, "velocity", axes=axes, columns={"velocity": names, "sigma": stated})
    np.testing.assert_allclose(table.values, [[1.0, 2.0, 3.0]])
    np.testing.assert_allclose(table.sigma, [[0.1, 0.2, 0.3]])


def test_mounted_attitude_sensor_tells_the_body_s_angles(tmp_path: Path) -> None:
    """A device turned by 90 deg about the vertical: its pitch is the body's roll with the other sign."""
    text = "time_s,roll_deg,pitch_deg,yaw_deg\n1,0.0,-5.0,120.0\n"
    table, _ = read(tmp_path, text, "attitude", mounting_rpy_deg=[0.0, 0.0, 90.0])
    np.testing.assert_allclose(np.degrees(table.values), [[5.0, 0.0, 30.0]], atol=1e-9)


def test_bad_cells_are_kept_as_no_number_and_told_with_file_line_and_column(tmp_path: Path) -> None:
    text = "time_s,pressure_hpa\n1,1000\n2,\n3,abc\n4,-5\n5,1001\n6,99999\n"
    table, events = read(tmp_path, text, "barometer")
    assert np.isfinite(table.values[:, 0]).tolist() == [True, False, False, False, True, False]
    bad = next(event for event in events if event.kind == "sensor_bad_values")
    assert "log.csv:3, column 'pressure_hpa'" in bad.detail and "4 of 6" in bad.detail


@pytest.mark.parametrize(
    ("kind", "log", "unit", "fits"),
    [
        ("magnetometer", "time_s,mag_x,mag_y,mag_z\n1,21000,300,43000\n2,20000,-900,43000\n", "uT", "'nT'"),
        ("heading", "time_s,heading_deg\n1,128.0\n2,127.5\n", "rad", "'deg'"),
        ("barometer", "time_s,pressure_hpa\n1,101325\n2,101320\n", "hPa", "'Pa' or 'ft'"),
    ],
)
def test_log_in_another_unit_is_an_error_that_names_the_unit(
    tmp_path: Path, kind: str, log: str, unit: str, fits: str
) -> None:
    with pytest.raises(InputError, match=f"no row holds a possible {kind} reading") as refused:
        read(tmp_path, log, kind, unit=unit)
    assert f"unit = {fits} would fit" in str(refused.value)
    some = (
        log.replace("1,", "0,1,1,1\n1,", 1) if kind == "magnetometer" else log.replace("\n1,", "\n0,1\n1,", 1)
    )
    if kind != "barometer":
        _, events = read(tmp_path, some, kind, unit=unit)
        assert f"unit = {fits} would fit" in next(e.detail for e in events if e.kind == "sensor_bad_values")


def test_glitches_do_not_speak_for_another_unit(tmp_path: Path) -> None:
    rows = "".join(f"{second},{-5 if second == 7 else 1000}\n" for second in range(1, 21))
    _, events = read(tmp_path, f"time_s,pressure_hpa\n{rows}", "barometer")
    (bad,) = events
    assert "1 of 20" in bad.detail and "would fit" not in bad.detail


def test_rows_out_of_order_are_sorted_and_repeats_refused_with_an_event(tmp_path: Path) -> None:
    table, events = read(tmp_path, "time_s,speed\n2,2\n1,1\n2,9\n3,3\n", "odometer")
    assert table.values[:, 0].tolist() == [1.0, 2.0, 3.0]
    assert "1 row(s) with a repeated time" in events[-1].detail


def test_log_without_a_reading_missing_column_and_missing_sigma_are_errors(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no row holds a possible odometer reading"):
        read(tmp_path, "time_s,speed\n1,\n2,x\n", "odometer")
    with pytest.raises(ColumnError, match="column missing"):
        read(tmp_path, "time_s,velocity\n1,2\n", "odometer")
    with pytest.raises(InputError, match="no sigmas"):
        read(tmp_path, "time_s,lat_deg,lon_deg,h_m\n1,48,11,500\n", "position")


FLIGHT = """
gps_week = 2385
[imu]
files = ["imu.csv"]
grade = "tactical"
[gnss]
files = ["gnss.csv"]
"""


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ('[[sensor]]\nkind = "odometre"', "unknown kind 'odometre'"),
        ('[[sensor]]\nkind = "odometer"\nsigma_m = 1.0', "unknown key"),
        ('[[sensor]]\nkind = "odometer"\n[[sensor]]\nkind = "odometer"', "two sensors are called 'odometer'"),
        ('[[sensor]]\nkind = "magnetometer"', "missing key"),
        ('[[sensor]]\nkind = "barometer"\nsigma_m = -1.0', "greater than 0"),
        ('[[sensor]]\nkind = "heading"\nname = "my compass"', "match pattern"),
    ],
)
def test_mistake_in_a_sensor_s_entry_is_named_with_its_line(tmp_path: Path, entry: str, message: str) -> None:
    path = tmp_path / "flight.toml"
    path.write_text(FLIGHT + entry)
    with pytest.raises(ConfigError, match=message) as raised:
        load_toml(path, FlightConfig)
    assert str(raised.value.key).startswith("sensor") and raised.value.line is not None
    if "two sensors" in message:
        assert raised.value.key == "sensor.name" and raised.value.line == FLIGHT.count("\n") + 3


def test_columns_that_one_of_two_sensors_of_a_file_reads_are_not_told_as_unread(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("time_s,speed,pressure_hpa,note\n1,2,1000,5\n2,2,1000,6\n")
    kinds = TypeAdapter(Sensor)
    pair = [kinds.validate_python({"kind": kind, "files": [path]}) for kind in ("odometer", "barometer")]

    shared = {path: tuple(name for sensor in pair for name in sensor.columns.all_names())}
    for sensor in pair:
        _, events = read_sensor(sensor, WEEK, shared)
        assert [event.detail for event in events] == [f"{path} has further columns: note"]
    _, alone = read_sensor(pair[0], WEEK)
    assert [event.detail for event in alone] == [f"{path} has further columns: pressure_hpa, note"]


@pytest.mark.parametrize("cell", ["", "nan", "text"])
def test_rows_without_a_value_hold_no_reading_where_another_log_shares_the_file(
    tmp_path: Path, cell: str
) -> None:
    path = tmp_path / "log.csv"
    path.write_text(f"time_s,gyro_x,pressure_hpa\n1,0,1000\n2,0,{cell}\n3,0,{cell}\n4,0,1001\n")
    config = TypeAdapter(Sensor).validate_python({"kind": "barometer", "files": [path]})

    table, events = read_sensor(config, WEEK, {path: ("time_s", "gyro_x")})
    kinds = [event.kind for event in events]
    if cell == "text":  # something was written, and cannot be read
        assert len(table.t_ns) == 4 and "sensor_bad_values" in kinds
    else:
        assert np.isfinite(table.values).all() and len(table.t_ns) == 2
        assert kinds == ["sensor_rows_without_reading"] and "2 of 4 rows" in events[0].detail

    alone, events = read_sensor(config, WEEK)
    assert len(alone.t_ns) == 4 and "sensor_bad_values" in [event.kind for event in events]
