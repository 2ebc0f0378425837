"""What noise levels learn from, what is told of a wrong prediction, and what a reset to a fix leaves."""

from __future__ import annotations

import math

import numpy as np
import pytest

from insgnss.constants import NS_PER_S
from insgnss.filter.diagnosis.resetting import inflate_bias_covariance, reinitialise_position
from insgnss.filter.layout import Layout
from insgnss.filter.measurements.range_rate import COLUMNS as RATE_COLUMNS
from insgnss.filter.output.writing import RANGES_NOISY, RATES_NOISY
from insgnss.filter.rows.lines import EpochWorkspace
from insgnss.filter.start.fix import Fix
from insgnss.filter.state import BA, BG, CLOCK, DR, DV, OFFSETS, Bank
from insgnss.filter.update.adaptation import raise_level
from insgnss.filter.update.epoch_space import new_epoch
from insgnss.filter.update.integrity import follow_explained
from insgnss.gnss.observation_rows import PSEUDORANGE, RANGE_RATE, GnssRows
from insgnss.inertial.sensor_model import sensor_model
from insgnss.status import DRIFTING, USED
from insgnss.tables import Float64
from tests.filter.scene import (
    RANGE_SIGMA_M,
    RATE_SIGMA_MPS,
    START_NS,
    TACTICAL,
    W_IE_E,
    Result,
    at_rest,
    geometry,
    new_filter,
    parameters,
    perfect_rows,
    place,
    run,
    sky,
)
from tests.layouts import layout_with
from tests.statistics_bounds import mean_chi_square_bounds

N = 12
VELOCITY = RATE_COLUMNS.index(DV)
EPOCHS = 90
SETTLED = {DR: 1.0, DV: 0.05, CLOCK: 1.0}


def scene(rng: np.random.Generator) -> tuple[Bank, GnssRows]:
    """Return a filter at rest on the truth and its rows with their noise."""
    at = place()
    bank = new_filter(at, sigmas=SETTLED)
    imu = at_rest(at, bank.state[0].C_eb, 1.0, 10.0)
    epoch_ns = START_NS + np.arange(1, EPOCHS + 1) * NS_PER_S
    log = perfect_rows(bank, parameters(), epoch_ns, sky(at), w_ib_b=imu.w_ib_b[0])
    log.observation["slot"] = log.observation["sv"]
    log.observation["value"] += rng.normal(size=(len(log.sat), 2)) * [RANGE_SIGMA_M, RATE_SIGMA_MPS]
    return bank, log


def factors(bank: Bank, log: GnssRows) -> np.ndarray:
    """Run the filter with adaptation; return the factors of ranges and range rates."""
    imu = at_rest(place(), bank.state[0].C_eb, EPOCHS + 1.0, 20.0)
    changes = {
        "adapt_gain": 1.0 / 30.0,
        "adapt_least": 0.02,
        "adapt_most": 100.0,
        "adapt_least_at_rest": 0.02,
    }
    run(bank, log, imu, parameters(**changes, rate_gate2=1e4, range_gate2=1e4))
    return np.asarray(bank.state["noise_factor"][0, :2])


def test_noise_as_assumed_leaves_the_levels(rng: np.random.Generator) -> None:
    """Sixty values of a chi^2 of about eight, in a memory of 30 s: a sigma of 9 % of the mean."""
    assert factors(*scene(rng)) == pytest.approx([1.0, 1.0], abs=0.3)


def test_what_all_satellites_share_is_no_noise(rng: np.random.Generator) -> None:
    """An accelerometer off by 20 mg for the whole minute shows in all innovations and in no level."""
    at = place()
    bank, log = scene(rng)
    sigma = np.sqrt(np.diag(bank.P[0]))
    assert sigma[BA] < 0.02
    imu = at_rest(at, bank.state[0].C_eb, EPOCHS + 1.0, 20.0)
    changes = {
        "adapt_gain": 1.0 / 30.0,
        "adapt_least": 0.02,
        "adapt_most": 100.0,
        "adapt_least_at_rest": 0.02,
    }
    par = parameters(**changes, rate_gate2=1e6, range_gate2=1e6)
    run(bank, log, imu._replace(f_b=imu.f_b + np.array([0.2, 0.0, 0.0])), par)
    assert np.all(bank.state["noise_factor"][0, :2] < 2.0)


ADAPTING = {"adapt_gain": 1.0 / 30.0, "adapt_least": 0.02, "adapt_most": 1e3, "adapt_least_at_rest": 0.02}


def judged_at_the_end(bank: Bank, log: GnssRows) -> Result:
    """Run an adapting filter at rest over a log."""
    return run(bank, log, at_rest(place(), bank.state[0].C_eb, EPOCHS + 1.0, 20.0), parameters(**ADAPTING))


@pytest.mark.parametrize("times", [10.0, 20.0])
def test_louder_noise_counts_from_its_first_epoch_on(rng: np.random.Generator, times: float) -> None:
    """A gate at the level before would leave a few rows of the first epoch, which would count as quiet ones."""
    bank, log = scene(rng)
    values = log.observation["value"].reshape(EPOCHS, N, 2)
    values[60:] += rng.normal(size=(30, N, 2)) * [times * RANGE_SIGMA_M, times * RATE_SIGMA_MPS]
    result = judged_at_the_end(bank, log)
    status = np.asarray(result.out.ledger["status"]).reshape(EPOCHS, N, 2)
    assert np.all(status[:60] == USED) and np.mean(status[60:] == USED) > 0.98
    assert bank.state["noise_factor"][0, :2] == pytest.approx([times**2, times**2], rel=0.5)
    told = result.out.events[: result.out.counts[0].events]
    assert told["kind"].tolist() == [RANGES_NOISY, RATES_NOISY]
    assert np.all(told["t_ns"] == log.epoch_ns[60])
    assert told["a"] == pytest.approx([times, times], rel=0.6)


def test_error_stays_within_its_sigma_when_noise_rises_by_ten(rng: np.random.Generator) -> None:
    """Forty draws, the two seconds after the rise: no velocity is beyond four sigma, nor a position."""
    worst = 0.0
    for _ in range(40):
        bank, log = scene(rng)
        values = log.observation["value"].reshape(EPOCHS, N, 2)
        values[60:] += rng.normal(size=(30, N, 2)) * [10.0 * RANGE_SIGMA_M, 10.0 * RATE_SIGMA_MPS]
        truth = bank.state[0].r_e.copy()
        short = log._replace(first=log.first[:63], epoch_ns=log.epoch_ns[:62], before_ns=log.before_ns[:62])
        judged_at_the_end(bank, short)
        error = np.concatenate([bank.state["r_e"][0] - truth, bank.state["v_e"][0]])
        sigma = np.sqrt(np.diag(bank.P[0]))[[DR, DR + 1, DR + 2, DV, DV + 1, DV + 2]]
        worst = max(worst, float(np.max(np.abs(error) / sigma)))
    assert worst < 4.0


def test_faults_do_not_raise_the_level(rng: np.random.Generator) -> None:
    """Four of twelve satellites that are wrong are no noise, and neither is a wrong velocity and place."""
    bank, log = scene(rng)
    values = log.observation["value"].reshape(EPOCHS, N, 2)
    values[60:, :4] += [50.0, 3.0]
    assert judged_at_the_end(bank, log).out.counts[0].events == 0
    assert np.all(bank.state["noise_factor"][0, :2] < 2.0)
    bank, log = scene(rng)
    bank.state["v_e"][0] += 5.0
    bank.state["r_e"][0] += 100.0
    result = judged_at_the_end(bank, log)
    told = result.out.events[: result.out.counts[0].events]
    assert not np.any((told["kind"] == RANGES_NOISY) | (told["kind"] == RATES_NOISY))


def half_known(rng: np.random.Generator, n: int) -> tuple[EpochWorkspace, Float64, Float64]:
    """Return n pseudoranges of noise 1, a prior of place and clock with sigma 0.5, and the rows of H."""
    work = new_epoch(n, OFFSETS)
    lines, unknowns = work.lines, [DR, DR + 1, DR + 2, CLOCK]
    azimuth, sine = rng.uniform(0.0, 2.0 * np.pi, n), np.linspace(0.1, 0.9, n)
    G = geometry(azimuth, np.arcsin(sine))
    P = np.diag(np.isin(np.arange(OFFSETS), unknowns) * 0.25)
    lines["h"][:, PSEUDORANGE, :4], lines["columns"][:, PSEUDORANGE, :4] = G, unknowns
    lines["count"][:, PSEUDORANGE], lines["status"][:, PSEUDORANGE] = 4, USED
    lines["predicted"][:, PSEUDORANGE] = 0.25 * np.sum(G**2, axis=1)
    lines["variance"][:, PSEUDORANGE] = 1.0
    return work, P, G


@pytest.mark.parametrize("n", [6, 11, 24])
def test_noise_as_assumed_raises_no_level(rng: np.random.Generator, n: int) -> None:
    """Once in 10^6 epochs it may; here there are 10^4, whose prediction shares its error among the rows."""
    (work, P, G), par = half_known(rng, n), parameters(**ADAPTING, residual_gate2=25.0)[0]
    lines, m = work.lines, new_filter(place()).state[0]
    for _ in range(10_000):
        lines["innovation"][:, PSEUDORANGE] = G @ rng.normal(size=4) * 0.5 + rng.normal(size=n)
        raise_level(m, P, lines, PSEUDORANGE, work.fit, np.zeros(n), par)
        assert m.noise_factor[PSEUDORANGE] == 1.0
    lines["innovation"][:, PSEUDORANGE] = G @ rng.normal(size=4) * 0.5 + 20.0 * rng.normal(size=n)
    raise_level(m, P, lines, PSEUDORANGE, work.fit, np.zeros(n), par)
    assert m.noise_factor[PSEUDORANGE] == pytest.approx(400.0, rel=0.9)
    assert np.all(lines["variance"][:, PSEUDORANGE] == m.noise_factor[PSEUDORANGE])


@pytest.mark.parametrize(("wrong", "rises"), [(2, False), (3, False), (5, True)])
def test_rows_that_a_third_contradicts_are_no_noise_wherever_the_clock_is(
    rng: np.random.Generator, wrong: int, rises: bool
) -> None:
    """A clock two sigmas off moves all innovations, wrong rows bend what all have in common: no median sees both."""
    (work, P, G), par = half_known(rng, 11), parameters(**ADAPTING, residual_gate2=25.0)[0]
    P[CLOCK, CLOCK] = 25.0
    work.lines["predicted"][:, PSEUDORANGE] += 25.0 - 0.25
    risen = 0
    for _ in range(200):
        m = new_filter(place()).state[0]
        innovation = G @ rng.normal(size=4) * 0.5 + rng.normal(size=11) + 10.0 * rng.choice([-1.0, 1.0])
        innovation[rng.choice(11, wrong, replace=False)] += rng.uniform(20.0, 40.0, wrong)
        work.lines["innovation"][:, PSEUDORANGE], work.lines["variance"][:, PSEUDORANGE] = innovation, 1.0
        raise_level(m, P, work.lines, PSEUDORANGE, work.fit, np.zeros(11), par)
        risen += m.noise_factor[PSEUDORANGE] > 1.0
    assert (risen > 0) == rises


def test_satellite_that_was_wrong_and_is_right_again_is_not_refused_for_it(rng: np.random.Generator) -> None:
    """A reflection of 6 m for 40 s: what comes back to the others is no drift, whatever the slow mean remembers."""
    bank, log = scene(rng)
    values = log.observation["value"].reshape(EPOCHS, N, 2)
    values[:60, 3, PSEUDORANGE] += 6.0
    imu = at_rest(place(), bank.state[0].C_eb, EPOCHS + 1.0, 20.0)
    result = run(bank, log, imu, parameters(drift_gate=3.0, range_gate2=100.0))
    status = np.asarray(result.out.ledger["status"]).reshape(EPOCHS, N, 2)
    assert np.all(status[60:] == USED)


@pytest.mark.parametrize("rate_mps", [0.3, -0.5])
def test_code_and_doppler_that_run_away_together_are_found_by_the_doppler(
    rng: np.random.Generator, rate_mps: float
) -> None:
    bank, log = scene(rng)
    values = log.observation["value"].reshape(EPOCHS, N, 2)
    values[30:, 3, PSEUDORANGE] += rate_mps * np.arange(EPOCHS - 30)
    values[30:, 3, RANGE_RATE] += rate_mps
    imu = at_rest(place(), bank.state[0].C_eb, EPOCHS + 1.0, 20.0)
    result = run(bank, log, imu, parameters(drift_gate=4.0))
    status = np.asarray(result.out.ledger["status"]).reshape(EPOCHS, N, 2)
    assert np.all(status[50:, 3] != USED)
    assert np.any(status[30:50, 3, RANGE_RATE] == DRIFTING)
    assert np.all(np.delete(status, 3, axis=1) == USED)


# ------------------------------------------------------------------------------------------------ reset


@pytest.mark.parametrize("outage_s", [1, 5, 20, 60])
def test_suspicion_is_chi_square_also_after_an_outage(rng: np.random.Generator, outage_s: int) -> None:
    """Range rates of a filter that is right: ten epochs, an outage, three epochs; chi^2 of three each time."""
    work, par = new_epoch(N, OFFSETS), parameters()[0]
    lines, u = work.lines, sky(place())[:, :3] - place().r_e
    G = np.column_stack([-u / np.linalg.norm(u, axis=1)[:, None], np.ones(N)])
    lines["h"][:, RANGE_RATE, VELOCITY : VELOCITY + 3] = G[:, :3]
    lines["status"][:, RANGE_RATE], lines["variance"][:, RANGE_RATE] = USED, RATE_SIGMA_MPS**2
    prior = np.diag(np.full(OFFSETS, 0.04**2))
    after = np.cumsum([*[1] * 10, outage_s, 1, 1])
    found = np.zeros((400, len(after)))
    for k in range(len(found)):
        m = new_filter(place()).state[0]
        for i, at_s in enumerate(after):
            x, noise = 0.04 * rng.normal(size=4), RATE_SIGMA_MPS * rng.normal(size=N)
            lines["innovation"][:, RANGE_RATE] = G @ x + noise
            follow_explained(m, prior, par, lines, work.fit, START_NS + int(at_s) * NS_PER_S)
            found[k, i] = m.suspicion
    low, high = mean_chi_square_bounds(3, len(found))
    assert low < found.mean(axis=0).min() and found.mean(axis=0).max() < high


def fix_of(bank: Bank, lever_b: np.ndarray, w_ib_b: np.ndarray, n_offsets: int) -> Fix:
    """Return the fix of an antenna on a lever arm of a filter's true state, one clock known."""
    m = bank.state[0]
    l_e = m.C_eb @ lever_b
    v_a = m.v_e + m.C_eb @ np.cross(w_ib_b, lever_b) - np.cross(W_IE_E, l_e)
    clocks = np.array([m.clock[0], *(math.nan,) * n_offsets])
    used = np.ones((2, 6), np.bool_)
    return Fix(
        START_NS,
        m.r_e + l_e,
        clocks,
        np.eye(4 + n_offsets),
        v_a,
        3.0,
        0.01 * np.eye(4),
        np.arange(6),
        used,
        used,
        True,
    )


def test_reset_takes_the_lever_arm_off_position_and_velocity() -> None:
    """Two metres at 30 deg/s are 1.05 m/s; at a sigma of 0.1 m/s that is no detail."""
    lever_b, w_ib_b = np.array([2.0, 0.0, 0.0]), np.radians([0.0, 0.0, 30.0])
    bank = new_filter(place(), v_n=(20.0, -5.0, 1.0), offsets=(3.0,))
    fix, truth = fix_of(bank, lever_b, w_ib_b, 1), bank.state.copy()
    bank.state["r_e"] += 50.0
    bank.state["v_e"] -= 3.0
    reinitialise_position(bank.state[0], bank.P[0], fix, lever_b, layout_with(n_offsets=1), w_ib_b, 40.0)
    assert bank.state["r_e"][0] == pytest.approx(truth["r_e"][0], abs=1e-6)
    assert bank.state["v_e"][0] == pytest.approx(truth["v_e"][0], abs=1e-6)
    # the sigma of a clock that the fix does not tell is the settings'
    assert bank.P[0, OFFSETS, OFFSETS] == pytest.approx(40.0**2)


def test_doubted_biases_keep_their_values() -> None:
    bank = new_filter(place())
    bank.state["b_a"], bank.state["b_g"] = 0.05, 1e-4
    sensor = sensor_model(TACTICAL)
    inflate_bias_covariance(bank.state[0], bank.P[0], sensor, Layout())
    assert np.all(bank.state["b_a"] == 0.05) and np.all(bank.state["b_g"] == 1e-4)
    assert bank.P[0, BA, BA] == sensor.accel_bias.sigma**2 and bank.P[0, BG, BG] == sensor.gyro_bias.sigma**2
