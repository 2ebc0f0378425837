"""The further antennas' epochs in the streaming engine: kept until the main epoch that they belong to is final."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from insgnss.errors import ConfigError, InputError
from insgnss.filter.antennas.phase_log import PhaseLog
from insgnss.filter.engine_results import EpochResult
from insgnss.filter.epoch_tables import empty_epoch, tag_of
from insgnss.filter.setup import FilterSetup
from insgnss.gnss.antenna_phases import MATCH_NS, epoch_of
from insgnss.gnss.observation_rows import GnssRows
from insgnss.gnss.table_joining import joined
from insgnss.tables import Event, GnssTable, Int64


class FurtherArrivals:
    """Epochs by antenna; without further antennas it stays empty."""

    def __init__(self, setup: FilterSetup) -> None:
        """Begin with nothing."""
        self._setup = setup
        self._names = () if setup.aid is None else setup.aid.names  # the main one first
        self._epochs: list[list[GnssTable]] = [[] for _ in self._names[1:]]  # each in the order of time

    @property
    def remarks(self) -> list[Event]:
        """Events about the antennas themselves."""
        return [] if self._setup.aid is None else list(self._setup.aid.remarks)

    @property
    def reach_ns(self) -> int:
        """How far before a new main epoch another one may lose its further antennas' rows to it."""
        return 2 * MATCH_NS if self._epochs else 0

    def number(self, antenna: str | None) -> int:
        """Return the number of an antenna, 0 for the main one.

        Raises
        ------
        ConfigError : the name is unknown
        """
        if antenna is None:
            return 0
        if antenna not in self._names:
            advice = "make the engine's settings from a flight file with an [attitude] block"
            if self._names:
                advice = f"it has: {', '.join(self._names)}"
            message = f"the engine has no antenna '{antenna}'"
            raise ConfigError(message, key="attitude.antenna.name", advice=advice)
        return self._names.index(antenna)

    def add(self, number: int, epoch: GnssTable) -> None:
        """Keep an epoch of a further antenna; rows of a time tag that is known join it.

        Raises
        ------
        InputError : it has no column of carrier phases
        """
        if epoch.carrier_cycles is None:
            raise InputError(
                f"an epoch of antenna '{self._names[number]}' has no carrier phase, which the attitude needs",
                key="carrier_cycles",
                advice="hand the carrier phases on with the observations",
            )
        epochs, t_ns = self._epochs[number - 1], tag_of(epoch)
        at = bisect_left(epochs, t_ns, key=tag_of)
        known = [e for e in epochs[at : at + 1] if tag_of(e) == t_ns]
        epochs[at : at + len(known)] = [joined([*known, epoch])]

    def phases(self, main: GnssTable, rows: GnssRows, mains_ns: Int64) -> PhaseLog:
        """Return the phases of all antennas of a main epoch; ``mains_ns`` are the time tags of all main epochs."""
        tables = []
        for epochs in self._epochs:
            own = [epoch for epoch in epochs if main_of(tag_of(epoch), mains_ns) == tag_of(main)]
            tables.append(joined(own) if own else empty_epoch())
        return self._setup.phases(main, rows, tables)

    def alone(self, number: int, epoch: GnssTable) -> EpochResult:
        """Return a further antenna's epoch that belongs to no main one."""
        nothing = replace(empty_epoch(), glonass_channels=epoch.glonass_channels)
        result = EpochResult.unused(self._setup, nothing, tag_of(epoch))
        tables = [*[empty_epoch()] * (number - 1), epoch]
        result.differences = self._setup.phases(result.gnss, result.rows, tables)
        return result

    def take_final(self, below_ns: int, mains_ns: Callable[[], Int64]) -> list[EpochResult]:
        """Let go of the epochs whose main epoch is before ``below_ns``; return those that can have none any more."""
        if not any(epochs and tag_of(epochs[0]) - MATCH_NS < below_ns for epochs in self._epochs):
            return []
        alone, known_ns = [], mains_ns()
        for number, epochs in enumerate(self._epochs, 1):
            left = []
            for epoch in epochs:
                t_ns = tag_of(epoch)
                main_ns = main_of(t_ns, known_ns)
                if (t_ns + MATCH_NS if main_ns is None else main_ns) >= below_ns:
                    left.append(epoch)
                elif main_ns is None:
                    alone.append(self.alone(number, epoch))
            epochs[:] = left
        return alone


def main_of(t_ns: int, mains_ns: Int64) -> int | None:
    """Return the main epoch that a further antenna's belongs to, None where none is near."""
    nearest = int(epoch_of(np.array([t_ns], np.int64), mains_ns)[0])
    return int(mains_ns[nearest]) if nearest < len(mains_ns) else None
