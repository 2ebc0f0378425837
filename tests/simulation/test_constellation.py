"""Simulated satellites: the file written is the truth, read alike by an independent implementation."""

from __future__ import annotations

import dataclasses
import datetime as dt
from pathlib import Path

import numpy as np
import pymap3d
import pytest
import sidereon

from insgnss.constants import NS_PER_S
from insgnss.gpstime import GPS_EPOCH, week_seconds_to_ns
from insgnss.simulation.constellation import satellite_states
from insgnss.simulation.rinex_nav import as_written, write_rinex_navigation
from insgnss.simulation.sample_trajectories import AIRFIELD
from insgnss.simulation.sky import PAPER_SKY, constellation_over, nominal_constellation
from insgnss.tables import EphemerisTable, NavigationData

START_NS = int(week_seconds_to_ns(2385, 293_700.0))
TOE_NS = int(week_seconds_to_ns(2385, 295_200.0))
J2000_S = (dt.datetime(2000, 1, 1, 12) - GPS_EPOCH).total_seconds()


@pytest.fixture(scope="module")
def paper() -> NavigationData:
    return constellation_over(AIRFIELD, PAPER_SKY, START_NS, 1200.0, TOE_NS)


def times(eph: EphemerisTable, *t_s: float) -> np.ndarray:
    return np.tile(np.array(t_s)[:, None], (1, len(eph.sv_names)))


def sky(navigation: NavigationData, t_s: float, place: tuple[float, float, float]) -> np.ndarray:
    """Return azimuth and elevation (n, 2) [deg] of the satellites from a place."""
    eph = navigation.ephemerides
    r = satellite_states(eph, START_NS, times(eph, t_s)).r_e[0]
    azimuth, elevation, _ = pymap3d.ecef2aer(r[:, 0], r[:, 1], r[:, 2], *place)
    return np.column_stack([azimuth, elevation])


@pytest.mark.parametrize("which", ["paper", "nominal"])
def test_the_file_gives_an_independent_reader_the_same_satellites(
    which: str, paper: NavigationData, tmp_path: Path
) -> None:
    navigation = paper if which == "paper" else nominal_constellation(TOE_NS)
    write_rinex_navigation(tmp_path / "nav.rnx", navigation, dt.datetime(2025, 9, 24))
    read = sidereon.load_rinex_nav(tmp_path / "nav.rnx")
    eph = navigation.ephemerides
    t = np.array([-3600.0, 0.0, 600.0, 1200.0, 5400.0])
    own = satellite_states(eph, START_NS, times(eph, *t))
    assert read.record_count == len(eph.sv_names)
    for k, name in enumerate(eph.sv_names):
        epochs = START_NS / NS_PER_S - J2000_S + t
        other = sidereon.observable_states_at_j2000_s(read, [name] * len(t), epochs)
        assert other.positions_ecef_m == pytest.approx(own.r_e[:, k], abs=1e-3)  # reached: 1e-7 m
        assert other.clocks_s == pytest.approx(own.clock_s[:, k], abs=1e-14)  # 3 um
        assert read.records[k].group_delay_s == eph.group_delay_s[k, 0]


def test_the_file_is_clean_and_its_header_complete(paper: NavigationData, tmp_path: Path) -> None:
    write_rinex_navigation(tmp_path / "nav.rnx", paper, dt.datetime(2025, 9, 24))
    text = (tmp_path / "nav.rnx").read_text()
    assert sidereon.lint_rinex_nav(text).findings == []
    read = sidereon.parse_rinex_nav(text)
    assert read.leap_seconds == 18
    assert sidereon.parse_rinex_iono_corrections(text).gps is not None
    assert max(len(line) for line in text.splitlines()) <= 80


def test_rounding_to_the_file_changes_nothing_the_second_time(paper: NavigationData) -> None:
    again = as_written(paper)
    for f in dataclasses.fields(EphemerisTable):
        assert np.array_equal(getattr(paper.ephemerides, f.name), getattr(again.ephemerides, f.name)), f.name


def test_no_term_of_the_orbit_is_zero(paper: NavigationData) -> None:
    optional = {"health", "fit_interval_s", "group_delay_s", "sv_names", "message"}
    for f in dataclasses.fields(EphemerisTable):
        if f.name not in optional:
            assert np.all(getattr(paper.ephemerides, f.name) != 0.0), f.name
    assert np.all(paper.ephemerides.group_delay_s[:, 0] != 0.0)


def test_velocity_and_clock_rate_are_derivatives(paper: NavigationData) -> None:
    eph, t, h = paper.ephemerides, np.array([0.0, 700.0, 1200.0]), 2.0
    before, at, after = (satellite_states(eph, START_NS, times(eph, *(t + d))) for d in (-h, 0.0, h))
    far_before, far_after = (satellite_states(eph, START_NS, times(eph, *(t + d))) for d in (-2 * h, 2 * h))
    slope = (8.0 * (after.r_e - before.r_e) - (far_after.r_e - far_before.r_e)) / (12.0 * h)
    assert np.max(np.abs(slope - at.v_e)) < 1e-7
    rate = (8.0 * (after.clock_s - before.clock_s) - (far_after.clock_s - far_before.clock_s)) / (12.0 * h)
    assert np.max(np.abs(rate - at.clock_rate)) < 1e-18


def test_the_satellites_stand_where_the_paper_has_them(paper: NavigationData) -> None:
    for t_s, moment, tolerance_deg in ((0.0, 0, 0.5), (1200.0, 1, 3.0)):
        for track, (azimuth, elevation) in zip(PAPER_SKY, sky(paper, t_s, AIRFIELD), strict=True):
            off = (azimuth - track.azimuth_deg[moment] + 180.0) % 360.0 - 180.0
            assert abs(off) * np.cos(np.deg2rad(elevation)) < tolerance_deg, track.number
            assert abs(elevation - track.elevation_deg[moment]) < tolerance_deg, track.number


def test_eleven_satellites_stay_above_five_degrees_for_twenty_minutes(paper: NavigationData) -> None:
    for t_s in np.arange(0.0, 1201.0, 60.0):
        assert np.all(sky(paper, t_s, AIRFIELD)[:, 1] > 5.0)


def test_the_nominal_constellation_fills_the_sky_everywhere() -> None:
    navigation = nominal_constellation(TOE_NS)
    for lat in (-90.0, -60.0, -30.0, 0.0, 30.0, 60.0, 90.0):
        for lon in (-150.0, -60.0, 30.0, 120.0):
            visible = np.count_nonzero(sky(navigation, 0.0, (lat, lon, 0.0))[:, 1] > 5.0)
            assert 8 <= visible <= 16
