"""A day at rest: with ideal sensors nothing moves, and an error swings with the period of Schuler's pendulum."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm

from insgnss.constants import (
    S_PER_DAY,
    WGS84_A_M,
    WGS84_B_M,
    WGS84_OMEGA_RADPS,
)
from insgnss.geodesy.ellipsoid import radii
from insgnss.geodesy.rotations import euler_to_matrix
from tests.geodesy.somigliana import WGS84_GAMMA_E_MPS2, WGS84_GAMMA_P_MPS2, WGS84_M, somigliana
from tests.inertial.held_height import Place, place_at_rest, stay
from tests.inertial.strapdown import EARTH, fly

POLAR_RADIUS_M = WGS84_A_M**2 / WGS84_B_M  # of curvature
EQUATORIAL_MERIDIAN_RADIUS_M = WGS84_B_M**2 / WGS84_A_M
MINUTES_S = 60.0 * np.arange(1, 24 * 60 + 1)


def at_rest(lat_deg: float, h_m: float = 0.0) -> Place:
    """Return a vehicle in an attitude like no other."""
    C_nb = np.zeros((3, 3))
    euler_to_matrix(0.3, -0.5, 2.0, C_nb)
    return place_at_rest(lat_deg, 30.0, h_m, C_nb)


def on_the_turning_earth(x_n: np.ndarray, lat_deg: float) -> np.ndarray:
    """Return what an observer at a pole, who turns with the Earth, sees of level displacements in fixed axes."""
    turn = np.sign(lat_deg) * WGS84_OMEGA_RADPS * MINUTES_S
    c, s = np.cos(turn), np.sin(turn)
    return np.column_stack([c * x_n[:, 0] - s * x_n[:, 1], s * x_n[:, 0] + c * x_n[:, 1]])


@pytest.mark.parametrize(
    ("dt", "limit_m"),
    [
        (
            1.0,
            0.02,
        ),  # (w dt)^2 / 12 of gravity, 4e-9 m/s^2, bends the level by 4e-10 rad of 6.4e6 m; reached 9 mm
        (0.1, 0.001),  # reached 0.2 mm
    ],
)
@pytest.mark.parametrize("lat_deg", [-90.0, 0.0, 60.0, 90.0])
def test_at_rest_with_ideal_sensors_the_position_stays_for_a_day(
    lat_deg: float, dt: float, limit_m: float
) -> None:
    assert np.max(np.abs(stay(at_rest(lat_deg, 100.0), S_PER_DAY, dt))) < limit_m


@pytest.mark.parametrize("lat_deg", [-90.0, 90.0])
def test_velocity_error_at_a_pole_swings_with_schulers_period_in_a_fixed_plane(lat_deg: float) -> None:
    speed = 0.1
    # of the inertial frame: gravitation is gravity without the centrifugal part
    schuler = math.sqrt(WGS84_GAMMA_P_MPS2 / POLAR_RADIUS_M + WGS84_OMEGA_RADPS**2)
    swing = speed / schuler * np.sin(schuler * MINUTES_S)

    moved = stay(at_rest(lat_deg), S_PER_DAY, 0.1, velocity_n=np.array([speed, 0.0, 0.0]))

    fixed = np.column_stack([swing, np.zeros_like(swing)])
    # 17 swings of 80 m; reached 0.2 mm
    assert moved == pytest.approx(on_the_turning_earth(fixed, lat_deg), abs=1e-3)
    assert 2.0 * math.pi / schuler / 60.0 == pytest.approx(84.34, abs=0.01)  # minutes


@pytest.mark.parametrize(
    ("axis", "radius_m", "minutes"), [(0, EQUATORIAL_MERIDIAN_RADIUS_M, 84.283), (1, WGS84_A_M, 84.567)]
)
def test_velocity_error_at_the_equator_swings_with_the_radius_of_its_direction(
    axis: int, radius_m: float, minutes: float
) -> None:
    speed = 0.1
    schuler = math.sqrt(WGS84_GAMMA_E_MPS2 / radius_m)
    velocity_n, expected = np.zeros(3), np.zeros((len(MINUTES_S), 2))
    velocity_n[axis] = speed
    expected[:, axis] = speed / schuler * np.sin(schuler * MINUTES_S)

    moved = stay(at_rest(0.0), S_PER_DAY, 0.1, velocity_n=velocity_n)

    # eastward the vertical Coriolis acceleration, held down, moves the level by 4 mm in a day
    assert moved == pytest.approx(expected, abs=6e-3)
    assert 2.0 * math.pi / schuler / 60.0 == pytest.approx(minutes, abs=0.001)


def test_tilt_error_at_a_pole_swings_about_the_place_where_gravity_is_level() -> None:
    place = at_rest(90.0)
    tilt_e = 1e-5 * place.C_ne[1] + 5e-6 * place.C_ne[0]
    schuler = math.sqrt(WGS84_GAMMA_P_MPS2 / POLAR_RADIUS_M + WGS84_OMEGA_RADPS**2)
    # dv' = psi x f: the tilt stands still in the inertial frame
    push_n = place.C_ne @ np.cross(tilt_e, -WGS84_GAMMA_P_MPS2 * place.C_ne[2])
    fixed = (push_n[:2] / schuler**2) * (1.0 - np.cos(schuler * MINUTES_S))[:, None]

    moved = stay(place, S_PER_DAY, 0.1, tilt_e=tilt_e)

    # up to 143 m, and psi^2 = 1e-10 of the 64 m it swings about; reached 1 mm
    assert moved == pytest.approx(on_the_turning_earth(fixed, 90.0), abs=5e-3)


@pytest.mark.parametrize("lat_deg", [-35.0, 60.0])
def test_velocity_error_precesses_like_foucaults_pendulum(lat_deg: float) -> None:
    lat = math.radians(lat_deg)
    gravity, (m, n) = somigliana(lat, 0.0), radii(lat)
    turn = 2.0 * WGS84_OMEGA_RADPS * math.sin(lat)
    # north, east: d'' = -gravity d / radius, and Coriolis of the level plane
    dynamics = np.zeros((4, 4))
    dynamics[0:2, 2:4] = np.eye(2)
    dynamics[2, 0], dynamics[3, 1] = -gravity / m, -gravity / n
    dynamics[2, 3], dynamics[3, 2] = -turn, turn
    minute = expm(60.0 * dynamics)
    state, expected = np.array([0.0, 0.0, 0.1, 0.05]), []
    for _ in MINUTES_S:
        state = minute @ state
        expected.append(state[:2])

    moved = stay(at_rest(lat_deg), S_PER_DAY, 0.1, velocity_n=np.array([0.1, 0.05, 0.0]))

    assert moved == pytest.approx(np.array(expected), abs=0.02)  # of 90 m


def test_height_error_grows_as_a_hyperbolic_cosine() -> None:
    place, up, count = at_rest(45.0), 1.0, 1800

    flown = fly(
        1.0,
        np.tile(place.w_b, (count, 1)),
        np.tile(place.f_b, (count, 1)),
        place.C_eb,
        place.r_e - up * place.C_ne[2],
        np.zeros(3),
    )

    # d'' = gradient d; gradient 2 g / a (1 + f + m - 2 f sin^2 lat), f cancels at 45 deg   [NGA.STND.0036, 4-3]
    gradient = 2.0 * somigliana(math.pi / 4.0, 0.0) / WGS84_A_M * (1.0 + WGS84_M)
    risen = -(flown.r_e - place.r_e) @ place.C_ne[2]
    # Coriolis bends the way up: (w t)^2 = 2 % of what has grown in 1800 s, turned aside by less; reached 2e-3
    assert risen == pytest.approx(up * np.cosh(math.sqrt(gradient) * np.arange(1.0, count + 1.0)), rel=5e-3)
    assert risen[-1] > 10.0  # the reason why the tests above hold the height


def test_earth_rotation_must_matter() -> None:
    place, end_s = place_at_rest(0.0, 30.0, 0.0, np.eye(3)), 100.0
    ideal = np.tile(place.f_b, (100, 1))

    # gyros that do not feel the Earth's rate: the level turns about north, gravity runs away to the west
    flown = fly(1.0, np.zeros((100, 3)), ideal, place.C_eb, place.r_e, np.zeros(3))

    east_m = (flown.r_e[-1] - place.r_e) @ place.C_ne[1]
    assert place.C_eb.T @ EARTH == pytest.approx([WGS84_OMEGA_RADPS, 0.0, 0.0])
    third = WGS84_GAMMA_E_MPS2 * WGS84_OMEGA_RADPS * end_s**3 / 6.0  # 119 m
    assert abs(east_m) == pytest.approx(third, rel=1e-3)
