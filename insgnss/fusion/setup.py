"""Everything that fixes a filter before the first sample: settings, parameters, clock groups, start."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy.typing as npt

from insgnss.config.filter import FilterConfig
from insgnss.config.flight import GivenStart, ImuGrade, Oscillator
from insgnss.fusion.parameters import resolve_parameters
from insgnss.tables import EphemerisTable, Float64


@dataclass(frozen=True)
class FilterSetup:
    """A filter ready to be started; ``replay`` and the streaming engine are given the same one."""

    config: FilterConfig
    grade: ImuGrade
    oscillator: Oscillator
    lever_arm_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    clock_groups: tuple[str, ...] = ("G",)  # constellations in use; the first keeps the receiver clock
    start: GivenStart | None = None  # None: automatic
    start_ns: int | None = None  # GPS time of a given start; None: the first epoch
    ephemerides: EphemerisTable | None = None  # None: the log carries satellite states
    klobuchar: Float64 | None = None

    @property
    def n_offsets(self) -> int:
        """Number of inter-system clock offsets."""
        return len(self.clock_groups) - 1

    def parameters(self) -> npt.NDArray[Any]:
        """Return the numbers of the compiled filter, (1,) of ``PARAMETERS_DTYPE``."""
        return resolve_parameters(
            self.config, self.grade, self.oscillator, self.lever_arm_m, self.klobuchar is not None
        )

    @property
    def log_drop(self) -> float:
        """Logarithm of the weight below which a hypothesis of the heading goes."""
        return math.log(self.config.heading.drop_below)


def clock_groups(constellations: tuple[str, ...], sv_names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the constellations that get a clock of their own, in the order of the settings, of those in the log.

    QZSS keeps GPS time and shares its clock where both are used.
    """
    present = {name[0] for name in sv_names}
    groups = [c for c in constellations if c in present]
    if "G" in groups and "J" in groups:
        groups.remove("J")
    return tuple(groups) or constellations[:1]
