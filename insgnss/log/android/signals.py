"""Satellites and signals as Android's GnssMeasurement numbers them become RINEX names and codes.

Android developer reference, ``android.location.GnssStatus`` (constellations, ranges of svid) and ``GnssMeasurement``
(carrier frequency, code type: the last letter of the RINEX 3 code).
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from insgnss.gnss.signals import G1_HZ, G2_HZ, signal_of
from insgnss.log.satellites import CHANNEL_NAME_ZERO, CHANNELS_IN_USE, SBAS_OFFSET, rinex_name

SYSTEMS: Final = {1: "G", 2: "S", 3: "R", 4: "J", 5: "C", 6: "E", 7: "I"}
_QZSS_OFFSET: Final = 192
_CHANNEL_OFFSET: Final = 100  # of a GLONASS satellite that is known by its channel alone
_LARGEST_ERROR_HZ: Final = 2e6  # phones log the carrier as a float of single precision, wrong by up to 64 Hz


class Band(NamedTuple):
    """A carrier of a system: the RINEX band and the code letter taken when the log does not say which code."""

    carrier_hz: float
    step_hz: float  # from one GLONASS channel to the next
    band: str
    letter: str


def _band(system: str, code: str) -> Band:
    signal = signal_of(system, f"C{code}")
    assert signal is not None
    return Band(signal.carrier_hz, signal.channel_step_hz, *code)


_CODES: Final = {
    **{"G": ("1C", "2L", "5Q"), "S": ("1C", "5I"), "R": ("1C", "2C"), "J": ("1C", "2L", "5Q", "6L")},
    **{"C": ("2I", "1P", "5P", "7I", "6I", "8P"), "E": ("1C", "5Q", "7Q", "8Q", "6C"), "I": ("5A", "9A")},
}
BANDS: Final = {system: tuple(_band(system, code) for code in codes) for system, codes in _CODES.items()}
_OFF_CHANNEL: Final = 0.25  # of a step; single precision is off by 0.0001


class AndroidSignal(NamedTuple):
    """What a row measures: RINEX code, carrier [Hz], GLONASS channel (None for other systems or not known)."""

    code: str
    carrier_hz: float
    channel: int | None = None


def satellite(constellation: int, svid: int) -> str | None:
    """Return the satellite's RINEX name, None when there is none.

    A GLONASS satellite that is known by its channel alone (93 to 106) has one of the names R43 to R56.
    """
    system = SYSTEMS.get(constellation)
    if system is None:
        return None
    if system == "R" and svid - _CHANNEL_OFFSET in CHANNELS_IN_USE:
        return f"R{CHANNEL_NAME_ZERO + svid - _CHANNEL_OFFSET}"
    number = svid - (_QZSS_OFFSET if system == "J" else SBAS_OFFSET if system == "S" else 0)
    return rinex_name(system, number) or None


def signal(system: str, carrier_hz: float, code_type: str) -> AndroidSignal | None:
    """Return the signal of a carrier and code type, None when no band of the system is near.

    Without a carrier frequency (before Android 8) it is the system's first band. Without a code type, or with one that
    no open signal of the band has, it is the usual code: phones state Q for BeiDou's B2a, whose pilot RINEX calls P,
    and A, a regulated service, for Galileo's E1.
    """
    bands = BANDS[system]
    if np.isnan(carrier_hz):
        band, channel = (bands[0], None)
    elif system == "R":
        band = bands[0] if carrier_hz > (G1_HZ + G2_HZ) / 2 else bands[1]
        steps = (carrier_hz - band.carrier_hz) / band.step_hz
        # some phones state all carriers half a step low
        channel = round(steps) if abs(steps - round(steps)) < _OFF_CHANNEL else math.floor(steps) + 1
        if channel not in CHANNELS_IN_USE:
            return None
    else:
        band, channel = min(bands, key=lambda b: abs(b.carrier_hz - carrier_hz)), None
        if abs(band.carrier_hz - carrier_hz) > _LARGEST_ERROR_HZ:
            return None
    letter = code_type.strip().upper()
    if signal_of(system, f"C{band.band}{letter}") is None:
        letter = band.letter
    carrier = band.carrier_hz + band.step_hz * (channel or 0)
    return AndroidSignal(f"C{band.band}{letter}", carrier, channel)


def on_channel(nominal: AndroidSignal, channel: int) -> AndroidSignal:
    """Return a GLONASS signal whose channel is known from elsewhere."""
    band = next(band for band in BANDS["R"] if band.band == nominal.code[1])
    return AndroidSignal(nominal.code, band.carrier_hz + band.step_hz * channel, channel)
