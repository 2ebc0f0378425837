"""Interpolation on the sphere: exact at the nodes, continuous everywhere, and its slope."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator
from scipy.spatial.transform import Rotation

from insgnss.antenna.gain_pattern import GainTable, gain_at, pattern_of
from insgnss.antenna.obstruction import directions
from insgnss.antenna.pattern_file import read_pattern
from insgnss.config.library import antenna_file
from tests.jacobian import finite_difference_jacobian


def lumpy(elevation: list[float], azimuth: list[float], seed: int = 3) -> GainTable:
    """Return a pattern of random gains, one value at each pole."""
    rng = np.random.default_rng(seed)
    gain = rng.uniform(-20.0, 5.0, (len(elevation), len(azimuth)))
    gain[0], gain[-1] = gain[0, 0], gain[-1, 0]
    return GainTable("lumpy", 1.6e9, "RHCP", "test", np.array(elevation), np.array(azimuth), gain)


EVEN = lumpy([-90.0, -60.0, -30.0, 0.0, 30.0, 60.0, 90.0], [float(a) for a in range(0, 360, 20)])
UNEVEN = lumpy([-90.0, -20.0, -0.1, 0.0, 15.0, 90.0], [0.0, 10.0, 25.0, 180.0, 300.0])


def gain(table: GainTable, azimuth_deg: float, elevation_deg: float) -> float:
    return gain_at(pattern_of([table]), 0, *directions(azimuth_deg, elevation_deg))[0]


@pytest.mark.parametrize("table", [EVEN, UNEVEN], ids=["even", "uneven"])
def test_gain_at_a_node_is_the_files(table: GainTable) -> None:
    pattern = pattern_of([table])
    found = [
        [gain_at(pattern, 0, *directions(a, e))[0] for a in table.azimuth_deg] for e in table.elevation_deg
    ]

    # 25 dB within 0.1 deg: rounding of the direction, 1e-15 rad, is 1e-11 dB
    np.testing.assert_allclose(found, table.gain_dbic, atol=1e-10)


@pytest.mark.parametrize("table", [EVEN, UNEVEN], ids=["even", "uneven"])
def test_gain_between_nodes_is_bilinear_as_an_independent_interpolator_has_it(table: GainTable) -> None:
    around = np.append(table.azimuth_deg, 360.0)
    oracle = RegularGridInterpolator(
        (table.elevation_deg, around), np.column_stack([table.gain_dbic, table.gain_dbic[:, 0]])
    )
    rng = np.random.default_rng(1)
    azimuth, elevation = rng.uniform(0.0, 360.0, 300), rng.uniform(-90.0, 90.0, 300)
    pattern = pattern_of([table])
    found = [gain_at(pattern, 0, *u)[0] for u in directions(azimuth, elevation)]

    np.testing.assert_allclose(found, oracle(np.column_stack([elevation, azimuth])), atol=1e-9)


def test_second_antennas_pattern_stands_behind_the_first() -> None:
    both = pattern_of([EVEN, UNEVEN])
    u = directions(77.0, 12.0)

    assert gain_at(both, 0, *u) == gain_at(pattern_of([EVEN]), 0, *u)
    assert gain_at(both, 1, *u) == gain_at(pattern_of([UNEVEN]), 0, *u)


@pytest.mark.parametrize("elevation", [-75.0, -0.05, 20.0, 89.0])
def test_gain_has_no_seam_where_azimuth_starts_anew(elevation: float) -> None:
    # a step of 1e-7 deg may change the gain by the slope, below 2 dB/deg
    assert gain(EVEN, -1e-7, elevation) == pytest.approx(gain(EVEN, 1e-7, elevation), abs=1e-6)
    assert gain(UNEVEN, 360.0 - 1e-7, elevation) == pytest.approx(gain(UNEVEN, 0.0, elevation), abs=1e-6)


@pytest.mark.parametrize("pole", [-90.0, 90.0])
def test_gain_has_no_jump_at_a_pole(pole: float) -> None:
    near = [gain(EVEN, azimuth, pole - np.sign(pole) * 1e-7) for azimuth in range(0, 360, 7)]

    np.testing.assert_allclose(near, EVEN.gain_dbic[-1 if pole > 0.0 else 0, 0], atol=1e-6)


def test_one_column_is_the_same_as_that_column_everywhere() -> None:
    column = read_pattern(antenna_file("choke_ring"))[0]
    table = GainTable(
        *("copy", 1.6e9, "RHCP", "test", column.elevation_deg, np.arange(0.0, 360.0, 30.0)),
        np.repeat(column.gain_dbic, 12, axis=1),
    )
    rng = np.random.default_rng(2)
    for u in directions(rng.uniform(0.0, 360.0, 50), rng.uniform(-90.0, 90.0, 50)):
        alone = gain_at(pattern_of([column]), 0, *u)
        np.testing.assert_allclose(alone, gain_at(pattern_of([table]), 0, *u), atol=1e-10)


@pytest.mark.parametrize("table", [EVEN, UNEVEN], ids=["even", "uneven"])
@pytest.mark.parametrize(
    ("azimuth", "elevation"), [(5.0, 41.0), (190.0, -47.0), (350.0, 5.0), (123.0, 89.5), (301.0, -89.0)]
)
def test_slope_by_a_rotation_of_the_body_is_the_finite_difference(
    table: GainTable, azimuth: float, elevation: float
) -> None:
    pattern, u = pattern_of([table]), directions(azimuth, elevation)

    def turned(phi: np.ndarray) -> float:
        # an attitude error phi of the body, C_eb_hat = C_eb (I + [phi x]), turns u_b by -phi x u_b
        return gain_at(pattern, 0, *Rotation.from_rotvec(-phi).apply(u))[0]

    by_rotation = np.cross(gain_at(pattern, 0, *u)[1:], u)
    numeric = finite_difference_jacobian(turned, np.zeros(3), 1e-5)

    # second derivative up to 1e3 dB/rad^2 half a degree from the pole, times the extrapolation's step^4
    np.testing.assert_allclose(by_rotation, numeric[0], rtol=1e-6, atol=1e-5)


def test_slope_lies_in_the_tangent_plane_and_is_finite_at_a_pole() -> None:
    pattern = pattern_of([EVEN])
    for u in (*directions([0.0, 45.0, 200.0], [30.0, -60.0, 89.9]), np.array([0.0, 0.0, -1.0])):
        slope = np.array(gain_at(pattern, 0, *u)[1:])

        assert np.isfinite(slope).all()
        assert slope @ u == pytest.approx(0.0, abs=1e-9 * np.linalg.norm(slope) + 1e-12)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("axis", range(3))
def test_direction_that_is_no_number_has_no_gain_and_no_slope(bad: float, axis: int) -> None:
    """The file's last row is beside other memory: an index made of NaN once read from there."""
    direction = [0.6, 0.0, -0.8]
    direction[axis] = bad
    found = gain_at(pattern_of([EVEN, UNEVEN]), 1, *direction)

    azimuth_is_known = not np.isnan(bad)  # of an infinite component: a direction along it
    assert np.isnan(found[0]) or azimuth_is_known
    if np.isnan(bad):
        assert found[1:] == (0.0, 0.0, 0.0)
