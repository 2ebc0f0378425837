"""Carrier differences: their row, the clone they stand on, and what the filter makes of them."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import numpy.typing as npt
import pytest

from insgnss.constants import C_MPS
from insgnss.filter import loop_calls
from insgnss.filter.loop import run_epochs
from insgnss.filter.output.writing import new_output
from insgnss.filter.rows.lines import EpochWorkspace
from insgnss.filter.state import (
    CLOCK,
    DR,
    DRIFT,
    DV,
    N_CLONE,
    OFFSETS,
    PSI,
    Bank,
    copy_bank,
    new_bank,
)
from insgnss.filter.update.clone import clone_epoch
from insgnss.filter.update.epoch_space import new_epoch, new_workspace
from insgnss.filter.update.prior_rows import place_antenna, predict_measurements
from insgnss.gnss.carrier_rows import CARRIER_DTYPE
from insgnss.gnss.observation_rows import CARRIER, GnssRows
from insgnss.kernels.compiled_ahead import compile_for
from insgnss.status import GATED, INCONSISTENT, NO_EPOCH_BEFORE, USED
from insgnss.tables import Float64
from tests.filter.scene import START_NS, attitude, new_filter, parameters, place, rows_of, sky, steady_force
from tests.filter.test_measurement_jacobians import moved as moved_state
from tests.jacobian import finite_difference_jacobian
from tests.layouts import layout_with

N = OFFSETS + N_CLONE
LEVER_B = (2.5, -1.2, -4.0)
STILL, FORCE = np.zeros(3), np.zeros(3)
STEP_NS = 500_000_000
NOISE = {"carrier_floor2": 0.003**2, "carrier_elevation2": 0.0, "carrier_cn02": 0.0}


def cloned_filter(rng: np.random.Generator) -> Bank:
    """Return a filter with a clone half a second old, 60 m behind it, and a full covariance."""
    at = place(-33.0, 151.0, 9000.0)
    small = new_filter(
        at, v_n=(100.0, -60.0, 5.0), C_eb=attitude(at, 40.0, -10.0, 120.0), clock=(300.0, -20.0)
    )
    bank = new_bank(1, N_CLONE)
    bank.state[0] = small.state[0]
    bank.head[0] = small.head[0]
    factor = rng.normal(size=(N, N))
    bank.P[0] = factor @ factor.T
    m = bank.state[0]
    m.r_clone[:] = m.r_e - 0.5 * m.v_e
    m.clock_clone, m.clone_ns = m.clock[0] + 10.0, START_NS - STEP_NS
    return bank


def carrier_log(at_ns: int = START_NS) -> GnssRows:
    """Return one epoch of twelve satellites whose carriers are differenced over half a second."""
    at = place(-33.0, 151.0, 9000.0)
    log = rows_of([at_ns], sky(at))
    before = log.sat.copy()
    before[:, :3] -= 0.5 * before[:, 3:6]
    carrier = np.zeros(len(before), CARRIER_DTYPE)
    return log._replace(carrier=carrier, before=before, before_ns=np.array([at_ns - STEP_NS]))


def numbers(**changes: Any) -> npt.NDArray[Any]:
    """Return the filter's numbers with a clone behind the 17 states."""
    return parameters(LEVER_B, at_clone=OFFSETS, **NOISE, **changes)


def observed(bank: Bank, log: GnssRows, par: npt.NDArray[Any]) -> EpochWorkspace:
    """Return the work space with the carriers held against the prior."""
    work = new_epoch(len(log.observation), N, OFFSETS)
    predict_measurements(bank.state[0], bank.P[0], par[0], log, 0, STILL, steady_force(bank.state[0]), work)
    return work


def test_carrier_row_equals_finite_differences(rng: np.random.Generator) -> None:
    bank, log, par = cloned_filter(rng), carrier_log(), numbers()

    def predicted(d: Float64) -> Float64:
        other = moved_state(bank, np.append(d[:OFFSETS], 0.0))
        other.state[0].r_clone[:] += d[OFFSETS : OFFSETS + 3]
        other.state[0].clock_clone += d[OFFSETS + 3]
        return -observed(other, log, par).lines["innovation"][:, CARRIER]

    lines = observed(bank, log, par).lines
    H = np.zeros((len(lines), N))
    for j, line in enumerate(lines):
        H[j, line["columns"][CARRIER, : line["count"][CARRIER]]] = line["h"][
            CARRIER, : line["count"][CARRIER]
        ]
    steps = np.repeat([10.0, 1.0, 0.02, 1e-2, 1e-2, 10.0, 1.0, 10.0, 10.0], [3, 3, 3, 3, 3, 1, 1, 3, 1])
    d = H - finite_difference_jacobian(predicted, np.zeros(N), steps)

    # the Earth's turn during the flight, 2e-6 of a column of positions; reception moves with the clock, v/c
    assert np.max(np.abs(d[:, DR : DR + 3])) < 3e-6
    assert np.max(np.abs(d[:, OFFSETS : OFFSETS + 3])) < 3e-6
    assert np.max(np.abs(d[:, PSI : PSI + 3])) < 3e-6 * float(np.linalg.norm(LEVER_B))
    assert np.max(np.abs(d[:, [CLOCK, OFFSETS + 3]])) < 1e-6
    assert not H[:, DV : DV + 3].any() and not H[:, DRIFT].any()


def test_clone_is_the_antenna_and_clock_with_all_their_correlations(rng: np.random.Generator) -> None:
    bank, par = cloned_filter(rng), numbers()
    m, P = bank.state[0], bank.P[0]
    work = new_epoch(1, N, OFFSETS)
    place_antenna(m, par[0], STILL, FORCE, work.antenna[0])
    x, y, z = m.C_eb @ LEVER_B
    J = np.zeros((N_CLONE, N))
    J[:3, DR : DR + 3] = np.eye(3)
    J[:3, PSI : PSI + 3] = -np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    J[3, CLOCK] = 1.0
    whole = np.vstack([np.eye(N)[:OFFSETS], J])
    expected = whole @ P @ whole.T

    clone_epoch(m, P, par[0], work.antenna[0], work.air[0], START_NS)

    assert np.max(np.abs(P - expected)) < 1e-12 * np.max(np.abs(expected))
    assert np.array_equal(P, P.T)
    assert np.array_equal(m.r_clone, work.antenna[0].r_a) and m.clone_ns == START_NS


def test_update_with_differences_equals_the_dense_filter(rng: np.random.Generator) -> None:
    """All twelve carriers of an epoch at once by the textbook, with full matrices."""
    bank, log, par = cloned_filter(rng), carrier_log(), numbers(carrier_gate2=1e30)
    log.observation["status"] = -1
    log.carrier["value"] = -observed(bank, log, par).lines["innovation"][:, CARRIER] + rng.normal(size=12)
    lines = observed(bank, log, par).lines
    H = np.zeros((12, N))
    for j, line in enumerate(lines):
        H[j, line["columns"][CARRIER, :11]] = line["h"][CARRIER, :11]
    P = bank.P[0].copy()

    out, work = run_epoch(bank, log, par)

    R = np.diag(work.epoch.lines["variance"][:12, CARRIER])  # with what the gate lets pass
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    x, P_after = K @ lines["innovation"][:, CARRIER], (np.eye(N) - K @ H) @ P
    assert np.all(out.carrier["status"] == USED)
    correction = work.epoch.vectors[0][:OFFSETS]
    # S of twelve unit-size states against 3 mm of noise: the inverse is good to 1e-9
    assert np.max(np.abs(correction - x[:OFFSETS])) < 1e-7 * np.max(np.abs(x))
    assert np.max(np.abs(bank.P[0][:OFFSETS, :OFFSETS] - P_after[:OFFSETS, :OFFSETS])) < 1e-7 * np.max(P)


@pytest.mark.parametrize("wrong", [[4], [4, 9], [0, 4, 9]])
def test_differences_that_the_others_contradict_are_found_behind_a_wide_gate(
    rng: np.random.Generator, wrong: list[int]
) -> None:
    """The prior knows the way to a metre, the gate lets 1.5 m pass; among twelve carriers they stand out."""
    bank, log, par = cloned_filter(rng), carrier_log(), numbers(residual_gate2=25.0)
    log.observation["status"] = -1
    way = -observed(bank, log, par).lines["innovation"][:, CARRIER]
    log.carrier["value"] = way + 1e-3 * rng.normal(size=12)
    log.carrier["value"][wrong] += 1.5

    out, _ = run_epoch(bank, log, par)

    assert np.flatnonzero(out.carrier["status"] == INCONSISTENT).tolist() == wrong
    assert np.count_nonzero(out.carrier["status"] == USED) == 12 - len(wrong)


def run_epoch(bank: Bank, log: GnssRows, par: npt.NDArray[Any]) -> tuple[Any, Any]:
    """Run the loop over one epoch at the filter's own time."""
    from insgnss.filter.loop import ImuSamples

    t_ns = np.array([START_NS - 10_000_000, START_NS], np.int64)
    force = np.tile(steady_force(bank.state[0]), (2, 1))
    out, work = new_output(log, 1, 10, np.zeros(0, np.int64)), new_workspace(12, layout_with(clone=True))
    bank.head["now_ns"], bank.head["next"] = START_NS, 2
    run_epochs(bank, (0, 1), log, ImuSamples(t_ns, np.zeros((2, 3)), force), par, -1e9, out, work)
    return out, work


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="the compiler is switched off")
def test_clone_is_compiled_ahead_for_the_types_that_the_loop_calls_it_with() -> None:
    rng = np.random.default_rng(2)
    run_epoch(cloned_filter(rng), carrier_log(), numbers())
    kernel: Any = clone_epoch
    known = list(kernel.signatures)

    compile_for(clone_epoch, loop_calls.calls()[clone_epoch])

    assert known and list(kernel.signatures) == known


def tight_filter() -> Bank:
    """Return a filter that knows how far it came since the clone to centimetres, but not where it is."""
    bank = cloned_filter(np.random.default_rng(0))
    m, P = bank.state[0], bank.P[0]
    P[:] = np.diag(np.repeat([4.0, 1e-4, 1e-6, 1e-8, 1e-12, 100.0, 1e-4, 0.0], [3, 3, 3, 3, 3, 1, 1, 4]))
    work = new_epoch(1, N, OFFSETS)
    par = numbers()
    there = m.r_clone.copy(), float(m.clock_clone)
    place_antenna(m, par[0], STILL, FORCE, work.antenna[0])
    clone_epoch(m, P, par[0], work.antenna[0], work.air[0], START_NS - STEP_NS)
    m.r_clone[:], m.clock_clone = there
    P[range(DR, DR + 3), range(DR, DR + 3)] += 0.01**2
    P[CLOCK, CLOCK] += 0.01**2
    return bank


@pytest.mark.parametrize("cycles", [0.5, 1.0, -1.0, 100.0])
def test_slip_that_nothing_else_has_found_is_refused_against_the_inertial_prediction(cycles: float) -> None:
    bank, log, par = tight_filter(), carrier_log(), numbers(carrier_gate2=16.0)
    log.observation["status"] = -1
    log.carrier["value"] = -observed(bank, log, par).lines["innovation"][:, CARRIER]
    log.carrier["value"][4] += cycles * C_MPS / 1575.42e6
    out, _ = run_epoch(bank, log, par)

    assert out.carrier["status"][4] == GATED
    assert np.all(np.delete(out.carrier["status"], 4) == USED)


def test_difference_from_another_epoch_than_the_clones_is_not_used() -> None:
    bank, log, par = tight_filter(), carrier_log(), numbers()
    log.observation["status"] = -1
    bank.state["clone_ns"] = START_NS - 2 * STEP_NS
    before = copy_bank(bank)
    out, _ = run_epoch(bank, log, par)

    assert np.all(out.carrier["status"] == NO_EPOCH_BEFORE)
    assert np.array_equal(bank.state["r_e"], before.state["r_e"])
    assert bank.state["clone_ns"][0] == START_NS


def test_carriers_measure_the_way_since_the_clone_and_leave_the_place_as_uncertain_as_it_was() -> None:
    """Both ends are 2 m uncertain together: twelve differences of 3 mm take 0.3 % of that, and only by geometry."""
    bank, log, par = tight_filter(), carrier_log(), numbers()
    log.observation["status"] = -1
    log.carrier["value"] = -observed(bank, log, par).lines["innovation"][:, CARRIER]
    sigma = np.sqrt(bank.P[0].diagonal())
    run_epoch(bank, log, par)

    assert np.allclose(np.sqrt(bank.P[0].diagonal())[DR : DR + 3], sigma[DR : DR + 3], rtol=0.01)


CRYSTAL_M = 0.15  # wander of an ordinary crystal in an interval, all satellites alike


def wandering_filter() -> Bank:
    """Return the tight filter with a clock that may have wandered by more than half a cycle since the clone."""
    bank = tight_filter()
    bank.P[0][CLOCK, CLOCK] += CRYSTAL_M**2
    return bank


@pytest.mark.parametrize("cycles", [0.5, 1.0, -1.0])
@pytest.mark.parametrize("slipped", [(4,), (1, 4, 7)])
def test_slip_of_a_cycle_shows_against_the_other_satellites_whatever_the_clock(
    slipped: tuple[int, ...], cycles: float
) -> None:
    """A cycle is 1.3 sigma of the clock; between two satellites it is ten of what the inertial sensor leaves open."""
    bank, log, par = wandering_filter(), carrier_log(), numbers(carrier_gate2=16.0)
    log.observation["status"] = -1
    log.carrier["value"] = -observed(bank, log, par).lines["innovation"][:, CARRIER] + CRYSTAL_M
    log.carrier["value"][list(slipped)] += cycles * C_MPS / 1575.42e6
    out, _ = run_epoch(bank, log, par)

    assert np.flatnonzero(out.carrier["status"] == GATED).tolist() == list(slipped)
    assert np.all(np.delete(out.carrier["status"], slipped) == USED)


def test_carriers_of_which_no_half_agrees_are_all_refused() -> None:
    bank, log, par = wandering_filter(), carrier_log(), numbers(carrier_gate2=16.0)
    log.observation["status"] = -1
    log.carrier["value"] = -observed(bank, log, par).lines["innovation"][:, CARRIER]
    log.carrier["value"] += np.linspace(-0.4, 0.4, 12)
    out, _ = run_epoch(bank, log, par)

    assert np.all(out.carrier["status"] == GATED)
