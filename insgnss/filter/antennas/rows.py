"""Carrier phase differences between antennas: those of an epoch, their prediction by an attitude, their common noise.

    lambda (phi_b - phi_a) = -u^T C_eb (l_b - l_a) + clock_b - clock_a + lambda N + noise

A satellite's differences all count from the first antenna that has it, so one that the main antenna does not see is
used between the others. The position falls out but for the curvature of the wave, l^2 / (2 R), 1e-6 m for 10 m.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from insgnss.attitude.cycle_search import clock_columns
from insgnss.attitude.wind_up import wind_up_differences
from insgnss.constants import C_MPS, NS_PER_S, WGS84_OMEGA_RADPS
from insgnss.filter.antennas.memory import Key
from insgnss.filter.parameters import Parameters
from insgnss.filter.receiver_time import turn_by_imu_time
from insgnss.filter.state import PSI, StateRecord
from insgnss.gnss.antenna_phases import AntennaPhases, Channel
from insgnss.gnss.noise_model import LOWEST_SINE, thermal_factor
from insgnss.gnss.observation_rows import MOST_CN0_DBHZ
from insgnss.tables import Bool, Float64, Int64

_ASSUMED_CN0_DBHZ: Final = 42.0  # where the log gives none
# A reflection without the direct signal has any phase: the variance of an even distribution over a cycle
_HIDDEN_CYCLES2: Final = 1.0 / 12.0


@dataclass(frozen=True)
class Antennas:
    """The vehicle's antennas as the differences need them, the main one first."""

    names: tuple[str, ...]
    lever_b: Float64  # (M, 3) from any one point of the body [m]
    delay_m: Float64  # (M,) of the cables, beyond the main antenna's
    C_ba: Float64  # (M, 3, 3) antenna axes to body axes
    separate_clocks: bool
    phase_sigma_m: float
    multipath_sigma_m: float
    phase_floor_m: float = 0.0
    phase_elevation_m: float = 0.0

    @cached_property
    def winds_up(self) -> bool:
        """Whether the antennas are tilted against each other."""
        return not bool(np.allclose(self.C_ba, self.C_ba[0], rtol=0.0, atol=1e-9))

    def reordered(self, order: tuple[int, ...]) -> Antennas:
        """Return the antennas with the cables of others: the log of antenna i is that of antenna ``order[i]``."""
        names = tuple(self.names[i] for i in order)
        return replace(self, names=names, lever_b=self.lever_b[list(order)], C_ba=self.C_ba[list(order)])


@dataclass(frozen=True)
class Differences:
    """The R differences of an epoch."""

    a: Int64  # (R,) antenna each counts from
    b: Int64  # (R,) antenna of the difference
    channel: Int64  # (R,) satellite and signal
    row: Int64  # (R,) row of the phases of antenna b
    other: Int64  # (R,) row of antenna a
    value_m: Float64  # (R,) wavelength times phase difference, at the moment of antenna a's epoch
    wavelength_m: Float64  # (R,)
    u_e: Float64  # (R, 3) unit vectors, receiver to satellite, ECEF at reception
    white: Float64  # (R, R) covariance of the noise of each epoch [m^2]
    slow: Float64  # (R, R) covariance of reflections, constant from epoch to epoch [m^2]
    clock: Int64  # (R,) number of the unknown clock difference in each, -1 with a common clock
    names: tuple[Channel, ...]  # of each channel

    @cached_property
    def keys(self) -> list[Key]:
        """What whole cycles belong to."""
        channels = [self.names[channel] for channel in self.channel]
        return list(zip(self.a.tolist(), self.b.tolist(), channels, strict=True))

    def only(self, kept: Bool) -> Differences:
        """Return the marked differences."""
        square = np.ix_(kept, kept)
        return Differences(
            *(self.a[kept], self.b[kept], self.channel[kept], self.row[kept], self.other[kept]),
            *(self.value_m[kept], self.wavelength_m[kept], self.u_e[kept]),
            *(self.white[square], self.slow[square]),
            *(self.clock[kept], self.names),
        )


def directions(sat: Float64, r_e: Float64) -> Float64:
    """Return unit vectors (n, 3) from ``r_e`` to satellites (n, >= 3), in ECEF axes at reception.

    Equation: as ``gnss.line_of_sight``; the Earth's turn over the flight time moves the satellite by omega tau.
    """
    path = sat[:, :3] - r_e
    angle = WGS84_OMEGA_RADPS / C_MPS * np.linalg.norm(path, axis=1)
    path[:, 0] += angle * sat[:, 1]
    path[:, 1] -= angle * sat[:, 0]
    return np.asarray(path / np.linalg.norm(path, axis=1, keepdims=True))


def form_differences(
    phases: AntennaPhases,
    kept: Int64,
    antennas: Antennas,
    r_e: Float64,
    v_e: Float64,
    doubt: Float64 | None = None,
) -> Differences:
    """Return the differences of the rows ``kept`` of one epoch, those of one antenna together, in its order.

    Clocks of their own shift the receivers' moments against each other: the difference is brought to one moment by the
    satellites' range rates, the shift taken from tags and pseudoranges (3 ns of it are 3 micrometres).

    Parameters
    ----------
    kept : rows of the phases, in ascending order
    doubt : of each of them the probability that its antenna does not see the satellite; zero when None
    """
    seen = kept[np.lexsort((phases.antenna[kept], phases.channel[kept]))]
    channel = phases.channel[seen]
    begins = np.ones(len(seen), np.bool_)
    begins[1:] = channel[1:] != channel[:-1]
    leader = seen[begins][np.cumsum(begins) - 1]
    pairs = np.flatnonzero(seen != leader)
    order = pairs[np.lexsort((channel[pairs], phases.antenna[seen[pairs]]))]
    row, other = seen[order], leader[order]
    a, b = phases.antenna[other].astype(np.int64), phases.antenna[row].astype(np.int64)
    u_e = directions(phases.sat[row], r_e)
    value = phases.phase_m[row] - phases.phase_m[other] - (antennas.delay_m[b] - antennas.delay_m[a])
    rate = np.sum(u_e * (phases.sat[row, 3:6] - v_e), axis=1)
    value = value - rate * _moments_apart(phases, row, other, a, b, antennas.separate_clocks)
    sine = np.maximum(u_e @ (r_e / np.linalg.norm(r_e)), LOWEST_SINE)
    doubts = [np.zeros(len(row))] * 2
    if doubt is not None:
        doubts = [doubt[np.searchsorted(kept, rows)] for rows in (row, other)]
    white, slow = _covariances(phases, (row, other), antennas, sine, doubts)
    clock = (
        _clock_numbers(a, b, phases.wavelength_m[row]) if antennas.separate_clocks else np.full(len(row), -1)
    )
    return Differences(
        *(a, b, phases.channel[row], row, other, value, phases.wavelength_m[row], u_e, white, slow, clock),
        phases.names,
    )


def _moments_apart(
    phases: AntennaPhases, row: Int64, other: Int64, a: Int64, b: Int64, separate: bool
) -> Float64:
    """Return how much later antenna b measured than antenna a, (R,) [s]: tags less clocks."""
    late = (phases.t_ns[row] - phases.t_ns[other]) / NS_PER_S
    if not separate:
        return np.asarray(late)
    codes = phases.code_m[row] - phases.code_m[other]
    for i, j in {*zip(a.tolist(), b.tolist(), strict=True)}:
        own = (a == i) & (b == j) & np.isfinite(codes)
        if own.any():
            late[(a == i) & (b == j)] -= np.median(codes[own]) / C_MPS
    return np.asarray(late)


def _clock_numbers(a: Int64, b: Int64, wavelength_m: Float64) -> Int64:
    """Return a number for each pair of antennas and carrier: a clock difference is whole cycles of one carrier only."""
    keys = np.stack([a, b, np.rint(wavelength_m * 1e9).astype(np.int64)], axis=1)
    return np.asarray(np.unique(keys, axis=0, return_inverse=True)[1]).reshape(-1).astype(np.int64)


def _covariances(
    phases: AntennaPhases,
    pairs: tuple[Int64, Int64],
    antennas: Antennas,
    sine: Float64,
    doubts: list[Float64],
) -> tuple[Float64, Float64]:
    """Return the covariances of noise and reflections: differences that count from one phase share it.

    Equation: of one phase sigma^2 10^((45 - C/N0) / 10) + floor^2 + (elevation / sin el)^2, and a share of what the
    phase of a hidden satellite has
    """
    shared = pairs[1][:, None] == pairs[1][None, :]
    plain = antennas.phase_floor_m**2 + (antennas.phase_elevation_m / sine) ** 2
    white = []
    for rows, doubt in zip(pairs, doubts, strict=True):
        cn0 = phases.cn0_dbhz[rows]
        thermal = thermal_factor(np.where(np.abs(cn0) <= MOST_CN0_DBHZ, cn0, _ASSUMED_CN0_DBHZ))
        hidden = _HIDDEN_CYCLES2 * phases.wavelength_m[rows] ** 2
        white.append(antennas.phase_sigma_m**2 * thermal + plain + doubt * hidden)
    slow = antennas.multipath_sigma_m**2 * (np.eye(len(sine)) + shared)
    return np.diag(white[0]) + shared * white[1][:, None], slow


def baselines(
    d: Differences, antennas: Antennas, w_eb_b: Float64 | None = None, late_s: float = 0.0
) -> Float64:
    """Return the baseline of each difference in body axes, (R, 3), as ``late_s`` before the state's time."""
    l_b = antennas.lever_b[d.b] - antennas.lever_b[d.a]
    return l_b if w_eb_b is None else np.asarray(l_b - late_s * np.cross(w_eb_b, l_b))


def predicted(d: Differences, l_b: Float64, C_eb: Float64, antennas: Antennas) -> Float64:
    """Return the differences predicted by an attitude, without clocks and whole cycles, (R,) [m].

    Equation: -u^T C_eb l, and the wind-up of antennas that are tilted against each other.
    """
    value = -np.sum(d.u_e * (l_b @ C_eb.T), axis=1)
    return np.asarray(value + wind_up(d, C_eb, antennas) if antennas.winds_up else value)


def wind_up(d: Differences, C_eb: Float64, antennas: Antennas) -> Float64:
    """Return the effect of the antennas' tilt against each other on the differences, (R,) [m]."""
    turned = wind_up_differences(antennas.C_ba, C_eb, d.u_e)  # (M - 1, R): against the first antenna
    turned = np.vstack([np.zeros((1, len(d.b))), turned])
    every = np.arange(len(d.b))
    # received phase grows towards the satellite, differences as ranges do
    return np.asarray((turned[d.a, every] - turned[d.b, every]) * d.wavelength_m / (2.0 * np.pi))


def attitude_rows(d: Differences, l_b: Float64, C_eb: Float64) -> Float64:
    """Return the rows of H at the attitude error psi_e, (R, 3): u x C_eb l [m/rad].

    Neglects: the wind-up's change with attitude, at most 0.03 m/rad where antennas are tilted.
    """
    return np.asarray(np.cross(d.u_e, l_b @ C_eb.T))


def rows_by_states(H: Float64, m: StateRecord, P: Float64, par: Parameters) -> tuple[Float64, Int64, Float64]:
    """Return rows of H by all states that they depend on, (R, k), the columns of these and their covariance (k, k).

    They are the attitude, and the IMU's time where that is estimated.
    """
    columns = np.arange(PSI, PSI + 3, dtype=np.int64)
    if par.at_imu_time < 0:
        return H, columns, P[PSI : PSI + 3, PSI : PSI + 3]
    H = np.column_stack([H, H @ turn_by_imu_time(m, P, par)])
    columns = np.append(columns, par.at_imu_time)
    return H, columns, P[np.ix_(columns, columns)]


def without_clocks(d: Differences, trusted: Bool) -> Float64:
    """Return M, (R, R): M y are the differences less each clock by the ``trusted`` ones."""
    B = clock_columns(d.clock)
    if not B.shape[1]:
        return np.eye(len(d.b))
    weight = B.T * np.where(trusted, 1.0 / np.diag(d.white + d.slow), 0.0)
    total = np.maximum(np.sum(weight, axis=1, keepdims=True), np.finfo(float).tiny)
    return np.asarray(np.eye(len(d.b)) - B @ (weight / total))


def whitened(d: Differences, H: Float64, y: Float64, spread: float) -> tuple[Float64, Float64]:
    """Return rows and innovations with independent errors of variance one, clocks eliminated.

    Equation: R = L L^T, Q^T L^-1 (y - H psi - B t) with Q^T L^-1 B = 0, one row less for each clock.

    Parameters
    ----------
    spread : by how much the reflections' variance counts more than one epoch's own
    """
    L = np.linalg.cholesky(d.white + spread * d.slow)
    rows = np.linalg.solve(L, np.column_stack([H, y, clock_columns(d.clock)]))
    width = H.shape[1]
    B = rows[:, width + 1 :]
    if B.shape[1]:
        Q = np.linalg.qr(B, mode="complete")[0][:, B.shape[1] :]
        rows = Q.T @ rows[:, : width + 1]
    return np.ascontiguousarray(rows[:, :width]), np.ascontiguousarray(rows[:, width])
