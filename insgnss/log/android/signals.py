"""Satellites and signals as Android's GnssMeasurement numbers them become RINEX names and codes.

Android developer reference, ``android.location.GnssStatus`` (constellations, ranges of svid) and ``GnssMeasurement``
(carrier frequency, code type: the last letter of the RINEX 3 code).
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from insgnss.gnss.signals import (
    B1I_HZ,
    B3I_HZ,
    E5_HZ,
    E5B_HZ,
    E6_HZ,
    G1_HZ,
    G1_STEP_HZ,
    G2_HZ,
    G2_STEP_HZ,
    L1_HZ,
    L2_HZ,
    L5_HZ,
    S_HZ,
    signal_of,
)
from insgnss.log.satellites import CHANNEL_NAME_ZERO, CHANNELS_IN_USE, SBAS_OFFSET, rinex_name

SYSTEMS: Final = {1: "G", 2: "S", 3: "R", 4: "J", 5: "C", 6: "E", 7: "I"}
_QZSS_OFFSET: Final = 192
_CHANNEL_OFFSET: Final = 100  # of a GLONASS satellite that is known by its channel alone
_LARGEST_ERROR_HZ: Final = 2e6  # phones log the carrier as a float of single precision, wrong by up to 64 Hz


class Band(NamedTuple):
    """A carrier of a system: the RINEX band and the code letter taken when the log does not say which code."""

    carrier_hz: float
    band: str
    letter: str


BANDS: Final = {
    "G": (Band(L1_HZ, "1", "C"), Band(L2_HZ, "2", "L"), Band(L5_HZ, "5", "Q")),
    "S": (Band(L1_HZ, "1", "C"), Band(L5_HZ, "5", "I")),
    "R": (Band(G1_HZ, "1", "C"), Band(G2_HZ, "2", "C")),
    "J": (Band(L1_HZ, "1", "C"), Band(L2_HZ, "2", "L"), Band(L5_HZ, "5", "Q"), Band(E6_HZ, "6", "L")),
    "C": (
        Band(B1I_HZ, "2", "I"),
        Band(L1_HZ, "1", "P"),
        Band(L5_HZ, "5", "P"),
        Band(E5B_HZ, "7", "I"),
        Band(B3I_HZ, "6", "I"),
        Band(E5_HZ, "8", "P"),
    ),
    "E": (
        Band(L1_HZ, "1", "C"),
        Band(L5_HZ, "5", "Q"),
        Band(E5B_HZ, "7", "Q"),
        Band(E5_HZ, "8", "Q"),
        Band(E6_HZ, "6", "C"),
    ),
    "I": (Band(L5_HZ, "5", "A"), Band(S_HZ, "9", "A")),
}
_OFF_CHANNEL: Final = 0.25  # of a step; single precision is off by 0.0001
_STEPS_HZ: Final = {"1": G1_STEP_HZ, "2": G2_STEP_HZ}


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
        channel = _channel((carrier_hz - band.carrier_hz) / _STEPS_HZ[band.band])
        if channel not in CHANNELS_IN_USE:
            return None
    else:
        band, channel = min(bands, key=lambda b: abs(b.carrier_hz - carrier_hz)), None
        if abs(band.carrier_hz - carrier_hz) > _LARGEST_ERROR_HZ:
            return None
    letter = code_type.strip().upper()
    if signal_of(system, f"C{band.band}{letter}") is None:
        letter = band.letter
    carrier = band.carrier_hz + (_STEPS_HZ[band.band] * channel if channel is not None else 0.0)
    return AndroidSignal(f"C{band.band}{letter}", carrier, channel)


def _channel(steps: float) -> int:
    """Return the GLONASS channel; some phones state all carriers half a step low."""
    nearest = round(steps)
    return nearest if abs(steps - nearest) < _OFF_CHANNEL else math.floor(steps) + 1


def on_channel(nominal: AndroidSignal, channel: int) -> AndroidSignal:
    """Return a GLONASS signal whose channel is known from elsewhere."""
    band = nominal.code[1]
    carrier_hz = {"1": G1_HZ, "2": G2_HZ}[band] + _STEPS_HZ[band] * channel
    return AndroidSignal(nominal.code, carrier_hz, channel)
