"""A scenario's sensors on their way through files, and what the check of a flight says of them."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import insgnss
from insgnss.config.library import find
from insgnss.constants import NS_PER_S
from insgnss.log.checks.report import Finding
from insgnss.log.checks.sensor_findings import (
    _common,
    _heading,
    _LocalTrack,
    _magnetometer,
    _SampledTrack,
    read_sensor_logs,
    sensor_findings,
)
from insgnss.log.checks.track import GnssTrack
from insgnss.log.flight import Flight, FlightLogs
from insgnss.runs.check import solve_track
from insgnss.runs.simulate import Simulation, simulate
from insgnss.tables import SensorTable
from tests.sensors.scenes import declared, simulated

SENSORS = """
[[sensor]]
kind = "odometer"
lever_arm_m = [-1.5, 0.7, 0.4]
[[sensor]]
kind = "barometer"
[[sensor]]
kind = "magnetometer"
[[sensor]]
kind = "heading"
[[sensor]]
kind = "attitude"
[[sensor]]
kind = "position"
[[sensor]]
kind = "velocity"
[[fault]]
kind = "slip"
from_s = 80.0
to_s = 82.0
[[fault]]
kind = "sensor_silence"
sensor = "barometer"
from_s = 10.0
to_s = 12.0
"""


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Simulation, FlightLogs, GnssTrack]:
    """The first 100 s of the library's car with a sensor of every kind, its logs and the track by GNSS."""
    folder = tmp_path_factory.mktemp("sensors")
    scenario = folder / "scenario.toml"
    scenario.write_text(find("scenarios", "city_car").read_text(encoding="utf-8") + SENSORS)
    made = simulate(scenario, 4, duration_s=100.0)
    made.save(folder / "flight")
    flight = Flight.load(folder / "flight" / "flight.toml")
    logs = flight.read()
    track = solve_track(flight, logs.gnss, logs.navigation)
    assert track is not None
    return folder / "flight", made, logs, track


def test_simulated_readings_come_back_from_their_files(
    saved: tuple[Path, Simulation, FlightLogs, GnssTrack],
) -> None:
    folder, made, logs, _ = saved
    tolerance = {"odometer": 1e-4, "barometer": 1e-3, "magnetometer": 1e-3, "position": 1e-3}
    for sent, read in zip(made.log.sensors, logs.sensors, strict=True):
        assert sent.name == read.name
        np.testing.assert_array_equal(sent.t_ns, read.t_ns)
        np.testing.assert_allclose(read.values, sent.values, atol=tolerance.get(sent.name, 1e-4))
        assert str(folder / f"sensor_{sent.name}.csv") in logs.input_hashes
    kinds = [event.kind for event in logs.events]
    assert kinds.count("sensor_bad_values") == 1


def checked(folder: Path, track: GnssTrack, change: tuple[str, str], to: Path) -> dict[str, list[Finding]]:
    """Return the findings of each sensor, one thing of the flight file changed."""
    shutil.copytree(folder, to)
    path = to / "flight.toml"
    text = path.read_text()
    assert change[0] in text
    path.write_text(text.replace(*change))
    flight = Flight.load(path)
    found: dict[str, list[Finding]] = {}
    for finding in sensor_findings(read_sensor_logs(flight), track, None):
        found.setdefault(finding.topic, []).append(finding)
    return found


def test_sensors_in_order_raise_no_warning(
    saved: tuple[Path, Simulation, FlightLogs, GnssTrack], tmp_path: Path
) -> None:
    folder, _, _, track = saved
    found = checked(folder, track, ("[imu]", "[imu]"), tmp_path / "f")
    assert set(found) == {
        "odometer",
        "barometer",
        "magnetometer",
        "heading",
        "attitude",
        "position",
        "velocity",
    }
    warned = [finding.line() for each in found.values() for finding in each if finding.severity != "ok"]
    assert all("sensor_bad_values" in line for line in warned) and len(warned) == 1
    assert any("at 10 Hz" in finding.text for finding in found["odometer"])


@pytest.mark.parametrize(
    ("name", "change", "advice"),
    [
        ("odometer", ('kind = "odometer"', 'kind = "odometer"\nunit = "km/h"'), "the unit fits m/s"),
        ("odometer", ('kind = "odometer"', 'kind = "odometer"\ntime.offset_s = 1.5'), "add -1.5 s"),
        ("barometer", ('kind = "barometer"', 'kind = "barometer"\nunit = "m"'), "check its unit"),
        (
            "magnetometer",
            ('kind = "magnetometer"', 'kind = "magnetometer"\naxes = ["+x", "-y", "-z"]'),
            'axes = ["+x", "+y", "+z"] fits',
        ),
        (
            "magnetometer",
            ('kind = "magnetometer"', 'kind = "magnetometer"\ncolumns.field = ["mag_y", "mag_x", "mag_z"]'),
            "its +y, +x, +z, which is left-handed: exchange two names in columns.field",
        ),
        (
            "magnetometer",
            ('kind = "magnetometer"', 'kind = "magnetometer"\nunit = "G"'),
            "unit = 'uT' would fit",
        ),
        ("magnetometer", ('kind = "magnetometer"', 'kind = "magnetometer"\nunit = "mG"'), "unit = 'uT' fits"),
        ("heading", ('kind = "heading"', 'kind = "heading"\noffset_deg = 90.0'), "offset_deg"),
        ("attitude", ('kind = "attitude"', 'kind = "attitude"\nunit = "rad"'), "possible attitude"),
        ("position", ('kind = "position"', 'kind = "position"\ntime.offset_s = 2.0'), "add -2.0 s"),
        ("position", ('kind = "position"', 'kind = "position"\nheight = "sea_level"'), ""),
        ("velocity", ('kind = "velocity"', 'kind = "velocity"\naxes = "enu"'), "axes = 'ned' fits"),
    ],
)
def test_wrong_declaration_is_found(
    saved: tuple[Path, Simulation, FlightLogs, GnssTrack],
    tmp_path: Path,
    name: str,
    change: tuple[str, str],
    advice: str,
) -> None:
    folder, _, _, track = saved
    found = checked(folder, track, change, tmp_path / "f")
    told = " ".join(finding.line() for finding in found[name] if finding.severity != "ok")
    assert advice in told


@pytest.mark.parametrize(
    ("turn_deg", "wind_deg", "round_deg", "warned"),
    [(12.0, 0.0, 360.0, True), (12.0, 0.0, 60.0, False), (0.0, 12.0, 360.0, False), (0.5, 5.0, 360.0, False)],
)
def test_heading_turned_on_all_courses_is_the_devices(
    turn_deg: float, wind_deg: float, round_deg: float, warned: bool
) -> None:
    """12 deg: a declination. Wind from the west turns an aircraft to the left going north, to the right going south."""
    t_s = np.arange(120.0)
    course = np.radians(round_deg) * t_s / 120.0
    v_n = 50.0 * np.column_stack([np.cos(course), np.sin(course), np.zeros(120)])
    place = np.tile([0.8, 0.1, 500.0], (120, 1))
    yaw = course + np.radians(turn_deg - wind_deg * np.cos(course))
    config = declared(simulated("heading"))
    track = _SampledTrack(t_s, yaw[:, None], v_n, place, _LocalTrack(t_s, v_n, place))
    findings = _heading(config, track)
    assert [finding.severity for finding in findings] == ["warning" if warned else "ok"]
    assert ("magnetic north" in findings[0].line()) == warned


@pytest.mark.parametrize("turns", [False, True])
def test_heading_in_radians_that_is_declared_in_degrees_is_named(turns: bool) -> None:
    t_s = np.arange(120.0)
    course = np.radians(3.0) * t_s if turns else np.full(120, 2.0)
    v_n = 50.0 * np.column_stack([np.cos(course), np.sin(course), np.zeros(120)])
    place = np.tile([0.8, 0.1, 500.0], (120, 1))
    config = declared(simulated("heading"), declination_deg=4.0)
    for values in (np.radians(course % (2.0 * np.pi)), course):
        read = values[:, None] + np.radians(4.0)  # as the reader adds the declination
        findings = _heading(config, _SampledTrack(t_s, read, v_n, place, _LocalTrack(t_s, v_n, place)))
        assert ("unit = 'rad' fits" in findings[0].line()) == (values is not course)


@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize("lat", [0.82, -0.6])
def test_vertical_field_that_points_the_wrong_way_is_told_at_rest_too(moves: bool, lat: float) -> None:
    """The field points down in the north and up in the south."""
    t_s = np.arange(120.0)
    course = np.radians(3.0) * t_s
    v_n = 10.0 * moves * np.column_stack([np.cos(course), np.sin(course), np.zeros(120)])
    v_n += 0.02 * np.random.default_rng(5).standard_normal(v_n.shape)
    place = np.tile([lat, 0.1, 500.0], (120, 1))
    config = declared(simulated("magnetometer"), declination_deg=0.0)
    Z = np.copysign(43.0, lat)
    sound = np.column_stack([20.0 * np.cos(course), -20.0 * np.sin(course), np.full(120, Z)])
    for axes, wrong in (((1.0, 1.0, 1.0), False), ((1.0, 1.0, -1.0), True)):
        track = _SampledTrack(t_s, sound * axes, v_n, place, _LocalTrack(t_s, v_n, place))
        told = " ".join(finding.line() for finding in _magnetometer(config, track))
        assert ("the vertical field points" in told) == wrong
        assert ("its +x, +y, -z, which is left-handed" in told) == (wrong and moves)


def test_readings_in_a_gap_of_the_satellites_are_not_compared() -> None:
    t_s = np.concatenate((np.arange(0.0, 10.0, 0.5), np.arange(13.0, 23.0, 0.5)))
    track = _LocalTrack(t_s, np.full((len(t_s), 3), 5.0), np.zeros((len(t_s), 3)))
    at_ns = np.arange(0, 24 * NS_PER_S, NS_PER_S // 10)

    common = _common(SensorTable("barometer", at_ns, *np.ones((2, len(at_ns), 1))), track, 0)

    assert common.t_s.min() == 0.0 and common.t_s.max() == 22.5
    assert not ((common.t_s > 9.5) & (common.t_s < 13.0)).any()
    assert len(common.t_s) == 96 + 96


def test_check_of_a_flight_looks_at_its_sensors(
    saved: tuple[Path, Simulation, FlightLogs, GnssTrack],
) -> None:
    report = insgnss.check_flight(Flight.load(saved[0] / "flight.toml"))
    assert {"odometer", "velocity"} <= {finding.topic for finding in report.findings}
