"""The interface of a stage that helps the filter at an epoch from outside the compiled loop.

Only the interface is here: a filter without help does not load its implementation.
"""

from __future__ import annotations

from typing import Protocol

from insgnss.filter.antennas.phase_log import PhaseLog
from insgnss.filter.parameters import Parameters
from insgnss.filter.state import Bank
from insgnss.tables import Event, Float64


class EpochAid(Protocol):
    """A stage that follows each epoch's own update, with a memory of its own."""

    log: PhaseLog | None  # where it finds the phases of an epoch, and writes their status

    @property
    def remarks(self) -> tuple[Event, ...]:
        """Events about the antennas themselves."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the antennas, the main one first."""

    def use(self, bank: Bank, t_ns: int, w_ib_b: Float64, par: Parameters) -> tuple[Bank, int]:
        """Update a bank at an epoch; return it and how many measurements were used."""

    def take_events(self) -> list[Event]:
        """Return the events since the last call."""

    def copied(self, log: PhaseLog | None = None) -> EpochAid:
        """Return a copy with the same memory that looks into another log."""
