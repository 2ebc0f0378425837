"""The error state by names: which blocks a filter has, where each stands, and in which unit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from insgnss.fusion.state import BA, BG, CLOCK, DR, DRIFT, DV, OFFSETS, PSI, Layout


class StateBlock(NamedTuple):
    """One block of the error state."""

    columns: slice  # where it stands in the error state
    unit: str  # of each component
    frame: str  # axes of a vector; empty of a scalar

    @property
    def size(self) -> int:
        """Number of components."""
        return int(self.columns.stop - self.columns.start)

    def __str__(self) -> str:
        return f"{self.size} [{self.unit}]{f' {self.frame}' if self.frame else ''}"


@dataclass(frozen=True)
class StateLayout(Mapping[str, StateBlock]):
    """The blocks of a filter's error state by name; every filter has the first seven.

    | block | components |
    |---|---|
    | position, velocity | of the IMU, ECEF [m], [m/s] |
    | attitude | psi of C_eb_hat = (I + [psi x]) C_eb, ECEF axes [rad] |
    | accelerometer_bias, gyro_bias | body axes [m/s^2], [rad/s] |
    | clock_bias, clock_drift | of the receiver [m], [m/s] |
    | offset_E, offset_R, ... | clock of a further constellation against the first one [m] |
    | glonass_bias | delay that grows with the frequency channel [m per channel] |
    | zenith_delay, ionosphere | what the models leave at the zenith [m] |

    The optional blocks have the names of their columns in ``run.nav``, without the unit.
    """

    blocks: Mapping[str, StateBlock]

    def __getitem__(self, name: str) -> StateBlock:
        return self.blocks[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.blocks)

    def __len__(self) -> int:
        return len(self.blocks)

    def __str__(self) -> str:
        return ", ".join(f"{name} {block}" for name, block in self.blocks.items())


def optional_names(layout: Layout, clock_groups: tuple[str, ...]) -> dict[str, str]:
    """Return the names of the optional states that have a value, in the order of the state, each with its unit."""
    names = {f"offset_{group.replace(':', '_')}": "m" for group in clock_groups[1:]}
    names |= {"glonass_bias": "m per channel"} if layout.channel_bias else {}
    names |= {"zenith_delay": "m"} if layout.zenith_delay else {}
    return names | ({"ionosphere": "m"} if layout.ionosphere else {})


def state_layout(layout: Layout, clock_groups: tuple[str, ...]) -> StateLayout:
    """Return the blocks of a filter's error state; the epoch before, which carrier differences need, is none of them.

    Parameters
    ----------
    clock_groups : as in ``setup.FilterSetup``
    """
    vectors = (
        ("position", DR, "m", "ECEF"),
        ("velocity", DV, "m/s", "ECEF"),
        ("attitude", PSI, "rad", "ECEF"),
        ("accelerometer_bias", BA, "m/s^2", "body"),
        ("gyro_bias", BG, "rad/s", "body"),
    )
    blocks = {name: StateBlock(slice(at, at + 3), unit, frame) for name, at, unit, frame in vectors}
    scalars = [("clock_bias", CLOCK, "m"), ("clock_drift", DRIFT, "m/s")]
    named = optional_names(layout, clock_groups).items()
    scalars += [(name, OFFSETS + i, unit) for i, (name, unit) in enumerate(named)]
    blocks |= {name: StateBlock(slice(at, at + 1), unit, "") for name, at, unit in scalars}
    return StateLayout(blocks)
