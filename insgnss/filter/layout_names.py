"""The error state by names: which blocks a filter has, where each stands, and in which unit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from insgnss.filter.layout import FIXED, SYSTEM_OFFSETS, Layout
from insgnss.filter.state import OFFSETS, PSI


class StatePlace(NamedTuple):
    """One block of the error state."""

    columns: slice  # its place in the error state
    unit: str  # of each component
    frame: str  # axes of a vector; empty of a scalar

    @property
    def size(self) -> int:
        """Number of components."""
        return int(self.columns.stop - self.columns.start)

    def __str__(self) -> str:
        return f"{self.size} [{self.unit}]{f' {self.frame}' if self.frame else ''}"


class GyroPart(NamedTuple):
    """One state that is a part of the gyros' error: in which axis, and which of ``layout.FACTORS`` it multiplies."""

    block: str
    size: int  # of the block
    component: int
    axis: int
    times: int


@dataclass(frozen=True)
class StateLayout(Mapping[str, StatePlace]):
    """The blocks of a filter's error state by name; every filter has the first seven.

    | block | components |
    |---|---|
    | position, velocity | of the IMU, ECEF [m], [m/s] |
    | attitude | psi of C_eb_hat = (I + [psi x]) C_eb, ECEF axes [rad] |
    | accelerometer_bias, gyro_bias | body axes [m/s^2], [rad/s] |
    | clock_bias, clock_drift | of the receiver [m], [m/s] |
    | offset_E, offset_R, ... | clock of a further constellation against the first one [m] |
    | glonass_channel_bias | delay that grows with the frequency channel [m per channel] |
    | zenith_delay, ionosphere | the models' residuals at the zenith [m] |
    | imu_time | correction to the IMU's time tags [s] |
    | lever_arm | correction to the antenna's lever arm in the flight file, body axes [m] |
    | a ``StateBlock`` of the user's | all of its states, SI units |
    """

    blocks: Mapping[str, StatePlace]
    gyro_parts: tuple[GyroPart, ...] = ()  # states that enter the gyros beside their bias

    def __getitem__(self, name: str) -> StatePlace:
        return self.blocks[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.blocks)

    def __len__(self) -> int:
        return len(self.blocks)

    def __str__(self) -> str:
        return ", ".join(f"{name} {block}" for name, block in self.blocks.items())


def _further_places(layout: Layout) -> dict[str, StatePlace]:
    """Return the names of the further states in their order, each with its place.

    A block of several states has one name, but the clock offsets have one each.
    """
    places: dict[str, StatePlace] = {}
    at = OFFSETS
    for block in layout.blocks:
        unit = block.unit if block.si_per_unit == 1.0 else f"{1.0 / block.si_per_unit:g} {block.unit}"
        parts = {block.name: block.size}
        if block.name == SYSTEM_OFFSETS:
            parts = {column.removesuffix("_m"): 1 for column in block.columns}
        for name, size in parts.items():
            places[name] = StatePlace(slice(at, at + size), unit, "")
            at += size
    return places


def state_layout(layout: Layout) -> StateLayout:
    """Return the blocks of a filter's error state without the clone of the epoch before."""
    places = {
        name: StatePlace(slice(at, at + size), unit, frame) for name, (at, size, unit, frame) in FIXED.items()
    }
    return StateLayout(places | _further_places(layout), tuple(_gyro_parts(layout)))


def _gyro_parts(layout: Layout) -> Iterator[GyroPart]:
    """Yield the states that enter the gyros."""
    for block in layout.blocks:
        for i, coupling in enumerate(block.couples):
            into, axis, times = coupling.places
            if into == PSI:
                yield GyroPart(block.name, block.size, i, axis, times)
