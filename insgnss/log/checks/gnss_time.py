"""Whether the GNSS tags are GPS time of the stated week: only then do the pseudoranges agree on a position.

Satellites move by 4 km a second: tags that are off by leap seconds, hours or weeks put them where the ranges contradict
each other, or where no message serves; so do tags that are off by a tenth of a second.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from insgnss.constants import NS_PER_S, NS_PER_WEEK, S_PER_WEEK
from insgnss.gpstime import leap_seconds, ns_to_datetime
from insgnss.log.checks.coarse_time import coarse_shift
from insgnss.log.checks.report import Finding, Proposal
from insgnss.log.checks.tag_shift import TagShift, is_refuted, shift_by_ranges
from insgnss.log.checks.time_offset import HOUR_S, SIGNIFICANT_SIGMAS, SMALLEST_S, scale_for, split
from insgnss.log.checks.track import Solve, solved_share
from insgnss.log.flight import Flight
from insgnss.log.gnss_rows import epochs, satellites_per_epoch
from insgnss.log.imu.csv_log import inertial
from insgnss.log.overlap import MOST_HOURS
from insgnss.tables import GnssTable, ImuTable, Int64, NavigationData

TRIED_EPOCHS: Final = 12
AGREEING: Final = 0.7  # of the tried epochs
FOUR: Final = 4  # satellites of an epoch for a place
PLENTY: Final = 6  # so many that masks and a clock for a second system leave enough
LEAST_EPOCHS: Final = 3
NEAR_WHOLE_S: Final = 60.0  # of hours or weeks: a shift is said as them and the rest


class _Shift(NamedTuple):
    """Something to be added to the GNSS tags."""

    weeks: int
    hours: int
    leaps: int

    def seconds(self, leap: int) -> int:
        return self.weeks * S_PER_WEEK + self.hours * HOUR_S + self.leaps * leap


def gnss_time_findings(
    flight: Flight, gnss: GnssTable, navigation: NavigationData | None, imu: ImuTable | None, solve: Solve
) -> list[Finding]:
    """Return the error of the GNSS tags: weeks, hours, leap seconds, or any time up to 14 hours.

    The pseudoranges show it. With few satellites only whole weeks, hours and leap seconds are sought, and several may
    do: then the one that makes the logs overlap counts. Epochs with fewer than four satellites of known messages say
    nothing.
    """
    if navigation is None or not navigation.has_messages or gnss.sat is not None:
        return []
    count = _satellites(gnss, navigation)
    enough = np.flatnonzero(count >= FOUR)
    if len(enough) < LEAST_EPOCHS:
        text = f"{len(enough)} epoch(s) with four satellites and more: whether the tags are GPS time was not compared"
        return [
            Finding("warning", "gnss", text, "log more satellites, or add the missing navigation messages")
        ]
    sample = _sample(gnss, enough)
    agree = solved_share(solve, sample, tested=False) >= AGREEING
    off = _off_by_any(solve, sample, navigation, agree=agree)
    if off is not None:
        return [_finding_of_any(flight, off, sample, imu)]
    if agree:
        return []
    shifts = _fitting(solve, sample, navigation)
    sure = "sure: no other shift does"
    if len(shifts) > 1 and imu is not None:
        leap = leap_seconds(ns_to_datetime(int(sample.t_ns[0])))
        first_ns, last_ns = (int(t) for t in gnss.t_ns[[0, -1]])
        added_ns = [shift.seconds(leap) * NS_PER_S for shift in shifts]
        shifts = [
            shift
            for shift, added in zip(shifts, added_ns, strict=True)
            if first_ns + added <= imu.t_ns[-1] and imu.t_ns[0] <= last_ns + added
        ]
        sure = "likely: of several shifts the one that makes the logs overlap"
    if len(shifts) == 1:
        return [_finding(flight, shifts[0], gnss, sure, imu)]
    text = "no position fits the pseudoranges with the time tags as logged"
    alternatives = f" or shifted by weeks, hours up to {MOST_HOURS} or leap seconds" if not shifts else ""
    if float(np.median(count[enough])) < PLENTY:
        return [
            Finding(
                "warning", "gnss", text + alternatives, "with so few satellites the masks may leave too few"
            )
        ]
    advice = "check the navigation files, and the columns of satellites, signals and pseudoranges"
    return [Finding("error", "gnss", text + alternatives, advice)]


def _off_by_any(
    solve: Solve, sample: GnssTable, navigation: NavigationData, *, agree: bool
) -> TagShift | None:
    """Return the shift, of any size, with which the pseudoranges agree; None if they agree as logged or with none."""
    off = shift_by_ranges(solve, sample, AGREEING)
    if off is not None or agree:
        return off
    begin_s = coarse_shift(sample, navigation, _weeks_to_messages(sample, navigation))
    return None if begin_s is None else shift_by_ranges(solve, sample, AGREEING, begin_s)


def _satellites(gnss: GnssTable, navigation: NavigationData) -> Int64:
    """Return how many satellites with a pseudorange and a message of any time each epoch has."""
    names = set(navigation.ephemerides.sv_names)
    if navigation.state_vectors is not None:
        names |= set(navigation.state_vectors.sv_names)
    known = np.array([name in names for name in gnss.sv_names], np.bool_)
    return satellites_per_epoch(gnss, np.isfinite(gnss.pseudorange_m) & known[gnss.sv])


def _sample(gnss: GnssTable, enough: Int64) -> GnssTable:
    """Return some of the epochs that have satellites enough, spread over the log."""
    _, starts = epochs(gnss)
    chosen = enough[np.unique(np.linspace(0, len(enough) - 1, TRIED_EPOCHS).astype(int))]
    return gnss.take(np.concatenate([np.arange(starts[k], starts[k + 1]) for k in chosen]))


def _fitting(solve: Solve, sample: GnssTable, navigation: NavigationData) -> list[_Shift]:
    """Return the shifts with which the pseudoranges agree, the first group of them that does."""
    leap = leap_seconds(ns_to_datetime(int(sample.t_ns[0])))
    weeks = _weeks_to_messages(sample, navigation)
    hours = [h for h in range(-MOST_HOURS, MOST_HOURS + 1) if h]
    groups = [
        [_Shift(weeks, 0, 0)] if weeks else [],
        [_Shift(weeks, 0, leaps) for leaps in (1, -1)],
        [_Shift(weeks, h, 0) for h in hours],
        [_Shift(weeks, h, leaps) for h in hours for leaps in (1, -1)],
    ]
    for group in groups:
        shifts = []
        for shift in group:
            shifted = sample.later(shift.seconds(leap) * NS_PER_S)
            fits = solved_share(solve, shifted, tested=True) >= AGREEING
            if fits and not is_refuted(solve, shifted, 0.0):
                shifts.append(shift)
        if shifts:
            return shifts
    return []


def _weeks_to_messages(sample: GnssTable, navigation: NavigationData) -> int:
    """Return the whole weeks from the log to the messages."""
    times = navigation.ephemerides.toe_ns
    if navigation.state_vectors is not None:
        times = np.concatenate([times, navigation.state_vectors.t_ns])
    if not len(times):
        return 0
    apart_s = (float(np.median(times)) - float(np.median(sample.t_ns))) / NS_PER_S
    return round(apart_s / S_PER_WEEK)


def _finding(
    flight: Flight, shift: _Shift, gnss: GnssTable, sure: str, imu: ImuTable | None, rest_s: float = 0.0
) -> Finding:
    """Return the finding of weeks, hours or leap seconds and, to be added too, ``rest_s``.

    The week of the flight file is that of both logs: where the inertial log is right, the GNSS tags alone are wrong.
    """
    leap = leap_seconds(ns_to_datetime(int(gnss.t_ns[0])))
    config = flight.config
    words = [f"{shift.weeks:+d} week(s)"] if shift.weeks else []
    words += [f"{shift.hours:+d} hour(s)"] if shift.hours else []
    words += [f"{shift.leaps * leap:+d} leap seconds"] if shift.leaps else []
    words += [f"{rest_s:+.3f} s"] if rest_s else []
    text = f"the pseudoranges agree on a position with the GNSS tags shifted by {' and '.join(words)}"
    why = "only this shift makes the pseudoranges agree on a position"
    proposals = []
    added = shift.hours * HOUR_S + rest_s
    in_week = config.gnss.format == "csv" and config.gnss.counts_in_gps_week
    if shift.weeks and in_week and not _imu_is_right(flight, shift.weeks, gnss, imu):
        proposals.append(Proposal("gps_week", config.gps_week + shift.weeks, why))
    else:
        added += shift.weeks * S_PER_WEEK
    if shift.leaps:
        scale = scale_for(config.gnss.time, shift.leaps) if config.gnss.format == "csv" else None
        if scale is None:
            added += shift.leaps * leap
        else:
            proposals.append(Proposal("gnss.time.scale", scale, why))
    if added:
        proposals.append(Proposal("gnss.time.offset_s", round(config.gnss.time.offset_s + added, 3), why))
    return Finding("error", "gnss", text, "", sure, tuple(proposals))


def _imu_is_right(flight: Flight, weeks: int, gnss: GnssTable, imu: ImuTable | None) -> bool:
    """Return whether the week is that of an inertial log which shares time with the GNSS log shifted by ``weeks``."""
    if imu is None or flight.config.imu is None or not inertial(flight.config).counts_in_gps_week:
        return False
    first_ns, last_ns = (int(t) + weeks * NS_PER_WEEK for t in gnss.t_ns[[0, -1]])
    return bool(first_ns <= imu.t_ns[-1] and imu.t_ns[0] <= last_ns)


def _finding_of_any(flight: Flight, off: TagShift, sample: GnssTable, imu: ImuTable | None) -> Finding:
    """Return the finding of a shift, as weeks, hours or leap seconds where it is them."""
    leap = leap_seconds(ns_to_datetime(int(sample.t_ns[0])))
    weeks, hours, leaps, rest_s = split(off.shift_s, leap)
    if (weeks or hours or leaps) and abs(rest_s) < NEAR_WHOLE_S:
        whole = abs(rest_s) <= max(SIGNIFICANT_SIGMAS * off.sd_s, SMALLEST_S)
        sure = "sure: no other shift does" if whole else f"sure: sigma {off.sd_s:.3f} s"
        return _finding(flight, _Shift(weeks, hours, leaps), sample, sure, imu, 0.0 if whole else rest_s)
    side = "late" if off.shift_s < 0.0 else "early"
    text = (
        f"the GNSS tags are {abs(off.shift_s):.3f} s {side}: the pseudoranges contradict each other as logged and agree"
        " on a position with this shift"
    )
    why = "this shift makes the pseudoranges agree on a position"
    offset_s = round(flight.config.gnss.time.offset_s + off.shift_s, 3)
    proposals = (Proposal("gnss.time.offset_s", offset_s, why),)
    return Finding("error", "gnss", text, "", f"sure: sigma {off.sd_s:.3f} s", proposals)
