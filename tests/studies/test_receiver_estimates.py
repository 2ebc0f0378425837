"""A receiver that estimates its C/N0: windows that show no signal, steps of the signal, and what it costs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from insgnss.studies.receiver.estimated_cn0 import EstimatedCn0, least_seen_dbhz
from insgnss.studies.receiver.runs import run_many
from insgnss.studies.receiver.variants import VARIANTS
from insgnss.studies.receiver.workspace import NO_SIGNAL
from insgnss.tables import Float64
from insgnss.tracking.vector_loop import RATIO, channels_of, levels_of
from tests.studies.test_receiver_study import setting

STEP_S, BLOCK = 5e-3, 100
CHANNELS = channels_of("coherent", STEP_S, 1.6e9, 1e6)


def power_of(rng: np.random.Generator, cn0_dbhz: float, told_dbhz: float) -> Float64:
    """Return the power of prompt replicas of two channels over half a second, scaled by the assumed C/N0."""
    ratio = 0.0 if math.isnan(cn0_dbhz) else 10.0 ** (0.1 * cn0_dbhz) * STEP_S
    noise = rng.standard_normal((BLOCK, 2, 2)) @ np.array([1.0, 1j])
    return (
        np.abs(math.sqrt(ratio) + math.sqrt(0.5) * noise) ** 2 * CHANNELS.table[levels_of(told_dbhz), RATIO]
    )


def test_estimates_do_not_depend_on_the_scale_of_the_assumed_cn0() -> None:
    rng, found = np.random.default_rng(6), EstimatedCn0(CHANNELS, np.full(2, 50.0), -math.inf)
    told = [50.0, 32.0, 41.0, 38.0]
    estimates = [found.take(power_of(rng, 40.0, x), np.full((BLOCK, 2), levels_of(x))) for x in told]

    # 200 integrations: 0.5 dB
    assert np.array(estimates) == pytest.approx(np.full((4, 2), 40.0), abs=2.0)


def test_window_without_a_signal_counts_as_a_weak_one_and_the_fourth_as_none() -> None:
    rng, found = np.random.default_rng(8), EstimatedCn0(CHANNELS, np.full(2, 30.0), -math.inf)
    flat = np.ones((BLOCK, 2)) + 1.5 * (np.arange(BLOCK) % 10 == 0)[:, None]  # more scatter than noise alone
    levels = []
    for _ in range(5):
        estimates = found.take(flat * rng.exponential(1.0, (BLOCK, 2)) ** 1.5, np.full((BLOCK, 2), 0))
        assert np.isnan(estimates).all()
        levels.append(found.level[0])
    weakest = [least_seen_dbhz(count, STEP_S) for count in (BLOCK, 2 * BLOCK)]

    assert levels[:2] == [levels_of(weakest[0]), levels_of(weakest[1])]
    assert levels[2] == levels[1] and levels[3:] == [NO_SIGNAL, NO_SIGNAL]
    assert np.isnan(found.believed).all()
    found.take(power_of(rng, 40.0, 40.0), np.full((BLOCK, 2), levels_of(40.0)))
    assert (found.level != NO_SIGNAL).all()  # the signal is back


def test_step_of_the_signal_is_seen_within_half_a_second() -> None:
    rng, found = np.random.default_rng(7), EstimatedCn0(CHANNELS, np.full(2, 45.0), -math.inf)
    told = np.full((BLOCK, 2), levels_of(45.0))
    for cn0_dbhz in (45.0, 45.0, 30.0):
        estimates = found.take(power_of(rng, cn0_dbhz, 45.0), told)

    assert estimates == pytest.approx(30.0, abs=2.0)


def test_estimated_cn0_costs_one_stage_a_decibel_of_its_threshold_at_most() -> None:
    """Half of the runs lose lock at 17.5 dBHz with known C/N0; with the estimates of half seconds at 19.9 dBHz."""
    of = setting("coherent", True, 100.0)
    of = replace(of, options=replace(of.options, estimates_cn0=True))
    time_s = of.truth.step_s * np.arange(len(of.truth.t_s))
    falling = np.maximum(45.0 - 2.0 * np.maximum(time_s - 5.0, 0.0), 18.8)[:, None]

    assert np.mean([run.lost for run in run_many(of, VARIANTS["one_stage"], falling, 10, 61, 2)]) < 0.5
