"""ECEF and geodetic coordinates against pymap3d, and there and back, from the sea floor to the GNSS satellites."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pymap3d
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymap3d import rcurve

from insgnss.constants import WGS84_A_M, WGS84_B_M
from insgnss.geodesy.ellipsoid import ecef_to_geodetic, geodetic_to_ecef, radii

LATITUDES_DEG = (-90.0, -89.999999, -45.0, -1e-7, 0.0, 30.0, 60.0, 89.9999999, 90.0)
LONGITUDES_DEG = (-180.0, -179.9999999, -90.0, 0.0, 1e-9, 77.0, 179.9999999, 180.0)
HEIGHTS_M = (-500.0, 0.0, 10e3, 2e6, 20e6)
ROUNDING_M = 1e-8  # two units of the last digit of 2.6e7 m


def to_ecef(lat: float, lon: float, h: float) -> np.ndarray:
    """Return the compiled ECEF position of radians and metres."""
    r_e = np.zeros(3)
    geodetic_to_ecef(lat, lon, h, r_e)
    return r_e


@pytest.mark.parametrize("h", HEIGHTS_M)
def test_geodetic_to_ecef_equals_pymap3d_at_poles_date_line_and_any_height(h: float) -> None:
    for lat, lon in product(LATITUDES_DEG, LONGITUDES_DEG):
        oracle = pymap3d.geodetic2ecef(lat, lon, h)

        assert to_ecef(math.radians(lat), math.radians(lon), h) == pytest.approx(oracle, abs=ROUNDING_M)


@pytest.mark.parametrize("h", HEIGHTS_M)
def test_ecef_to_geodetic_inverts_pymap3d_at_poles_date_line_and_any_height(h: float) -> None:
    for lat_deg, lon_deg in product(LATITUDES_DEG, LONGITUDES_DEG):
        r_e = np.array(pymap3d.geodetic2ecef(lat_deg, lon_deg, h))
        lat, lon, height = ecef_to_geodetic(r_e)

        assert height == pytest.approx(h, abs=ROUNDING_M)
        assert lat == pytest.approx(math.radians(lat_deg), abs=1e-15)  # 6 nm on the ground
        # east-west metres: longitude has no meaning at the pole, and -180 deg is 180 deg
        east = math.remainder(lon - math.radians(lon_deg), 2.0 * math.pi) * math.hypot(r_e[0], r_e[1])
        assert east == pytest.approx(0.0, abs=ROUNDING_M)


@pytest.mark.parametrize("h", [-500.0, 0.0, 10e3])
def test_ecef_to_geodetic_equals_pymap3d_where_that_is_exact(h: float) -> None:
    # higher up pymap3d's own inverse gives up latitude: 0.08 m at 2000 km, 8 m at 20 000 km
    for lat_deg, lon_deg in product(LATITUDES_DEG, LONGITUDES_DEG):
        r_e = to_ecef(math.radians(lat_deg), math.radians(lon_deg), h)
        lat, _, height = ecef_to_geodetic(r_e)
        oracle = pymap3d.ecef2geodetic(*r_e)

        assert (lat - math.radians(oracle[0])) * WGS84_A_M == pytest.approx(0.0, abs=ROUNDING_M)
        assert height == pytest.approx(oracle[2], abs=ROUNDING_M)


@given(
    st.floats(-math.pi / 2, math.pi / 2),
    st.floats(-math.pi, math.pi),
    st.floats(-500e3, 30e6),
)
def test_there_and_back_is_the_same_place(lat: float, lon: float, h: float) -> None:
    r_e = to_ecef(lat, lon, h)

    assert to_ecef(*ecef_to_geodetic(r_e)) == pytest.approx(r_e, abs=1.5 * ROUNDING_M)


def test_exact_pole_and_date_line_give_exact_angles() -> None:
    lat, lon, h = ecef_to_geodetic(np.array([0.0, 0.0, -WGS84_B_M]))
    assert (lat, lon, h) == (-math.pi / 2, 0.0, pytest.approx(0.0, abs=1e-9))

    lat, lon, h = ecef_to_geodetic(np.array([-WGS84_A_M, 0.0, 0.0]))
    assert (lat, lon, h) == (0.0, math.pi, pytest.approx(0.0, abs=1e-9))


def test_radii_of_curvature_have_their_closed_values_at_equator_and_pole() -> None:
    polar = WGS84_A_M**2 / WGS84_B_M

    assert radii(0.0) == pytest.approx((WGS84_B_M**2 / WGS84_A_M, WGS84_A_M), rel=1e-14)
    assert radii(math.pi / 2) == pytest.approx((polar, polar), rel=1e-14)


def test_radii_of_curvature_equal_pymap3d() -> None:
    for lat_deg in LATITUDES_DEG:
        oracle = rcurve.meridian(lat_deg), rcurve.transverse(lat_deg)

        assert radii(math.radians(lat_deg)) == pytest.approx(oracle, rel=1e-14)
