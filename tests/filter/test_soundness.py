"""No memory is overwritten and no NaN gets through, whatever numbers reach the filter's kernels."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest

from insgnss.constants import NS_PER_S
from insgnss.filter.loop import COVARIANCE_LOST, DONE, PRUNE, run_epochs
from insgnss.filter.output.writing import new_output
from insgnss.filter.rows.lines import Lines
from insgnss.filter.soundness import is_finite, is_sound
from insgnss.filter.state import BG, PSI, Bank, copy_bank, joined_banks
from insgnss.filter.update import consistency
from insgnss.filter.update.consistency import exchange, farthest, refuse_inconsistent, remove_smallest_set
from insgnss.filter.update.epoch_space import new_epoch, new_workspace
from insgnss.filter.update.epoch_update import use_rows
from insgnss.filter.update.gating import gate_rows
from insgnss.filter.update.scalar_update import scalar_update
from insgnss.status import GATED, NOT_STARTED, USED
from insgnss.tables import Float64
from tests.filter.scene import (
    START_NS,
    at_rest,
    new_filter,
    parameters,
    perfect_rows,
    place,
    sky,
)
from tests.kernels.filter import wrong_rows
from tests.layouts import layout_with

NO_VARIANCE = [math.nan, math.inf, -math.inf, 0.0, -1.0]
NO_NUMBER = [math.nan, math.inf, -math.inf]


# --- the search for rows that contradict the others ------------------------------------------------------------------


@pytest.mark.parametrize("bad", [math.nan, math.inf, -1.0, 0.0])
def test_search_over_sets_finds_none_in_numbers_that_are_none(bad: float) -> None:
    for n in (1, 2, 3, 7, 30):
        active = np.ones(n, np.int64)
        assert remove_smallest_set(np.full((n, n + 1), bad), active, 9.0, 3) == 0
        assert active.tolist() == [1] * n


@pytest.mark.parametrize("pivot", NO_VARIANCE)
def test_exchange_refuses_a_pivot_that_is_no_variance(pivot: float) -> None:
    T = np.random.default_rng(1).normal(size=(4, 5))
    T[2, 2] = pivot
    before = T.copy()

    assert not exchange(T, 2)
    np.testing.assert_array_equal(T, before)


def test_row_without_a_variance_is_neither_farthest_nor_nearest() -> None:
    T = np.diag([1.0, math.nan, -4.0, 1.0])
    T = np.column_stack([T, [2.0, 9.0, 9.0, math.nan]])
    active = np.ones(4, np.int64)

    assert farthest(T, active, 1) == (0, 4.0)
    assert farthest(T[1:3], active[1:3], 1) == (-1, 0.0)


@pytest.mark.parametrize("spoil", ["covariance", "variance", "innovation", "negative"])
def test_an_epoch_of_lost_numbers_refuses_no_row_as_inconsistent(spoil: str) -> None:
    P, lines = wrong_rows()
    if spoil == "covariance":
        P[0, 0] = math.nan
    elif spoil == "negative":
        P[:] = -P
    else:
        lines[spoil][3, 0] = math.nan

    assert refuse_inconsistent(P, lines, 0, 9.0) == 0
    assert (lines["status"][:, 0] == USED).all()


def test_what_the_search_finds_in_sound_numbers_has_not_changed() -> None:
    P, lines = wrong_rows()

    assert refuse_inconsistent(P, lines, 0, 9.0) == 2
    assert np.flatnonzero(lines["status"][:, 0] == consistency.INCONSISTENT).tolist() == [2, 7]


# --- variances of innovations ----------------------------------------------------------------------------------------


def one_row(variance: float, predicted: float = 1.0, innovation: float = 0.0) -> Lines:
    lines = new_epoch(1, 17).lines
    lines["status"], lines["innovation"] = USED, innovation
    lines["variance"], lines["predicted"] = variance, predicted
    lines["h"][0, 0, :3] = 1.0
    return lines


@pytest.mark.parametrize(
    ("variance", "predicted"), [(-3.0, 1.0), (math.inf, 1.0), (1.0, math.nan), (-1.0, 1.0)]
)
def test_gate_refuses_an_innovation_whose_variance_is_none(variance: float, predicted: float) -> None:
    lines = one_row(variance, predicted)

    assert gate_rows(lines, 0, 25.0)[:2] == (0, 1)
    assert lines["status"][0, 0] == GATED


@pytest.mark.parametrize("variance", [-10.0, math.nan, math.inf])
def test_update_without_a_variance_changes_nothing_and_leaves_a_finite_likelihood(variance: float) -> None:
    P = np.eye(17)
    vectors = np.zeros((4, 17))
    lines = one_row(variance, innovation=1.0)
    columns = lines[0].columns[0][:7]

    scalar_update(P, lines[0].h[0], columns, 1.0, variance, vectors)
    likelihood, _ = use_rows(P, lines, vectors, 0, 25.0, 1.0, np.zeros(0))

    np.testing.assert_array_equal(P, np.eye(17))
    np.testing.assert_array_equal(vectors[0], 0.0)
    assert lines["status"][0, 0] == GATED
    assert math.isfinite(likelihood)


# --- a hypothesis that is lost ---------------------------------------------------------------------------------------


def sound() -> Bank:
    return new_filter(place(), offsets=(5.0,))


def _set(name: str, value: float) -> Callable[[Bank], None]:
    def spoil(bank: Bank) -> None:
        field = bank.state[name]
        field[0] = (
            value
            if field.ndim == 1
            else np.where(np.arange(field[0].size) == 1, value, 0).reshape(field[0].shape)
        )

    return spoil


STATES = (
    "q_eb",
    "C_eb",
    "r_e",
    "v_e",
    "b_a",
    "b_g",
    "clock",
    "optional",
    "r_clone",
    "C_swung",
    "clock_clone",
    "previous_zenith_delays",
)
SUMS = (
    "sum_dt",
    "f_smooth",
    "w_smooth",
    "f_mean",
    "v_mean",
    "v_mean_variance",
    "sum_dv",
    "sum_f",
    "sum_w",
    "sum_C",
    "sum_gyro_q",
    "sum_accel_q",
    "noise_factor",
    "weak_shown",
    "weak_rows",
    "cn0_level",
    "motion_response",
)


@pytest.mark.parametrize("bad", NO_NUMBER)
@pytest.mark.parametrize("name", [*STATES, *SUMS])
def test_every_number_of_the_state_is_looked_at(name: str, bad: float) -> None:
    bank = sound()
    assert is_sound(bank.state[0], bank.P[0])

    _set(name, bad)(bank)

    assert not is_finite(bank.state[0], bank.P[0])
    assert not is_sound(bank.state[0], bank.P[0])


@pytest.mark.parametrize(
    ("row", "column", "value"), [(3, 3, -1e-9), (17, 17, math.nan), (16, 16, 1e31), (2, 9, math.nan)]
)
def test_every_number_of_the_covariance_is_looked_at(row: int, column: int, value: float) -> None:
    bank = sound()
    bank.P[0, row, column] = value

    assert not is_sound(bank.state[0], bank.P[0])


@pytest.mark.parametrize(("name", "value"), [("r_e", 1e10), ("v_e", -1e7), ("clock", 1e16)])
def test_a_place_far_beyond_the_moon_is_no_state(name: str, value: float) -> None:
    bank = sound()
    bank.state[name][0] = value

    assert not is_sound(bank.state[0], bank.P[0])


def epochs_after(
    imu_value: float, bank: Bank, at: int = 150
) -> tuple[int, Bank, npt.NDArray[np.record], npt.NDArray[np.record]]:
    """Return why the loop stopped on four epochs with a sample of ``imu_value``, the bank, navigation and ledger."""
    here = place()
    par = parameters()
    epoch_ns = START_NS + np.arange(1, 5) * NS_PER_S
    imu = at_rest(here, bank.state[0].C_eb, 4.5, 100.0)
    log = perfect_rows(bank, par, epoch_ns, sky(here), w_ib_b=imu.w_ib_b[0])
    imu.w_ib_b[at, 2] = imu_value
    out = new_output(log, 600, 8, imu.t_ns.copy())
    code, _ = run_epochs(bank, (0, 4), log, imu, par, -30.0, out, new_workspace(12, layout_with()))
    return code, bank, out.nav[: out.counts[0].nav], out.ledger


@pytest.mark.parametrize("bad", [1e6, 1e29, 1e35, -1e100])
def test_wild_sample_that_a_quaternion_survives_leaves_finite_rows(bad: float) -> None:
    _, bank, nav, ledger = epochs_after(bad, new_filter(place()))

    assert np.isfinite(bank.P).all()
    assert np.isfinite(nav["value"]).all()
    assert not np.isinf(ledger["innovation"]).any()


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, -1e300])
def test_wild_sample_loses_the_filter_and_no_row_tells_of_it(bad: float) -> None:
    code, _, nav, ledger = epochs_after(bad, new_filter(place()))

    assert code == COVARIANCE_LOST
    assert 100 <= len(nav) <= 150  # of four seconds at 100 Hz, those before the sample
    assert np.isfinite(nav["value"]).all()
    assert (ledger["status"][12:24] == NOT_STARTED).all()
    for name in ("innovation", "variance", "predicted"):
        assert np.isfinite(ledger[name][:12]).all()
        assert np.isnan(ledger[name][12:24]).all()


@pytest.mark.parametrize("lead", [0, 1])
def test_lost_hypothesis_has_no_weight_and_the_others_go_on(lead: int) -> None:
    one = new_filter(place())
    bank = joined_banks(one, copy_bank(one))
    bank.state["log_weight"] = math.log(0.5)
    bank.state["b_g"][1 - lead, 0] += 1e-6
    lost = lead  # the first one is the leader
    bank.P[lost, PSI, BG] = math.nan

    code, bank, nav, _ = epochs_after(0.0, bank)

    assert code == PRUNE
    assert bank.state["log_weight"][lost] == -math.inf
    assert bank.state["log_weight"][1 - lost] == pytest.approx(0.0, abs=1e-12)
    assert bank.head[0].leader == 1 - lost
    assert np.isfinite(nav["value"]).all()


def test_sound_filter_goes_through_the_same_epochs() -> None:
    code, _, nav, ledger = epochs_after(0.0, new_filter(place()))

    assert code == DONE
    assert len(nav) > 390
    assert (ledger["status"] == USED).all()


def test_covariance_that_is_lost_is_written_as_no_row() -> None:
    lost: Float64 = new_filter(place()).P[0]
    lost[0, 1] = math.nan

    assert not is_finite(new_filter(place()).state[0], lost)
