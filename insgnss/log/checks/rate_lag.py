"""The lag of the range rates behind the motion, estimated from the ranges alone, without inertial data.

A receiver that smooths its Doppler, or takes it over an interval, gives the rate of an earlier time. Smoothed twice by
T/2 (``filter.rows.late_rates``), the rate r obeys  range' = r + T r' + ...,  so that in a window

    y(t) = range(t) - integral of r dt = c + d t + T r(t) + noise.

c and the trend d (a bias of the rate, the divergence of code and carrier) are of each satellite and signal; the mean of
all of them holds the receiver's clock. T follows by least squares from x, the rates, and y, both freed from these: P x
and P y. Noise of the rates with the variance s2 is in both, with the trapezoid L of the integral:

    E[x^T P y] = T x^T P x - s2 tr(P L),   E[x^T P x] = that of the motion + s2 tr(P)

s2 comes from third differences. Windows in which the motion does not exceed this noise are not used. The sigma is that
of the scatter of windows and satellites. Neglects: what r does between two epochs, which the trapezoid adds in
quadrature to r; noise of the rates that is correlated from epoch to epoch.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from insgnss.config.flight import LONGEST_LAG_S
from insgnss.constants import NS_PER_S
from insgnss.log.checks.report import Finding, Proposal
from insgnss.log.checks.time_offset import (
    SIGNIFICANT_SIGMAS,
    SMALLEST_S,
    SUSPECT_SIGMAS,
    RatesInTime,
)
from insgnss.log.checks.track import GnssTrack, between_epochs
from insgnss.tables import Float64, GnssTable

# Short windows keep errors of the pseudoranges out that persist, long ones have more motion: all are tried
CODE_WINDOWS_S: Final = (8.0, 15.0, 30.0)
CARRIER_WINDOWS_S: Final = (6.0, 12.0)  # longer ones have slips
LEAST_EPOCHS: Final = 7
LEAST_CHANNELS: Final = 3
LEAST_WINDOWS: Final = 3.0  # with motion, by their weight
ABOVE_NOISE: Final = 4.0  # variance of the rates in a window, to their noise
PASSES: Final = 4  # of the weights
_GAP_STEPS: Final = 1.5
_KNOWN_S: Final = 0.5  # a larger sigma says nothing
_SUSPECT_S: Final = 0.02  # as of the filter: with 2 m/s^2 less is below the noise of a velocity
_THIRD: Final = 20.0  # 1 + 9 + 9 + 1: the variance of third differences


class RateLag(NamedTuple):
    """How far the range rates are behind the ranges."""

    late_s: float
    sd_s: float
    by: str  # "carrier phases" or "pseudoranges"


class KnownLag(NamedTuple):
    """The lag that a comparison with other sensors takes out, and what the ranges say of the rest."""

    used_s: float  # declared, or that of the ranges where they contradict it
    sd_s: float  # of the used one
    rest: RateLag | None  # beyond the used one; None where the ranges do not show it
    findings: tuple[Finding, ...] = ()

    @property
    def in_time(self) -> RatesInTime:
        """The lag as another explanation of an offset of the inertial tags."""
        rest_s, sd_s = (0.0, np.inf) if self.rest is None else (self.rest.late_s, self.rest.sd_s)
        return RatesInTime(self.used_s, rest_s, sd_s)

    def velocities(self, track: GnssTrack) -> GnssTrack:
        """Return the track with each velocity at its own time; the places stay with them."""
        sd_time_s = float(np.hypot(track.sd_time_s, self.sd_s))
        return replace(track, t_s=track.t_s - self.used_s, sd_time_s=sd_time_s, late_s=self.used_s)

    def at_epochs(self, track: GnssTrack) -> GnssTrack:
        """Return the track with the velocities of its own times, linear between the epochs.

        An epoch is left out whose velocity comes after a gap of the log, or after its end.
        """
        if self.used_s == 0.0 or len(track.t_s) < LEAST_EPOCHS:
            return track
        at_s = track.t_s + self.used_s
        v_e = np.column_stack([np.interp(at_s, track.t_s, v) for v in track.v_e.T])
        known = between_epochs(track.t_s, at_s)
        epochs = {
            name: getattr(track, name)[known] for name in ("t_s", "r_e", "sd_v_mps", "clock_m", "drift_mps")
        }
        return replace(track, v_e=v_e[known], **epochs)


def known_lag(gnss: GnssTable, rates: Float64, carriers_m: Float64 | None, declared_s: float) -> KnownLag:
    """Return the lag of the range rates by declaration and ranges, with the findings on it.

    Parameters
    ----------
    rates : (n,) of the rows of ``gnss``, positive when the distance grows [m/s]
    carriers_m : (n,) wavelength times carrier phase, None without
    declared_s : ``gnss.range_rate_lag_s``
    """
    lag = best_lag(gnss, rates, carriers_m)
    if lag is None or lag.sd_s > _KNOWN_S:
        return KnownLag(declared_s, 0.0, None)
    rest = lag._replace(late_s=lag.late_s - declared_s)
    finding = _finding(lag, rest.late_s, declared_s)
    if not finding.proposals:
        return KnownLag(declared_s, 0.0, rest, (finding,))
    used_s = max(lag.late_s, 0.0)
    return KnownLag(used_s, lag.sd_s, lag._replace(late_s=lag.late_s - used_s), (finding,))


def _finding(lag: RateLag, rest_s: float, declared_s: float) -> Finding:
    estimate = f"{lag.late_s:+.3f} s by the {lag.by}, sigma {lag.sd_s:.3f} s"
    against = f"; declared: {declared_s:.3f} s" if declared_s else ""
    if abs(rest_s) <= max(SUSPECT_SIGMAS * lag.sd_s, _SUSPECT_S):
        text = (
            "the range rates lag as declared"
            if declared_s
            else f"the {lag.by} show no lag of the range rates"
        )
        return Finding("ok", "gnss", f"{text}: {estimate}{against}")
    how = "less than declared" if rest_s < 0.0 else "behind the motion"
    text = f"the range rates lag {how}: {estimate}{against}"
    sigmas = f"{abs(rest_s) / lag.sd_s:.1f} sigma"
    if lag.late_s < -max(SUSPECT_SIGMAS * lag.sd_s, _SUSPECT_S) or lag.late_s > LONGEST_LAG_S:
        text = f"range rates and {lag.by} do not agree in time: the rates' lag is {estimate}{against}"
        advice = f"suspected: {lag.by} that the receiver smooths or dates late; no key of the flight file corrects this"
        return Finding("warning", "gnss", text, advice, sigmas)
    late_s = round(max(lag.late_s, 0.0), 3)
    if abs(rest_s) <= max(SIGNIFICANT_SIGMAS * lag.sd_s, SMALLEST_S) or lag.sd_s > SMALLEST_S:
        advice = f"suspected gnss.range_rate_lag_s = {late_s}; more turns, runs and stops decide"
        return Finding("warning", "gnss", text, advice, sigmas)
    why = f"the change of the {lag.by} is ahead of the range rates"
    return Finding(
        "error", "gnss", text, "", f"sure: {sigmas}", (Proposal("gnss.range_rate_lag_s", late_s, why),)
    )


class _Window(NamedTuple):
    """Sums over the epochs of one window, for each of its channels (c,)."""

    xx: Float64
    xy: Float64
    yy: Float64
    epochs: int


def best_lag(gnss: GnssTable, rates: Float64, carriers_m: Float64 | None) -> RateLag | None:
    """Return the lag with the least sigma, by carrier phases or pseudoranges; None where too little moves.

    Parameters
    ----------
    rates : (n,) of the rows of ``gnss``, positive when the distance grows [m/s]
    carriers_m : (n,) wavelength times carrier phase, None without
    """
    tried = [rate_lag(gnss, gnss.pseudorange_m, rates, s, "pseudoranges") for s in CODE_WINDOWS_S]
    if carriers_m is not None:
        tried += [rate_lag(gnss, carriers_m, rates, s, "carrier phases") for s in CARRIER_WINDOWS_S]
    return min((one for one in tried if one is not None), key=lambda one: one.sd_s, default=None)


def rate_lag(gnss: GnssTable, ranges: Float64, rates: Float64, length_s: float, by: str) -> RateLag | None:
    """Return the lag by windows of ``length_s``; None where too little moves."""
    windows = list(_windows(gnss, ranges, rates, length_s))
    if len(windows) < LEAST_WINDOWS:
        return None
    xx, xy, yy = (np.concatenate(parts) for parts in zip(*[w[:3] for w in windows], strict=True))
    window = np.repeat(np.arange(len(windows)), [len(w.xx) for w in windows])
    epochs = np.array([w.epochs for w in windows])[window]
    late_s, weight = 0.0, np.ones_like(xx)
    for _ in range(PASSES):
        if np.sum(weight * xx) <= 0.0:  # freed from noise: little but noise is left
            return None
        variance = np.maximum(yy - 2.0 * late_s * xy + late_s**2 * xx, 0.0) / epochs
        weight = 1.0 / (variance + max(float(np.median(variance)), 1e-12))
        late_s = float(np.sum(weight * xy) / np.sum(weight * xx))
    each = weight * (xy - late_s * xx)
    information = np.bincount(window, weight * xx)
    total = float(information.sum())
    count = total**2 / float(np.sum(information**2))
    if total <= 0.0 or count < LEAST_WINDOWS:
        return None
    scatter2 = max(float(np.sum(np.bincount(window, each) ** 2)), float(np.sum(each**2)))
    return RateLag(late_s, float(np.sqrt(scatter2 * count / (count - 1.0))) / total, by)


def _windows(gnss: GnssTable, ranges: Float64, rates: Float64, length_s: float) -> Iterator[_Window]:
    """Yield the windows without a gap in which the motion stands out of the noise."""
    t_ns, start = np.unique(gnss.t_ns, return_index=True)
    t_s = (t_ns - t_ns[0]) / NS_PER_S
    if len(t_s) < LEAST_EPOCHS:
        return
    start = np.append(start, len(gnss.t_ns))
    step_s = float(np.median(np.diff(t_s)))
    n = max(round(length_s / step_s) + 1, LEAST_EPOCHS)
    channel = gnss.sv.astype(np.int64) * len(gnss.signal_names) + gnss.signal
    breaks = np.flatnonzero(np.diff(t_s) > _GAP_STEPS * step_s) + 1
    for begin, end in pairwise([0, *breaks.tolist(), len(t_s)]):
        for first in range(begin, end - n + 1, n - 1):
            rows = slice(start[first], start[first + n])
            epoch = np.repeat(np.arange(n), np.diff(start[first : first + n + 1]))
            names, column = np.unique(channel[rows], return_inverse=True)
            z, r = np.full((n, len(names)), np.nan), np.full((n, len(names)), np.nan)
            z[epoch, column], r[epoch, column] = ranges[rows], rates[rows]
            whole = np.isfinite(z).all(axis=0) & np.isfinite(r).all(axis=0)
            if whole.sum() >= LEAST_CHANNELS:
                window = _window(t_s[first : first + n], z[:, whole], r[:, whole])
                if window is not None:
                    yield window


def _window(t_s: Float64, z: Float64, r: Float64) -> _Window | None:
    """Return the sums of one window, freed from the noise of the rates; None where they are little else."""
    z, r = (values - values.mean(axis=1, keepdims=True) for values in (z, r))
    n = len(t_s)
    trend, _ = np.linalg.qr(np.column_stack([np.ones(n), t_s - t_s.mean()]))
    x, y = (values - trend @ (trend.T @ values) for values in (r, z - _integral(t_s, r)))
    trace = 0.5 * (t_s[-1] - t_s[0]) - float(np.sum(trend * _integral(t_s, trend)))  # tr(P L)
    s2 = np.mean(np.diff(r, 3, axis=0) ** 2, axis=0) / _THIRD
    noise = s2 * (n - 2)
    xx, xy = np.sum(x**2, axis=0) - noise, np.sum(x * y, axis=0) + s2 * trace
    if xx.sum() < ABOVE_NOISE * noise.sum():
        return None
    return _Window(xx, xy, np.sum(y**2, axis=0), n)


def _integral(t_s: Float64, values: Float64) -> Float64:
    """Return the integral of each column from the first time on, by the trapezoid rule."""
    steps = 0.5 * np.diff(t_s)[:, None] * (values[1:] + values[:-1])
    return np.concatenate((np.zeros((1, values.shape[1])), np.cumsum(steps, axis=0)))
