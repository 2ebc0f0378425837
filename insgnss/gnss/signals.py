"""The signals: RINEX codes, carrier, and the group delay that a single-frequency user must subtract.

A broadcast clock holds for one combination of signals (GPS: the ionosphere-free L1/L2 P(Y); Galileo I/NAV:
E1/E5b, F/NAV: E1/E5a; BeiDou: B3I alone). For another signal the delay ``k . d`` is subtracted, d the two
delays of the message (``EphemerisTable.group_delay_s``), k the factors kept here. Where a message lacks the
delay of a signal, the nearest one is used and ``neglects`` says what is left out. GPS and QZSS send the differences of
their signals in CNAV: where the navigation data have them, ``inter_signal_index`` says which is added.
GLONASS satellites share two bands, each on a channel of its own: the carrier and everything derived from it need the
channel.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any, Final

from insgnss.constants import C_MPS

L1_HZ: Final = 1_575.42e6  # GPS L1, Galileo E1, BeiDou B1C, QZSS L1, SBAS L1; IS-GPS-200N 3.3.1.1
L2_HZ: Final = 1_227.60e6  # GPS and QZSS L2; IS-GPS-200N 3.3.1.1
L5_HZ: Final = 1_176.45e6  # GPS L5, Galileo E5a, BeiDou B2a, QZSS L5, NavIC L5; IS-GPS-705J 3.3.1.1
E5B_HZ: Final = 1_207.14e6  # Galileo E5b, BeiDou B2I and B2b; Galileo OS SIS ICD 2.1, table 2
E5_HZ: Final = 1_191.795e6  # Galileo E5 AltBOC, BeiDou B2a+b; Galileo OS SIS ICD 2.1, table 2
E6_HZ: Final = 1_278.75e6  # Galileo E6, QZSS L6; Galileo OS SIS ICD 2.1, table 2
B1I_HZ: Final = 1_561.098e6  # BDS-SIS-ICD B1I 3.0, 4.2.1
B3I_HZ: Final = 1_268.52e6  # BDS-SIS-ICD B3I 1.0, 4.2.1
S_HZ: Final = 2_492.028e6  # NavIC S; NavIC SPS ICD 1.1, table 3
G1_HZ: Final = 1_602.0e6  # GLONASS channel 0 and the spacing of channels; GLONASS ICD 5.1, 3.3.1.1
G1_STEP_HZ: Final = 0.5625e6
G2_HZ: Final = 1_246.0e6
G2_STEP_HZ: Final = 0.4375e6
CHANNELS: Final = range(-7, 14)  # in use since 2005: -7 to 6; 7 to 13 before; GLONASS ICD 5.1, table 3.1
CHANNEL_OFFSET: Final = 7  # added by receivers that send a channel without its sign
UNKNOWN_CHANNEL: Final = -128

_GAMMA_L2: Final = (L1_HZ / L2_HZ) ** 2
_GAMMA_E5A: Final = (L1_HZ / L5_HZ) ** 2
_GAMMA_E5B: Final = (L1_HZ / E5B_HZ) ** 2
_GAMMA_NAVIC_L5: Final = (S_HZ / L5_HZ) ** 2

# Sources in words, each named once
_IS200 = "IS-GPS-200N, 20.3.3.3.3.2: (dt)L1 = dt - TGD, (dt)L2 = dt - gamma TGD"
_IS200_ISC = "IS-GPS-200N, 30.3.3.3.1.1: (dt) = dt - TGD + ISC"
_IS705 = "IS-GPS-705J, 20.3.3.3.1.2: (dt)L5 = dt - TGD + ISC"
_GAL = "Galileo OS SIS ICD 2.1, 5.1.5: dt(E1) = dt - BGD, dt(E5) = dt - (f1/f5)^2 BGD"
_BDS = "BDS-SIS-ICD B1I 3.0, 5.2.4.10: dt(B1I) = dt - TGD1, dt(B2I) = dt - TGD2, B3I as broadcast"
_BDS_CNAV = "BDS-SIS-ICD B1C 1.0, 7.6, and B2a 1.0, 7.6: delays against B3I, broadcast in CNAV only"
_QZS = "IS-QZSS-PNT-005, 5.8: as GPS, reference L1 C/A with TGD"
_NAVIC = "NavIC SPS ICD 1.1, 6.2.1.5: (dt)S = dt - TGD, (dt)L5 = dt - (fS/fL5)^2 TGD"
_GLO = "GLONASS ICD 5.1, 4.4: the clock holds for L1, dt(L2) = dt - dtau_n"
_SBAS = "RTCA DO-229, A.4.4.11: the message's clock holds for L1"

# Entry of ``NavigationData.inter_signal_s`` for each code: L1 C/A, L2C, L5I, L5Q, L1C data, L1C pilot. L1 P(Y) and
# L2 P(Y) have none: TGD is defined by them. A receiver that tracks data and pilot together (X) gets the pilot's.
INTER_SIGNAL: Final = {
    **{"C1C": 0, "C2L": 1, "C2X": 1, "C2S": 1, "C5I": 2, "C5Q": 3, "C5X": 3},
    **{"C1S": 4, "C1L": 5, "C1X": 5},
}

_NO_ISC = "the inter-signal correction, about 1 m, where no CNAV message gives it"
_NO_ISC_L5 = "the inter-signal correction, up to 3 m, where no CNAV message gives it"
_NO_G1 = (
    "the receiver's delays, different on each channel, up to 5 m, and the reference of the clock, about 1 m"
)


@dataclass(frozen=True)
class Signal:
    """One signal of one system: its RINEX codes, its carrier, and which group delay applies to it."""

    system: str  # RINEX letter
    name: str  # the ICD's name
    band: str  # "L1", "L2", "L5", "E5b", "E5", "E6", "B1", "B3", "S"
    codes: tuple[str, ...]  # RINEX 3 pseudorange codes, the preferred one first
    carrier_hz: float  # GLONASS: of channel 0
    group_delay: tuple[float, float]  # factors of the message's two group delays
    source: str  # section of the ICD in words
    group_delay_fnav: tuple[float, float] | None = None  # instead, when the clock is Galileo's F/NAV
    neglects: str = ""  # what the group delay neglects
    channel_step_hz: float = 0.0  # between GLONASS channels


@dataclass(frozen=True)
class UnsupportedSignal:
    """A signal that exists in RINEX and cannot be used, with the reason."""

    system: str
    codes: tuple[str, ...]
    reason: str


def _gps() -> tuple[Signal, ...]:
    return (
        Signal("G", "L1 C/A", "L1", ("C1C",), L1_HZ, (1, 0), _IS200, neglects=_NO_ISC),
        Signal("G", "L1 P(Y)", "L1", ("C1W", "C1P", "C1Y"), L1_HZ, (1, 0), _IS200),
        Signal("G", "L1C", "L1", ("C1L", "C1X", "C1S"), L1_HZ, (1, 0), _IS200_ISC, neglects=_NO_ISC),
        Signal("G", "L2C", "L2", ("C2L", "C2X", "C2S"), L2_HZ, (_GAMMA_L2, 0), _IS200, neglects=_NO_ISC),
        Signal("G", "L2 P(Y)", "L2", ("C2W", "C2P", "C2Y", "C2D"), L2_HZ, (_GAMMA_L2, 0), _IS200),
        Signal("G", "L2 C/A", "L2", ("C2C",), L2_HZ, (_GAMMA_L2, 0), _IS200, neglects=_NO_ISC),
        Signal("G", "L5", "L5", ("C5Q", "C5X", "C5I"), L5_HZ, (1, 0), _IS705, neglects=_NO_ISC_L5),
    )


def _galileo() -> tuple[Signal, ...]:
    # t(E5x) - t(clock pair) = BGD(pair) + (gamma_x - 1) BGD_x: follows from the definition of both delays
    a, b = _GAMMA_E5A - 1, _GAMMA_E5B - 1
    e5 = "its own delay: the mean of E5a and E5b is taken, about 0.5 m"
    e6 = "its own delay: that of E5b is taken, up to 3 m"
    return (
        Signal("E", "E1 OS", "L1", ("C1C", "C1X", "C1B"), L1_HZ, (0, 1), _GAL, (1, 0)),
        Signal("E", "E5a", "L5", ("C5Q", "C5X", "C5I"), L5_HZ, (a, 1), _GAL, (1 + a, 0)),
        Signal("E", "E5b", "E5b", ("C7Q", "C7X", "C7I"), E5B_HZ, (0, 1 + b), _GAL, (1, b)),
        Signal(
            "E", "E5", "E5", ("C8Q", "C8X", "C8I"), E5_HZ, (a / 2, 1 + b / 2), _GAL, (1 + a / 2, b / 2), e5
        ),
        Signal("E", "E6", "E6", ("C6C", "C6X", "C6B"), E6_HZ, (0, 1 + b), _GAL, (1, b), e6),
    )


def _beidou() -> tuple[Signal, ...]:
    b1i = ("C2I", "C2X", "C2Q", "C1I", "C1Q")  # C1I, C1Q: the names of RINEX 3.02
    b1c = ("C1P", "C1X", "C1D")
    no_b1c = "the difference of B1C and B1I (CNAV only), about 1 m: TGD1 is taken"
    no_b2a = "its own delay (CNAV only), up to 3 m"
    no_b2b = "its own delay (CNAV only), up to 3 m: TGD2 is taken"
    return (
        Signal("C", "B1I", "B1", b1i, B1I_HZ, (1, 0), _BDS),
        Signal("C", "B1C", "L1", b1c, L1_HZ, (1, 0), _BDS_CNAV, neglects=no_b1c),
        Signal("C", "B2a", "L5", ("C5P", "C5X", "C5D"), L5_HZ, (0, 0), _BDS_CNAV, neglects=no_b2a),
        Signal("C", "B2I", "E5b", ("C7I", "C7X", "C7Q"), E5B_HZ, (0, 1), _BDS),
        Signal("C", "B2b", "E5b", ("C7P", "C7Z", "C7D"), E5B_HZ, (0, 1), _BDS_CNAV, neglects=no_b2b),
        Signal("C", "B2a+b", "E5", ("C8P", "C8X", "C8D"), E5_HZ, (0, 0), _BDS_CNAV, neglects=no_b2a),
        Signal("C", "B3I", "B3", ("C6I", "C6X", "C6Q"), B3I_HZ, (0, 0), _BDS),
    )


def _regional() -> tuple[Signal, ...]:
    l6 = ("C6L", "C6X", "C6S", "C6E", "C6Z")
    l5_navic = ("C5A", "C5X", "C5B", "C5C")
    no_l5 = "the difference of L1 and L5, up to 3 m"
    return (
        Signal("J", "L1 C/A", "L1", ("C1C", "C1E"), L1_HZ, (1, 0), _QZS),
        Signal("J", "L1C", "L1", ("C1L", "C1X", "C1S"), L1_HZ, (1, 0), _QZS, neglects=_NO_ISC),
        Signal("J", "L1S", "L1", ("C1Z",), L1_HZ, (1, 0), _QZS, neglects=_NO_ISC),
        Signal("J", "L2C", "L2", ("C2L", "C2X", "C2S"), L2_HZ, (_GAMMA_L2, 0), _QZS, neglects=_NO_ISC),
        Signal("J", "L5", "L5", ("C5Q", "C5X", "C5I"), L5_HZ, (1, 0), _QZS, neglects=_NO_ISC_L5),
        Signal("J", "L5S", "L5", ("C5P", "C5Z", "C5D"), L5_HZ, (1, 0), _QZS, neglects=_NO_ISC_L5),
        Signal("J", "L6", "E6", l6, E6_HZ, (1, 0), _QZS, neglects=_NO_ISC_L5),
        Signal("I", "L5 SPS", "L5", l5_navic, L5_HZ, (_GAMMA_NAVIC_L5, 0), _NAVIC),
        Signal("I", "S SPS", "S", ("C9A", "C9X", "C9B", "C9C"), S_HZ, (1, 0), _NAVIC),
        Signal("S", "L1 C/A", "L1", ("C1C",), L1_HZ, (0, 0), _SBAS),
        Signal("S", "L5", "L5", ("C5I", "C5X", "C5Q"), L5_HZ, (0, 0), _SBAS, neglects=no_l5),
    )


def _glonass() -> tuple[Signal, ...]:
    g1, g2 = (G1_HZ, G1_STEP_HZ), (G2_HZ, G2_STEP_HZ)

    def signal(name: str, band: str, code: str, carrier: tuple[float, float], **options: Any) -> Signal:
        # the one group delay of the message is that of L2 against L1
        delay = (1.0 if band == "L2" else 0.0, 0.0)
        step = carrier[1]
        return Signal(
            "R",
            name,
            band,
            (code,),
            carrier[0],
            delay,
            _GLO,
            neglects=_NO_G1,
            channel_step_hz=step,
            **options,
        )

    return (
        signal("G1 C/A", "L1", "C1C", g1),
        signal("G1 P", "L1", "C1P", g1),
        signal("G2 C/A", "L2", "C2C", g2),
        signal("G2 P", "L2", "C2P", g2),
    )


SIGNALS: Final[tuple[Signal, ...]] = _gps() + _glonass() + _galileo() + _beidou() + _regional()

_GLONASS_CDMA = "CDMA signal of GLONASS-K: its clock and group delays are in the CDMA messages only"
_REGULATED = "regulated service: no public group delay"

UNSUPPORTED: Final[tuple[UnsupportedSignal, ...]] = (
    UnsupportedSignal("R", ("C3I", "C3Q", "C3X", "C4A", "C4B", "C4X", "C6A", "C6B", "C6X"), _GLONASS_CDMA),
    UnsupportedSignal("G", ("C1M", "C2M"), _REGULATED),
    UnsupportedSignal("E", ("C1A", "C1Z", "C6A", "C6Z"), _REGULATED),
    UnsupportedSignal("C", ("C1S", "C1L", "C1Z", "C6D", "C6P", "C6Z"), _REGULATED),
    UnsupportedSignal("I", ("C1D", "C1P", "C1X"), "NavIC L1: its group delays are in the L1 message only"),
)

_BY_CODE: Final = {(signal.system, code): signal for signal in SIGNALS for code in signal.codes}
_REASONS: Final = {(entry.system, code): entry.reason for entry in UNSUPPORTED for code in entry.codes}


def signal_of(system: str, code: str) -> Signal | None:
    """Return the signal of a system letter ("G") and RINEX code ("C1C"), None when unknown or unsupported."""
    return _BY_CODE.get((system, code))


def reason_unsupported(system: str, code: str) -> str:
    """Return why ``signal_of`` knows no such signal, "" when it does."""
    if (system, code) in _BY_CODE:
        return ""
    return _REASONS.get((system, code), f"no signal {code} of system {system} in RINEX 3")


def is_rinex_code(system: str, code: str) -> bool:
    """Return whether RINEX names a signal of a system so, supported or not."""
    return (system, code) in _BY_CODE or (system, code) in _REASONS


def codes_in_band(system: str, code: str) -> tuple[str, ...]:
    """Return the codes of a system's signals in the RINEX band of a code ("C5Q"); empty where it has none there."""
    return tuple(other for of, other in _BY_CODE if of == system and re.fullmatch(f"C{other[1]}[A-Z]", code))


def carrier_hz(system: str, code: str, channel: int | None = None) -> float:
    """Return the carrier [Hz], NaN when the signal is unknown or unsupported.

    Parameters
    ----------
    system, code : RINEX letter and code
    channel : the satellite's GLONASS channel, without which its carrier is NaN; of no account to the other systems
    """
    signal = signal_of(system, code)
    if signal is None:
        return math.nan
    if signal.channel_step_hz == 0.0:
        return signal.carrier_hz
    if channel is None or channel not in CHANNELS:
        return math.nan
    return signal.carrier_hz + channel * signal.channel_step_hz


def wavelength_m(system: str, code: str, channel: int | None = None) -> float:
    """Return the carrier's wavelength [m], NaN where ``carrier_hz`` is."""
    return C_MPS / carrier_hz(system, code, channel)


def ionosphere_factor(system: str, code: str, channel: int | None = None) -> float:
    """Return (f_L1 / f)^2, the ionosphere's delay on this signal over that on L1 (GPS's); NaN where no carrier is."""
    return float((L1_HZ / carrier_hz(system, code, channel)) ** 2)


def inter_signal_index(system: str, code: str) -> int:
    """Return which entry of ``NavigationData.inter_signal_s`` belongs to a signal, -1 for none."""
    return INTER_SIGNAL[code] if system in "GJ" and code in INTER_SIGNAL else -1
