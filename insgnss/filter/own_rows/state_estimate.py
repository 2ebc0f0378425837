"""One hypothesis of the filter at one time, as a user's own measurement sees it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.filter.layout_names import GyroPart, StateLayout
from insgnss.filter.prediction import ImuSamples
from insgnss.filter.state import OFFSETS, StateRecord
from insgnss.geodesy.ellipsoid import ecef_to_geodetic
from insgnss.geodesy.local_level import ecef_to_ned_matrix
from insgnss.geodesy.rotations import matrix_to_euler
from insgnss.tables import Float64, Int64

LONGEST_WINDOW_S: Final = 5.0  # the streaming engine keeps a second more (``engine._HISTORY_S``)
_NO_SAMPLES: Final = ImuSamples(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3)))


class InertialWindow(NamedTuple):
    """Inertial samples as the filter takes them, biases in them."""

    t_ns: Int64  # (k,) ends of their intervals, GPS time
    w_ib_b: Float64  # (k, 3) rates [rad/s]
    f_b: Float64  # (k, 3) specific forces [m/s^2]
    unknown: bool  # whether motion is missing in them, as in samples that repeat or saturate


@dataclass(frozen=True)
class StateEstimate:
    """The filter's state at ``t_ns``, before the measurement: copies, read only.

    Frames and signs are those of the package: e ECEF, n north-east-down, b forward-right-down; ``C_eb`` takes body axes
    to ECEF. Position and velocity are those of the IMU.
    """

    t_ns: int  # GPS time
    r_e: Float64  # (3,) position [m]
    v_e: Float64  # (3,) velocity against the Earth [m/s]
    C_eb: Float64  # (3, 3)
    b_a: Float64  # (3,) accelerometer bias [m/s^2]
    b_g: Float64  # (3,) gyro bias [rad/s]
    clock_bias_m: float
    clock_drift_mps: float
    w_ib_b: Float64  # (3,) rate of the sample whose interval holds the time, the gyros' error removed [rad/s]
    f_b: Float64  # (3,) its specific force, the accelerometers' error removed [m/s^2]
    # values of the further blocks by their names in the layout, SI units
    optional: Mapping[str, float | Float64]
    _gyro_parts: tuple[GyroPart, ...] = ()  # ``gyro_error`` is for use
    _samples: ImuSamples = (
        _NO_SAMPLES  # of the unbroken stretch, later ones among them: ``recent`` is for use
    )

    def recent(self, seconds: float) -> InertialWindow:
        """Return the samples whose intervals end in the last ``seconds``, 5 at most; fewer where the log begins.

        Raises
        ------
        ValueError : a longer or a negative time
        """
        if not 0.0 <= seconds <= LONGEST_WINDOW_S:
            raise ValueError(
                f"the samples of {seconds} s are asked for: 0 to {LONGEST_WINDOW_S:g} s are kept"
            )
        ends = [self.t_ns - round(seconds * NS_PER_S), self.t_ns]
        chosen = slice(*np.searchsorted(self._samples.t_ns, ends, side="right"))
        unknown = bool(self._samples.unknown[chosen].any())
        t_ns = self._samples.t_ns[chosen]
        w_ib_b, f_b = (read_only(each[chosen]) for each in (self._samples.w_ib_b, self._samples.f_b))
        return InertialWindow(t_ns, w_ib_b, f_b, unknown)

    def gyro_error(self, w_ib_b: Float64, f_b: Float64) -> tuple[Float64, dict[str, Float64]]:
        """Return the gyros' whole error (3,) [rad/s] where they measure a rate, under a specific force, both (3,).

        It is the bias, and what scale factors, misalignments and g-sensitivity make of rate and force, where the filter
        has them as states. The second result says how it grows with each of these blocks, (3, size of the block).
        """
        error, grows = self.b_g.tolist(), {"gyro_bias": np.eye(3)}
        factors = (1.0, *f_b.tolist(), *w_ib_b.tolist())
        values: dict[str, list[float]] = {}
        for part in self._gyro_parts:
            if part.block not in grows:
                grows[part.block] = np.zeros((3, part.size))
                values[part.block] = np.atleast_1d(self.optional[part.block]).tolist()
            grows[part.block][part.axis, part.component] += factors[part.times]
            error[part.axis] += values[part.block][part.component] * factors[part.times]
        return np.array(error), grows

    @cached_property
    def _geodetic(self) -> tuple[float, float, float]:
        lat, lon, h = ecef_to_geodetic(np.array(self.r_e))
        return float(lat), float(lon), float(h)

    @property
    def lat_deg(self) -> float:
        """Geodetic latitude [deg]."""
        return math.degrees(self._geodetic[0])

    @property
    def lon_deg(self) -> float:
        """Longitude [deg]."""
        return math.degrees(self._geodetic[1])

    @property
    def h_m(self) -> float:
        """Height above the WGS-84 ellipsoid [m]; ``insgnss.geodesy.sea_level`` has the geoid."""
        return self._geodetic[2]

    @cached_property
    def C_ne(self) -> Float64:
        """ECEF to north-east-down (3, 3): its rows are the unit vectors north, east and down."""
        C_ne = np.zeros((3, 3))
        ecef_to_ned_matrix(self._geodetic[0], self._geodetic[1], C_ne)
        return read_only(C_ne)

    @cached_property
    def C_nb(self) -> Float64:
        """Body to north-east-down (3, 3)."""
        return read_only(self.C_ne @ self.C_eb)

    @property
    def up_e(self) -> Float64:
        """Unit vector up, ECEF (3,): how the height grows with the position."""
        return np.asarray(-self.C_ne[2])

    @property
    def v_n(self) -> Float64:
        """Velocity north, east, down (3,) [m/s]; it grows with ``velocity`` by ``C_ne``."""
        return np.asarray(self.C_ne @ self.v_e)

    @cached_property
    def rpy_rad(self) -> Float64:
        """Roll, pitch and yaw (3,) [rad]; yaw from true north, -pi to pi."""
        return read_only(np.array(matrix_to_euler(np.array(self.C_nb))))

    @property
    def yaw_rad(self) -> float:
        """Yaw from true north, -pi to pi [rad]."""
        return float(self.rpy_rad[2])

    @cached_property
    def rpy_by_attitude(self) -> Float64:
        """How roll, pitch and yaw (rows) grow with ``attitude`` (columns), (3, 3).

        Equation: C_ne psi = dyaw (0, 0, 1) + dpitch (-sin yaw, cos yaw, 0) + droll C_nb (1, 0, 0)
        Neglects: what the position's error turns of north and down, 1.6e-7 rad per metre.
        """
        _, _, yaw = self.rpy_rad
        pitched = np.array([-math.sin(yaw), math.cos(yaw), 0.0])
        turns = np.column_stack([self.C_nb[:, 0], pitched, [0.0, 0.0, 1.0]])
        return read_only(np.linalg.solve(turns, self.C_ne))


def state_estimate(
    m: StateRecord,
    t_ns: int,
    w_ib_b: Float64,
    f_b: Float64,
    layout: StateLayout,
    samples: ImuSamples = _NO_SAMPLES,
) -> StateEstimate:
    """Return a hypothesis ``m`` as its user sees it.

    Parameters
    ----------
    w_ib_b, f_b : (3,) inertial sample, the sensors' errors removed
    layout : the blocks of the error state by name; those behind the fixed ones have a value in ``optional``
    samples : those that the filter is carried over
    """
    values: dict[str, float | Float64] = {}
    optional, clock = m["optional"], m["clock"]
    for name, place in layout.items():
        if place.columns.start < OFFSETS:
            continue
        part = optional[place.columns.start - OFFSETS : place.columns.stop - OFFSETS]
        values[name] = float(part[0]) if place.size == 1 else read_only(part.copy())
    vectors = {name: read_only(np.array(m[name])) for name in ("r_e", "v_e", "C_eb", "b_a", "b_g")}
    return StateEstimate(
        t_ns=t_ns,
        **vectors,
        clock_bias_m=float(clock[0]),
        clock_drift_mps=float(clock[1]),
        w_ib_b=read_only(w_ib_b),
        f_b=read_only(f_b),
        optional=MappingProxyType(values),
        _gyro_parts=layout.gyro_parts,
        _samples=samples,
    )


def read_only(array: Float64) -> Float64:
    """Return the same array, locked against changes."""
    array.flags.writeable = False
    return array
