"""A Septentrio receiver's own solution: INSNavGeod with its inertial sensor, else fixes of satellites, and AttEuler.

AsteRx SBi reference guide. INSNavGeod has a fixed part, then position sigmas, attitude, its sigmas, velocity and its
sigmas, of which ``SBList`` names those that follow; angles of the attitude in degrees, heading clockwise from north.

PVTGeodetic (else PVTCartesian) states the fixes, of quality 2: angles in rad, velocity north, east, up. Sigmas are
those of the covariances of the same time. Where they are not logged, those of the place are half of the accuracies that
PVTGeodetic states from its revision 2 on: twice the rms of the distance across, twice the sigma of the height.
PVTCartesian, PosCovCartesian and VelCovCartesian state the same numbers along the axes x, y, z of the Earth.

AttEuler is the attitude from several antennas (PolaRx5 reference guide): heading clockwise from north, pitch and roll
in degrees; bits 0 and 1 of the error are of the baseline to the first auxiliary antenna, bit 7 says that no attitude
was asked for. AttCovEuler has the variances in deg^2.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from insgnss.geodesy.local_level import ecef_to_ned_matrix
from insgnss.log.events import counted
from insgnss.log.files import records
from insgnss.log.further_samples import HEADING, FurtherSamples, further_samples
from insgnss.log.own_solution import distinct_rows, from_earth_axes, on_earth, own_reference, stated_sigmas
from insgnss.log.sbf.blocks import (
    ATTITUDE,
    ATTITUDE_COV,
    FLOAT_MISSING,
    HEADER_LENGTH,
    INS_NAV,
    LAYOUTS,
    POS_COV,
    POS_COV_ECEF,
    PVT,
    PVT_ECEF,
    VEL_COV,
    VEL_COV_ECEF,
    Blocks,
    block_length,
    block_records,
    block_times_ns,
    time_known,
)
from insgnss.tables import Bool, Event, Float64, Int64, ReferenceTable
from insgnss.units import RAD_PER_DEG

_TRIPLE: Final = np.dtype([("value", "<f4", (3,))])
# Sub-blocks in the order of their bits in SBList
_POSITION_SD, _ATTITUDE, _ATTITUDE_SD, _VELOCITY, _VELOCITY_SD = range(5)
_N_PARTS: Final = 5


def solution(data: bytes, blocks: Blocks) -> tuple[ReferenceTable | None, list[Event]]:
    """Return the receiver's solution, None when the file has none; rows in error or without a place are counted."""
    heads = block_records(data, blocks, INS_NAV)
    if not len(heads):
        return None, []
    place, rows, events = solved_rows(heads, True, "INSNavGeod block(s) without a solution")
    if len(rows) < 2:
        return None, events
    parts = _parts(data, np.array(blocks.starts[INS_NAV], np.int64)[rows], heads[rows])
    # the receiver's order: latitude, longitude, height; east, north, up; heading, pitch, roll
    velocity = parts[_VELOCITY][:, [1, 0, 2]] * [1.0, 1.0, -1.0]
    attitude = parts[_ATTITUDE][:, ::-1]
    sigma = np.column_stack(
        [parts[_POSITION_SD], parts[_VELOCITY_SD][:, [1, 0, 2]], parts[_ATTITUDE_SD][:, ::-1]]
    )
    t_ns, quality = block_times_ns(heads[rows]), np.ones(len(rows))
    table = own_reference(t_ns, place[rows], sigma, velocity=velocity, attitude=attitude, quality=quality)
    return table, events


def solved_rows(
    rows: npt.NDArray[np.void], usable: Bool | bool, lost: str
) -> tuple[Float64, Int64, list[Event]]:
    """Return places (n, 3) of a receiver's solutions [deg, deg, m], the rows to take, and an event for the others.

    Parameters
    ----------
    usable : which may be taken, if they have a time, no error and a place
    lost : what the others are
    """
    place = np.column_stack([rows["lat_rad"] / RAD_PER_DEG, rows["lon_rad"] / RAD_PER_DEG, rows["h_m"]])
    good = time_known(rows) & (rows["error"] == 0) & on_earth(place) & usable
    events = counted("sbf_no_solution", ~good, f"{lost} left out")
    return place, distinct_rows(block_times_ns(rows), good), events


def _parts(data: bytes, starts: Int64, heads: npt.NDArray[np.void]) -> list[Float64]:
    """Return the five sub-blocks (n, 3) of each block, NaN where it has not sent one."""
    listed = heads["parts"].astype(np.int64)
    size = _TRIPLE.itemsize
    at = starts + HEADER_LENGTH + LAYOUTS[INS_NAV].itemsize
    ends = starts + np.array([block_length(data, start) for start in starts.tolist()], np.int64)
    parts = []
    for part in range(_N_PARTS):
        present = (listed >> part & 1 != 0) & (at + size <= ends)
        values = np.full((len(starts), 3), np.nan)
        stated = records(data, at[present].tolist(), _TRIPLE)["value"].astype(np.float64)
        values[present] = np.where(stated > FLOAT_MISSING, stated, np.nan)
        parts.append(values)
        at = at + size * (listed >> part & 1)
    return parts


_MODE_MASK, _FIX_2D = 0x0F, 0x80  # of the byte that names the kind of solution
_ACCURACIES: Final = np.dtype([("cm", "<u2", (2,))])  # across, height
_ACCURACIES_AT: Final = 90  # byte of the block
_NOT_STATED: Final = 65_534  # larger, or not known
_M_PER_CM: Final = 0.01
_UP: Final = np.array([1.0, 1.0, -1.0])
_NAMES: Final = {PVT: "PVTGeodetic", PVT_ECEF: "PVTCartesian"}
# in both forms of a block
_SHARED: Final = ("tow_ms", "week", "mode", "error")
# of PVTGeodetic, of PVTCartesian: for the place, for the velocity
_COVARIANCES: Final = {PVT: (POS_COV, VEL_COV), PVT_ECEF: (POS_COV_ECEF, VEL_COV_ECEF)}


def name_of_fixes(blocks: Blocks) -> str:
    """Return the names of the blocks that hold the fixes."""
    return _NAMES[_kind_of_fixes(blocks)]


def _kind_of_fixes(blocks: Blocks) -> int:
    return PVT if blocks.starts.get(PVT) else PVT_ECEF


def fixes(data: bytes, blocks: Blocks) -> tuple[ReferenceTable | None, list[Event]]:
    """Return the fixes in three dimensions, None with less than two; the other blocks are counted."""
    kind = _kind_of_fixes(blocks)
    rows = block_records(data, blocks, kind)
    if not len(rows):
        return None, []
    if kind == PVT_ECEF:
        rows = _geodetic(rows)
    in_space = (rows["mode"] & _MODE_MASK > 0) & (rows["mode"] & _FIX_2D == 0)
    what = f"{_NAMES[kind]} block(s) without a fix in three dimensions"
    place, chosen, events = solved_rows(rows, in_space, what)
    if len(chosen) < 2:
        return None, events
    t_ns = block_times_ns(rows[chosen])
    sigma = np.full((len(chosen), 9), np.nan)
    for number, columns in zip(_COVARIANCES[kind], (slice(0, 3), slice(3, 6)), strict=True):
        covariances = block_records(data, blocks, number)
        if kind == PVT_ECEF:
            covariances = _along_north_east_up(covariances, t_ns, place[chosen])
        sigma[:, columns] = _sigmas(covariances, t_ns)
    stated = _accuracies(data, np.array(blocks.starts[kind], np.int64)[chosen])
    sigma[:, :3] = np.where(np.isnan(sigma[:, :3]), stated, sigma[:, :3])
    velocity = rows["v_neu"][chosen].astype(np.float64)
    velocity = np.where(velocity > FLOAT_MISSING, velocity, np.nan) * _UP
    return own_reference(t_ns, place[chosen], sigma, velocity=velocity), events


def _geodetic(rows: Any) -> Any:
    """Return blocks of PVTCartesian (n,) as those of PVTGeodetic; an impossible place becomes NaN."""
    turned = _as_block(rows, PVT)
    v_e = rows["v_mps"].astype(np.float64)
    v_e[(v_e <= FLOAT_MISSING).any(axis=1)] = np.nan
    place, velocity = from_earth_axes(rows["r_m"].astype(np.float64), v_e)
    turned["lat_rad"], turned["lon_rad"], turned["h_m"] = (place * [RAD_PER_DEG, RAD_PER_DEG, 1.0]).T
    turned["v_neu"] = velocity * _UP
    return turned


def _along_north_east_up(rows: Any, at_ns: Int64, place: Float64) -> Any:
    """Return Cartesian covariances (n,) as variances north, east, up at the places (m, 3) of the fixes."""
    turned = _as_block(rows, POS_COV)
    place_of = dict(zip(at_ns.tolist(), place.tolist(), strict=True))
    C_ne = np.empty((3, 3))
    for k, t_ns in enumerate(block_times_ns(rows).tolist()):
        if t_ns not in place_of:
            continue
        lat_deg, lon_deg, _ = place_of[t_ns]
        ecef_to_ned_matrix(lat_deg * RAD_PER_DEG, lon_deg * RAD_PER_DEG, C_ne)
        xx, yy, zz, _, xy, xz, _, yz, _, _ = rows["covariance"][k].astype(np.float64)
        turned["variance"][k] = np.diag(C_ne @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ C_ne.T)
    return turned


def _as_block(rows: Any, number: int) -> Any:
    """Return blocks (n,) of another number with the time, mode and error of ``rows``, the rest zero."""
    blocks = np.zeros(len(rows), LAYOUTS[number])
    for name in _SHARED:
        blocks[name] = rows[name]
    return blocks


def _sigmas(rows: Any, at_ns: Int64) -> Float64:
    """Return the roots (n, 3) of the variances at given times, NaN where no block states them."""
    rows = rows[time_known(rows) & (rows["error"] == 0)]
    sigma = np.full((len(at_ns), 3), np.nan)
    t_ns = block_times_ns(rows)
    distinct = distinct_rows(t_ns, np.ones(len(rows), bool))
    _, here, there = np.intersect1d(at_ns, t_ns[distinct], assume_unique=True, return_indices=True)
    variance = rows["variance"][distinct][there].astype(np.float64)
    sigma[here] = stated_sigmas(np.sqrt(np.where(variance > 0.0, variance, np.nan)))
    return sigma


def _accuracies(data: bytes, starts: Int64) -> Float64:
    """Return the sigmas (n, 3) of the place by the accuracies of its block, NaN where it has none."""
    end = _ACCURACIES_AT + _ACCURACIES.itemsize
    long_enough = np.array([block_length(data, start) >= end for start in starts.tolist()], bool)
    sigma = np.full((len(starts), 3), np.nan)
    stated = records(data, (starts[long_enough] + _ACCURACIES_AT).tolist(), _ACCURACIES)["cm"].astype(float)
    stated = np.where(stated < _NOT_STATED, stated * _M_PER_CM / 2.0, np.nan)
    sigma[long_enough] = stated[:, [0, 0, 1]] / [math.sqrt(2.0), math.sqrt(2.0), 1.0]
    return stated_sigmas(sigma)


_FIXED: Final = (2, 4)  # modes with fixed ambiguities: heading and pitch; with roll
_NO_HEADING: Final = 0b1000_0011  # bits of the error


def headings(data: bytes, blocks: Blocks) -> tuple[list[FurtherSamples], list[Event]]:
    """Return the headings with fixed ambiguities and their sigmas, and an event that counts the others.

    The list is empty if there is none. A heading without an AttCovEuler of its time has no sigma.
    """
    rows = block_records(data, blocks, ATTITUDE)
    if not len(rows):
        return [], []
    usable = time_known(rows) & np.isin(rows["mode"], _FIXED) & (rows["error"] & _NO_HEADING == 0)
    usable &= rows["heading_deg"] > FLOAT_MISSING
    what = "AttEuler block(s) without a heading by fixed ambiguities left out"
    events = counted("sbf_no_heading", ~usable, what)
    rows = rows[usable]
    t_ns = block_times_ns(rows)
    covariances = block_records(data, blocks, ATTITUDE_COV)
    stated = covariances[time_known(covariances) & (covariances["variance"][:, 0] > 0.0)]
    _, here, there = np.intersect1d(t_ns, block_times_ns(stated), return_indices=True)
    sigma_deg = np.full(len(rows), np.nan)
    sigma_deg[here] = np.sqrt(stated["variance"][there, 0])
    values = np.column_stack([rows["heading_deg"].astype(np.float64), sigma_deg])
    samples, left_out = further_samples(HEADING, "AttEuler", t_ns, values)
    return samples, events + left_out
