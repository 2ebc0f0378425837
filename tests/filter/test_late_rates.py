"""Range rates that lag behind the motion: the law of the lag, and what it makes of a prediction."""

from __future__ import annotations

import cmath

import numpy as np
import pytest

from insgnss.constants import NS_PER_S, WGS84_GM_M3PS2, WGS84_OMEGA_RADPS
from insgnss.filter.rows.late_rates import LATE_RATE_DOUBT, carry_late_velocity, set_lag
from insgnss.gnss.observation_rows import RANGE_RATE
from insgnss.tables import Float64
from tests.filter.scene import START_NS, new_filter, observed, parameters, place, rows_of, sky

AT = place(47.0, 11.0, 500.0)
STEP_S = 0.005


def lag_of_a_swaying_velocity(late_s: float, w_radps: float, *, lever: bool) -> complex:
    """Return the lag of exp(i w t) long after its beginning, of the IMU's velocity or of the antenna's about it."""
    m = new_filter(AT).state[0]
    m.rates_late_s = late_s
    par = parameters((1.0 / w_radps, 0.0, 0.0) if lever else (0.0, 0.0, 0.0))[0]
    rate = np.array([0.0, 0.0, w_radps if lever else 0.0])
    m.v_e[:] = 0.0
    for k in range(1, round(40.0 * late_s / STEP_S)):
        angle, before = w_radps * k * STEP_S, tuple(m.v_e)
        if lever:  # the antenna's velocity is (-sin, cos, 0) of the angle
            c, s = np.cos(angle), np.sin(angle)
            m.C_eb[:] = [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]
        else:
            m.v_e[:] = [-np.sin(angle), np.cos(angle), 0.0]
        carry_late_velocity(m, par, rate, before, STEP_S)
    e = m.dv_late.sum(axis=0)
    return complex(e[1], -e[0]) * cmath.exp(-1j * angle)


@pytest.mark.parametrize("lever", [False, True])
@pytest.mark.parametrize(("late_s", "w_radps"), [(0.1, 0.5), (0.5, 1.0), (1.0, 2.0)])
def test_velocity_that_is_smoothed_twice_lags_as_theory_says(
    late_s: float, w_radps: float, lever: bool
) -> None:
    expected = 1.0 - 1.0 / (1.0 + 0.5j * w_radps * late_s) ** 2
    assert lag_of_a_swaying_velocity(late_s, w_radps, lever=lever) == pytest.approx(
        expected, abs=2.0 * STEP_S * w_radps * abs(expected)
    )


def moved(sat: Float64, dt: float) -> Float64:
    """Return satellites (k, 8) on their orbits about the Earth's centre after ``dt``, in axes that turn with it."""
    w = np.array([0.0, 0.0, WGS84_OMEGA_RADPS])
    r, v = sat[:, :3].copy(), sat[:, 3:6] + np.cross(w, sat[:, :3])
    for _ in range(200):
        h = dt / 200.0
        v -= 0.5 * h * WGS84_GM_M3PS2 * r / np.linalg.norm(r, axis=1)[:, None] ** 3
        r += h * v
        v -= 0.5 * h * WGS84_GM_M3PS2 * r / np.linalg.norm(r, axis=1)[:, None] ** 3
    c, s = np.cos(-WGS84_OMEGA_RADPS * dt), np.sin(-WGS84_OMEGA_RADPS * dt)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    there = sat.copy()
    there[:, :3], there[:, 3:6] = r @ turn.T, (v - np.cross(w, r)) @ turn.T
    return there


def test_satellites_that_move_on_are_predicted_where_they_were() -> None:
    late_s, bank, par = 0.5, new_filter(AT), parameters()
    now = sky(AT)
    epochs = START_NS + np.array([0, round(-late_s * NS_PER_S)])
    log = rows_of(epochs, np.stack([now, moved(now, -late_s)]))
    at_once = observed(bank, par, log, 0).lines["innovation"][:, RANGE_RATE].copy()
    earlier = observed(bank, par, log, 1).lines["innovation"][:, RANGE_RATE].copy()
    set_lag(bank, late_s)
    late = observed(bank, par, log, 0).lines["innovation"][:, RANGE_RATE]
    assert np.abs(earlier - at_once).max() > 0.05
    assert late == pytest.approx(earlier, abs=2e-4)


def test_row_whose_rate_lags_by_much_is_uncertain_by_a_share_of_it() -> None:
    bank, par, log = new_filter(AT), parameters(), rows_of([START_NS], sky(AT))
    sound = observed(bank, par, log).lines["variance"][:, RANGE_RATE].copy()
    set_lag(bank, 0.4)
    lines = observed(bank, par, log).lines
    assert lines["variance"][:, RANGE_RATE] == pytest.approx(sound)  # of the satellites' own motion nothing
    predicted = lines["innovation"][:, RANGE_RATE].copy()
    bank.state["dv_late"] = [3.0, -2.0, 1.0]
    lines = observed(bank, par, log).lines
    late = predicted - lines["innovation"][:, RANGE_RATE]
    expected = sound + (LATE_RATE_DOUBT * 0.4 * late) ** 2
    assert lines["variance"][:, RANGE_RATE] == pytest.approx(expected)
    assert np.abs(late).max() > 1.0


def test_lag_that_begins_in_a_turn_does_not_begin_with_the_swing() -> None:
    bank, par = new_filter(AT), parameters((2.0, 0.0, 0.0))
    set_lag(bank, 0.3)
    m = bank.state[0]
    carry_late_velocity(m, par[0], np.array([0.0, 0.0, 0.5]), tuple(m.v_e), STEP_S)
    assert np.abs(m.dv_late).max() < 1e-12
    assert np.linalg.norm(m.swing_late) == pytest.approx(1.0)
