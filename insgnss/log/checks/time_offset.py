"""The constant time offset between inertial and GNSS log: its size, its certainty, and the key that corrects it."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from insgnss.config.flight import LONGEST_LAG_S, FlightConfig
from insgnss.config.log_table import TimeScale
from insgnss.constants import NS_PER_S, S_PER_WEEK
from insgnss.gpstime import leap_seconds, ns_to_datetime
from insgnss.log.checks.axis_search import EQUAL, SURE
from insgnss.log.checks.report import Finding, Proposal
from insgnss.log.flight import Flight
from insgnss.log.imu.csv_log import inertial

HOUR_S: Final = 3600
# An offset is proposed when it is many sigmas, and more than tags at 10 Hz or an antenna's filter explain; from three
# sigmas on the tags cannot be said to agree
SUSPECT_SIGMAS: Final = 3.0
SIGNIFICANT_SIGMAS: Final = 5.0  # an estimate further from what was declared contradicts it
SMALLEST_S: Final = 0.05
MOST_SIGMA_S: Final = 0.15  # of a proposal
NEAR_LEAP_S: Final = 0.4


class Timing(NamedTuple):
    """The offset that makes the logs agree."""

    offset_s: float  # to be added to the inertial tags
    sd_s: float
    cost: float  # -2 log likelihood
    gain: float  # of the cost against no offset at all


class RatesInTime(NamedTuple):
    """What else may explain an offset: a lag of the range rates that the comparison did not take out."""

    used_s: float  # lag that it did take out
    rest_s: float  # what the ranges say of the rest
    sd_s: float  # infinite: nothing

    def lag_s(self, timing: Timing) -> float | None:
        """Return the lag that explains an offset as well as wrong tags: they differ in what the ranges should say.

        None where the ranges rule it out. A lag below zero does not exist: with zero instead, an offset of the tags
        remains, and only one that would be proposed by itself rules the lag out.
        """
        late_s, sd_s = self.used_s + timing.offset_s, float(np.hypot(self.sd_s, timing.sd_s))
        no_other = self.used_s <= 0.0 and late_s <= 0.0
        if no_other or not -proposed_from(timing.sd_s) <= late_s <= LONGEST_LAG_S:
            return None
        ruled_out = (timing.offset_s - self.rest_s) ** 2 - self.rest_s**2 > SURE * sd_s**2
        return None if ruled_out else max(late_s, 0.0)


def proposed_from(sd_s: float) -> float:
    """Return the size [s] from which an offset is proposed."""
    return max(SIGNIFICANT_SIGMAS * sd_s, SMALLEST_S)


NO_RATES: Final = RatesInTime(-np.inf, 0.0, np.inf)  # the velocities are not of range rates


def offset_findings(
    flight: Flight, timing: Timing, contrast: float, origin_ns: int, rates: RatesInTime = NO_RATES
) -> list[Finding]:
    """Return the offset as a finding, with proposals where it is one.

    Parameters
    ----------
    timing : the offset and how sure it is
    contrast : how far -2 log likelihood falls at it below that of other shifts
    origin_ns : GPS time of the log
    rates : a lag of the range rates instead; where the ranges leave both, both are named and none is proposed
    """
    offset_s, sd_s = timing.offset_s, timing.sd_s
    leap = leap_seconds(ns_to_datetime(origin_ns))
    weeks, hours, leaps, rest = split(offset_s, leap)
    significant = abs(rest) > proposed_from(sd_s)
    lag_s = rates.lag_s(timing)
    if not (weeks or hours or leaps) and not significant:
        return [_small_offset(offset_s, sd_s, lag_s)]
    side = "behind" if offset_s > 0.0 else "ahead"
    text = f"the IMU tags are {abs(offset_s):.3f} s {side}{_label(weeks, hours, leaps)}"
    if lag_s is not None:
        text += f", or the range rates lag by {lag_s:.3f} s" if lag_s else ", or the range rates do not lag"
        advice = f"suspected imu.time.offset_s = {offset_s:+.3f}{_or_lag(lag_s)}: {_WHAT_DECIDES}"
        return [Finding("warning", "motion", text, advice, f"sigma {sd_s:.3f} s")]
    if abs(offset_s) < rates.used_s:
        advice = f"suspected imu.time.offset_s = {offset_s:+.3f}: {_FORM_OF_LAG}"
        return [Finding("warning", "motion", text, advice, f"sigma {sd_s:.3f} s")]
    if sd_s > MOST_SIGMA_S or timing.gain < EQUAL:
        advice = f"suspected imu.time.offset_s = {offset_s:+.2f}; more turns, runs and stops decide"
        return [Finding("warning", "motion", text, advice, f"sigma {sd_s:.2f} s")]
    remaining_s = rest if significant else 0.0
    proposals = time_proposals(flight.config, weeks, hours, leaps * leap, remaining_s)
    sure = f"sure: sigma {sd_s:.3f} s, log likelihood {contrast / 2.0:.0f} above other shifts"
    return [Finding("error", "motion", text, "", sure, proposals)]


_WHAT_DECIDES: Final = (
    "the ranges do not tell them apart; carrier phases in the log, or more turns, runs and stops, decide"
)


# With rates of the Xi'an car put 0.2 s late its tags, which are right, seem 0.15 s ahead: seven sigmas
_FORM_OF_LAG: Final = (
    "the lag of the range rates was removed as a pure delay; a receiver that smooths is not a pure delay, and the"
    " difference may look like a time offset"
)


def _or_lag(lag_s: float | None) -> str:
    return "" if lag_s is None else f" or gnss.range_rate_lag_s = {lag_s:.3f}"


def _small_offset(offset_s: float, sd_s: float, lag_s: float | None) -> Finding:
    """Return the finding of an offset that is not large or sure enough for a proposal."""
    estimate = f"offset {offset_s:+.3f} s, sigma {sd_s:.3f} s"
    if abs(offset_s) <= SUSPECT_SIGMAS * sd_s:
        return Finding("ok", "motion", f"IMU and GNSS tags agree: {estimate}")
    text = f"IMU and GNSS tags do not agree: {estimate}, {abs(offset_s) / sd_s:.1f} sigma"
    advice = (
        f"suspected imu.time.offset_s = {offset_s:+.3f}{_or_lag(lag_s)}: a latency of either log, or a delay of the"
        " sensor's filter;"
        " more turns, runs and stops decide"
    )
    return Finding("warning", "motion", text, advice)


def split(offset_s: float, leap: int) -> tuple[int, int, int, float]:
    """Return whole weeks, whole hours, leap seconds (-1, 0 or 1 times) and the rest [s] of an offset."""
    weeks = round(offset_s / S_PER_WEEK)
    left = offset_s - weeks * S_PER_WEEK
    hours = round(left / HOUR_S) if abs(left) > HOUR_S / 2 else 0
    left -= hours * HOUR_S
    for leaps in (1, -1):
        if abs(left - leaps * leap) < NEAR_LEAP_S:
            return weeks, hours, leaps, left - leaps * leap
    return weeks, hours, 0, left


def _label(weeks: int, hours: int, leaps: int) -> str:
    words = []
    if weeks:
        words.append(f"{abs(weeks)} week(s)")
    if hours:
        words.append(f"{abs(hours)} hour(s), as local time is")
    if leaps:
        words.append(
            "the leap seconds: UTC taken for GPS time" if leaps > 0 else "the leap seconds: added twice"
        )
    return f": {' and '.join(words)}" if words else ""


def time_proposals(
    config: FlightConfig, weeks: int, hours: int, leap_s: int, rest_s: float
) -> tuple[Proposal, ...]:
    """Return the keys that add so much to the inertial tags; ``leap_s`` is the leap seconds' part, with its sign."""
    time = inertial(config).time
    added = weeks * S_PER_WEEK + hours * HOUR_S + rest_s
    proposals = []
    if leap_s:
        scale = scale_for(time, leap_s)
        if scale is None:
            added += leap_s
        else:
            why = "the tags are off by the leap seconds"
            proposals.append(Proposal("imu.time.scale", scale, why))
    # the week is that of the inertial log alone
    if (
        weeks
        and inertial(config).counts_in_gps_week
        and not (config.gnss.format == "csv" and config.gnss.counts_in_gps_week)
    ):
        why = "the IMU tags are whole weeks off the GNSS log, which states its week"
        proposals.append(Proposal("gps_week", config.gps_week + weeks, why))
        added -= weeks * S_PER_WEEK
    if added:
        why = "found by comparing gyros and accelerometers with the GNSS velocity"
        proposals.append(Proposal("imu.time.offset_s", round(time.offset_s + added, 3), why))
    return tuple(proposals)


def scale_for(time: TimeScale, leap_s: int) -> str | None:
    """Return the time scale that adds (above zero) or subtracts the leap seconds, None if there is none."""
    if leap_s > 0 and time.scale == "gps":
        return "utc"
    return "gps" if leap_s < 0 and time.scale == "utc" and time.leap_seconds is None else None


def overlapping_shifts(imu_ns: tuple[int, int], gnss_ns: tuple[int, int]) -> list[int]:
    """Return the whole hours and weeks [s] that, added to the inertial tags, make the logs overlap, the least first.

    Half of the shorter log must be in common; none is given when it is already.
    """
    wanted = 0.5 * min(imu_ns[1] - imu_ns[0], gnss_ns[1] - gnss_ns[0])

    def common(shift_s: int) -> float:
        shift = shift_s * NS_PER_S
        return min(imu_ns[1] + shift, gnss_ns[1]) - max(imu_ns[0] + shift, gnss_ns[0])

    if common(0) >= wanted:
        return []
    apart = (gnss_ns[0] + gnss_ns[1] - imu_ns[0] - imu_ns[1]) / (2 * NS_PER_S)
    weeks = round(apart / S_PER_WEEK) * S_PER_WEEK
    hours = [weeks + h * HOUR_S for h in range(-26, 27)] if abs(apart - weeks) < 27 * HOUR_S else [weeks]
    return sorted((s for s in hours if s and common(s) >= wanted), key=lambda s: abs(s - apart))
