"""What a GNSS log shows before any filter runs: epochs, satellites, range-rate sign and unit, clock jumps, doubles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from insgnss.constants import C_MPS, NS_PER_S
from insgnss.gnss.ephemeris_choice import VALIDITY_S
from insgnss.gnss.satellite_state import range_rates
from insgnss.gnss.signals import CHANNELS, wavelength_m
from insgnss.gpstime import ns_to_week_seconds
from insgnss.log.gnss_rows import epochs
from insgnss.log.report import Finding
from insgnss.tables import Float64, GnssTable, Int64, NavigationData

MAX_PAIR_S: Final = 5.0  # a longer step lets the range rate change too much to be compared with the mean
GAP_STEPS: Final = 2.5
MIN_PAIRS: Final = 10
# Differences of range rate between satellites below this say nothing about sign and unit
MIN_RATE_MPS: Final = 30.0
SLOPE_TOLERANCE: Final = 0.15
# A common step of half a microsecond: no receiver clock wanders so far within an epoch
CLOCK_JUMP_M: Final = 150.0
MIN_SATELLITES: Final = 4


@dataclass(frozen=True)
class _Pairs:
    """The same satellite and signal in two successive epochs."""

    epoch: Int64  # (p,) index of the later epoch
    from_code: Float64  # (p,) change of pseudorange over time [m/s]
    from_rate: Float64  # (p,) mean of the two range rates [m/s]
    dt_s: Float64  # (p,)


def gnss_findings(gnss: GnssTable, week: int, channels: Mapping[str, int] | None = None) -> list[Finding]:
    """Return what a GNSS log shows by itself; ``channels`` of GLONASS are those of the log when None."""
    t_ns, starts = epochs(gnss)
    findings = [_span_finding(t_ns, week), *_gap_findings(t_ns, week), *_satellite_findings(gnss, starts)]
    findings += _duplicate_findings(gnss, starts)
    channels = gnss.glonass_channels if channels is None else channels
    findings += _channel_findings(gnss, channels)
    pairs = _pairs(gnss, t_ns, starts, range_rates(gnss, channels))
    return findings + _rate_findings(gnss, pairs) + _clock_findings(pairs, t_ns, week)


def _span_finding(t_ns: Int64, week: int) -> Finding:
    first, last = ns_to_week_seconds(t_ns[[0, -1]], week)
    step = float(np.median(np.diff(t_ns))) / NS_PER_S if len(t_ns) > 1 else float("nan")
    text = f"{len(t_ns)} epochs, {first:.3f} to {last:.3f} s of week {week} ({last - first:.1f} s), every {step:.4g} s"
    return Finding("ok", "gnss", text)


def _gap_findings(t_ns: Int64, week: int) -> list[Finding]:
    if len(t_ns) < 3:
        return []
    step = np.diff(t_ns)
    gaps = np.flatnonzero(step > GAP_STEPS * np.median(step))
    if not len(gaps):
        return []
    longest = gaps[np.argmax(step[gaps])]
    start = float(ns_to_week_seconds(t_ns[longest], week))
    text = f"{len(gaps)} gap(s), the longest {step[longest] / NS_PER_S:.4g} s from {start:.3f} s on"
    return [Finding("warning", "gnss", text)]


def _satellite_findings(gnss: GnssTable, starts: Int64) -> list[Finding]:
    findings = []
    usable = np.isfinite(gnss.pseudorange_m)
    count = _distinct_per_epoch(gnss, starts, usable)
    systems: dict[str, set[str]] = {}
    for code, index in zip(*np.unique(np.stack([gnss.signal, gnss.sv]), axis=1), strict=True):
        systems.setdefault(f"{gnss.sv_names[index][0]} {gnss.signal_names[code]}", set()).add(
            gnss.sv_names[index]
        )
    listed = ", ".join(f"{name} ({len(found)})" for name, found in sorted(systems.items()))
    findings.append(Finding("ok", "gnss", f"signals (satellites): {listed}"))
    text = f"satellites with a pseudorange per epoch: {count.min()} to {count.max()}, median {np.median(count):.0f}"
    few = int(np.count_nonzero(count < MIN_SATELLITES))
    empty = int(np.count_nonzero(count == 0))
    findings.append(Finding("ok", "gnss", text))
    if few:
        text = f"{few} of {len(count)} epochs with fewer than {MIN_SATELLITES} satellites, {empty} with none"
        findings.append(Finding("warning", "gnss", text))
    missing = [
        name
        for name, columns in (
            ("range rate", (gnss.range_rate_mps, gnss.doppler_hz)),
            ("C/N0", (gnss.cn0_dbhz,)),
        )
        if not any(np.isfinite(values).any() for values in columns)
    ]
    if missing:
        findings.append(Finding("warning", "gnss", f"no {' and no '.join(missing)} in the log"))
    return findings


def _distinct_per_epoch(
    gnss: GnssTable, starts: Int64, which: np.ndarray[tuple[int], np.dtype[np.bool_]]
) -> Int64:
    """Return how many different satellites have a chosen row in each epoch."""
    epoch = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    keys = np.unique(epoch[which] * len(gnss.sv_names) + gnss.sv[which])
    return np.bincount(keys // len(gnss.sv_names), minlength=len(starts) - 1)


def _duplicate_findings(gnss: GnssTable, starts: Int64) -> list[Finding]:
    epoch = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    keys = (epoch * len(gnss.sv_names) + gnss.sv) * len(gnss.signal_names) + gnss.signal
    distinct, first, count = np.unique(keys, return_index=True, return_counts=True)
    twice = np.flatnonzero(count > 1)
    if not len(twice):
        return []
    example = first[twice[0]]
    name, code = gnss.sv_names[gnss.sv[example]], gnss.signal_names[gnss.signal[example]]
    rows = len(keys) - len(distinct)
    text = f"{rows} row(s) repeat a satellite and signal within an epoch, first {name} {code}"
    return [Finding("warning", "gnss", text, "the first of each counts")]


def _channel_findings(gnss: GnssTable, channels: Mapping[str, int]) -> list[Finding]:
    """Report GLONASS satellites whose frequency nothing tells: they are not used."""
    unknown = [
        name
        for index, name in enumerate(gnss.sv_names)
        if name[0] == "R" and channels.get(name) not in CHANNELS and (gnss.sv == index).any()
    ]
    if not unknown:
        return []
    text = f"no frequency channel of {', '.join(sorted(unknown))}: not used"
    return [Finding("warning", "gnss", text, "give them as gnss.glonass_channels, or GLONASS messages")]


def _pairs(gnss: GnssTable, t_ns: Int64, starts: Int64, rate: Float64) -> _Pairs:
    """Return the rows that have the same satellite and signal in the epoch before, the first where it stands twice."""
    epoch = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    channel = gnss.sv.astype(np.int64) * len(gnss.signal_names) + gnss.signal
    keys, row = np.unique(channel * (len(t_ns) + 1) + epoch, return_index=True)
    later = np.flatnonzero(np.diff(keys) == 1) + 1
    a, b = row[later - 1], row[later]
    dt_s = (gnss.t_ns[b] - gnss.t_ns[a]) / NS_PER_S
    pairs = _Pairs(
        epoch[b], (gnss.pseudorange_m[b] - gnss.pseudorange_m[a]) / dt_s, 0.5 * (rate[a] + rate[b]), dt_s
    )
    used = (dt_s <= MAX_PAIR_S) & np.isfinite(pairs.from_code) & np.isfinite(pairs.from_rate)
    return _Pairs(pairs.epoch[used], pairs.from_code[used], pairs.from_rate[used], dt_s[used])


def _common(values: Float64, epoch: Int64) -> tuple[Float64, Int64]:
    """Return the median of the values of each epoch, and the epochs."""
    order = np.lexsort((values, epoch))
    distinct, start, count = np.unique(epoch[order], return_index=True, return_counts=True)
    middle = values[order]
    return 0.5 * (middle[start + (count - 1) // 2] + middle[start + count // 2]), distinct


def _rate_findings(gnss: GnssTable, pairs: _Pairs) -> list[Finding]:
    """Compare range rates with the change of the pseudoranges, both against the epoch's median (no receiver clock)."""
    if not len(pairs.epoch):
        return []
    code = pairs.from_code - _spread(pairs.from_code, pairs.epoch)
    rate = pairs.from_rate - _spread(pairs.from_rate, pairs.epoch)
    fast = (np.abs(code) > MIN_RATE_MPS) & (rate != 0.0)
    if fast.sum() < MIN_PAIRS:
        return [Finding("ok", "gnss", "too little relative motion to judge sign and unit of the range rates")]
    slope = float(np.median(code[fast] / rate[fast]))
    return [_slope_finding(slope, gnss)]


def _spread(values: Float64, epoch: Int64) -> Float64:
    """Return each epoch's median at each of its rows."""
    middle, distinct = _common(values, epoch)
    return middle[np.searchsorted(distinct, epoch)]


def _slope_finding(slope: float, gnss: GnssTable) -> Finding:
    logged = "range_rate_mps" if np.isfinite(gnss.range_rate_mps).any() else "doppler_hz"
    if abs(slope - 1.0) < SLOPE_TOLERANCE:
        return Finding("ok", "gnss", f"range rates agree with the pseudoranges (ratio {slope:.3f})")
    if abs(slope + 1.0) < SLOPE_TOLERANCE:
        advice = (
            "Doppler has the RINEX sign, positive when the distance shrinks; a range rate the opposite one"
        )
        return Finding(
            "error", "gnss", f"range-rate sign reversed: {logged} runs against the pseudoranges", advice
        )
    sign = "" if slope > 0.0 else " and the sign reversed"
    wavelength = _usual_wavelength_m(gnss)
    if logged == "range_rate_mps" and abs(abs(slope) / wavelength - 1.0) < SLOPE_TOLERANCE:
        sign = " and the sign of a range rate" if slope > 0.0 else ", with the sign of Doppler"
        advice = "map the column as gnss.columns.doppler"
        return Finding("error", "gnss", f"range_rate_mps looks like Doppler in Hz{sign}", advice)
    if logged == "doppler_hz" and abs(abs(slope) * wavelength - 1.0) < SLOPE_TOLERANCE:
        sign = " with the sign of a range rate" if slope < 0.0 else ""
        advice = "map the column as gnss.columns.range_rate if it is positive when the distance grows"
        return Finding("error", "gnss", f"doppler_hz looks like metres per second{sign}", advice)
    text = f"range rates and pseudoranges disagree: pseudoranges change {slope:.3g} times as fast"
    return Finding("error", "gnss", text, "check the unit and the signal codes")


def _usual_wavelength_m(gnss: GnssTable) -> float:
    """Return the wavelength of the log's most frequent signal, of GLONASS that of channel 0 [m]."""
    n = max(len(gnss.signal_names), 1)
    pairs, count = np.unique(gnss.sv.astype(np.int64) * n + gnss.signal, return_counts=True)
    most = int(pairs[np.argmax(count)])
    return wavelength_m(gnss.sv_names[most // n][0], gnss.signal_names[most % n], 0)


def _clock_findings(pairs: _Pairs, t_ns: Int64, week: int) -> list[Finding]:
    """Report common steps of all pseudoranges against the range rates."""
    if not len(pairs.epoch):
        return []
    step_m, at = _common((pairs.from_code - pairs.from_rate) * pairs.dt_s, pairs.epoch)
    jumps = np.flatnonzero(np.abs(step_m) > CLOCK_JUMP_M)
    if not len(jumps):
        return []
    first = float(ns_to_week_seconds(t_ns[at[jumps[0]]], week))
    size = float(np.median(np.abs(step_m[jumps]))) / C_MPS * 1e3
    text = (
        f"the receiver's clock jumps {len(jumps)} time(s), typically by {size:.3g} ms, first at {first:.3f} s"
    )
    return [Finding("ok" if len(jumps) < 0.5 * len(at) else "warning", "gnss", text)]


def ephemeris_findings(gnss: GnssTable, navigation: NavigationData) -> list[Finding]:
    """Return how well the navigation data cover the log: per system, per epoch, and which satellites lack it."""
    messages = _messages(navigation)
    counts: dict[str, int] = {}
    for name in messages.sv_names:
        counts[name[0]] = counts.get(name[0], 0) + 1
    listed = ", ".join(f"{count} {system}" for system, count in sorted(counts.items()))
    findings = [Finding("ok", "navigation", f"messages: {listed}")]
    _, starts = epochs(gnss)
    covered = _covered_rows(gnss, messages)
    count = _distinct_per_epoch(gnss, starts, covered & np.isfinite(gnss.pseudorange_m))
    few = int(np.count_nonzero(count < MIN_SATELLITES))
    spread = f"{count.min()} to {count.max()}, median {np.median(count):.0f}"
    text = f"satellites with a current ephemeris per epoch: {spread}"
    if few:
        text += f"; {few} of {len(count)} epochs with fewer than {MIN_SATELLITES}"
    findings.append(Finding("warning" if few else "ok", "navigation", text))
    without = [
        name
        for index, name in enumerate(gnss.sv_names)
        if (gnss.sv == index).any() and not covered[gnss.sv == index].any() and name[0] in VALIDITY_S
    ]
    if without:
        text = f"no current ephemeris for {', '.join(sorted(without))}"
        findings.append(
            Finding("warning", "navigation", text, "add navigation files of the hours of the flight")
        )
    unhealthy = sorted({name for name, h in zip(messages.sv_names, messages.health, strict=True) if h != 0.0})
    if unhealthy:
        findings.append(
            Finding("ok", "navigation", f"marked unhealthy by their own message: {', '.join(unhealthy)}")
        )
    if navigation.klobuchar is None:
        text = "no ionosphere coefficients in the navigation file"
        findings.append(
            Finding("warning", "navigation", text, "expect metres of ionospheric delay on single frequencies")
        )
    return findings


class _Messages(NamedTuple):
    """What the messages of both kinds say of their use."""

    sv_names: tuple[str, ...]
    t_ns: Int64  # (n,) reference time
    limit_s: Float64  # (n,) how far from it each may be used
    health: Float64  # (n,)


def _messages(navigation: NavigationData) -> _Messages:
    """Return ephemerides and, behind them, states to be integrated."""
    table, states = navigation.ephemerides, navigation.state_vectors
    usual = np.array([VALIDITY_S.get(name[0], 7200.0) for name in table.sv_names])
    limit_s = np.where(table.fit_interval_s > 0.0, 0.5 * table.fit_interval_s, usual)
    if states is None:
        return _Messages(table.sv_names, table.toe_ns, limit_s, table.health)
    of_states = np.array([VALIDITY_S.get(name[0], 0.0) for name in states.sv_names])
    return _Messages(
        (*table.sv_names, *states.sv_names),
        np.concatenate([table.toe_ns, states.t_ns]),
        np.concatenate([limit_s, of_states]),
        np.concatenate([table.health, states.health]),
    )


def _covered_rows(gnss: GnssTable, messages: _Messages) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return which rows have a message of their satellite within its time of use."""
    names = np.array(messages.sv_names)
    covered = np.zeros(len(gnss.t_ns), np.bool_)
    for index, name in enumerate(gnss.sv_names):
        rows = np.flatnonzero(gnss.sv == index)
        own = np.flatnonzero(names == name)
        if not len(own) or not len(rows):
            continue
        order = own[np.argsort(messages.t_ns[own], kind="stable")]
        nearest = np.searchsorted(messages.t_ns[order], gnss.t_ns[rows])
        for candidate in (np.maximum(nearest - 1, 0), np.minimum(nearest, len(own) - 1)):
            which = order[candidate]
            away_ns = np.abs(gnss.t_ns[rows] - messages.t_ns[which])
            covered[rows] |= away_ns <= messages.limit_s[which] * NS_PER_S
    return covered
