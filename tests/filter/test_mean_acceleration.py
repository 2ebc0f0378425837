"""The acceleration that levels a start in motion: no farther than the velocities and the accelerometers bear it out."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.constants import NS_PER_S
from insgnss.filter.start.fix import Fix
from insgnss.filter.start.mean_acceleration import (
    MeanAcceleration,
    mean_acceleration,
    unknown_acceleration,
)
from insgnss.filter.start.rest import MeasuredVelocity, slight_acceleration
from insgnss.geodesy.gravity import normal_gravity_ecef
from insgnss.tables import Float64

PLACE_E = np.array([6_378_137.0, 0.0, 0.0])  # at longitude 0 on the equator up is x, east is y, north is z
SECONDS = 2.0


def gravity() -> Float64:
    g_e = np.zeros(3)
    normal_gravity_ecef(PLACE_E, g_e)
    return g_e


def fix(v_a: Float64, sigma: float, t_s: float) -> Fix:
    P_v = np.eye(4) * sigma**2
    none, unused = np.zeros(0, np.int64), np.zeros((2, 0), np.bool_)
    return Fix(
        int(t_s * NS_PER_S), PLACE_E, np.zeros(1), np.eye(4), v_a, 0.0, P_v, none, unused, unused, True
    )


def velocity(v_a: Float64, sigma: float, t_s: float) -> MeasuredVelocity:
    measured = fix(v_a, sigma, t_s).velocity
    assert measured is not None
    return measured


def found(change: list[float], sigma: float, true: list[float]) -> MeanAcceleration:
    """Return what two velocities of a sigma and a change [m/s] give where the true acceleration is ``true``."""
    later = fix(np.array(change), sigma, SECONDS)
    assert later.v_a is not None
    return mean_acceleration(
        later, fix(np.zeros(3), sigma, 0.0), later.v_a, later.P_v[:3, :3], np.array(true) - gravity()
    )


def test_good_velocities_count_in_full() -> None:
    mean = found([0.0, 6.0, 0.0], 0.02, [0.0, 3.0, 0.0])
    np.testing.assert_allclose(mean.a_e, [0.0, 3.0, 0.0], atol=0.01)
    assert mean.sigma == pytest.approx(np.sqrt(3.0 * 2.0) * 0.02 / SECONDS, rel=0.01)
    assert mean.excess == 1.0


def test_a_vertical_velocity_that_is_wrong_does_not_turn_the_vehicle_over() -> None:
    """40 m/s in two seconds are 20 m/s^2 downwards: f = a - g would point down."""
    mean = found([-40.0, 0.0, 0.0], 1.0, [0.0, 0.0, 0.0])
    np.testing.assert_array_equal(mean.a_e, 0.0)
    assert mean.sigma == pytest.approx(2.0)
    assert mean.excess > 10.0  # both velocities count as so much worse


def test_poor_velocities_are_believed_as_far_as_vehicles_accelerate() -> None:
    """Of a sigma of 7 m/s^2 and the accelerometers silent: the usual change of speed says more."""
    mean = found([0.0, 20.0, 0.0], 10.0, [0.0, 0.0, 0.0])
    assert 0.0 < mean.a_e[1] < 0.6
    assert 1.8 < mean.sigma < 2.0


def test_a_tight_turn_is_no_contradiction() -> None:
    """60 deg of bank: the accelerometers measure 2 g, and the velocity turns by 1.7 g."""
    aside = np.sqrt(3.0) * np.linalg.norm(gravity())
    mean = found([0.0, aside * SECONDS, 0.0], 1.0, [0.0, aside, 0.0])
    assert mean.a_e[1] == pytest.approx(aside, rel=0.02)


def test_without_velocities_a_vehicle_changes_its_speed_as_usual() -> None:
    mean = unknown_acceleration(PLACE_E, -gravity())
    np.testing.assert_array_equal(mean.a_e, 0.0)
    assert mean.sigma == pytest.approx(2.0)


@pytest.mark.parametrize("seed", range(3))
def test_the_sigma_is_that_of_the_error(seed: int) -> None:
    """Accelerations as assumed, the accelerometers' length known: mean square over 2000 draws within 20 %."""
    rng = np.random.default_rng(seed)
    sigma, square, expected = 1.5, 0.0, 0.0
    for _ in range(2000):
        true = rng.standard_normal(3) * 2.0 / np.sqrt(3.0)
        change = true * SECONDS + rng.standard_normal(3) * sigma * np.sqrt(2.0)
        mean = found(list(change), sigma, list(true))
        square += float(np.sum((mean.a_e - true) ** 2))
        expected += mean.sigma**2
    assert square / expected == pytest.approx(1.0, abs=0.2)


def test_the_end_of_a_brake_is_left_in_the_level() -> None:
    braked = slight_acceleration(
        velocity(np.array([0.0, 0.3, 0.0]), 0.02, 11.0), velocity(np.array([0.0, 0.8, 0.0]), 0.02, 10.0)
    )
    assert braked == pytest.approx(0.5, rel=0.01)


def test_noise_of_the_velocities_is_no_brake() -> None:
    """Mean square over many draws: what their sigmas explain is taken off."""
    rng = np.random.default_rng(4)
    v = rng.standard_normal((2000, 2, 3)) * 0.1
    squares = [slight_acceleration(velocity(b, 0.1, 11.0), velocity(a, 0.1, 10.0)) ** 2 for a, b in v]
    assert np.mean(squares) < 0.5 * 6 * 0.1**2
