"""What the airframe hides: exact geometry, its raster, and files that cannot be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insgnss.antenna.installation import clearance_at
from insgnss.antenna.obstruction import (
    Obstruction,
    Polygon,
    Sector,
    cell_centres,
    clearance_raster,
    directions,
    is_inside,
    read_obstruction,
)
from insgnss.errors import ConfigError, MissingFileError

TAIL = Sector(name="tail", azimuth_deg=(170.0, 190.0), elevation_deg=(-30.0, 25.0))
NOSE = Sector(name="nose", azimuth_deg=(350.0, 10.0), elevation_deg=(-90.0, -5.0))
WING = Polygon(name="wing", corners_deg=((80.0, -50.0), (70.0, 8.0), (95.0, 12.0), (110.0, -45.0)))
CROSS = Polygon(name="over the top", corners_deg=((0.0, 70.0), (90.0, 80.0), (180.0, 65.0), (270.0, 75.0)))
FILE = """\
frame = "body_forward_right_down"
source = "drawing 12"

[[sector]]
name = "tail"
azimuth_deg = [170.0, 190.0]
elevation_deg = [-30.0, 25.0]

[[polygon]]
name = "wing"
corners_deg = [[80.0, -50.0], [70.0, 8.0], [95.0, 12.0], [110.0, -45.0]]
"""
SHAPES = pytest.mark.parametrize("shape", [TAIL, NOSE, WING, CROSS], ids=lambda shape: shape.name)


def random_directions(n: int, seed: int = 5) -> np.ndarray:
    u = np.random.default_rng(seed).standard_normal((n, 3))
    return np.asarray(u / np.linalg.norm(u, axis=1, keepdims=True))


def winding(polygon: Polygon, u: np.ndarray) -> float:
    """Return by how much the corners go around a direction [rad]: 2 pi inside, 0 outside."""
    corners = directions(*np.array(polygon.corners_deg).T)
    flat = corners - np.outer(corners @ u, u)
    total = 0.0
    for a, b in zip(flat, np.roll(flat, -1, axis=0), strict=True):
        total += np.arctan2(u @ np.cross(a, b), a @ b)
    return abs(total)


@pytest.mark.parametrize(
    ("azimuth", "elevation", "blocked"),
    [(180, 0, True), (171, 24, True), (169, 0, False), (180, 26, False), (180, -31, False), (0, 0, False)],
)
def test_sector_blocks_between_its_bounds(azimuth: float, elevation: float, blocked: bool) -> None:
    assert is_inside(TAIL, directions(azimuth, elevation)[None])[0] == blocked


def test_sector_may_cross_the_seam() -> None:
    inside = is_inside(NOSE, directions([355.0, 5.0, 0.0, 20.0, 180.0], -20.0))

    assert inside.tolist() == [True, True, True, False, False]


def test_sector_all_around_blocks_every_azimuth() -> None:
    around = Sector(azimuth_deg=(0.0, 360.0), elevation_deg=(-90.0, 0.0))

    assert is_inside(around, directions(np.arange(0.0, 360.0, 9.0), -45.0)).all()


@pytest.mark.parametrize("polygon", [WING, CROSS], ids=["wing", "top"])
def test_polygon_is_what_its_great_circles_enclose(polygon: Polygon) -> None:
    u = random_directions(4000)
    u = u[u @ directions(*np.array(polygon.corners_deg).T).mean(axis=0) > 0.05]
    expected = np.array([winding(polygon, one) > np.pi for one in u])

    assert 10 < expected.sum() < len(u)
    np.testing.assert_array_equal(is_inside(polygon, u), expected)


def test_polygon_hides_nothing_behind() -> None:
    u = -directions(*np.array(WING.corners_deg).T).mean(axis=0)

    assert not is_inside(WING, (u / np.linalg.norm(u))[None]).any()


@SHAPES
def test_raster_is_the_exact_geometry_except_within_a_cell_of_an_edge(shape: Sector | Polygon) -> None:
    named = {"sector": (shape,)} if isinstance(shape, Sector) else {"polygon": (shape,)}
    raster = clearance_raster(Obstruction(frame="body_forward_right_down", source="test", **named))
    u = random_directions(20_000)
    hidden = np.array([clearance_at(raster[None], 0, *one) < 0.0 for one in u])
    wrong = np.flatnonzero(hidden != is_inside(shape, u))
    # sample the exact shape on a ring of the half diagonal of a cell, 0.71 deg, about each wrong direction
    for k in wrong:
        aside = np.cross(u[k], [0.3, 0.4, 0.866])
        aside /= np.linalg.norm(aside)
        ring = np.linspace(0.0, 2.0 * np.pi, 60)[:, None]
        offsets = np.cos(ring) * aside + np.sin(ring) * np.cross(u[k], aside)
        near = np.cos(np.radians(0.75)) * u[k] + np.sin(np.radians(0.75)) * offsets
        assert len(set(is_inside(shape, near))) == 2

    assert len(wrong) < 200
    assert hidden.any()


def test_clearance_is_the_angle_to_the_nearest_edge() -> None:
    cap = Sector(azimuth_deg=(0.0, 360.0), elevation_deg=(-90.0, 0.0))
    raster = clearance_raster(Obstruction(frame="body_forward_right_down", source="test", sector=(cap,)))
    for elevation in (-80.5, -10.5, 3.5, 45.5):
        found = np.degrees(clearance_at(raster[None], 0, *directions(33.3, elevation)))

        # from centre to centre, rounded up: half a cell and one degree
        assert found == pytest.approx(elevation, abs=1.5)
        assert np.sign(found) == np.sign(elevation)


def test_nothing_in_the_way_is_clear_everywhere_and_everything_is_nowhere() -> None:
    all_of_it = Sector(azimuth_deg=(0.0, 360.0), elevation_deg=(-90.0, 90.0))
    full = Obstruction(frame="body_forward_right_down", source="test", sector=(all_of_it,))

    assert (clearance_raster(None) == 127).all()
    assert (clearance_raster(full) == -127).all()
    assert cell_centres().shape == (180, 360, 3)


def test_file_gives_its_shapes(tmp_path: Path) -> None:
    path = tmp_path / "airframe.toml"
    path.write_text(FILE, encoding="utf-8")
    found = read_obstruction(path)

    assert found.sector == (TAIL,)
    assert found.polygon == (WING,)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("body_forward_right_down", "body_forward_left_up", "body_forward_right_down"),
        ("[-30.0, 25.0]", "[25.0, -30.0]", "lower to the higher"),
        ("[170.0, 190.0]", "[170.0, 170.0]", "no width"),
        ("[-30.0, 25.0]", "[-30.0, 95.0]", "less than or equal to 90"),
        ("[-30.0, 25.0]", "[20.0, 20.1]", "covers no cell"),
        ("[[80.0, -50.0], [70.0, 8.0], ", "[", "at least 3"),
        ("[80.0, -50.0]", "[300.0, -50.0]", "wider than a hemisphere"),
        ("azimuth_deg", "azimut_deg", "azimuth_deg"),
    ],
)
def test_wrong_file_is_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = tmp_path / "airframe.toml"
    path.write_text(FILE.replace(old, new), encoding="utf-8")

    with pytest.raises(ConfigError, match=words) as caught:
        read_obstruction(path)
    assert caught.value.file == str(path)


def test_missing_file_is_reported(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError):
        read_obstruction(tmp_path / "nothing.toml")
