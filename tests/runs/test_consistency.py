"""NEES and NIS over independent simulated runs whose truth is the filter's own model: inside computed bounds.

Each epoch's mean is over the runs, which are independent; the epochs of one run are not, so the probability of a false
alarm is divided by the number of epochs and blocks looked at (Bonferroni) instead of averaging over time.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import stats

from insgnss.config.filter import NoiseConfig
from insgnss.config.flight import ImuGrade, Oscillator
from insgnss.filter.setup import FilterSetup
from insgnss.gnss.observation_rows import PSEUDORANGE, RANGE_RATE
from insgnss.simulation.simulated_log import Simulator
from insgnss.tables import Float64
from tests.runs.matched_runs import (
    BLOCKS,
    CLOCK_TYPE,
    GRADE,
    MatchedRun,
    matched_run,
    matched_setup,
    matched_simulator,
)
from tests.statistics_bounds import CONFIDENCE, assert_mean_chi_square, mean_chi_square_bounds, nees

RUNS = 250
RUNS_OF_A_WRONG_FILTER = 60
EPOCHS = (1, 10, 30, 60, 90, 119)  # while it converges, in turns and on legs
CONFIDENCE_OF_ONE = 1.0 - (1.0 - CONFIDENCE) / (len(EPOCHS) * len(BLOCKS))


@pytest.fixture(scope="module")
def simulator() -> Simulator:
    return matched_simulator()


def draw_runs(simulator: Simulator, setup: FilterSetup, count: int) -> list[MatchedRun]:
    generators = (np.random.default_rng([2015, i]) for i in range(count))
    return [matched_run(simulator.draw(rng), setup, EPOCHS, rng) for rng in generators]


@pytest.fixture(scope="module")
def runs(simulator: Simulator) -> list[MatchedRun]:
    return draw_runs(simulator, matched_setup(), RUNS)


def mean_nees(runs: list[MatchedRun], block: str) -> Float64:
    """Return the mean over the runs, one for each epoch."""
    part = BLOCKS[block]
    errors = np.array([run.error[:, part] for run in runs])
    covariances = np.array([run.P[:, part, part] for run in runs])
    return np.asarray(nees(errors, covariances).mean(axis=0))


def nees_bounds(block: str, count: int) -> tuple[float, float]:
    return mean_chi_square_bounds(BLOCKS[block].stop - BLOCKS[block].start, count, CONFIDENCE_OF_ONE)


@pytest.mark.parametrize("block", BLOCKS)
def test_nees_of_each_block_is_inside_its_bounds_at_each_epoch(runs: list[MatchedRun], block: str) -> None:
    low, high = nees_bounds(block, RUNS)
    found = mean_nees(runs, block)
    assert np.all((low <= found) & (found <= high)), f"{block}: {found} outside [{low:.3f}, {high:.3f}]"


def test_errors_have_no_mean(runs: list[MatchedRun]) -> None:
    """Each component over its own sigma, averaged over the runs, is normal with variance 1 / runs."""
    scaled = np.array([run.error / np.sqrt(np.diagonal(run.P, axis1=1, axis2=2)) for run in runs])
    limit = stats.norm.isf(0.5 * (1.0 - CONFIDENCE) / scaled[0].size) / np.sqrt(RUNS)
    assert np.abs(scaled.mean(axis=0)).max() < limit


def worse(grade: ImuGrade = GRADE, clock: Oscillator = CLOCK_TYPE, noise: float = 1.0) -> FilterSetup:
    """Return the filter that takes a sensor, the clock or both kinds of measurement for better than they are."""
    setup = matched_setup()
    kinds = ("pseudorange_noise_m", "range_rate_noise_mps")
    config = setup.config.model_copy(
        update={kind: scaled(getattr(setup.config, kind), noise) for kind in kinds}
    )
    return dataclasses.replace(setup, config=config, grade=grade, oscillator=clock)


def scaled(noise: NoiseConfig, factor: float) -> NoiseConfig:
    names = ("floor", "elevation", "cn0_at_45_dbhz")
    return noise.model_copy(update={name: getattr(noise, name) * factor for name in names})


def grade_with(**changes: float) -> ImuGrade:
    return GRADE.model_copy(update=changes)


@pytest.mark.parametrize(
    ("blocks", "setup"),
    [
        (("whole", "position", "velocity"), worse(noise=0.5)),
        (("attitude", "gyro bias"), worse(grade_with(gyro_bias_instability_deg_per_h=5.0))),
        (("accelerometer bias",), worse(grade_with(accel_bias_instability_mg=0.5))),
        (("clock",), worse(clock=CLOCK_TYPE.model_copy(update={"h_minus2_per_s": 1e-22}))),
    ],
    ids=["measurements", "gyros", "accelerometers", "clock"],
)
def test_nees_of_a_filter_that_believes_too_much_is_above_its_bound(
    simulator: Simulator, blocks: tuple[str, ...], setup: FilterSetup
) -> None:
    runs = draw_runs(simulator, setup, RUNS_OF_A_WRONG_FILTER)
    for block in blocks:
        assert mean_nees(runs, block)[-1] > nees_bounds(block, RUNS_OF_A_WRONG_FILTER)[1], block


def innovations_of(runs: list[MatchedRun], kind: int) -> tuple[Float64, Float64]:
    """Return the scaled innovations (runs, epochs, satellites) of a kind and the predicted shares of their variance."""
    return np.array([run.innovation[kind] for run in runs]), np.array(
        [run.predicted_share[kind] for run in runs]
    )


def independent_share(share: Float64) -> float:
    """Return by how much fewer independent values there are than innovations.

    Equation: Var(sum z_i^2) = 2 sum_ij rho_ij^2 with rho_ij^2 <= d_i d_j, d = D / S: within an epoch the innovations
    share the state's error and nothing else; those of different epochs are independent.
    """
    total = np.nansum(share, axis=-1)
    count = np.count_nonzero(np.isfinite(share))
    spread = count + np.sum(total**2) - np.nansum(share**2)
    return float(count / spread)


@pytest.mark.parametrize("kind", [PSEUDORANGE, RANGE_RATE], ids=["pseudorange", "range_rate"])
def test_nis_of_each_kind_is_inside_its_bounds(runs: list[MatchedRun], kind: int) -> None:
    scaled, share = innovations_of(runs, kind)
    nis = scaled[np.isfinite(scaled)] ** 2
    assert nis.size > 250_000
    assert_mean_chi_square(nis, 1, effective_share=independent_share(share))


@pytest.mark.parametrize("kind", [PSEUDORANGE, RANGE_RATE], ids=["pseudorange", "range_rate"])
def test_innovations_of_successive_epochs_are_uncorrelated(runs: list[MatchedRun], kind: int) -> None:
    """What one epoch left unused would show in the next: the correlation at lag one is zero within its bound."""
    scaled, share = innovations_of(runs, kind)
    product = scaled[:, :-1] * scaled[:, 1:]
    found = float(np.nanmean(product))
    independent = np.count_nonzero(np.isfinite(product)) * independent_share(share)
    limit = stats.norm.isf(0.5 * (1.0 - CONFIDENCE)) / np.sqrt(independent)
    assert abs(found) < limit, f"{found:.5f} beyond {limit:.5f}"
