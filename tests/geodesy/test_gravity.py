"""Normal gravity against the published numbers of WGS-84 and against a potential written for these tests."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from insgnss.constants import WGS84_A_M
from insgnss.geodesy.ellipsoid import geodetic_to_ecef, radii
from insgnss.geodesy.gravity import normal_gravity_ecef
from insgnss.geodesy.local_level import ecef_to_ned_matrix
from tests.geodesy.normal_field import OMEGA, gravitation, potential
from tests.geodesy.somigliana import WGS84_GAMMA_E_MPS2, WGS84_GAMMA_P_MPS2, somigliana
from tests.jacobian import finite_difference_jacobian

# J8 is neglected: 9 J8 g = 1.3e-9 m/s^2 on the ground, less above
WITHOUT_J8_MPS2 = 2e-9

latitudes = st.floats(-math.pi / 2, math.pi / 2)
longitudes = st.floats(-math.pi, math.pi)


def place(lat: float, lon: float, h: float) -> np.ndarray:
    """Return the ECEF position of radians and metres."""
    r_e = np.zeros(3)
    geodetic_to_ecef(lat, lon, h, r_e)
    return r_e


def gravity(r_e: np.ndarray) -> np.ndarray:
    """Return the compiled field."""
    g_e = np.zeros(3)
    normal_gravity_ecef(r_e, g_e)
    return g_e


@pytest.mark.parametrize(
    ("lat_deg", "published_mps2"),
    [
        (0.0, 9.7803253359),  # NGA.STND.0036, table 3.6
        (45.0, 9.8061977694),  # its equation 4-1, evaluated with the table's digits
        (-45.0, 9.8061977694),
        (90.0, 9.8321849379),
        (-90.0, 9.8321849379),
    ],
)
def test_somigliana_gives_the_published_gravity(lat_deg: float, published_mps2: float) -> None:
    assert somigliana(math.radians(lat_deg), 0.0) == pytest.approx(published_mps2, abs=1e-10)


def test_somigliana_has_the_published_mean_over_the_ellipsoid() -> None:
    def zone(lat: float) -> float:
        m, n = radii(lat)
        return m * n * math.cos(lat)

    weighted = quad(lambda lat: zone(lat) * somigliana(lat, 0.0), 0.0, math.pi / 2)[0]
    area = quad(zone, 0.0, math.pi / 2)[0]

    # NGA.STND.0036: mean value of normal gravity
    assert weighted / area == pytest.approx(9.7976432223, abs=2e-10)


@pytest.mark.parametrize("h", [-500.0, 100.0, 3000.0, 10_000.0, 20_000.0])
def test_somigliana_with_height_equals_the_field_up_to_what_it_neglects(h: float) -> None:
    # the flattening squared in the gradient 2 g / a, and 4 (h/a)^3 of gravity: 7e-7 and 1.5e-7 m/s^2 at 10 km
    neglected = 1.1e-10 * abs(h) + 4.2 * 9.8 * abs(h / WGS84_A_M) ** 3
    for lat in np.radians(np.arange(-90.0, 91.0, 7.5)):
        size = np.linalg.norm(gravity(place(lat, 0.4, h)))

        assert somigliana(lat, h) == pytest.approx(size, abs=WITHOUT_J8_MPS2 + neglected)


def test_height_series_is_wrong_by_a_tenth_at_2000_km_where_the_field_is_right() -> None:
    r_e = place(0.7, 0.0, 2e6)

    assert somigliana(0.7, 2e6) - np.linalg.norm(gravity(r_e)) == pytest.approx(0.9, abs=0.05)


@given(latitudes, longitudes)
def test_field_equals_somigliana_on_the_ellipsoid(lat: float, lon: float) -> None:
    # reached: 1.3e-9 m/s^2
    assert np.linalg.norm(gravity(place(lat, lon, 0.0))) == pytest.approx(
        somigliana(lat, 0.0), abs=WITHOUT_J8_MPS2
    )


def test_field_has_the_published_gravity_at_equator_and_poles() -> None:
    assert np.linalg.norm(gravity(place(0.0, 1.0, 0.0))) == pytest.approx(
        WGS84_GAMMA_E_MPS2, abs=WITHOUT_J8_MPS2
    )
    for lat in (-math.pi / 2, math.pi / 2):
        assert np.linalg.norm(gravity(place(lat, 1.0, 0.0))) == pytest.approx(
            WGS84_GAMMA_P_MPS2, abs=WITHOUT_J8_MPS2
        )


@given(latitudes, longitudes)
def test_field_stands_upright_on_the_ellipsoid(lat: float, lon: float) -> None:
    C_ne = np.zeros((3, 3))
    ecef_to_ned_matrix(lat, lon, C_ne)

    g_n = C_ne @ gravity(place(lat, lon, 0.0))

    # the ellipsoid is a level surface: a deflection of 2e-10 rad is left by J8
    assert g_n[:2] == pytest.approx([0.0, 0.0], abs=WITHOUT_J8_MPS2)
    assert g_n[2] > 9.78


@given(latitudes, longitudes, st.floats(-500.0, 20e6))
def test_field_is_the_gradient_of_the_potential(lat: float, lon: float, h: float) -> None:
    r_e = place(lat, lon, h)

    slope = finite_difference_jacobian(potential, r_e, 5e3)[0]

    # rounding of 6e7 m^2/s^2 over 5 km: 3e-12 m/s^2
    assert gravity(r_e) == pytest.approx(slope, abs=WITHOUT_J8_MPS2)


def test_centrifugal_acceleration_is_all_that_parts_gravity_from_gravitation() -> None:
    r_e = place(0.6, -2.0, 2e6)

    away = OMEGA**2 * np.array([r_e[0], r_e[1], 0.0])

    assert gravity(r_e) - gravitation(r_e) == pytest.approx(away, abs=WITHOUT_J8_MPS2)
    assert np.linalg.norm(away) > 0.03  # it must matter
