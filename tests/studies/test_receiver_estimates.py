"""A receiver that estimates its C/N0: windows that show no signal, steps of the signal, and what it costs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from insgnss.studies.receiver.estimated_cn0 import ESTIMATORS, EstimatedCn0
from insgnss.studies.receiver.runs import run_many
from insgnss.studies.receiver.variants import VARIANTS
from insgnss.studies.receiver.workspace import NO_SIGNAL
from insgnss.tables import Float64
from insgnss.tracking.vector_loop import RATIO, channels_of, levels_of
from tests.studies.test_receiver_study import setting

STEP_S, BLOCK = 5e-3, 4
SECOND = round(1.0 / (BLOCK * STEP_S))  # blocks
CHANNELS = channels_of("coherent", STEP_S, 1.6e9, 1e6)


def power_of(rng: np.random.Generator, cn0_dbhz: float, told_dbhz: float, channels: int = 2) -> Float64:
    """Return the power of prompt replicas of channels over 20 ms, scaled by the assumed C/N0."""
    ratio = 0.0 if math.isnan(cn0_dbhz) else 10.0 ** (0.1 * cn0_dbhz) * STEP_S
    noise = rng.standard_normal((BLOCK, channels, 2)) @ np.array([1.0, 1j])
    seen = np.abs(math.sqrt(2.0 * ratio) + noise) ** 2
    return np.asarray(seen * CHANNELS.table[levels_of(told_dbhz), RATIO])


def taken(found: EstimatedCn0, rng: np.random.Generator, cn0_dbhz: float, blocks: int) -> Float64:
    """Return the estimates of blocks whose replicas are scaled by what the receiver believes, (blocks, m) [dBHz]."""
    estimates = []
    for _ in range(blocks):
        powers, m = [], len(found.believed)
        for c in range(m):
            powers.append(power_of(rng, cn0_dbhz, found.believed[c], m)[:, c])
        estimates.append(found.take(np.column_stack(powers), np.tile(levels_of(found.believed), (BLOCK, 1))))
    return np.array(estimates)


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_estimates_do_not_depend_on_the_scale_of_the_assumed_cn0(estimator: str) -> None:
    rng, found = np.random.default_rng(6), EstimatedCn0(CHANNELS, np.full(2, 50.0), -math.inf, estimator)
    for told in (50.0, 32.0, 41.0, 38.0):
        for _ in range(SECOND):
            estimates = found.take(power_of(rng, 40.0, told), np.full((BLOCK, 2), levels_of(told)))

        # 200 integrations: 0.1 dB of the power, 0.2 dB of the moments
        assert estimates == pytest.approx(40.0, abs=1.0)


@pytest.mark.parametrize("cn0_dbhz", [18.0, 30.0, 45.0])
def test_mean_power_above_the_noise_scatters_as_a_window_of_a_second_does(cn0_dbhz: float) -> None:
    """Its variance is (1 + 2 a) / n where the window never restarts by chance."""
    rng, found = np.random.default_rng(3), EstimatedCn0(CHANNELS, np.full(16, cn0_dbhz), -math.inf, "power")
    seconds = [taken(found, rng, cn0_dbhz, SECOND)[-1] for _ in range(41)][1:]
    a, n = 10.0 ** (0.1 * cn0_dbhz) * STEP_S, SECOND * BLOCK
    signal = 10.0 ** (0.1 * np.array(seconds)) * STEP_S

    # 640 windows that do not overlap: the mean to a twenty-fifth of a sigma, sigma to 3 %
    sigma = math.sqrt((1.0 + 2.0 * a) / n)
    assert float(np.mean(signal)) == pytest.approx(a, abs=4.0 * sigma / math.sqrt(640))
    assert float(np.std(signal)) == pytest.approx(sigma, rel=0.12)


def test_window_without_a_signal_counts_as_a_weak_one_and_two_seconds_without_as_none() -> None:
    found = EstimatedCn0(CHANNELS, np.full(2, 30.0), -math.inf, "power")
    noise = np.full((BLOCK, 2), 2.0 * CHANNELS.table[0, RATIO])  # never more than the mean of noise
    believed = []
    for _ in range(2 * SECOND + 1):
        assert np.isnan(found.take(noise, np.zeros((BLOCK, 2), np.int64))).all()
        believed.append(found.believed[0])
    # half a sigma of a twentieth of a second and of a second
    weakest = [10.0 * math.log10(0.5 / math.sqrt(n) / STEP_S) for n in (BLOCK, SECOND * BLOCK)]

    assert believed[0] == pytest.approx(weakest[0]) and believed[SECOND] == pytest.approx(weakest[1])
    assert np.isfinite(believed[2 * SECOND - 2]) and np.isnan(believed[-1])
    assert (found.level == NO_SIGNAL).all()
    found.take(power_of(np.random.default_rng(8), 40.0, 40.0), np.full((BLOCK, 2), levels_of(40.0)))
    assert (found.level != NO_SIGNAL).all()  # the signal is back


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_fall_of_the_signal_is_seen_after_twenty_milliseconds(estimator: str) -> None:
    rng, found = np.random.default_rng(7), EstimatedCn0(CHANNELS, np.full(8, 45.0), -math.inf, estimator)
    before, after = taken(found, rng, 45.0, SECOND)[-1], taken(found, rng, 30.0, 1)[0]

    assert before == pytest.approx(45.0, abs=1.0)
    # four integrations of a signal of 5 times the noise: one sigma is 1.4 dB
    assert after.max() < 34.0 and float(np.mean(after)) == pytest.approx(30.0, abs=2.0)


# without INS a receiver loses its phases within a quarter of a second in which it takes noise for signal
@pytest.mark.parametrize(("name", "cn0_dbhz"), [("scalar", 34.0), ("one_stage", 28.5)])
def test_receiver_without_ins_survives_a_fall_by_ten_decibels_and_more(name: str, cn0_dbhz: float) -> None:
    of = setting("coherent", False, 100.0)
    of = replace(of, options=replace(of.options, estimates_cn0=True))
    profile = np.full((len(of.truth.t_s), 1), 45.0)
    profile[round(20.0 / of.truth.step_s) :] = cn0_dbhz

    assert np.mean([run.lost for run in run_many(of, VARIANTS[name], profile, 6, 61, 2)]) < 0.5


# half of the runs lose lock at 17.5 and 19.1 dBHz with known C/N0
@pytest.mark.parametrize(("name", "cn0_dbhz"), [("one_stage", 18.5), ("optimal", 20.1)])
def test_estimated_cn0_costs_a_decibel_of_the_threshold_at_most(name: str, cn0_dbhz: float) -> None:
    of = setting("coherent", True, 100.0)
    of = replace(of, options=replace(of.options, estimates_cn0=True))
    profile = np.full((len(of.truth.t_s), 1), 45.0)
    profile[round(20.0 / of.truth.step_s) :] = cn0_dbhz

    assert np.mean([run.lost for run in run_many(of, VARIANTS[name], profile, 10, 61, 2)]) < 0.5
