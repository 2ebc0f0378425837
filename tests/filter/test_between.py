"""Times between epochs: smoothed as an epoch without measurements would be, and as well as their covariance says."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from insgnss.filter.navigator import Navigator
from insgnss.filter.output.writing import new_output
from insgnss.filter.prediction import ImuSamples, carry_bank, new_scratch, predict_covariance
from insgnss.filter.setup import FilterSetup
from insgnss.filter.smoothing.between import (
    InterpolatedStates,
    Nodes,
    _distinct_steps,
    one_hypothesis,
    smoothed,
)
from insgnss.filter.smoothing.smoother import Smoother
from insgnss.filter.smoothing.smoother_step import FilteredEpoch, SmoothedEpoch, one_back
from insgnss.filter.state import OFFSETS, STATE_DTYPE
from insgnss.filter.update.closed_loop import close_loop
from insgnss.simulation.simulated_log import SimulatedLog, Simulator
from insgnss.tables import Float64, Int64
from tests.runs.matched_runs import BLOCKS, error_state, matched_setup, matched_simulator
from tests.runs.test_carrier_consistency import opened, setup, simulated
from tests.statistics_bounds import CONFIDENCE, mean_chi_square_bounds, nees

RUNS = 40
LAST, BACK = 40, 80  # epochs around 40 s without measurements
LOOKS = (45, 60, 75)  # seconds inside them, at which the truth is known


def flown(simulator: Simulator, filter_setup: FilterSetup, seed: int) -> tuple[SimulatedLog, Smoother]:
    """Return a log of the filter's own model and the smoother that has gone over it, but for 40 s."""
    rng = np.random.default_rng([1976, seed])
    log = simulator.draw(rng)
    rows = filter_setup.rows(log.gnss, filter_setup.navigation)
    out = new_output(rows, len(rows.epoch_ns), 64, np.zeros(0, np.int64))
    navigator = Navigator(filter_setup)
    navigator.bank, navigator.started_ns = opened(log, filter_setup, rng), int(log.at_gnss.t_ns[0])
    smoother = Smoother(navigator, ImuSamples(log.imu.t_ns, log.imu.w_ib_b, log.imu.f_b))
    smoother.forward(rows, 1, LAST + 1, out)
    smoother.forward(rows, BACK, len(rows.epoch_ns), out)
    return log, smoother


def before_the_gap(smoother: Smoother, t_ns: int) -> tuple[SmoothedEpoch, SmoothedEpoch]:
    """Return the last epoch before the gap and the first after it."""
    found = list(smoother._back())[::-1]
    at = next(i for i, one in enumerate(found) if one.kept.t_ns == t_ns)
    return found[at], found[at + 1]


def silent(bank: Any, t_ns: int, imu: ImuSamples, parameters: npt.NDArray[Any]) -> FilteredEpoch:
    """Return an epoch without measurements."""
    carried = one_hypothesis(bank.state, bank.P, bank.head)
    scratch = new_scratch(carried.P.shape[1])
    carry_bank(carried, t_ns, imu, parameters[0], scratch)
    predict_covariance(carried.state[0], carried.P[0], parameters[0], scratch)
    q = carried.P.shape[1]
    return FilteredEpoch(carried, np.zeros(q), np.zeros((0, q)), linked=True)


def parts_of(found: SmoothedEpoch, times_ns: Int64, smoother: Smoother) -> list[InterpolatedStates]:
    """Return the smoothed states at times after an epoch, in their order."""
    assert found.onward is not None
    parts = smoothed(found.kept.bank, times_ns, found.onward, smoother.navigator.parameters, len(found.e))
    return list(parts)[::-1]


def test_time_between_epochs_is_smoothed_like_an_epoch_without_measurements() -> None:
    """By steps of Rauch, Tung and Striebel over one such epoch a second, each with an inverse of its own."""
    log, smoother = flown(matched_simulator(), matched_setup(), 7)
    navigator, imu = smoother.navigator, smoother.imu
    last, back = before_the_gap(smoother, int(log.at_gnss.t_ns[LAST]))
    times_ns = log.at_gnss.t_ns[LAST + 1 : BACK]
    between = parts_of(last, times_ns, smoother)

    chain = [last.kept]
    for t_ns in times_ns:
        chain.append(silent(chain[-1].bank, int(t_ns), imu, navigator.parameters))
    later, expected = back, {}
    for kept in chain[:0:-1]:
        later = one_back(kept, later, imu, navigator.parameters, navigator.setup.layout)
        expected[kept.t_ns] = later

    assert sum(len(part.state) for part in between) == len(times_ns)
    for part in between:
        for e, P, t_ns in zip(part.correction, part.P, times_ns[part.rows], strict=True):
            step = expected[int(t_ns)]
            sigma = np.sqrt(np.diagonal(step.P))
            np.testing.assert_allclose(e / sigma, step.e / sigma, atol=2e-5)
            np.testing.assert_allclose(P / np.outer(sigma, sigma), step.P / np.outer(sigma, sigma), atol=2e-5)


def test_states_at_both_ends_of_a_way_are_those_of_its_epochs() -> None:
    log, smoother = flown(matched_simulator(), matched_setup(), 8)
    last, back = before_the_gap(smoother, int(log.at_gnss.t_ns[LAST]))
    near_ns = np.array([last.kept.t_ns + 1000, back.kept.t_ns - 1000])

    first, final = parts_of(last, near_ns, smoother)

    for part, epoch in ((first, last), (final, back)):
        state = part.state[:1].copy()
        close_loop(state[0], np.ascontiguousarray(part.correction[0]), len(epoch.e))
        sigma = np.sqrt(np.diagonal(epoch.P))
        assert np.linalg.norm(state["r_e"][0] - epoch.state().r_e) < 1e-3 * sigma[0] + 2e-4
        np.testing.assert_allclose(np.sqrt(np.diagonal(part.P[0])), sigma, rtol=2e-3)


@cache
def runs_inside(carrier: bool) -> tuple[Float64, Float64, Float64, Float64]:
    """Return errors (r, k, 17) and covariances (r, k, 17, 17) of smoother and filter inside the gap."""
    simulator, filter_setup = (simulated(), setup()) if carrier else (matched_simulator(), matched_setup())
    errors, covariances, before, filtered = [], [], [], []
    for seed in range(RUNS):
        log, smoother = flown(simulator, filter_setup, seed)
        last, _ = before_the_gap(smoother, int(log.at_gnss.t_ns[LAST]))
        times_ns = log.at_gnss.t_ns[list(LOOKS)]
        parts = parts_of(last, times_ns, smoother)
        states = np.concatenate([part.state for part in parts])
        before.append([error_state(m, log, look) for m, look in zip(states, LOOKS, strict=True)])
        for m, e in zip(states, np.concatenate([part.correction for part in parts]), strict=True):
            close_loop(m, e, len(e))
        errors.append([error_state(m, log, look) for m, look in zip(states, LOOKS, strict=True)])
        covariances.append(np.concatenate([part.P for part in parts])[:, :OFFSETS, :OFFSETS])
        kept = [silent(last.kept.bank, int(t), smoother.imu, smoother.navigator.parameters) for t in times_ns]
        filtered.append([one.bank.P[0, :OFFSETS, :OFFSETS] for one in kept])
    return np.array(errors), np.array(covariances), np.array(before), np.array(filtered)


@pytest.mark.parametrize("block", BLOCKS)
def test_errors_inside_a_gap_are_as_large_as_their_covariance_says(block: str) -> None:
    errors, covariances, _, _ = runs_inside(carrier=False)
    part = BLOCKS[block]
    dof = part.stop - part.start
    low, high = mean_chi_square_bounds(dof, RUNS, 1.0 - (1.0 - CONFIDENCE) / (len(LOOKS) * len(BLOCKS)))

    found = nees(errors[:, :, part], covariances[:, :, part, part]).mean(axis=0)

    assert (found > low).all()
    assert (found < high).all()


@pytest.mark.parametrize("block", ["position", "velocity", "attitude"])
def test_errors_inside_a_gap_with_carriers_are_within_their_covariance(block: str) -> None:
    """Differences that follow each other share a phase, which the filter neglects: sigma may be too large."""
    errors, covariances, _, _ = runs_inside(carrier=True)
    part = BLOCKS[block]
    low, high = mean_chi_square_bounds(3, RUNS, 1.0 - (1.0 - CONFIDENCE) / (len(LOOKS) * 3))

    found = nees(errors[:, :, part], covariances[:, :, part, part]).mean(axis=0)

    assert (found > 0.5 * low).all()
    assert (found < high).all()


@pytest.mark.parametrize("carrier", [False, True])
def test_inside_a_gap_the_smoother_knows_more_and_errs_less_than_the_filter(carrier: bool) -> None:
    errors, covariances, before, filtered = runs_inside(carrier)
    variances = np.diagonal(covariances, axis1=2, axis2=3), np.diagonal(filtered, axis1=2, axis2=3)

    assert (variances[0] <= variances[1] * (1.0 + 1e-6)).all()
    assert (np.linalg.eigvalsh(covariances)[..., 0] > 0.0).all()
    for block, share in (("position", 0.35), ("velocity", 0.35)):
        part = BLOCKS[block]
        assert np.sqrt(np.mean(errors[:, 1:, part] ** 2) / np.mean(before[:, 1:, part] ** 2)) < share


def test_times_within_one_step_of_the_covariance_share_its_inverse() -> None:
    P = np.zeros((4, 2, 2))
    P[2:] = 1.0
    Phi = np.tile(np.eye(2), (4, 1, 1))
    Phi[3, 0, 1] = 0.1

    first, step = _distinct_steps(Nodes(np.zeros(4, STATE_DTYPE), P, Phi, P, Phi))

    assert first.tolist() == [0, 2, 3] and step.tolist() == [0, 0, 1, 2]
