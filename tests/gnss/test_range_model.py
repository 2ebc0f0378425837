"""The list of corrections: each one listed moves the prediction the way and by the size that the list says."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import insgnss
from insgnss.constants import C_MPS
from insgnss.geodesy.ellipsoid import ecef_to_geodetic, geodetic_to_ecef
from insgnss.geodesy.local_level import ecef_to_ned_matrix
from insgnss.gnss.differential import Corrections, apply, base_ranges
from insgnss.gnss.line_of_sight import line_of_sight_range
from insgnss.gnss.orbits.satellite_state import SatelliteStates, satellite_states
from insgnss.gnss.phase_centre import SatelliteAntennas, phase_centre_offsets
from insgnss.gnss.range_model import (
    AIR_DTYPE,
    CORRECTIONS,
    AirModel,
    RangeCorrection,
    evaluate_atmosphere,
    path_delay,
    slant_delay,
)
from insgnss.gnss.troposphere import STANDARD_WEATHER, weather_at_sea_level
from insgnss.simulation.sky import KLOBUCHAR, nominal_constellation
from insgnss.tables import Float64, GnssTable
from tests.gnss.broadcast_sample import observations
from tests.gnss.troposphere import mapping_factors

WEEK_S = 4 * 86_400 + 46_800.0
NOON_NS = int((2268 * 604_800 + WEEK_S) * 1e9)
NAVIGATION = nominal_constellation(NOON_NS)
COEFFICIENTS = np.array(KLOBUCHAR)
LAT, LON, H = 0.7, 0.2, 100.0
RECEIVER = np.empty(3)
geodetic_to_ecef(LAT, LON, H, RECEIVER)


def visible() -> tuple[GnssTable, SatelliteStates, Float64]:
    """Return one epoch of the satellites above 10 deg at 13 h, their states and unit vectors north-east-down."""
    names = NAVIGATION.ephemerides.sv_names
    log = observations(names, [NOON_NS] * len(names), [2.2e7] * len(names))
    states = satellite_states(log, NAVIGATION.ephemerides)
    C_ne = np.empty((3, 3))
    ecef_to_ned_matrix(LAT, LON, C_ne)
    u = states.position - RECEIVER
    u_n = (u / np.linalg.norm(u, axis=1)[:, None]) @ C_ne.T
    high = np.flatnonzero(-u_n[:, 2] > math.sin(math.radians(10.0)))
    return (
        log.take(high),
        SatelliteStates(*(np.ascontiguousarray(field[high]) for field in states)),
        u_n[high],
    )


LOG, STATES, U_N = visible()
COUNT = len(U_N)


def ranges(sat: Float64) -> Float64:
    return np.array([line_of_sight_range(sat, k, RECEIVER, np.empty(3)) for k in range(len(sat))])


def delays(ionosphere: float, troposphere: float, **weather: float) -> Float64:
    air = np.zeros(1, AIR_DTYPE)
    evaluate_atmosphere(air[0], LAT, LON, H, WEEK_S, troposphere, weather_at_sea_level(h=H, **weather))
    return np.array([slant_delay(air[0], COEFFICIENTS, u, ionosphere, math.nan) for u in U_N])


def light_time() -> Float64:
    """Return the change of range when the satellite is taken at the reception instead of the transmission."""
    moved = STATES.sat.copy()
    moved[:, :3] += 0.075 * STATES.velocity
    return ranges(STATES.sat) - ranges(moved)


def earths_turn() -> Float64:
    return ranges(STATES.sat) - np.linalg.norm(STATES.position - RECEIVER, axis=1)


def satellite_antenna() -> Float64:
    one = np.array([[0.279, 0.0, 2.35]])  # of Block IIA
    moved = STATES.sat.copy()
    for k, sv in enumerate(LOG.sv):
        antennas = SatelliteAntennas((LOG.sv_names[sv],), np.array([0]), np.array([2**62]), one)
        moved[k, :3] += phase_centre_offsets(
            antennas, LOG.sv_names[sv], LOG.t_ns[k : k + 1], moved[k : k + 1, :3]
        )[0]
    return ranges(moved) - ranges(STATES.sat)


def satellite_clock() -> Float64:
    return -STATES.clock_m


def relativity() -> Float64:
    return 2.0 / C_MPS * np.sum(STATES.position * STATES.velocity, axis=1)


def group_delay() -> Float64:
    unknown = GnssTable(**{**vars(LOG), "signal_names": ("",)})
    return satellite_states(unknown, NAVIGATION.ephemerides).clock_m - STATES.clock_m


def differential() -> Float64:
    """Return what a base's correction of +-7 m takes off the pseudorange."""
    by_name = LOG.sv.astype(np.int16)
    sign = np.where(np.arange(COUNT) % 2, 7.0, -7.0)
    order = np.argsort(by_name)
    table = Corrections(
        LOG.sv_names,
        LOG.signal_names,
        LOG.t_ns,
        by_name[order],
        np.zeros(COUNT, np.int16),
        STATES.message[order],
        sign[order],
    )
    return apply(table, LOG, STATES.message, 10.0)


MOVES: dict[str, Callable[[], Float64]] = {
    "light time": light_time,
    "Earth's turn": earths_turn,
    "satellite antenna": satellite_antenna,
    # filter states: their sizes are those of receivers, and enter one for one
    "receiver clock": lambda: np.array([30.0, 1.5e5]),
    "inter-system offset": lambda: np.array([3.0, 70.0]),
    "satellite clock": satellite_clock,
    "relativity of the eccentricity": relativity,
    "group delay": group_delay,
    "ionosphere": lambda: delays(1.0, 0.0),
    "hydrostatic troposphere": lambda: delays(0.0, 1.0, humidity=0.0),
    "wet troposphere": lambda: delays(0.0, 1.0) - delays(0.0, 1.0, humidity=0.0),
    "differential correction": differential,
}


def test_list_and_proofs_name_the_same_corrections() -> None:
    assert [term.name for term in CORRECTIONS] == list(MOVES)


@pytest.mark.parametrize("term", CORRECTIONS, ids=lambda term: term.name)
def test_each_listed_correction_moves_the_prediction_by_its_stated_size(term: RangeCorrection) -> None:
    moved = MOVES[term.name]()
    least, most = term.size_m
    assert np.isfinite(moved).all()
    assert np.abs(moved).max() <= most
    # not every satellite has the largest one, but the list must not say a size that none has
    assert np.abs(moved).max() >= max(least, most / 1000.0)


@pytest.mark.parametrize("name", ["ionosphere", "hydrostatic troposphere", "wet troposphere"])
def test_delays_of_the_air_lengthen_every_range(name: str) -> None:
    assert np.all(MOVES[name]() > 0.0)


def test_satellite_clock_ahead_shortens_the_prediction() -> None:
    model, sine = np.empty((2, COUNT)), np.empty(COUNT)
    for out, clock_m in zip(model, (0.0, 250.0), strict=True):
        no_air = AirModel(np.zeros(8), np.zeros(COUNT), 0.0, STANDARD_WEATHER)
        clocks = np.full(COUNT, clock_m)
        base_ranges(LOG.t_ns, STATES.sat, clocks, RECEIVER, no_air, np.zeros(COUNT), out, sine)
    np.testing.assert_allclose(model[1] - model[0], -250.0, atol=1e-7)
    np.testing.assert_allclose(sine, -U_N[:, 2], atol=1e-5)


def test_relativity_is_that_of_the_broadcast_clock() -> None:
    """2 r.v / c against -2 sqrt(mu) / c^2 e sqrt(a) sin E of the message: 3 cm by the Earth's oblateness."""
    eph = NAVIGATION.ephemerides
    rows = STATES.message
    polynomial = C_MPS * (
        eph.af0[rows]
        + eph.af1[rows] * STATES.age_s
        + eph.af2[rows] * STATES.age_s**2
        - eph.group_delay_s[rows, 0]
    )
    np.testing.assert_allclose(polynomial - STATES.clock_m, relativity(), rtol=0, atol=0.03)


def test_every_module_of_the_list_exists_and_each_correction_has_sign_source_and_size() -> None:
    package = Path(insgnss.__file__).parent
    for term in CORRECTIONS:
        assert (package / (term.where.replace(".", "/") + ".py")).is_file()
        assert term.adds in ("+", "-", "in rho") and term.source and 0.0 <= term.size_m[0] < term.size_m[1]


def test_pressure_must_matter() -> None:
    low = delays(0.0, 1.0, pressure_hpa=975.0) - delays(0.0, 1.0)
    # 26 hPa less than the standard at 100 m: 6 cm at the zenith, times 1 / sin of the elevation
    assert np.all((low < -0.055) & (low > -0.4))


def test_wet_factor_is_the_derivative_by_the_residual_zenith_delay() -> None:
    air = np.zeros(1, AIR_DTYPE)
    evaluate_atmosphere(air[0], LAT, LON, H, WEEK_S, 1.0, STANDARD_WEATHER)
    for u in U_N:
        before = slant_delay(air[0], COEFFICIENTS, u, 0.0)
        factor = float(air[0].wet_factor)
        air[0].wet += 0.1
        assert slant_delay(air[0], COEFFICIENTS, u, 0.0) - before == pytest.approx(0.1 * factor, abs=1e-9)
        air[0].wet -= 0.1
        assert factor == pytest.approx(mapping_factors(LAT, H, math.asin(-u[2]))[1], rel=1e-12)
    evaluate_atmosphere(air[0], LAT, LON, H, WEEK_S, 0.0, STANDARD_WEATHER)
    slant_delay(air[0], COEFFICIENTS, U_N[0], 1.0)
    assert air[0].wet_factor == 0.0


def test_given_ionosphere_replaces_the_compiled_model_and_scales_with_the_carrier() -> None:
    air = np.zeros(1, AIR_DTYPE)
    evaluate_atmosphere(air[0], LAT, LON, H, WEEK_S, 0.0, STANDARD_WEATHER)
    assert slant_delay(air[0], COEFFICIENTS, U_N[0], 1.793, 4.0) == pytest.approx(1.793 * 4.0, rel=1e-12)
    assert slant_delay(air[0], COEFFICIENTS, U_N[0], 0.0, 4.0) == 0.0
    own = slant_delay(air[0], COEFFICIENTS, U_N[0], 1.0, math.nan)
    azimuth, elevation = math.atan2(U_N[0, 1], U_N[0, 0]), math.asin(-U_N[0, 2])
    place = ecef_to_geodetic(RECEIVER)
    assert own == pytest.approx(path_delay(COEFFICIENTS, place, azimuth, elevation, WEEK_S, 1.0, 0.0))
