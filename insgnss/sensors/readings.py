"""The readings of one further sensor, by their times: out of its log, or as they come in live."""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from insgnss.config.sensors import Sensor
from insgnss.constants import NS_PER_S
from insgnss.tables import Bool, Float64, Int64, SensorTable

_JITTER: Final = 0.8  # of ``interval_s`` that has to pass


class Reading(NamedTuple):
    """A sensor's reading at one time, SI units."""

    values: Float64  # (k,) NaN where it gave none
    sigma: Float64  # (s,) of one reading, NaN where the log states none
    weight: float  # by how much its variance grows, as it does not stand alone in its correlation time


@dataclass(frozen=True)
class Readings:
    """The readings of a log that are used."""

    times_ns: Int64  # (n,)
    values: Float64  # (n, k)
    sigma: Float64  # (n, s)
    weight: Float64  # (n,)
    left_out: int = 0  # readings that came too soon after another

    def at(self, t_ns: int) -> Reading:
        """Return the reading of an existing time."""
        k = int(np.searchsorted(self.times_ns, t_ns))
        return Reading(self.values[k], self.sigma[k], float(self.weight[k]))

    @cached_property
    def same(self) -> Bool:
        """Of each reading but the first, whether it equals the one before to the bit (n - 1,)."""
        return _equal(self.values[1:], self.values[:-1])

    def is_repeat(self, t_ns: int) -> bool:
        """Return whether the reading of a time equals the one before to the bit."""
        k = int(np.searchsorted(self.times_ns, t_ns))
        return k > 0 and bool(self.same[k - 1])

    @cached_property
    def _run_starts(self) -> Int64:
        """Index of the first of the equal readings in a row to which each belongs (n,)."""
        starts = np.arange(len(self.values), dtype=np.int64)
        starts[1:][self.same] = 0
        return np.maximum.accumulate(starts)

    def repeated(self, t_ns: int) -> tuple[Float64, Float64 | None] | None:
        """Return the value (k,) that the reading of a time repeats to the bit and the one before that, None if none."""
        k = int(np.searchsorted(self.times_ns, t_ns))
        first = int(self._run_starts[k])
        if first == k:
            return None
        return self.values[k], self.values[first - 1] if first else None


def _equal(now: Float64, before: Float64) -> Bool:
    """Return whether readings (..., k) are equal to the bit; one that is missing in both is."""
    return np.asarray(((now == before) | (np.isnan(now) & np.isnan(before))).all(axis=-1))


def weight_after(config: Sensor, before_ns: int | None, t_ns: int) -> float:
    """Return by how much a reading's variance grows: max(1, 2 correlation time / time since the reading before).

    The first counts as if the usual interval had passed.
    """
    since_s = config.interval_s if before_ns is None else (t_ns - before_ns) / NS_PER_S
    return max(1.0, 2.0 * config.correlation_time_s / since_s) if since_s > 0.0 else 1.0


def least_step_ns(config: Sensor) -> int:
    """Return the time after a reading before which another is left out [ns]."""
    return math.ceil(_JITTER * config.interval_s * NS_PER_S)


def readings_of(config: Sensor, table: SensorTable) -> Readings:
    """Return the readings of a log that are used, each with its weight."""
    least, kept, last = least_step_ns(config), [], None
    for k, t_ns in enumerate(table.t_ns.tolist()):
        if last is None or t_ns - last >= least:
            kept.append(k)
            last = t_ns
    t = table.t_ns[kept]
    before = [None, *t[:-1].tolist()]
    weight = [weight_after(config, b, int(t_ns)) for b, t_ns in zip(before, t.tolist(), strict=True)]
    values, sigma = table.values[kept], table.sigma[kept]
    return Readings(t, values, sigma, np.array(weight), len(table.t_ns) - len(kept))


@dataclass
class LiveReadings:
    """Readings that come in one by one."""

    config: Sensor
    times: list[int] = field(default_factory=list)
    found: dict[int, tuple[Float64, Float64]] = field(default_factory=dict)
    times_ns: Int64 = field(default_factory=lambda: np.zeros(0, np.int64))  # none is known beforehand

    def add(self, t_ns: int, values: Float64, sigma: Float64) -> bool:
        """Take a reading; return whether it is used: not where another stands within the interval."""
        k, least = bisect_left(self.times, t_ns), least_step_ns(self.config)
        near = [abs(t_ns - other) for other in self.times[max(k - 1, 0) : k + 1]]
        if any(step < max(least, 1) for step in near):
            return False
        self.times.insert(k, t_ns)
        self.found[t_ns] = values, sigma
        return True

    def at(self, t_ns: int) -> Reading:
        """Return the reading of an existing time."""
        k = bisect_left(self.times, t_ns)
        before = self.times[k - 1] if k else None
        return Reading(*self.found[t_ns], weight_after(self.config, before, t_ns))

    def repeated(self, t_ns: int) -> tuple[Float64, Float64 | None] | None:
        """Return what the reading of a time repeats, as ``Readings.repeated``."""
        k = first = bisect_left(self.times, t_ns)
        value = self._values(k)
        while first > 0 and _equal(value, self._values(first - 1)):
            first -= 1
        if first == k:
            return None
        return value, self._values(first - 1) if first else None

    def is_repeat(self, t_ns: int) -> bool:
        """Return whether the reading of a time equals the one before to the bit."""
        k = bisect_left(self.times, t_ns)
        return k > 0 and bool(_equal(self._values(k), self._values(k - 1)))

    def _values(self, k: int) -> Float64:
        return self.found[self.times[k]][0]

    def forget_before(self, t_ns: int) -> None:
        """Forget the readings before a time."""
        gone = self.times[: bisect_left(self.times, t_ns)]
        del self.times[: len(gone)]
        for each in gone:
            del self.found[each]
