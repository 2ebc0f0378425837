"""Bit fields of broadcast messages: a message is one integer, its first transmitted bit the most significant."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple


class Field(NamedTuple):
    """One field of a message; fields follow each other without a gap."""

    name: str  # "" for bits that are passed over
    bits: int
    scale: float = 1.0
    signed: bool = False  # two's complement


def angle(power: int) -> float:
    """Return the scale of an angle sent in units of 2^power semicircles [rad]."""
    return math.ldexp(math.pi, power)


def power(exponent: int) -> float:
    """Return 2^exponent."""
    return math.ldexp(1.0, exponent)


# Elements of an orbit, which all systems send with the same bits and scales: bits, scale, two's complement
_ELEMENTS: Final = {
    **{name: (32, angle(-31), True) for name in ("m0", "i0", "omega0", "omega")},
    **{"e": (32, power(-33), False), "sqrt_a": (32, power(-19), False), "delta_n": (16, angle(-43), True)},
    **{"omega_dot": (24, angle(-43), True), "idot": (14, angle(-43), True)},
}


def orbit_fields(names: str, *, bits: int, angles: int, radii: int) -> tuple[Field, ...]:
    """Return fields of an orbit, elements and harmonics, in the order of their names ("m0 cuc crs").

    Parameters
    ----------
    bits : of each harmonic of the system
    angles, radii : exponents of two of the scales of cuc, cus, cic, cis [rad] and of crc, crs [m]
    """
    harmonics = {name: (bits, power(angles), True) for name in ("cuc", "cus", "cic", "cis")}
    harmonics |= {name: (bits, power(radii), True) for name in ("crc", "crs")}
    return tuple(Field(name, *(_ELEMENTS | harmonics)[name]) for name in names.split())


def unsigned(message: int, length: int, start: int, bits: int) -> int:
    """Return ``bits`` bits of a message of ``length`` bits, from bit ``start`` on (0 is sent first)."""
    return message >> (length - start - bits) & ((1 << bits) - 1)


def twos_complement(value: int, bits: int) -> int:
    """Return the signed number that ``bits`` bits hold."""
    return value - (1 << bits) if value >> (bits - 1) else value


def sign_and_magnitude(value: int, bits: int) -> int:
    """Return the number whose first of ``bits`` bits is its sign (GLONASS ICD 5.1, 4.4)."""
    magnitude = value & ((1 << (bits - 1)) - 1)
    return -magnitude if value >> (bits - 1) else magnitude


def unpack(message: int, length: int, fields: Sequence[Field]) -> dict[str, float]:
    """Return the named fields of a message, scaled; the fields count from the first bit sent."""
    values = {}
    at = 0
    for name, bits, scale, signed in fields:
        if name:
            raw = unsigned(message, length, at, bits)
            values[name] = (twos_complement(raw, bits) if signed else raw) * scale
        at += bits
    return values


def joined(words: Sequence[int], bits: int) -> int:
    """Return words of ``bits`` bits as one integer, the first word in front."""
    message = 0
    for word in words:
        message = message << bits | (word & ((1 << bits) - 1))
    return message


# x^24 + x^23 + x^18 + x^17 + x^14 + x^11 + x^10 + x^7 + x^6 + x^5 + x^4 + x^3 + x + 1
CRC24Q: Final = 0x1864CFB


def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        remainder = byte << 16
        for _ in range(8):
            remainder <<= 1
            if remainder & 0x1000000:
                remainder ^= CRC24Q
        table.append(remainder)
    return tuple(table)


_CRC_TABLE: Final = _crc_table()


def crc24q(message: int, length: int) -> int:
    """Return the CRC-24Q of a message of ``length`` bits (Galileo OS SIS ICD 2.1, 5.1.9.4)."""
    remainder = 0
    for byte in message.to_bytes((length + 7) // 8, "big"):  # zeros in front leave the remainder at zero
        remainder = (remainder << 8 & 0xFFFFFF) ^ _CRC_TABLE[remainder >> 16 ^ byte]
    return remainder
