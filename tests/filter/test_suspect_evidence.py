"""How suspects are compared: axes of a sensor by the jump's estimate, explanations by their posterior odds."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from insgnss.config.library import imu_grade
from insgnss.filter.diagnosis.axes import of_axes
from insgnss.filter.diagnosis.hindsight import Verdict
from insgnss.filter.diagnosis.jumps import ACCELEROMETER, GYRO, WIDEST
from insgnss.filter.diagnosis.past import EpochRange, in_one_piece
from insgnss.filter.diagnosis.supposed_faults import IMU_TAGS, LOG_PRIOR, SATELLITES, with_fault
from insgnss.filter.diagnosis.suspects import explanations, log_odds, log_weights, over_onsets, shared
from insgnss.filter.diagnosis.witnesses import KindColumns, least_nis
from insgnss.filter.layout import Layout
from insgnss.filter.sensor_errors import BIAS_OF
from insgnss.filter.state import BA, DV, PSI, new_bank
from insgnss.status import USED
from insgnss.tables import Float64
from tests.filter.scene import new_filter, place, rows_of

SIGMA = 0.5  # of the grade's bias
BANK = new_bank(1, 0)


def gaussian(x: Float64, covariance: Float64) -> float:
    """Return the logarithm of a density with mean zero."""
    return float(-0.5 * (x @ np.linalg.solve(covariance, x) + np.linalg.slogdet(2.0 * np.pi * covariance)[1]))


@pytest.mark.parametrize("axes", [(0,), (1, 2), (0, 1, 2)])
def test_evidence_of_axes_is_that_of_the_measurements_themselves(axes: tuple[int, ...]) -> None:
    """Against y = H d + e with every prior on d written out: p(y) = N(0, H Q H^T + R)."""
    rng = np.random.default_rng(3)
    H, R = rng.normal(size=(9, 3)), 0.3 * np.eye(9)
    y = H @ np.array([4.0, 0.0, 0.0]) + 0.5 * rng.normal(size=9)
    widest = WIDEST * SIGMA
    S = np.linalg.inv(H.T @ np.linalg.solve(R, H) + np.eye(3) / widest**2)
    m = S @ H.T @ np.linalg.solve(R, y)
    wide = gaussian(y, H @ H.T * widest**2 + R)
    own = H[:, list(axes)]
    each = [gaussian(y, own @ own.T * (size * SIGMA) ** 2 + R) for size in (2.0, 6.0, 20.0)]
    expected = np.logaddexp.reduce(each) - np.log(3.0) - wide
    assert of_axes(m, S, SIGMA, widest)[axes] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("jump", "price"), [(2.0, 3.0), (50.0, 3.0 - np.log(1e-4)), (900.0, 3.0 - np.log(1e-4))]
)
def test_prior_that_is_far_too_wide_costs_little(jump: float, price: float) -> None:
    """Sizes from a small jump to a sensor that fails share the prior: a failure costs no more than being rarer."""
    rng = np.random.default_rng(12)
    H = rng.normal(size=(30, 3))
    y = H @ np.array([0.0, jump, 0.0]) * SIGMA + 0.3 * rng.normal(size=30)

    def of(widest: float) -> float:
        S = np.linalg.inv(H.T @ H / 0.09 + np.eye(3) / widest**2)
        m = S @ H.T @ y / 0.09
        wide = gaussian(y, H @ H.T * widest**2 + 0.09 * np.eye(30))
        return wide + of_axes(m, S, SIGMA, widest)[(1,)]

    known = gaussian(y, np.outer(H[:, 1], H[:, 1]) * (jump * SIGMA) ** 2 + 0.09 * np.eye(30))
    assert known - price < of(2000.0 * SIGMA) < known + 1.0


@pytest.mark.parametrize(
    ("sensor", "state", "earlier", "span_s"),
    [
        (ACCELEROMETER, DV, False, (0.0, 0.8)),
        (ACCELEROMETER, DV, True, (0.0, 0.8)),
        (GYRO, PSI, False, (0.0, 0.8)),
        (GYRO, PSI, True, (-90.0, 0.0)),
    ],
)
def test_jump_that_is_not_at_the_bank_has_moved_what_the_sensor_moves(
    sensor: str, state: int, earlier: bool, span_s: tuple[float, float]
) -> None:
    """A bias taken from the bank on is taken for t too long, or too short: C b t, drawn many times."""
    bank = new_bank(1, 0)
    C = bank.state[0].C_eb
    C[:] = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
    widths = np.array([3.0, 0.1, 1.0])
    setup: Any = SimpleNamespace(grade=imu_grade("industrial"))
    rng = np.random.default_rng(8)
    b, t = widths * rng.normal(size=(400_000, 3)), rng.uniform(*span_s, (400_000, 1))
    drawn = np.hstack([t * b @ C.T, b])
    expected = drawn.T @ drawn / len(drawn)

    P = with_fault(bank, setup, sensor, widths, earlier, later_s=0.8).P[0]

    bias, sigma = BIAS_OF[state], np.sqrt(np.diag(expected))
    at = [*range(state, state + 3), *range(bias, bias + 3)]
    scale = np.outer(sigma, sigma)
    np.testing.assert_allclose((P - bank.P[0])[np.ix_(at, at)] / scale, expected / scale, atol=0.01)
    np.testing.assert_allclose(P.T, P, rtol=1e-12)


def test_wandering_clock_is_one_event_and_not_one_of_each_row() -> None:
    """Two epochs of eleven rows: all three sigmas off by the clock, and each off by itself."""
    rng = np.random.default_rng(4)
    off = np.concatenate([3.0 + 0.1 * rng.normal(size=11), 3.0 * rng.choice([-1.0, 1.0], 11)])
    p = np.ones(22)
    rows = KindColumns(off, 0.01 + p, p, np.full(22, USED))
    clock, each = least_nis(rows, np.repeat([0, 1], 11)) / 11
    assert clock < 2.5 < 7.0 < float(np.mean(off[:11] ** 2 / rows.variance[:11]))
    assert each > 7.0


def test_jump_of_one_axis_is_found_on_that_axis() -> None:
    S = np.diag([0.2, 0.3, 5.0]) ** 2
    gains = of_axes(np.array([0.1, 3.0, -1.0]), S, SIGMA, WIDEST * SIGMA)
    assert max(gains, key=lambda axes: gains[axes] + LOG_PRIOR * len(axes)) == (1,)


@pytest.mark.parametrize("variance", [0.0, -1e-9, -0.04])
def test_filters_that_used_other_rows_tell_of_no_axis(variance: float) -> None:
    """The sound one refuses what the other uses: the difference of the covariances is no covariance."""
    gains = of_axes(np.array([0.1, 3.0, -1.0]), np.diag([0.04, 0.09, variance]), SIGMA, WIDEST * SIGMA)
    assert gains == {(0, 1, 2): 0.0}
    assert of_axes(np.ones(3), variance * np.eye(3), SIGMA, WIDEST * SIGMA) == {(0, 1, 2): 0.0}


def verdict(suspect: str, log_likelihood: float, **more: Any) -> Verdict:
    return Verdict(suspect, log_likelihood, more.pop("bank", BANK), fits=True, **more)


def test_likelihood_over_the_onset_is_a_mean_and_not_its_maximum() -> None:
    """A peak of a tenth of the range is worth a tenth of it."""
    onsets = [verdict(GYRO, 50.0 if k == 5 else -50.0, onset_ns=k * 1_000_000_000) for k in range(11)]
    assert np.logaddexp.reduce(log_weights(onsets)) == pytest.approx(50.0 - np.log(10.0), abs=1e-9)
    flat = [verdict(GYRO, 7.0, onset_ns=k * k * 1_000_000_000) for k in range(5)]
    assert np.logaddexp.reduce(log_weights(flat)) == pytest.approx(7.0)


def test_filter_after_a_fault_holds_what_the_onset_leaves_open() -> None:
    """A bias of 1 since 8 s ago, or of 3 since 4 s ago: mean and variance are those of the mixture."""
    rng, verdicts = np.random.default_rng(8), []
    for onset_s, value, log_likelihood in ((0, 1.0, 40.0), (4, 3.0, 41.0), (8, 5.0, 38.0), (9, 900.0, -70.0)):
        bank = new_filter(place())
        bank.state[0].b_a[:] = 1e-3 * value
        A = rng.normal(size=bank.P[0].shape)
        bank.P[0] = 1e-6 * A @ A.T
        verdicts.append(
            verdict(ACCELEROMETER, log_likelihood, bank=bank, axes=(2,), onset_ns=onset_s * 1_000_000_000)
        )
    (told,) = explanations(verdicts, 0.0)

    found = over_onsets(told, Layout())

    weight = np.exp(np.array([40.0, 41.0, 38.0])) * np.array([2.0, 4.0, 2.5])
    weight /= weight.sum()
    mean = weight @ np.array([1e-3, 3e-3, 5e-3])
    within = sum(w * v.bank.P[0, BA, BA] for w, v in zip(weight, verdicts, strict=False))
    between = weight @ (np.array([1e-3, 3e-3, 5e-3]) - mean) ** 2
    assert len(found.bank.state) == 1
    assert found.bank.state[0].b_a == pytest.approx([mean] * 3)
    assert found.bank.P[0, BA, BA] == pytest.approx(within + between)
    assert np.array_equal(verdicts[1].bank.state[0].b_a, [3e-3] * 3), "the verdicts stay as they were"
    satellites = explanations([verdict(SATELLITES, 5.0, satellites=(4,))], 0.0)[0]
    assert over_onsets(satellites, Layout()) is satellites.best


def test_each_further_satellite_must_be_worth_a_fault_of_its_own() -> None:
    one = verdict(SATELLITES, 60.0, satellites=(4,))
    two = verdict(SATELLITES, 60.0 - 0.5 * LOG_PRIOR, satellites=(4, 7))
    told = explanations([two, one], 0.0)
    assert [each.best.satellites for each in told] == [(4,), (4, 7)]
    assert told[0].log_odds == pytest.approx(60.0 + LOG_PRIOR)
    common = shared(told)
    assert common is not None and common.best.satellites == (4,)


def test_two_axes_that_explain_the_same_have_nothing_in_common() -> None:
    told = explanations([verdict(GYRO, 60.0, axes=(0,)), verdict(GYRO, 59.0, axes=(2,))], 0.0)
    assert shared(told) is None
    assert log_odds(told[:1], told) == pytest.approx(1.0, abs=1e-3)


def test_sound_filter_is_one_of_the_explanations() -> None:
    told = explanations([verdict(ACCELEROMETER, 5.0, axes=(1,)), verdict(IMU_TAGS, -40.0, size=0.02)], 0.0)
    assert log_odds(told, told) == pytest.approx(5.0 + LOG_PRIOR, abs=1e-3)


def test_satellites_whose_rows_nobody_uses_make_equal_explanations() -> None:
    """Left out beside one that runs away, any of them explains as much, with filters that are equal to the bit."""
    both = [verdict(SATELLITES, 40.0, satellites=(4, each), bank=new_bank(1, 0)) for each in (7, 8)]
    ranked = explanations(both, 0.0)
    assert log_odds(ranked[:1], ranked) == pytest.approx(0.0, abs=1e-6)


def test_likelihood_that_is_no_number_explains_nothing() -> None:
    assert explanations([verdict(GYRO, float("nan"), axes=(0,))], 0.0) == []


def test_onset_that_fits_is_taken_only_where_it_is_about_as_likely() -> None:
    """Of one jump the filters from twelve onsets differ by e^40: the one that happens to fit may begin far too late."""

    def at(onset_s: float, log_likelihood: float, fits: bool) -> Verdict:
        found = Verdict(ACCELEROMETER, log_likelihood, BANK, fits, axes=(0,))
        return found._replace(onset_ns=int(onset_s * 1e9))

    likeliest, late = at(0.5, 51.4, False), at(10.5, 9.9, True)
    assert explanations([likeliest, late], 0.0)[0].best is likeliest
    near = at(1.5, 47.9, True)
    assert explanations([likeliest, late, near], 0.0)[0].best is near


def test_past_of_a_stream_is_rerun_in_one_piece_but_not_across_another_ionosphere() -> None:
    """A call of the loop costs as much as several epochs."""
    at = [np.arange(n, n + 2) * 10**9 for n in (0, 2, 4)]
    parts = [rows_of(t_ns, np.full((5, 8), float(t_ns[0]))) for t_ns in at]
    learnt = parts[2]._replace(klobuchar=np.full(8, 0.1))

    whole, later = in_one_piece(tuple(EpochRange(part, 0, 2) for part in (*parts[:2], learnt)))
    assert (whole.first, whole.last) == (0, 4) and whole.rows.first.tolist() == [0, 5, 10, 15, 20]
    assert whole.rows.epoch_ns.tolist() == [0, 10**9, 2 * 10**9, 3 * 10**9]
    np.testing.assert_array_equal(whole.rows.sat, np.concatenate([part.sat for part in parts[:2]]))
    assert later.rows.klobuchar is learnt.klobuchar and later.rows.epoch_ns.tolist() == at[2].tolist()
    assert len(in_one_piece((EpochRange(parts[0], 1, 2),))[0].rows.epoch_ns) == 1
    silent = rows_of(at[1], np.zeros((0, 8)))
    assert len(in_one_piece(tuple(EpochRange(part, 0, 2) for part in (parts[0], silent, parts[2])))) == 1
