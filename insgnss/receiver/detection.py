"""Detection of a signal in noise: the signal-to-noise ratio that it needs, and the accumulation time.

A look is one coherent accumulation of in-phase and quadrature over a time T; its signal-to-noise ratio is
``snr = C T / N0``, the power of its mean over the variance of its complex noise. ``looks`` of them are squared and
summed (square-law, non-coherent). All ratios are linear unless the name ends in ``_db``.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.config.search import Detection
from insgnss.errors import ConfigError
from insgnss.tables import Float64, Int64

_SNR_BISECTIONS: Final = 45  # of a bracket of a factor 2: to 3e-14 of the ratio
_POISSON_SIGMAS: Final = 12.0  # weights further from their mean are below 1e-30


class Detector(NamedTuple):
    """The requirement of a detection: the ratio of each look for 1, 2, ... looks, processing loss included."""

    required_snr: Float64  # (max_looks,) of each look [-], falling
    coherent_limit_s: float  # inf: one look, as long as it takes


class Accumulation(NamedTuple):
    """The accumulation for a signal of a given strength."""

    time_s: Float64  # in all; inf where the allowed number of looks does not suffice
    looks: Int64
    look_s: Float64  # coherent part: time_s / looks; inf where time_s is


def _special() -> Any:
    """Return SciPy's special functions, loaded late: a replay without supervision does not need them."""
    from scipy import special

    return special


def marcum_q(order: npt.ArrayLike, a: npt.ArrayLike, b: npt.ArrayLike) -> Float64:
    """Return the generalised Marcum Q function, by its series in Poisson weights; arguments broadcast.

    Equation: Q_m(a, b) = sum_k e^(-h) h^k / k! Gamma(m + k, b^2/2) / Gamma(m + k), h = a^2 / 2
                                                                    [Shnidman 1989, IEEE Trans. IT 35(2)]
    Neglects: terms of a total weight below 1e-30; no cancellation, as all terms are positive.
    """
    m, half, x = np.broadcast_arrays(np.asarray(order, float), np.square(a) / 2.0, np.square(b) / 2.0)
    spread = _POISSON_SIGMAS * np.sqrt(half) + 60.0
    first = np.maximum(np.floor(half - spread), 0.0)
    terms = int(np.max(half + spread - first, initial=0.0)) + 1
    k = first[..., None] + np.arange(terms)
    weight = np.exp(_special().xlogy(k, half[..., None]) - half[..., None] - _special().gammaln(k + 1.0))
    return np.asarray(np.sum(weight * _special().gammaincc(m[..., None] + k, x[..., None]), axis=-1))


def threshold(pfa: npt.ArrayLike, looks: npt.ArrayLike = 1) -> Float64:
    """Return the threshold of Pfa for noise alone: a sum of looks, each over its mean without signal.

    Equation: Gamma(K, y) / Gamma(K) = Pfa                          [Marcum 1960; Richards 2014, chapter 6]
    """
    return np.asarray(_special().gammainccinv(np.asarray(looks, float), pfa))


def detection_probability(snr: npt.ArrayLike, pfa: npt.ArrayLike, looks: npt.ArrayLike = 1) -> Float64:
    """Return the probability of detection of a steady signal of unknown phase, exactly; arguments broadcast.

    Equation: Pd = Q_K(sqrt(2 K snr), sqrt(2 y)), y the ``threshold``
                                                                    [Marcum 1960; Richards 2014, chapter 6]
    """
    K = np.asarray(looks, float)
    edge = np.sqrt(2.0 * threshold(pfa, K))
    return marcum_q(K, np.sqrt(2.0 * K * np.asarray(snr, float)), edge)


def coherent_detection_probability(snr: npt.ArrayLike, pfa: npt.ArrayLike) -> Float64:
    """Return the probability of detection when the phase is known too.

    Equation: Pd = Phi(sqrt(2 snr) - Phi^-1(1 - Pfa))               [Richards 2014, chapter 6]
    """
    return np.asarray(_special().ndtr(np.sqrt(2.0 * np.asarray(snr, float)) + _special().ndtri(pfa)))


def albersheim_snr_db(pd: float, pfa: float, looks: npt.ArrayLike = 1) -> Float64:
    """Return the ratio that each look needs [dB], by Albersheim's formula.

    Equation: A = ln(0.62 / Pfa), B = ln(Pd / (1 - Pd)), g = log10(A + 0.12 A B + 1.7 B);
              one look: 10 g; K looks: -5 log10 K + (6.2 + 4.54 / sqrt(K + 0.44)) g
                                            [Albersheim 1981, Proc. IEEE 69(7), 839; Skolnik 2001, chapter 2]
    Neglects: 0.2 dB is stated for Pfa 1e-7 ... 1e-3 and Pd 0.1 ... 0.9, for a linear detector. Against
    ``exact_snr_db`` it is off by 0.09 dB at most for one look and Pd 0.4 ... 0.99, by 0.37 dB for up to 1000 looks (of
    which the square law is a part), but by 0.9 dB at Pd 0.2 and 4 dB at Pd 0.1. At Pd 0.99, Pfa 1e-3 it gives 12.50 dB
    for 12.46 dB. One look put into the second form would give 0.02 dB less than the first.

    Raises
    ------
    ConfigError : the formula has no value for this pair of pd and pfa
    """
    _check_pair(pd, pfa)
    A, B = math.log(0.62 / pfa), math.log(pd / (1.0 - pd))
    inner = A + 0.12 * A * B + 1.7 * B
    if pfa >= 0.62 or inner <= 0.0:
        advice = "take method = 'exact', or a pd above 0.1 and a pfa below 1e-3"
        raise ConfigError(
            f"Albersheim's formula has no value at pd {pd:g}, pfa {pfa:g}", key="pd", advice=advice
        )
    K = np.asarray(looks, float)
    slope = np.where(K > 1.0, 6.2 + 4.54 / np.sqrt(K + 0.44), 10.0)
    return np.asarray(-5.0 * np.log10(K) + slope * math.log10(inner))


def exact_snr_db(pd: float, pfa: float, looks: npt.ArrayLike = 1) -> Float64:
    """Return the ratio that each look needs [dB], by inverting ``detection_probability``; -inf where noise suffices.

    Raises
    ------
    ConfigError : pd is not above pfa
    """
    _check_pair(pd, pfa)
    K = np.asarray(looks, float)
    edge = np.sqrt(2.0 * threshold(pfa, K))
    low, high = np.zeros(K.shape), np.ones(K.shape)  # of K snr
    while np.any(short := marcum_q(K, np.sqrt(2.0 * high), edge) < pd):
        low, high = np.where(short, high, low), np.where(short, 2.0 * high, high)
    for _ in range(_SNR_BISECTIONS):
        middle = 0.5 * (low + high)
        short = marcum_q(K, np.sqrt(2.0 * middle), edge) < pd
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    return np.asarray(10.0 * np.log10(high / K))


def coherent_snr_db(pd: float, pfa: float) -> float:
    """Return the ratio that one look of known phase needs [dB], the inverse of ``coherent_detection_probability``.

    Raises
    ------
    ConfigError : pd is not above pfa
    """
    _check_pair(pd, pfa)
    return float(20.0 * np.log10((_special().ndtri(pd) - _special().ndtri(pfa)) / math.sqrt(2.0)))


def _check_pair(pd: float, pfa: float) -> None:
    if not 0.0 < pfa < pd < 1.0:
        raise ConfigError(
            f"pd {pd:g} and pfa {pfa:g} are not valid probabilities of detection and false alarm",
            key="pfa" if 0.0 < pd < 1.0 else "pd",
            advice="give 0 < pfa < pd < 1",
        )


def detector(settings: Detection) -> Detector:
    """Return the requirement of a detection; worth keeping, as the exact method takes some seconds.

    A carrier of known phase is collected in one look: its coherent limit says nothing.

    Raises
    ------
    ConfigError : the method has no value for these probabilities
    """
    limit = math.inf if settings.coherent_limit_s is None else settings.coherent_limit_s
    looks = np.arange(1.0, (settings.max_looks if math.isfinite(limit) else 1) + 1.0)
    if settings.method == "coherent":
        limit, required_db = math.inf, np.array([coherent_snr_db(settings.pd, settings.pfa)])
    elif settings.method == "exact":
        required_db = exact_snr_db(settings.pd, settings.pfa, looks)
    else:
        required_db = albersheim_snr_db(settings.pd, settings.pfa, looks)
    return Detector(np.power(10.0, (required_db + settings.loss_db) / 10.0), limit)


def accumulation(cn0_dbhz: npt.ArrayLike, need: Detector) -> Accumulation:
    """Return the accumulation of a signal: the fewest looks whose length stays within the limit.

    Equation: T = K snr_K / (C/N0), the least K with snr_K <= (C/N0) T_limit
    """
    cn0_hz = np.power(10.0, np.asarray(cn0_dbhz, float, order="C") / 10.0)
    # required_snr falls with the number of looks: how many of them are too few
    with np.errstate(
        divide="ignore", invalid="ignore"
    ):  # no signal at all: NaN, which sorts behind every number
        too_few = np.searchsorted(-need.required_snr, -cn0_hz * need.coherent_limit_s)
        enough = too_few < len(need.required_snr)
        looks = np.minimum(too_few, len(need.required_snr) - 1) + 1
        look_s = np.where(enough, need.required_snr[looks - 1] / cn0_hz, np.inf)
    return Accumulation(looks * look_s, looks.astype(np.int64), look_s)
