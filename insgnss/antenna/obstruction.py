"""The airframe's obstructions of an antenna's sky: sectors and polygons in body axes, as a raster that a kernel reads.

An obstruction file (TOML) holds ``frame = "body_forward_right_down"``, ``source``, and any number of ``[[sector]]``
(``azimuth_deg`` from, clockwise to; ``elevation_deg`` from, to) and ``[[polygon]]`` (``corners_deg``, pairs of azimuth
and elevation joined by great circles; the inside is the part that lies within a hemisphere). Azimuth counts from
forward towards right, elevation upward, both seen from the antenna along the body's axes.

The raster has cells of 1 deg; each holds the angle from its centre to the nearest centre of the other kind, positive
where the sky is free. An edge is therefore off by up to 0.71 deg (half a cell's diagonal), the angle by up to 1 deg.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final, Literal

import numpy as np
from pydantic import Field, field_validator

from insgnss.antenna.installation import FARTHEST_DEG, N_AZIMUTHS, N_ELEVATIONS
from insgnss.config.quantities import Angle, Elevation
from insgnss.config.strict import StrictModel, load_toml
from insgnss.errors import ConfigError
from insgnss.geodesy.directions import angles_of, directions
from insgnss.tables import Bool, Float64, Int8

_WIDEST_POLYGON_DEG: Final = 85.0  # from its middle to a corner: beyond, which side is inside is not plain


class Sector(StrictModel):
    """A blocked rectangle of azimuth and elevation."""

    name: str = ""
    azimuth_deg: tuple[Angle, Angle] = Field(description="from, clockwise to; [0, 360] is all around")
    elevation_deg: tuple[Elevation, Elevation] = Field(description="from, to; -90 is straight down")

    @field_validator("azimuth_deg")
    @classmethod
    def _has_a_width(cls, azimuth: tuple[float, float]) -> tuple[float, float]:
        if azimuth[0] == azimuth[1]:
            raise ValueError("azimuth_deg has no width; [0, 360] is all around")
        return azimuth

    @field_validator("elevation_deg")
    @classmethod
    def _goes_up(cls, elevation: tuple[float, float]) -> tuple[float, float]:
        if not elevation[0] < elevation[1]:
            raise ValueError("elevation_deg goes from the lower to the higher one")
        return elevation


class Polygon(StrictModel):
    """A blocked polygon, its corners in order around it, joined by great circles."""

    name: str = ""
    corners_deg: tuple[tuple[Angle, Elevation], ...] = Field(
        min_length=3, description="pairs of azimuth and elevation"
    )

    @field_validator("corners_deg")
    @classmethod
    def _lies_within_a_hemisphere(
        cls, corners: tuple[tuple[float, float], ...]
    ) -> tuple[tuple[float, float], ...]:
        u = directions(*np.array(corners).T)
        middle = u.mean(axis=0)
        size = float(np.linalg.norm(middle))
        if size < 1e-6 or (u @ middle).min() < size * math.cos(math.radians(_WIDEST_POLYGON_DEG)):
            raise ValueError("the polygon is wider than a hemisphere: split it")
        return corners


Shape = Sector | Polygon


class Obstruction(StrictModel):
    """A whole obstruction file."""

    frame: Literal["body_forward_right_down"]
    source: str
    sector: tuple[Sector, ...] = ()
    polygon: tuple[Polygon, ...] = ()

    def shapes(self) -> list[Shape]:
        """Return the union of all obstructions."""
        return [*self.sector, *self.polygon]


def read_obstruction(path: Path) -> Obstruction:
    """Return the obstructions of a file.

    Raises
    ------
    MissingFileError : no such file
    ConfigError : an unknown key, an impossible sector or polygon, or one so small that it covers no cell
    """
    obstruction = load_toml(path, Obstruction)
    centres = cell_centres().reshape(-1, 3)
    for shape in obstruction.shapes():
        kind = type(shape).__name__.lower()
        if not is_inside(shape, centres).any():
            raise ConfigError(
                f"the {kind} '{shape.name}' covers no cell of one degree",
                file=path,
                key=kind,
                advice="widen it, or leave it out",
            )
    return obstruction


def is_inside(shape: Shape, u_b: Float64) -> Bool:
    """Return which directions (n, 3), body axes, a shape blocks: exact geometry."""
    return _in_sector(shape, u_b) if isinstance(shape, Sector) else _in_polygon(shape, u_b)


def _in_sector(sector: Sector, u_b: Float64) -> Bool:
    azimuth, elevation = np.degrees(angles_of(u_b))
    begin, end = sector.azimuth_deg
    width = (end - begin) % 360.0 or 360.0
    low, high = sector.elevation_deg
    return np.asarray(((azimuth - begin) % 360.0 <= width) & (elevation >= low) & (elevation <= high))


def _in_polygon(polygon: Polygon, u_b: Float64) -> Bool:
    """Return which directions lie inside, by the even-odd rule in the gnomonic projection about the middle.

    In this projection great circles are straight lines, so the plane's rule holds on the sphere.
    """
    corners = directions(*np.array(polygon.corners_deg).T)
    middle = corners.mean(axis=0)
    middle /= np.linalg.norm(middle)
    across = np.cross(middle, np.eye(3)[np.argmin(np.abs(middle))])
    across /= np.linalg.norm(across)
    axes = np.stack([across, np.cross(middle, across)])
    ahead = u_b @ middle > 1e-9
    x, y = (axes @ u_b[ahead].T) / (u_b[ahead] @ middle)
    px, py = (axes @ corners.T) / (corners @ middle)
    odd = np.zeros(x.size, np.bool_)
    for k in range(len(corners)):
        x0, y0, x1, y1 = px[k - 1], py[k - 1], px[k], py[k]
        crosses = (y0 > y) != (y1 > y)
        with np.errstate(divide="ignore", invalid="ignore"):
            odd ^= crosses & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
    inside = np.zeros(len(u_b), np.bool_)
    inside[ahead] = odd
    return inside


def cell_centres() -> Float64:
    """Return the directions (180, 360, 3) of the centres of the raster's cells."""
    return directions(np.arange(N_AZIMUTHS) + 0.5, np.arange(N_ELEVATIONS)[:, None] - 89.5)


def clearance_raster(obstruction: Obstruction | None) -> Int8:
    """Return the raster (180, 360): angle to the nearest cell of the other kind [deg], negative where blocked."""
    clearance = np.full(N_ELEVATIONS * N_AZIMUTHS, FARTHEST_DEG, np.int8)
    if obstruction is not None:
        from scipy.spatial import cKDTree  # late: a tenth of a second and 20 MiB that few flights need

        centres = cell_centres().reshape(-1, 3)
        blocked = np.zeros(len(centres), np.bool_)
        for shape in obstruction.shapes():
            blocked |= is_inside(shape, centres)
        clearance[blocked] = -FARTHEST_DEG
        if blocked.any() and not blocked.all():
            for own, sign in ((blocked, -1), (~blocked, 1)):
                chord, _ = cKDTree(centres[~own]).query(centres[own])
                angle = np.degrees(2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0)))
                # rounded up, so that no cell at an edge has zero: its sign marks the edge
                clearance[own] = sign * np.minimum(np.ceil(angle), FARTHEST_DEG).astype(np.int8)
    return clearance.reshape(N_ELEVATIONS, N_AZIMUTHS)
