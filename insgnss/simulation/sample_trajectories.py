"""Ready-made trajectories: at rest, a circle in closed form, flights of an aircraft, a car's drive, over the pole."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from insgnss.constants import WGS84_A_M, WGS84_B_M
from insgnss.geodesy.ellipsoid import geodetic_to_ecef
from insgnss.geodesy.local_level import ecef_to_ned_matrix
from insgnss.simulation.course import KNOT_S, MARGIN_S, ManoeuvreSequence
from insgnss.simulation.trajectory import Trajectory
from insgnss.tables import Float64
from insgnss.units import deg_to_rad, rad_to_deg

WGS84_POLAR_RADIUS_M = WGS84_A_M**2 / WGS84_B_M  # of curvature, at the poles
# latitude, longitude [deg], ellipsoidal height [m]: the place of the sample flight
AIRFIELD = (59.97, 30.32, 20.0)


def _level_place(lat_deg: float, lon_deg: float, h_m: float) -> tuple[Float64, Float64]:
    """Return the ECEF position (3,) and C_en (3, 3) of a place."""
    r_e, C_ne = np.empty(3), np.empty((3, 3))
    geodetic_to_ecef(deg_to_rad(lat_deg), deg_to_rad(lon_deg), h_m, r_e)
    ecef_to_ned_matrix(deg_to_rad(lat_deg), deg_to_rad(lon_deg), C_ne)
    return r_e, C_ne.T


def _knots(duration_s: float, knot_s: float) -> Float64:
    return np.asarray(-MARGIN_S + knot_s * np.arange(int(np.ceil((duration_s + 2 * MARGIN_S) / knot_s)) + 1))


def static(
    duration_s: float,
    lat_deg: float,
    lon_deg: float,
    h_m: float,
    rpy_deg: tuple[float, float, float] = (0.0, 0.0, 0.0),
    *,
    knot_s: float = 1.0,
) -> Trajectory:
    """Return a vehicle at rest on the Earth."""
    r_e, C_en = _level_place(lat_deg, lon_deg, h_m)
    t = _knots(duration_s, knot_s)
    C_eb = Rotation.from_matrix(C_en) * Rotation.from_euler("ZYX", rpy_deg[::-1], degrees=True)
    return Trajectory.from_knots(t, np.tile(r_e, (len(t), 1)), Rotation.concatenate([C_eb] * len(t)))


def circle(
    duration_s: float,
    lat_deg: float,
    lon_deg: float,
    h_m: float,
    *,
    radius_m: float,
    speed_mps: float,
    bank_deg: float = 0.0,
    knot_s: float = KNOT_S,
) -> Trajectory:
    """Return a flat circle to the right, at constant rate, in the level plane of its centre.

    Equation: ``d_n = radius (sin a, -cos a, 0)``, yaw = ``a = speed t / radius``: it starts west of its centre, going
    north, with the nose along the velocity; ``w_nb_b = C_bn (0, 0, speed / radius)`` is constant.
    """
    centre_e, C_en = _level_place(lat_deg, lon_deg, h_m)
    t = _knots(duration_s, knot_s)
    angle = speed_mps / radius_m * t
    d_n = radius_m * np.column_stack([np.sin(angle), -np.cos(angle), np.zeros_like(t)])
    euler = np.column_stack([angle, np.zeros_like(t), np.full_like(t, deg_to_rad(bank_deg))])
    C_eb = Rotation.from_matrix(C_en) * Rotation.from_euler("ZYX", euler)
    return Trajectory.from_knots(t, centre_e + d_n @ C_en.T, C_eb)


def sample_flight_course() -> ManoeuvreSequence:
    """Return 20 minutes of an aircraft: 70 s at rest, take-off, climb, legs and turns of 25 to 45 deg, landing."""
    course = ManoeuvreSequence()
    course.hold(70.0).change_speed(72.0, 34.0).hold(2.0)
    climb_start = course.clock_s
    course.climb(1500.0, 8.0, meanwhile=True)
    course.hold(45.0).turn(-90.0, 25.0).hold(15.0).change_speed(100.0, 30.0)
    course.hold_until(climb_start + 205.0)
    course.turn(180.0, 30.0).hold(45.0)
    course.turn(-90.0, 43.5).hold(40.0)
    course.turn(-270.0, 45.0).hold(50.0)
    course.turn(60.0, 35.0).turn(-120.0, 35.0).turn(60.0, 35.0).hold(40.0)
    course.turn(360.0, 40.0).hold(20.0)
    descent_start = course.clock_s
    course.climb(-1500.0, 6.0, meanwhile=True)
    course.hold(20.0).turn(135.0, 30.0).hold(30.0).change_speed(72.0, 40.0).turn(45.0, 25.0)
    course.hold_until(descent_start + 262.0)
    return course.change_speed(0.0, 45.0).hold_until(1200.0)


def level_turns() -> Trajectory:
    """Return the 20-minute flight of ``sample_flight_course`` from the airfield."""
    return sample_flight_course().lay(*AIRFIELD, 10.0)


def airborne_turns(
    duration_s: float = 120.0,
    place: tuple[float, float, float] = (AIRFIELD[0], AIRFIELD[1], 1500.0),
    *,
    bank_deg: float = 35.0,
) -> Trajectory:
    """Return an aircraft that flies at 100 m/s: 10 s straight, then right and left turns by 120 deg, legs between."""
    course = ManoeuvreSequence(100.0).hold(10.0)
    side = 1.0
    while course.clock_s < duration_s:
        course.turn(120.0 * side, bank_deg).hold(10.0)
        side = -side
    course.clock_s = duration_s
    return course.lay(*place, 10.0)


def car(
    duration_s: float = 600.0,
    place: tuple[float, float, float] = AIRFIELD,
    heading_deg: float = 80.0,
    *,
    knot_s: float = KNOT_S,
) -> Trajectory:
    """Return a drive in a city: 20 s at rest, then blocks with right and left corners, each third one after a stop."""
    course = ManoeuvreSequence().hold(20.0)
    corner = 0
    while course.clock_s < duration_s:
        course.change_speed(14.0, 8.0).hold(12.0).change_speed(6.0, 5.0)
        course.steer(90.0 if corner % 4 < 2 else -90.0, 5.0)
        if corner % 3 == 2:
            course.change_speed(0.0, 5.0).hold(15.0)
        corner += 1
    course.clock_s = duration_s
    return course.lay(*place, heading_deg, knot_s=knot_s)


def over_the_pole(duration_s: float = 600.0) -> Trajectory:
    """Return a straight flight along a meridian that passes the north pole half-way and goes on down the other side."""
    speed_mps, h_m = 250.0, 10_000.0
    away_rad = 0.5 * duration_s * speed_mps / (WGS84_POLAR_RADIUS_M + h_m)
    course = ManoeuvreSequence(speed_mps).hold(duration_s)
    return course.lay(90.0 - rad_to_deg(away_rad), 30.0, h_m, 0.0)
