"""The flight behind the simulated logs: an aircraft whose own bank hides the five satellites."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from insgnss.config.library import scenario_config
from insgnss.studies.masking.banked_flight import BankedFlight

SCENARIO = scenario_config("sokolov_2015")
OUTAGE, ROLL_S = SCENARIO.outage, SCENARIO.flight.roll_s


@cache
def flight() -> BankedFlight:
    return BankedFlight.of(SCENARIO, "tactical", "tcxo")


def test_bank_truly_hides_the_five_and_no_other_while_it_is_held() -> None:
    spells = flight().spells

    assert [spell.sv for spell in spells] == list(OUTAGE.sv)
    for spell in spells:
        # hidden when the bank is reached, and not before rolling in began; the same on the way out
        assert OUTAGE.from_s - ROLL_S < spell.from_s <= OUTAGE.from_s
        assert OUTAGE.until_s <= spell.until_s < OUTAGE.until_s + ROLL_S


def test_attitude_is_level_then_banked_then_level_and_the_heading_right_half_way() -> None:
    truth = flight().reference
    roll, _, heading = truth.rpy_deg[[0, 780, 800, 900, 1000, 1020, 2400]].T

    np.testing.assert_allclose(roll, [0.0, 0.0, -43.5, -43.5, -43.5, 0.0, 0.0], atol=1e-6)
    # 0.1 deg: against the geodesic of the start the meridians have turned meanwhile
    assert heading[3] % 360.0 == pytest.approx(355.5, abs=0.2)
    # coordinated: g tan(43.5 deg) / 250 m/s = 2.13 deg/s
    assert heading[2] - heading[4] == pytest.approx(2.133 * 20.0, abs=0.3)


def test_turn_is_coordinated_so_no_side_force_is_felt() -> None:
    t_s = flight().edges_s[1:]
    held = (t_s > OUTAGE.from_s + 0.5) & (t_s < OUTAGE.until_s - 0.5)
    side, down = flight().force_b[held, 1], flight().force_b[held, 2]

    # Coriolis at 250 m/s (0.03 m/s^2) is what the balance leaves out
    assert np.abs(side).max() < 0.05
    np.testing.assert_allclose(down, -9.82 / np.cos(np.radians(43.5)), rtol=0.01)


def test_draw_has_the_scenarios_noise_and_a_start_within_its_sigmas() -> None:
    draws = [flight().draw(np.random.default_rng([3, k])) for k in range(2)]
    difference = draws[0].observations.range_rate_mps - draws[1].observations.range_rate_mps

    # two draws of 0.25 m^2/s^2; the clocks' own difference, common to all satellites, is taken off
    apart = difference - difference.mean(axis=1, keepdims=True)
    count = apart.size - len(apart)
    variance = np.sum(apart**2) / count
    assert variance == pytest.approx(2.0 * 0.25, abs=0.5 * 4.0 * np.sqrt(2.0 / count))
    assert draws[0].observations.tracked.all()
    start = draws[0].start
    # five sigma of 30 m is 150 m, of 3 deg is 15 deg
    assert abs(start.h_m - 1000.0) < 150.0
    assert abs(start.lat_deg - SCENARIO.place.lat_deg) < 150.0 / 111e3 + 250.0 / 111e3
    assert start.sd_yaw_deg == 3.0
