"""Receivers whose inertial samples are missing or stand at the end of their range."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from insgnss.constants import STANDARD_GRAVITY_MPS2
from insgnss.errors import ConfigError
from insgnss.simulation.closed_loop_sky import InertialAiding
from insgnss.studies.receiver import runs as receiver_runs
from insgnss.studies.receiver.imu import UnknownMotion, with_gaps
from insgnss.studies.receiver.interval_message import widen_message
from insgnss.studies.receiver.scene import scene_of
from insgnss.studies.receiver.variants import VARIANTS
from tests.studies.test_receiver_study import (
    LOW,
    VELOCITY,
    flown,
    motion,
    nees_within_bounds,
    setting,
    settled,
    small,
)

RUNS = 4


def test_gap_holds_the_newest_sample_and_says_that_motion_is_unknown() -> None:
    n = 8
    told = InertialAiding(np.arange(3.0 * n).reshape(n, 3), -np.ones((n, 3)), np.ones((n, 6)))
    found, unknown = with_gaps(told, np.arange(n) * 1.0, LOW, ((2.0, 4.5),), UnknownMotion(10.0, 2.0))

    assert found.rate_b[2:5] == pytest.approx(np.tile(told.rate_b[1], (3, 1)))
    assert np.array_equal(found.rate_b[5:], told.rate_b[5:]) and not found.ahead_b[2:5].any()
    # 2 sigma^2 t (1 - exp(-t / tau)): of 0.5 rad/s and 1 s, of 10 m/s^2 and 2 s, since the sample of 1 s
    t = np.arange(1.0, 4.0)
    grown = np.column_stack([0.5 * t * (1.0 - np.exp(-t)), 200.0 * t * (1.0 - np.exp(-t / 2.0))])
    assert unknown[2:5] == pytest.approx(grown) and not unknown[[0, 1, 5, 6, 7]].any()


def test_gaps_cost_velocity_and_the_filter_knows_it() -> None:
    of = setting("noncoherent", True, 100.0)
    gapped = replace(of, options=replace(of.options, imu_gaps_s=((60.0, 60.3), (75.0, 76.0))))
    whole, runs = (flown(x, VARIANTS["one_stage"], 40.0, RUNS, 41) for x in (of, gapped))
    k = math.floor(60.2 / (of.record_every * of.truth.step_s))

    assert not any(run.lost for run in runs) and nees_within_bounds(gapped, runs)
    assert settled(gapped, runs, VELOCITY) > 1.3 * settled(of, whole, VELOCITY)
    assert runs[0].sd[k, 3:6].min() > 5.0 * whole[0].sd[k, 3:6].max()
    # and it is over within seconds
    assert runs[0].sd[k + 100, 3:6] == pytest.approx(whole[0].sd[k + 100, 3:6], rel=0.3)


@pytest.mark.parametrize("name", ["two_stage", "optimal"])
def test_channels_with_filters_of_their_own_know_of_a_gap_and_hold_their_phases(name: str) -> None:
    of = setting("coherent", True, 100.0)
    gapped = replace(of, options=replace(of.options, imu_gaps_s=((25.0, 25.1),)))
    runs = flown(gapped, VARIANTS[name], 40.0, RUNS, 43)
    after = slice(math.ceil(25.0 / (of.record_every * of.truth.step_s)), None)
    nees = np.mean([run.nees[after].mean() for run in runs])
    states = int(np.isfinite(runs[0].sd[0]).sum())

    assert not any(run.lost for run in runs)
    assert nees < stats.chi2.ppf(0.9995, states * RUNS) / (states * RUNS)


def test_noise_of_a_gap_grows_as_the_change_of_a_gauss_markov_process_since_the_sample_that_is_held() -> None:
    unknown, step_s, runs = UnknownMotion(3.0, 0.8), 0.01, 4000
    rng, decay = np.random.default_rng(45), math.exp(-step_s / unknown.time_s)
    value = unknown.sigma * rng.standard_normal(runs)
    held, change = value.copy(), np.zeros(runs)
    for _ in range(200):
        before = value
        value = decay * value + unknown.sigma * math.sqrt(1.0 - decay**2) * rng.standard_normal(runs)
        change += step_s * (0.5 * (before + value) - held)
    middles = step_s * (np.arange(200) + 0.5)

    # the variance of 4000 runs to 2 %, one sigma
    assert np.sum(unknown.density_since(middles)) * step_s == pytest.approx(np.var(change), rel=0.1)


def test_message_along_a_path_that_noise_moves_is_that_of_an_information_filter() -> None:
    rng = np.random.default_rng(44)
    root, U = rng.standard_normal((2, 2, 2)), (0.3, 0.11, 0.07)
    L, b = root[0] @ root[0].T, rng.standard_normal(2)
    s = np.column_stack([L, b])
    widen_message(s, U)
    expected = np.linalg.inv(np.linalg.inv(L) + np.reshape([U[0], U[1], U[1], U[2]], (2, 2)))

    assert s[:, :2] == pytest.approx(expected)
    assert s[:, 2] == pytest.approx(expected @ np.linalg.solve(L, b))


def test_saturated_accelerometers_are_lost_where_nothing_tells_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    of = setting("noncoherent", True, 100.0)
    assert of.inertial is not None
    narrow = replace(of, grade=LOW.model_copy(update={"accel_range_g": 8.0}))
    beyond = (np.abs(of.inertial.force_b) > 8.0 * STANDARD_GRAVITY_MPS2).any(axis=1)
    told = flown(narrow, VARIANTS["one_stage"], 40.0, RUNS, 42)
    monkeypatch.setattr(receiver_runs, "with_gaps", lambda told, since, *_: (told, np.zeros((len(since), 2))))
    untold = flown(narrow, VARIANTS["one_stage"], 40.0, 2, 42)

    assert 0.1 < beyond.mean() < 0.6
    assert not any(run.lost for run in told) and nees_within_bounds(narrow, told)
    assert all(run.lost for run in untold)


@pytest.mark.parametrize("gap", [(5.0, 4.0), (0.0, 1.0), (29.0, 31.0)])
def test_gap_that_is_none_is_refused(gap: tuple[float, float]) -> None:
    with pytest.raises(ConfigError, match="a gap from") as error:
        scene_of(motion(), "coherent", LOW, "tcxo", small(imu_gaps_s=(gap,)))

    assert error.value.key == "imu_gaps_s"
