"""What the air adds to the rows: its growth against the delays' own derivative, its signs, the columns of the rest."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from insgnss.config.filter import FilterConfig
from insgnss.config.library import filter_config
from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.filter.setup import FilterSetup
from insgnss.filter.state import N_CLONE, OFFSETS, Bank, new_bank
from insgnss.filter.update.epoch_space import new_epoch
from insgnss.filter.update.prior_rows import predict_measurements
from insgnss.geodesy.ellipsoid import ecef_to_geodetic
from insgnss.gnss.carrier_rows import CARRIER_DTYPE
from insgnss.gnss.ionosphere import shell_mapping
from insgnss.gnss.ionosphere_rows import ionosphere_growth
from insgnss.gnss.observation_rows import CARRIER, PSEUDORANGE, RANGE_RATE, GnssRows
from insgnss.gnss.range_model import path_delay
from insgnss.tables import Float64
from tests.filter.scene import (
    START_NS,
    TACTICAL,
    TCXO,
    Place,
    attitude,
    new_filter,
    parameters,
    place,
    rows_of,
    sky,
    steady_force,
)
from tests.jacobian import finite_difference_jacobian

KLOBUCHAR = np.array([1.1e-8, 1.5e-8, -6e-8, -1.2e-7, 9e4, 1.3e5, -6.5e4, -5.2e5])
L5 = (1575.42 / 1176.45) ** 2
WEEK_S = (START_NS % NS_PER_WEEK) / NS_PER_S
AT = place(47.0, 8.0, 2500.0)
ZENITH, IONOSPHERE, CLONE = OFFSETS, OFFSETS + 1, OFFSETS + 2
N = OFFSETS + 2 + N_CLONE
STEP_NS = 500_000_000
SKY_DEG = ((20, 30), (140, 45), (250, 6), (300, 75), (90, 15), (200, 60), (340, 12), (60, 50))


def climbing_filter(v_n: tuple[float, float, float]) -> Bank:
    """Return a filter whose clone is where the antenna was half a second ago, in the air of there."""
    small = new_filter(AT, v_n=v_n, C_eb=attitude(AT, 0.0, 0.0, 70.0), clock=(0.0, 0.0))
    bank = new_bank(1, 2 + N_CLONE)
    bank.state[0], bank.head[0] = small.state[0], small.head[0]
    bank.P[0] = np.eye(N)
    bank.P[0][:OFFSETS, :OFFSETS] = small.P[0]
    m = bank.state[0]
    m.r_clone[:] = m.r_e - 0.5 * m.v_e
    m.clone_ns = START_NS - STEP_NS
    at_clone = parameters(at_zenith_delay=ZENITH, use_troposphere=1.0)
    m.previous_zenith_delays[:] = air_at(m.r_clone, at_clone)
    return bank


def air_at(r_e: Float64, par: npt.NDArray[Any]) -> tuple[float, float]:
    """Return the zenith delays of the troposphere, dry and wet [m]."""
    from insgnss.gnss.troposphere import standard_atmosphere, zenith_delays

    lat, _, h = ecef_to_geodetic(r_e)
    weather = (float(par["pressure_0"][0]), float(par["temperature_0"][0]), float(par["humidity"][0]))
    return zenith_delays(lat, h, *standard_atmosphere(h, *weather))


def log_at(at: Place, factor: float) -> GnssRows:
    """Return an epoch of satellites, one of them at 6 deg, with carriers on the frequency of ``factor``."""
    sat = sky(at, SKY_DEG)
    log = rows_of([START_NS], sat)
    log.observation["ionosphere_factor"] = log.observation["phase_factor"] = factor
    before = log.sat.copy()
    before[:, :3] -= 0.5 * before[:, 3:6]
    carrier = np.zeros(len(before), CARRIER_DTYPE)
    return log._replace(
        carrier=carrier, before=before, before_ns=np.array([START_NS - STEP_NS]), klobuchar=KLOBUCHAR
    )


def numbers(ionosphere: float, troposphere: float, **changes: Any) -> npt.NDArray[Any]:
    """Return the filter's numbers with the air switched on or off."""
    return parameters(at_clone=CLONE, use_ionosphere=ionosphere, use_troposphere=troposphere, **changes)


def lines_of(bank: Bank, log: GnssRows, par: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the lines of the epoch held against the prior."""
    work = new_epoch(len(log.observation), N, CLONE)
    predict_measurements(
        bank.state[0], bank.P[0], par[0], log, 0, np.zeros(3), steady_force(bank.state[0]), work
    )
    return work.lines


def added(bank: Bank, log: GnssRows, ionosphere: float, troposphere: float) -> Float64:
    """Return (k, 3) what the air adds to the prediction of each kind."""
    empty = lines_of(bank, log, numbers(0.0, 0.0))["innovation"]
    return np.asarray(empty - lines_of(bank, log, numbers(ionosphere, troposphere))["innovation"])


def delays_at(bank: Bank, log: GnssRows, dt: float, factor: float, troposphere: float) -> Float64:
    """Return the path delays (k,) [m] where antenna and satellites are ``dt`` later, by the whole model anew."""
    m = bank.state[0]
    r_e = m.r_e + dt * m.v_e
    lat, lon, h = ecef_to_geodetic(r_e)
    there = place(np.degrees(lat), np.degrees(lon), h)
    found = []
    for row in log.sat:
        towards = row[:3] + dt * row[3:6] - r_e
        north, east, down = there.C_ne @ (towards / np.linalg.norm(towards))
        azimuth, elevation = float(np.arctan2(east, north)), float(np.arcsin(-down))
        found.append(
            path_delay(KLOBUCHAR, (lat, lon, h), azimuth, elevation, WEEK_S + dt, factor, troposphere)
        )
    return np.array(found)


@pytest.mark.parametrize("v_n", [(0.0, 0.0, 0.0), (0.0, 0.0, -30.0), (180.0, -170.0, 12.0)])
@pytest.mark.parametrize("factor", [1.0, L5])
def test_air_grows_in_rates_and_carriers_as_the_models_own_delays_do(
    v_n: tuple[float, float, float], factor: float
) -> None:
    bank, log = climbing_filter(v_n), log_at(AT, factor)
    ionosphere, troposphere = added(bank, log, 1.0, 0.0), added(bank, log, 0.0, 1.0)

    # signs: a code is delayed, its carrier advanced; the Doppler is the carrier's. The Earth's turn during the flight
    # (5e-6 rad in the line of sight) leaves 1e-4 of a delay at 6 deg
    for found, f, t, sign in ((ionosphere, factor, 0.0, -1.0), (troposphere, 0.0, 1.0, 1.0)):
        now, before = delays_at(bank, log, 0.0, f, t), delays_at(bank, log, -0.5, f, t)
        np.testing.assert_allclose(found[:, PSEUDORANGE], now, rtol=3e-4)
        np.testing.assert_allclose(found[:, CARRIER], sign * (now - before), atol=5e-6)
        slope = delays_at(bank, log, 0.01, f, t) - delays_at(bank, log, -0.01, f, t)
        # a quarter of a second of the models' bend, at 6 deg and 250 m/s
        np.testing.assert_allclose(found[:, RANGE_RATE], sign * slope / 0.02, atol=2e-4)
    assert np.abs(ionosphere[:, RANGE_RATE]).max() > 5e-4
    assert np.abs(troposphere[:, RANGE_RATE]).max() > 3e-3


def test_growth_computed_beforehand_stands_in_rate_and_carrier_with_the_carriers_sign() -> None:
    bank, log = climbing_filter((0.0, 0.0, 0.0)), log_at(AT, L5)
    log.observation["ionosphere_m"], log.observation["ionosphere_rate"] = 7.0, 2e-3

    found = added(bank, log, 1.0, 0.0)

    np.testing.assert_allclose(found[:, PSEUDORANGE], 7.0 * L5, rtol=1e-6)
    np.testing.assert_allclose(found[:, RANGE_RATE], -2e-3 * L5, rtol=1e-6)
    np.testing.assert_allclose(found[:, CARRIER], -1e-3 * L5, rtol=1e-4)


def test_combined_pseudorange_has_no_ionosphere_and_its_carrier_has() -> None:
    bank, log = climbing_filter((0.0, 0.0, 0.0)), log_at(AT, 1.0)
    whole = added(bank, log, 1.0, 0.0)
    log.observation["ionosphere_factor"] = 0.0

    found = added(bank, log, 1.0, 0.0)

    assert not found[:, PSEUDORANGE].any()
    assert np.array_equal(found[:, 1:], whole[:, 1:])


def test_end_of_the_models_day_is_no_step_of_the_rate() -> None:
    """Klobuchar's cosine ends 2 % of its height above the night: over that second the model of now goes on."""
    bank, log = climbing_filter((0.0, 0.0, 0.0)), log_at(AT, 1.0)
    seconds = np.arange(0, 86_400, 200)
    largest = 0.0
    for s in seconds:
        at_ns = START_NS + int(s) * NS_PER_S
        bank.state["clone_ns"] = at_ns - STEP_NS
        shifted = log._replace(epoch_ns=np.array([at_ns]), before_ns=np.array([at_ns - STEP_NS]))
        largest = max(largest, float(np.abs(added(bank, shifted, 1.0, 0.0)[:, RANGE_RATE]).max()))
    assert 1e-3 < largest < 2e-2


def test_columns_of_what_the_models_leave_equal_finite_differences() -> None:
    bank, log = climbing_filter((180.0, -170.0, 12.0)), log_at(AT, L5)
    par = numbers(1.0, 1.0, at_zenith_delay=ZENITH, at_ionosphere=IONOSPHERE)
    bank.state["optional"][0, :2] = 0.05, -0.7
    first = bank.state["optional"][0, :2].copy()

    def predicted(d: Float64) -> Float64:
        bank.state["optional"][0, :2] = first + d
        return -lines_of(bank, log, par)["innovation"].ravel()

    expected = finite_difference_jacobian(predicted, np.zeros(2), np.ones(2)).reshape(-1, 3, 2)
    bank.state["optional"][0, :2] = first
    lines = lines_of(bank, log, par)
    H = np.zeros((len(lines), 3, N))
    for j, line in enumerate(lines):
        for kind in (PSEUDORANGE, RANGE_RATE, CARRIER):
            count = line["count"][kind]
            H[j, kind, line["columns"][kind, :count]] = line["h"][kind, :count]

    # rounding of a range of 2.2e7 m; the states enter linearly
    assert np.max(np.abs(H[:, :, [ZENITH, IONOSPHERE]] - expected)) < 1e-7
    assert (np.abs(expected) > 1e-6).all()
    assert (expected[:, PSEUDORANGE, 1] > 0.0).all()


def test_shell_stretches_the_zenith_delay_as_published() -> None:
    """RTCA DO-229, A.4.4.10.4: 1 / sqrt(1 - (R cos E / (R + 350 km))^2), R = 6378.1363 km."""
    assert shell_mapping(1.0) == 1.0
    assert shell_mapping(np.sin(np.radians(30.0))) == pytest.approx(1.7514, abs=2e-4)
    assert shell_mapping(np.sin(np.radians(5.0))) == pytest.approx(3.041, abs=1e-3)


def test_growth_of_delays_given_beforehand_is_their_slope_within_each_arc() -> None:
    seconds = np.array([0, 0, 1, 2, 2, 3, 500, 501, 900])
    sv = np.array([0, 1, 0, 0, 1, 0, 0, 0, 0])
    delay = np.where(sv == 0, 5.0 + 2e-3 * seconds, 9.0 - 1e-3 * seconds)
    delay[6:] += 40.0
    gnss: Any = SimpleNamespace(t_ns=seconds * NS_PER_S, sv=sv)

    found = ionosphere_growth(gnss, delay)

    np.testing.assert_allclose(found[:8], np.where(sv == 0, 2e-3, -1e-3)[:8], rtol=1e-9)
    assert np.isnan(found[8])  # alone: nothing tells how it grows


@pytest.mark.parametrize(
    ("groups", "carrier", "changes", "wanted"),
    [
        (("G", "E"), True, {}, True),
        (("G", "E"), False, {}, False),
        (("G", "G:L5"), True, {}, False),
        (("G",), True, {"measurements": {"ionosphere": "ionosphere_free"}}, False),
        (("G",), True, {"process": {"ionosphere_sigma_m": 0.0, "imu_time_sigma_s": 0.0}}, False),
    ],
)
def test_ionosphere_is_a_state_where_carriers_of_one_band_show_it(
    groups: tuple[str, ...], carrier: bool, changes: dict[str, Any], wanted: bool
) -> None:
    settings = filter_config("tight17", {"process.imu_time_sigma_s": 0.0})
    config = FilterConfig.model_validate(settings.model_dump() | changes)

    layout = FilterSetup(config, TACTICAL, TCXO, clock_groups=groups, with_carrier=carrier).layout

    assert (layout.at("ionosphere") >= 0) == wanted
    assert layout.at("ionosphere") == (OFFSETS + len(groups) - 1 if wanted else -1)
    assert layout.n_values == len(groups) - 1 + wanted
