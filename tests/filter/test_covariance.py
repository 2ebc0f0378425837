"""The covariance over hours: the dense Joseph form to 1e-9 m, symmetric bit for bit, positive, in hard cases too."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.filter.loop import DONE, carry_bank, run_epochs
from insgnss.filter.output.writing import Output, new_output
from insgnss.filter.prediction import new_scratch, predict_covariance
from insgnss.filter.rows.lines import EpochWorkspace
from insgnss.filter.state import BA, BG, CLOCK, DR, DRIFT, OFFSETS, PSI, copy_bank
from insgnss.filter.update.epoch_space import new_workspace
from insgnss.status import USED
from insgnss.tables import Float64
from tests.filter.scene import (
    START_NS,
    dense_rows,
    new_filter,
    observed,
    parameters,
    perfect_rows,
    place,
    run,
    sky,
    update,
)
from tests.filter.turntable import Turning, turning
from tests.layouts import layout_with

LEVER_B = (1.0, 0.3, -0.8)
N = OFFSETS


def room(t: Turning) -> Output:
    """Return room for what a run over all epochs writes."""
    return new_output(t.rows, len(t.rows.epoch_ns), 10, np.zeros(0, np.int64))


def smallest_eigenvalue(P: Float64) -> float:
    """Return the smallest eigenvalue of the correlation matrix: it does not depend on units."""
    sigma = np.sqrt(np.diag(P))
    return float(np.linalg.eigvalsh(P / np.outer(sigma, sigma))[0])


def dense_joseph(P: Float64, work: EpochWorkspace) -> tuple[Float64, Float64]:
    """Return covariance and correction of one epoch by the textbook Joseph form, every matrix dense."""
    H, y, r = dense_rows(work, N), work.lines["innovation"][:, :2], work.lines["variance"][:, :2]
    x, unit = np.zeros(N), np.eye(N)
    for kind in range(2):
        for j in range(len(y)):
            h = H[kind, j]
            g = P @ h
            K = g / (h @ g + r[j, kind])
            x += K * (y[j, kind] - h @ x)
            left = unit - np.outer(K, h)
            P = left @ P @ left.T + np.outer(K, K) * r[j, kind]
    return P, x


def test_an_hour_of_updates_equals_the_dense_joseph_form_to_a_nanometre(rng: np.random.Generator) -> None:
    """Both work on the same rows; each carries its own covariance on, and what they correct is added up."""
    seconds, imu_hz = 3600, 10
    par = parameters(LEVER_B, covariance_step=0.1)
    t = turning(par, seconds, imu_hz, rng)
    bank, dense = t.bank, copy_bank(t.bank)
    out, work, scratch = room(t), new_workspace(12, layout_with()), new_scratch(N)
    apart, of_P = np.zeros((seconds, N)), []
    for epoch in range(seconds):
        dense.state[:] = bank.state
        carry_bank(dense, int(t.rows.epoch_ns[epoch]), t.imu, par[0], scratch)
        predict_covariance(dense.state[0], dense.P[0], par[0], scratch)
        k = imu_hz * (epoch + 1)
        rows = observed(dense, par, t.rows, epoch, t.imu.w_ib_b[k], t.imu.f_b[k])
        dense.P[0], x = dense_joseph(dense.P[0], rows)

        run_epochs(bank, (epoch, epoch + 1), t.rows, t.imu, par, -1e9, out, work)

        apart[epoch] = work.epoch.vectors[0][:N] - x
        sigma = np.sqrt(np.diag(dense.P[0]))
        of_P.append(np.max(np.abs(bank.P[0] - dense.P[0]) / np.outer(sigma, sigma)))
    summed = np.abs(np.cumsum(apart, axis=0))
    assert np.all(out.ledger["status"] == USED)
    assert np.max(summed[:, DR : DR + 3]) < 1e-9
    assert np.max(summed[:, [CLOCK]]) < 1e-9
    assert max(of_P) < 1e-9


def test_noise_beyond_the_grade_is_that_of_a_noisier_sensor(rng: np.random.Generator) -> None:
    """Three times the white noise in sigma: eight times the grade's variance beyond it."""
    par = parameters(LEVER_B)
    loud = par.copy()
    loud["gyro_density"] *= 9.0
    loud["accel_density"] *= 9.0
    t = turning(par, 5, 100, rng)
    scratch, end_ns = new_scratch(N), int(t.imu.t_ns[-1])
    t.bank.P[:] = 0.0  # what there is afterwards is noise alone
    banks = [copy_bank(t.bank) for _ in range(3)]
    banks[1].state["noise_excess"] = 8.0
    for bank, each in zip(banks, (par, par, loud), strict=True):
        carry_bank(bank, end_ns, t.imu, each[0], scratch)
        predict_covariance(bank.state[0], bank.P[0], each[0], scratch)

    usual, raised, noisier = (bank.P[0] for bank in banks)
    np.testing.assert_allclose(raised, noisier, rtol=1e-9, atol=1e-30)
    assert np.all(np.diagonal(raised)[PSI : PSI + 3] > 5.0 * np.diagonal(usual)[PSI : PSI + 3])


def test_covariance_of_a_ten_hour_run_is_symmetric_and_positive_throughout(rng: np.random.Generator) -> None:
    hours, imu_hz = 10, 10
    par = parameters(LEVER_B, covariance_step=0.1)
    t = turning(par, hours * 3600, imu_hz, rng)
    out, work = room(t), new_workspace(12, layout_with())
    truth, smallest = t.bank.state["r_e"][0].copy(), []
    for first in range(0, hours * 3600, 120):
        code, _ = run_epochs(t.bank, (first, first + 120), t.rows, t.imu, par, -1e9, out, work)
        assert code == DONE
        assert np.array_equal(t.bank.P[0], t.bank.P[0].T)
        smallest.append(smallest_eigenvalue(t.bank.P[0]))
    assert min(smallest) > 0
    assert np.mean(out.ledger["status"] == USED) > 0.999
    assert np.linalg.norm(t.bank.state["r_e"][0] - truth) < 4.0 * np.sqrt(np.trace(t.bank.P[0, :3, :3]))


@pytest.mark.parametrize(
    "without",
    [(BA, 3), (BG, 3), (DRIFT, 1), (CLOCK, 2), (DR, 3)],
    ids=["accelerometer bias", "gyro bias", "clock drift", "clock", "position"],
)
def test_filter_runs_on_when_a_state_is_known_perfectly(
    without: tuple[int, int], rng: np.random.Generator
) -> None:
    """No variance and no process noise: the state is left as it is, and the others go on as usual."""
    first, count = without
    still = {
        "accel_bias_density": 0.0,
        "gyro_bias_density": 0.0,
        "clock_bias_density": 0.0,
        "clock_drift_density": 0.0,
    }
    par = parameters(LEVER_B, covariance_step=0.1, **still)
    t = turning(par, 60, 10, rng)
    t.bank.P[0, range(first, first + count), range(first, first + count)] = 0.0

    code = run(t.bank, t.rows, t.imu, par).code

    assert code == DONE
    assert np.all(np.isfinite(t.bank.P))


def test_biases_without_process_noise_are_learnt_without_end(rng: np.random.Generator) -> None:
    par = parameters(LEVER_B, covariance_step=0.1)
    for name in ("accel_bias", "gyro_bias"):
        par[f"{name}_density"], par[f"{name}_time"] = 0.0, np.inf
    t = turning(par, 3600, 10, rng)
    out, work, sigmas = room(t), new_workspace(12, layout_with()), []
    for first in range(0, 3600, 600):
        code, _ = run_epochs(t.bank, (first, first + 600), t.rows, t.imu, par, -1e9, out, work)
        assert code == DONE
        assert smallest_eigenvalue(t.bank.P[0]) > 0.0
        sigmas.append(np.sqrt(np.diag(t.bank.P[0]))[BA : BG + 3])

    assert np.all(np.diff(sigmas, axis=0) < 0.0)
    errors = np.concatenate([t.bank.state["b_a"][0], t.bank.state["b_g"][0]])
    assert np.all(np.abs(errors) < 4.0 * sigmas[-1])


def test_the_same_satellite_twelve_times_at_a_millimetre_leaves_a_positive_covariance() -> None:
    """Nearly singular: twelve equal rows of 1 mm on a clock of 100 m, S falls by 1e10 with the first of them."""
    at, par = place(), parameters(LEVER_B, range_floor2=1e-6)
    bank = new_filter(at)
    log = perfect_rows(bank, par, [START_NS], np.repeat(sky(at)[:1], 12, axis=0))
    P = bank.P[0].copy()
    expected, _ = dense_joseph(P, observed(bank, par, log))

    assert update(bank, log, par).code == DONE
    sigma = np.sqrt(np.diag(expected))
    assert np.max(np.abs(bank.P[0] - expected) / np.outer(sigma, sigma)) < 1e-9
    assert np.array_equal(bank.P[0], bank.P[0].T)
    assert smallest_eigenvalue(bank.P[0]) > 0.0
