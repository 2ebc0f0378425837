"""Real logs through the whole chain: orbit, clock, atmosphere, line of sight, point solution."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from insgnss.gpstime import week_seconds_to_ns
from insgnss.log.rinex.navigation import read_navigation
from insgnss.log.rinex.observations import read_rinex_obs
from insgnss.tables import Float64, GnssTable, NavigationData
from tests.gnss.single_point import solve_log

pytestmark = pytest.mark.real_data
INSTINCT, INSTINCT_WEEK = "instinct_static_20230629", 2268
XIAN, XIAN_WEEK = "xian_psins_20211108", 2183
WALK, WALK_WEEK = "walk_boulder_20250828", 2381


def read_log(path: Path, week: int) -> GnssTable:
    frame = pd.read_csv(path)
    names, codes = sorted(frame["sv"].unique()), sorted(frame["signal"].unique())

    def column(name: str) -> Float64:
        return frame[name].to_numpy(dtype=np.float64, copy=True)

    return GnssTable(
        t_ns=week_seconds_to_ns(week, column("time_s")),
        sv=np.array([names.index(name) for name in frame["sv"]], np.int16),
        signal=np.array([codes.index(code) for code in frame["signal"]], np.int16),
        pseudorange_m=column("pseudorange_m"),
        doppler_hz=column("doppler_hz"),
        range_rate_mps=np.full(len(frame), np.nan),
        cn0_dbhz=column("cn0_dbhz"),
        sv_names=tuple(names),
        signal_names=tuple(codes),
    )


@pytest.fixture(scope="module")
def reach(data_root: Path) -> tuple[GnssTable, NavigationData]:
    """Return every fortieth epoch of the second receiver's log (u-blox, own antenna, a few metres from the first)."""
    folder = data_root / INSTINCT
    nav, _ = read_navigation([folder / "nav_reach_m2.rnx"])
    log, _ = read_rinex_obs([folder / "reach_m2_static_10min.23O.gz"])
    some = np.unique(log.t_ns)[::40]
    return log.take(np.flatnonzero(np.isin(log.t_ns, some))), nav


@pytest.fixture(scope="module")
def instinct(data_root: Path) -> tuple[GnssTable, NavigationData]:
    folder = data_root / INSTINCT
    nav, _ = read_navigation([folder / "nav_reach_m2.rnx"])
    return read_log(folder / "gnss_obs.csv", INSTINCT_WEEK), nav


def rms(values: Float64) -> float:
    return float(np.sqrt(np.mean(values**2)))


REFERENCE = (48.78066473, 9.17149599, 330.082)  # the receiver's own fix


def test_static_gps_fix_is_where_the_note_of_the_log_says(instinct: tuple[GnssTable, NavigationData]) -> None:
    """The note: fix minus the receiver's own N/E/D -3.4/1.1/7.5 m, by another program; 1 m for its other mask."""
    log, nav = instinct
    found = solve_log(log, nav.ephemerides, nav.klobuchar, {("G", "C1C")})
    assert len(found.r_e) == found.n_epochs == 166
    np.testing.assert_allclose(found.ned(*REFERENCE).mean(axis=0), [-3.4, 1.1, 7.5], rtol=0, atol=1.0)
    assert rms(found.range_residual_m) < 2.2
    assert rms(found.rate_residual_mps) < 0.03
    assert np.abs(found.v_n.mean(axis=0)).max() < 0.02
    assert found.v_n.std(axis=0).max() < 0.08
    assert found.excluded == 0


@pytest.mark.parametrize(("code", "limit_m"), [("C1C", 0.6), ("C7Q", 0.3)])
def test_galileo_on_either_frequency_fits_to_half_a_metre(
    instinct: tuple[GnssTable, NavigationData], code: str, limit_m: float
) -> None:
    log, nav = instinct
    found = solve_log(log, nav.ephemerides, nav.klobuchar, {("E", code)})
    assert len(found.r_e) == 166
    assert rms(found.range_residual_m) < limit_m
    np.testing.assert_allclose(found.ned(*REFERENCE).mean(axis=0), [-3.6, 0.3, 4.5], rtol=0, atol=1.5)


def test_two_constellations_share_one_position(instinct: tuple[GnssTable, NavigationData]) -> None:
    log, nav = instinct
    found = solve_log(log, nav.ephemerides, nav.klobuchar, {("G", "C1C"), ("E", "C1C")})
    assert len(found.r_e) == 166 and found.clock_m.shape == (166, 2)
    # the receiver's inter-system offset is constant
    assert (found.clock_m[:, 1] - found.clock_m[:, 0]).std() < 1.5
    np.testing.assert_allclose(found.ned(*REFERENCE).mean(axis=0), [-3.4, 1.1, 7.5], rtol=0, atol=1.0)


@pytest.mark.parametrize("what", ["group delay", "ionosphere"])
def test_what_is_left_out_shows_in_the_residuals(
    instinct: tuple[GnssTable, NavigationData], what: str
) -> None:
    log, nav = instinct
    table, klobuchar = nav.ephemerides, nav.klobuchar
    with_all = solve_log(log, table, klobuchar, {("G", "C1C")})
    if what == "group delay":
        table = replace(table, group_delay_s=np.zeros_like(table.group_delay_s))
    else:
        klobuchar = None
    without = solve_log(log, table, klobuchar, {("G", "C1C")})
    assert rms(without.range_residual_m) > 1.2 * rms(with_all.range_residual_m)


@pytest.mark.parametrize(("code", "limit_m"), [("C1C", 2.3), ("C2C", 2.1)])
def test_glonass_alone_gives_position_and_velocity(
    reach: tuple[GnssTable, NavigationData], code: str, limit_m: float
) -> None:
    """Each satellite's residual keeps the receiver's delay on its channel, up to 5 m with this receiver.

    What changes within 3 min is a fifth of it. A carrier of another channel would put 0.35 m/s for each 1000 m/s of
    range rate into the velocity's residuals, a leap second 1 km into the ranges'.
    """
    log, nav = reach
    found = solve_log(log, nav, nav.klobuchar, {("R", code)})
    assert len(found.r_e) == found.n_epochs == 16
    assert np.abs(found.ned(*REFERENCE).mean(axis=0)).max() < 3.0
    assert rms(found.range_residual_m) < limit_m
    assert rms(found.rate_residual_mps) < 0.05
    # 0.1 m/s of scatter upward, 16 epochs
    assert np.abs(found.v_n.mean(axis=0)).max() < 0.05
    names = np.array(log.sv_names)[log.sv[found.row]]
    within = [found.range_residual_m[names == sv].std() for sv in set(names)]
    assert np.median(within) < 0.5


def test_four_constellations_are_nearer_to_the_place_than_gps_alone(
    reach: tuple[GnssTable, NavigationData],
) -> None:
    log, nav = reach
    every = {("G", "C1C"), ("R", "C1C"), ("E", "C1X"), ("C", "C2I")}
    alone, together = (
        solve_log(log, nav, nav.klobuchar, codes).ned(*REFERENCE) for codes in ({("G", "C1C")}, every)
    )
    assert rms(together) < 0.75 * rms(alone)


def test_open_sky_drive_fits_to_a_third_of_a_metre(data_root: Path) -> None:
    """The note: residual rms 0.3 m, Doppler residual 0.01 to 0.02 m/s."""
    nav, _ = read_navigation([data_root / XIAN / "nav_from_mat.rnx"])
    log = read_log(data_root / XIAN / "gnss_obs.csv", XIAN_WEEK)
    found = solve_log(log, nav.ephemerides, nav.klobuchar, {("G", "C1C")})
    # one epoch of the 427 has four satellites in a bad geometry
    assert len(found.r_e) >= found.n_epochs - 1
    assert rms(found.range_residual_m) < 0.35
    assert rms(found.rate_residual_mps) < 0.035
    assert found.excluded == 0


def test_walk_with_gps_and_galileo_is_solved_at_every_epoch(data_root: Path) -> None:
    nav, _ = read_navigation([data_root / WALK / "nav_decoded_from_ubx.rnx"])
    log = read_log(data_root / WALK / "gnss_obs.csv", WALK_WEEK)
    found = solve_log(log, nav.ephemerides, nav.klobuchar, {("G", "C1C"), ("E", "C1C")})
    assert len(found.r_e) >= 0.98 * found.n_epochs
    reference = pd.read_csv(data_root / WALK / "reference.csv")
    start = reference.iloc[0]
    # the log starts at rest, with a constant offset of N 5.0, E 6.5, D -5 m that its note tells
    offset = found.ned(start.lat_deg, start.lon_deg, start.h_m)[:40].mean(axis=0)
    np.testing.assert_allclose(offset, [5.0, 6.5, -5.0], rtol=0, atol=3.0)
    assert rms(found.range_residual_m) < 1.5
