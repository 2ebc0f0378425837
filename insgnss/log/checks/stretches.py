"""Stretches of a log with motion: the antenna's velocity freed from gravity, and the inertial samples around it.

In ECEF, with f_e = C_es f_s:   dv_e/dt = f_e + g_e - 2 W x v_e   [Groves 2013, 5.36]
In the axes of ECEF at the stretch's start, which do not turn, with R the Earth's turn since then:
    d(R v_e)/dt = R f_e + R (g_e - W x v_e)
so that  s(t) = R v_e - integral of R (g_e - W x v_e) dt  is what the accelerometers alone add to the velocity, and the
gyros measure the turns of their axes against these. The Earth turns a jet's velocity of 300 m/s by 1 m/s in 45 s.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from insgnss.config.flight import ImuGrade
from insgnss.constants import NS_PER_S, WGS84_OMEGA_RADPS
from insgnss.geodesy.gravity import normal_gravity_ecef
from insgnss.log.checks.track import GnssTrack, longest_step_s
from insgnss.tables import Float64, ImuTable, Int64
from insgnss.units import S_PER_H

# A stretch is so short that a gyro's bias turns it less than this, within these bounds
MOST_TURN_DEG: Final = 2.0
SHORTEST_STRETCH_S: Final = 20.0
LONGEST_STRETCH_S: Final = 45.0
MIN_SHARE: Final = 0.4
STEP_S: Final = 0.05  # of the inertial path
SPACING_S: Final = 0.2  # epochs nearer than this share their noise
IMU_GAP_S: Final = 0.3  # over a longer one the mean rate of the next sample does not hold
MIN_EPOCHS: Final = 8


class GnssStretch(NamedTuple):
    """One stretch without a gap of the GNSS."""

    t_s: Float64  # (k,) after the track's origin
    v_e: Float64  # (k, 3)
    s_e: Float64  # (k, 3) velocity freed from gravity, in the axes of ECEF at the first epoch [m/s]
    up_e: Float64  # (3,) unit vector against gravity
    sd_mps: float  # of a velocity's component
    motion: float  # rms change of the velocity against noise, over a second


class InertialGrid(NamedTuple):
    """Increments of angle and velocity on an even grid around stretches, sensor axes."""

    start_s: Float64  # (s,) first node of each stretch
    theta: Float64  # (s, n, 3) from node to node [rad]
    dv: Float64  # (s, n, 3) [m/s]
    from_s: float  # the inertial log's first and last tag
    until_s: float


def stretches(track: GnssTrack, length_s: float, spans_s: list[tuple[float, float]]) -> list[GnssStretch]:
    """Return the track inside spans of time, cut into stretches of about ``length_s``, most motion first.

    ``spans_s``: from and until, counted from the track's origin; where the inertial log has samples.
    """
    keep = _spaced(track.t_s)
    t, v, sd = track.t_s[keep], track.v_e[keep], track.sd_v_mps[keep]
    if len(t) < MIN_EPOCHS:
        return []
    pulls = _pulls(track.r_e[keep], v)
    limit = longest_step_s(t)
    parts = []
    for from_s, until_s in spans_s:
        first, last = np.searchsorted(t, (from_s, until_s))
        edges = [first, *(first + 1 + np.flatnonzero(np.diff(t[first:last]) > limit)), last]
        for a, b in _cuts(t, edges, length_s):
            parts.append(_stretch(t[a:b], v[a:b], sd[a:b], pulls[a:b]))
    return sorted(parts, key=lambda stretch: -stretch.motion)


def _cuts(t_s: Float64, edges: list[int], length_s: float) -> Iterator[tuple[int, int]]:
    """Yield first and last row of even pieces between edges, those that are long enough."""
    for first, last in pairwise(edges):
        if last - first < MIN_EPOCHS:
            continue
        pieces = max(1, int((t_s[last - 1] - t_s[first]) / length_s + 0.5))
        cuts = first + (last - first) * np.arange(pieces + 1) // pieces
        for a, b in pairwise(cuts.tolist()):
            if b - a >= MIN_EPOCHS and t_s[b - 1] - t_s[a] > MIN_SHARE * length_s:
                yield a, b


def spans_without_gaps(
    imu: ImuTable, origin_ns: int, shift_s: float, edge_s: float
) -> list[tuple[float, float]]:
    """Return from when until when an inertial log has samples, ``edge_s`` off each end, after a track's origin."""
    t_s = (imu.t_ns - origin_ns) / NS_PER_S + shift_s
    breaks = np.flatnonzero(np.diff(t_s) > IMU_GAP_S)
    starts, ends = np.append(0, breaks + 1), np.append(breaks, len(t_s) - 1)
    return [(float(t_s[a]) + edge_s, float(t_s[b]) - edge_s) for a, b in zip(starts, ends, strict=True)]


def length_for(grade: ImuGrade) -> float:
    """Return how long a stretch may be that a gyro of this grade does not turn it too far [s]."""
    drift = max(grade.gyro_bias_deg_per_h, 1e-6) / S_PER_H
    return float(np.clip(MOST_TURN_DEG / drift, SHORTEST_STRETCH_S, LONGEST_STRETCH_S))


def _spaced(t_s: Float64) -> Int64:
    """Return every so many epochs that they are ``SPACING_S`` apart."""
    if len(t_s) < 2:
        return np.arange(len(t_s))
    every = max(1, round(SPACING_S / float(np.median(np.diff(t_s)))))
    return np.arange(0, len(t_s), every)


def _pulls(r_e: Float64, v_e: Float64) -> Float64:
    """Return g - W x v at each epoch, (m, 3) [m/s^2]."""
    g_e = np.empty_like(r_e)
    one = np.empty(3)
    for k in range(len(r_e)):
        normal_gravity_ecef(r_e[k], one)
        g_e[k] = one
    g_e[:, 0] += WGS84_OMEGA_RADPS * v_e[:, 1]
    g_e[:, 1] -= WGS84_OMEGA_RADPS * v_e[:, 0]
    return g_e


def _turned(vectors_e: Float64, t_s: Float64) -> Float64:
    """Return vectors (k, 3) in ECEF at given times in the axes of ECEF at the first of them."""
    angle = WGS84_OMEGA_RADPS * (t_s - t_s[0])
    x, y, z = vectors_e.T
    return np.stack([np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y, z], axis=1)


def _stretch(t_s: Float64, v_e: Float64, sd: Float64, pulls: Float64) -> GnssStretch:
    dt = np.diff(t_s)[:, None]
    pulls = _turned(pulls, t_s)
    gained = np.concatenate((np.zeros((1, 3)), np.cumsum(0.5 * dt * (pulls[1:] + pulls[:-1]), axis=0)))
    lag = lag_of(t_s)
    change = v_e[lag:] - v_e[:-lag]
    noise = float(np.median(sd))
    up_e = -pulls.mean(axis=0)
    motion = float(np.sqrt(np.mean(np.sum(change**2, axis=1)) / (6.0 * noise**2)))
    return GnssStretch(t_s, v_e, _turned(v_e, t_s) - gained, up_e / np.linalg.norm(up_e), noise, motion)


def lag_of(t_s: Float64) -> int:
    """Return over how many epochs velocities are differenced: about a second."""
    return max(1, round(1.0 / float(np.median(np.diff(t_s)))))


def inertial_grid(
    imu: ImuTable, origin_ns: int, chosen: list[GnssStretch], margin_s: float, shift_s: float = 0.0
) -> InertialGrid:
    """Return the inertial increments around stretches, ``shift_s`` added to the inertial tags.

    Between samples, and over gaps, the mean rate of the sample that ends there holds.
    """
    t_s = (imu.t_ns - origin_ns) / NS_PER_S + shift_s
    dt = np.diff(t_s, prepend=t_s[0])[:, None]
    angle = np.cumsum(imu.w_ib_b * dt, axis=0)
    speed = np.cumsum(imu.f_b * dt, axis=0)
    longest = max(stretch.t_s[-1] - stretch.t_s[0] for stretch in chosen)
    n = int((longest + 2.0 * margin_s) / STEP_S) + 2
    start_s = np.array([stretch.t_s[0] - margin_s for stretch in chosen])
    nodes = start_s[:, None] + STEP_S * np.arange(n + 1)

    def steps(sums: Float64) -> Float64:
        columns = [np.interp(nodes, t_s, sums[:, axis]) for axis in range(3)]
        return np.diff(np.stack(columns, axis=-1), axis=1)

    return InertialGrid(start_s, steps(angle), steps(speed), float(t_s[0]), float(t_s[-1]))
