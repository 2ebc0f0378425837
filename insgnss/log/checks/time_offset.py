"""The constant offset between the tags of inertial and GNSS log: how large, how sure, and which key mends it."""

from __future__ import annotations

from typing import Final, NamedTuple

from insgnss.config.flight import FlightConfig
from insgnss.config.log_table import TimeScale
from insgnss.constants import NS_PER_S, S_PER_WEEK
from insgnss.gpstime import leap_seconds, ns_to_datetime
from insgnss.log.checks.axis_search import EQUAL
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


def offset_findings(flight: Flight, timing: Timing, contrast: float, origin_ns: int) -> list[Finding]:
    """Return the offset as a finding, with proposals where it is one.

    Parameters
    ----------
    timing : the offset and how sure it is
    contrast : how far -2 log likelihood falls at it below that of other shifts
    origin_ns : GPS time of the log
    """
    offset_s, sd_s = timing.offset_s, timing.sd_s
    leap = leap_seconds(ns_to_datetime(origin_ns))
    weeks, hours, leaps, rest = split(offset_s, leap)
    significant = abs(rest) > max(SIGNIFICANT_SIGMAS * sd_s, SMALLEST_S)
    if not (weeks or hours or leaps) and not significant:
        return [_small_offset(offset_s, sd_s)]
    side = "behind" if offset_s > 0.0 else "ahead"
    text = f"the IMU tags are {abs(offset_s):.3f} s {side}{_label(weeks, hours, leaps)}"
    if sd_s > MOST_SIGMA_S or timing.gain < EQUAL:
        advice = f"suspected imu.time.offset_s = {offset_s:+.2f}; more turns, runs and stops decide"
        return [Finding("warning", "motion", text, advice, f"sigma {sd_s:.2f} s")]
    remaining_s = rest if significant else 0.0
    proposals = time_proposals(flight.config, weeks, hours, leaps * leap, remaining_s)
    sure = f"sure: sigma {sd_s:.3f} s, log likelihood {contrast / 2.0:.0f} above other shifts"
    return [Finding("error", "motion", text, "", sure, proposals)]


def _small_offset(offset_s: float, sd_s: float) -> Finding:
    """Return the finding of an offset that is not large or sure enough for a proposal."""
    estimate = f"offset {offset_s:+.3f} s, sigma {sd_s:.3f} s"
    if abs(offset_s) <= SUSPECT_SIGMAS * sd_s:
        return Finding("ok", "motion", f"IMU and GNSS tags agree: {estimate}")
    text = f"IMU and GNSS tags do not agree: {estimate}, {abs(offset_s) / sd_s:.1f} sigma"
    advice = (
        f"suspected imu.time.offset_s = {offset_s:+.3f}: a latency of either log, or a delay of the sensor's filter;"
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
