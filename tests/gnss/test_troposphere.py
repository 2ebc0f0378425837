"""Zenith delays, mapping and the atmosphere's upper end."""

from __future__ import annotations

import math

import numpy as np
import pytest
import sidereon

from insgnss.errors import ConfigError
from insgnss.gnss.troposphere import (
    STANDARD_WEATHER,
    mapping_coefficients,
    standard_atmosphere,
    weather_at_sea_level,
    zenith_delays,
)
from tests.gnss.troposphere import mapping_factors, tropospheric_delay

# Niell's season has its zero crossing a quarter of a year after day 28
NO_SEASON_US = int((1_672_531_200 + (28 - 1 + 365.25 / 4) * 86_400) * 1e6)


@pytest.mark.parametrize(
    ("h", "pressure", "temperature"),
    [  # ICAO standard atmosphere, doc 7488, by geopotential height
        (-500.0, 1074.78, 291.40),
        (0.0, 1013.25, 288.15),
        (5_000.0, 540.20, 255.65),
        (11_000.0, 226.32, 216.65),
        (20_000.0, 54.75, 216.65),
    ],
)
def test_standard_atmosphere_equals_its_table(h: float, pressure: float, temperature: float) -> None:
    p, T, _ = standard_atmosphere(h)
    assert p == pytest.approx(pressure, abs=0.02)
    assert T == pytest.approx(temperature, abs=0.01)


def test_zenith_delays_agree_with_an_independent_implementation(rng: np.random.Generator) -> None:
    for _ in range(200):
        lat, h = rng.uniform(-1.57, 1.57), rng.uniform(0.0, 8000.0)
        p, T, e = standard_atmosphere(h)
        dry, wet = sidereon.tropo_zenith_delay(lat, h, p, T, 0.7)
        assert zenith_delays(lat, h, p, T, e) == pytest.approx((dry, wet), abs=2e-5)


def test_hydrostatic_zenith_delay_is_2_31_m_at_the_sea() -> None:
    """0.0022768 * 1013.25 at 45 deg, height 0 (Davis et al. 1985): 2.3070 m."""
    assert zenith_delays(math.radians(45.0), 0.0, 1013.25, 288.15, 0.0)[0] == pytest.approx(2.3070, abs=1e-4)


def test_mapping_agrees_with_an_independent_implementation(rng: np.random.Generator) -> None:
    for _ in range(300):
        lat, h, el = rng.uniform(-1.57, 1.57), rng.uniform(0.0, 8000.0), math.radians(rng.uniform(3.0, 90.0))
        theirs = sidereon.tropo_mapping_factors(el, lat, h, NO_SEASON_US)
        # theirs takes the day with its fraction: 1e-7 of the season is left
        assert mapping_factors(lat, h, el) == pytest.approx(theirs, rel=1e-6)


def test_neglected_season_is_as_small_as_stated() -> None:
    def slant_change_m(elevation_deg: float) -> float:
        el, lat = math.radians(elevation_deg), math.radians(60.0)
        ours, _ = mapping_factors(lat, 0.0, el)
        winter, _ = sidereon.tropo_mapping_factors(el, lat, 0.0, int((1_672_531_200 + 27 * 86_400) * 1e6))
        return 2.3 * abs(winter - ours)

    assert slant_change_m(5.0) < 0.07
    assert slant_change_m(10.0) < 0.013


def test_mapping_is_one_at_the_zenith_and_grows_towards_the_horizon() -> None:
    assert mapping_factors(0.7, 0.0, math.pi / 2) == pytest.approx((1.0, 1.0), abs=1e-12)
    factors = np.array([mapping_factors(0.7, 300.0, el) for el in np.radians(np.arange(90.0, 1.9, -0.5))])
    assert np.all(np.diff(factors, axis=0) > 0.0)


def test_delay_below_two_degrees_stays_at_its_value_there() -> None:
    floor = tropospheric_delay(0.7, 100.0, math.radians(2.0))
    for elevation in (0.03, 0.0, -0.5, -math.pi / 2):
        assert tropospheric_delay(0.7, 100.0, elevation) == floor
    assert 40.0 < floor < 60.0


def test_delay_goes_smoothly_to_nothing_with_height() -> None:
    heights = np.concatenate([np.arange(-500.0, 60_000.0, 20.0), np.linspace(60e3, 2e6, 500), [4.2e7, 1e12]])
    for elevation in (math.pi / 2, math.radians(5.0)):
        delay = np.array([tropospheric_delay(0.9, h, elevation) for h in heights])
        assert np.all(np.isfinite(delay)) and np.all(delay >= 0.0) and np.all(np.diff(delay) <= 0.0)
        # 20 m of air make 6e-3 m at the zenith near the ground; no step anywhere, the tropopause included
        assert np.abs(np.diff(delay)).max() < 0.008 * tropospheric_delay(0.9, 0.0, elevation)
        assert delay[heights > 1e5].max() < 1e-4
        assert tropospheric_delay(0.9, 2e6, elevation) < 1e-12


def test_wild_height_makes_no_wild_delay() -> None:
    for h in (-6.4e6, -1e12, 1e12):
        assert 0.0 <= tropospheric_delay(0.3, h, 0.5) < 6.0


def test_weather_of_the_standard_atmosphere_is_the_standard_at_every_height() -> None:
    assert weather_at_sea_level() == weather_at_sea_level(h=800.0) == STANDARD_WEATHER
    for h in (0.0, 1500.0, 9000.0):
        pressure, temperature, _ = standard_atmosphere(h)
        assert weather_at_sea_level(pressure, temperature, 0.7, h) == pytest.approx(
            STANDARD_WEATHER, rel=1e-12
        )
        assert standard_atmosphere(h, *STANDARD_WEATHER) == standard_atmosphere(h)


def test_measured_weather_returns_at_the_height_where_it_was_measured() -> None:
    weather = weather_at_sea_level(843.2, 291.0, 0.35, 1580.0)
    pressure, temperature, vapour = standard_atmosphere(1580.0, *weather)
    assert (pressure, temperature) == pytest.approx((843.2, 291.0), abs=1e-9)
    # 35 % of the 20.6 hPa at which water boils away at 17.85 degC (steam tables: 20.5 hPa)
    assert vapour == pytest.approx(0.35 * 20.5, rel=0.01)


def test_pressure_moves_the_hydrostatic_delay_by_two_millimetres_for_each_hectopascal() -> None:
    low, high = (
        zenith_delays(0.8, 0.0, *standard_atmosphere(0.0, *weather_at_sea_level(p)))[0]
        for p in (980.0, 1040.0)
    )
    assert high - low == pytest.approx(60 * 2.28e-3, rel=5e-3)


def test_humidity_and_temperature_must_matter_in_the_wet_delay() -> None:
    def wet(temperature: float, humidity: float) -> float:
        weather = weather_at_sea_level(None, temperature, humidity)
        return zenith_delays(0.8, 0.0, *standard_atmosphere(0.0, *weather))[1]

    assert wet(288.15, 0.0) == 0.0
    assert wet(288.15, 1.0) == pytest.approx(2.0 * wet(288.15, 0.5), rel=1e-12)
    # a tropical day holds three times the water of a spring day: 0.4 m against 0.1 m
    assert 0.3 < wet(303.0, 0.9) < 0.45
    assert 0.01 < wet(263.0, 0.7) < 0.03


@pytest.mark.parametrize(
    ("pressure", "temperature", "humidity", "key"),
    [
        (101_325.0, None, None, "pressure_hpa"),
        (29.92, None, None, "pressure_hpa"),
        (None, 15.0, None, "temperature_k"),
        (None, -3.0, None, "temperature_k"),
        (None, None, 70.0, "humidity"),
        (math.nan, None, None, "pressure_hpa"),
        (1000.0, 0.0, None, "pressure_hpa"),
    ],
)
def test_weather_in_another_unit_is_refused(
    pressure: float | None, temperature: float | None, humidity: float | None, key: str
) -> None:
    with pytest.raises(ConfigError, match=key):
        weather_at_sea_level(pressure, temperature, humidity)


def test_latitude_that_is_no_number_gives_no_coefficients() -> None:
    m = np.zeros(9)
    mapping_coefficients(math.nan, 100.0, m)

    assert np.isnan(m[:8]).all()


@pytest.mark.parametrize(
    "lat_deg", [-90.0, -75.0, -74.9, -15.0, 0.0, 14.9, 15.0, 44.0, 60.0, 74.9, 75.0, 80.0, 90.0]
)
def test_coefficients_are_linear_between_the_columns_of_the_table(lat_deg: float) -> None:
    """Of Niell's table 3 the first row, by an interpolation of its own."""
    m = np.zeros(9)
    mapping_coefficients(math.radians(lat_deg), 0.0, m)
    table = [1.2769934e-3, 1.2683230e-3, 1.2465397e-3, 1.2196049e-3, 1.2045996e-3]

    assert m[0] == pytest.approx(np.interp(abs(lat_deg), [15.0, 30.0, 45.0, 60.0, 75.0], table), rel=1e-12)
