"""The smoother: consistent, better than the filter, and the filter's own where there is nothing to come."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import insgnss
from insgnss.constants import NS_PER_S
from insgnss.errors import ConfigError
from insgnss.filter.loop import ImuSamples
from insgnss.filter.navigator import Navigator
from insgnss.filter.output.writing import Output, new_output
from insgnss.filter.setup import FilterSetup
from insgnss.filter.smoothing.across_gap import way_back, without_shown_motion
from insgnss.filter.smoothing.between import one_hypothesis
from insgnss.filter.smoothing.smoother import FilteredEpoch, Smoother
from insgnss.filter.smoothing.smoother_step import (
    apart,
    last_of_all,
    one_after_another,
    predicted,
    step_of_state,
)
from insgnss.filter.state import OFFSETS
from insgnss.filter.update.closed_loop import close_loop
from insgnss.geodesy.local_level import up_direction
from insgnss.simulation.simulated_log import SimulatedLog, Simulator
from insgnss.tables import Float64
from tests.runs.matched_runs import BLOCKS, error_state, matched_setup, matched_simulator
from tests.runs.test_carrier_consistency import opened, setup, simulated
from tests.statistics_bounds import CONFIDENCE, mean_chi_square_bounds, nees

RUNS = 40
LOOKS = (5, 30, 60, 90)
SAMPLE = "data/sample_flight/flight.toml"


def flown(
    simulator: Simulator, filter_setup: FilterSetup, seed: int
) -> tuple[SimulatedLog, Smoother, Output]:
    """Return a log of the filter's own model and the smoother that has gone forward over it."""
    rng = np.random.default_rng([1965, seed])
    log = simulator.draw(rng)
    rows = filter_setup.rows(log.gnss, filter_setup.navigation)
    out = new_output(rows, len(rows.epoch_ns), 64, np.zeros(0, np.int64))
    navigator = Navigator(filter_setup)
    navigator.bank, navigator.started_ns = opened(log, filter_setup, rng), int(log.at_gnss.t_ns[0])
    smoother = Smoother(navigator, ImuSamples(log.imu.t_ns, log.imu.w_ib_b, log.imu.f_b))
    smoother.forward(rows, 1, len(rows.epoch_ns), out)
    return log, smoother, out


def error_of(kept: FilteredEpoch, e: Float64, log: SimulatedLog, epoch: int) -> Float64:
    state = kept.bank.state.copy()
    close_loop(state[0], e, len(e))
    return error_state(state[0], log, epoch)


@cache
def smoothed_runs(carrier: bool) -> tuple[Float64, Float64, Float64, Float64]:
    """Return errors (r, k, 17) and covariances (r, k, 17, 17) of smoother and filter."""
    simulator, filter_setup = (simulated(), setup()) if carrier else (matched_simulator(), matched_setup())
    errors, covariances, before, filtered = [], [], [], []
    for seed in range(RUNS):
        log, smoother, _ = flown(simulator, filter_setup, seed)
        found = list(smoother.backward())[::-1]
        at = [found[look - 1] for look in LOOKS]  # the first epoch is in the start
        errors.append([error_of(kept, e, log, look) for (kept, e, _), look in zip(at, LOOKS, strict=True)])
        covariances.append([P[:OFFSETS, :OFFSETS] for _, _, P in at])
        before.append(
            [error_of(kept, 0.0 * e, log, look) for (kept, e, _), look in zip(at, LOOKS, strict=True)]
        )
        filtered.append([kept.bank.P[0, :OFFSETS, :OFFSETS] for kept, _, _ in at])
    return np.array(errors), np.array(covariances), np.array(before), np.array(filtered)


@pytest.mark.parametrize("block", BLOCKS)
def test_smoothed_errors_are_as_large_as_their_covariance_says(block: str) -> None:
    """Too small a covariance and too large a one both fail: so the gain of the backward pass is right too."""
    errors, covariances, _, _ = smoothed_runs(carrier=False)
    part = BLOCKS[block]
    dof = part.stop - part.start
    low, high = mean_chi_square_bounds(dof, RUNS, 1.0 - (1.0 - CONFIDENCE) / (len(LOOKS) * len(BLOCKS)))

    found = nees(errors[:, :, part], covariances[:, :, part, part]).mean(axis=0)

    assert (found > low).all()
    assert (found < high).all()


@pytest.mark.parametrize("block", ["position", "velocity", "attitude"])
def test_smoothed_errors_with_carriers_are_within_their_covariance(block: str) -> None:
    """Differences that follow each other share a phase, which the filter neglects: sigma may be too large."""
    errors, covariances, _, _ = smoothed_runs(carrier=True)
    part = BLOCKS[block]
    low, high = mean_chi_square_bounds(3, RUNS, 1.0 - (1.0 - CONFIDENCE) / (len(LOOKS) * 3))

    found = nees(errors[:, :, part], covariances[:, :, part, part]).mean(axis=0)

    assert (found > 0.5 * low).all()
    assert (found < high).all()


@pytest.mark.parametrize("carrier", [False, True])
def test_smoother_knows_every_state_at_least_as_well_as_the_filter(carrier: bool) -> None:
    _, covariances, _, filtered = smoothed_runs(carrier)
    variances = np.diagonal(covariances, axis1=2, axis2=3), np.diagonal(filtered, axis1=2, axis2=3)

    assert (variances[0] <= variances[1] * (1.0 + 1e-6)).all()
    assert (np.linalg.eigvalsh(covariances)[..., 0] > 0.0).all()


@pytest.mark.parametrize("carrier", [False, True])
def test_smoother_errs_less_than_the_filter(carrier: bool) -> None:
    errors, _, before, _ = smoothed_runs(carrier)
    for block in ("position", "velocity", "attitude"):
        part = BLOCKS[block]
        assert np.mean(errors[:, :, part] ** 2) < 0.8 * np.mean(before[:, :, part] ** 2)


def test_last_epoch_is_the_filters_to_the_bit_and_a_reset_parts_the_log() -> None:
    _, smoother, _ = flown(matched_simulator(), matched_setup(), 1)
    n = len(smoother.kept)
    smoother.kept[60] = smoother.kept[60]._replace(linked=False)

    found = list(smoother.backward())[::-1]

    for at in (n - 1, 59):  # the last of the log, and the last before the reset
        kept, e, P = found[at]
        assert not e.any()
        np.testing.assert_array_equal(P, kept.bank.P[0])
    assert found[58][1].any()


def test_clock_that_stepped_tells_nothing_of_the_clock_before() -> None:
    _, smoother, _ = flown(matched_simulator(), matched_setup(), 2)
    plain = list(smoother.backward())[::-1]
    smoother.kept[60] = smoother.kept[60]._replace(stepped=(15,))

    stepped = list(smoother.backward())[::-1]

    clock, position = (15, 15), (0, 0)
    filtered = smoother.kept[59].bank.P[0]
    assert stepped[59][2][clock] > plain[59][2][clock]
    assert stepped[59][2][position] < 0.9 * filtered[position]  # the rest is smoothed across the step


def test_way_back_to_a_first_sample_is_the_transition_inverted() -> None:
    """Of a filter that began at an epoch, the samples before it give P(t_0) = Phi^-1 (P + Q) Phi^-T and its state."""
    log, smoother, _ = flown(matched_simulator(), matched_setup(), 3)
    navigator, at = smoother.navigator, smoother.kept[60]
    parameters, layout = without_shown_motion(navigator.parameters), navigator.setup.layout
    before = int(np.searchsorted(log.imu.t_ns, at.t_ns - 3 * NS_PER_S))
    imu = ImuSamples(*(column[before:] for column in (log.imu.t_ns, log.imu.w_ib_b, log.imu.f_b)))
    found, n = last_of_all(at, layout), OFFSETS + layout.n_values

    found = found._replace(kept=at._replace(anew=True))

    (first,) = way_back(found, imu, parameters, layout)

    left = step_of_state(
        one_hypothesis(first.state().reshape(1), at.bank.P, first.kept.bank.head),
        found,
        imu,
        parameters,
        layout,
    )
    assert (np.abs(left) < 1e-4 * np.sqrt(np.diagonal(found.P))).all()
    known = first.kept.bank._replace(P=1e-6 * np.eye(at.bank.P.shape[1])[None])
    carried, cross = predicted(known, at, imu, parameters[0], n)
    Phi = 1e6 * cross[:, :n].T
    back = np.linalg.inv(Phi)
    Q = carried[:n, :n] - 1e-6 * Phi @ Phi.T
    expected = back @ (found.P + Q) @ back.T
    sigma = np.sqrt(np.diagonal(expected))
    np.testing.assert_allclose(first.P / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=1e-3)


@pytest.mark.parametrize("turn_deg", [0.0, 16.0, -90.0])
def test_two_corrections_of_an_attitude_are_one(turn_deg: float) -> None:
    """Their sum is wrong by as much as the first one turns the second one's tilt."""
    _, smoother, _ = flown(matched_simulator(), matched_setup(), 4)
    start, n = smoother.kept[-1].bank.state[:1], OFFSETS
    up = np.array(up_direction(start[0].r_e))
    first, then = np.zeros((2, n))
    first[6:9] = np.radians([0.3, -0.2, 0.1]) + np.radians(turn_deg) * up
    then[6:9] = np.radians([0.8, 0.5, -0.4])
    one_by_one, at_once = start.copy(), start.copy()
    close_loop(one_by_one[0], first, n)
    close_loop(one_by_one[0], then, n)

    both = first + then
    both[6:9] = one_after_another(first[6:9], then[6:9], up)
    close_loop(at_once[0], both, n)

    np.testing.assert_allclose(at_once[0].C_eb, one_by_one[0].C_eb, atol=1e-9)
    layout = smoother.navigator.setup.layout
    np.testing.assert_allclose(apart(one_by_one[0], start[0], layout)[6:9], both[6:9], atol=1e-9)


def test_replay_smooths_the_sample_flight() -> None:
    filtered, smoothed = insgnss.replay(SAMPLE), insgnss.replay(SAMPLE, smooth=True)

    assert len(filtered.nav) == len(smoothed.nav)
    assert filtered.nav.iloc[-1].equals(smoothed.nav.iloc[-1])
    assert filtered.measurements.equals(smoothed.measurements)
    assert smoothed.errors is not None
    assert filtered.errors is not None
    later = slice(100, None)  # the heading is known
    for name in ("n_m", "d_m", "ve_mps", "roll_deg"):
        rms = [float(np.sqrt(np.mean(run.errors[f"d_{name}"][later] ** 2))) for run in (smoothed, filtered)]
        assert rms[0] < 0.85 * rms[1]
    assert smoothed.settings["smooth"] is True


@pytest.mark.parametrize("asked", [{"aiding": 10.0}, {"supervise": True}])
def test_smoothing_refuses_what_lives_on_the_past(asked: dict[str, object]) -> None:
    with pytest.raises(ConfigError, match="no aiding and no supervision"):
        insgnss.replay(SAMPLE, smooth=True, **asked)  # type: ignore[arg-type]
