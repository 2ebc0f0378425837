"""Interference in a correlator: spectra of the civil signals and their separation from an emitter's.

Spectra here are two-sided densities of complex baseband, of unit power over all frequencies, in 1/Hz. With them the
interference's power J adds ``J kappa`` to the one-sided density N_0 of thermal noise at the carrier: a complex
baseband density over both signs of frequency is the one-sided density at the carrier.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy import integrate

from insgnss.errors import ModelError
from insgnss.gnss.signals import SIGNALS, Signal, reason_unsupported, signal_of
from insgnss.interference.checks import named, positive
from insgnss.tables import Float64

# of the integrals over frequency: lobes of 1 MHz in a front end of 50 MHz have 160 each
_POINTS: Final = 8001
_SYSTEMS: Final = {
    "G": "GPS", "R": "GLONASS", "E": "Galileo", "C": "BeiDou", "J": "QZSS", "I": "NavIC", "S": "SBAS"
}  # fmt: skip


@dataclass(frozen=True)
class Part:
    """One component of a spectrum: chips of ``pulses`` alternating pulses each, 1 for BPSK, 2 m / n for BOC(m, n)."""

    weight: float
    chip_rate_hz: float
    pulses: int = 1
    offset_hz: float = 0.0  # of its centre from the carrier


@dataclass(frozen=True)
class Modulation:
    """A signal's spectrum, its data, and whether a component without data can be tracked."""

    parts: tuple[Part, ...]
    symbol_s: float  # of the data component: the longest coherent accumulation without knowing the data
    pilot: bool = False
    neglects: str = ""

    @property
    def null_to_null_hz(self) -> float:
        """Band between the outer zeros of the main lobes, the paper's DF_c."""
        main = self.parts[0]
        lobes = 1.0 if main.pulses == 1 else 0.5 * main.pulses + 1.0
        return 2.0 * (lobes * main.chip_rate_hz + abs(main.offset_hz))


def _bpsk(rate_hz: float, symbol_s: float, pilot: bool = False, neglects: str = "") -> Modulation:
    return Modulation((Part(1.0, rate_hz),), symbol_s, pilot, neglects)


def _mboc(symbol_s: float) -> Modulation:
    # 10/11 BOC(1,1) + 1/11 BOC(6,1), the spectrum that GPS, Galileo and BeiDou agreed on
    return Modulation((Part(10.0 / 11.0, _C, 2), Part(1.0 / 11.0, _C, 12)), symbol_s, True)


def _two_lobes(symbol_s: float) -> Modulation:
    lobes = (Part(0.5, 10.0 * _C, 1, -15.0 * _C), Part(0.5, 10.0 * _C, 1, 15.0 * _C))
    return Modulation(lobes, symbol_s, True, "AltBOC(15,10) is taken for two lobes of 10.23 MHz")


_C: Final = 1.023e6  # chips per second of GPS C/A; IS-GPS-200N, 3.3.2.3
# By system and name in ``gnss.signals``: chip rates, subcarriers and symbol rates of the ICDs named there. A period of
# the code bounds nothing here; where secondary codes or bits are known, longer accumulations can be asked for.
MODULATIONS: Final[dict[tuple[str, str], Modulation]] = {
    ("G", "L1 C/A"): _bpsk(_C, 0.020),
    ("G", "L1 P(Y)"): _bpsk(10.0 * _C, 0.020, neglects="the loss of tracking without the code"),
    ("G", "L1C"): _mboc(0.010),
    ("G", "L2C"): _bpsk(_C, 0.020, True),
    ("G", "L2 P(Y)"): _bpsk(10.0 * _C, 0.020, neglects="the loss of tracking without the code"),
    ("G", "L2 C/A"): _bpsk(_C, 0.020),
    ("G", "L5"): _bpsk(10.0 * _C, 0.010, True),
    ("R", "G1 C/A"): _bpsk(
        0.511e6, 0.010
    ),  # GLONASS ICD 5.1, 3.3.2.2; bits of 20 ms times a meander of 10 ms
    ("R", "G1 P"): _bpsk(5.11e6, 0.010),
    ("R", "G2 C/A"): _bpsk(0.511e6, 0.010),
    ("R", "G2 P"): _bpsk(5.11e6, 0.010),
    ("E", "E1 OS"): _mboc(0.004),
    ("E", "E5a"): _bpsk(10.0 * _C, 0.020, True),
    ("E", "E5b"): _bpsk(10.0 * _C, 0.004, True),
    ("E", "E5"): _two_lobes(0.004),
    ("E", "E6"): _bpsk(5.0 * _C, 0.001, True),
    ("C", "B1I"): _bpsk(2.0 * _C, 0.020),
    ("C", "B1C"): _mboc(0.010),
    ("C", "B2a"): _bpsk(10.0 * _C, 0.005, True),
    ("C", "B2I"): _bpsk(2.0 * _C, 0.020),
    ("C", "B2b"): _bpsk(10.0 * _C, 0.001),
    ("C", "B2a+b"): _two_lobes(0.005),
    ("C", "B3I"): _bpsk(10.0 * _C, 0.020),
    ("J", "L1 C/A"): _bpsk(_C, 0.020),
    ("J", "L1C"): _mboc(0.010),
    ("J", "L1S"): _bpsk(_C, 0.002),
    ("J", "L2C"): _bpsk(_C, 0.020, True),
    ("J", "L5"): _bpsk(10.0 * _C, 0.010, True),
    ("J", "L5S"): _bpsk(10.0 * _C, 0.002, True),
    ("J", "L6"): _bpsk(5.0 * _C, 0.004),
    ("I", "L5 SPS"): _bpsk(_C, 0.020),
    ("I", "S SPS"): _bpsk(_C, 0.020),
    ("S", "L1 C/A"): _bpsk(_C, 0.002),
    ("S", "L5"): _bpsk(10.0 * _C, 0.002),
}


def signal_named(name: str) -> Signal:
    """Return a signal by name, "GPS L1 C/A", or by RINEX letter and code, "G:C1C".

    Raises
    ------
    ModelError : there is no such signal; the advice names the nearest, or why it is not supported
    """
    letter, _, code = name.partition(":")
    if code:
        found = signal_of(letter.strip().upper(), code.strip().upper())
        if found is not None:
            return found
        reason = reason_unsupported(letter.strip().upper(), code.strip().upper())
        near = [f"{s.system}:{s.codes[0]}" for s in SIGNALS if s.system == letter.strip().upper()]
        raise ModelError(
            f"unknown signal '{name}': {reason}", advice=f"known: {', '.join(near) or 'G, R, E, C, J, I, S'}"
        )
    return named("signal", name, [(signal_name(s), s) for s in SIGNALS])


def signal_name(signal: Signal) -> str:
    """Return the name in words: "GPS L1 C/A"."""
    return f"{_SYSTEMS[signal.system]} {signal.name}"


def modulation_of(signal: Signal) -> Modulation:
    """Return the spectrum and data of a signal."""
    return MODULATIONS[signal.system, signal.name]


def spectrum(modulation: Modulation, offset_hz: npt.ArrayLike) -> Float64:
    """Return the density of a signal at offsets from its carrier, of unit power over all frequencies [1/Hz].

    Equation: G(f) = T_p^2 / T_c sinc^2(f T_p) |sum_k (-1)^k e^(-2 pi i f k T_p)|^2, pulses of T_p = T_c / n: BPSK for
    n = 1, sine BOC(m, n) for 2 m / n pulses                        [Betz 2001, Navigation 48(4), from the pulse itself]
    Neglects: the lines of periodic codes, each up to 9 dB above the envelope for GPS C/A, and their products in
    composite signals.
    """
    f = np.asarray(offset_hz, np.float64)
    total = np.zeros(f.shape)
    for part in modulation.parts:
        pulse_s = 1.0 / (part.chip_rate_hz * part.pulses)
        turn = (f - part.offset_hz) * pulse_s
        k = np.arange(part.pulses)
        chip = np.exp(-2j * math.pi * turn[..., None] * k) @ ((-1.0) ** k)
        total += part.weight * pulse_s**2 * part.chip_rate_hz * np.sinc(turn) ** 2 * np.abs(chip) ** 2
    return np.asarray(total)


def power_within(modulation: Modulation, front_end_hz: float) -> float:
    """Return the share of a signal's power that a rectangular front end passes."""
    half = 0.5 * float(positive("front_end_hz", front_end_hz, "two-sided bandwidth at the carrier, 20e6"))
    f = np.linspace(-half, half, _POINTS)
    return float(integrate.trapezoid(spectrum(modulation, f), f))


def broadband_separation(
    modulation: Modulation, front_end_hz: float, offset_hz: float, bandwidth_hz: float
) -> float:
    """Return the separation of a signal from flat interference: the addition to N_0 by 1 W of it [1/Hz].

    Equation: kappa = int G_s G_j df / (int G_s df)^2 over the front end, G_j = 1 / B over the emitter's band
                                        [Betz 2001; Kaplan & Hegarty 2017, 9.2; referred to the signal's whole power]
    Interference outside the front end adds nothing; that it may saturate it, is neglected.

    Parameters
    ----------
    front_end_hz : two-sided bandwidth around the signal's carrier
    offset_hz : of the emitter's centre from the signal's carrier
    bandwidth_hz : of the emitter, two-sided, all of whose power lies inside
    """
    band = float(positive("bandwidth_hz", bandwidth_hz, "of the emitter, in hertz; a line is a CW emitter"))
    kept = power_within(modulation, front_end_hz)
    low = max(-0.5 * front_end_hz, offset_hz - 0.5 * band)
    high = min(0.5 * front_end_hz, offset_hz + 0.5 * band)
    if high <= low:
        return 0.0
    f = np.linspace(low, high, _POINTS)
    return float(integrate.trapezoid(spectrum(modulation, f), f)) / band / kept**2


def line_separation(modulation: Modulation, front_end_hz: float, offset_hz: float) -> float:
    """Return the separation of a signal from a continuous wave, as if its code had no period [1/Hz].

    Equation: kappa = G_s(f_j - f_c) / (int G_s df)^2 within the front end, zero outside
    """
    kept = power_within(modulation, front_end_hz)
    inside = abs(offset_hz) <= 0.5 * front_end_hz
    return float(spectrum(modulation, offset_hz)) / kept**2 if inside else 0.0
