"""The geoid of EGM96: how far mean sea level lies above the ellipsoid.

``egm96_15_minutes.xz`` beside this file is the published grid of 15 minutes of arc, in centimetres: second differences,
along longitude and latitude, of int16, packed by xz. EGM96 was made by NASA GSFC and NIMA (today NGA) [Lemoine et al.
1998, NASA/TP-1998-206861]; as a work of the US government it is in the public domain. The grid is theirs (WW15MGH), in
the form that PROJ distributes (egm96_15.gtx).
"""

from __future__ import annotations

import importlib.resources
import lzma
from functools import cache
from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.tables import Float64

_ROWS: Final = 721  # from 90 deg south to 90 deg north
_COLUMNS: Final = 1440  # from 180 deg west, eastwards
_PER_DEG: Final = 4
_EDGE: Final = 8  # nodes added around the grid: a cubic spline's coefficients depend on few neighbours
_M_PER_UNIT: Final = 0.01


def geoid_height(lat_deg: npt.ArrayLike, lon_deg: npt.ArrayLike) -> Float64:
    """Return the height of the geoid of EGM96 above the WGS-84 ellipsoid [m]: h_msl = h - geoid_height.

    Cubic splines through the grid of 15 minutes: within 0.004 m of the six test values that NGA published with it.
    Neglects: the model's own error, 0.5 to 1 m (1 sigma), more where it had few gravity data. National height systems
    differ from it by decimetres.

    Parameters
    ----------
    lat_deg, lon_deg : (n,) geodetic, WGS-84; longitude of any turn; NaN gives NaN
    """
    from scipy.ndimage import map_coordinates

    row = (np.asarray(lat_deg, np.float64) + 90.0) * _PER_DEG + _EDGE
    column = (np.asarray(lon_deg, np.float64) + 180.0) % 360.0 * _PER_DEG + _EDGE
    known = np.isfinite(row + column)
    height = np.full(row.shape, np.nan)
    height[known] = map_coordinates(_spline(), [row[known], column[known]], order=3, prefilter=False)
    return height


@cache
def _spline() -> Float64:
    """Return the coefficients of the spline through the grid [m], continued over the poles and around the Earth."""
    from scipy.ndimage import spline_filter

    packed = importlib.resources.files("insgnss.geodesy").joinpath("egm96_15_minutes.xz").read_bytes()
    steps = np.frombuffer(lzma.decompress(packed), "<i2").reshape(_ROWS, _COLUMNS).astype(np.int32)
    grid = _M_PER_UNIT * steps.cumsum(axis=0).cumsum(axis=1)
    # beyond a pole a meridian continues at the opposite longitude
    across = np.roll(grid, _COLUMNS // 2, axis=1)
    tall = np.vstack([across[_EDGE:0:-1], grid, across[-2 : -_EDGE - 2 : -1]])
    wide = np.hstack([tall[:, -_EDGE:], tall, tall[:, :_EDGE]])
    return np.asarray(spline_filter(wide, order=3), np.float64)
