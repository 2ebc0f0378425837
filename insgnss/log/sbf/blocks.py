"""SBF blocks: found in the bytes by their sync word and checksum, and the layouts of those that are read.

Septentrio SBF reference (PolaRx5TR reference guide, firmware 5.5.0, chapter 4): a block is "$@", a CRC-16-CCITT over
what follows it, the block's number with its revision in the upper three bits, and its length, a multiple of four.
"""

from __future__ import annotations

import binascii
import struct
from collections import Counter
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from insgnss.constants import NS_PER_MS, NS_PER_WEEK
from insgnss.log.files import records
from insgnss.tables import Bool, Int64

SYNC: Final = b"$@"
HEADER_LENGTH: Final = 8
FIRST_NUMBER: Final = 4000  # of a block; appendix A of the guide
# Times from here on are none: TOW's and WNc's "do not use" values are the largest of their types
TOW_END_MS: Final = 604_800_000
WEEK_END: Final = 10_000  # the year 2171
FLOAT_MISSING: Final = -2e10

_TIME: Final = (("tow_ms", "<u4"), ("week", "<u2"))
_KEPLER_LNAV: Final = (
    *(("af2", "<f4"), ("af1", "<f4"), ("af0", "<f4"), ("crs", "<f4"), ("delta_n", "<f4"), ("m0", "<f8")),
    *(("cuc", "<f4"), ("e", "<f8"), ("cus", "<f4"), ("sqrt_a", "<f8"), ("toe_s", "<u4"), ("cic", "<f4")),
    *(("omega0", "<f8"), ("cis", "<f4"), ("i0", "<f8"), ("crc", "<f4"), ("omega", "<f8")),
    *(("omega_dot", "<f4"), ("idot", "<f4"), ("week_toc", "<u2"), ("week_toe", "<u2")),
)
_LNAV: Final = (
    *_TIME,
    *(("svid", "u1"), ("", "u1"), ("week_sent", "<u2"), ("l2_codes", "u1"), ("ura", "u1"), ("health", "u1")),
    *(("l2_flag", "u1"), ("iodc", "<u2"), ("iode", "u1"), ("iode3", "u1"), ("fit", "u1"), ("", "u1")),
    *(("tgd", "<f4"), ("toc_s", "<u4")),
    *_KEPLER_LNAV,
)
_KLOBUCHAR: Final = (*_TIME, ("svid", "u1"), ("", "u1"), ("coefficients", "<f4", (8,)))
_COVARIANCES: Final = (*_TIME, ("mode", "u1"), ("error", "u1"), ("variance", "<f4", (3,)))
# of x, y, z and the clock: the variances, then xy, xz, x and clock, yz, ...
_COVARIANCES_ECEF: Final = (*_TIME, ("mode", "u1"), ("error", "u1"), ("covariance", "<f4", (10,)))
_UTC: Final = (("a1", "<f4"), ("a0", "<f8"), ("tot_s", "<u4"), ("week_t", "u1"), ("leap", "i1"))


def _layout(*fields: tuple[str, str] | tuple[str, str, tuple[int, ...]]) -> np.dtype[np.void]:
    """Return a packed layout; fields without a name are passed over."""
    named = [(name or f"_{k}", *rest) for k, (name, *rest) in enumerate(fields)]
    return np.dtype(named)


# Raw measurements in a compressed form whose layout the reference guide leaves out
_MEAS3: Final = dict(
    enumerate(("Meas3Ranges", "Meas3CN0HiRes", "Meas3Doppler", "Meas3PP", "Meas3MP"), start=4109)
)
# Of the blocks that are not read those whose name says what is missed
_NOT_READ: Final = {**_MEAS3, 4028: "BaseVectorGeod", 4043: "BaseVectorCart"}
MEAS_EPOCH: Final = 4027
EXT_SENSOR: Final = 4050
INS_NAV: Final = 4226
ATTITUDE, ATTITUDE_COV = 5938, 5939
PVT_ECEF, PVT = 4006, 4007
POS_COV_ECEF, POS_COV, VEL_COV_ECEF, VEL_COV = 5905, 5906, 5907, 5908
GPS_NAV, GPS_ION, GPS_UTC = 5891, 5893, 5894
GAL_NAV, GAL_ION = 4002, 4030
GLO_NAV: Final = 4004
BDS_NAV, BDS_ION = 4081, 4120
QZS_NAV: Final = 4095

LAYOUTS: Final = {
    MEAS_EPOCH: _layout(
        *_TIME,
        *(("n1", "u1"), ("length1", "u1"), ("length2", "u1"), ("flags", "u1"), ("clock_jumps_ms", "u1")),
        ("", "u1"),
    ),
    EXT_SENSOR: _layout(*_TIME, ("n", "u1"), ("length", "u1")),
    INS_NAV: _layout(
        *(*_TIME, ("mode", "u1"), ("error", "u1"), ("info", "<u2"), ("age", "<u2")),
        *(("lat_rad", "<f8"), ("lon_rad", "<f8"), ("h_m", "<f8"), ("undulation_m", "<f4")),
        *(("accuracy_cm", "<u2"), ("latency", "<u2"), ("datum", "u1"), ("", "u1"), ("parts", "<u2")),
    ),
    ATTITUDE: _layout(
        *(*_TIME, ("n_sv", "u1"), ("error", "u1"), ("mode", "<u2"), ("", "<u2"), ("heading_deg", "<f4")),
        *(("pitch_deg", "<f4"), ("roll_deg", "<f4")),
    ),
    ATTITUDE_COV: _layout(*_TIME, ("", "u1"), ("error", "u1"), ("variance", "<f4", (3,))),
    # to the last field that every revision has and that is read
    PVT: _layout(
        *(*_TIME, ("mode", "u1"), ("error", "u1"), ("lat_rad", "<f8"), ("lon_rad", "<f8"), ("h_m", "<f8")),
        *(("undulation_m", "<f4"), ("v_neu", "<f4", (3,))),
    ),
    PVT_ECEF: _layout(
        *(*_TIME, ("mode", "u1"), ("error", "u1"), ("r_m", "<f8", (3,)), ("undulation_m", "<f4")),
        ("v_mps", "<f4", (3,)),
    ),
    POS_COV_ECEF: _layout(*_COVARIANCES_ECEF),
    VEL_COV_ECEF: _layout(*_COVARIANCES_ECEF),
    POS_COV: _layout(*_COVARIANCES),
    VEL_COV: _layout(*_COVARIANCES),
    GPS_NAV: _layout(*_LNAV),
    QZS_NAV: _layout(*_LNAV),
    GPS_ION: _layout(*_KLOBUCHAR),
    BDS_ION: _layout(*_KLOBUCHAR),
    GPS_UTC: _layout(*_TIME, ("svid", "u1"), ("", "u1"), *_UTC),
    GAL_ION: _layout(*_TIME, ("svid", "u1"), ("source", "u1"), ("coefficients", "<f4", (3,))),
    GAL_NAV: _layout(
        *_TIME,
        *(("svid", "u1"), ("source", "u1"), ("sqrt_a", "<f8"), ("m0", "<f8"), ("e", "<f8"), ("i0", "<f8")),
        *(("omega", "<f8"), ("omega0", "<f8"), ("omega_dot", "<f4"), ("idot", "<f4"), ("delta_n", "<f4")),
        *(("cuc", "<f4"), ("cus", "<f4"), ("crc", "<f4"), ("crs", "<f4"), ("cic", "<f4"), ("cis", "<f4")),
        *(("toe_s", "<u4"), ("toc_s", "<u4"), ("af2", "<f4"), ("af1", "<f4"), ("af0", "<f8")),
        *(("week_toe", "<u2"), ("week_toc", "<u2"), ("iod", "<u2"), ("health", "<u2"), ("", "u1")),
        *(("sisa_e5a", "u1"), ("sisa_e5b", "u1"), ("", "u1"), ("bgd_e5a", "<f4"), ("bgd_e5b", "<f4")),
    ),
    GLO_NAV: _layout(
        *_TIME,
        *(("svid", "u1"), ("channel", "u1"), ("r_km", "<f8", (3,)), ("v_kmps", "<f4", (3,))),
        *(("a_kmps2", "<f4", (3,)), ("gamma", "<f4"), ("tau", "<f4"), ("dtau", "<f4"), ("toe_s", "<u4")),
        *(("week_toe", "<u2"), ("p1", "u1"), ("p2", "u1"), ("age", "u1"), ("health_b", "u1"), ("tb", "<u2")),
        *(("m", "u1"), ("p", "u1"), ("health_l", "u1")),
    ),
    BDS_NAV: _layout(
        *_TIME,
        *(("svid", "u1"), ("", "u1"), ("week_sent", "<u2"), ("ura", "u1"), ("health", "u1"), ("aodc", "u1")),
        *(("aode", "u1"), ("", "<u2"), ("tgd1", "<f4"), ("tgd2", "<f4"), ("toc_s", "<u4")),
        *_KEPLER_LNAV,
    ),
}
# The sub-blocks of MeasEpoch
CHANNEL_1: Final = _layout(
    *(("rx", "u1"), ("type", "u1"), ("svid", "u1"), ("misc", "u1"), ("code_lsb", "<u4"), ("doppler", "<i4")),
    *(("carrier_lsb", "<u2"), ("carrier_msb", "i1"), ("cn0", "u1"), ("lock_s", "<u2"), ("info", "u1")),
    ("n2", "u1"),
)
CHANNEL_2: Final = _layout(
    *(("type", "u1"), ("lock_s", "u1"), ("cn0", "u1"), ("offsets_msb", "u1"), ("carrier_msb", "i1")),
    *(("info", "u1"), ("code_lsb", "<u2"), ("carrier_lsb", "<u2"), ("doppler_lsb", "<u2")),
)
SENSOR: Final = _layout(
    *(("source", "u1"), ("model", "u1"), ("type", "u1"), ("info", "u1"), ("xyz", "<f8", (3,))),
)


@dataclass
class Blocks:
    """Where the blocks of a file begin, by number, and the unreadable ones."""

    starts: dict[int, list[int]] = field(default_factory=dict)
    damaged: int = 0  # sync words with a sound header but a wrong checksum, or cut by the end
    others: Counter[int] = field(default_factory=Counter)  # sound blocks that are not read, by number


def find_blocks(data: bytes) -> Blocks:
    """Return where the sound blocks of ``data`` begin; bytes between them (NMEA, RTCM, noise) are passed over."""
    blocks = Blocks()
    at = data.find(SYNC)
    while at >= 0:
        length = _sound_length(data, at, blocks)
        at = data.find(SYNC, at + (length or 1))
    return blocks


def _sound_length(data: bytes, at: int, blocks: Blocks) -> int:
    """Note the block at ``at`` and return its length, zero when there is none."""
    if at + HEADER_LENGTH > len(data):
        blocks.damaged += 1
        return 0
    crc, number, length = struct.unpack_from("<HHH", data, at + 2)
    if length < HEADER_LENGTH or length % 4 or number & 0x1FFF < FIRST_NUMBER:
        return 0
    if at + length > len(data) or binascii.crc_hqx(data[at + 4 : at + length], 0) != crc:
        blocks.damaged += 1
        return 0
    number &= 0x1FFF
    layout = LAYOUTS.get(number)
    if layout is None:
        blocks.others[number] += 1
    elif length >= HEADER_LENGTH + layout.itemsize:
        blocks.starts.setdefault(number, []).append(at)
    else:
        blocks.damaged += 1
    return int(length)


def other_blocks(blocks: Blocks) -> dict[str, int]:
    """Return how many blocks are not read by number, the most frequent first, with their names where that helps."""
    names = {number: f" ({name})" for number, name in _NOT_READ.items()}
    return {f"of {number}{names.get(number, '')}": count for number, count in blocks.others.most_common()}


def missed_measurements(blocks: Blocks) -> str:
    """Return what a log's Meas3 blocks would hold and what to do about them, empty without any."""
    names = [name for number, name in _MEAS3.items() if blocks.others[number]]
    if not names:
        return ""
    count = sum(blocks.others[number] for number in _MEAS3)
    return (
        f"the raw measurements are in {count} compressed block(s) that cannot be read ({', '.join(names)})."
        " Convert this log to RINEX with sbf2rin of Septentrio's RxTools; for the next one let the receiver"
        f" send MeasEpoch (block {MEAS_EPOCH}): setSBFOutput, Stream1, <port>, +MeasEpoch"
    )


def block_length(data: bytes, start: int) -> int:
    """Return the bytes of the block that begins at ``start``, with its header."""
    return int.from_bytes(data[start + 6 : start + 8], "little")


def time_known(rows: np.ndarray[tuple[int], np.dtype[np.void]]) -> Bool:
    """Return a mask of the blocks that contain a time."""
    return np.asarray((rows["tow_ms"] < TOW_END_MS) & (rows["week"] < WEEK_END))


def block_times_ns(rows: np.ndarray[tuple[int], np.dtype[np.void]]) -> Int64:
    """Return the GPS time of blocks whose time is known [ns]."""
    tow_ns = rows["tow_ms"].astype(np.int64) * NS_PER_MS
    return np.asarray(tow_ns + rows["week"].astype(np.int64) * NS_PER_WEEK)


def block_records(data: bytes, blocks: Blocks, number: int) -> np.ndarray[tuple[int], np.dtype[np.void]]:
    """Return the contents of all blocks of a number."""
    starts = [at + HEADER_LENGTH for at in blocks.starts.get(number, [])]
    return records(data, starts, LAYOUTS[number])
