"""Axes, gyro unit, time offset and lever arm: the inertial log compared with the GNSS motion."""

from __future__ import annotations

from typing import Final

import numpy as np

from insgnss.config.imu import ImuGrade
from insgnss.log.checks.axis_search import LOOKED_AT, SURE, Hypothesis, Match, in_motion, is_map, search
from insgnss.log.checks.declaration import AxesDeclaration
from insgnss.log.checks.far_shift import FARTHEST_S, far_shift
from insgnss.log.checks.lever_arm import lever_arm_findings
from insgnss.log.checks.refinement import TAU, UNKNOWN, RefinedEstimate, Uncertainty, refine
from insgnss.log.checks.report import Finding, Proposal
from insgnss.log.checks.stretches import GnssStretch, inertial_grid, length_for, spans_without_gaps, stretches
from insgnss.log.checks.time_offset import NO_RATES, RatesInTime, Timing, offset_findings
from insgnss.log.checks.track import GnssTrack
from insgnss.log.checks.vehicle_axes import (
    VehicleAxes,
    axes_findings,
    candidates,
    decided,
    gyros_known,
    relative,
)
from insgnss.log.flight import Flight
from insgnss.tables import Float64
from insgnss.units import ppm_to_ratio

EDGE_S: Final = 1.0  # the stretches stay so far inside the inertial log, for the fine shift
MARGIN_S: Final = 1.5
REFINED_STRETCHES: Final = 12
GIVEN_M: Final = 1.0  # how far a given lever arm may be off, while the time offset is sought
USUAL_LEVER_M: Final = 3.0  # of one that is not given
UNIT_FITS: Final = 20.0  # a unit that is ruled out by less is only suspected


def motion_findings(
    flight: Flight,
    declared: AxesDeclaration,
    track: GnssTrack,
    base_s: float = 0.0,
    rates: RatesInTime = NO_RATES,
) -> list[Finding]:
    """Return the findings from the motion on the inertial log.

    Parameters
    ----------
    declared : the log in its own axes, accelerometers in their right unit
    track : the antenna's way
    base_s : whole hours or weeks that the inertial tags are off, added to them here
    rates : whether the track's velocities may be late
    """
    match = match_of(flight, declared, track, base_s)
    far_s = far_shift(
        declared, track, match, lambda shift_s: _common(flight, declared, track, shift_s, 0.35), base_s
    )
    if far_s is not None:
        base_s = far_s
        match = match_of(flight, declared, track, base_s)
    if match is None:
        return [_no_motion()]
    match = _weighed(match, flight, declared, track, base_s + match.shift_s)
    if match.contrast < SURE:
        return [_unexplained(match)]
    readings = candidates(match.readings, declared.accel, declared.gyro)
    best = readings[0]
    unit = _unit_findings(declared, best, match)
    axes = axes_findings(declared, readings, match)
    timing = _timing(flight, declared, track, best, base_s, match.shift_s) if gyros_known(readings) else None
    if timing is None:
        return [*unit, *axes]
    known = timing._replace(sd_s=float(np.hypot(timing.sd_s, track.sd_time_s)))
    times = offset_findings(flight, known, match.contrast, track.origin_ns, rates)
    if not decided(readings):
        return [*unit, *axes, *times]
    free = np.zeros(3)
    refined = _refined(flight, declared, track, best.hypothesis, timing.offset_s, free, UNKNOWN)
    if refined is None:
        return [*unit, *axes, *times]
    return [*unit, *axes, *times, *lever_arm_findings(flight, refined, best.accel, declared, track)]


def match_of(flight: Flight, declared: AxesDeclaration, track: GnssTrack, base_s: float) -> Match | None:
    """Return the best hypotheses of axes, unit and time, None without motion in common."""
    gnss_stretches = _common(flight, declared, track, base_s, 0.35)
    declared_map = relative(declared.accel, declared.gyro)
    return search(declared.imu, track.origin_ns, gnss_stretches, declared_map, declared.factors, base_s)


def _common(
    flight: Flight, declared: AxesDeclaration, track: GnssTrack, shift_s: float, edge_s: float
) -> list[GnssStretch]:
    spans = spans_without_gaps(declared.imu, track.origin_ns, shift_s, edge_s)
    return stretches(track, length_for(flight.imu_grade), spans)


def _weighed(
    match: Match, flight: Flight, declared: AxesDeclaration, track: GnssTrack, shift_s: float
) -> Match:
    """Return the match with its hypotheses reweighted with biases and lever arm, unless the declared one leads.

    What the first fit leaves out, a gyro's bias or a long lever arm, must not favour other axes.
    """
    own = relative(declared.accel, declared.gyro)
    handed = int(np.rint(np.linalg.det(declared.accel)))
    if any(is_map(one, own, 1.0) and one.handed == handed for one in match.tied):
        return match
    seen = [one for one in match.ranked if one.cost < LOOKED_AT or is_map(one, own, 1.0)]
    refined = [_refined(flight, declared, track, one, shift_s, np.zeros(3), UNKNOWN) for one in seen]
    costs = np.array([np.inf if one is None else one.cost for one in refined])
    if not np.isfinite(costs).any():
        return match
    costs -= costs.min()
    order = np.argsort(costs, kind="stable")
    ranked = [seen[k]._replace(cost=float(costs[k])) for k in order]
    units = [one.cost for one in ranked if one.factor != ranked[0].factor]
    return match._replace(ranked=ranked, unit_gap=min(units, default=np.inf))


def _timing(
    flight: Flight,
    declared: AxesDeclaration,
    track: GnssTrack,
    best: VehicleAxes,
    base_s: float,
    shift_s: float,
) -> Timing | None:
    """Return the offset by least squares, begun on both sides of the peak too, and the evidence for an offset."""
    given = flight.config.gnss.lever_b
    lever_s = best.accel.T @ np.array(given or (0.0, 0.0, 0.0))
    known = Uncertainty(lever_m=USUAL_LEVER_M if given is None else GIVEN_M)
    timings = []
    for begin in (-0.25, 0.0, 0.25):
        begin_s = base_s + shift_s + begin
        refined = _refined(flight, declared, track, best.hypothesis, begin_s, lever_s, known)
        if refined is not None:
            offset = begin_s + float(refined.x[TAU])
            timings.append(Timing(offset, float(refined.sd[TAU]), refined.cost, np.inf))
    if not timings:
        return None
    timing = min(timings, key=lambda one: one.cost)
    if shift_s != 0.0 or base_s != 0.0:
        return timing
    still = _refined(flight, declared, track, best.hypothesis, 0.0, lever_s, known._replace(time_s=1e-6))
    return timing if still is None else timing._replace(gain=still.cost - timing.cost)


def _refined(
    flight: Flight,
    declared: AxesDeclaration,
    track: GnssTrack,
    one: Hypothesis,
    shift_s: float,
    lever_s: Float64,
    known: Uncertainty,
) -> RefinedEstimate | None:
    chosen = in_motion(_common(flight, declared, track, shift_s, EDGE_S))[:REFINED_STRETCHES]
    if not chosen:
        return None
    grid = inertial_grid(declared.imu, track.origin_ns, chosen, MARGIN_S, shift_s)
    gyro_map = one.factor * one.gyro_map
    known = known._replace(scale=_scale_sigmas(flight.imu_grade), smoothed_s2=track.late_s**2)
    return refine(chosen, grid, gyro_map, one.handed, lever_s, known)


def _scale_sigmas(grade: ImuGrade) -> Float64:
    """Return (2, 3, 3) sigmas of scale factors and, off the diagonal, misalignments: accelerometers', gyros'."""
    scale = ppm_to_ratio(np.array([grade.accel_scale_factor_ppm, grade.gyro_scale_factor_ppm]))
    across = 1e-3 * np.array([grade.accel_misalignment_mrad, grade.gyro_misalignment_mrad])
    return np.asarray(np.where(np.eye(3) > 0.0, scale[:, None, None], across[:, None, None]))


def _no_motion() -> Finding:
    text = (
        "no motion above the noise while both logs run: forward axis, gyro unit and time offset are not"
        " observable"
    )
    return Finding("ok", "motion", text, "log a minute with two turns, or with an acceleration and a stop")


def _unexplained(match: Match) -> Finding:
    text = (
        f"no hypothesis makes the inertial log fit the GNSS velocities (best rms {match.rms_mps:.2g} m/s): 48 axis"
        " mappings and both gyro units with shifts of 22 s, the declared axes with shifts of"
        f" {FARTHEST_S / 60.0:.0f} min"
    )
    return Finding("warning", "motion", text, "check that the inertial log is of this flight")


def _unit_findings(declared: AxesDeclaration, best: VehicleAxes, match: Match) -> list[Finding]:
    if best.factor == 1.0:
        return []
    unit = declared.units[declared.factors.index(best.factor)]
    how = f"log likelihood {match.unit_gap / 2.0:.0f} above any other"
    text = f"the gyros turn {1.0 / best.factor:.3g} times as far as the course does: their unit is {unit}"
    if match.unit_gap < UNIT_FITS:
        return [Finding("warning", "motion", text, f"suspected gyro_unit = '{unit}'; more turns decide", how)]
    proposal = Proposal("imu.gyro_unit", unit, "the turns of the GNSS course require it")
    return [Finding("error", "motion", text, "", f"sure: {how}", (proposal,))]
