"""Replicas are as far off as a receiver's covariance says, and a second stage without INS takes the acceleration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from insgnss.studies.receiver.tables import innovation_correlation
from insgnss.studies.receiver.variants import VARIANTS
from tests.studies.test_receiver_study import (
    VELOCITY,
    flown,
    nees_within_bounds,
    setting,
    settled,
)

RUNS = 6
RANGE, RATE = 0, 1


@pytest.mark.parametrize(
    ("name", "with_ins", "cn0_dbhz"),
    [
        *(("one_stage", True, cn0) for cn0 in (45.0, 25.0)),
        *(("optimal", True, cn0) for cn0 in (45.0, 25.0)),
        ("scalar", False, 40.0),
        ("one_stage", False, 30.0),
    ],
)
def test_delay_and_frequency_of_each_channel_are_as_far_off_as_its_covariance_says(
    name: str, with_ins: bool, cn0_dbhz: float
) -> None:
    of = setting("noncoherent", with_ins, 100.0)
    runs = flown(of, VARIANTS[name], cn0_dbhz, RUNS, 51)
    squares = np.array([(run.rms / run.predicted) ** 2 for run in runs])  # (runs, channels, 2)
    of_channels = np.sqrt(squares.mean(axis=0))
    # position and clock make all delays, and last for half a minute: each run of 60 s is two looks at four of them
    low, high = stats.chi2.interval(0.999, 2 * 4 * RUNS) / np.array(2 * 4 * RUNS)

    assert of_channels[:, RATE] == pytest.approx(1.0, abs=0.1)
    assert low < squares[:, :, RANGE].mean() < high


# the newest inertial sample, led on over half an integration at 5 g, is off by as much as the filter's range rates
@pytest.mark.parametrize("name", ["one_stage", "optimal", "two_stage"])
def test_range_rates_beside_a_good_oscillator_are_off_by_what_the_sample_led_on_leaves_too(name: str) -> None:
    of = setting("coherent", True, 1.0)
    runs = flown(of, VARIANTS[name], 43.0, 3, 51)
    rate = np.sqrt(np.mean([(run.rms / run.predicted)[:, RATE] ** 2 for run in runs], axis=0))

    assert rate == pytest.approx(1.0, abs=0.1)


def test_a_covariance_that_counts_the_same_information_twice_promises_too_much() -> None:
    of = setting("noncoherent", True, 100.0)
    runs = flown(of, VARIANTS["two_stage"], 22.0, 4, 51)
    squares = np.mean([(run.rms / run.predicted) ** 2 for run in runs], axis=(0, 1))

    assert not any(run.lost for run in runs)
    assert squares[RATE] > 2.0


# of 20, 40 and 100 ms: in the last one 5 g change by 12 m/s^2
@pytest.mark.parametrize(("tracking", "interval"), [("coherent", 4), ("coherent", 20), ("noncoherent", 4)])
def test_second_stage_without_ins_takes_the_acceleration_of_the_interval_and_is_consistent(
    tracking: str, interval: int
) -> None:
    of = replace(setting(tracking, False, 100.0), interval=interval)
    optimal, one = (flown(of, VARIANTS[name], 40.0, RUNS, 52) for name in ("optimal", "one_stage"))

    assert not any(run.lost for run in optimal)
    assert nees_within_bounds(of, optimal)
    assert abs(innovation_correlation(of, VARIANTS["optimal"], optimal)) < 0.03
    # between two updates its velocity is a prediction with an acceleration that is known to 10 m/s^2
    assert 1.0 < settled(of, optimal, VELOCITY) / settled(of, one, VELOCITY) < 1.6


@pytest.mark.parametrize("interval", [4, 20])
def test_messages_are_consistent_though_the_oscillator_wanders_within_the_interval(interval: int) -> None:
    of = replace(setting("coherent", True, 100.0), interval=interval)  # of 20 and 100 ms
    runs = flown(of, VARIANTS["optimal"], 45.0, 4, 5)

    assert nees_within_bounds(of, runs)
    for k in (RANGE, RATE):
        assert np.mean([(run.rms / run.predicted)[:, k] for run in runs]) == pytest.approx(1.0, abs=0.1)
