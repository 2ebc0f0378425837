"""The dipole's sign of the vertical field, at places whose dip is published."""

from __future__ import annotations

import math

import pytest

from insgnss.geodesy.magnetic_dipole import down_sign


@pytest.mark.parametrize(
    ("place", "lat_deg", "lon_deg", "sign"),
    [
        ("Boulder, dip 66 deg", 40.1, -105.2, 1),
        ("Kakioka, dip 50 deg", 36.2, 140.2, 1),
        ("Niemegk, dip 68 deg", 52.1, 12.7, 1),
        ("Canberra, dip -66 deg", -35.3, 149.4, -1),
        ("Hermanus, dip -65 deg", -34.4, 19.2, -1),
        ("Huancayo, dip 0 deg", -12.0, -75.3, 0),
        ("Vassouras, dip -40 deg, in the South Atlantic anomaly", -22.4, -43.7, 0),
    ],
)
def test_field_points_down_north_of_the_dip_equator_and_up_south_of_it(
    place: str, lat_deg: float, lon_deg: float, sign: int
) -> None:
    assert down_sign(math.radians(lat_deg), math.radians(lon_deg)) == sign, place
