"""Writes NovAtel OEM messages field by field, as the OEM7 manual lists them: the source of the tests.

Independent of the reader: ``struct`` codes and a checksum computed bit by bit.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

C_MPS = 299_792_458.0
WEEK, TOW_S = 2195, 512_277.0


def crc32(data: bytes) -> int:
    """NovAtel's CRC: polynomial 0xEDB88320 reflected, start 0, no inversion, bit by bit."""
    value = 0
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = (value >> 1) ^ 0xEDB88320 if value & 1 else value >> 1
    return value


def message(
    kind: int, body: bytes, tow_s: float = TOW_S, week: int = WEEK, form: int = 0, status: int = 180
) -> bytes:
    """Return a message with the long header."""
    head = b"\xaa\x44\x12" + struct.pack("<BHBBHHBBHIIHH", 28, kind, form, 32, len(body), 0, 50, status, week,
                                         round(tow_s * 1000), 0, 0, 16_809)  # fmt: skip
    return head + body + struct.pack("<I", crc32(head + body))


def short(kind: int, body: bytes, tow_s: float = TOW_S, week: int = WEEK) -> bytes:
    """Return a message with the short header."""
    head = b"\xaa\x44\x13" + struct.pack("<BHHI", len(body), kind, week, round(tow_s * 1000))
    return head + body + struct.pack("<I", crc32(head + body))


def resealed(data: bytes) -> bytes:
    """Return the bytes with the checksums of all messages made right again: damage that no checksum tells."""
    out, at = bytearray(data), 0
    while at + 12 <= len(out):
        if out[at : at + 3] == b"\xaa\x44\x12":
            end = at + out[at + 3] + int.from_bytes(out[at + 8 : at + 10], "little")
        elif out[at : at + 3] == b"\xaa\x44\x13":
            end = at + 12 + out[at + 3]
        else:
            at += 1
            continue
        if end + 4 <= len(out):
            out[end : end + 4] = struct.pack("<I", crc32(bytes(out[at:end])))
            at = end + 4
        else:
            at += 1
    return bytes(out)


@dataclass(frozen=True)
class Channel:
    """What was measured of one signal."""

    prn: int
    range_m: float = 2.2e7
    cycles: float = 1.15e8  # RINEX sign
    doppler_hz: float = -1234.5
    cn0: float = 45.0
    lock_s: float = 100.0
    system: int = 0
    signal: int = 0
    channel: int = 0  # GLONASS
    phase_lock: bool = True
    parity: bool = True
    code_lock: bool = True
    half: bool = False

    def status(self) -> int:
        bits = 4 | self.phase_lock << 10 | self.parity << 11 | self.code_lock << 12
        return bits | self.system << 16 | self.signal << 21 | self.half << 28


def range_b(channels: list[Channel], tow_s: float = TOW_S, form: int = 0, status: int = 180) -> bytes:
    rows = [
        struct.pack("<HHdfdffffI", c.prn, c.channel + 7, c.range_m, 0.05, -c.cycles, 0.01, c.doppler_hz, c.cn0,
                    c.lock_s, c.status())
        for c in channels
    ]  # fmt: skip
    return message(43, struct.pack("<I", len(rows)) + b"".join(rows), tow_s, form=form, status=status)


def rangecmp(channels: list[Channel], tow_s: float = TOW_S) -> bytes:
    """Return RANGECMP: bit fields laid side by side, the least significant first."""
    body = struct.pack("<I", len(channels))
    for c in channels:
        adr = round(-c.cycles * 256) % (1 << 32 - 1)  # modulo 2^23 cycles
        adr = adr - (1 << 31) if adr >= 1 << 30 else adr
        fields = (
            (c.status(), 32), (round(c.doppler_hz * 256), 28), (round(c.range_m * 128), 36), (adr, 32), (1, 4), (1, 4),
            (c.prn, 8), (round(c.lock_s * 32), 21), (round(c.cn0 - 20), 5), (c.channel + 7, 6), (0, 16),
        )  # fmt: skip
        body += _packed(fields, 24)
    return message(140, body, tow_s)


def rangecmp2(
    system: int,
    number: int,
    channel: int,
    base_m: int,
    base_hz: int,
    signals: list[tuple[int, Channel, float, float]],
) -> bytes:
    """Return RANGECMP2 of one satellite; each signal with its type, phase range [m], Doppler of the first carrier."""
    fields: tuple[tuple[int, int], ...] = (
        (3, 8), (number, 8), (channel + 7, 4), (system, 5), (0, 1), (base_m, 29), (base_hz, 21), (len(signals), 4),
    )  # fmt: skip
    body = _packed(fields, 10)
    for kind, c, phase_m, doppler in signals:
        fields = (
            (kind, 5), (c.phase_lock, 1), (c.parity, 1), (c.code_lock, 1), (round(c.lock_s * 1000), 17), (1, 4), (1, 1),
            (c.half, 1), (0, 1), (round(c.cn0 - 20), 5), (2, 4), (2, 4), (round((c.range_m - base_m) * 128), 14),
            (round((phase_m - base_m) * 2048), 20), (round((doppler - base_hz) * 256), 17),
        )  # fmt: skip
        body += _packed(fields, 12)
    return message(1273, struct.pack("<I", len(body)) + body)


def _packed(fields: tuple[tuple[int, int], ...], size: int) -> bytes:
    value, place = 0, 0
    for number, bits in fields:
        assert -(1 << bits) < int(number) < 1 << bits
        value |= (int(number) % (1 << bits)) << place
        place += bits
    assert place == 8 * size
    return value.to_bytes(size, "little")


def rawimusx(
    tow_s: float, gyro: tuple[int, int, int], accel: tuple[int, int, int], kind: int = 58, info: int = 0
) -> bytes:
    """Return RAWIMUSX with counts about and along x, y, z."""
    z_y_x = struct.pack("<6i", accel[2], -accel[1], accel[0], gyro[2], -gyro[1], gyro[0])
    return short(1462, struct.pack("<BBHdI", info, kind, WEEK, tow_s, 0) + z_y_x, tow_s)


def rawimus(tow_s: float, gyro: tuple[int, int, int], accel: tuple[int, int, int]) -> bytes:
    z_y_x = struct.pack("<6i", accel[2], -accel[1], accel[0], gyro[2], -gyro[1], gyro[0])
    return short(325, struct.pack("<IdI", WEEK, tow_s, 0) + z_y_x, tow_s)


def inspvax(tow_s: float, status: int = 3) -> bytes:
    body = struct.pack("<II3df3d3d9fIH", status, 56, 51.15, -114.03, 1080.0, -17.0, 1.0, 2.0, 0.5, -1.5, 2.5, 90.0,
                       *(0.1 * k for k in range(1, 10)), 0, 0)  # fmt: skip
    return message(1465, body, tow_s)


def inspvas(tow_s: float, status: int = 3) -> bytes:
    body = struct.pack(
        "<Id3d3d3dI", WEEK, tow_s, 51.15, -114.03, 1063.0, 1.0, 2.0, 0.5, -1.5, 2.5, 90.0, status
    )
    return short(508, body, tow_s)


def bestpos(tow_s: float, status: int = 0, kind: int = 16) -> bytes:
    body = struct.pack("<II3dfI3f", status, kind, 51.15, -114.03, 1080.0, -17.0, 61, 0.5, 0.6, 0.9)
    return message(42, body + b"AAAA" + struct.pack("<ff8B", 0, 0, *[9] * 8), tow_s)


def bestxyz(
    tow_s: float, xyz: tuple[float, float, float], velocity: tuple[float, float, float], status: int = 0
) -> bytes:
    parts = [struct.pack("<II3d3f", status, 16, *vector, 0.5, 0.6, 0.9) for vector in (xyz, velocity)]
    return message(241, b"".join(parts) + b"AAAA" + struct.pack("<fff8B", 0, 0, 0, *[9] * 8), tow_s)


def heading2(tow_s: float, heading_deg: float, status: int = 0, kind: int = 50) -> bytes:
    """Return HEADING2 of a baseline of 1.25 m, pitch 1.5 deg, sigmas 0.25 and 0.5 deg."""
    body = struct.pack("<II6f", status, kind, 1.25, heading_deg, 1.5, 0.0, 0.25, 0.5)
    return message(1335, body + b"ROVRBASE" + bytes([20, 18, 18, 9, 1, 0, 3, 51]), tow_s)


def bestvel(tow_s: float, speed: float, track_deg: float, up: float) -> bytes:
    return message(99, struct.pack("<IIffdddf", 0, 8, 0.15, 0, speed, track_deg, up, 0), tow_s)


def gloephemeris(slot: int, channel: int, tow_s: float) -> bytes:
    """Return GLOEPHEMERIS of a satellite at 1e7, -2e7, 5e6 m, (1000, 2000, -3000) m/s."""
    body = struct.pack(
        "<HHBBHIIHBBII", slot + 37, channel + 7, 1, 0, WEEK, round(tow_s * 1000), 10_782, 700, 0, 0, 5, 0
    )
    body += struct.pack("<9d", 1e7, -2e7, 5e6, 1e3, 2e3, -3e3, 1e-6, -2e-6, 0.0)
    return message(723, body + struct.pack("<3d5I", -3e-5, 1e-9, 2e-12, 0, 0, 0, 0, 0), tow_s)


def inav(prn: int, toe_s: int) -> bytes:
    """Return GALINAVEPHEMERIS."""
    body = struct.pack("<I8BHBBII", prn, 1, 0, 0, 0, 2, 1, 0, 0, 77, 107, 3, toe_s, toe_s)
    return message(1309, body + struct.pack("<20d", 0.5, 3e-9, 1e-4, 5440.6, 0.97, 1e-10, 2.0, -0.5, -5e-9, 1e-6, 2e-6,
                                            150.0, 90.0, 1e-8, -1e-8, 1e-4, 2e-12, 0.0, -4e-9, -5e-9))  # fmt: skip


def rawephem(prn: int, subframes: list[int], toe_s: int, kind: int = 41) -> bytes:
    """Return RAWEPHEM with three subframes of 240 bits."""
    return message(
        kind, struct.pack("<III", prn, WEEK, toe_s) + b"".join(s.to_bytes(30, "big") for s in subframes)
    )
