"""The truth closes: velocity, attitude rate, specific force and increments belong to one motion."""

from __future__ import annotations

import numpy as np
import pymap3d
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from insgnss.constants import WGS84_OMEGA_RADPS
from insgnss.errors import ConfigError
from insgnss.geodesy.gravity import normal_gravity_ecef
from insgnss.geodesy.local_level import ned_axes
from insgnss.simulation import sample_trajectories
from insgnss.simulation.trajectory import Trajectory
from tests.geodesy.somigliana import somigliana
from tests.simulation.inertial_integration import gravitation_i, integrate, position_i, rotation_ib

EARTH = np.array([0.0, 0.0, WGS84_OMEGA_RADPS])


@pytest.fixture(scope="module")
def flight() -> Trajectory:
    return sample_trajectories.level_turns()


def closure_m(trajectory: Trajectory, from_s: float, to_s: float, step_s: float = 0.01) -> float:
    """Return the largest distance between integrated increments and the trajectory [m]."""
    edges = from_s + step_s * np.arange(2.0 * round((to_s - from_s) / (2 * step_s)) + 1.0)
    t, places, C_ib = integrate(trajectory, trajectory.increments(edges))
    turned = Rotation.from_matrix(C_ib.T @ rotation_ib(trajectory, t[-1:]).as_matrix()[0]).magnitude()
    assert turned < 1e-10
    return float(np.max(np.linalg.norm(places - position_i(trajectory, t), axis=1)))


def test_velocity_is_the_derivative_of_position(flight: Trajectory) -> None:
    t, h = np.arange(75.0, 1195.0, 1.7), 0.02
    slope = (
        8.0 * (flight.position_e(t + h) - flight.position_e(t - h))
        - (flight.position_e(t + 2 * h) - flight.position_e(t - 2 * h))
    ) / (12.0 * h)
    assert np.max(np.abs(slope - flight.velocity_e(t))) < 1e-6  # reached: 1e-7, rounding of 6e6 m over 20 ms


def test_angular_rate_is_the_derivative_of_the_inertial_attitude(flight: Trajectory) -> None:
    t, h = np.arange(75.0, 1195.0, 1.7), 1e-3
    turn = rotation_ib(flight, t - h).inv() * rotation_ib(flight, t + h)
    assert np.max(np.abs(turn.as_rotvec() / (2.0 * h) - flight.angular_rate_b(t))) < 1e-6


def test_specific_force_is_inertial_acceleration_less_gravitation(flight: Trajectory) -> None:
    t, h = np.arange(75.0, 1195.0, 3.1), 0.1
    second = (position_i(flight, t + h) - 2.0 * position_i(flight, t) + position_i(flight, t - h)) / h**2
    gravitation = np.array([gravitation_i(r, s) for r, s in zip(position_i(flight, t), t, strict=True)])
    f_b = rotation_ib(flight, t).apply(second - gravitation, inverse=True)
    # second difference over 0.1 s: h^2/12 of the fourth derivative (rolling in at 45 deg), and 4e-7 of rounding
    assert np.max(np.abs(f_b - flight.specific_force_b(t))) < 5e-3
    assert np.median(np.abs(f_b - flight.specific_force_b(t))) < 2e-5


@pytest.mark.parametrize("rpy_deg", [(0.0, 0.0, 0.0), (10.0, -20.0, 130.0), (0.0, 90.0, 0.0)])
@pytest.mark.parametrize("lat_deg", [-90.0, -33.0, 0.0, 59.97, 90.0])
def test_at_rest_the_sensors_feel_gravity_and_the_earths_rate(
    lat_deg: float, rpy_deg: tuple[float, float, float]
) -> None:
    trajectory = sample_trajectories.static(60.0, lat_deg, 30.0, 100.0, rpy_deg)
    increments = trajectory.increments(np.arange(6001.0) * 0.01)
    C_eb = trajectory.rotation_eb(np.array([0.0])).as_matrix()[0]
    g_e = np.empty(3)
    normal_gravity_ecef(trajectory.origin_e, g_e)
    assert np.max(np.abs(increments.mean_specific_force() + C_eb.T @ g_e)) < 1e-9
    assert np.max(np.abs(increments.mean_rate() - C_eb.T @ EARTH)) < 1e-12
    size = np.linalg.norm(increments.mean_specific_force(), axis=1)
    assert size == pytest.approx(somigliana(np.deg2rad(lat_deg), 100.0), abs=1e-6)


def test_a_level_vehicle_feels_gravity_upwards_and_north_latitude_turns_it() -> None:
    trajectory = sample_trajectories.static(10.0, 60.0, 30.0, 0.0, (0.0, 0.0, 0.0))
    f = trajectory.specific_force_b(np.array([5.0]))[0]
    w = trajectory.angular_rate_b(np.array([5.0]))[0]
    assert f == pytest.approx([0.0, 0.0, -9.8191], abs=2e-4)
    assert w == pytest.approx(WGS84_OMEGA_RADPS * np.array([0.5, 0.0, -np.sqrt(0.75)]), abs=1e-12)


def test_increments_integrated_in_the_inertial_frame_return_the_flight(flight: Trajectory) -> None:
    assert closure_m(flight, 300.0, 900.0) < 1e-4  # ten minutes with turns of 45 deg; reached 0.03 mm


def test_increments_integrated_in_the_inertial_frame_return_take_off_and_landing(flight: Trajectory) -> None:
    assert closure_m(flight, 60.0, 240.0) < 1e-5
    assert closure_m(flight, 1000.0, 1180.0) < 1e-5


def test_increments_integrated_in_the_inertial_frame_cross_the_pole() -> None:
    trajectory = sample_trajectories.over_the_pole()
    lat, lon, h = pymap3d.ecef2geodetic(*trajectory.position_e(np.array([295.0, 305.0])).T)
    assert lat == pytest.approx(90.0 - 5 * 250.0 / 111_693.0 / (1 + 10e3 / 6.4e6), abs=2e-4)
    assert lon == pytest.approx([30.0, -150.0], abs=0.1)
    assert h == pytest.approx(10_000.0, abs=1e-3)
    assert closure_m(trajectory, 0.0, 600.0) < 5e-5


def test_increments_add_up_whatever_the_sampling(flight: Trajectory) -> None:
    fine = flight.increments(400.0 + 0.0025 * np.arange(8001.0))
    coarse = flight.increments(400.0 + 0.02 * np.arange(1001.0))
    assert np.max(np.abs(fine.angle.reshape(-1, 8, 3).sum(axis=1) - coarse.angle)) < 1e-12
    assert np.max(np.abs(fine.velocity.reshape(-1, 8, 3).sum(axis=1) - coarse.velocity)) < 1e-10


def test_increments_do_not_depend_on_the_size_of_the_blocks(
    flight: Trajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    edges = 400.0 + 0.01 * np.arange(1001.0)
    whole = flight.increments(edges)
    monkeypatch.setattr("insgnss.simulation.trajectory.INTERVALS_AT_ONCE", 7)
    assert np.array_equal(whole.velocity, flight.increments(edges).velocity)


def test_circle_has_the_closed_form() -> None:
    radius, speed = 500.0, 50.0
    trajectory = sample_trajectories.circle(120.0, 45.0, 10.0, 1000.0, radius_m=radius, speed_mps=speed)
    t = np.arange(0.0, 120.0, 0.37)
    angle = speed / radius * t
    C_ne = ned_axes(np.deg2rad([[45.0, 10.0, 0.0]]))[0]
    zero = np.zeros_like(t)
    v_n = speed * np.column_stack([np.cos(angle), np.sin(angle), zero])
    a_n = speed**2 / radius * np.column_stack([-np.sin(angle), np.cos(angle), zero])
    C_nb = Rotation.from_euler("Z", angle[:, None])
    assert trajectory.velocity_e(t) @ C_ne.T == pytest.approx(v_n, abs=1e-6)
    earth_n = C_ne @ EARTH
    rate_n = earth_n + np.array([0.0, 0.0, speed / radius])
    assert trajectory.angular_rate_b(t) == pytest.approx(
        C_nb.apply(np.tile(rate_n, (len(t), 1)), inverse=True), abs=1e-9
    )
    gravity = np.empty((len(t), 3))
    for k, r in enumerate(trajectory.position_e(t)):
        normal_gravity_ecef(r, gravity[k])
    f_n = a_n + 2.0 * np.cross(earth_n, v_n) - gravity @ C_ne.T
    # positions of 5e6 m, rounded, differentiated twice over 0.1 s: 4e-7 m/s^2
    assert trajectory.specific_force_b(t) == pytest.approx(C_nb.apply(f_n, inverse=True), abs=1e-6)


def test_free_fall_in_orbit_feels_no_force() -> None:
    start = np.array([7.0e6, 0.0, 0.0, 0.0, 2500.0, 7100.0])

    def fall(t: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[3:], gravitation_i(y[:3], t)])

    t = np.arange(0.0, 600.5, 1.0)
    orbit = solve_ivp(fall, (0.0, t[-1]), start, method="DOP853", t_eval=t, rtol=1e-13, atol=1e-9).y
    turn = Rotation.from_rotvec(np.outer(t, EARTH))
    trajectory = Trajectory.from_knots(t, turn.apply(orbit[:3].T, inverse=True), Rotation.identity(len(t)))
    f = trajectory.increments(np.arange(5.0, 595.0, 0.1)).mean_specific_force()
    assert np.max(np.abs(f)) < 1e-5  # 7.5 km/s: of 8 m/s^2 of gravitation nothing is left


def test_a_tumbling_vehicle_has_the_rate_it_was_given() -> None:
    t = np.arange(0.0, 10.0, 0.01)
    axis, rate = np.array([0.6, 0.0, 0.8]), np.deg2rad(1000.0)
    C_eb = Rotation.from_rotvec(np.outer(rate * t, axis))
    place = np.tile([6_378_137.0, 0.0, 0.0], (len(t), 1))
    trajectory = Trajectory.from_knots(t, place, C_eb)
    middle = np.array([5.0, 5.003])
    assert trajectory.rate_eb_b(middle) == pytest.approx(np.tile(rate * axis, (2, 1)), abs=1e-8)


def test_times_outside_the_trajectory_are_refused(flight: Trajectory) -> None:
    with pytest.raises(ConfigError, match="covers"):
        flight.motion(np.array([1300.0]))
    with pytest.raises(ConfigError, match="covers"):
        flight.increments(np.array([-5.0, 0.0]))
