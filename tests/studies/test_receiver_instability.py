"""A second stage that counts the same information twice loses lock with a good oscillator, and each cure holds it."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Final

import numpy as np
import pytest

from insgnss.simulation.closed_loop_sky import GLONASS_RADIUS_M
from insgnss.studies import ReceiverOptions
from insgnss.studies.receiver.runs import ReceiverRun, Setting, run_many
from insgnss.studies.receiver.scene import scene_of
from insgnss.studies.receiver.tables import innovation_correlation
from insgnss.studies.receiver.variants import VARIANTS
from tests.studies.test_receiver_study import LOW, VELOCITY, flown, setting

RUNS: Final = 4
T_RECORD_S: Final = 0.1
EARLY, LATE = (50.0, 150.0), (299.0, 399.0)  # seconds


@cache
def long_setting() -> Setting:
    """Return the laboratory without phase tracking for 400 s."""
    options = ReceiverOptions(
        duration_s=400.0,
        settle_s=50.0,
        average_s=50.0,
        step_s=10e-3,
        carrier_hz=1.6e9,
        chip_hz=0.511e6,
        orbit_radius_m=GLONASS_RADIUS_M,
    )
    return scene_of("manoeuvring_5g_long", "noncoherent", LOW, {"drift_density": 1.0}, options).setting


# An independent program, 16 runs: 3.95 m/s between 50 and 150 s and all lost before 300 s
def test_simplified_second_stage_with_a_good_oscillator_grows_until_all_is_lost() -> None:
    of, sick = long_setting(), sick_runs()
    first_s = min(run.lost_s.min() for run in sick)
    growing = [between(of, sick, begin_s, begin_s + 15.0) for begin_s in (10.0, 35.0, 60.0)]
    nees_before = [run.nees[round(10.0 / T_RECORD_S) : round(25.0 / T_RECORD_S)].mean() for run in sick]

    assert all(run.lost for run in sick) and first_s > 75.0
    assert growing[1] > 1.3 * growing[0] and growing[2] > 1.3 * growing[1]  # long before the first loss
    assert min(nees_before) > 100.0  # and sure of what it does not know
    early, late = (between(of, sick, *window) for window in (EARLY, LATE))
    assert early > 3.0 and late > 3.0 * early


# The same program: loops for a hundred times the drift density 0.097 and then 0.092 m/s, the interval's message 0.084
# and 0.087 m/s, an oscillator of 100 rad^2/s^3 without a cure 0.105 and 0.100 m/s, none lost
@pytest.mark.parametrize(
    ("name", "changed", "interval", "drift_density", "velocity_mps"),
    [
        ("two_stage", {"widening": 100.0}, 10, 1.0, 0.097),
        ("optimal", {}, 10, 1.0, 0.084),
        ("two_stage", {}, 10, 100.0, 0.105),
        ("two_stage", {"inflation": 100.0}, 10, 1.0, None),
        ("two_stage", {}, 200, 1.0, None),
    ],
)
def test_each_cure_stops_the_growth_that_the_simplified_second_stage_has(
    name: str, changed: dict[str, float], interval: int, drift_density: float, velocity_mps: float | None
) -> None:
    of = replace(long_setting(), interval=interval, drift_density=drift_density)
    cured = flown(of, replace(VARIANTS[name], **changed), 40.0, RUNS, 71)  # type: ignore[arg-type]
    early, late = (between(of, cured, *window) for window in (EARLY, LATE))

    assert not any(run.lost for run in cured)
    assert late < 1.15 * early
    if velocity_mps is not None:
        assert early == pytest.approx(velocity_mps, rel=0.15)
    else:  # larger variances of rows, or rows that are rare, cost what the rows say
        assert 0.3 < late < early < 2.0


# The same program: 7.6 m/s and 257', all lost; loops for a hundred times the drift density 0.136 and then 0.132 m/s.
# Its sensor's noise is not stated: here it is three times that of the sensor above.
def test_poor_inertial_sensor_is_lost_sooner_and_wider_loops_or_the_intervals_message_hold_it() -> None:
    noisy = {"gyro_arw_deg_per_sqrt_h": 1.0, "accel_vrw_mps_per_sqrt_h": 0.3}
    poor = LOW.model_copy(
        update={"gyro_bias_instability_deg_per_h": 300.0, "accel_bias_instability_mg": 0.2 / 9.80665e-3}
        | noisy
    )
    of, simple = replace(long_setting(), grade=poor), VARIANTS["two_stage"]
    sick, wide, optimal = (
        flown(of, variant, 40.0, 2, 71)
        for variant in (simple, replace(simple, widening=100.0), VARIANTS["optimal"])
    )

    assert all(run.lost_s.min() < 300.0 for run in sick)
    assert between(of, sick, *EARLY) > 7.6
    assert not any(run.lost for run in (*wide, *optimal))
    assert between(of, wide, *EARLY) == pytest.approx(0.136, rel=0.15)
    assert between(of, wide, *LATE) == pytest.approx(0.132, rel=0.15)
    assert between(of, optimal, *LATE) < between(of, wide, *LATE)


@pytest.mark.parametrize("drift_density", [1.0, 100.0])
def test_innovations_are_white_unless_the_filter_counts_the_same_information_twice(
    drift_density: float,
) -> None:
    of, names = replace(long_setting(), drift_density=drift_density), ("one_stage", "optimal", "two_stage")
    runs = {name: flown(of, VARIANTS[name], 40.0, 2, 72) for name in names}
    correlation = {name: innovation_correlation(of, VARIANTS[name], runs[name]) for name in names}

    # two runs of eight channels and 3500 updates: one sigma is 0.004
    assert abs(correlation["one_stage"]) < 0.02 and abs(correlation["optimal"]) < 0.02
    assert correlation["two_stage"] > 0.9
    # a receiver without a filter has none
    assert math.isnan(innovation_correlation(of, VARIANTS["scalar"], runs["one_stage"]))


def test_simplified_second_stage_is_lost_on_stairs_that_the_intervals_message_descends() -> None:
    """Of 20 runs of an independent program half are lost at 11 dBHz, of the interval's message at 6.3 dBHz.

    It descends by 60 s a step in steps that are not stated, and such receivers take minutes to be lost. Here half of 12
    runs are lost, from 24 dBHz in steps of 1 and of 2 dB, at 13 and 9 dBHz, of the interval's message at 4 and 2 dBHz.
    These numbers are not determined; the order is.
    """
    of = replace(long_setting(), drift_density=100.0)
    time_s = of.truth.step_s * np.arange(len(of.truth.t_s))
    stairs = np.where(time_s < 40.0, 45.0, 16.0 - 2.0 * np.floor((time_s - 40.0) / 60.0))[:, None]
    simple, optimal = (run_many(of, VARIANTS[name], stairs, 3, 5, 2) for name in ("two_stage", "optimal"))

    assert sum(run.lost for run in simple) >= 2
    assert not any(run.lost for run in optimal)
    assert min(run.lost_s.min() for run in simple) > 40.0 + 60.0  # not before 14 dBHz


# An independent program has 1.00 m/s at 24 dBHz, and does not say from where its runs start
def test_errors_of_the_simplified_second_stage_depend_on_the_start_for_minutes() -> None:
    of = setting("noncoherent", True, 100.0)
    level = np.full((len(of.truth.t_s), 1), 24.0)
    fallen = level.copy()
    fallen[: round(40.0 / of.truth.step_s)] = 45.0
    weak, strong = (
        between(of, run_many(of, VARIANTS["two_stage"], profile, 6, 78, 2), 50.0, 100.0)
        for profile in (level, fallen)
    )

    assert strong < 1.0 < weak < 2.5 * strong


@cache
def sick_runs() -> list[ReceiverRun]:
    return flown(long_setting(), VARIANTS["two_stage"], 40.0, RUNS, 71)


def between(of: Setting, runs: list[ReceiverRun], begin_s: float, end_s: float) -> float:
    """Return the rms velocity error of a time."""
    first, last = (round(t / (of.record_every * of.truth.step_s)) for t in (begin_s, end_s))
    return math.sqrt(np.mean([np.sum(run.error[first:last, VELOCITY] ** 2, axis=1).mean() for run in runs]))
