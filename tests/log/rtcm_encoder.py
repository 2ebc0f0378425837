"""Writes RTCM 3 messages from physical numbers, bit by bit as RTCM 10403.3 lists the fields: the source of the tests.

Independent of the reader: bits as text, a checksum computed bit by bit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

C_M_PER_MS = 299_792.458
SYSTEMS = "GRESJCI"  # of the messages 1071 to 1137


def crc24q(data: bytes) -> int:
    """CRC-24Q, polynomial 0x1864CFB, start 0, bit by bit."""
    value = 0
    for byte in data:
        value ^= byte << 16
        for _ in range(8):
            value <<= 1
            if value & 0x1000000:
                value ^= 0x1864CFB
    return value


def frame(bits: str) -> bytes:
    """Return a message's bits as a frame."""
    bits += "0" * (-len(bits) % 8)
    body = bytes(int(bits[k : k + 8], 2) for k in range(0, len(bits), 8))
    head = b"\xd3" + len(body).to_bytes(2, "big") + body
    return head + crc24q(head).to_bytes(3, "big")


def resealed(data: bytes) -> bytes:
    """Return the bytes with the checksums of all frames made right again: damage that no checksum tells."""
    out, at = bytearray(data), 0
    while at + 6 <= len(out):
        end = at + 3 + (int.from_bytes(out[at + 1 : at + 3], "big") & 1023)
        if out[at] == 0xD3 and end + 3 <= len(out):
            out[end : end + 3] = crc24q(bytes(out[at:end])).to_bytes(3, "big")
            at = end + 3
        else:
            at += 1
    return bytes(out)


def u(value: float, bits: int, scale: float = 1.0) -> str:
    raw = round(value / scale)
    assert 0 <= raw < 1 << bits, (value, bits)
    return format(raw, f"0{bits}b")


def s(value: float, bits: int, scale: float = 1.0) -> str:
    raw = round(value / scale)
    assert -(1 << bits - 1) <= raw < 1 << bits - 1, (value, bits)
    return format(raw % (1 << bits), f"0{bits}b")


def sm(value: float, bits: int, scale: float = 1.0) -> str:
    """Sign and magnitude, as GLONASS has it."""
    raw = round(abs(value) / scale)
    return ("1" if value < 0 else "0") + format(raw, f"0{bits - 1}b")


@dataclass(frozen=True)
class Cell:
    """What was measured of one signal."""

    sat: int
    signal: int
    range_m: float | None
    phase_m: float | None = None
    rate_mps: float | None = None
    cn0: float = 45.0
    lock: int = 400  # indicator
    half: bool = False


def msm(
    system: str,
    kind: int,
    time: int,
    cells: list[Cell],
    channels: dict[int, int] | None = None,
    station: int = 7,
    more: bool = False,
) -> bytes:
    """Return an MSM3 to MSM7 message; ``time`` is the epoch's field as sent."""
    number = 1070 + 10 * SYSTEMS.index(system) + kind
    sats, signals = sorted({c.sat for c in cells}), sorted({c.signal for c in cells})
    of = {(c.sat, c.signal): c for c in cells}
    bits = u(number, 12) + u(station, 12) + u(time, 30) + str(int(more)) + "0" * 18
    bits += "".join("1" if k in sats else "0" for k in range(1, 65))
    bits += "".join("1" if k in signals else "0" for k in range(1, 33))
    bits += "".join("1" if (a, b) in of else "0" for a in sats for b in signals)
    first = {a: next(c for c in cells if c.sat == a and c.range_m is not None) for a in sats}
    rough = {a: round((first[a].range_m or 0.0) / C_M_PER_MS * 1024) for a in sats}
    bits += "".join(u(rough[a] // 1024, 8) for a in sats) if kind > 3 else ""
    if kind in (5, 7):
        bits += "".join(u((channels or {}).get(a, 8) + 7, 4) for a in sats)
    bits += "".join(u(rough[a] % 1024, 10) for a in sats)
    rates = {a: round(first[a].rate_mps or 0.0) for a in sats}
    if kind in (5, 7):
        bits += "".join(s(rates[a], 14) for a in sats)
    order = [of[a, b] for a in sats for b in signals if (a, b) in of]
    code, phase = ((15, -24), (22, -29)) if kind < 6 else ((20, -29), (24, -31))
    bits += "".join(_fine(c.range_m, rough[c.sat], *code) for c in order)
    bits += "".join(_fine(c.phase_m, rough[c.sat], *phase) for c in order)
    bits += "".join(u(c.lock, 4 if kind < 6 else 10) for c in order)
    bits += "".join(str(int(c.half)) for c in order)
    if kind > 3:
        bits += "".join(u(c.cn0, 6) if kind < 6 else u(c.cn0, 10, 0.0625) for c in order)
    if kind in (5, 7):
        bits += "".join(
            s(-16384, 15) if c.rate_mps is None else s(c.rate_mps - rates[c.sat], 15, 1e-4) for c in order
        )
    return frame(bits)


def _fine(metres: float | None, rough: int, bits: int, power: int) -> str:
    if metres is None:
        return s(-(1 << bits - 1), bits)
    return s(metres / C_M_PER_MS - rough / 1024, bits, 2.0**power)


@dataclass(frozen=True)
class Orbit:
    """Keplerian elements in the units in which they are sent: semicircles, metres, seconds."""

    toe_s: float = 381_600.0
    af0: float = 1.2e-4
    af1: float = -3.0e-12
    sqrt_a: float = 5153.65
    e: float = 0.0123
    i0: float = 0.305
    omega0: float = -0.71
    omega: float = 0.25
    m0: float = 0.44
    delta_n: float = 1.4e-9
    omega_dot: float = -2.5e-9
    idot: float = 1.1e-10
    harmonic: float = 2.0e-6
    radial: float = 180.0
    group_delay_s: float = -5.0e-9


def gps_ephemeris(sat: int, week: int, o: Orbit, iode: int = 61, health: int = 0) -> bytes:
    """Return message 1019 (table 3.5-21)."""
    return frame(
        u(1019, 12) + u(sat, 6) + u(week % 1024, 10) + u(1, 4) + "01" + s(o.idot, 14, 2.0**-43) + u(iode, 8)
        + u(o.toe_s, 16, 16) + s(0, 8) + s(o.af1, 16, 2.0**-43) + s(o.af0, 22, 2.0**-31) + u(iode, 10)
        + s(o.radial, 16, 2.0**-5) + s(o.delta_n, 16, 2.0**-43) + s(o.m0, 32, 2.0**-31)
        + s(o.harmonic, 16, 2.0**-29) + u(o.e, 32, 2.0**-33) + s(o.harmonic, 16, 2.0**-29)
        + u(o.sqrt_a, 32, 2.0**-19) + u(o.toe_s, 16, 16) + s(o.harmonic, 16, 2.0**-29)
        + s(o.omega0, 32, 2.0**-31) + s(o.harmonic, 16, 2.0**-29) + s(o.i0, 32, 2.0**-31)
        + s(o.radial, 16, 2.0**-5) + s(o.omega, 32, 2.0**-31) + s(o.omega_dot, 24, 2.0**-43)
        + s(o.group_delay_s, 8, 2.0**-31) + u(health, 6) + "0" + "0"
    )  # fmt: skip


def galileo_ephemeris(sat: int, gst_week: int, o: Orbit, iod: int = 77) -> bytes:
    """Return message 1046 (I/NAV)."""
    return frame(
        u(1046, 12) + u(sat, 6) + u(gst_week, 12) + u(iod, 10) + u(107, 8) + s(o.idot, 14, 2.0**-43)
        + u(o.toe_s, 14, 60) + s(0, 6) + s(o.af1, 21, 2.0**-46) + s(o.af0, 31, 2.0**-34)
        + s(o.radial, 16, 2.0**-5) + s(o.delta_n, 16, 2.0**-43) + s(o.m0, 32, 2.0**-31)
        + s(o.harmonic, 16, 2.0**-29) + u(o.e, 32, 2.0**-33) + s(o.harmonic, 16, 2.0**-29)
        + u(o.sqrt_a, 32, 2.0**-19) + u(o.toe_s, 14, 60) + s(o.harmonic, 16, 2.0**-29)
        + s(o.omega0, 32, 2.0**-31) + s(o.harmonic, 16, 2.0**-29) + s(o.i0, 32, 2.0**-31)
        + s(o.radial, 16, 2.0**-5) + s(o.omega, 32, 2.0**-31) + s(o.omega_dot, 24, 2.0**-43)
        + s(o.group_delay_s, 10, 2.0**-32) + s(2 * o.group_delay_s, 10, 2.0**-32)
        + "01" + "0" + "10" + "1" + "00"
    )  # fmt: skip


def beidou_ephemeris(sat: int, bdt_week: int, o: Orbit) -> bytes:
    """Return message 1042."""
    return frame(
        u(1042, 12) + u(sat, 6) + u(bdt_week, 13) + u(2, 4) + s(o.idot, 14, 2.0**-43) + u(5, 5)
        + u(o.toe_s, 17, 8) + s(0, 11) + s(o.af1, 22, 2.0**-50) + s(o.af0, 24, 2.0**-33) + u(4, 5)
        + s(o.radial, 18, 2.0**-6) + s(o.delta_n, 16, 2.0**-43) + s(o.m0, 32, 2.0**-31)
        + s(o.harmonic, 18, 2.0**-31) + u(o.e, 32, 2.0**-33) + s(o.harmonic, 18, 2.0**-31)
        + u(o.sqrt_a, 32, 2.0**-19) + u(o.toe_s, 17, 8) + s(o.harmonic, 18, 2.0**-31)
        + s(o.omega0, 32, 2.0**-31) + s(o.harmonic, 18, 2.0**-31) + s(o.i0, 32, 2.0**-31)
        + s(o.radial, 18, 2.0**-6) + s(o.omega, 32, 2.0**-31) + s(o.omega_dot, 24, 2.0**-43)
        + s(o.group_delay_s, 10, 1e-10) + s(2 * o.group_delay_s, 10, 1e-10) + "1"
    )  # fmt: skip


def glonass_ephemeris(sat: int, channel: int, t_b: int, day: int = 0, four_years: int = 0) -> bytes:
    """Return message 1020 of a satellite at 1e7, -2e7, 5e6 m, (1000, 2000, -3000) m/s."""
    axes = "".join(
        sm(v / 1e3, 24, 2.0**-20) + sm(r / 1e3, 27, 2.0**-11) + sm(a / 1e3, 5, 2.0**-30)
        for r, v, a in ((1e7, 1e3, 2.0**-30 * 1e3), (-2e7, 2e3, 0.0), (5e6, -3e3, -(2.0**-29) * 1e3))
    )
    return frame(
        u(1020, 12) + u(sat, 6) + u(channel + 7, 5) + "1" + "1" + "00" + "0" * 12 + "1" + "0" + u(t_b, 7)
        + axes + "0" + sm(-(2.0**-38), 11, 2.0**-40) + "00" + "1" + sm(-3e-5, 22, 2.0**-30)
        + sm(2.0**-29, 5, 2.0**-30) + u(0, 5) + "0" + u(2, 4) + u(day, 11) + "01" + "1" + u(0, 11)
        + s(0, 32) + u(four_years, 5) + s(0, 22) + "0" + "0" * 7
    )  # fmt: skip


def gps_1004(
    time_ms: int, sat: int, range_1_m: float, cycles_1: float, range_2_m: float, lock: int = 127
) -> bytes:
    """Return message 1004 of one satellite, L1 C/A and L2 P(Y) without codes; L2's phase is its range."""
    modulus, lambda_1 = int(range_1_m // C_M_PER_MS), C_M_PER_MS * 1e3 / 1575.42e6
    rest = round((range_1_m - modulus * C_M_PER_MS) / 0.02)
    sent = rest * 0.02 + modulus * C_M_PER_MS
    wrapped = math.remainder(cycles_1 - sent / lambda_1, 1500.0) * lambda_1
    return frame(
        u(1004, 12) + u(7, 12) + u(time_ms, 30) + "0" + u(1, 5) + "0" + "000"
        + u(sat, 6) + "0" + u(rest, 24) + s(wrapped, 20, 0.0005) + u(lock, 7) + u(modulus, 8) + u(44.0, 8, 0.25)
        + "11" + s(range_2_m - sent, 14, 0.02) + s(range_2_m - sent, 20, 0.0005) + u(lock, 7) + u(30.0, 8, 0.25)
    )  # fmt: skip


def station(number: int, x: float, y: float, z: float) -> bytes:
    """Return message 1005."""
    return frame(
        u(1005, 12) + u(number, 12) + "0" * 6 + "1" + "0" * 3 + s(x, 38, 1e-4) + "00" + s(y, 38, 1e-4)
        + "00" + s(z, 38, 1e-4)
    )  # fmt: skip
