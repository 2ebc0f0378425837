"""The results of the streaming engine."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.filter.antennas.phase_log import PhaseLog
from insgnss.filter.navigator import Snapshot
from insgnss.filter.output.total_sigmas import nav_columns
from insgnss.filter.output.writing import Output, new_output
from insgnss.filter.setup import FilterSetup
from insgnss.gnss.observation_rows import GnssRows, from_epoch
from insgnss.gnss.table_joining import joined
from insgnss.status import NO_EPOCH_BEFORE, TOO_LATE, USED
from insgnss.tables import Event, Float64, GnssTable


@dataclass(frozen=True)
class NavState:
    """The filter's answer at the time of the newest inertial sample; ``values`` has the columns of ``run.nav``."""

    t_ns: int
    started: bool
    values: dict[str, float]

    @classmethod
    def of(cls, setup: FilterSetup, out: Output, t_ns: int) -> NavState:
        """Return the answer at ``t_ns`` from the output there."""
        if out.counts[0].nav == 0:
            return cls(t_ns, False, {})
        values = nav_columns(out.nav[:1], with_shares=not setup.config.process.range_bias_states)
        values |= setup.layout.in_columns(out.optional[:1])
        return cls(t_ns, True, {name: float(value[0]) for name, value in values.items()})


class EpochProtection(NamedTuple):
    """The protection levels of an epoch, and how far each of k faults moves the solution."""

    hpl_m: float
    vpl_m: float
    faults: tuple[str, ...]  # a satellite's name, or a constellation's letter
    separation_m: Float64  # (k, 3) of the solution without it, north, east, down; NaN where there is none
    limit_m: Float64  # (k, 3) beyond which it is an alert


@dataclass
class EpochResult:
    """The result of one epoch: its rows and the loop's output for them.

    A further antenna's epoch that belongs to no main one has a result of its own, with differences alone.
    """

    t_ns: int
    gnss: GnssTable
    rows: GnssRows
    out: Output
    differences: PhaseLog | None = None  # results of several antennas' phases; None with one antenna
    protection: EpochProtection | None = None  # where it is asked for and the filter has a solution

    @classmethod
    def unused(cls, setup: FilterSetup, epoch: GnssTable, t_ns: int) -> EpochResult:
        """Return an epoch that the filter does not use."""
        rows = rows_of(setup, epoch, None)
        return cls(t_ns, epoch, rows, one_row(setup, rows))

    def refuse(self, what: str, newest_ns: int, latency_ns: int) -> Event:
        """Mark what could have been used as too late, and return the event that says so."""
        for ledger in (self.out.ledger, self.out.carrier):
            # read by itself, its carriers had no epoch before them
            reached = (ledger["status"] == USED) | (ledger["status"] == NO_EPOCH_BEFORE)
            ledger["status"][reached] = TOO_LATE
        if self.differences is not None:
            self.differences.ledger.status[self.differences.phases.status == USED] = TOO_LATE
        late, limit = (newest_ns - self.t_ns) / NS_PER_S, latency_ns / NS_PER_S
        detail = f"{what} {late:.3f} s behind the newest sample (limit {limit:.3f} s): refused"
        if late <= limit:
            detail = f"{what} is not later than the last final output: refused"
        return Event(self.t_ns, "too_late", detail)


@dataclass
class FilterSnapshot:
    """The filter after an epoch (or at a settled time)."""

    t_ns: int
    saved: Snapshot


def rows_of(setup: FilterSetup, epoch: GnssTable, before: GnssTable | None) -> GnssRows:
    """Return an epoch's rows; the carrier's differences need the epoch before it."""
    if before is None or not setup.with_carrier:
        return setup.rows(epoch, setup.messages)
    both = setup.rows(joined([before, epoch]), setup.messages)
    rows = from_epoch(both, len(both.epoch_ns) - 1)
    rows.observation["sv"] = epoch.sv  # numbered as in the epoch's own table
    return rows


def one_row(setup: FilterSetup, rows: GnssRows) -> Output:
    """Return an output with room for the navigation row of one epoch."""
    return new_output(rows, 1, 32, np.zeros(0, np.int64), setup.layout.n_shown)
