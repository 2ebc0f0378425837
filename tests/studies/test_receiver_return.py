"""Phases that come back after their signals were gone: whether the filter still knows their cycle, and its honesty."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from scipy import stats

from insgnss.constants import C_MPS
from insgnss.simulation.closed_loop_sky import GLONASS_RADIUS_M
from insgnss.studies import ReceiverOptions
from insgnss.studies.receiver.runs import ReceiverRun, Setting, run_many
from insgnss.studies.receiver.scene import scene_of
from insgnss.studies.receiver.variants import VARIANTS
from tests.studies.test_receiver_study import LOW, motion

GONE_S, BACK_S, LASTS_S, RUNS = 20.0, 35.0, 45.0, 6
HALF_CYCLE_M = 0.5 * C_MPS / 1.6e9


@cache
def of() -> Setting:
    options = ReceiverOptions(
        duration_s=LASTS_S, settle_s=15.0, carrier_hz=1.6e9, chip_hz=1.022e6, orbit_radius_m=GLONASS_RADIUS_M
    )
    return scene_of(motion(), "coherent", LOW, {"drift_density": 100.0}, options).setting


@cache
def flown(name: str, gone_s: float, back_s: float, channels: int = 8) -> list[ReceiverRun]:
    """Return runs at 45 dBHz in which the first channels have no signal for a time."""
    truth = of().truth
    since_s = truth.t_s - truth.t_s[0]
    cn0 = np.full(truth.ranges.shape, 45.0)
    cn0[(since_s >= gone_s) & (since_s < back_s), :channels] = np.nan
    return run_many(of(), VARIANTS[name], cn0, RUNS, 7, 2)


def rows(begin_s: float, end_s: float) -> slice:
    """Return the recorded integrations of a time."""
    record_s = of().record_every * of().truth.step_s
    return slice(math.ceil(begin_s / record_s), math.ceil(end_s / record_s))


AFTER = rows(BACK_S + 1.0, LASTS_S)


@pytest.mark.parametrize("name", ["two_stage", "optimal", "one_stage", "one_stage_code"])
def test_filter_is_honest_after_a_return_whose_cycles_are_open(name: str) -> None:
    runs = flown(name, GONE_S, BACK_S)
    nees = np.mean([run.nees[AFTER].mean() for run in runs])
    states = int(np.isfinite(runs[0].sd[0]).sum())
    low, high = stats.chi2.interval(0.999, states * RUNS)

    assert low < nees * states * RUNS < high
    # the coast has left metres: the new velocity says something of them, no phase says which cycle it is ...
    at_once = rows(BACK_S + 0.1, BACK_S + 0.2)
    assert min(np.linalg.norm(run.sd[at_once, :3]) for run in runs) > HALF_CYCLE_M
    # ... but the velocity is that of before within a second
    before = np.mean([run.sd[rows(15.0, GONE_S), 3:6] for run in runs])
    assert np.mean([run.sd[AFTER, 3:6] for run in runs]) < 1.1 * before
    assert not any(run.lost for run in runs)


def test_phases_whose_signals_are_gone_for_a_moment_keep_their_cycles() -> None:
    runs = flown("one_stage", GONE_S, GONE_S + 0.1)

    # no phase begins a state of its own: the position is as good as ever
    assert all(not run.apart[..., 1].any() for run in runs)
    assert max(run.sd[rows(GONE_S + 1.0, LASTS_S), :3].max() for run in runs) < 0.01


def test_phase_that_comes_back_among_others_keeps_its_cycle() -> None:
    runs = flown("one_stage", GONE_S, BACK_S, channels=2)

    assert all(not run.apart[..., 1].any() for run in runs)
    states = int(np.isfinite(runs[0].sd[0]).sum())
    low, high = stats.chi2.interval(0.999, states * RUNS)
    nees = np.mean([run.nees[AFTER].mean() for run in runs])
    assert low < nees * states * RUNS < high


# with its fraction of a cycle taken for known, sigmas of the position fall by 8 % at once, with code by 0.45 %
@pytest.mark.parametrize(
    ("name", "share"),
    [("two_stage", 0.99), ("optimal", 0.99), ("one_stage", 0.99), ("one_stage_code", 0.999)],
)
def test_phase_of_a_satellite_that_rises_begins_from_pseudo_coordinates(name: str, share: float) -> None:
    runs, without = (flown(name, 0.0, back_s, channels=1) for back_s in (BACK_S, LASTS_S))
    at_once = rows(BACK_S + 0.1, BACK_S + 0.2)

    for run, other in zip(runs, without, strict=True):
        # however well its range is predicted, it has a state of its own and says nothing of the position
        assert run.apart[-1, 0, 1] > 0.0
        assert (run.sd[at_once, :3] > share * other.sd[at_once, :3]).all()


def test_filter_is_honest_after_a_satellite_has_risen() -> None:
    runs = flown("one_stage", 0.0, BACK_S, channels=1)
    states = int(np.isfinite(runs[0].sd[0]).sum())
    low, high = stats.chi2.interval(0.999, states * RUNS)

    assert low < np.mean([run.nees[AFTER].mean() for run in runs]) * states * RUNS < high


def test_states_of_phases_change_nothing_while_no_signal_is_gone() -> None:
    cn0 = np.full(of().truth.ranges.shape, 45.0)
    plain = run_many(of(), VARIANTS["one_stage"], cn0, 1, 7, 1)[0]
    cn0[-1, 0] = np.nan  # there is room for states, and no time to use it
    with_room = run_many(of(), VARIANTS["one_stage"], cn0, 1, 7, 1)[0]

    assert with_room.error[:-1] == pytest.approx(plain.error[:-1], abs=1e-7)
    assert with_room.nees[:-1] == pytest.approx(plain.nees[:-1], rel=1e-4)
