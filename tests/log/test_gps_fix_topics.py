"""GPSFix in bags: fixes with velocities and errors, beside NavSatFix; topics that are not what they seem."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from insgnss.errors import InputError
from insgnss.gpstime import utc_to_ns
from insgnss.log.convert import convert
from insgnss.log.receiver import ReceiverLog
from insgnss.log.rosbag.reader import read_rosbag
from tests.log.test_rosbag import FIX, HEADER, IMU, UTC, Bag, header

RULE = "=" * 80
NUMBERS = (
    *("latitude", "longitude", "altitude", "track", "speed", "climb", "pitch", "roll", "dip", "time", "gdop"),
    *("pdop", "hdop", "vdop", "tdop", "err", "err_horz", "err_vert", "err_track", "err_speed", "err_climb"),
    *("err_time", "err_pitch", "err_roll", "err_dip"),
)
GPSFIX = (
    "std_msgs/Header header\ngps_msgs/GPSStatus status\n"
    + "".join(f"float64 {name}\n" for name in NUMBERS)
    + f"float64[9] position_covariance\nuint8 position_covariance_type\n{RULE}\nMSG: gps_msgs/GPSStatus\n"
    "std_msgs/Header header\nuint16 satellites_used\nint32[] satellite_used_prn\nuint16 satellites_visible\n"
    "int32[] satellite_visible_prn\nint32[] satellite_visible_z\nint32[] satellite_visible_azimuth\n"
    "int32[] satellite_visible_snr\nint16 status\nuint16 motion_source\nuint16 orientation_source\n"
    "uint16 position_source" + HEADER
)
Message = tuple[str, str, str, float, Mapping[str, Any]]  # topic, type, definition, after [s], content


def imu(after_s: float, topic: str = "/imu", **changes: Any) -> Message:
    content = {
        "header": header(after_s),
        "angular_velocity": {"x": 0.1, "y": -0.2, "z": 0.3},
        "angular_velocity_covariance": [0.0] * 9,
        "linear_acceleration": {"x": 0.5, "y": 1.5, "z": 9.8},
        "linear_acceleration_covariance": [0.0] * 9,
    }
    return topic, "sensor_msgs/msg/Imu", IMU, after_s, content | changes


def navsatfix(after_s: float, topic: str = "/fix", **changes: Any) -> Message:
    content = {
        "header": header(after_s),
        "status": {"status": 0, "service": 1},
        **{"latitude": 47.0, "longitude": 8.0 + after_s * 1e-5, "altitude": 547.5},
        "position_covariance": [4.0, 0, 0, 0, 1.0, 0, 0, 0, 9.0],
        "position_covariance_type": 2,
    }
    return topic, "sensor_msgs/msg/NavSatFix", FIX, after_s, content | changes


def gpsfix(after_s: float, topic: str = "/gps", **changes: Any) -> Message:
    status = {"status": changes.pop("status", 0), "satellite_used_prn": [5, 7, 9]}
    status |= {name: changes.pop(name, 1) for name in ("motion_source", "position_source")}
    content = {
        "header": header(after_s),
        "status": status,
        **dict.fromkeys(NUMBERS, 0.0),
        **{"latitude": 47.0, "longitude": 8.0 + after_s * 1e-5, "altitude": 547.5},
        **{"track": 60.0, "speed": 10.0, "climb": 0.5},
        **{"err_track": 3.0, "err_speed": 0.196, "err_climb": 0.392},
        "position_covariance": [4.0, 0, 0, 0, 1.0, 0, 0, 0, 9.0],
        "position_covariance_type": 2,
    }
    return topic, "gps_msgs/msg/GPSFix", GPSFIX, after_s, content | changes


def written(path: Path, messages: list[Message]) -> Path:
    """Write a bag and return its path."""
    bag = Bag()
    for message in messages:
        bag.put(*message)
    path.write_bytes(bag.data)
    return path


def told(log: ReceiverLog) -> dict[str, str]:
    return {event.kind: event.detail for event in log.events}


def test_gpsfix_is_read_as_fixes_with_velocities_and_their_errors(tmp_path: Path) -> None:
    messages = [gpsfix(k) for k in range(4)] + [gpsfix(4.0, status=-1)]
    log = read_rosbag(written(tmp_path / "bag", messages))
    fixes = log.satellite_fixes()
    assert fixes is not None and len(fixes.t_ns) == 4 and fixes.t_ns[3] == utc_to_ns(UTC) + 3 * 10**9
    assert fixes.lon_deg[3] == pytest.approx(8.00003) and fixes.h_m[0] == 547.5
    course = math.radians(60.0)
    assert fixes.v_n[0] == pytest.approx([10.0 * math.cos(course), 10.0 * math.sin(course), -0.5])
    # 95 %: 0.1 m/s along the track, 10 m/s times 3 / 1.96 deg across it
    along, across = 0.1, 10.0 * math.radians(3.0 / 1.96)
    level = [
        math.hypot(along * math.cos(course), across * math.sin(course)),
        math.hypot(along * math.sin(course), across * math.cos(course)),
    ]
    assert fixes.sigma is not None
    assert fixes.sigma[0, :6] == pytest.approx([1.0, 2.0, 3.0, *level, 0.2])
    assert "heights are taken as above the ellipsoid" in told(log)["mcap_heights_assumed"]
    assert "mcap_not_used" not in told(log)


def test_errors_of_95_percent_stand_in_for_a_covariance_that_is_not_stated(tmp_path: Path) -> None:
    changes = {"position_covariance_type": 0, "err_horz": 4.895, "err_vert": 3.92}
    messages = [gpsfix(k, **changes) for k in range(3)]
    fixes = read_rosbag(written(tmp_path / "bag", messages)).solution
    assert fixes is not None and fixes.sigma is not None
    assert fixes.sigma[0, :3] == pytest.approx([2.0, 2.0, 2.0], rel=1e-3)


def test_velocity_that_a_driver_leaves_at_zero_is_none(tmp_path: Path) -> None:
    still = read_rosbag(
        written(tmp_path / "a", [gpsfix(k, speed=0.0, track=0.0, climb=0.0) for k in range(3)])
    )
    level = read_rosbag(written(tmp_path / "b", [gpsfix(k, climb=0.0) for k in range(3)]))
    stops = read_rosbag(
        written(
            tmp_path / "c",
            [gpsfix(k, speed=k * 1.0, track=math.nan if k == 0 else 60.0) for k in range(3)],
        )
    )
    assert still.solution is not None and np.isnan(still.solution.v_n).all()
    assert level.solution is not None and np.isnan(level.solution.v_n[:, 2]).all()
    assert np.isfinite(level.solution.v_n[:, :2]).all()
    assert stops.solution is not None and stops.solution.v_n[0, :2].tolist() == [0.0, 0.0]
    # at rest the track's error says nothing of the velocity across
    assert stops.solution.sigma is not None and stops.solution.sigma[0, 3:5] == pytest.approx([0.1, 0.1])


def test_velocities_of_gpsfix_join_the_fixes_of_navsatfix(tmp_path: Path) -> None:
    messages = [m for k in range(4) for m in (navsatfix(k), gpsfix(k + 0.0002, altitude=500.0))][:-1]
    log = read_rosbag(written(tmp_path / "bag", messages))
    assert log.solution is not None and log.solution.h_m.tolist() == [547.5] * 4
    assert np.isfinite(log.solution.v_n[:3]).all() and np.isnan(log.solution.v_n[3]).all()
    assert log.solution.sigma is not None and log.solution.sigma[0, 5] == pytest.approx(0.2)
    assert "with the velocities of /gps" in told(log)["reference_own"]
    assert "mcap_heights_assumed" not in told(log) and "mcap_not_used" not in told(log)
    # either topic may be named
    alone = read_rosbag(tmp_path / "bag", {"reference": "/gps"}).solution
    assert alone is not None and alone.h_m.tolist() == [500.0] * 3


@pytest.mark.parametrize("named", [True, False])
def test_solution_of_a_filter_with_inertial_data_does_not_take_the_place_of_fixes(
    tmp_path: Path, named: bool
) -> None:
    source = 96 if named else 1  # gyroscopes and accelerometers
    messages = [gpsfix(k, position_source=source, motion_source=source) for k in range(4)]
    log = read_rosbag(written(tmp_path / "bag", messages))
    assert (log.satellite_fixes() is None) is named and log.solution is not None
    assert ("filter with inertial data" in told(log)["reference_own"]) is named


def test_topic_of_another_type_is_refused_by_name(tmp_path: Path) -> None:
    path = written(tmp_path / "bag", [imu(k / 10) for k in range(9)] + [navsatfix(k) for k in range(3)])
    with pytest.raises(
        InputError, match=r"'/imu' is of the type sensor_msgs/msg/Imu, which is not read as reference"
    ):
        read_rosbag(path, {"reference": "/imu"})


def test_messages_that_are_not_as_their_type_says_are_told(tmp_path: Path) -> None:
    topic, kind, text, after_s, content = imu(0.0)
    others = [(topic, kind, text.replace("angular_velocity", "turn"), after_s, content)]
    log = read_rosbag(written(tmp_path / "bag", others + [navsatfix(k) for k in range(3)]))
    assert log.imu is None and log.solution is not None
    assert "/imu (sensor_msgs/msg/Imu) not read: its fields are not those" in told(log)["mcap_not_used"]


def test_samples_that_hold_neither_rates_nor_forces_are_told(tmp_path: Path) -> None:
    unknown = [-1.0] + [0.0] * 8
    changes = {"angular_velocity_covariance": unknown, "linear_acceleration_covariance": unknown}
    messages = [imu(k / 10, **changes) for k in range(9)] + [navsatfix(k) for k in range(3)]
    log = read_rosbag(written(tmp_path / "bag", messages))
    assert log.imu is None
    assert (
        "/imu: by its covariances, 9 message(s) hold neither rates nor forces" in told(log)["imu_incomplete"]
    )


def test_converted_bag_has_its_fixes_as_sensors(tmp_path: Path) -> None:
    messages = [m for k in range(5) for m in (*(imu(k + j / 20) for j in range(20)), gpsfix(k))]
    path = written(tmp_path / "bag", messages)
    done = convert([path], tmp_path / "out")
    assert [p.name for p in done.written] == ["imu.csv", "reference.csv", "fixes.csv", "flight.toml"]
    flight = (tmp_path / "out" / "flight.toml").read_text()
    assert 'kind = "velocity"' in flight and '["+x", "-y", "-z"]' in flight
