"""Ranging codes: shift registers, the civil codes of GLONASS and GPS, their sampling and correlation.

A bit 1 of the interface documents is a chip of -1, a bit 0 one of +1.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.errors import ConfigError
from insgnss.tables import Float64, Int8
from insgnss.tracking.admissible import require_known, require_within

GLONASS_ST_CHIP_HZ: Final = 511_000.0  # GLONASS ICD 5.1, 3.3.2.1
GPS_CA_CHIP_HZ: Final = 1_023_000.0  # IS-GPS-200N, 3.3.2.3
# the meander turns each data bit's sign after 10 ms; GLONASS ICD 5.1, 3.3.2.2
GLONASS_ST_SIGN_S: Final = 0.010
GPS_BIT_S: Final = 0.020  # 50 bit/s; IS-GPS-200N, 3.2.2
SBAS_SYMBOL_S: Final = 0.002  # 500 symbols/s on PRN 120 to 158; RTCA DO-229, A.4.2
GPS_PRNS: Final = range(1, 211)

# Delay of G2 in chips for PRN 1, 2, ... 210; IS-GPS-200N, tables 3-Ia, 3-Ib and 6-I
_G2_DELAYS: Final = tuple(
    int(delay)
    for delay in (
        "5 6 7 8 17 18 139 140 141 251 252 254 255 256 257 258 469 470 471 472 473 474 509 512 513 514 515 "
        "516 859 860 861 862 863 950 947 948 950 67 103 91 19 679 225 625 946 638 161 1001 554 280 710 709 "
        "775 864 558 220 397 55 898 759 367 299 1018 729 695 780 801 788 732 34 320 327 389 407 525 405 221 "
        "761 260 326 955 653 699 422 188 438 959 539 879 677 586 153 792 814 446 264 1015 278 536 819 156 957 "
        "159 712 885 461 248 713 126 807 279 122 197 693 632 771 467 647 203 145 175 52 21 237 235 886 657 "
        "634 762 355 1012 176 603 130 359 595 68 386 797 456 499 883 307 127 211 121 118 163 628 853 484 289 "
        "811 202 1021 463 568 904 670 230 911 684 309 644 932 12 314 891 212 185 675 503 150 395 345 846 798 "
        "992 357 995 877 112 144 476 193 109 445 291 87 399 292 901 339 208 711 189 263 537 663 942 173 900 "
        "30 500 935 556 373 85 652 310 "
    ).split()
)


@dataclass(frozen=True)
class RangingCode:
    """One period of a code, and the time between possible sign changes by the data."""

    name: str
    chips: Int8  # (length,) +1 or -1
    rate_hz: float  # chips per second
    sign_s: float  # shortest time between two changes of sign by the data

    @property
    def length(self) -> int:
        """Return the number of chips in a period."""
        return len(self.chips)

    @property
    def period_s(self) -> float:
        """Return the duration of a period."""
        return self.length / self.rate_hz


def lfsr(taps: tuple[int, ...], start: str, length: int, stage: int) -> Int8:
    """Return the bits of a shift register whose feedback, the sum modulo 2 of the tapped stages, enters stage 1.

    Parameters
    ----------
    taps : stages that are fed back, counted from 1; x^9 + x^5 + 1 has (5, 9)
    start : the register's first state as bits, stage 1 first
    length : number of bits
    stage : the stage that is read

    Raises
    ------
    ConfigError : a stage does not exist, or the state is none that ever changes
    """
    size = len(start)
    if not re.fullmatch("[01]+", start) or "1" not in start:
        advice = "give one 0 or 1 for each stage, not all of them 0: that state repeats for ever"
        raise ConfigError(f"invalid start '{start}' of a shift register", key="start", advice=advice)
    if not taps or not all(1 <= s <= size for s in (*taps, stage)):
        advice = f"stages are counted from 1 to {size}"
        raise ConfigError(f"taps {taps} and output {stage} are not all stages", key="taps", advice=advice)
    register = [int(bit) for bit in start]
    bits = np.empty(length, np.int8)
    for k in range(length):
        bits[k] = register[stage - 1]
        fed = sum(register[tap - 1] for tap in taps) % 2
        register = [fed, *register[:-1]]
    return bits


def glonass_st() -> RangingCode:
    """Return the standard-accuracy code of GLONASS, the same for all satellites.

    Equation: x^9 + x^5 + 1, all ones at the start, read at stage 7                    [GLONASS ICD 5.1, 3.3.2.1]
    The ICD also names a "first group" 111111100: these are chips that leave the register. Taken for the register's
    state, as in a published program, they give this same sequence two chips late (586 m), which a correlator that
    shares the slip never shows; ranges between receivers do.
    """
    bits = lfsr((5, 9), "111111111", 511, 7)
    return RangingCode("glonass-st", _chips(bits), GLONASS_ST_CHIP_HZ, GLONASS_ST_SIGN_S)


def gps_ca(prn: int) -> RangingCode:
    """Return the C/A code of a PRN: GPS 1 to 63, SBAS 120 to 158, QZSS 193 to 202, the rest reserved.

    Equation: C/A(t) = G1(t) + G2(t - delay), G1 = 1 + x^3 + x^10, G2 = 1 + x^2 + x^3 + x^6 + x^8 + x^9 + x^10
                                                                                        [IS-GPS-200N, 3.3.2.3]

    Raises
    ------
    ConfigError : the number has no code
    """
    require_within(GPS_PRNS[0], GPS_PRNS[-1], "the C/A codes are numbered 1 to 210", prn=prn)
    g1 = lfsr((3, 10), "1" * 10, 1023, 10)
    g2 = lfsr((2, 3, 6, 8, 9, 10), "1" * 10, 1023, 10)
    bits = g1 ^ np.roll(g2, _G2_DELAYS[prn - 1])
    sign_s = SBAS_SYMBOL_S if 120 <= prn <= 158 else GPS_BIT_S
    return RangingCode(f"gps-ca-{prn}", _chips(bits), GPS_CA_CHIP_HZ, sign_s)


def code_names() -> list[str]:
    """Return the name of every code that ``code_of`` knows."""
    return ["glonass-st", *(f"gps-ca-{prn}" for prn in GPS_PRNS)]


def code_of(name: str) -> RangingCode:
    """Return a code by its name: ``glonass-st``, ``gps-ca-7``.

    Raises
    ------
    ConfigError : no such code, with the nearest name
    """
    known = require_known(name, code_names(), "signal", "ranging code")
    return glonass_st() if known == "glonass-st" else gps_ca(int(known.rsplit("-", 1)[1]))


def _chips(bits: Int8) -> Int8:
    return np.asarray(1 - 2 * bits, np.int8)


def autocorrelation(code: RangingCode) -> Float64:
    """Return the circular autocorrelation at whole chips, 1 at lag 0; exact to rounding.

    Equation: rho(m) = 1/L sum_k c(k) c(k + m)
    """
    spectrum = np.fft.rfft(code.chips.astype(np.float64))
    raw = np.fft.irfft(np.abs(spectrum) ** 2, code.length)
    return np.asarray(np.rint(raw) / code.length)


def triangle(offset_chips: npt.ArrayLike) -> Float64:
    """Return the correlation of an endless random code: 1 - |x| within a chip, 0 beyond.

    Neglects: the side values, -1/511 of GLONASS ST, up to 65/1023 of GPS C/A.
    """
    return np.asarray(np.maximum(0.0, 1.0 - np.abs(np.asarray(offset_chips, float))))


def correlation(code: RangingCode, offset_chips: npt.ArrayLike) -> Float64:
    """Return a code's correlation at any offset: straight lines between whole chips, exact for rectangular ones."""
    values = autocorrelation(code)
    x = np.asarray(offset_chips, float)
    whole = np.floor(x).astype(np.int64)
    share = x - whole
    return np.asarray((1.0 - share) * values[whole % code.length] + share * values[(whole + 1) % code.length])
