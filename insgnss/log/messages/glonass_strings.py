"""GLONASS strings (ICD L1, L2, edition 5.1, section 4) -> states of the satellites.

A string comes as 85 bits: bit 85 of the ICD first, bit 1 last; relative code and time mark are undone.
"""

from __future__ import annotations

import datetime as dt
import math
from typing import Final

from insgnss.constants import M_PER_KM, NS_PER_S, S_PER_DAY
from insgnss.gnss.signals import UNKNOWN_CHANNEL
from insgnss.gpstime import MOSCOW_MINUS_UTC_S, leap_seconds, ns_to_datetime
from insgnss.log.messages.bits import sign_and_magnitude
from insgnss.log.messages.broadcast import Broadcast, StateVector

LENGTH: Final = 85
_CHECK_BITS: Final = 8
# Strings 1 to 4 are sent within 8 s; the receiver's epochs around them are known to a few seconds
_FRAME_NS: Final = 15 * NS_PER_S


def _check_masks() -> tuple[int, ...]:
    """Return the bits that each of the seven checksums adds up (ICD 5.1, 4.7).

    Data bit 9 + k has the k-th number that is not a power of two, 3, 5, 6, 7, 9, ...; checksum j covers the data bits
    whose number has bit j, and check bit j + 1.
    """
    numbers = [n for n in range(3, 128) if n & (n - 1)][: LENGTH - _CHECK_BITS]
    masks = []
    for j in range(_CHECK_BITS - 1):
        covered = sum(1 << (_CHECK_BITS + k) for k, n in enumerate(numbers) if n >> j & 1)
        masks.append(covered | 1 << j)
    return tuple(masks)


_MASKS: Final = _check_masks()


def parity_holds(string: int) -> bool:
    """Return whether all checksums of a string are zero, so that no bit error is detected."""
    return string.bit_count() % 2 == 0 and not any((string & mask).bit_count() & 1 for mask in _MASKS)


def bits_of(string: int, high: int, low: int) -> int:
    """Return bits ``high`` to ``low`` in the numbering of the ICD, bit 1 sent last."""
    return string >> (low - 1) & ((1 << (high - low + 1)) - 1)


def _number(string: int, high: int, low: int, power: int) -> float:
    return math.ldexp(sign_and_magnitude(bits_of(string, high, low), high - low + 1), power)


class GlonassMessages:
    """Collects strings 1 to 4 per satellite; four of one frame make a state."""

    def __init__(self, broadcast: Broadcast) -> None:
        self._broadcast = broadcast
        self._frames: dict[str, tuple[int, int, list[int]]] = {}  # frame, receiver time, strings so far

    def add(self, sv: str, string: int, frame: int, near_ns: int | None, channel: int | None) -> None:
        """Take one string of 85 bits.

        Parameters
        ----------
        sv : "R07"
        string : the bits
        frame : any number that is the same for the strings of one frame
        near_ns : GPS time of about the reception; without it the day is not known and nothing is taken
        channel : frequency channel, -7..6
        """
        number = bits_of(string, 84, 81)
        if not parity_holds(string):
            self._broadcast.refused["GLONASS string with a wrong checksum"] += 1
            return
        if near_ns is None:
            self._broadcast.refused["GLONASS string without a receiver time for its day"] += 1
            return
        if number == 1:
            self._frames[sv] = (frame, near_ns, [string])
            return
        if number > 4 or sv not in self._frames:
            return
        known, begun_ns, strings = self._frames[sv]
        if known != frame or len(strings) != number - 1 or not 0 <= near_ns - begun_ns <= _FRAME_NS:
            return
        strings.append(string)
        if number == 4:
            self._complete(sv, strings, near_ns, channel)

    def _complete(self, sv: str, strings: list[int], near_ns: int, channel: int | None) -> None:
        _, second, third, fourth = strings
        if bits_of(fourth, 15, 11) not in (0, int(sv[1:])):
            self._broadcast.refused["GLONASS string of another satellite"] += 1
            return
        in_day_s = bits_of(second, 76, 70) * 900
        if not 0 < in_day_s < S_PER_DAY:
            self._broadcast.refused["GLONASS frame without a reference time"] += 1
            return
        delay = _number(fourth, 58, 54, -30)
        unhealthy = bits_of(second, 80, 80) | bits_of(third, 65, 65) << 1
        state = StateVector(
            sv,
            nearest_in_day(in_day_s, near_ns),
            tuple(_number(s, 35, 9, -11) * M_PER_KM for s in strings[:3]),
            tuple(_number(s, 64, 41, -20) * M_PER_KM for s in strings[:3]),
            tuple(_number(s, 40, 36, -30) * M_PER_KM for s in strings[:3]),
            -_number(fourth, 80, 59, -30),
            _number(third, 79, 69, -40),
            math.nan if bits_of(fourth, 58, 54) == 0b10000 else delay,  # minus zero: not given
            float(unhealthy),
            UNKNOWN_CHANNEL if channel is None else channel,
        )
        self._broadcast.states.setdefault(state)


def nearest_in_day(in_day_s: float, near_ns: int) -> int:
    """Return the GPS time of these seconds of the Moscow day that is nearest to ``near_ns`` [ns]."""
    when = ns_to_datetime(near_ns)
    leap = leap_seconds(dt.datetime(when.year, when.month, when.day))
    to_moscow = (MOSCOW_MINUS_UTC_S - leap) * NS_PER_S
    day, near = S_PER_DAY * NS_PER_S, near_ns + to_moscow
    return near + (round(in_day_s * NS_PER_S) - near + day // 2) % day - day // 2 - to_moscow
