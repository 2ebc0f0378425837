"""ROS 2 bags, written by the libraries' own writers, become tables with those numbers."""

from __future__ import annotations

import builtins
import datetime as dt
import io
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from insgnss.errors import InputError
from insgnss.gpstime import utc_to_ns
from insgnss.log.convert import convert
from insgnss.log.detect import detect_format
from insgnss.log.flight import Flight
from insgnss.log.receiver import ReceiverLog
from insgnss.log.rosbag.reader import read_rosbag
from tests.log.rtcm_encoder import Orbit, galileo_ephemeris, msm, station
from tests.log.test_convert import read_again, same
from tests.log.test_rtcm import TOW_S, WEEK, gps_cells
from tests.log.ubx_writing import rawx

UTC = dt.datetime(2025, 8, 28, 17, 30, 21)
UNIX_S = int(UTC.replace(tzinfo=dt.UTC).timestamp())
HEADER = """
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
IMU = (
    """std_msgs/Header header
geometry_msgs/Quaternion orientation
float64[9] orientation_covariance
geometry_msgs/Vector3 angular_velocity
float64[9] angular_velocity_covariance
geometry_msgs/Vector3 linear_acceleration
float64[9] linear_acceleration_covariance
================================================================================
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z"""
    + HEADER
)
FIX = (
    """std_msgs/Header header
sensor_msgs/NavSatStatus status
float64 latitude
float64 longitude
float64 altitude
float64[9] position_covariance
uint8 position_covariance_type
================================================================================
MSG: sensor_msgs/NavSatStatus
int8 status
uint16 service"""
    + HEADER
)
MEAS = """float64 pr_mes
float64 cp_mes
float32 do_mes
uint8 gnss_id
uint8 sv_id
uint8 {signal}
uint8 freq_id
uint16 locktime
int8 {strength}
uint8 pr_stdev
uint8 cp_stdev
uint8 do_stdev
"""
RAWX = (
    """float64 rcv_tow
uint16 week
int8 leap_s
uint8 num_meas
uint8 rec_stat
uint8 version
ublox_msgs/RxmRAWXMeas[] meas
================================================================================
MSG: ublox_msgs/RxmRAWXMeas
"""
    + MEAS.format(signal="reserved0", strength="cno")
    + "uint8 trk_stat\n"
)
UBX_RAWX = (
    """float64 rcv_tow
uint16 week
int8 leap_s
uint8 num_meas
ublox_ubx_msgs/RecStat rec_stat
uint8 version
ublox_ubx_msgs/RawxData[] rawx_data
================================================================================
MSG: ublox_ubx_msgs/RecStat
bool leap_sec
bool clk_reset
================================================================================
MSG: ublox_ubx_msgs/RawxData
"""
    + MEAS.format(signal="sig_id", strength="c_no")
    + """ublox_ubx_msgs/TrkStat trk_stat
================================================================================
MSG: ublox_ubx_msgs/TrkStat
bool pr_valid
bool cp_valid
bool half_cyc
bool sub_half_cyc
"""
)
FIELD = (
    """std_msgs/Header header
geometry_msgs/Vector3 magnetic_field
float64[9] magnetic_field_covariance"""
    + HEADER
    + """
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z"""
)
STRING, BYTES = "string data", "std_msgs/Header header\nuint8[] message" + HEADER


class Bag:
    """A bag that grows by messages; ``data`` returns its bytes."""

    def __init__(self, compression: str = "ZSTD", chunk: int = 20_000) -> None:
        pytest.importorskip("mcap_ros2", reason="the extra 'mcap' is not installed")
        from mcap.writer import CompressionType
        from mcap_ros2.writer import Writer

        self._stream = io.BytesIO()
        self._writer = Writer(self._stream, chunk_size=chunk, compression=CompressionType[compression])
        self._schemas: dict[str, Any] = {}

    def put(self, topic: str, kind: str, text: str, after_s: float, message: Mapping[str, Any]) -> None:
        if kind not in self._schemas:
            self._schemas[kind] = self._writer.register_msgdef(kind, text)
        t_ns = UNIX_S * 10**9 + round(after_s * 1e9)
        schema = self._schemas[kind]
        self._writer.write_message(
            topic=topic, schema=schema, message=message, log_time=t_ns, publish_time=t_ns
        )

    def imu(self, after_s: float, topic: str = "/imu/data", sec: int | None = None, **changes: Any) -> None:
        message = {
            "header": header(after_s, sec),
            "angular_velocity": {"x": 0.1, "y": -0.2, "z": 0.3},
            "angular_velocity_covariance": [0.0] * 9,
            "linear_acceleration": {"x": 0.5, "y": 1.5, "z": 9.8},
            "linear_acceleration_covariance": [0.0] * 9,
        } | changes
        self.put(topic, "sensor_msgs/msg/Imu", IMU, after_s, message)

    def fix(self, after_s: float, status: int = 0, topic: str = "/fix") -> None:
        message = {
            "header": header(after_s),
            "status": {"status": status, "service": 1},
            **{"latitude": 47.0, "longitude": 8.0 + after_s * 1e-5, "altitude": 547.5},
            "position_covariance": [4.0, 0, 0, 0, 1.0, 0, 0, 0, 9.0],
            "position_covariance_type": 2,
        }
        self.put(topic, "sensor_msgs/msg/NavSatFix", FIX, after_s, message)

    @property
    def data(self) -> bytes:
        self._writer.finish()
        return self._stream.getvalue()


def header(after_s: float, sec: int | None = None) -> dict[str, Any]:
    whole = int(after_s)
    return {
        "stamp": {"sec": UNIX_S + whole if sec is None else sec, "nanosec": round((after_s - whole) * 1e9)},
        "frame_id": "imu_link",
    }


def measurement(**names: Any) -> dict[str, Any]:
    values = {"pr_mes": 2.1e7, "cp_mes": 1.1e8, "do_mes": -1234.5, "gnss_id": 0, "sv_id": 5, "freq_id": 0}
    return values | {"locktime": 5000, "pr_stdev": 1, "cp_stdev": 1, "do_stdev": 1} | names


def recorded(compression: str = "ZSTD", seconds: int = 5) -> Bag:
    bag = Bag(compression)
    for k in range(seconds):
        for j in range(20):
            bag.imu(k + j / 20)
        bag.fix(k)
        bag.put("/chatter", "std_msgs/msg/String", STRING, k, {"data": "hello"})
        rows = [
            measurement(reserved0=0, cno=42, trk_stat=7),
            measurement(sv_id=7, reserved0=3, cno=30, trk_stat=3),
        ]
        head = {
            "rcv_tow": 408_639.0 + k,
            "week": 2381,
            "leap_s": 18,
            "num_meas": 2,
            "rec_stat": 1,
            "version": 1,
        }
        bag.put("/ublox/rxmraw", "ublox_msgs/msg/RxmRAWX", RAWX, k, head | {"meas": rows})
    return bag


def read(folder: Path, data: bytes, **topics: str) -> ReceiverLog:
    path = folder / "bag"
    path.write_bytes(data)
    return read_rosbag(path, topics)


@pytest.mark.parametrize("compression", ["NONE", "LZ4", "ZSTD"])
def test_bag_becomes_samples_fixes_and_measurements(tmp_path: Path, compression: str) -> None:
    log = read(tmp_path, recorded(compression).data)
    assert log.imu is not None and len(log.imu.t_ns) == 100
    assert log.imu.t_ns[21] == utc_to_ns(UTC) + 1_050_000_000
    assert log.imu.w_ib_b[3].tolist() == [0.1, -0.2, 0.3] and log.imu.f_b[3].tolist() == [0.5, 1.5, 9.8]
    own = log.solution
    assert own is not None and len(own.t_ns) == 5 and own.h_m[0] == 547.5 and (own.quality == 2.0).all()
    assert own.sigma is not None and own.sigma[0, :3].tolist() == [1.0, 2.0, 3.0]
    gnss = log.gnss
    assert len(gnss.t_ns) == 10 and gnss.sv_names == ("G05", "G07") and gnss.signal_names == ("C1C", "C2L")
    assert (gnss.pseudorange_m == 2.1e7).all() and gnss.doppler_hz[0] == -1234.5 and gnss.cn0_dbhz[0] == 42
    assert gnss.lli is not None and gnss.lli[:2].tolist() == [0, 2]
    told = {event.kind: event.detail for event in log.events}
    assert "5 /chatter (std_msgs/msg/String)" in told["mcap_not_used"]


def test_pressure_and_field_are_the_logs_further_samples(tmp_path: Path) -> None:
    bag = recorded()
    head = "std_msgs/Header header\n"
    for k in range(4):
        pressure = {"header": header(k), "fluid_pressure": 95_012.5 + k, "variance": 0.0}
        text = head + "float64 fluid_pressure\nfloat64 variance" + HEADER
        bag.put("/baro", "sensor_msgs/msg/FluidPressure", text, k, pressure)
        for topic, count in (("/mag", 4), ("/mag_spare", 2)):
            field = {
                "header": header(k),
                "magnetic_field": {"x": 25e-6, "y": -50e-6, "z": 1e-6 * k},
                "magnetic_field_covariance": [0.0] * 9,
            }
            if k < count:
                bag.put(topic, "sensor_msgs/msg/MagneticField", FIELD, k, field)
    log = read(tmp_path, bag.data)
    found = {samples.kind: samples for samples in log.further}
    assert found["barometer"].values[:, 0] == pytest.approx([950.125, 950.135, 950.145, 950.155])
    assert found["magnetometer"].source == "/mag"
    assert found["magnetometer"].values[3] == pytest.approx([25.0, -50.0, 3.0])
    assert found["magnetometer"].t_ns[3] == utc_to_ns(UTC) + 3 * 10**9
    told = {event.kind: event.detail for event in log.events}
    assert "2 /mag_spare (/mag has more)" in told["sensor_samples_not_used"]
    assert "/mag" not in told["mcap_not_used"]


def test_measurements_of_the_other_driver_are_the_same(tmp_path: Path) -> None:
    bag = Bag()
    state = {"pr_valid": True, "cp_valid": True, "half_cyc": True, "sub_half_cyc": False}
    rows = [measurement(sig_id=0, c_no=42, trk_stat=state)]
    head = {"rcv_tow": 408_639.0, "week": 2381, "leap_s": 18, "num_meas": 1, "version": 1}
    message = head | {"rec_stat": {"leap_sec": True, "clk_reset": False}, "rawx_data": rows}
    bag.put("/ubx/rawx", "ublox_ubx_msgs/msg/UBXRxmRawx", UBX_RAWX, 0, message)
    other, one = read(tmp_path, bag.data).gnss, read(tmp_path, recorded().data).gnss
    for name in ("pseudorange_m", "carrier_cycles", "doppler_hz", "cn0_dbhz", "lli"):
        assert getattr(other, name)[0] == getattr(one, name)[0], name


@pytest.mark.parametrize("kind", ["ubx", "rtcm"])
def test_bytes_are_read_as_what_they_are(tmp_path: Path, kind: str) -> None:
    stream = b"".join(rawx(408_639.0 + k) for k in range(3))
    if kind == "rtcm":
        stream = msm("G", 7, TOW_S * 1000, gps_cells()) + galileo_ephemeris(11, WEEK - 1024, Orbit())
    bag = Bag()
    for k in range(0, len(stream), 50):
        bag.put(
            "/bytes",
            "rtcm_msgs/msg/Message",
            BYTES,
            k,
            {"header": header(k), "message": list(stream[k : k + 50])},
        )
    log = read(tmp_path, bag.data)
    assert len(np.unique(log.gnss.t_ns)) == (3 if kind == "ubx" else 1) and "G05" in log.gnss.sv_names


def test_corrections_that_a_robot_receives_are_no_measurements_of_its_receiver(tmp_path: Path) -> None:
    bag = Bag()
    for k in range(3):
        bag.fix(k)  # far from the station
        data = msm("G", 7, (TOW_S + k) * 1000, gps_cells()) + station(7, -3869297.5, 3436571.3, 3717369.4)
        data += galileo_ephemeris(11, WEEK - 1024, Orbit())
        content = {"header": header(k), "message": list(data)}
        bag.put("/ntrip_client/rtcm", "rtcm_msgs/msg/Message", BYTES, k, content)
    log = read(tmp_path, bag.data)
    assert not len(log.gnss.t_ns) and log.satellite_fixes() is not None
    assert "km away, a base: not read" in {event.kind: event.detail for event in log.events}["rtcm_of_base"]
    # a topic that the user names is this receiver's
    assert len(np.unique(read(tmp_path, bag.data, gnss="/ntrip_client/rtcm").gnss.t_ns)) == 3
    assert len(np.unique(read_rosbag(tmp_path / "bag", rtcm="own").gnss.t_ns)) == 3
    bag = Bag()
    for k in range(3):
        bag.fix(k)
        content = {"header": header(k), "message": list(msm("G", 7, TOW_S * 1000, gps_cells()))}
        bag.put("/rtcm", "rtcm_msgs/msg/Message", BYTES, k, content)
    (tmp_path / "bag").write_bytes(bag.data)
    assert not len(read_rosbag(tmp_path / "bag", rtcm="base").gnss.t_ns)


def test_of_several_topics_one_has_to_be_named(tmp_path: Path) -> None:
    bag = recorded()
    bag.imu(0.0, "/other/imu")
    bag.imu(0.1, "/other/imu")
    data = bag.data
    with pytest.raises(InputError, match=r"2 topics could be the imu(.|\n)*--topic imu=/imu/data"):
        read(tmp_path, data)
    log = read(tmp_path, data, imu="/other/imu")
    assert log.imu is not None and len(log.imu.t_ns) == 2
    assert "/imu/data" in {event.kind: event.detail for event in log.events}["mcap_not_used"]
    with pytest.raises(InputError, match=r"no topic '/nobody'(.|\n)*/other/imu"):
        read(tmp_path, data, imu="/nobody")


def test_stamps_that_are_no_dates_and_sensors_without_data_are_told(tmp_path: Path) -> None:
    bag = Bag()
    for k in range(4):
        bag.imu(k / 10, sec=12)
    bag.fix(0.0)
    bag.fix(1.0, status=-1)
    bag.fix(2.0)
    log = read(tmp_path, bag.data)
    assert log.imu is None and log.solution is not None and len(log.solution.t_ns) == 2
    assert "invalid time stamp" in {event.kind: event.detail for event in log.events}["mcap_time_unknown"]
    bag = Bag()
    for k in range(4):
        bag.imu(k / 10, linear_acceleration_covariance=[-1.0] + [0.0] * 8)
    with pytest.raises(InputError, match="no specific forces"):
        read(tmp_path, bag.data)


def test_cut_and_damaged_bags_give_what_they_hold(tmp_path: Path) -> None:
    data = recorded("NONE", 60).data
    cut = read(tmp_path, data[: len(data) // 2])
    assert cut.imu is not None and 100 < len(cut.imu.t_ns) < 1200
    assert "mcap_cut" in {event.kind for event in cut.events}
    spoilt = bytearray(data)
    spoilt[len(data) // 3] ^= 0x55
    log = read(tmp_path, bytes(spoilt))
    assert log.imu is not None and 800 < len(log.imu.t_ns) < 1200
    assert "a chunk of" in {event.kind: event.detail for event in log.events}["mcap_damaged"]


def test_a_chunk_that_grows_beyond_belief_is_left_out(tmp_path: Path) -> None:
    zstandard = pytest.importorskip("zstandard", reason="the extra 'mcap' is not installed")
    data = recorded(seconds=2).data
    packed = zstandard.ZstdCompressor().compress(b"\0" * (1 << 28))
    chunk = struct.pack("<QQQII4sQ", 0, 0, 1 << 28, 0, 4, b"zstd", len(packed)) + packed
    record = b"\x06" + struct.pack("<Q", len(chunk)) + chunk
    magic = 8
    end = magic + 9 + int.from_bytes(data[magic + 1 : magic + 9], "little")
    log = read(tmp_path, data[:end] + record + data[end:])
    assert log.imu is not None and len(log.imu.t_ns) == 40
    assert "more than 100 times" in {event.kind: event.detail for event in log.events}["mcap_damaged"]


def test_what_is_no_bag_or_holds_nothing_is_told(tmp_path: Path) -> None:
    bag = Bag()
    bag.put("/chatter", "std_msgs/msg/String", STRING, 0, {"data": "hello"})
    with pytest.raises(InputError, match=r"1 /chatter(.|\n)*sensor_msgs/msg/Imu"):
        read(tmp_path, bag.data)
    with pytest.raises(InputError, match="cannot be read"):
        read(tmp_path, b"\x89MCAP0\r\n" + bytes(100))


def test_bag_without_a_message_says_that_nothing_was_published(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"the bag holds no message(.|\n)*nothing was published"):
        read(tmp_path, Bag().data)


def test_converted_bag_is_a_flight(tmp_path: Path) -> None:
    path = tmp_path / "data.db3"
    path.write_bytes(recorded().data)
    assert detect_format(path) == "mcap"
    done = convert([path], tmp_path / "out")
    assert [p.name for p in done.written] == ["gnss_obs.csv", "imu.csv", "reference.csv", "flight.toml"]
    same(done.log.gnss, read_again(tmp_path / "out")[1])
    config = Flight.load(tmp_path / "out" / "flight.toml").config
    assert config.imu is not None and '["+x", "-y", "-z"]' in (tmp_path / "out" / "flight.toml").read_text()


def test_without_the_library_the_error_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = builtins.__import__

    def missing(name: str, *rest: Any, **named: Any) -> Any:
        if name.split(".")[0] in ("mcap", "mcap_ros2"):
            raise ImportError(name)
        return real(name, *rest, **named)

    monkeypatch.setattr(builtins, "__import__", missing)
    (tmp_path / "bag").write_bytes(b"\x89MCAP0\r\n")
    with pytest.raises(InputError, match=r"pip install 'insgnss\[mcap\]'"):
        read_rosbag(tmp_path / "bag")


@pytest.fixture(scope="module")
def small() -> bytes:
    return recorded("NONE", 2).data
