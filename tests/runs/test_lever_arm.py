"""A lever arm that is wrong in the flight file: found in turns as well as it is claimed, and not found at rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import insgnss
from insgnss.log.flight import FlightInMemory
from insgnss.tables import Float64
from tests.benchmarks.trust.flying import drawn
from tests.benchmarks.trust.motions import scenario, straight
from tests.benchmarks.trust.rows import Row
from tests.runs.scenes import flight, turns
from tests.statistics_bounds import assert_mean_chi_square, nees

SIGMA_M = 0.5
SETTINGS = {"process.lever_arm_sigma_m": SIGMA_M, "process.imu_time_sigma_s": 0.0}
PLAIN = {"health.recovery": False}  # else a sensor is blamed for the wrong lever arm, after many looks back


def with_wrong_arm(flown: FlightInMemory, off: Float64) -> FlightInMemory:
    """Return a flight whose file has the antenna ``off`` [m] from where it is."""
    gnss = flown.config.gnss
    assert gnss.lever_arm_m is not None
    wrong = tuple(float(v) for v in np.array(gnss.lever_arm_m) - off)
    gnss = gnss.model_copy(update={"lever_arm_m": wrong})
    return replace(flown, config=flown.config.model_copy(update={"gnss": gnss}))


def found(run: insgnss.Run) -> tuple[Float64, Float64]:
    """Return the lever arm's error as it was found at the end, and its sigmas [m]."""
    last = run.nav.iloc[-1]
    value = np.array([last[f"lever_arm_{axis}_m"] for axis in "xyz"])
    return value, np.array([last[f"sd_lever_arm_{axis}_m"] for axis in "xyz"])


def roll_over_sigma(run: insgnss.Run) -> float:
    """Return the rms of the roll's error over its sigma in the second half of a run."""
    ratio = (run.errors["d_roll_deg"] / run.errors["sd_roll_deg"]).to_numpy()
    return float(np.sqrt(np.mean(np.square(ratio[len(ratio) // 2 :]))))


def test_lever_arm_is_found_in_turns_and_the_attitude_is_as_good_as_it_claims() -> None:
    """Turns of 35 deg of bank; errors drawn from the prior, so the sum of squared errors over sigma is chi^2."""
    rng, squares, rolls = np.random.default_rng(515), [], []
    for seed in range(6):
        off = SIGMA_M * rng.standard_normal(3)
        flown = with_wrong_arm(flight(turns(180.0), seed=300 + seed), off)
        run, plain = (insgnss.replay(flown, settings=settings) for settings in (SETTINGS, PLAIN))
        value, sigma = found(run)
        squares.append(nees((value - off)[:, None], (sigma**2)[:, None, None]))
        assert sigma.max() < 0.4 * SIGMA_M
        rolls.append([roll_over_sigma(each) for each in (run, plain)])
    assert_mean_chi_square(squares, 1)
    with_state, without = np.median(rolls, axis=0)
    assert 0.5 < with_state < 1.5 and without > 1.3 * with_state


def test_vehicle_at_rest_shows_no_lever_arm_however_its_heading_drifts() -> None:
    """Half an hour with carriers: the attitude of a consumer sensor wanders by tens of degrees, the antenna stays."""
    text = scenario("lever_at_rest", straight(1800.0), grade="mems_consumer", rate_hz=25.0, carrier=True)
    row = Row("lever_at_rest", "rest", text, (), "mems_consumer", looks={"end": 1798.0})
    _, _, flown = drawn(row, 8)
    run = insgnss.replay(with_wrong_arm(flown, np.array([0.6, -0.4, 0.5])), settings=SETTINGS, output=10.0)
    value, sigma = found(run)
    assert sigma.min() > 0.95 * SIGMA_M
    assert np.abs(value).max() < 0.2 * SIGMA_M
