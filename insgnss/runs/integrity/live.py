"""Protection levels of the live filter: a sub-filter for each fault runs in parallel.

Before a satellite is used for the first time, the filter without it is the full filter itself. So its sub-filter begins
as a copy of the full filter, made before the first epoch with that satellite, and is from then on, to the last bit, the
sub-filter that ``separation`` runs from the start of a log.

A live filter knows only the past: a level counts the faults of the satellites and constellations so far, and in view
are the satellites of the last minute. Pairs of constellations have no sub-filter; their probability is taken off the
risk.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from insgnss.config.integrity import Integrity
from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.filter.engine import FilterEngine
from insgnss.filter.engine_results import EpochProtection, EpochResult
from insgnss.filter.output.writing import Output
from insgnss.filter.setup import FilterSetup
from insgnss.filter.whole_log import LedgerPart
from insgnss.gnss.observation_rows import N_SATELLITE_SLOTS, GnssRows, satellite_name
from insgnss.runs.integrity.alerts import Separations, alert_events, epoch_misfit, suspect_rows
from insgnss.runs.integrity.faults import (
    MEMORY_NS,
    Fault,
    numbers_of,
    of_constellation,
    two_at_once,
    usable_of,
    without,
)
from insgnss.runs.integrity.separation import (
    alert_limits,
    from_full,
    place_sigma,
    protection_levels,
    spent_risk,
)
from insgnss.tables import Event, Float64, GnssTable, Int64

_NOT_COPIED: Final = {"_final", "_done"}  # the full filter's own results and events
_MOST_ROWS: Final = 600  # of an alert, by which its suspect is found


class SubFilter(FilterEngine):
    """The live filter without some satellites, as a copy of the full one that has not used them yet."""

    def __init__(self, full: FilterEngine, setup: FilterSetup, satellites: Int64) -> None:
        """Copy the full filter, of the setup ``setup``; what never changes is shared, and so are sensors' readings."""
        super().__init__(setup)
        shared: list[object] = [setup, *vars(setup).values()]
        if setup.own is not None:
            shared += [setup.own.arrived, *setup.own.kinds, *(kind.source for kind in setup.own.kinds)]
        memo = {id(part): part for part in shared}
        for name in vars(self).keys() - _NOT_COPIED:
            setattr(self, name, copy.deepcopy(getattr(full, name), memo))
        self.satellites = satellites
        # by time, those that the full filter's were not compared with yet
        self.final: dict[int, EpochResult] = {}

    def _rows(self, epoch: GnssTable, before: GnssTable | None = None) -> GnssRows:
        return without(super()._rows(epoch, before), self.satellites)

    def _finish(self, results: list[EpochResult]) -> None:
        self.final |= {result.t_ns: result for result in results}
        self._final = []  # only refused epochs, which the full filter tells

    def _carry_live(self) -> None:
        """Wait: the newest row is rarely asked for."""
        self._live = None

    def newest_row(self) -> Output:
        """Return the output at the newest inertial sample."""
        super()._carry_live()
        return super().newest_row()


@dataclass
class _Monitored:
    """A fault and the filter that it does not affect."""

    name: str  # a satellite's, or a constellation's letter
    sub: SubFilter
    most: int = 1  # satellites of it in view at the same time

    @property
    def is_constellation(self) -> bool:
        return len(self.name) == 1

    def fault(self, config: Integrity) -> Fault:
        """Return it with its probability."""
        p = of_constellation(self.most, config) if self.is_constellation else config.satellite_fault
        return Fault(self.name, self.sub.satellites, p)


class _AlertRow(NamedTuple):
    """A row with an alert, of k faults."""

    t_ns: int
    names: tuple[str, ...]
    d: Float64  # (k, 3)
    limit: Float64
    misfit: Float64  # (k,)


class LiveProtection:
    """The sub-filters of a live filter, and the levels that they give."""

    def __init__(self, full: FilterEngine, setup: FilterSetup) -> None:
        """Begin with no satellite used."""
        self._full, self._setup, self._config = full, setup, setup.config.integrity
        self._monitored: list[_Monitored] = []
        self._usable_ns: dict[int, int] = {}  # by satellite, the newest epoch that may use it
        self._waiting: list[EpochResult] = []  # of the full filter, final
        self._alert: list[_AlertRow] = []  # the rows of the one that lasts
        self._alert_ns: dict[str, int] = {}  # by suspect, the newest row with an alert of it
        self._spent = False  # the risk, which has been told

    def prepare(self, epoch: GnssTable) -> None:
        """Make the sub-filters of satellites and constellations that are new; the full filter has the epoch not yet."""
        rows = self._setup.rows(epoch, self._setup.messages)
        usable = usable_of(rows)
        t_ns = np.repeat(rows.epoch_ns, np.diff(rows.first))
        for number, at_ns in zip(numbers_of(rows)[usable].tolist(), t_ns[usable].tolist(), strict=True):
            if number not in self._usable_ns:
                self._monitor(number)
            self._usable_ns[number] = max(at_ns, self._usable_ns.get(number, at_ns))
        for last_ns in rows.epoch_ns[-1:].tolist():
            count = self._in_view(last_ns)
            for each in self._monitored:
                each.most = max(each.most, count.get(each.name, 0))

    def _monitor(self, number: int) -> None:
        """Make the sub-filter without a satellite, and without its constellation if it is the first of it."""
        name = satellite_name(number)
        if name[0] not in {each.name for each in self._monitored}:
            every = [n for n in range(N_SATELLITE_SLOTS) if satellite_name(n)[0] == name[0]]
            self._monitored.append(_Monitored(name[0], SubFilter(self._full, self._setup, np.array(every))))
        self._monitored.append(_Monitored(name, SubFilter(self._full, self._setup, np.array([number]))))

    def _in_view(self, t_ns: int) -> dict[str, int]:
        """Return how many satellites of each constellation are in view at a time; in an outage, before it."""
        newest_ns = min(t_ns, max(self._usable_ns.values(), default=t_ns))
        count: dict[str, int] = {}
        for number, at_ns in self._usable_ns.items():
            letter = satellite_name(number)[0]
            count[letter] = count.get(letter, 0) + int(at_ns >= newest_ns - MEMORY_NS)
        return count

    @property
    def sub_filters(self) -> list[SubFilter]:
        """All of them, to be given what the full filter is given."""
        return [each.sub for each in self._monitored]

    def take_final(self, results: list[EpochResult]) -> None:
        """Take results of the full filter that have become final; the sub-filters' may be behind."""
        self._waiting += results

    def compare(self) -> list[Event]:
        """Give the full filter's final results their levels; return alerts, and the event of a risk that is spent."""
        if not self._waiting:
            return []
        events: list[Event] = []
        for result in self._waiting:
            if result.out.counts[0].nav:
                events += self._compare(result)
        for each in self._monitored:
            each.sub.final = {}
        self._waiting = []
        return events

    def _compare(self, result: EpochResult) -> list[Event]:
        """Give a result its levels."""
        monitored = self._counted()
        finals = [each.sub.final.get(result.t_ns) for each in monitored]
        subs = [None if final is None else final.out for final in finals]
        levels, d, sigma = self._levels(result.out, monitored, subs, result.t_ns)
        limit = alert_limits(sigma, self._config)
        names = tuple(each.name for each in monitored)
        result.protection = EpochProtection(*levels, names, d[:, :, 0], limit[:, :, 0])
        return self._alerts(result, subs) + self._spent_risk(result.t_ns)

    def newest(self, out: Output, t_ns: int) -> dict[str, float]:
        """Return the levels at the newest sample, the full filter's output there given."""
        monitored = self._counted()
        levels, _, _ = self._levels(out, monitored, [each.sub.newest_row() for each in monitored], t_ns)
        return dict(zip(("hpl_m", "vpl_m"), levels, strict=True))

    def _counted(self) -> list[_Monitored]:
        """Return the faults that count: a constellation's where there are two at least."""
        several = sum(each.is_constellation for each in self._monitored) > 1
        return [each for each in self._monitored if several or not each.is_constellation]

    def _levels(
        self, full: Output, monitored: Sequence[_Monitored], subs: Sequence[Output | None], t_ns: int
    ) -> tuple[tuple[float, float], Float64, Float64]:
        """Return both levels at a time, and the separations and sigmas (k, 3, 1) of the sub-filters."""
        d, sigma = np.full((len(subs), 3, 1), np.nan), np.full((len(subs), 3, 1), np.nan)
        for k, sub in enumerate(subs):
            if sub is not None and sub.counts[0].nav:
                d[k], sigma[k] = from_full(full.nav[:1], sub.nav[:1])
        if not subs:  # no satellite yet: what the solution rests on is not monitored
            return (np.inf, np.inf), d, sigma
        p = np.array([each.fault(self._config).probability for each in monitored])
        risk = np.array([max(self._config.risk - self._unmonitored(t_ns), 0.0)])
        hpl_m, vpl_m = protection_levels(place_sigma(full.nav[:1]), d, sigma, p, risk)
        return (float(hpl_m[0]), float(vpl_m[0])), d, sigma

    def _unmonitored(self, t_ns: int) -> float:
        """Return the probability of the faults that no sub-filter covers."""
        return float(two_at_once(self._in_view(t_ns), self._config))

    def _alerts(self, result: EpochResult, subs: list[Output | None]) -> list[Event]:
        """Return the event of an alert; none for a suspect that already had one within the last minute."""
        assert result.protection is not None
        _, _, names, d, limit = result.protection
        if not (np.abs(d) > limit).any():
            self._alert = []
            return []
        if self._alert and self._alert[0].names != names:
            self._alert = []
        misfit = [_misfit(result, sub) for sub in subs]
        self._alert = [*self._alert[-_MOST_ROWS:], _AlertRow(result.t_ns, names, d, limit, np.array(misfit))]
        t_ns = np.array([row.t_ns for row in self._alert])
        separations = Separations(
            [each.fault(self._config) for each in self._counted()],
            np.stack([row.d for row in self._alert], axis=-1),
            np.stack([row.limit for row in self._alert], axis=-1),
            t_ns,
            t_ns % NS_PER_WEEK / NS_PER_S,
            np.stack([row.misfit for row in self._alert], axis=-1),
            t_ns,
        )
        (suspect,) = suspect_rows(separations)
        before_ns = self._alert_ns.get(names[suspect])
        self._alert_ns[names[suspect]] = result.t_ns
        is_known = before_ns is not None and result.t_ns - before_ns < MEMORY_NS
        return [] if is_known else alert_events(separations)

    def _spent_risk(self, t_ns: int) -> list[Event]:
        """Return the event of levels that begin to be infinite because nothing is left of the risk."""
        p, spent = self._unmonitored(t_ns), self._spent
        self._spent = p >= self._config.risk
        if not self._spent or spent:
            return []
        return [Event(t_ns, "integrity_risk_spent", spent_risk("from here on", p, self._config))]


def _misfit(full: EpochResult, sub: Output | None) -> float:
    """Return by how much worse than the full filter a sub-filter explains an epoch's measurements."""
    if sub is None:
        return 0.0
    parts = [[LedgerPart(out.ledger, out.carrier)] for out in (sub, full.out)]
    return float(epoch_misfit([full.rows], *parts).sum())
