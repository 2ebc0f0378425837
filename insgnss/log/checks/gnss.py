"""The check of a GNSS log before any filter runs: epochs, satellites, duplicates, ephemerides."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from insgnss.config.flight import FlightConfig
from insgnss.constants import NS_PER_S
from insgnss.gnss.orbits.ephemeris_choice import VALIDITY_S
from insgnss.gnss.orbits.plausible_messages import plausible_klobuchar
from insgnss.gnss.orbits.satellite_state import range_rates, status_of_given
from insgnss.gnss.signals import CHANNELS
from insgnss.gpstime import ns_to_week_seconds
from insgnss.log.checks.rates import jump_findings, rate_findings, rate_pairs
from insgnss.log.checks.report import Finding
from insgnss.log.checks.track import GNSS_GAP_STEPS
from insgnss.log.gnss_rows import epochs, satellites_per_epoch
from insgnss.status import USED
from insgnss.tables import Bool, Float64, GnssTable, Int64, NavigationData

MIN_SATELLITES: Final = 4


def gnss_findings(
    gnss: GnssTable, config: FlightConfig, channels: Mapping[str, int] | None = None
) -> list[Finding]:
    """Return the findings on a GNSS log by itself; ``channels`` of GLONASS are those of the log when None."""
    week = config.gps_week
    t_ns, starts = epochs(gnss)
    first, last = ns_to_week_seconds(t_ns[[0, -1]], week)
    step = float(np.median(np.diff(t_ns))) / NS_PER_S if len(t_ns) > 1 else float("nan")
    text = f"{len(t_ns)} epochs, {first:.3f} to {last:.3f} s of week {week} ({last - first:.1f} s), every {step:.4g} s"
    findings = [Finding("ok", "gnss", text), *_gap_findings(t_ns, week), *_satellite_findings(gnss, config)]
    findings += _duplicate_findings(gnss, starts)
    channels = gnss.glonass_channels if channels is None else channels
    findings += _channel_findings(gnss, channels)
    pairs = rate_pairs(gnss, t_ns, starts, range_rates(gnss, channels))
    rates = rate_findings(gnss, pairs, config.gnss)
    wrong = any(finding.severity == "error" for finding in rates)  # then every epoch would look like a jump
    return findings + rates + ([] if wrong else jump_findings(pairs, t_ns, week))


def _gap_findings(t_ns: Int64, week: int) -> list[Finding]:
    if len(t_ns) < 3:
        return []
    step = np.diff(t_ns)
    gaps = np.flatnonzero(step > GNSS_GAP_STEPS * np.median(step))
    if not len(gaps):
        return []
    longest = gaps[np.argmax(step[gaps])]
    start = float(ns_to_week_seconds(t_ns[longest], week))
    text = f"{len(gaps)} gap(s), the longest {step[longest] / NS_PER_S:.4g} s from {start:.3f} s on"
    return [Finding("warning", "gnss", text)]


def _satellite_findings(gnss: GnssTable, config: FlightConfig) -> list[Finding]:
    findings = []
    usable = np.isfinite(gnss.pseudorange_m)
    count = satellites_per_epoch(gnss, usable)
    systems: dict[str, set[str]] = {}
    for code, index in zip(*np.unique(np.stack([gnss.signal, gnss.sv]), axis=1), strict=True):
        systems.setdefault(f"{gnss.sv_names[index][0]} {gnss.signal_names[code]}", set()).add(
            gnss.sv_names[index]
        )
    listed = ", ".join(f"{name} ({len(satellites)})" for name, satellites in sorted(systems.items()))
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
        is_table = config.gnss.format == "csv"
        advice = "if the log has such a column, name it under gnss.columns" if is_table else ""
        findings.append(Finding("warning", "gnss", f"no {' and no '.join(missing)} in the log", advice))
    return findings


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
    return [Finding("warning", "gnss", text, "the first of each is used")]


def _channel_findings(gnss: GnssTable, channels: Mapping[str, int]) -> list[Finding]:
    """Report GLONASS satellites of unknown frequency: they are not used."""
    unknown = [
        name
        for index, name in enumerate(gnss.sv_names)
        if name[0] == "R" and channels.get(name) not in CHANNELS and (gnss.sv == index).any()
    ]
    if not unknown:
        return []
    text = f"no frequency channel of {', '.join(sorted(unknown))}: not used"
    return [
        Finding(
            "warning",
            "gnss",
            text,
            "declare them as gnss.glonass_channels, or add GLONASS navigation messages",
        )
    ]


def ephemeris_findings(gnss: GnssTable, navigation: NavigationData) -> list[Finding]:
    """Return the coverage of the log by navigation data: per system, per epoch, and the satellites without any."""
    messages = _messages(navigation)
    counts: dict[str, int] = {}
    for name in messages.sv_names:
        counts[name[0]] = counts.get(name[0], 0) + 1
    listed = ", ".join(f"{count} {system}" for system, count in sorted(counts.items()))
    findings = [Finding("ok", "navigation", f"messages: {listed}")]
    covered = _covered_rows(gnss, messages)
    if gnss.sat is not None:
        covered |= status_of_given(gnss.sat) == USED
    count = satellites_per_epoch(gnss, covered & np.isfinite(gnss.pseudorange_m))
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
        findings.append(Finding("warning", "navigation", text, "add navigation files that cover the flight"))
    unhealthy = sorted({name for name, h in zip(messages.sv_names, messages.health, strict=True) if h != 0.0})
    if unhealthy:
        findings.append(
            Finding("ok", "navigation", f"marked unhealthy by their own message: {', '.join(unhealthy)}")
        )
    return findings


def ionosphere_findings(navigation: NavigationData | None) -> list[Finding]:
    """Return a warning where neither log nor navigation files have the coefficients of GPS's ionosphere model."""
    if navigation is not None and plausible_klobuchar(navigation.klobuchar) is not None:
        return []
    text = "no ionosphere coefficients in the log or a navigation file"
    advice = "expect 5 to 20 m of ionospheric delay on single frequencies; name the day's navigation file"
    return [Finding("warning", "navigation", text, advice)]


class _Messages(NamedTuple):
    """Health and age of the messages of both kinds."""

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


def _covered_rows(gnss: GnssTable, messages: _Messages) -> Bool:
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
