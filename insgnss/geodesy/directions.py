"""Directions by azimuth and elevation, in north-east-down or forward-right-down axes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from insgnss.tables import Float64


def directions(azimuth_deg: npt.ArrayLike, elevation_deg: npt.ArrayLike) -> Float64:
    """Return unit vectors (..., 3) of azimuths and elevations [deg], which broadcast."""
    return unit_vectors(np.radians(azimuth_deg), np.radians(elevation_deg))


def unit_vectors(azimuth: npt.ArrayLike, elevation: npt.ArrayLike) -> Float64:
    """Return unit vectors (..., 3) of azimuths and elevations [rad], which broadcast.

    Equation: u = (cos e cos a, cos e sin a, -sin e)
    """
    a, e = np.broadcast_arrays(azimuth, elevation)
    level = np.cos(e)
    return np.stack([level * np.cos(a), level * np.sin(a), -np.sin(e)], axis=-1)


def angles_of(u: Float64) -> tuple[Float64, Float64]:
    """Return azimuth (-pi to pi) and elevation [rad] of vectors (..., 3) of any length."""
    x, y, z = np.moveaxis(u, -1, 0)
    return np.asarray(np.arctan2(y, x)), np.asarray(np.arctan2(-z, np.hypot(x, y)))


def angle_columns(u: Float64, prefix: str = "") -> dict[str, Float64]:
    """Return azimuth (0 to 360) and elevation [deg] of directions (n, 3) as columns of a table."""
    azimuth, elevation = angles_of(u)
    return {f"{prefix}az_deg": np.degrees(azimuth) % 360.0, f"{prefix}el_deg": np.degrees(elevation)}
