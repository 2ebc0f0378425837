"""Range rates compared with the change of the pseudoranges: sign and unit, and steps of the receiver's clock."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.config.flight import Gnss
from insgnss.config.log_table import NO_COLUMN
from insgnss.constants import C_MPS, NS_PER_S, SIGMA_PER_MEDIAN
from insgnss.gnss.signals import SIGNALS, carrier_hz, wavelength_m
from insgnss.gpstime import ns_to_week_seconds
from insgnss.log.checks.report import CLOCK_LEAPS, RATES_CONTRADICT, Finding, Proposal
from insgnss.tables import Bool, Float64, GnssTable, Int64

MAX_PAIR_S: Final = 5.0  # a longer step lets the range rate change too much to be compared with the mean
MIN_PAIRS: Final = 10
LONGEST_SPAN_S: Final = 30.0  # over which the ranges' noise is divided
MEDIAN_PER_MEAN: Final = 1.2533  # sigma of a median over that of a mean, sqrt(pi / 2)
# Differences of range rate between satellites below this say nothing about sign and unit
MIN_RATE_MPS: Final = 30.0
SLOPE_TOLERANCE: Final = 0.15  # of a sign or a unit
# A ratio that is off by more than this and by its own sigmas is another carrier's or another scale: two carriers of the
# satellites differ by 0.9 % at least, and half a metre a second is ten sigmas of a Doppler
RATIO_TOLERANCE: Final = 1e-3
RATIO_SIGMAS: Final = 5.0
CARRIER_TOLERANCE: Final = 1e-3  # of a ratio of two carriers
# A common step of half a microsecond: no receiver clock wanders so far within an epoch
CLOCK_JUMP_M: Final = 150.0  # half a microsecond within an epoch
# Jumps of one receiver are of one size, or a whole multiple of it where epochs are missing, to this share
JUMP_TOLERANCE: Final = 0.05
_ALL: Final = ""  # the key of all satellites' ratio
_SURE: Final = "sure: the ratio is that of the median of all satellites"


@dataclass(frozen=True)
class RatePairs:
    """The same satellite and signal in two successive epochs."""

    epoch: Int64  # (p,) index of the later epoch
    from_code: Float64  # (p,) change of pseudorange over time [m/s]
    from_rate: Float64  # (p,) mean of the two range rates [m/s]
    dt_s: Float64  # (p,)
    row: Int64  # (p,) of the later epoch


class _Ratio(NamedTuple):
    """How many times as fast as its range rates the pseudoranges of some satellites change."""

    value: float
    sd: float  # by the scatter of the rows, those of an epoch counted once: they share its median


def rate_pairs(gnss: GnssTable, t_ns: Int64, starts: Int64, rate: Float64) -> RatePairs:
    """Return the rows that have the same satellite and signal in the epoch before, the first if it appears twice."""
    epoch = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    channel = gnss.sv.astype(np.int64) * len(gnss.signal_names) + gnss.signal
    keys, row = np.unique(channel * (len(t_ns) + 1) + epoch, return_index=True)
    later = np.flatnonzero(np.diff(keys) == 1) + 1
    a, b = row[later - 1], row[later]
    dt_s = (gnss.t_ns[b] - gnss.t_ns[a]) / NS_PER_S
    pairs = RatePairs(
        epoch[b], (gnss.pseudorange_m[b] - gnss.pseudorange_m[a]) / dt_s, 0.5 * (rate[a] + rate[b]), dt_s, b
    )
    used = (dt_s <= MAX_PAIR_S) & np.isfinite(pairs.from_code) & np.isfinite(pairs.from_rate)
    return RatePairs(pairs.epoch[used], pairs.from_code[used], pairs.from_rate[used], dt_s[used], b[used])


def _common(values: Float64, epoch: Int64) -> tuple[Float64, Int64]:
    """Return the median of the values of each epoch, and the epochs."""
    order = np.lexsort((values, epoch))
    distinct, start, count = np.unique(epoch[order], return_index=True, return_counts=True)
    middle = values[order]
    return 0.5 * (middle[start + (count - 1) // 2] + middle[start + count // 2]), distinct


def rate_findings(gnss: GnssTable, pairs: RatePairs, config: Gnss) -> list[Finding]:
    """Compare range rates with the change of the pseudoranges, both against the epoch's median (no receiver clock)."""
    if not len(pairs.epoch):
        return []
    labels = _labels(gnss)
    by_signal = _ratios(pairs, labels)
    if not by_signal:
        return [Finding("ok", "gnss", "too little relative motion to judge sign and unit of the range rates")]
    of_spans = _ratios(_over_spans(pairs, gnss), labels)
    by_signal = {name: min(one, of_spans.get(name, one), key=_sd) for name, one in by_signal.items()}
    finding = _slope_finding(by_signal.pop(_ALL).value, gnss, config)
    if finding.severity != "ok":
        return [finding]
    wrong = {name: one for name, one in by_signal.items() if _contradicts(one)}
    return [_scale_finding(name, one, gnss) for name, one in wrong.items()] or [finding]


def _ratios(pairs: RatePairs, labels: npt.NDArray[np.str_]) -> dict[str, _Ratio]:
    """Return the ratio of all satellites and of each signal's, empty where too few move against the others.

    Both rates are held against their epoch's median, which takes out the receiver clock.
    """
    code = pairs.from_code - _spread(pairs.from_code, pairs.epoch)
    rate = pairs.from_rate - _spread(pairs.from_rate, pairs.epoch)
    fast = (np.abs(code) > MIN_RATE_MPS) & (rate != 0.0)
    if fast.sum() < MIN_PAIRS:
        return {}
    each, epoch, label = code[fast] / rate[fast], pairs.epoch[fast], labels[pairs.row[fast]]
    of_signals = {str(name): _ratio(each[label == name], epoch[label == name]) for name in np.unique(label)}
    return {_ALL: _ratio(each, epoch)} | of_signals


def _sd(ratio: _Ratio) -> float:
    return ratio.sd


def _over_spans(pairs: RatePairs, gnss: GnssTable) -> RatePairs:
    """Return the rates over spans of many epochs, which follow each other: the ranges' noise counts once a span.

    The range rates are summed over the epochs between. A span has no gap, and all satellites' spans end together.
    """
    step_s = float(np.median(pairs.dt_s))
    n = (
        min(round(LONGEST_SPAN_S / step_s), int(np.ptp(pairs.epoch)) // (2 * MIN_PAIRS))
        if step_s > 0.0
        else 1
    )
    if n < 2 or len(pairs.epoch) <= n:
        return pairs
    channel = gnss.sv[pairs.row].astype(np.int64) * len(gnss.signal_names) + gnss.signal[pairs.row]
    arc = np.cumsum(np.concatenate(([0], (np.diff(channel) != 0) | (np.diff(pairs.epoch) != 1))))
    changes = (pairs.from_code * pairs.dt_s, pairs.from_rate * pairs.dt_s, pairs.dt_s)
    code, rate, time = (np.concatenate(([0.0], np.cumsum(change))) for change in changes)
    end = np.arange(n - 1, len(arc))
    end = end[(arc[end] == arc[end - (n - 1)]) & (pairs.epoch[end] % n == 0)]
    dt_s = time[end + 1] - time[end + 1 - n]
    return RatePairs(
        pairs.epoch[end],
        (code[end + 1] - code[end + 1 - n]) / dt_s,
        (rate[end + 1] - rate[end + 1 - n]) / dt_s,
        dt_s,
        pairs.row[end],
    )


def _ratio(each: Float64, epoch: Int64) -> _Ratio:
    value = float(np.median(each))
    scatter = SIGMA_PER_MEDIAN * float(np.median(np.abs(each - value)))
    epochs = len(np.unique(epoch))
    return _Ratio(value, MEDIAN_PER_MEAN * scatter / epochs**0.5 if epochs >= MIN_PAIRS else math.inf)


def _contradicts(ratio: _Ratio) -> bool:
    return abs(ratio.value - 1.0) > max(RATIO_TOLERANCE, RATIO_SIGMAS * ratio.sd)


def _labels(gnss: GnssTable) -> npt.NDArray[np.str_]:
    """Return (n,) system and signal of each row, "G C1C"."""
    systems = np.array([name[0] for name in gnss.sv_names])[gnss.sv]
    signals = np.array(gnss.signal_names)[gnss.signal]
    return np.char.add(np.char.add(systems, " "), signals)


def _scale_finding(label: str, ratio: _Ratio, gnss: GnssTable) -> Finding:
    """Return the finding on range rates of a signal that are off by a factor near 1."""
    text = (
        f"range rates of {label} contradict the pseudoranges: these change {ratio.value:.5f} times as fast"
        f" (sigma {ratio.sd:.5f})"
    )
    return Finding("error", "gnss", text, _suspects(label, ratio, gnss), kind=RATES_CONTRADICT)


def _suspects(label: str, ratio: _Ratio, gnss: GnssTable) -> str:
    """Return what makes the range rates of a signal wrong by such a factor."""
    system, code = label.split(" ")
    if np.isfinite(gnss.range_rate_mps).any():
        return (
            "suspected: the unit, or a Doppler turned into metres per second with another signal's wavelength"
        )
    advice = "suspected: the unit, or the Doppler of another signal than its code says"
    if system == "R":
        return f"{advice}, or another frequency channel"
    own_hz = carrier_hz(system, code)
    other = min(SIGNALS, key=lambda signal: abs(signal.carrier_hz * ratio.value / own_hz - 1.0))
    if abs(other.carrier_hz * ratio.value / own_hz - 1.0) > CARRIER_TOLERANCE:
        return advice
    return (
        f"{advice}: as if the carrier of {1e-6 * own_hz:.3f} MHz were that of {other.name},"
        f" {1e-6 * other.carrier_hz:.3f} MHz"
    )


def _spread(values: Float64, epoch: Int64) -> Float64:
    """Return each epoch's median at each of its rows."""
    middle, distinct = _common(values, epoch)
    return middle[np.searchsorted(distinct, epoch)]


def _slope_finding(slope: float, gnss: GnssTable, config: Gnss) -> Finding:
    logged = "range_rate_mps" if np.isfinite(gnss.range_rate_mps).any() else "doppler_hz"
    if abs(slope - 1.0) < SLOPE_TOLERANCE:
        return Finding("ok", "gnss", f"range rates agree with the pseudoranges (ratio {slope:.3f})")
    if abs(slope + 1.0) < SLOPE_TOLERANCE:
        advice = (
            "Doppler has the RINEX sign, positive when the distance shrinks; a range rate the opposite one"
        )
        text = f"range-rate sign reversed: {logged} runs against the pseudoranges"
        return Finding("error", "gnss", text, advice, _SURE, (_other_sign(config),))
    # the column holds the other quantity: with its own sign, or with the sign of what it was taken for
    turned = (_other_sign(config),) if slope > 0.0 else ()
    wavelength = _usual_wavelength_m(gnss)
    if logged == "range_rate_mps" and abs(abs(slope) / wavelength - 1.0) < SLOPE_TOLERANCE:
        sign = " and the sign of a range rate" if slope > 0.0 else ", with the sign of Doppler"
        proposals = (*_mapped(config, "doppler", "range_rate"), *turned)
        advice = "map the column as gnss.columns.doppler"
        return Finding(
            "error", "gnss", f"range_rate_mps looks like Doppler in Hz{sign}", advice, _SURE, proposals
        )
    if logged == "doppler_hz" and abs(abs(slope) * wavelength - 1.0) < SLOPE_TOLERANCE:
        sign = " with the sign of a range rate" if slope < 0.0 else ""
        proposals = (*_mapped(config, "range_rate", "doppler"), *turned)
        advice = "map the column as gnss.columns.range_rate if it is positive when the distance grows"
        text = f"doppler_hz looks like metres per second{sign}"
        return Finding("error", "gnss", text, advice, _SURE, proposals)
    text = f"range rates and pseudoranges disagree: pseudoranges change {slope:.3g} times as fast"
    return Finding("error", "gnss", text, "check the unit and the signal codes", kind=RATES_CONTRADICT)


def _other_sign(config: Gnss) -> Proposal:
    value = "reversed" if config.rate_sign == "standard" else "standard"
    return Proposal(
        "gnss.rate_sign", value, "the range rates and the change of the pseudoranges have opposite signs"
    )


def _mapped(config: Gnss, wanted: str, logged: str) -> tuple[Proposal, ...]:
    """Return the mapping of the column that is read as ``logged`` to ``wanted``."""
    if config.format != "csv":
        return ()
    column = str(getattr(config.columns, logged))
    why = f"'{column}' changes with the pseudoranges as a {wanted.replace('_', ' ')} does"
    return (
        Proposal(f"gnss.columns.{wanted}", column, why),
        Proposal(f"gnss.columns.{logged}", NO_COLUMN, why),
    )


def _usual_wavelength_m(gnss: GnssTable) -> float:
    """Return the wavelength of the log's most frequent signal, of GLONASS that of channel 0 [m]."""
    n = max(len(gnss.signal_names), 1)
    pairs, count = np.unique(gnss.sv.astype(np.int64) * n + gnss.signal, return_counts=True)
    most = int(pairs[np.argmax(count)])
    return wavelength_m(gnss.sv_names[most // n][0], gnss.signal_names[most % n], 0)


def jump_findings(pairs: RatePairs, t_ns: Int64, week: int) -> list[Finding]:
    """Report common steps of all pseudoranges against the range rates."""
    if not len(pairs.epoch):
        return []
    step_m, at = _common((pairs.from_code - pairs.from_rate) * pairs.dt_s, pairs.epoch)
    real, leaps = clock_jumps(step_m)
    findings = []
    if len(real):
        first = float(ns_to_week_seconds(t_ns[at[real[0]]], week))
        size = float(np.median(np.abs(step_m[real]))) / C_MPS * 1e3
        text = f"the receiver's clock jumps {len(real)} time(s), typically by {size:.3g} ms, first at {first:.3f} s"
        findings.append(Finding("ok" if len(real) < 0.5 * len(at) else "warning", "gnss", text))
    if len(leaps):
        first = float(ns_to_week_seconds(t_ns[at[leaps[0]]], week))
        findings.append(leaps_finding(step_m[leaps], f", first at {first:.3f} s"))
    return findings


def clock_jumps(step_m: Float64) -> tuple[Int64, Int64]:
    """Return where a receiver's clock jumps, and where it leaps and does not, of (n,) steps beyond its drift [m].

    A leap that the next epoch takes back is one bad epoch and does not count as a jump.
    """
    beyond = np.flatnonzero(np.abs(step_m) > CLOCK_JUMP_M)
    back = _taken_back(step_m[beyond], beyond)
    left = beyond[~back]
    agree = jumps_that_agree(step_m[left])
    return left[agree], np.sort(np.concatenate((beyond[back], left[~agree])))


def _taken_back(size_m: Float64, at: Int64) -> Bool:
    """Return (n,) which leaps are one of a pair, the second undoing the first at the next epoch."""
    back = np.zeros(len(size_m), np.bool_)
    noise_m = np.maximum(CLOCK_JUMP_M, JUMP_TOLERANCE * np.abs(size_m))
    for k in range(len(size_m) - 1):
        if not back[k] and at[k + 1] == at[k] + 1 and abs(size_m[k] + size_m[k + 1]) <= noise_m[k]:
            back[k : k + 2] = True
    return back


def jumps_that_agree(size_m: Float64) -> Bool:
    """Return (n,) which leaps of the clock are jumps of a receiver: all of one sign and size, or multiples of it.

    One alone is a jump; of several, those that agree are jumps if they are more than half of all.
    """
    if len(size_m) < 2:
        return np.ones(len(size_m), np.bool_)
    times = np.rint(size_m[None, :] / size_m[:, None])  # of each row's size
    off_m = np.abs(size_m[None, :] - times * size_m[:, None])
    fits = (times >= 1.0) & (off_m <= np.maximum(CLOCK_JUMP_M, JUMP_TOLERANCE * np.abs(size_m[:, None])))
    fits &= np.abs(size_m[:, None]) > 2.0 * CLOCK_JUMP_M  # of a smaller one nearly everything is a multiple
    best = fits[np.argmax(fits.sum(axis=1))]
    return np.asarray(best if 2 * best.sum() > len(best) else np.zeros(len(size_m), np.bool_))


def leaps_finding(size_m: Float64, where: str = "") -> Finding:
    """Return the finding on clock leaps that are not clock jumps but epochs with wrong pseudoranges."""
    least, most = np.abs(size_m).min() / C_MPS * 1e3, np.abs(size_m).max() / C_MPS * 1e3
    text = (
        f"the clock offset leaps {len(size_m)} time(s) by {least:.2g} to {most:.2g} ms{where}, and returns at the next"
        " epoch or differs in size each time: bad epochs, not jumps of the receiver's clock"
    )
    return Finding("warning", "gnss", text, "'insgnss point' shows their residuals", kind=CLOCK_LEAPS)
