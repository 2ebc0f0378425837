"""The format of a file by what stands in it."""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest

from insgnss.errors import InputError, MissingFileError
from insgnss.log.detect import Format, detect_format
from tests.log.android_generator import COLUMNS as ANDROID_COLUMNS
from tests.log.android_generator import HEADER as ANDROID_HEADER
from tests.log.sbf_encoder import Channel, epoch, satellite
from tests.log.test_rinex_navigation import HEADER as NAV_HEADER
from tests.log.test_rinex_observations import HEADER as OBS_HEADER

PAYLOAD = bytes(range(20))


def ubx(kind: bytes = b"\x02\x15", payload: bytes = PAYLOAD) -> bytes:
    body = kind + len(payload).to_bytes(2, "little") + payload
    a = b = 0
    for byte in body:
        a = (a + byte) % 256
        b = (b + a) % 256
    return b"\xb5\x62" + body + bytes((a, b))


SBF = epoch(1.0, [satellite(5, [Channel(0, 1575.42e6, 2.3e7, 0.0, None, 40.0)])])
FILES: list[tuple[bytes, Format]] = [
    (OBS_HEADER.encode(), "rinex_observation"),
    (OBS_HEADER.replace("\n", "\r\n").encode(), "rinex_observation"),
    (
        b"3.0                 COMPACT RINEX FORMAT                    CRINEX VERS   / TYPE\n",
        "rinex_observation",
    ),
    (NAV_HEADER.encode(), "rinex_navigation"),
    (ANDROID_HEADER.encode(), "android"),
    (f"{ANDROID_COLUMNS}\n1,2\n".encode(), "android"),
    (f"\ufeff{ANDROID_COLUMNS}\r\n1,2\r\n".encode(), "android"),
    (ubx(), "ubx"),
    (b"$GNGGA,1*00\r\n" * 40 + ubx(), "ubx"),
    (b"\xb5\x62\xff\xff" * 20 + SBF * 3, "sbf"),
    (b"$@" * 30 + SBF, "sbf"),
]


@pytest.mark.parametrize(("data", "expected"), FILES)
@pytest.mark.parametrize("packed", [False, True])
def test_format_is_told_by_content(tmp_path: Path, data: bytes, expected: Format, packed: bool) -> None:
    path = tmp_path / "misleading.csv"
    path.write_bytes(gzip.compress(data) if packed else data)
    assert detect_format(path) == expected


@pytest.mark.parametrize(
    ("data", "hint"),
    [
        (b"$GPGGA,123519,4807.038,N*48\r\n", "NMEA.*checksum"),
        (b"\xd3\x00\x13\x3e", "RTCM"),
        (b"time_s,sv\n1,G05\n", "CSV"),
        (b"time_s,sv\n1,G05\n" * 10 + b"\x00", "CSV"),
        (b"Time [s];Satellite\n1;5\n", "CSV"),
        (b"#ROSBAG V2.0\nE\x00\x00\x00chunk_count=\x01", "ROS 1 bag.*rosbags-convert.*--dst-storage mcap"),
        (b"SQLite format 3\x00", "ROS 2 bag in SQLite.*MCAP.*ros2 bag convert"),
        (b"just words", "no header of a known format"),
        ("time_s,sv\n1,G05\n".encode("utf-16"), "UTF-16.*save it in UTF-8"),
        (b"\x00" * 50, "binary file of no known kind"),
        (b"BZh91AY&SY\x00\x01\x02" * 9, "packed by bzip2\n.*unpack it .gzip, zip"),
        (ubx()[:-1] + b"\x00", "binary file of no known kind"),
        (SBF[:-4], "binary file of no known kind"),
        (
            b"JP055RLOGF JPS ALPHA Receiver Log File,\r\n~~005" + bytes(range(256)) * 4,
            "binary.*RINEX.*u-blox UBX",
        ),
    ],
)
def test_unknown_content_is_refused_with_a_hint(tmp_path: Path, data: bytes, hint: str) -> None:
    path = tmp_path / "log.ubx"
    path.write_bytes(data)
    with pytest.raises(InputError, match=hint):
        detect_format(path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (f"{'     3.00           C':<60}RINEX VERSION / TYPE\n", r"clocks.*gnss\.precise"),
        (f"{'     2.00           CLOCK DATA':<60}RINEX VERSION / TYPE\n", r"clocks.*gnss\.precise"),
        ("#cP2015  8 29  0  0  0.00000000      96 ORBIT IGb08 HLM  IGS\n", r"SP3.*gnss\.precise"),
        (f"{'     1.4            M':<60}ANTEX VERSION / SYST\n", r"ANTEX.*gnss\.antennas"),
        (f"{'     3.05           M: METEOROLOGICAL DATA':<60}RINEX VERSION / TYPE\n", "weather"),
    ],
)
def test_files_beside_a_log_are_told_where_they_belong(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "file").write_text(text)
    with pytest.raises(InputError, match=f"(?s){words}"):
        detect_format(tmp_path / "file")


def test_missing_file_is_told(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError):
        detect_format(tmp_path / "none.ubx")
