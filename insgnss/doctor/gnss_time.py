"""Whether the GNSS tags are GPS time of the stated week: only then do the pseudoranges agree on a place.

Satellites move by 4 km a second: tags that are off by leap seconds, hours or weeks put them where the ranges contradict
each other, or where no message serves.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.doctor.time_offset import HOUR_S, WEEK_S, scale_for
from insgnss.doctor.track import solved_share
from insgnss.gpstime import leap_seconds, ns_to_datetime
from insgnss.log.flight import Flight
from insgnss.log.gnss_rows import epochs
from insgnss.log.report import Finding, Proposal
from insgnss.tables import GnssTable, ImuTable, NavigationData

TRIED_EPOCHS: Final = 12
AGREEING: Final = 0.7  # of the tried epochs
MOST_HOURS: Final = 14  # time zones


class _Shift(NamedTuple):
    """Something to be added to the GNSS tags."""

    weeks: int
    hours: int
    leaps: int

    def seconds(self, leap: int) -> int:
        return self.weeks * WEEK_S + self.hours * HOUR_S + self.leaps * leap


def gnss_time_findings(
    flight: Flight, gnss: GnssTable, navigation: NavigationData | None, imu: ImuTable | None
) -> list[Finding]:
    """Return by what whole weeks, hours or leap seconds the GNSS tags are off, if the pseudoranges say so.

    With few satellites several shifts may do: then the one that makes the logs overlap counts.
    """
    if navigation is None or gnss.sat is not None:
        return []
    sample = _sample(gnss)
    if solved_share(flight, sample, navigation, tested=False) >= AGREEING:
        return []
    found = _fitting(flight, sample, navigation)
    sure = "sure: no other shift does"
    if len(found) > 1 and imu is not None:
        leap = leap_seconds(ns_to_datetime(int(sample.t_ns[0])))
        found = [shift for shift in found if _overlaps(gnss, imu, shift.seconds(leap))]
        sure = "likely: of several shifts the one that makes the logs overlap"
    if len(found) == 1:
        return [_finding(flight, found[0], gnss, sure)]
    text = "the pseudoranges do not agree on a place, with the tags as they are"
    told = f" nor shifted by weeks, hours up to {MOST_HOURS} or leap seconds" if not found else ""
    advice = "check the navigation files, and the columns of satellites, signals and pseudoranges"
    return [Finding("error", "gnss", text + told, advice)]


def _overlaps(gnss: GnssTable, imu: ImuTable, shift_s: int) -> bool:
    shift_ns = shift_s * NS_PER_S
    return bool(gnss.t_ns[0] + shift_ns <= imu.t_ns[-1] and imu.t_ns[0] <= gnss.t_ns[-1] + shift_ns)


def _sample(gnss: GnssTable) -> GnssTable:
    """Return some epochs, spread over the log."""
    _, starts = epochs(gnss)
    chosen = np.unique(np.linspace(0, len(starts) - 2, TRIED_EPOCHS).astype(int))
    return gnss.take(np.concatenate([np.arange(starts[k], starts[k + 1]) for k in chosen]))


def _fitting(flight: Flight, sample: GnssTable, navigation: NavigationData) -> list[_Shift]:
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
        found = [shift for shift in group if _agrees(flight, sample, navigation, shift.seconds(leap))]
        if found:
            return found
    return []


def _agrees(flight: Flight, sample: GnssTable, navigation: NavigationData, shift_s: int) -> bool:
    shifted = replace(sample, t_ns=sample.t_ns + shift_s * NS_PER_S)
    return solved_share(flight, shifted, navigation, tested=True) >= AGREEING


def _weeks_to_messages(sample: GnssTable, navigation: NavigationData) -> int:
    """Return the whole weeks from the log to the messages."""
    times = navigation.ephemerides.toe_ns
    if navigation.state_vectors is not None:
        times = np.concatenate([times, navigation.state_vectors.t_ns])
    if not len(times):
        return 0
    apart_s = (float(np.median(times)) - float(np.median(sample.t_ns))) / NS_PER_S
    return round(apart_s / WEEK_S)


def _finding(flight: Flight, shift: _Shift, gnss: GnssTable, sure: str) -> Finding:
    leap = leap_seconds(ns_to_datetime(int(gnss.t_ns[0])))
    config = flight.config
    words = [f"{shift.weeks:+d} week(s)"] if shift.weeks else []
    words += [f"{shift.hours:+d} hour(s)"] if shift.hours else []
    words += [f"{shift.leaps * leap:+d} leap seconds"] if shift.leaps else []
    text = f"the pseudoranges agree on a place with the GNSS tags shifted by {' and '.join(words)}"
    why = "only so do the pseudoranges agree on a place"
    proposals = []
    added = shift.hours * HOUR_S
    if shift.weeks and config.gnss.format == "csv" and config.gnss.time.origin == "gps_week":
        proposals.append(Proposal("gps_week", config.gps_week + shift.weeks, why))
    else:
        added += shift.weeks * WEEK_S
    if shift.leaps:
        scale = scale_for(config.gnss.time, shift.leaps) if config.gnss.format == "csv" else None
        if scale is None:
            added += shift.leaps * leap
        else:
            proposals.append(Proposal("gnss.time.scale", scale, why))
    if added:
        proposals.append(Proposal("gnss.time.offset_s", round(config.gnss.time.offset_s + added, 3), why))
    return Finding("error", "gnss", text, "", sure, tuple(proposals))
