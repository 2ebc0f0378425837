"""The geoid against published values, at the seam of the grid and at the poles."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.geodesy.sea_level import geoid_height

# NGA, EGM96, README of the 15 minute grid: the test values of its interpolation program
NGA = [
    (38.6281550, 269.7791550, -31.628),
    (-14.6212170, 305.0211140, -2.969),
    (46.8743190, 102.4487290, -43.575),
    (-23.6174460, 133.8747120, 15.871),
    (38.6254730, 359.9995000, 50.066),
    (-0.4667440, 0.0023000, 17.329),
]


@pytest.mark.parametrize(("lat_deg", "lon_deg", "published_m"), NGA)
def test_geoid_agrees_with_the_published_test_values(
    lat_deg: float, lon_deg: float, published_m: float
) -> None:
    # the grid is rounded to 5 mm, and two splines through it differ by as much
    assert geoid_height([lat_deg], [lon_deg])[0] == pytest.approx(published_m, abs=0.005)


def test_geoid_agrees_with_the_harmonics_between_the_nodes() -> None:
    # GeographicLib, GeoidEval: egm96-5 at 16:46:33N 3:00:34W (Timbuktu), made from the harmonics themselves
    assert geoid_height([16.0 + 46.0 / 60.0 + 33.0 / 3600.0], [-(3.0 + 34.0 / 3600.0)])[0] == pytest.approx(
        28.7068, abs=0.01
    )


def test_geoid_has_no_seam_and_one_value_at_a_pole() -> None:
    lat_deg = np.linspace(-89.9, 89.9, 50)
    east, west = (geoid_height(lat_deg, np.full(50, lon)) for lon in (180.0 - 1e-9, -180.0))

    assert np.allclose(east, west, atol=1e-6)
    assert np.isnan(geoid_height([np.nan, 10.0], [5.0, np.nan])).all()
    assert np.allclose(geoid_height([10.0], [370.0]), geoid_height([10.0], [10.0]), atol=1e-12)
    poles = geoid_height([90.0] * 4 + [-90.0] * 4, [0.0, 77.3, 180.0, 300.0] * 2)
    assert np.allclose(poles, [13.605] * 4 + [-29.535] * 4, atol=0.006)  # NGA: 13.61 and -29.53
