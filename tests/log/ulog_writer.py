"""Writes ULog files message by message, as PX4's page of the format lists them: the source of the tests."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence

_CODES = {
    "uint64_t": "Q",
    "int64_t": "q",
    "uint32_t": "I",
    "int32_t": "i",
    "uint8_t": "B",
    "float": "f",
    "double": "d",
}
Field = tuple[str, str]  # type, perhaps with a count: "float[3]"; name


def message(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def _code(kind: str) -> str:
    base, _, count = kind.partition("[")
    return count.rstrip("]") + _CODES[base]


class Ulog:
    """A log that grows by topics and rows; ``data`` returns its bytes."""

    def __init__(self, start_us: int = 1_000_000) -> None:
        self._head = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", start_us)
        self._formats = message("B", bytes(40))
        self._data = b""
        self._topics: dict[tuple[str, int], tuple[int, str]] = {}

    def topic(self, name: str, fields: Sequence[Field], instance: int = 0) -> None:
        """Declare a topic; its first field, the timestamp, is added."""
        listed = [("uint64_t", "timestamp"), *fields]
        text = f"{name}:" + "".join(f"{kind} {field};" for kind, field in listed)
        if (name, 0) not in self._topics or instance == 0:
            self._formats += message("F", text.encode())
        number = len(self._topics)
        self._topics[name, instance] = (number, "<" + "".join(_code(kind) for kind, _ in listed))
        self._data += message("A", struct.pack("<BH", instance, number) + name.encode())

    def row(self, name: str, t_us: int, *values: float | bytes, instance: int = 0) -> None:
        number, code = self._topics[name, instance]
        flat: list[float] = []
        for value in values:
            flat += list(value) if isinstance(value, bytes | tuple) else [value]
        self._data += message("D", struct.pack("<H", number) + struct.pack(code, t_us, *flat))

    def sync(self) -> None:
        self._data += message("S", b"\x2f\x73\x13\x20\x25\x0c\xbb\x12")

    def dropout(self, ms: int) -> None:
        self._data += message("O", struct.pack("<H", ms))

    @property
    def data(self) -> bytes:
        return self._head + self._formats + self._data


GPS: Sequence[Field] = (
    ("uint64_t", "time_utc_usec"), ("double", "latitude_deg"), ("double", "longitude_deg"),
    ("double", "altitude_msl_m"), ("double", "altitude_ellipsoid_m"), ("float", "s_variance_m_s"), ("float", "eph"),
    ("float", "epv"), ("float", "vel_n_m_s"), ("float", "vel_e_m_s"), ("float", "vel_d_m_s"),
    ("int32_t", "timestamp_time_relative"), ("uint8_t", "fix_type"),
)  # fmt: skip
COMBINED: Sequence[Field] = (
    ("float[3]", "gyro_rad"), ("uint32_t", "gyro_integral_dt"), ("int32_t", "accelerometer_timestamp_relative"),
    ("float[3]", "accelerometer_m_s2"), ("uint32_t", "accelerometer_integral_dt"),
)  # fmt: skip
VEHICLE_IMU: Sequence[Field] = (
    ("uint64_t", "timestamp_sample"), ("float[3]", "delta_angle"), ("float[3]", "delta_velocity"),
    ("uint32_t", "delta_angle_dt"), ("uint32_t", "delta_velocity_dt"),
)  # fmt: skip
DUMP: Sequence[Field] = (("uint8_t", "instance"), ("uint8_t", "len"), ("uint8_t[79]", "data"))


def rows(start_us: int, step_us: int, count: int) -> Mapping[int, int]:
    """Return the times of a topic's rows by their numbers."""
    return {k: start_us + k * step_us for k in range(count)}
