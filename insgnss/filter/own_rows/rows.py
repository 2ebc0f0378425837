"""A user's own measurement kinds: their interface, and all of them on one time line.

The signs are those of the package. The error is estimate minus truth, ``C_eb_hat = (I + [psi x]) C_eb``. A row's value
is measured minus predicted, and its partials are those of the **prediction** by the state, with their plain sign: how
much the prediction grows when the position, the velocity, a bias grows, or when C_eb becomes (I + [psi x]) C_eb.

| row | value | partials |
|---|---|---|
| height h | h - state.h_m | {"position": state.up_e} |
| yaw | remainder(yaw - state.yaw_rad, 2 pi) | {"attitude": state.rpy_by_attitude[2]} |
| velocity v along u | v - u @ state.v_e | {"velocity": u} |
| range to a beacon at b | range - abs(b - state.r_e) | {"position": -(b - state.r_e) / abs(b - state.r_e)} |
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Final, NamedTuple, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from insgnss.filter.layout_names import StateLayout
from insgnss.filter.own_rows.live_times import LiveTimes
from insgnss.filter.own_rows.state_estimate import StateEstimate
from insgnss.tables import Int64

NOT_WATCHED: Final = -1
NOT_CARRYING: Final = -1
NOT_STEPPING: Final = -1


class Row(NamedTuple):
    """One scalar measurement; a plain tuple of the first three is as good."""

    innovation: float  # measured minus predicted; NaN or beyond 1e18: the row is refused as 'bad_value'
    partials: Mapping[str, npt.ArrayLike]  # of the prediction, by the names of the layout
    variance: float  # of the measurement's error, as it counts in the update
    # of this one error, where ``variance`` is larger because the errors of successive rows go together: gate and ledger
    # take this one; None: they are the same
    single_variance: float | None = None
    # second-order terms of the prediction where its partials turn with the state: the matrix M of a^T M b for two
    # blocks by their names. The update takes their mean out of the innovation and adds their variance
    second: Mapping[tuple[str, str], npt.ArrayLike] | None = None


RowsGiven: TypeAlias = Row | tuple[float, Mapping[str, npt.ArrayLike], float] | Iterable[Any]


class Measurement(Protocol):
    """A measurement kind of a user's own, for ``measurements=[...]`` of ``replay`` and ``Engine``.

    An object may also have

    - ``gate_sigma``: above so many sigmas of its predicted innovation a row is refused; None: no gate. Without it the
      gate is that of the pseudoranges.
    - ``unit``: of its innovations, for the report.
    - ``period_ns``, in place of ``times_ns``: there are rows at all its whole multiples in GPS time inside the inertial
      samples, as of a constraint that always holds. The ledger has what was used, nothing of the time before the start.
    - ``watched``: True lets the filter stop using the kind while the mean of its innovations contradicts everything
      else (``own_rows.contradiction``). A look back at faults may leave out any kind.
    - ``tells_heading``: True of a sensor that gives or decides the heading, which is validated like a given start:
      filters without the sensor run in parallel until the vehicle has moved.
    - ``carrying``: True if the filter has no other position or velocity: rows that contradict it then raise its sigmas
      (``own_rows.carrying``).
    - ``repeats(t_ns)``: whether the rows of a time only repeat those before. Such rows say nothing against
      the filter, nor that a kind which was left out agrees again.
    - ``steps``: name of a scalar state of its own whose value may step, as the offset of a barometer where a window is
      opened: readings refused one after the other let it be estimated anew (``own_rows.steps``). One row a time.
    - ``unlikely(state)``: the natural logarithm of the factor, at most 1, by which an open heading loses weight the
      first time that it is below 1. Evidence of limited weight, as that a car does not drive backward.
    - ``together``: True where one row beyond the gate refuses all of the same time.
    - ``hint``: what to check if its rows are refused for long, for the event.
    - ``clock``: whose time its rows are at if the error of the IMU's tags is estimated: "imu", or "gps", where the rows
      are asked for at GPS time and get a column of the IMU's time. Without it "imu".
    """

    @property
    def name(self) -> str:
        """The kind in the ledger: a valid identifier, not that of a built-in kind or of another measurement."""

    @property
    def times_ns(self) -> Int64:
        """GPS times [ns] of its rows (k,), increasing integers; ``flight.gps_ns`` makes them of seconds of the week."""

    def rows(self, state: StateEstimate, layout: StateLayout) -> RowsGiven:
        """Return one row or a sequence of rows at ``state.t_ns``; an empty sequence where nothing was measured.

        It is called for each open heading, and again where the filter looks back or runs beside itself: the answer must
        depend on ``state`` alone. Every heading must be given as many rows as the others; where one is given none,
        the kind has none at that time.
        """


@dataclass(frozen=True)
class Kind:
    """A measurement whose name, times and gate are in order."""

    source: Measurement
    name: str
    times_ns: Int64  # (k,) empty where there is a period
    gate2: float | None  # squared; None: that of the pseudoranges; infinite: no gate
    unit: str
    period_ns: int = 0  # of ticks without end; 0: none
    watched: bool = False  # not used while its rows contradict everything else
    watch: int = NOT_WATCHED  # its place among those that may be left out
    carrying: int = NOT_CARRYING  # its place among those that carry the filter
    tells_heading: bool = False  # a heading that is to be validated
    steps: str = ""  # its state whose value may step
    stepping: int = NOT_STEPPING  # its place among those that have one
    unlikely: Callable[[StateEstimate], float] | None = None
    together: bool = False  # one row beyond the gate refuses all of its time
    hint: str = ""  # what to look at where its rows are refused
    at_gps_time: bool = False  # rather than at the IMU's tags
    # a hypothesis about it: variances larger by this factor, tags late by this time
    widened2: float = 1.0
    late_ns: int = 0

    def repeats(self, t_ns: int) -> bool:
        """Return whether the rows of a time only repeat those before, and so are not evidence."""
        repeats = getattr(self.source, "repeats", None)
        return repeats is not None and bool(repeats(t_ns + self.late_ns))


@dataclass(frozen=True)
class OwnMeasurements:
    """All measurements that a user adds to a filter, on one time line."""

    kinds: tuple[Kind, ...]
    times_ns: Int64  # (m,) at which there are rows, each once, increasing; without periodic and live ones
    periods_ns: tuple[int, ...] = ()  # of the periodic ones
    arrived: LiveTimes = field(default_factory=LiveTimes)

    @property
    def named(self) -> str:
        """The names of all kinds, in a sentence."""
        return ", ".join(kind.name for kind in self.kinds)

    @cached_property
    def _names(self) -> frozenset[str]:
        return frozenset(kind.name for kind in self.kinds)

    @property
    def headings(self) -> tuple[Kind, ...]:
        """The kinds that give the heading."""
        return tuple(kind for kind in self.kinds if kind.tells_heading)

    def without(self, kinds: Iterable[Kind]) -> OwnMeasurements:
        """Return the measurements without some kinds; those that come live are shared."""
        names = {kind.name for kind in kinds}
        return on_one_line(tuple(kind for kind in self.kinds if kind.name not in names), self.arrived)

    def widened(self, kind: Kind, factor2: float) -> OwnMeasurements:
        """Return the measurements with variances of the rows of a kind that are ``factor2`` times as large."""
        wide = replace(kind, widened2=factor2)
        return replace(self, kinds=tuple(wide if each is kind else each for each in self.kinds))

    def late(self, kind: Kind, late_ns: int, after_ns: int, until_ns: int) -> OwnMeasurements:
        """Return the measurements with the rows of a kind whose tags are in an interval, ``late_ns`` too late."""
        first, last = np.searchsorted(kind.times_ns, [after_ns, until_ns], side="right")
        other = replace(kind, times_ns=kind.times_ns[first:last] - late_ns, late_ns=late_ns)
        kinds = tuple(other if each is kind else each for each in self.kinds)
        return on_one_line(kinds, self.arrived.late(kind.name, late_ns, after_ns, until_ns))

    def due(self, after_ns: int, until_ns: int) -> list[int]:
        """Return the times after ``after_ns``, up to ``until_ns``."""
        times = self.listed(after_ns, until_ns)
        if not self.periods_ns:
            return times
        ticks = {t for each in self.periods_ns for t in range(_next_tick(after_ns, each), until_ns + 1, each)}
        return sorted(ticks.union(times))

    def listed(self, after_ns: int, until_ns: int) -> list[int]:
        """Return those of the times that measurements have listed."""
        first, last = np.searchsorted(self.times_ns, [after_ns, until_ns], side="right")
        known = [int(t) for t in self.times_ns[first:last]]
        live = [
            t_ns for t_ns in self.arrived.due(after_ns, until_ns) if self._names & self.arrived.names_at(t_ns)
        ]
        return sorted({*known, *live}) if live else known

    def at(self, t_ns: int) -> list[Kind]:
        """Return the kinds that have rows at a time, in the order in which they were given."""
        live = self.arrived.names_at(t_ns)
        return [kind for kind in self.kinds if kind.name in live or _has(kind, t_ns)]

    def epochs_before_next(self, epoch_ns: Int64, epoch: int, last: int) -> int:
        """Return the epoch after those that come before the next rows: after ``epoch``, ``last`` at most."""
        now_ns = int(epoch_ns[epoch])
        k = int(np.searchsorted(self.times_ns, now_ns, side="right"))
        following = [int(t) for t in self.times_ns[k : k + 1]] + self.arrived.next_after(now_ns, self._names)
        following += [_next_tick(now_ns, each) for each in self.periods_ns]
        if not following:
            return last
        return min(int(np.searchsorted(epoch_ns, min(following))), last)


def on_one_line(kinds: tuple[Kind, ...], arrived: LiveTimes) -> OwnMeasurements:
    """Return kinds on one time line with times that have arrived live."""
    times_ns = np.unique(np.concatenate([np.zeros(0, np.int64), *(kind.times_ns for kind in kinds)]))
    return OwnMeasurements(kinds, times_ns, tuple(sorted({kind.period_ns for kind in kinds} - {0})), arrived)


def _next_tick(after_ns: int, period_ns: int) -> int:
    """Return the first whole multiple of a period after a time."""
    return (after_ns // period_ns + 1) * period_ns


def _has(kind: Kind, t_ns: int) -> bool:
    if kind.period_ns:
        return t_ns % kind.period_ns == 0
    k = int(np.searchsorted(kind.times_ns, t_ns))
    return k < len(kind.times_ns) and int(kind.times_ns[k]) == t_ns
