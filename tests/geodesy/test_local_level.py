"""North, east and down in ECEF axes against pymap3d and against the way the coordinates grow."""

from __future__ import annotations

import math

import numpy as np
import pymap3d
import pytest
from hypothesis import given
from hypothesis import strategies as st

from insgnss.geodesy.ellipsoid import geodetic_to_ecef, radii
from insgnss.geodesy.local_level import ecef_to_ned_matrix
from tests.jacobian import finite_difference_jacobian

latitudes = st.floats(-90.0, 90.0)
longitudes = st.floats(-180.0, 180.0)


def ned_matrix(lat: float, lon: float) -> np.ndarray:
    """Return the compiled C_ne."""
    C_ne = np.zeros((3, 3))
    ecef_to_ned_matrix(lat, lon, C_ne)
    return C_ne


def ecef(point: np.ndarray) -> np.ndarray:
    """Return the ECEF position of latitude, longitude and height."""
    r_e = np.zeros(3)
    geodetic_to_ecef(*point, r_e)
    return r_e


@given(latitudes, longitudes)
def test_axes_equal_pymap3d(lat_deg: float, lon_deg: float) -> None:
    v_e = np.array([0.3, -0.8, 0.5])

    east, north, up = pymap3d.ecef2enuv(*v_e, lat_deg, lon_deg)

    v_n = ned_matrix(math.radians(lat_deg), math.radians(lon_deg)) @ v_e
    assert v_n == pytest.approx([north, east, -up], abs=1e-15)


@given(latitudes, longitudes)
def test_axes_are_orthogonal_and_right_handed_at_poles_too(lat_deg: float, lon_deg: float) -> None:
    C_ne = ned_matrix(math.radians(lat_deg), math.radians(lon_deg))

    assert C_ne @ C_ne.T == pytest.approx(np.eye(3), abs=5e-16)
    assert np.cross(C_ne[0], C_ne[1]) == pytest.approx(C_ne[2], abs=5e-16)


@pytest.mark.parametrize("lat_deg", [-89.0, -33.0, 0.0, 59.97, 89.9])
@pytest.mark.parametrize("h", [0.0, 2e6])
def test_axes_point_where_latitude_longitude_and_depth_grow(lat_deg: float, h: float) -> None:
    lat, lon = math.radians(lat_deg), 0.5
    m, n = radii(lat)

    # the step is 1e-4 rad or 640 m of height: fourth-order error 1e-13, rounding 1e-9 m / 640 m
    ways = finite_difference_jacobian(ecef, np.array([lat, lon, h]), np.array([1e-4, 1e-4, 640.0]))

    metres = np.array([m + h, (n + h) * math.cos(lat), -1.0])  # per rad, per rad, per metre of height
    assert (ways / metres).T == pytest.approx(ned_matrix(lat, lon), abs=2e-9)
