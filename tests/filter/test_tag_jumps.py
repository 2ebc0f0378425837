"""The jump of a GNSS tag: the columns of its offset, and what the pseudoranges of one epoch say of it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy import stats

from insgnss.config.library import filter_config
from insgnss.filter.diagnosis.offset_state import with_further_states
from insgnss.filter.layout import Layout
from insgnss.filter.parameters import resolve_parameters
from insgnss.filter.state import CLOCK, DR, OFFSETS, Bank
from insgnss.filter.states.gnss_time import UNKNOWN_GNSS_TIME
from insgnss.filter.states.imu_time import UNKNOWN_IMU_TIME
from insgnss.filter.update.epoch_space import new_epoch
from insgnss.filter.update.prior_rows import predict_measurements
from insgnss.filter.update.tag_jumps import TagEvidence, follow_tag_jump, tag_evidence
from insgnss.gnss.observation_rows import N_KINDS, PSEUDORANGE, GnssRows
from insgnss.status import NAMES, TAG_JUMP, USED
from insgnss.tables import Float64
from tests.filter.scene import (
    RANGE_SIGMA_M,
    SKY_DEG,
    START_NS,
    TACTICAL,
    TCXO,
    new_filter,
    parameters,
    place,
    rows_of,
    sky,
    steady_force,
)
from tests.filter.test_carrier import carrier_log
from tests.filter.test_imu_time import LEVER_B, PULL, RATE, manoeuvring_filter
from tests.jacobian import finite_difference_jacobian

AT = OFFSETS + 1  # behind the state of the inertial tags, which the manoeuvre of the test has
STILL = np.zeros(3)
ODDS = math.log(1e4)


def lines_of(offset_s: float) -> npt.NDArray[Any]:
    """Return the predictions of an epoch in a manoeuvre, of a filter with an offset of the GNSS tags."""
    bank = with_further_states(
        manoeuvring_filter(),
        Layout((UNKNOWN_IMU_TIME,), clone=True),
        Layout((UNKNOWN_IMU_TIME, UNKNOWN_GNSS_TIME), clone=True),
    )
    m = bank.state[0]
    m.clone_ns = manoeuvring_filter().state[0].clone_ns
    m.optional[AT - OFFSETS] = offset_s
    par = parameters(LEVER_B, at_imu_time=OFFSETS, at_gnss_time=AT, at_clone=AT + 1, motion_gate2=0.0)[0]
    work = new_epoch(12, bank.P.shape[1], AT + 1)
    predict_measurements(m, bank.P[0], par, carrier_log(), 0, RATE, PULL, work)
    return work.lines


@pytest.mark.parametrize("kind", range(N_KINDS))
def test_columns_equal_finite_differences(kind: int) -> None:
    lines = lines_of(0.0)
    H = [line["h"][kind][list(line["columns"][kind][: line["count"][kind]]).index(AT)] for line in lines]
    found = finite_difference_jacobian(
        lambda d: -np.asarray(lines_of(float(d[0]))["innovation"][:, kind]), np.zeros(1), np.full(1, 1e-3)
    )[:, 0]
    assert lines["status"][:, kind].tolist() == [USED] * 12
    np.testing.assert_allclose(H, found, rtol=2e-6, atol=1e-5)
    assert np.abs(found).max() > (100.0, 3.0, 50.0)[kind]


def tagged_epoch(late_s: float, noise_m: Float64, moved_m: float = 0.0) -> tuple[Bank, GnssRows, Any]:
    """Return a filter, and an epoch of as many satellites as ``noise_m`` has, whose tag is late by ``late_s``.

    The satellites approach and recede by up to 700 m/s. ``moved_m``: by how much the filter is north of the truth.
    """
    at, n = place(), len(noise_m)
    log = rows_of([START_NS], sky(at, SKY_DEG[:n]))
    away = (log.sat[:, :3] - at.r_e) / np.linalg.norm(log.sat[:, :3] - at.r_e, axis=1)[:, None]
    log.sat[:, 3:6] += away * np.linspace(-700.0, 700.0, n)[np.argsort(np.sin(7.0 * np.arange(n)))][:, None]
    log.sat[:, 6:] = 0.0
    bank = new_filter(at, clock=(0.0, 0.0), sigmas={DR: 0.1, CLOCK: 0.1})
    par = parameters(tag_jump_odds=ODDS)[0]
    work = new_epoch(n, bank.P.shape[1])
    force = steady_force(bank.state[0])
    predict_measurements(bank.state[0], bank.P[0], par, log, 0, STILL, force, work)
    log.observation["value"][:, PSEUDORANGE] = noise_m - work.lines["innovation"][:, PSEUDORANGE]
    log.sat[:, :3] += late_s * log.sat[:, 3:6]  # where a late tag seeks them
    bank.state[0].r_e[:] += at.C_ne.T @ np.array([moved_m, 0.0, 0.0])
    predict_measurements(bank.state[0], bank.P[0], par, log, 0, STILL, force, work)
    return bank, log, (par, work)


def evidence(late_s: float, noise_m: Float64, moved_m: float = 0.0) -> TagEvidence:
    bank, log, (par, work) = tagged_epoch(late_s, noise_m, moved_m)
    return TagEvidence(*tag_evidence(bank.state[0], bank.P[0], par, log, 0, work))


@pytest.mark.parametrize("n", [6, 9, 12])
@pytest.mark.parametrize("late_s", [0.05, -0.05, 1.0])
def test_late_tag_is_found_with_its_sigma(n: int, late_s: float) -> None:
    draws = [evidence(late_s, np.random.default_rng(k).normal(0.0, RANGE_SIGMA_M, n)) for k in range(60)]
    assert all(found.log_odds > 3.0 and found.elsewhere == 0 for found in draws)
    ratios = np.array([(found.late_s - late_s) / found.sigma_s for found in draws])
    low, high = stats.chi2.ppf([0.0005, 0.9995], len(draws)) / len(draws)
    assert low < np.mean(ratios**2) < high


@pytest.mark.parametrize("n", [6, 8, 12])
def test_noise_that_has_risen_is_no_jump(n: int) -> None:
    draws = [evidence(0.0, np.random.default_rng(k).normal(0.0, 12.0, n)).log_odds for k in range(400)]
    assert sum(odds > 3.0 for odds in draws) <= stats.binom.ppf(0.9995, len(draws), 2.0 * math.exp(-3.0))
    assert max(draws) < math.log(len(draws) / 0.0005)


def test_wrong_place_alone_is_no_jump() -> None:
    for k in range(20):
        noise = np.random.default_rng(k).normal(0.0, RANGE_SIGMA_M, 12)
        assert evidence(0.0, noise, moved_m=80.0).log_odds == 0.0


def test_late_tag_at_a_wrong_place_is_both_and_that_takes_eight_satellites() -> None:
    for k in range(20):
        noise = np.random.default_rng(k).normal(0.0, RANGE_SIGMA_M, 12)
        both = evidence(0.05, noise, moved_m=80.0)
        assert both.elsewhere == 1
        assert abs(both.late_s - 0.05) < 4.5 * both.sigma_s < 0.03
        assert evidence(0.05, noise[:7], moved_m=80.0).log_odds == 0.0


def test_five_satellites_say_nothing_nor_does_a_filter_without_recovery() -> None:
    assert evidence(0.05, np.zeros(5)).log_odds == 0.0
    bank, log, (par, work) = tagged_epoch(0.05, np.zeros(9))
    for recovery, seen in ((True, True), (False, False)):
        tight = filter_config("tight17")
        config = tight.model_copy(update={"health": tight.health.model_copy(update={"recovery": recovery})})
        par.tag_jump_odds = resolve_parameters(config, TACTICAL, TCXO, (0.0, 0.0, 0.0), True)[0].tag_jump_odds
        assert (tag_evidence(bank.state[0], bank.P[0], par, log, 0, work)[2] > 0.0) == seen


def follow(bank: Bank, log: GnssRows, par: Any, work: Any) -> list[list[str]]:
    """Return the status of pseudoranges and range rates after the tag of the epoch was looked at."""
    follow_tag_jump(bank, 0, par, log, 0, work)
    return [[NAMES[int(status)] for status in work.lines["status"][:, kind]] for kind in range(2)]


def test_jump_whose_offset_is_no_state_yet_costs_the_pseudoranges_of_the_epoch() -> None:
    bank, log, (par, work) = tagged_epoch(0.05, np.zeros(9))
    ranges, rates = follow(bank, log, par, work)
    assert ranges == [NAMES[TAG_JUMP]] * 9 and rates == ["used"] * 9
    assert bank.head[0].tag_jump_ns == START_NS and bank.head[0].tag_late_s == pytest.approx(0.05, abs=1e-3)
    bank, log, (par, work) = tagged_epoch(0.5, np.zeros(9))
    assert follow(bank, log, par, work) == [[NAMES[TAG_JUMP]] * 9] * 2


def test_jump_whose_offset_is_a_state_makes_it_unknown_and_uses_the_rows() -> None:
    bank, log, (par, work) = tagged_epoch(0.05, np.zeros(9))
    bank = with_further_states(bank, Layout(), Layout((UNKNOWN_GNSS_TIME,)))
    bank.P[0, OFFSETS, OFFSETS], bank.P[0, OFFSETS, DR], bank.P[0, DR, OFFSETS] = 1e-6, 1e-4, 1e-4
    par.at_gnss_time = OFFSETS
    work = new_epoch(9, bank.P.shape[1])
    predict_measurements(bank.state[0], bank.P[0], par, log, 0, STILL, steady_force(bank.state[0]), work)
    before = work.lines["predicted"][:, PSEUDORANGE].copy()
    assert follow(bank, log, par, work) == [["used"] * 9] * 2
    assert bank.P[0, OFFSETS, OFFSETS] == UNKNOWN_GNSS_TIME.variance and bank.P[0, OFFSETS, DR] == 0.0
    h = work.lines["h"][:, PSEUDORANGE, work.lines["count"][0, PSEUDORANGE] - 1]
    grown = work.lines["predicted"][:, PSEUDORANGE] - before
    np.testing.assert_allclose(grown, h**2 * UNKNOWN_GNSS_TIME.variance, rtol=0.01, atol=1.0)


@pytest.mark.parametrize(
    ("value_s", "sigma_s", "rates"), [(0.0, 1.0, "tag_jump"), (1.0, 1e-3, "tag_jump"), (0.1, 1e-3, "used")]
)
def test_range_rates_wait_until_the_offset_is_known_and_short(
    value_s: float, sigma_s: float, rates: str
) -> None:
    """The acceleration of a second ago is another: where a turn had just ended, the velocity was 16 sigma off."""
    bank, log, (par, work) = tagged_epoch(0.0, np.zeros(9))
    bank = with_further_states(bank, Layout(), Layout((UNKNOWN_GNSS_TIME,)))
    bank.state[0].optional[0], bank.P[0, OFFSETS, OFFSETS] = value_s, sigma_s**2
    par.at_gnss_time = OFFSETS
    assert follow(bank, log, par, work) == [["used"] * 9, [rates] * 9]


def test_hypotheses_are_tested_once() -> None:
    bank, log, (par, work) = tagged_epoch(0.0, np.zeros(9))
    follow(bank, log, par, work)
    assert bank.head[0].tag_tested_ns == START_NS
    tested, log, (par, work) = tagged_epoch(0.05, np.zeros(9))
    tested.head[0].tag_tested_ns = START_NS
    ranges, _ = follow(tested, log, par, work)
    assert ranges == ["used"] * 9
