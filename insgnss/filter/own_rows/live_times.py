"""The times of own rows that are not known beforehand: readings that reach the streaming engine one by one."""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from dataclasses import dataclass, field


@dataclass
class LiveTimes:
    """Times that have arrived so far, and of which kinds there are rows at each."""

    times: list[int] = field(default_factory=list)  # increasing
    names: dict[int, set[str]] = field(default_factory=dict)

    def add(self, name: str, t_ns: int) -> None:
        """Take a time at which a kind has rows."""
        if t_ns not in self.names:
            insort(self.times, t_ns)
        self.names.setdefault(t_ns, set()).add(name)

    def due(self, after_ns: int, until_ns: int) -> list[int]:
        """Return the times after ``after_ns``, up to ``until_ns``."""
        return self.times[bisect_right(self.times, after_ns) : bisect_right(self.times, until_ns)]

    def next_after(self, t_ns: int, names: frozenset[str]) -> list[int]:
        """Return the first time after ``t_ns`` at which one of some kinds has rows, if there is one."""
        later = self.times[bisect_right(self.times, t_ns) :]
        return next(([t] for t in later if names & self.names[t]), [])

    def names_at(self, t_ns: int) -> set[str]:
        """Return the kinds that have rows at a time."""
        return self.names.get(t_ns, set())

    def late(self, name: str, late_ns: int, after_ns: int, until_ns: int) -> LiveTimes:
        """Return the times with only those of a kind that are within an interval, ``late_ns`` earlier."""
        others = LiveTimes()
        for t_ns, names in self.names.items():
            for each in names:
                if each != name:
                    others.add(each, t_ns)
                elif after_ns < t_ns <= until_ns:
                    others.add(each, t_ns - late_ns)
        return others

    def forget_before(self, t_ns: int) -> None:
        """Forget the times before ``t_ns``."""
        gone = self.times[: bisect_left(self.times, t_ns)]
        del self.times[: len(gone)]
        for each in gone:
            del self.names[each]
