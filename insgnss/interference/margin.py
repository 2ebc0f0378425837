"""The interference margin J/S of an aided phase loop, and the drift that a wanted margin allows.

J/S is the power of the interference over that of the signal, both at the correlator's input, at which the loop, made
optimal for that very interference, is about to lose lock. It does not depend on the vehicle's motion, only on what the
aiding leaves of it and on the oscillator: S = S_INS + S_osc.

``bandwidth_hz`` (DF_c) turns power into density: J / DF_c is the one-sided density of white noise that would disturb
the correlator as much. The paper takes the band between the first zeros of the spectrum; for a given emitter it is the
inverse of the spectral separation coefficient (``spectra``).

A loop without aiding has to follow the vehicle's acceleration too: ``margin_in_motion_db``.

Which oscillator and which INS together allow a wanted margin, say the lines of the paper's figures 4, 5 and 6. Two
characteristics describe the two drifts [Shatilov 2009, (28)]:

    c_osc = df_max^2 / T_osc [Hz^2/s],  c_INS = dV_max^2 / T_INS [m^2/s^3],
    2 (2 pi / 3)^2 c_osc + 2 (2 pi f0 / (3 c))^2 c_INS <= S_max

so that each wanted margin is a straight line; on one of the axes the *other* sensor's characteristic is zero (the
paper's text at figure 4 has it the other way round). S_max is one-sided [rad^2/s^3].

One-sided densities throughout: S of the frequency's rate [rad^2/s^3].
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.interference.checks import finite, not_negative, positive
from insgnss.interference.discriminators import TIME_ADVICE, Discriminator, equivalent_noise, inverse_cn0
from insgnss.interference.drift import per_mps
from insgnss.interference.optimal_loop import noise_bandwidth, threshold_noise
from insgnss.interference.steady_acceleration import threshold_in_motion
from insgnss.tables import Float64

_BAND_ADVICE: Final = "give the signal's band in hertz: 1.022e6 between the first zeros of GLONASS ST"
_DB_ADVICE: Final = "give decibels"
PER_OSCILLATOR: Final = 2.0 * (2.0 * math.pi / 3.0) ** 2  # 8.77298 rad^2/s^3 for 1 Hz^2/s
_ADVICE: Final = "the square of the greatest increment over the time it took"


@dataclass(frozen=True)
class PhaseLoop:
    """A phase loop for one signal.

    Raises
    ------
    ConfigError : band or accumulation is not above zero
    """

    discriminator: Discriminator
    bandwidth_hz: float  # DF_c of the signal
    accumulation_s: float  # T_s, coherent; of no account to type 1

    def __post_init__(self) -> None:
        positive("bandwidth_hz", self.bandwidth_hz, _BAND_ADVICE)
        positive("accumulation_s", self.accumulation_s, TIME_ADVICE)


def db(ratio: npt.ArrayLike) -> Float64:
    """Return 10 log10 of a ratio of powers; -inf for zero."""
    with np.errstate(divide="ignore"):
        return np.asarray(10.0 * np.log10(np.asarray(ratio, np.float64)))


def ratio(decibels: npt.ArrayLike) -> Float64:
    """Return the ratio of powers of a number of decibels."""
    return np.asarray(np.power(10.0, np.asarray(decibels, np.float64) / 10.0))


def threshold_inverse_cn0(drift: npt.ArrayLike, loop: PhaseLoop, phase_walk: npt.ArrayLike = 0.0) -> Float64:
    """Return x = 1 / q [1/Hz] at which lock goes: type 1 S_n, type 2 T (sqrt(1 + 2 S_n / T) - 1), S_n by (18)."""
    noise = threshold_noise(drift, loop.discriminator.threshold_rms_rad, phase_walk)
    return inverse_cn0(loop.discriminator, noise, loop.accumulation_s)


def threshold_cn0_dbhz(drift: npt.ArrayLike, loop: PhaseLoop, phase_walk: npt.ArrayLike = 0.0) -> Float64:
    """Return the least effective C/N0, interference counted as noise, at which the loop keeps lock [dBHz]."""
    return -db(threshold_inverse_cn0(drift, loop, phase_walk))


def margin_db(
    drift: npt.ArrayLike,
    loop: PhaseLoop,
    cn0_dbhz: npt.ArrayLike | None = None,
    phase_walk: npt.ArrayLike = 0.0,
) -> Float64:
    """Return the greatest J/S at which the loop keeps lock [dB]; -inf where noise alone breaks it.

    Equation: J/S = DF_c (x_thr - 1/q0), 1/q0 = N_0 / C; without thermal noise
              type 1: J/S = DF_c (A_d C_A)^(8/3) (4/S)^(1/3)
              type 2: J/S = DF_c T_s {sqrt[1 + 2 (A_d C_A)^(8/3) / T_s (4/S)^(1/3)] - 1}
                            [Shatilov 2009, (24), (25); in print the cube root of (25) stands outside the square root]

    Parameters
    ----------
    drift : S, one-sided density of the frequency's rate [rad^2/s^3]
    cn0_dbhz : C/N0 without interference; None leaves thermal noise out, as the paper does
    phase_walk : one-sided density of white frequency noise [rad^2/s], which the paper has not
    """
    return _margin_at(threshold_inverse_cn0(drift, loop, phase_walk), loop, cn0_dbhz)


def margin_in_motion_db(
    drift: npt.ArrayLike,
    sigma_mps2: npt.ArrayLike,
    time_s: float,
    carrier_hz: float,
    loop: PhaseLoop,
    cn0_dbhz: npt.ArrayLike | None = None,
    phase_walk: npt.ArrayLike = 0.0,
) -> Float64:
    """Return the greatest J/S that a loop without aiding withstands [dB], the better of second and third order.

    Equation: as ``margin_db``, with S_n,thr of ``threshold_in_motion``

    Parameters
    ----------
    drift : S of the oscillator alone, one-sided [rad^2/s^3]
    sigma_mps2, time_s : one sigma and correlation time of the vehicle's acceleration along the line of sight
    """
    rms = loop.discriminator.threshold_rms_rad
    noise = threshold_in_motion(drift, sigma_mps2, time_s, carrier_hz, rms, phase_walk).noise
    return _margin_at(inverse_cn0(loop.discriminator, noise, loop.accumulation_s), loop, cn0_dbhz)


def _margin_at(x: Float64, loop: PhaseLoop, cn0_dbhz: npt.ArrayLike | None) -> Float64:
    """Return the margin of a threshold x = 1 / q [dB]."""
    if cn0_dbhz is not None:
        x = x - ratio(-finite("cn0_dbhz", cn0_dbhz, _DB_ADVICE))
    return db(loop.bandwidth_hz * np.maximum(x, 0.0))


def greatest_drift(margin: npt.ArrayLike, loop: PhaseLoop, cn0_dbhz: npt.ArrayLike | None = None) -> Float64:
    """Return the greatest one-sided density S [rad^2/s^3] that allows a wanted J/S; the inverse of ``margin_db``.

    Equation: S_max = 4 (A_d C_A)^8 / S_n^3, S_n of (19) or (20) at J/S; without thermal noise
              type 1: 4 (A_d C_A)^8 (DF_c / (J/S))^3
              type 2: 32 (A_d C_A)^8 / T_s^3 [((J/S) / (DF_c T_s) + 1)^2 - 1]^-3           [Shatilov 2009, (26), (27)]

    Parameters
    ----------
    margin : wanted J/S [dB]
    """
    x = ratio(finite("margin", margin, _DB_ADVICE)) / loop.bandwidth_hz
    if cn0_dbhz is not None:
        x = x + ratio(-finite("cn0_dbhz", cn0_dbhz, _DB_ADVICE))
    noise = equivalent_noise(loop.discriminator, x, loop.accumulation_s)
    return np.asarray(4.0 * loop.discriminator.threshold_rms_rad**8 / noise**3)


def bandwidth_at_margin_hz(drift: npt.ArrayLike, loop: PhaseLoop, phase_walk: npt.ArrayLike = 0.0) -> Float64:
    """Return the one-sided noise bandwidth of the loop that is optimal at its threshold [Hz].

    Equation: DF = 3 / (4 sqrt 2) (S / S_n,thr)^(1/4)               [Shatilov 2009, steps 4* and 5*]
    With a phase walk: (K1^2 + K2) / (4 K1), K2 = sqrt(S / S_n), K1 = sqrt(2 K2 + S_f / S_n).
    """
    noise = threshold_noise(drift, loop.discriminator.threshold_rms_rad, phase_walk)
    if not np.asarray(phase_walk).any():
        return noise_bandwidth(drift, noise)
    K2 = np.sqrt(np.asarray(drift) / noise)
    K1 = np.sqrt(2.0 * K2 + np.asarray(phase_walk) / noise)
    return np.asarray((K1 * K1 + K2) / (4.0 * K1))


class TradeOff(NamedTuple):
    """One line: all pairs below it allow the margin."""

    margin_db: float
    greatest_density: float  # S_max, one-sided [rad^2/s^3]
    c_ins: float  # m^2/s^3, with a perfect oscillator
    c_osc: float  # Hz^2/s, with a perfect INS

    def osc_left(self, c_ins: npt.ArrayLike) -> Float64:
        """Return the greatest c_osc beside a c_INS, zero where nothing is left."""
        share = 1.0 - not_negative("c_ins", c_ins, _ADVICE) / self.c_ins
        return np.asarray(self.c_osc * np.maximum(share, 0.0))


class Diagram(NamedTuple):
    """The lines of figure 4: the margin with one characteristic alone, the other zero."""

    margin_db: Float64
    c_ins: Float64  # left axis: c_osc = 0
    c_osc: Float64  # right axis: c_INS = 0


def per_ins(carrier_hz: float) -> float:
    """Return the contribution of a c_INS of 1 m^2/s^3 to S: 2 (2 pi f0 / (3 c))^2, 249.888 rad^2/s^3 at 1600 MHz."""
    return 2.0 * (per_mps(carrier_hz) / 3.0) ** 2


def density(c_osc: npt.ArrayLike, c_ins: npt.ArrayLike, carrier_hz: float) -> Float64:
    """Return the one-sided density S of two characteristics       [Shatilov 2009, (28)]."""
    return np.asarray(
        PER_OSCILLATOR * not_negative("c_osc", c_osc, _ADVICE)
        + per_ins(carrier_hz) * not_negative("c_ins", c_ins, _ADVICE)
    )


def trade_off(margin: float, loop: PhaseLoop, carrier_hz: float, cn0_dbhz: float | None = None) -> TradeOff:
    """Return the line of a wanted J/S [dB]; thermal noise counts where ``cn0_dbhz`` is given."""
    S = float(greatest_drift(margin, loop, cn0_dbhz))
    return TradeOff(margin, S, S / per_ins(carrier_hz), S / PER_OSCILLATOR)


def diagram(margins: npt.ArrayLike, loop: PhaseLoop, carrier_hz: float) -> Diagram:
    """Return figure 4's curve for one discriminator, both axes."""
    S = greatest_drift(margins, loop)
    return Diagram(np.asarray(margins, np.float64), S / per_ins(carrier_hz), S / PER_OSCILLATOR)
