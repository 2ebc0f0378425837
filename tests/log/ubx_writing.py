"""UBX frames and broadcast messages written bit by bit for the tests, from the ICDs' tables alone."""

from __future__ import annotations

import struct
from collections.abc import Sequence

WEEK = 2381
TOW_S = 408_639.748


def frame(kind: int, payload: bytes) -> bytes:
    """Return a UBX frame with Fletcher's checksum, added up byte by byte."""
    body = struct.pack(">H", kind) + struct.pack("<H", len(payload)) + payload
    a = b = 0
    for byte in body:
        a = (a + byte) & 255
        b = (b + a) & 255
    return b"\xb5\x62" + body + bytes((a, b))


def measurement(
    gnss: int = 0,
    sv: int = 5,
    sig: int = 0,
    pr: float = 2.1e7,
    cp: float = 1.1e8,
    dop: float = -1234.5,
    freq: int = 0,
    lock: int = 5000,
    cno: int = 42,
    status: int = 7,
) -> bytes:
    """Return one measurement of RXM-RAWX."""
    head = struct.pack("<ddf4BH", pr, cp, dop, gnss, sv, sig, freq, lock)
    return head + struct.pack("<6B", cno, 3, 4, 5, status, 0)


def rawx(
    tow_s: float = TOW_S,
    measurements: Sequence[bytes] = (measurement(),),
    week: int = WEEK,
    leap: int = 18,
    status: int = 1,
) -> bytes:
    """Return a frame of RXM-RAWX."""
    head = struct.pack("<dHbBBB2x", tow_s, week, leap, len(measurements), status, 1)
    return frame(0x0215, head + b"".join(measurements))


def sfrbx(gnss: int, sv: int, sig: int, words: Sequence[int], freq: int = 0) -> bytes:
    """Return a frame of RXM-SFRBX."""
    head = struct.pack("<8B", gnss, sv, sig, freq, len(words), 1, 2, 0)
    return frame(0x0213, head + struct.pack(f"<{len(words)}I", *words))


class Bits:
    """A message whose bits are set by their number in the ICD, 1 sent first."""

    def __init__(self, length: int) -> None:
        self.bits = [0] * length

    def put(self, value: float, *places: tuple[int, int], scale: float = 1.0) -> None:
        """Set a number, negative ones in two's complement, at (first bit, count), ..., most significant first."""
        count = sum(n for _, n in places)
        raw = round(value / scale)
        assert -(1 << (count - 1)) <= raw < 1 << count
        text = format(raw % (1 << count), f"0{count}b")
        for first, n in places:
            for k in range(n):
                self.bits[first - 1 + k] = int(text[0])
                text = text[1:]

    def value(self) -> int:
        """Return the bits as one integer."""
        return int("".join(map(str, self.bits)), 2)

    def words(self, size: int) -> list[int]:
        """Return words of ``size`` bits."""
        text = "".join(map(str, self.bits))
        return [int(text[k : k + size], 2) for k in range(0, len(text), size)]


def crc24q(bits: Sequence[int]) -> int:
    """Return the CRC-24Q of single bits, by long division."""
    register = [*bits, *[0] * 24]
    generator = [int(b) for b in format(0x1864CFB, "b")]
    for k in range(len(bits)):
        if register[k]:
            for j, g in enumerate(generator):
                register[k + j] ^= g
    return int("".join(map(str, register[-24:])), 2)
