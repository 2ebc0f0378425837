"""The Sun's place, the satellite's attitude, the antenna's offset."""

from __future__ import annotations

import math

import numpy as np
import pytest
import sidereon

from insgnss.constants import NS_PER_S
from insgnss.gnss.phase_centre import (
    SatelliteAntennas,
    body_axes,
    offsets_of,
    phase_centre_offsets,
    sun_position,
)
from insgnss.gpstime import UNIX_TO_GPS_S, leap_seconds, ns_to_datetime
from tests.gnss.precise_sample import ORBITS, START_NS

R_E = 1e3 * np.array(ORBITS["G20"])[:, :3]
T_NS = START_NS + np.arange(len(R_E)) * 900 * NS_PER_S


def antennas(offset_b: tuple[float, float, float]) -> SatelliteAntennas:
    whole = np.array([0]), np.array([2**62])
    return SatelliteAntennas(("G20",), *whole, np.array([offset_b]))


def test_sun_agrees_with_an_independent_implementation(rng: np.random.Generator) -> None:
    """0.01 deg of the series and 0.005 deg of what the sidereal time leaves out; 2000 to 2024."""
    for t_ns in rng.integers(630_763_213, 1_400_000_000, 100) * NS_PER_S:
        utc_s = t_ns // NS_PER_S + UNIX_TO_GPS_S - leap_seconds(ns_to_datetime(int(t_ns)))
        theirs = sidereon.sun_moon_ecef(np.array([utc_s * 1_000_000])).sun[0]
        ours = sun_position(np.array([t_ns]))[0]
        sine = np.linalg.norm(np.cross(ours, theirs)) / np.linalg.norm(ours) / np.linalg.norm(theirs)
        assert math.degrees(math.asin(sine)) < 0.015
        assert np.linalg.norm(ours) == pytest.approx(np.linalg.norm(theirs), rel=2e-4)
        assert ours @ theirs > 0.0


def test_sun_stands_over_greenwich_at_noon_of_an_equinox() -> None:
    """2023-03-20 21:24 UTC is the equinox; at 12:07:30 UTC the Sun's hour angle at Greenwich is zero."""
    t_ns = np.array([(2254 * 604_800 + 86_400 + 12 * 3600 + 7 * 60 + 30 + 18) * NS_PER_S])
    x, y, z = sun_position(t_ns)[0] / np.linalg.norm(sun_position(t_ns))
    assert abs(math.degrees(math.atan2(y, x))) < 0.1
    assert abs(math.degrees(math.asin(z)) - (-0.155)) < 0.02


def test_body_axes_are_a_rotation_with_z_down_and_x_to_the_sun() -> None:
    sun = sun_position(T_NS)
    C_eb = body_axes(R_E, sun)
    np.testing.assert_allclose(
        np.einsum("nij,nik->njk", C_eb, C_eb), np.broadcast_to(np.eye(3), (14, 3, 3)), atol=1e-14
    )
    np.testing.assert_allclose(np.linalg.det(C_eb), 1.0, atol=1e-14)
    np.testing.assert_allclose(C_eb[:, :, 2], -R_E / np.linalg.norm(R_E, axis=1)[:, None], atol=1e-15)
    towards = sun - R_E
    assert np.all(np.einsum("ni,ni->n", C_eb[:, :, 0], towards) > 0.0)
    np.testing.assert_allclose(np.einsum("ni,ni->n", C_eb[:, :, 1], towards), 0.0, atol=1e-3)


def test_offset_along_z_lowers_the_satellite_by_its_length() -> None:
    moved = R_E + phase_centre_offsets(antennas((0.0, 0.0, 1.154)), "G20", T_NS, R_E)
    np.testing.assert_allclose(
        np.linalg.norm(R_E, axis=1) - np.linalg.norm(moved, axis=1), 1.154, rtol=0, atol=1e-8
    )


def test_sideways_offset_keeps_the_height_and_its_own_length() -> None:
    offset = phase_centre_offsets(antennas((0.279, 0.1, 0.0)), "G20", T_NS, R_E)
    np.testing.assert_allclose(np.linalg.norm(offset, axis=1), math.hypot(0.279, 0.1), rtol=1e-12)
    np.testing.assert_allclose(np.einsum("ni,ni->n", offset, R_E) / 2.66e7, 0.0, atol=1e-9)


def test_antenna_counts_within_its_span_alone() -> None:
    spans = SatelliteAntennas(
        ("G20", "G20", "G05"),
        np.array([0, T_NS[5], 0]),
        np.array([T_NS[3], 2**62, 2**62]),
        np.array([[0, 0, 1.0], [0, 0, 2.0], [0, 0, 3.0]]),
    )
    offset_b, known = offsets_of(spans, "G20", T_NS)
    assert list(offset_b[:, 2]) == [1.0] * 4 + [0.0] + [2.0] * 9
    assert list(np.flatnonzero(~known)) == [4]
    assert np.all(phase_centre_offsets(spans, "R01", T_NS, R_E) == 0.0)
