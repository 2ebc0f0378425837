"""The solution of a receiver, a phone or an autopilot: a reference, but not independent truth."""

from __future__ import annotations

from typing import Final

import numpy as np

from insgnss.geodesy.local_level import geodetic, ned_axes
from insgnss.tables import Bool, Event, Float64, Int64, ReferenceTable
from insgnss.units import RAD_PER_DEG

OWN_SOLUTION: Final = 2.0  # its quality: do not score tightly
FIX_3D: Final = 3  # kind of fix, as u-blox and PX4 number them
_LARGEST_SIGMA: Final = 1e6
_LARGEST_HEIGHT_M: Final = 1e8
_LEAST_RADIUS_M: Final = 1e6


def on_earth(place: Float64) -> Bool:
    """Return which places (n, 3), latitude, longitude [deg], height [m], can be: damaged bytes may give any number."""
    limits = np.array([90.0, 360.0, _LARGEST_HEIGHT_M])
    return np.asarray((np.abs(place) <= limits).all(axis=1))  # false for NaN


def from_earth_axes(r_e: Float64, v_e: Float64) -> tuple[Float64, Float64]:
    """Return places (n, 3), latitude, longitude [deg], height [m], and velocities (n, 3) north, east, down [m/s].

    Parameters
    ----------
    r_e, v_e : (n, 3) along the axes x, y, z of the Earth [m], [m/s]; a place far from the Earth's surface gives NaN
    """
    radius_m = np.linalg.norm(r_e, axis=1, keepdims=True)
    near = (radius_m > _LEAST_RADIUS_M) & (radius_m < _LARGEST_HEIGHT_M)
    place = geodetic(np.where(near, r_e, np.nan))
    return place / [RAD_PER_DEG, RAD_PER_DEG, 1.0], np.einsum("kij,kj->ki", ned_axes(place), v_e)


def distinct_rows(t_ns: Int64, good: Bool) -> Int64:
    """Return the good rows in the order of time, of those with the same time the first."""
    rows = np.flatnonzero(good)
    _, first = np.unique(t_ns[rows], return_index=True)
    return rows[first]


def stated_sigmas(sigma: Float64) -> Float64:
    """Return sigmas with NaN in place of those that are not stated."""
    return np.where(np.isfinite(sigma) & (sigma > 0.0) & (sigma < _LARGEST_SIGMA), sigma, np.nan)


def own_reference(
    t_ns: Int64,
    place: Float64,
    sigma: Float64 | None,
    *,
    velocity: Float64 | None = None,
    attitude: Float64 | None = None,
    quality: Float64 | None = None,
) -> ReferenceTable:
    """Return a solution's rows (n,) as a reference.

    Parameters
    ----------
    place : (n, 3) latitude, longitude [deg], height [m]
    sigma : (n, 9) as in ``ReferenceTable``
    velocity, attitude : (n, 3) north, east, down [m/s] and roll, pitch, yaw [deg]; NaN when None
    quality : (n,), ``OWN_SOLUTION`` when None
    """
    unknown = np.full(place.shape, np.nan)
    quality = np.full(len(place), OWN_SOLUTION) if quality is None else quality
    v_n, rpy_deg = (unknown if values is None else values for values in (velocity, attitude))
    lat_deg, lon_deg, h_m = place.T
    return ReferenceTable(t_ns, lat_deg, lon_deg, h_m, v_n, rpy_deg, quality, sigma)


def has_attitude(solution: ReferenceTable | None) -> bool:
    """Return whether a solution states its attitude in any row, as only filters with inertial data do."""
    return solution is not None and bool(np.isfinite(solution.rpy_deg).any())


def not_independent(what: str) -> Event:
    """Return the event that says what a reference of this kind is."""
    return Event(None, "reference_own", f"the reference is {what}: not independent truth")
