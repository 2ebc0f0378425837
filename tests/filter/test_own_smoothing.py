"""The smoother over a user's own rows between epochs: consistent, and nothing changes where they tell nothing."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from functools import cache

import numpy as np
import pytest

import insgnss
from insgnss.filter.navigator import Navigator
from insgnss.filter.output.writing import Output, new_output
from insgnss.filter.own_rows.declared import own_measurements
from insgnss.filter.prediction import ImuSamples
from insgnss.filter.setup import FilterSetup
from insgnss.filter.smoothing.smoother import Smoother
from insgnss.filter.state import OFFSETS
from insgnss.simulation.faults import outage
from insgnss.simulation.simulated_log import SimulatedLog
from insgnss.tables import Float64, Int64
from tests.filter.test_smoother import error_of
from tests.runs.matched_runs import matched_setup, matched_simulator
from tests.runs.scenes import START_NS, with_faults
from tests.runs.test_carrier_consistency import opened, setup, simulated
from tests.statistics_bounds import CONFIDENCE, mean_chi_square_bounds, nees

RUNS = 16  # the bounds of a block are 0.39 and 2.0 of what its covariance says
SIGMA_M = 1.0
GONE_S = (40.0, 70.0)
BLOCKS = {"position": slice(0, 3), "velocity": slice(3, 6), "attitude": slice(6, 9)}
LOOKS_S = (20.0, 38.0, 75.0, 100.0)


@dataclasses.dataclass(frozen=True)
class Position:
    """Two components of the position in ECEF."""

    times_ns: Int64
    value: Float64  # (k, 2)
    sigma_m: float = SIGMA_M
    name: str = "position"

    def rows(
        self, state: insgnss.StateEstimate, layout: insgnss.StateLayout
    ) -> list[tuple[float, Mapping[str, Float64], float]]:
        z = self.value[np.searchsorted(self.times_ns, state.t_ns)]
        return [(z[i] - state.r_e[i], {"position": np.eye(3)[i]}, self.sigma_m**2) for i in range(2)]


def own_times() -> Int64:
    """Return times every half second, at epochs and between them, from the third epoch on."""
    return START_NS + np.arange(3000, 119000, 500) * 1_000_000


def measured(
    log: SimulatedLog, truth_r_e: Float64, rng: np.random.Generator, times_ns: Int64, sigma_m: float
) -> Position:
    at = np.searchsorted(log.imu.t_ns, times_ns)
    assert (log.imu.t_ns[at] == times_ns).all()
    return Position(times_ns, truth_r_e[at, :2] + sigma_m * rng.standard_normal((len(at), 2)), sigma_m)


def flown(
    seed: int, *, carrier: bool, gone: bool = True, sigma_m: float = SIGMA_M, own: bool = True
) -> tuple[SimulatedLog, Smoother, Output]:
    """Return a log of the filter's own model with an outage, and the smoother that has gone forward over it."""
    simulator = simulated() if carrier else matched_simulator()
    filter_setup: FilterSetup = setup() if carrier else matched_setup()
    simulator = with_faults(simulator, [outage(None, *GONE_S)] if gone else [])
    rng = np.random.default_rng([1990, seed])
    log = simulator.draw(rng)
    bank = opened(log, filter_setup, rng)
    if own:
        mine = measured(log, simulator.imu_motion.r_e, rng, own_times(), sigma_m)
        filter_setup = dataclasses.replace(filter_setup, own=own_measurements([mine]))
    rows = filter_setup.rows(log.gnss, filter_setup.navigation)
    out = new_output(rows, len(rows.epoch_ns), 64, np.zeros(0, np.int64))
    navigator = Navigator(filter_setup)
    navigator.bank, navigator.started_ns = bank, int(log.at_gnss.t_ns[0])
    smoother = Smoother(navigator, ImuSamples(log.imu.t_ns, log.imu.w_ib_b, log.imu.f_b))
    smoother.forward(rows, 1, len(rows.epoch_ns), out)
    return log, smoother, out


@cache
def smoothed_runs(carrier: bool) -> tuple[Float64, Float64, Float64]:
    """Return errors (r, k, 17), their covariances and the filter's variances (r, k, 17) at epochs beside the outage."""
    errors, covariances, before = [], [], []
    looks = [START_NS + int(s * 1e9) for s in LOOKS_S]
    for seed in range(RUNS):
        log, smoother, _ = flown(seed, carrier=carrier)
        at = {kept.t_ns: (kept, e, P) for kept, e, P in smoother.backward() if not kept.is_own}
        truth = {int(t): i for i, t in enumerate(log.at_gnss.t_ns)}
        errors.append([error_of(at[t][0], at[t][1], log, truth[t]) for t in looks])
        covariances.append([at[t][2][:OFFSETS, :OFFSETS] for t in looks])
        before.append([np.diag(at[t][0].bank.P[0])[:OFFSETS] for t in looks])
    return np.array(errors), np.array(covariances), np.array(before)


@pytest.mark.parametrize("block", BLOCKS)
def test_smoothed_errors_beside_an_outage_with_own_rows_are_as_large_as_they_say(block: str) -> None:
    errors, covariances, before = smoothed_runs(carrier=False)
    part = BLOCKS[block]
    low, high = mean_chi_square_bounds(3, RUNS, 1.0 - (1.0 - CONFIDENCE) / (len(LOOKS_S) * len(BLOCKS)))

    ratio = nees(errors[:, :, part], covariances[:, :, part, part]).mean(axis=0)

    assert (ratio > low).all() and (ratio < high).all(), ratio
    variances = np.diagonal(covariances, axis1=2, axis2=3)
    assert (variances <= before * (1.0 + 1e-6)).all()


@pytest.mark.parametrize("block", BLOCKS)
def test_smoothed_errors_with_carriers_and_own_rows_are_within_their_covariance(block: str) -> None:
    """As without own rows: differences that follow each other share a phase, so sigma may be too large."""
    errors, covariances, _ = smoothed_runs(carrier=True)
    part = BLOCKS[block]
    low, high = mean_chi_square_bounds(3, RUNS, 1.0 - (1.0 - CONFIDENCE) / (len(LOOKS_S) * len(BLOCKS)))

    ratio = nees(errors[:, :, part], covariances[:, :, part, part]).mean(axis=0)

    assert (ratio > 0.5 * low).all() and (ratio < high).all(), ratio


@pytest.mark.parametrize("carrier", [False, True])
def test_own_rows_that_tell_nothing_change_nothing_of_the_smoothed_epochs(carrier: bool) -> None:
    """Rows of 1000 km; the covariance's steps part at their times, which is worth a thousandth of a sigma."""
    _, plain, _ = flown(1, carrier=carrier, gone=False, own=False)
    _, told, _ = flown(1, carrier=carrier, gone=False, sigma_m=1e6)
    wanted = {kept.t_ns: (kept, e, P) for kept, e, P in plain.backward()}
    compared = 0
    for kept, e, P in told.backward():
        if kept.is_own:
            continue
        before, e_before, P_before = wanted[kept.t_ns]
        sd = np.sqrt(np.diag(P_before))[:OFFSETS]
        np.testing.assert_allclose(np.sqrt(np.diag(P))[:OFFSETS] / sd, 1.0, atol=5e-3)
        apart = kept.bank.state["r_e"][0] + e[:3] - before.bank.state["r_e"][0] - e_before[:3]
        assert np.abs(apart / sd[:3]).max() < 2e-2
        compared += 1
    assert compared == 119


def test_smoothed_row_at_the_time_of_own_rows_is_that_between_its_neighbours() -> None:
    """Rows of a smoothed run every 0.1 s through the outage: no step of either kind at the times of own rows."""
    log, smoother, _ = flown(3, carrier=True)
    navigator = smoother.navigator
    seconds = np.arange(45.0, 60.0, 0.1)
    times_ns = START_NS + np.round(seconds * 1e9).astype(np.int64)
    own = navigator.setup.own
    assert own is not None
    rows = navigator.setup.rows(log.gnss, navigator.setup.navigation)
    out = new_output(rows, len(times_ns), 64, times_ns, navigator.setup.layout.n_values)
    again = Navigator(navigator.setup)
    again.bank, again.started_ns = (
        opened(log, navigator.setup, np.random.default_rng(3)),
        navigator.started_ns,
    )
    redone = Smoother(again, ImuSamples(log.imu.t_ns, log.imu.w_ib_b, log.imu.f_b))
    redone.forward(rows, 1, len(rows.epoch_ns), out)
    filtered = out.nav["value"].copy()
    redone.finish(out)
    sd_n = out.nav["value"][:, 9]
    assert (sd_n < filtered[:, 9]).all()
    assert np.abs(np.diff(sd_n)).max() < 0.02 * sd_n.max()
    # height's growth and velocity down
    speed = np.diff(out.nav["value"][:, 2]) / 0.1 + out.nav["value"][1:, 5]
    assert np.abs(speed).max() < 0.1
