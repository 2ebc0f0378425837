"""Which model serves which satellite, and the delays of a whole log."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.errors import ConfigError, NavigationDataError
from insgnss.geodesy.ellipsoid import ecef_to_geodetic, geodetic_to_ecef
from insgnss.gnss.ionosphere import ionosphere_above, klobuchar_delay
from insgnss.gnss.ionosphere_rows import _nequick_at, antenna_places, ionosphere_rows, serving_models
from insgnss.gnss.orbits.satellite_state import satellite_states
from insgnss.simulation.sky import KLOBUCHAR, nominal_constellation
from insgnss.tables import Float64, GnssTable, NavigationData

NOON_NS = 2268 * NS_PER_WEEK + (4 * 86_400 + 43_200) * NS_PER_S
NAVIGATION = nominal_constellation(NOON_NS)
GALILEO = np.array([121.129893, 0.351254133, 0.0134635348])
BEIDOU = np.array([1.2107e-8, 1.3039e-7, -9.5367e-7, 1.6689e-6, 1.2288e5, -2.2938e5, 1.5073e6, 1.9661e6])
QZSS = np.array([2.1e-8, 7.5e-9, -6e-8, -6e-8, 1e5, 3.3e4, -2e5, -6.5e4])


def navigation(**coefficients: Float64) -> NavigationData:
    return replace(NAVIGATION, ionosphere=coefficients)


def place(lat: float, lon: float, h: float) -> Float64:
    r_e = np.empty(3)
    geodetic_to_ecef(lat, lon, h, r_e)
    return r_e


def log(letters: str, r_e: Float64, seconds: Float64) -> tuple[GnssTable, Float64]:
    """Return satellites above 5 deg, their constellations in turn, and where they are."""
    names = NAVIGATION.ephemerides.sv_names
    n = len(names) * len(seconds)
    none = np.full(n, np.nan)
    sv = np.tile(np.arange(len(names)), len(seconds)).astype(np.int16)
    t_ns = NOON_NS + np.repeat(np.rint(seconds * NS_PER_S).astype(np.int64), len(names))
    zero = np.zeros(n, np.int16)
    gnss = GnssTable(t_ns, sv, zero, np.full(n, 2.2e7), none, none, none, names, ("C1C",))
    sat = satellite_states(gnss, NAVIGATION.ephemerides).position
    up = r_e / np.linalg.norm(r_e)
    sine = (sat - r_e) @ up / np.linalg.norm(sat - r_e, axis=1)
    high = np.flatnonzero(sine > math.sin(math.radians(5.0)))
    renamed = tuple(letters[i % len(letters)] + name[1:] for i, name in enumerate(names))
    return replace(gnss.take(high), sv_names=renamed), sat[high]


def rows_of(gnss: GnssTable, letter: str) -> Float64:
    return np.array([name[0] == letter for name in gnss.sv_names])[gnss.sv]


HERE = place(0.4, 1.9, 50.0)
ONE = (np.array([NOON_NS]), HERE[None])


def test_each_setting_names_the_model_of_each_constellation() -> None:
    whole = navigation(galileo=GALILEO, beidou=BEIDOU, qzss=QZSS)
    assert serving_models(whole, "own") == {
        "G": "klobuchar",
        "R": "klobuchar",
        "E": "nequick",
        "C": "beidou",
        "J": "qzss",
        "I": "klobuchar",
        "S": "klobuchar",
    }
    for model in ("klobuchar", "nequick", "beidou", "none"):
        assert set(serving_models(whole, model).values()) == {model}


def test_what_is_not_known_is_served_by_another() -> None:
    assert set(serving_models(navigation(), "own").values()) == {"klobuchar"}
    without_gps = replace(navigation(galileo=GALILEO), klobuchar=None)
    assert set(serving_models(without_gps, "own").values()) == {"nequick"}
    assert set(serving_models(replace(navigation(), klobuchar=None), "own").values()) == {"none"}
    # converters write three zeros for coefficients that they do not have
    assert serving_models(navigation(galileo=np.zeros(3)), "own")["E"] == "klobuchar"


def test_model_without_coefficients_or_of_unknown_name_is_an_error() -> None:
    for model in ("nequick", "beidou"):
        with pytest.raises(NavigationDataError, match="ionosphere"):
            serving_models(navigation(), model)
    with pytest.raises(ConfigError, match="ionosphere"):
        serving_models(navigation(), "ionex")


def test_rows_of_the_compiled_model_stay_open() -> None:
    gnss, sat = log("G", HERE, np.zeros(1))
    assert np.isnan(ionosphere_rows(gnss, NAVIGATION, "klobuchar", *ONE, sat)).all()
    assert np.all(ionosphere_rows(gnss, NAVIGATION, "none", *ONE, sat) == 0.0)
    unknown = replace(NAVIGATION, klobuchar=None)
    assert np.all(ionosphere_rows(gnss, unknown, "klobuchar", *ONE, sat) == 0.0)


def test_own_models_serve_their_constellations() -> None:
    gnss, sat = log("GECJ", HERE, np.zeros(1))
    own = ionosphere_rows(gnss, navigation(galileo=GALILEO, beidou=BEIDOU, qzss=QZSS), "own", *ONE, sat)
    assert np.isnan(own[rows_of(gnss, "G")]).all()
    for letter, coefficients, model in (("E", GALILEO, "nequick"), ("C", BEIDOU, "beidou")):
        name = {"E": "galileo", "C": "beidou"}[letter]
        of_all = ionosphere_rows(gnss, navigation(**{name: coefficients}), model, *ONE, sat)
        rows = rows_of(gnss, letter)
        np.testing.assert_array_equal(own[rows], of_all[rows])
        assert np.all((own[rows] > 1.0) & (own[rows] < 60.0))
    assert np.all(own[rows_of(gnss, "J")] > 1.0)


@pytest.mark.parametrize("h", [50.0, 4.0e5])
def test_qzss_coefficients_are_used_in_the_form_of_gps_at_the_antennas_height(h: float) -> None:
    here = place(0.4, 1.9, h)
    gnss, sat = log("J", here, np.zeros(1))
    delay = ionosphere_rows(gnss, navigation(qzss=QZSS), "own", np.array([NOON_NS]), here[None], sat)
    lat, lon, _ = ecef_to_geodetic(here)
    up = np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])
    east = np.array([-math.sin(lon), math.cos(lon), 0.0])
    for i in range(len(delay)):
        u = (sat[i] - here) / np.linalg.norm(sat[i] - here)
        azimuth = math.atan2(u @ east, u @ np.cross(up, east))
        ground = klobuchar_delay(QZSS, lat, lon, azimuth, math.asin(u @ up), 4 * 86_400 + 43_200.0)
        assert delay[i] == pytest.approx(ionosphere_above(h) * ground, rel=1e-6)


def test_beidou_delay_is_scaled_from_b1i_to_l1() -> None:
    gnss, sat = log("C", HERE, np.zeros(1))
    night = BEIDOU.copy()
    night[:4] = 0.0
    delay = ionosphere_rows(gnss, navigation(beidou=night), "beidou", *ONE, sat)
    # 5 ns at the zenith on B1I, 1.8 % less on L1, through a shell at 375 km; the vertical is 0.2 deg off the radius
    up = HERE / np.linalg.norm(HERE)
    sine = (sat - HERE) @ up / np.linalg.norm(sat - HERE, axis=1)
    at_layer = 6378.0 / 6753.0 * np.sqrt(1.0 - sine**2)
    zenith = 5e-9 * 299_792_458.0 * (1561.098 / 1575.42) ** 2
    np.testing.assert_allclose(delay, zenith / np.sqrt(1.0 - at_layer**2), rtol=0.01)


def test_interpolated_nequick_is_within_its_stated_error_for_a_flying_antenna() -> None:
    """40 min of an aircraft at 250 m/s near the crest of the anomaly: 3 cm for 99 of 100, 0.15 m at worst."""
    start = place(0.35, -1.8, 9000.0)
    east = np.array([-math.sin(-1.8), math.cos(-1.8), 0.0])
    position_ns = NOON_NS + np.array([0, 2400]) * NS_PER_S
    position_e = np.stack([start, start + 250.0 * 2400.0 * east])
    gnss, sat = log("E", start, np.arange(0.0, 2400.0, 30.0))
    delay = ionosphere_rows(gnss, navigation(galileo=GALILEO), "nequick", position_ns, position_e, sat)
    assert np.isfinite(delay).all()
    antenna_e = antenna_places(gnss.t_ns, position_ns, position_e)
    some = np.arange(7, len(delay), 7)
    exact = [
        _nequick_at(GALILEO, gnss.t_ns[i], np.array(ecef_to_geodetic(antenna_e[i])), sat[i]) for i in some
    ]
    error = np.abs(delay[some] - exact)
    assert np.percentile(error, 98) < 0.03 and error.max() < 0.15
    # a fixed place must differ: 600 km matter
    fixed = ionosphere_rows(
        gnss, navigation(galileo=GALILEO), "nequick", position_ns[:1], position_e[:1], sat
    )
    assert np.nanmax(np.abs(fixed[some] - exact)) > 0.3


def test_satellite_without_a_state_keeps_no_delay() -> None:
    gnss, sat = log("EC", HERE, np.arange(0.0, 900.0, 300.0))
    sat[::5] = math.nan
    delay = ionosphere_rows(gnss, navigation(galileo=GALILEO, beidou=BEIDOU), "own", *ONE, sat)
    assert np.isnan(delay[::5]).all()
    assert np.isfinite(np.delete(delay, np.arange(0, len(delay), 5))).all()


def test_empty_log_gives_no_rows() -> None:
    gnss, sat = log("E", HERE, np.zeros(0))
    assert len(ionosphere_rows(gnss, navigation(galileo=GALILEO), "nequick", *ONE, sat)) == 0


def test_gps_coefficients_are_those_of_the_simulation() -> None:
    np.testing.assert_allclose(NAVIGATION.klobuchar, KLOBUCHAR, rtol=1e-4)
