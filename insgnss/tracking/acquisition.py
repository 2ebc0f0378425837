"""Acquisition of a code in samples: all delays at once by Fourier transforms, Doppler by Doppler, looks summed.

A look is a coherent sum over whole code periods, folded into one of them; the squares of ``looks`` of them are summed.
Where there is no signal, the sum in one cell over its mean of one look has the Gamma distribution of ``looks`` degrees:
the threshold for a false-alarm probability is ``insgnss.receiver.detection.threshold``. Cells closer than a chip share
part of their noise, so the false-alarm probability of a whole search is at most the sum of those of its cells.

    wanted = SearchSpan(0.0, 5000.0, coherent_s=0.005, looks=40)
    found = acquire(SignalSamples(sampling, i, q), [gps_ca(7)], [wanted])[0]
    found.statistic, found.delay_chips, found.doppler_hz
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import fft, special

from insgnss.errors import ConfigError, InputError
from insgnss.tables import Complex, Float64, Int64
from insgnss.tracking.admissible import require_not_negative, require_positive
from insgnss.tracking.codes import RangingCode
from insgnss.tracking.signal import SignalSamples

SingleComplex = npt.NDArray[np.complex64]
DOPPLER_STEP_CYCLES: Final = 2.0 / 3.0  # over a look: sinc^2 loses 1.6 dB at the edge of a bin
SILENT: Final = "the samples are all zero"
SILENT_ADVICE: Final = "check the front end and its gain, the sample type and the bytes that are skipped"
_FINE_BINS: Final = 33  # over two Doppler bins, when a detection is refined
_FINE_CHIPS: Final = 0.5  # early and late of the refined delay


@dataclass(frozen=True)
class SearchSpan:
    """Where one satellite is looked for, and for how long."""

    doppler_hz: float  # middle of the window, at the middle of the samples
    doppler_half_width_hz: float
    delay_chips: float | None = None  # middle of the window at the first sample; None: the whole code
    delay_half_width_chips: float = math.inf
    doppler_rate_hz_per_s: float = 0.0  # by which the replica is led on
    coherent_s: float = 0.01
    looks: int = 1

    def __post_init__(self) -> None:
        require_not_negative(doppler_half_width_hz=self.doppler_half_width_hz)
        require_positive(
            "a window has a width", delay_half_width_chips=min(self.delay_half_width_chips, 1e9),
            coherent_s=self.coherent_s,
        )  # fmt: skip
        if self.looks < 1:
            raise ConfigError(f"{self.looks} looks", key="looks", advice="take at least one")

    def bins_hz(self) -> Float64:
        """Return the Doppler bins, evenly spread over the window, at most ``DOPPLER_STEP_CYCLES`` apart."""
        step = DOPPLER_STEP_CYCLES / self.coherent_s
        half = math.ceil(max(self.doppler_half_width_hz - 0.5 * step, 0.0) / step)
        return self.doppler_hz + step * np.arange(-half, half + 1.0)


class Acquisition(NamedTuple):
    """The strongest cell of a search."""

    statistic: float  # sum of the looks over the mean of one without signal
    cells: int  # looked at, delays by Doppler bins
    delay_chips: float  # at the first sample, 0 to the code's length
    doppler_hz: float  # at the middle of the samples
    cn0_dbhz: float  # by the strength at the refined delay and Doppler, NaN where noise alone is stronger


class _BasebandLooks(NamedTuple):
    """Samples at baseband as looks by code periods by samples of a period, and their times."""

    y: SingleComplex  # (looks, periods, n)
    t_s: Float64  # same shape, from the first sample


class _Floor(NamedTuple):
    """What a code's strongest cell stands against."""

    cells: int
    noise: float  # of a look
    bit_delay_chips: float  # NaN: not known


def acquire(
    samples: SignalSamples,
    codes: Sequence[RangingCode],
    span: SearchSpan,
    carrier_hz: float,
    bit_delays_chips: Sequence[float] | None = None,
) -> list[Acquisition]:
    """Return the strongest cell of each code, all searched over one span of Doppler; a detection is left to the caller.

    Equation: Z_kb(tau) = sum y exp(-j w_b t) h(t - tau) over a look, S = sum_k |Z_kb|^2 / noise; the noise of a look is
              the median of the sums over all delays over that of the Gamma distribution, so that coloured noise and
              the other satellites' correlations count
    The delays of later looks are led on by the Doppler of the bin, as the code's rate is that of the carrier.
    Neglects: the code's Doppler within a look, 0.03 chips for 10 ms and 5 kHz.

    Parameters
    ----------
    samples : at least ``looks`` times ``coherent_s`` of them
    codes : of one rate and length
    span : of the search; a window of delays is that of all codes
    bit_delays_chips : of each code the delay of its data bits at the first sample, good to half a code period; with
        it the Doppler is refined over whole bits, else over looks

    Raises
    ------
    InputError : too few samples, or none that is not zero
    ConfigError : a look that is not a whole number of code periods, or a sampling that folds the signal
    """
    code = codes[0]
    farthest = abs(span.doppler_hz) + span.doppler_half_width_hz
    samples.sampling.check(code.rate_hz, span.coherent_s, farthest)
    ready = _looks_of(samples, code, span)
    n = ready.y.shape[2]
    spectra = [np.conj(fft.fft(_period(each, samples.sampling.rate_hz, n))) for each in codes]
    bins = span.bins_hz()
    inside = _inside(span, code, n)
    best = [(-1.0, 0, 0.0)] * len(codes)
    floor = np.zeros(len(codes))
    for doppler in bins:
        looks = fft.fft(_folded(ready, float(doppler)), axis=1)
        looks *= _delay_ramps(ready, float(doppler), carrier_hz, samples.sampling.rate_hz)
        for c, spectrum in enumerate(spectra):
            power = np.sum(np.abs(fft.ifft(looks * spectrum, axis=1)) ** 2, axis=0)
            floor[c] += np.median(power)
            power[~inside] = 0.0
            k = int(np.argmax(power))
            if power[k] > best[c][0]:
                best[c] = (float(power[k]), k, float(doppler))
    if not floor.all():
        raise InputError(SILENT, advice=SILENT_ADVICE)
    cells = len(bins) * int(np.count_nonzero(inside))
    noise = floor / (len(bins) * special.gammaincinv(span.looks, 0.5))
    bits = [math.nan] * len(codes) if bit_delays_chips is None else bit_delays_chips
    return [
        _refined(ready, each, span, carrier_hz, found, _Floor(cells, level, bit))
        for each, found, level, bit in zip(codes, best, noise.tolist(), bits, strict=True)
    ]


def _looks_of(samples: SignalSamples, code: RangingCode, span: SearchSpan) -> _BasebandLooks:
    """Return the samples without intermediate frequency and given Doppler rate, one row for each code period."""
    rate = samples.sampling.rate_hz
    periods = round(span.coherent_s / code.period_s)
    if periods < 1 or abs(periods * code.period_s / span.coherent_s - 1.0) > 1e-6:
        advice = f"take a multiple of {code.period_s * 1e3:g} ms"
        raise ConfigError(
            f"a look of {span.coherent_s * 1e3:g} ms is not a whole number of code periods",
            key="coherent_s",
            advice=advice,
        )
    n = round(code.period_s * rate)
    # where a period is not a whole number of samples, each begins at the nearest one: within half a sample
    first = np.rint(np.arange(span.looks * periods) * code.period_s * rate).astype(np.int64)
    if first[-1] + n > len(samples.in_phase):
        raise InputError(
            f"{len(samples.in_phase)} samples are fewer than {span.looks} looks of {span.coherent_s * 1e3:g} ms need",
            key="looks",
            advice=f"give at least {first[-1] + n} samples, or take fewer or shorter looks",
        )
    place = first[:, None] + np.arange(n)
    # single precision: 1e-7 of a sum of 1e5 samples is nothing beside their noise, and half the time
    y = samples.in_phase[place].astype(np.complex64)
    if samples.sampling.is_complex:
        y.imag = samples.quadrature[place]
    t = place / rate
    middle = 0.5 * t[-1, -1]
    cycles = samples.sampling.intermediate_hz * t + 0.5 * span.doppler_rate_hz_per_s * (t - middle) ** 2
    if np.any(cycles):
        y *= np.exp(-2j * np.pi * (cycles % 1.0)).astype(np.complex64)
    shape = (span.looks, periods, n)
    return _BasebandLooks(y.reshape(shape), t.reshape(shape))


def _period(code: RangingCode, rate_hz: float, n: int) -> npt.NDArray[np.float32]:
    """Return one period of a code at the samples."""
    place = np.floor(np.arange(n) * (code.rate_hz / rate_hz)).astype(np.int64)
    return np.asarray(code.chips[place % code.length], np.float32)


def _folded(ready: _BasebandLooks, doppler_hz: float) -> SingleComplex:
    """Return each look of one Doppler, (looks, n): its periods summed. Its own phase does not matter."""
    turn = np.exp(-2j * np.pi * doppler_hz * ready.t_s[0]).astype(np.complex64)
    return np.asarray(np.einsum("kpn,pn->kn", ready.y, turn))


def _delay_ramps(
    ready: _BasebandLooks, doppler_hz: float, carrier_hz: float, rate_hz: float
) -> SingleComplex:
    """Return what shifts the looks' spectra to the delay that the code had at the first sample."""
    n = ready.y.shape[2]
    since_s = ready.t_s[:, :, 0].mean(axis=1)
    late = -doppler_hz / carrier_hz * since_s * rate_hz  # samples by which the delay has changed
    if np.max(np.abs(late)) < 0.02:
        return np.ones((1, 1), np.complex64)
    return np.asarray(np.exp(2j * np.pi * np.fft.fftfreq(n)[None, :] * late[:, None]).astype(np.complex64))


def _inside(span: SearchSpan, code: RangingCode, n: int) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return which delays of a period are inside the window, (n,)."""
    if span.delay_chips is None or span.delay_half_width_chips >= 0.5 * code.length:
        return np.ones(n, np.bool_)
    delays = np.arange(n) * (code.length / n)
    off = (delays - span.delay_chips + 0.5 * code.length) % code.length - 0.5 * code.length
    inside = np.abs(off) <= span.delay_half_width_chips
    inside[np.argmin(np.abs(off))] = True
    return np.asarray(inside)


def _refined(
    ready: _BasebandLooks,
    code: RangingCode,
    span: SearchSpan,
    carrier_hz: float,
    found: tuple[float, int, float],
    floor: _Floor,
) -> Acquisition:
    """Return a cell with its Doppler refined between bins, over whole data bits where known, and its delay.

    The delay is refined by early against late half a chip away, the Doppler by a parabola through the best of
    sixteenths of a bin and its neighbours. There the coherent sums Z_b, of l_b code periods Tc each, give

        C/N0 = (sum |Z_b|^2 / N - sum l_b) / (Tc sum l_b^2)

    with N the noise of one code period.
    Neglects: the side lobes of the code's own correlation, which count as noise: -0.5 dB at 42 dBHz and 10 ms.
    """
    power, k, doppler = found
    looks, periods, n = ready.y.shape
    delay = k * (code.length / n)
    t = ready.t_s.reshape(looks * periods, n)
    mixed = ready.y.reshape(t.shape) * np.exp(-2j * np.pi * (doppler * t % 1.0)).astype(np.complex64)
    begins = _sum_begins(t[:, n // 2], code, floor.bit_delay_chips, delay, periods)

    def sums(at_chips: float, off_hz: Float64) -> Complex:
        """Return the coherent sums, (sums, dopplers), of a replica at a delay."""
        phase = t * (code.rate_hz * (1.0 + doppler / carrier_hz)) - at_chips
        rows = np.einsum("kn,kn->k", mixed, code.chips[np.floor(phase).astype(np.int64) % code.length])
        turned = rows[:, None] * np.exp(-2j * np.pi * np.outer(t[:, n // 2], off_hz))
        return np.asarray(np.add.reduceat(turned, begins, axis=0))

    fine = DOPPLER_STEP_CYCLES / span.coherent_s * np.linspace(-1.0, 1.0, _FINE_BINS)
    strength = np.sum(np.abs(sums(delay, fine)) ** 2, axis=0)
    off = _peak(fine, strength)
    at_peak = np.array([off])
    early, late = (np.linalg.norm(sums(delay + side * _FINE_CHIPS, at_peak)) for side in (-1.0, 1.0))
    delay += 0.5 * float((late - early) / (late + early))
    lengths = np.diff(begins, append=len(t))
    strongest = float(np.sum(np.abs(sums(delay, at_peak)) ** 2)) * periods / floor.noise
    snr = (strongest - len(t)) / float(np.sum(lengths**2))
    cn0 = 10.0 * math.log10(snr / code.period_s) if snr > 0.0 else math.nan
    return Acquisition(power / floor.noise, floor.cells, delay % code.length, doppler + off, cn0)


def _sum_begins(
    middle_s: Float64, code: RangingCode, bit_delay_chips: float, delay_chips: float, periods: int
) -> Int64:
    """Return the numbers of the code periods at which coherent sums begin: those of data bits where these are known."""
    if math.isnan(bit_delay_chips):
        return np.arange(0, len(middle_s), periods)
    whole = delay_chips + code.length * round((bit_delay_chips - delay_chips) / code.length)
    bit = np.floor((code.rate_hz * middle_s - whole) / (code.rate_hz * code.sign_s))
    return np.concatenate([[0], np.flatnonzero(np.diff(bit)) + 1])


def _peak(x: Float64, y: Float64) -> float:
    """Return where a parabola through the largest value and its neighbours has its top; at an end the end itself."""
    k = int(np.argmax(y))
    if k in (0, len(x) - 1):
        return float(x[k])
    low, top, high = y[k - 1 : k + 2]
    return float(x[k] + 0.5 * (x[1] - x[0]) * (low - high) / (low - 2.0 * top + high))
