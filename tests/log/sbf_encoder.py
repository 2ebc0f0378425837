"""Writes SBF blocks from physical numbers, field by field as the reference guide lists them: the source of the tests.

Independent of the reader: ``struct`` codes and a checksum computed bit by bit.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

C_MPS = 299_792_458.0
WEEK = 2367


def crc16(data: bytes) -> int:
    """CRC-16-CCITT, polynomial 0x1021, start 0, bit by bit."""
    value = 0
    for byte in data:
        value ^= byte << 8
        for _ in range(8):
            value = (value << 1) ^ 0x1021 if value & 0x8000 else value << 1
            value &= 0xFFFF
    return value


def block(number: int, body: bytes, revision: int = 1) -> bytes:
    body += b"\0" * (-len(body) % 4)
    rest = struct.pack("<HH", number | revision << 13, 8 + len(body)) + body
    return b"$@" + struct.pack("<H", crc16(rest)) + rest


def time(tow_s: float, week: int = WEEK) -> bytes:
    return struct.pack("<IH", round(tow_s * 1000), week)


@dataclass(frozen=True)
class Channel:
    """What was measured of one signal, and how the block names it."""

    number: int  # of the signal
    carrier_hz: float
    pseudorange_m: float
    doppler_hz: float
    cycles: float | None
    cn0_dbhz: float
    lock_s: int = 100
    half_cycle: bool = False
    antenna: int = 0


def _type_and_info(channel: Channel, glonass: int) -> tuple[int, int]:
    low = channel.number if channel.number < 31 else 31
    high = channel.number - 32 if low == 31 else glonass + 8 if channel.number in (8, 9, 10, 11) else 0
    return low | channel.antenna << 5, high << 3 | (4 if channel.half_cycle else 0)


def _cn0(channel: Channel) -> int:
    return round((channel.cn0_dbhz - (0 if channel.number in (1, 2) else 10)) * 4)


def _carrier(channel: Channel, code_m: float) -> tuple[int, int]:
    if channel.cycles is None:
        return -128, 0
    return divmod(round((channel.cycles - code_m * channel.carrier_hz / C_MPS) * 1000), 65_536)


def satellite(svid: int, channels: list[Channel], glonass: int = 0, padding: int = 0) -> bytes:
    """A type 1 sub-block and its type 2 sub-blocks, each ``padding`` bytes longer than needed."""
    first, *others = channels
    kind, info = _type_and_info(first, glonass)
    code_mm = round(first.pseudorange_m * 1000)
    msb, lsb = _carrier(first, code_mm / 1000)
    doppler = round(first.doppler_hz * 1e4)
    misc = code_mm >> 32
    text = struct.pack("<BBBBIi", 7, kind, svid, misc, code_mm & 0xFFFFFFFF, doppler)
    text += struct.pack("<HbBHBB", lsb, msb, _cn0(first), first.lock_s, info, len(others)) + b"\0" * padding
    for other in others:
        kind, info = _type_and_info(other, glonass)
        code_msb, code_lsb = divmod(round(other.pseudorange_m * 1000) - code_mm, 65_536)
        scaled = doppler * 1e-4 * other.carrier_hz / first.carrier_hz
        rate_msb, rate_lsb = divmod(round((other.doppler_hz - scaled) * 1e4), 65_536)
        msb, lsb = _carrier(other, round(other.pseudorange_m * 1000) / 1000)
        offsets = (code_msb & 7) | (rate_msb & 31) << 3
        text += struct.pack("<BBBBbB", kind, min(other.lock_s, 254), _cn0(other), offsets, msb, info)
        text += struct.pack("<HHH", code_lsb, lsb, rate_lsb) + b"\0" * padding
    return text


def epoch(
    tow_s: float, satellites: list[bytes], jumps_ms: int = 0, flags: int = 0, padding: int = 0
) -> bytes:
    head = struct.pack("<BBBBBB", len(satellites), 20 + padding, 12 + padding, flags, jumps_ms % 256, 0)
    return block(4027, time(tow_s) + head + b"".join(satellites))


def sensor(tow_s: float, rates_dps: tuple[float, ...] | None, forces: tuple[float, ...] | None) -> bytes:
    parts = [(1, rates_dps), (0, forces)]
    sets = [struct.pack("<BBBB3d", 1, 2, kind, 0, *xyz) for kind, xyz in parts if xyz is not None]
    return block(4050, time(tow_s) + struct.pack("<BB", len(sets), 28) + b"".join(sets))


def fix(tow_s: float, mode: int = 4, error: int = 0, accuracies_cm: tuple[int, int] | None = None) -> bytes:
    """PVTGeodetic: every number a known function of the time; with accuracies it is of revision 2."""
    body = time(tow_s) + struct.pack("<BBdddf", mode, error, 0.5, -1.5, 100.0 + tow_s % 100, -27.0)
    body += struct.pack("<ffff", 4.0, 3.0, 0.5, -2e10)  # north, east, up, course
    body += struct.pack("<dfBBBBHHIB", 0.1, 0.2, 0, 0, 12, 0, 0, 0, 1, 0)
    if accuracies_cm is None:
        return block(4007, body, revision=0)
    return block(4007, body + struct.pack("<BHHHHB", 1, 0, 50, *accuracies_cm, 0), revision=2)


def cartesian_fix(
    tow_s: float, r_m: tuple[float, ...], v_mps: tuple[float, ...], mode: int = 4, error: int = 0
) -> bytes:
    """PVTCartesian of revision 0."""
    body = time(tow_s) + struct.pack("<BB3dffff", mode, error, *r_m, -27.0, *v_mps)
    body += struct.pack("<fdfBBBBHHIB", -2e10, 0.1, 0.2, 0, 0, 12, 0, 0, 0, 1, 0)
    return block(4006, body, revision=0)


def cartesian_covariances(number: int, tow_s: float, xyz: tuple[tuple[float, ...], ...]) -> bytes:
    """PosCovCartesian (5905) or VelCovCartesian (5907) of a covariance along x, y, z."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = xyz
    values = (xx, yy, zz, 0.25, xy, xz, 0.01, yz, 0.02, 0.03)
    return block(number, time(tow_s) + struct.pack("<BB10f", 4, 0, *values), revision=0)


def covariances(number: int, tow_s: float, variances: tuple[float, float, float], error: int = 0) -> bytes:
    """PosCovGeodetic (5906) or VelCovGeodetic (5908)."""
    others = (0.25, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06)
    return block(number, time(tow_s) + struct.pack("<BB10f", 4, error, *variances, *others), revision=0)


def attitude(tow_s: float, heading_deg: float, mode: int = 2, error: int = 0) -> bytes:
    """AttEuler of two antennas; pitch 1.5 deg, no roll."""
    body = struct.pack("<BBHBB6f", 20, error, mode, 0, 0, heading_deg, 1.5, -2e10, 0.0, -2e10, 0.0)
    return block(5938, time(tow_s) + body)


def attitude_covariance(tow_s: float, heading_deg2: float) -> bytes:
    """AttCovEuler of two antennas."""
    return block(5939, time(tow_s) + struct.pack("<BB6f", 0, 0, heading_deg2, 0.09, *[-2e10] * 4))


def ins_solution(tow_s: float, error: int = 0, parts: int = 0b11111, week: int = WEEK) -> bytes:
    """INSNavGeod: every number a known function of the time; ``parts`` names the sub-blocks that follow."""
    head = struct.pack("<BBHHdddf", 4, error, 0, 0, 0.5, -1.5, 100.0 + tow_s % 100, -27.0)
    head += struct.pack("<HHBBH", 40, 0, 0, 0, parts)
    triples = (
        (0.3, 0.25, 0.5),  # sigmas of latitude, longitude, height
        (45.0, -2.0, 1.5),  # heading, pitch, roll
        (0.2, 0.125, 0.0625),
        (3.0, 4.0, -0.5),  # east, north, up
        (0.03125, 0.046875, 0.0546875),
    )
    body = b"".join(struct.pack("<3f", *t) for k, t in enumerate(triples) if parts >> k & 1)
    return block(4226, time(tow_s, week) + head + body, revision=0)
