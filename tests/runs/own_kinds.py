"""Measurement kinds of a user's own, as tests and their readers would write them: nothing of them is in the package."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

import insgnss
from insgnss.tables import Float64, Int64


@dataclass(frozen=True)
class ZeroVelocity:
    """The vehicle stands: three rows, each with the noise of its time."""

    times_ns: Int64
    noise_mps: Float64  # (k, 3)
    sigma_mps: float = 0.02
    name: str = "zero_velocity"
    unit: str = "m/s"

    def rows(
        self, state: insgnss.StateEstimate, layout: insgnss.StateLayout
    ) -> list[tuple[float, Mapping[str, Float64], float]]:
        z = self.noise_mps[np.searchsorted(self.times_ns, state.t_ns)]
        variance = self.sigma_mps**2
        return [(z[i] - state.v_e[i], {"velocity": np.eye(3)[i]}, variance) for i in range(3)]


@dataclass(frozen=True)
class Compass:
    """A yaw from true north."""

    times_ns: Int64
    yaw_rad: Float64  # (k,)
    sigma_rad: float
    name: str = "compass"

    def rows(self, state: insgnss.StateEstimate, layout: insgnss.StateLayout) -> insgnss.Row:
        z = self.yaw_rad[np.searchsorted(self.times_ns, state.t_ns)]
        difference = math.remainder(z - state.yaw_rad, 2.0 * math.pi)
        return insgnss.Row(difference, {"attitude": state.rpy_by_attitude[2]}, self.sigma_rad**2)


@dataclass(frozen=True)
class MapHeight:
    """A height above the ellipsoid."""

    times_ns: Int64
    h_m: Float64  # (k,)
    sigma_m: float
    name: str = "map_height"
    unit: str = "m"

    def rows(
        self, state: insgnss.StateEstimate, layout: insgnss.StateLayout
    ) -> tuple[float, Mapping[str, Float64], float]:
        z = self.h_m[np.searchsorted(self.times_ns, state.t_ns)]
        return z - state.h_m, {"position": state.up_e}, self.sigma_m**2


@dataclass(frozen=True)
class Beacon:
    """A range from a point of the body to a beacon."""

    times_ns: Int64
    range_m: Float64  # (k,)
    sigma_m: float
    beacon_e: Float64  # (3,)
    lever_b: tuple[float, float, float]
    gate_sigma: float | None = None
    name: str = "beacon"
    unit: str = "m"

    def rows(
        self, state: insgnss.StateEstimate, layout: insgnss.StateLayout
    ) -> tuple[float, Mapping[str, Float64], float]:
        l_e = state.C_eb @ self.lever_b
        away = state.r_e + l_e - self.beacon_e
        distance = float(np.linalg.norm(away))
        z = self.range_m[np.searchsorted(self.times_ns, state.t_ns)]
        along = away / distance
        return z - distance, {"position": along, "attitude": np.cross(l_e, along)}, self.sigma_m**2
