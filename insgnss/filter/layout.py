"""The further states of a filter as a list of blocks, and the only place that says where each of them stands.

The first seventeen errors are fixed (``inertial.error_state``). Behind them come the blocks that the settings, the log
or a user ask for, and last of all the clone of the epoch before, where carrier phases are used. A block is data: the
compiled filter reads densities, correlation times and couplings from arrays that are filled by the blocks' order.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, NamedTuple

import numpy as np

from insgnss.errors import ConfigError
from insgnss.filter.state import ABSENT_STATE, MAX_COUPLINGS, MAX_OPTIONAL, N_CLONE, OFFSETS
from insgnss.inertial.error_state import BA, BG, CLOCK, DR, DRIFT, DV, PSI
from insgnss.tables import Float64

# what an error of a sensor may be proportional to: one, the specific force and the rate in body axes
FACTORS: Final = ("1", "f_x", "f_y", "f_z", "w_x", "w_y", "w_z")
SENSORS: Final = {"accelerometer": DV, "gyro": PSI}  # the error whose growth theirs is
_AXES: Final = "xyz"


def _is_zero_or_more(value: Any) -> bool:
    """Return whether a value is a finite number that is not negative."""
    is_number = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    return is_number and 0.0 <= float(value) < math.inf


def _is_positive(value: Any) -> bool:
    return _is_zero_or_more(value) and float(value) > 0.0


def _are_names(names: Any) -> bool:
    """Return whether a value is a list of identifiers, at least one."""
    return isinstance(names, tuple | list) and bool(names) and all(map(_is_name, names))


def _is_name(name: Any) -> bool:
    return isinstance(name, str) and name.isidentifier()


class Coupling(NamedTuple):
    """How one component of a block enters a sensor: measured = true + bias + state x ``times``, along ``axis``."""

    sensor: str  # of ``SENSORS``
    axis: str  # x, y or z of the body
    times: str = "1"  # of ``FACTORS``

    @property
    def places(self) -> tuple[int, int, int]:
        """Error that it enters, axis and factor (index into ``FACTORS``)."""
        return SENSORS[self.sensor], _AXES.index(self.axis), FACTORS.index(self.times)

    @property
    def is_known(self) -> bool:
        """Return whether sensor, axis and factor exist."""
        return self.sensor in SENSORS and self.axis in tuple(_AXES) and self.times in FACTORS


@dataclass(frozen=True)
class RandomWalk:
    """A state that wanders: its variance grows by ``density`` squared in a second; zero is a constant."""

    density: float = 0.0  # [unit / sqrt(s)]

    @property
    def is_usable(self) -> bool:
        """Return whether the density is a number, not negative."""
        return _is_zero_or_more(self.density)

    @property
    def variance_per_s(self) -> float:
        """Return the growth of the variance [unit^2 / s]."""
        return self.density**2

    @property
    def rate(self) -> float:
        """Return the inverse of the correlation time [1/s]."""
        return 0.0


@dataclass(frozen=True)
class GaussMarkov:
    """A state that returns to zero with ``time_s`` and has ``sigma`` in the steady state."""

    sigma: float
    time_s: float

    @property
    def is_usable(self) -> bool:
        """Return whether sigma and time are numbers, the sigma not negative, the time above zero."""
        return _is_zero_or_more(self.sigma) and _is_positive(self.time_s)

    @property
    def variance_per_s(self) -> float:
        """Return the density that keeps the steady state [unit^2 / s]."""
        return 2.0 * self.sigma**2 / self.time_s

    @property
    def rate(self) -> float:
        """Return the inverse of the correlation time [1/s]."""
        return 1.0 / self.time_s


@dataclass(frozen=True)
class StateBlock:
    """Some states of one kind.

    ``sigma`` is that of each at the start, in ``unit``; ``columns`` names each in the table ``nav``, where its sigma
    stands as ``sd_`` and the name, unless the block is not ``shown`` there. ``couples`` is empty, or says for each
    component how it enters a sensor; the unit times ``si_per_unit`` is then one of the sensor's SI unit over that of
    the factor (a scale factor in ppm: 1e-6).

    Raises
    ------
    ConfigError : a block without a name or columns, an impossible sigma or process, or an unknown coupling
    """

    name: str
    columns: tuple[str, ...]
    unit: str
    sigma: float
    process: RandomWalk | GaussMarkov = RandomWalk()
    couples: tuple[Coupling, ...] = ()
    si_per_unit: float = 1.0
    shown: bool = True

    def __post_init__(self) -> None:
        """Refuse a state block that no filter can carry."""
        if not (_is_name(self.name) and _are_names(self.columns)):
            raise self._wrong("a name and the names of its columns in a tuple, as identifiers")
        process: Any = self.process
        is_usable = isinstance(process, RandomWalk | GaussMarkov) and process.is_usable
        if not (_is_positive(self.sigma) and is_usable):
            raise self._wrong(
                "a positive sigma, the same for all columns, and a process of finite density and time"
            )
        if not _is_positive(self.si_per_unit):
            raise self._wrong("a positive si_per_unit")
        couples: Any = self.couples
        if not isinstance(couples, tuple | list) or (couples and len(couples) != len(self.columns)):
            raise self._wrong("no coupling, or one for each column, in a tuple")
        for one in couples:
            if not (isinstance(one, Coupling) and one.is_known):
                raise self._wrong(f"couplings of {', '.join(SENSORS)}, x, y, z and {', '.join(FACTORS)}")

    def _wrong(self, needed: str) -> ConfigError:
        return ConfigError(f"the state block {self.name!r} is not usable", advice=f"it needs {needed}")

    @property
    def size(self) -> int:
        """Number of its states."""
        return len(self.columns)

    @property
    def variance(self) -> float:
        """Variance of each of its states at the start, SI units."""
        return (self.sigma * self.si_per_unit) ** 2


@dataclass(frozen=True)
class Layout:
    """The further states of a filter, and the place of each in the error state.

    Raises
    ------
    ConfigError : two blocks of one name or column, or more states or couplings than there is room for
    """

    blocks: tuple[StateBlock, ...] = ()  # those that ``nav`` shows before the others
    clone: bool = False  # antenna position and clock of the epoch before
    home: tuple[int, ...] = ()  # of each clock group the earlier one to which it is tied, else -1

    def __post_init__(self) -> None:
        """Refuse blocks that do not go together."""
        names = [*self.names, *FIXED]
        columns = [f"{sd}{name}" for sd in ("", "sd_") for block in self.blocks for name in block.columns]
        for taken in (names, columns):
            twice = next((name for name in taken if taken.count(name) > 1), None)
            if twice is not None:
                raise ConfigError(
                    f"two states are called {twice!r}", advice="give each block names of its own"
                )
        if self.n_optional > MAX_OPTIONAL or len(self.couplings) > MAX_COUPLINGS:
            raise ConfigError(
                f"{self.n_values} further states with {len(self.couplings)} couplings are too many",
                advice=f"there is room for {MAX_OPTIONAL - N_CLONE} states and {MAX_COUPLINGS} couplings",
            )

    def at(self, name: str) -> int:
        """Return the index of a block's first state, ``ABSENT_STATE`` where the filter has none of it."""
        at = OFFSETS
        for block in self.blocks:
            if block.name == name:
                return at
            at += block.size
        return ABSENT_STATE

    @property
    def names(self) -> list[str]:
        """Names of the blocks, in the order of the states."""
        return [block.name for block in self.blocks]

    @property
    def n_values(self) -> int:
        """Number of further states that have a value of their own."""
        return sum(block.size for block in self.blocks)

    @property
    def n_shown(self) -> int:
        """Number of those that the table ``nav`` shows."""
        return len(self.columns)

    @property
    def n_offsets(self) -> int:
        """Number of inter-system clock offsets, which are the first of the further states."""
        return sum(block.size for block in self.blocks if block.name == SYSTEM_OFFSETS)

    @property
    def at_clone(self) -> int:
        """First index of the epoch before."""
        return OFFSETS + self.n_values if self.clone else ABSENT_STATE

    @property
    def n_optional(self) -> int:
        """Number of further states, the clone among them."""
        return self.n_values + N_CLONE * self.clone

    @property
    def columns(self) -> list[str]:
        """Names of the values in the table ``nav``, in the order of the states."""
        return [name for block in self.blocks if block.shown for name in block.columns]

    @property
    def units(self) -> list[float]:
        """What one of the unit of each column is in SI units."""
        return [block.si_per_unit for block in self.blocks if block.shown for _ in block.columns]

    def in_columns(self, values: Float64) -> dict[str, Float64]:
        """Return values and sigmas (..., 2 k) of the states shown, SI units, by their columns in ``nav``."""
        sigmas = values[..., self.n_shown :]
        named: dict[str, Float64] = {}
        for i, (name, unit) in enumerate(zip(self.columns, self.units, strict=True)):
            named |= {name: values[..., i] / unit, f"sd_{name}": sigmas[..., i] / unit}
        return named

    @cached_property
    def couplings(self) -> list[tuple[int, int, int, int]]:
        """State, error that it enters, axis and factor (index into ``FACTORS``) of each coupling.

        Those of one axis of a sensor stand together.
        """
        entries = [
            (self.at(block.name) + i, *one.places)
            for block in self.blocks
            for i, one in enumerate(block.couples)
        ]
        return sorted(entries, key=lambda coupling: coupling[1:3])

    @cached_property
    def sensor_states(self) -> dict[int, float]:
        """Variance at the start of each further error of the sensors, SI units squared, by its index."""
        return {
            self.at(block.name) + i: block.variance
            for block in self.blocks
            for i in range(block.size if block.couples else 0)
        }


SYSTEM_OFFSETS: Final = "system_offsets"
# the blocks of every filter: where they stand, their size, unit and axes
FIXED: Final = {
    "position": (DR, 3, "m", "ECEF"),
    "velocity": (DV, 3, "m/s", "ECEF"),
    "attitude": (PSI, 3, "rad", "ECEF"),
    "accelerometer_bias": (BA, 3, "m/s^2", "body"),
    "gyro_bias": (BG, 3, "rad/s", "body"),
    "clock_bias": (CLOCK, 1, "m", ""),
    "clock_drift": (DRIFT, 1, "m/s", ""),
}


def diagonal(sensor: str) -> tuple[Coupling, Coupling, Coupling]:
    """Return the couplings of scale factors: each axis of a sensor in proportion to what it measures itself."""
    letter = "w" if sensor == "gyro" else "f"
    x, y, z = (Coupling(sensor, axis, f"{letter}_{axis}") for axis in _AXES)
    return x, y, z
