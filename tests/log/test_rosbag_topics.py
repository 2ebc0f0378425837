"""Topics of a ROS 2 bag that are read though their type does not say so, or not read though it does."""

from __future__ import annotations

from pathlib import Path

from insgnss.gpstime import utc_to_ns
from tests.log.test_rosbag import BYTES, IMU, UTC, Bag, header, read, recorded


def test_samples_within_a_drivers_own_message_are_read_with_its_stamp(tmp_path: Path) -> None:
    rule = "=" * 80
    fields = "std_msgs/Header header\nsensor_msgs/Imu imu  # of the sensor\nstring raw"
    schema = f"{fields}\n{rule}\nMSG: sensor_msgs/Imu\n{IMU}"
    bag = Bag()
    for k in range(20):
        imu = {
            "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""},
            "angular_velocity": {"x": 0.1, "y": -0.2, "z": 0.3},
            "linear_acceleration": {"x": 0.5, "y": 1.5, "z": -9.8},
            "angular_velocity_covariance": [0.0] * 9,
            "linear_acceleration_covariance": [0.0] * 9,
        }
        bag.put(
            "/vn100",
            "custom/msg/Vectornav",
            schema,
            k / 20,
            {"header": header(k / 20), "imu": imu, "raw": "$VN"},
        )
    log = read(tmp_path, bag.data)
    assert log.imu is not None and len(log.imu.t_ns) == 20 and log.imu.t_ns[1] == utc_to_ns(UTC) + 50_000_000
    assert log.imu_axes == ("+x", "+y", "+z")
    assert "-z" in {event.kind: event.detail for event in log.events}["imu_axes_downwards"]


def test_bytes_that_are_no_receivers_need_not_be_told_apart(tmp_path: Path) -> None:
    bag = recorded()
    for k in range(2):
        bag.put("/noise", "rtcm_msgs/msg/Message", BYTES, k, {"header": header(k), "message": [1, 2, 3]})
    log = read(tmp_path, bag.data)
    assert len(log.gnss.t_ns) == 10
    assert "/noise" in {event.kind: event.detail for event in log.events}["mcap_not_used"]
