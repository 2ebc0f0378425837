"""Single-point solutions of a whole log, as a test of satellites, clocks, atmosphere and solution together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pymap3d

from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.geodesy.directions import angles_of
from insgnss.gnss.ionosphere import klobuchar_delay
from insgnss.gnss.least_squares import RANGE, RANGE_RATE, FitRows, free_clocks, workspace
from insgnss.gnss.line_of_sight import line_of_sight, line_of_sight_range
from insgnss.gnss.orbits.ephemeris_choice import broadcast_messages
from insgnss.gnss.orbits.satellite_state import glonass_channels, range_rates, satellite_states
from insgnss.gnss.point.integrity import (
    BAD_GEOMETRY,
    EXCLUDED,
    OK,
    TOO_FEW,
    UNTESTED,
    Fits,
    agree,
    redundancy_room,
)
from insgnss.gnss.signals import ionosphere_factor
from insgnss.runs.point import chi_square_limits
from insgnss.tables import Bool, EphemerisTable, Float64, GnssTable, NavigationData
from tests.gnss.troposphere import tropospheric_delay

RANGE_SIGMA_M = 2.0  # at the zenith
RATE_SIGMA_MPS = 0.1
_SOLVED, _NONE = (OK, EXCLUDED, UNTESTED), (TOO_FEW, BAD_GEOMETRY)


@dataclass(frozen=True)
class Solutions:
    """One row per solved epoch, and the residuals of all rows in use."""

    n_epochs: int
    r_e: Float64  # (m, 3)
    v_n: Float64  # (m, 3) north, east, down
    clock_m: Float64  # (m, groups)
    drift_mps: Float64  # (m,)
    excluded: int
    range_residual_m: Float64
    rate_residual_mps: Float64
    row: npt.NDArray[np.int64]  # of each range residual

    def ned(self, lat_deg: float, lon_deg: float, h_m: float) -> Float64:
        """Return positions relative to a point, north, east, down [m]."""
        return np.array(pymap3d.ecef2ned(*self.r_e.T, lat_deg, lon_deg, h_m)).T


def solve_log(
    log: GnssTable,
    nav: EphemerisTable | NavigationData,
    klobuchar: Float64 | None,
    codes: set[tuple[str, str]],
    mask_deg: float = 10.0,
) -> Solutions:
    """Solve every epoch with the given (system, code) pairs, ionosphere and troposphere corrected."""
    messages = broadcast_messages(nav)
    channels = glonass_channels(log, messages)
    states, rates = satellite_states(log, messages), range_rates(log, channels)
    systems = sorted({system for system, _ in codes})
    wanted = np.array(
        [(log.sv_names[a][0], log.signal_names[b]) in codes for a, b in zip(log.sv, log.signal, strict=True)]
    )
    wanted &= (states.status == 0) & np.isfinite(log.pseudorange_m)
    epochs: list[tuple[Float64, ...]] = []
    residuals: list[tuple[float, float, int]] = []
    excluded, times = 0, np.unique(log.t_ns)
    for t in times:
        index = np.flatnonzero((log.t_ns == t) & wanted)
        epoch = _Epoch(log, states.sat[index].copy(), index, systems, channels)
        epoch.ranges = log.pseudorange_m[index] + states.clock_m[index]
        x = epoch.solve(int(t), klobuchar, np.radians(mask_deg))
        if x is None:
            continue
        v = epoch.velocity(x[:3].copy(), rates[index] + states.drift_mps[index])
        if v is None:
            continue
        excluded += epoch.excluded
        residuals += epoch.residuals(x, v, rates[index] + states.drift_mps[index])
        epochs.append((x[:3], epoch.C_en.T @ v[:3], x[3:], v[3:]))
    columns = [np.array(column) for column in zip(*epochs, strict=True)]
    ranges, rate, row = np.array(residuals).T
    return Solutions(
        len(times),
        columns[0],
        columns[1],
        columns[2],
        columns[3][:, 0],
        excluded,
        ranges,
        rate,
        row.astype(int),
    )


def _verdict(rows: FitRows, use: Bool, start: Float64, x: Float64) -> int:
    """Return whether rows agree on a solution, written to ``x``; ``use`` keeps those in it."""
    n, p = len(use), len(x)
    fits = Fits(chi_square_limits(n, 1e-4), workspace(p), redundancy_room(n))
    return agree(rows, use, start, x, np.zeros((p, p)), fits)[0]


class _Epoch:
    """One epoch's rows and the corrections for where it was seen from."""

    def __init__(
        self,
        log: GnssTable,
        sat: Float64,
        index: npt.NDArray[np.int64],
        systems: list[str],
        channels: dict[str, int],
    ) -> None:
        self.sat, self.index = sat, index
        names = [log.sv_names[k] for k in log.sv[index]]
        self.group = np.array([systems.index(name[0]) for name in names], np.int64)
        self.n_groups = len(systems)
        codes = [log.signal_names[k] for k in log.signal[index]]
        self.factor = [
            ionosphere_factor(name[0], code, channels.get(name))
            for name, code in zip(names, codes, strict=True)
        ]
        self.ranges, self.corrected = np.zeros(len(index)), np.zeros(len(index))
        self.sigma = np.full(len(index), 15.0)
        self.use = np.ones(len(index), np.bool_)
        self.C_en = np.eye(3)
        self.excluded = 0

    def solve(self, t_ns: int, klobuchar: Float64 | None, mask: float) -> Float64 | None:
        """Return position and clocks: a first pass without atmosphere, then two with it."""
        n = 3 + self.n_groups
        x = np.zeros(n)
        self.corrected = self.ranges.copy()
        for _ in range(3):
            rows = FitRows(
                RANGE, self.sat, self.corrected, self.sigma, self.group, free_clocks(self.n_groups), x
            )
            verdict = _verdict(rows, self.use, np.append(x[:3], np.zeros(self.n_groups)), x)
            if verdict in _NONE:
                return None
            in_use = self.use.copy()
            offered = self._correct(t_ns, x[:3].copy(), klobuchar, mask)
            self.use = offered.copy()
        self.excluded = int((offered & ~in_use).sum())
        self.use = in_use
        return x if verdict in _SOLVED else None

    def _correct(
        self, t_ns: int, r_e: Float64, klobuchar: Float64 | None, mask: float
    ) -> npt.NDArray[np.bool_]:
        lat_deg, lon_deg, h = (float(value) for value in pymap3d.ecef2geodetic(*r_e))
        lat, lon = np.radians(lat_deg), np.radians(lon_deg)
        # C_ne has the axes of e, seen in n, as columns; as rows they make C_en
        self.C_en = np.array([pymap3d.ecef2nedv(*axis, lat_deg, lon_deg) for axis in np.eye(3)])
        u, visible = np.zeros(3), np.zeros(len(self.index), np.bool_)
        for k in range(len(self.index)):
            line_of_sight_range(self.sat, k, r_e, u)
            az, el = (float(angle) for angle in angles_of(self.C_en.T @ u))
            visible[k] = el > mask
            self.sigma[k] = RANGE_SIGMA_M / np.sin(max(el, 0.1))
            delay = tropospheric_delay(lat, h, el)
            if klobuchar is not None:
                week_s = (t_ns % NS_PER_WEEK) / NS_PER_S
                delay += self.factor[k] * klobuchar_delay(klobuchar, lat, lon, az, el, week_s)
            self.corrected[k] = self.ranges[k] - delay
        return visible

    def velocity(self, r_e: Float64, rates: Float64) -> Float64 | None:
        v, n = np.zeros(4), len(rates)
        sigma, one_clock = np.full(n, RATE_SIGMA_MPS), np.zeros(n, np.int64)
        rows = FitRows(RANGE_RATE, self.sat, rates, sigma, one_clock, free_clocks(1), r_e)
        return None if _verdict(rows, self.use.copy(), np.zeros(4), v) in _NONE else v

    def residuals(self, x: Float64, v: Float64, rates: Float64) -> list[tuple[float, float, int]]:
        """Return range residual, rate residual and row of the log for each row in use."""
        found, u, g = [], np.zeros(3), np.zeros(3)
        for k in np.flatnonzero(self.use):
            distance, rate = line_of_sight(self.sat, k, x[:3].copy(), v[:3].copy(), u, g)
            found.append(
                (
                    float(self.corrected[k] - distance - x[3 + self.group[k]]),
                    float(rates[k] - rate - v[3]),
                    int(self.index[k]),
                )
            )
        return found
