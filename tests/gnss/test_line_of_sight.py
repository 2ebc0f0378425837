"""The line of sight against the light-time equation in extended precision, and its derivatives."""

from __future__ import annotations

import numpy as np
import pymap3d
import pytest

from insgnss.constants import C_MPS, WGS84_OMEGA_RADPS
from insgnss.geodesy.directions import angles_of
from insgnss.gnss.line_of_sight import line_of_sight, line_of_sight_range
from tests.jacobian import Float64, finite_difference_jacobian

Long = np.longdouble


def light_time_range(sat: Float64, r_e: Float64, v_e: Float64, t: float) -> Long:
    """Return c (t_reception - t_transmission) for reception at ``t``; the rows' states hold at t = 0 - tau(0).

    Solved to the last digit: |R3(omega tau) r_s(t - tau) - r(t)| = c tau, everything moving linearly in ECEF.
    """
    r_s, v_s = sat[0:3].astype(Long), sat[3:6].astype(Long)
    tau_0 = _flight_time(r_s, 0.0 * v_s, r_e.astype(Long), Long(0.0), Long(0.0))
    here = r_e.astype(Long) + v_e.astype(Long) * Long(t)
    return Long(C_MPS) * _flight_time(r_s, v_s, here, Long(t), tau_0)


def _flight_time(r_s: np.ndarray, v_s: np.ndarray, r_e: np.ndarray, t: Long, tau_0: Long) -> Long:
    tau = Long(0.08)
    for _ in range(30):
        x, y, z = r_s + v_s * (t - tau + tau_0)
        cosine, sine = np.cos(Long(WGS84_OMEGA_RADPS) * tau), np.sin(Long(WGS84_OMEGA_RADPS) * tau)
        d = np.array([cosine * x + sine * y, cosine * y - sine * x, z]) - r_e
        tau = np.sqrt(np.sum(d * d)) / Long(C_MPS)
    return tau


def central_rate(sat: Float64, r_e: Float64, v_e: Float64, h: float) -> Long:
    return (light_time_range(sat, r_e, v_e, h) - light_time_range(sat, r_e, v_e, -h)) / (2 * Long(h))


def random_geometry(
    rng: np.random.Generator, radius_m: float, speed_mps: float
) -> tuple[Float64, Float64, Float64]:
    """Return a satellite at 20 000 to 42 000 km of radius and a receiver below it."""
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    r_s = direction * rng.uniform(2.6e7, 4.22e7)
    r_e = direction + 0.4 * rng.normal(size=3)
    r_e *= radius_m / np.linalg.norm(r_e)
    return np.concatenate([r_s, rng.normal(size=3) * 2000.0]), r_e, rng.normal(size=3) * speed_mps


@pytest.mark.parametrize(("radius_m", "speed_mps"), [(6.37e6, 0.0), (6.38e6, 300.0), (8.4e6, 5000.0)])
def test_range_and_rate_equal_the_light_time_equation(
    rng: np.random.Generator, radius_m: float, speed_mps: float
) -> None:
    u, g = np.zeros(3), np.zeros(3)
    for _ in range(50):
        sat, r_e, v_e = random_geometry(rng, radius_m, speed_mps)
        distance, rate = line_of_sight(sat[None, :], 0, r_e, v_e, u, g)
        exact = light_time_range(sat, r_e, v_e, 0.0)
        wide, narrow = (central_rate(sat, r_e, v_e, h) for h in (0.02, 0.01))
        exact_rate = (4.0 * narrow - wide) / 3.0
        # tau to first order in the Earth's turn; two units in the last place of a position
        assert abs(float(distance - exact)) < 2e-8
        # the extended precision leaves 1e-12 m over a step of 10 ms
        assert abs(float(rate - exact_rate)) < 2e-9
        assert line_of_sight_range(sat[None, :], 0, r_e, u) == distance


def range_and_rate(sat: Float64, r_e: Float64, v_e: Float64) -> tuple[float, float]:
    return line_of_sight(sat[None, :], 0, r_e, v_e, np.zeros(3), np.zeros(3))


@pytest.mark.parametrize("case", range(20))
def test_derivatives_equal_finite_differences(rng: np.random.Generator, case: int) -> None:
    sat, r_e, v_e = random_geometry(rng, 6.4e6, 200.0)
    u, g = np.zeros(3), np.zeros(3)
    line_of_sight(sat[None, :], 0, r_e, v_e, u, g)
    by_position = finite_difference_jacobian(lambda r: range_and_rate(sat, r, v_e), r_e, 100.0)
    by_velocity = finite_difference_jacobian(lambda v: range_and_rate(sat, r_e, v), v_e, 1.0)
    # left out: the Doppler factor and the turn's dependence on the receiver, 2e-5 of the size
    np.testing.assert_allclose(by_position[0], -u, rtol=0, atol=2e-5)
    np.testing.assert_allclose(by_position[1], g, rtol=0, atol=2e-5 * 3e-4)
    np.testing.assert_allclose(by_velocity[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(by_velocity[1], -u, rtol=0, atol=2e-5)


def test_sagnac_must_matter_by_tens_of_metres_east_and_west() -> None:
    r_e = np.array([6.378e6, 0.0, 0.0])
    u = np.zeros(3)
    for side in (-1.0, 1.0):
        sat = np.array([[1.3e7, side * 2.3e7, 0.0]])
        straight = float(np.linalg.norm(sat[0] - r_e))
        turned = line_of_sight_range(sat, 0, r_e, u) - straight
        # omega / c (x_s y_r - y_s x_r) = -+36 m: a satellite in the east is nearer by the Earth's turn
        assert turned == pytest.approx(-side * WGS84_OMEGA_RADPS / C_MPS * 2.3e7 * 6.378e6, abs=1e-3)
        assert abs(turned) > 35.0


def test_range_at_the_pole_reduces_to_the_straight_line() -> None:
    r_e = np.array([0.0, 0.0, 6.357e6])
    sat = np.array([[1.5e7, 1.0e7, 1.9e7]])
    assert line_of_sight_range(sat, 0, r_e, np.zeros(3)) == pytest.approx(
        np.linalg.norm(sat[0] - r_e), abs=1e-8
    )


def test_light_time_must_matter_in_the_rate_by_millimetres_per_second() -> None:
    sat = np.array([[1.5e7, 1.2e7, 1.8e7, 2000.0, -1500.0, 1800.0]])
    r_e, v_e = np.array([6.37e6, 0.0, 0.0]), np.zeros(3)
    u, g = np.zeros(3), np.zeros(3)
    _, rate = line_of_sight(sat, 0, r_e, v_e, u, g)
    straight = (sat[0, :3] - r_e) / np.linalg.norm(sat[0, :3] - r_e)
    assert abs(rate - straight @ sat[0, 3:6]) > 1e-3


def test_rate_of_a_receiver_that_turns_with_the_earth_is_that_of_its_ecef_velocity() -> None:
    """A satellite fixed over the equator, seen from the ground, shows no range rate at all."""
    sat = np.array([[4.2164e7, 0.0, 0.0, 0.0, 0.0, 0.0]])
    u, g = np.zeros(3), np.zeros(3)
    _, rate = line_of_sight(sat, 0, np.array([5.0e6, 3.9e6, 1.0e6]), np.zeros(3), u, g)
    assert abs(rate) < 1e-10


def test_azimuth_and_elevation_equal_pymap3d(rng: np.random.Generator) -> None:
    for _ in range(50):
        lat, lon = rng.uniform(-1.55, 1.55), rng.uniform(-3.1, 3.1)
        u = rng.normal(size=3)
        u /= np.linalg.norm(u)
        C_ne = np.array([pymap3d.ecef2nedv(*axis, np.degrees(lat), np.degrees(lon)) for axis in np.eye(3)]).T
        azimuth, elevation = angles_of(C_ne @ u)
        r_e = np.array(pymap3d.geodetic2ecef(np.degrees(lat), np.degrees(lon), 0.0))
        az, el, _ = pymap3d.ecef2aer(*(r_e + 2e7 * u), np.degrees(lat), np.degrees(lon), 0.0)
        assert np.degrees(azimuth) % 360.0 == pytest.approx(az, abs=1e-9)
        assert np.degrees(elevation) == pytest.approx(el, abs=1e-9)
