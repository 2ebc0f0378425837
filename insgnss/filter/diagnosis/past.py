"""The filter's record of its last minute, to rerun if it may have been wrong (``suspects``)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.filter.state import Bank, copy_bank
from insgnss.gnss.observation_rows import GnssRows, joined_epochs, some_epochs

_EVERY_NS: Final = 15 * NS_PER_S
_KEPT: Final = 5  # so the oldest is 60 to 75 s old
_LEAST_NS: Final = 8 * NS_PER_S  # a shorter past decides nothing
_MARGIN_NS: Final = 110_000_000  # time tags may be tried that are so much later than the newest sample allows
_LOOK_AGAIN_NS: Final = 3 * NS_PER_S
_PATIENCE: Final = 8  # the next look comes after an eighth of the time for which it has been unclear
_MOST_IN_VAIN: Final = 8  # a quarter of an hour
_FORGIVEN_NS: Final = 1800 * NS_PER_S


class EpochRange(NamedTuple):
    """Epochs of a log that the filter went over."""

    rows: GnssRows
    first: int
    last: int

    def alone(self) -> GnssRows:
        """Return the rows of the epochs without the rest of their log; they share their memory with it."""
        return some_epochs(self.rows, self.first, self.last)


EpochRanges: TypeAlias = tuple[EpochRange, ...]


@dataclass(frozen=True)
class FilterHistory:
    """The filter as it stood, and the epochs since the oldest of that. Nothing in it is ever changed."""

    banks: tuple[Bank, ...] = ()
    epochs: EpochRanges = ()
    unclear_ns: int = 0  # since when there is a fault of which it is not clear whose it is
    opened: bool = False  # whether both sensors are suspect meanwhile
    suspected: frozenset[str | int] = frozenset()  # the suspicion at the last check
    judged_ns: int = 0  # when it was last checked
    tags_off_ns: int = 0  # when the inertial tags were last found to be off
    in_vain: int = 0  # how often in a row without a result

    @property
    def respite_ns(self) -> int:
        """For how long no suspicion is raised: longer and longer while nothing comes of it.

        An undecided suspicion is checked again soon, and less often the longer it lasts.
        """
        if self.unclear_ns:
            return max(_LOOK_AGAIN_NS, (self.judged_ns - self.unclear_ns) // _PATIENCE)
        return int(_LOOK_AGAIN_NS * 2 ** min(self.in_vain, _MOST_IN_VAIN))

    @property
    def look_again_ns(self) -> int:
        """When a suspicion may be checked again, however often that was in vain."""
        return self.judged_ns + _LOOK_AGAIN_NS

    @property
    def due_ns(self) -> int:
        """When the filter is to be kept next."""
        return int(self.banks[-1].head[0].now_ns) + _EVERY_NS if self.banks else 0

    def after(self, bank: Bank, rows: GnssRows, first: int, last: int) -> FilterHistory:
        """Return the past after the epochs ``first`` to ``last - 1``."""
        if len(bank.state) > 1:
            return self.forgotten()
        epochs = (*self.epochs, EpochRange(rows, first, last)) if self.banks else ()
        if int(bank.head[0].now_ns) < self.due_ns:
            return replace(self, epochs=epochs)
        banks = (*self.banks, copy_bank(bank))[-_KEPT:]
        oldest_ns = int(banks[0].head[0].now_ns)
        recent = tuple(e for e in epochs if int(e.rows.epoch_ns[e.last - 1]) > oldest_ns)
        return replace(self, banks=banks, epochs=recent)

    def judged(self) -> tuple[FilterHistory, tuple[int, int] | None]:
        """Return the past to rerun now, the end of the judgement and the last epoch; None if it is too short.

        The judgement ends a little before the last epoch, so that other time tags can be tried.
        """
        if not self.banks or not self.epochs:
            return self, None
        last = self.epochs[-1]
        now_ns = int(last.rows.epoch_ns[last.last - 1])
        in_vain = self.in_vain if now_ns - self.judged_ns < _FORGIVEN_NS else 0
        past = replace(self, judged_ns=now_ns, in_vain=in_vain)
        times_ns = np.concatenate([e.rows.epoch_ns[e.first : e.last] for e in self.epochs])
        end = int(np.searchsorted(times_ns, now_ns - _MARGIN_NS, side="right")) - 1
        oldest_ns = int(self.banks[0].head[0].now_ns)
        if end < 0 or int(times_ns[end]) - oldest_ns < _LEAST_NS:
            return past, None
        return past, (int(times_ns[end]), now_ns)

    def tags_were_off(self, within_ns: int) -> bool:
        """Return whether the inertial tags were recently found to be off."""
        return self.tags_off_ns > 0 and self.judged_ns - self.tags_off_ns < within_ns

    def of_late(self, since_ns: int) -> FilterHistory:
        """Return the past from the youngest filter on that is ``since_ns`` old, from the oldest where none is."""
        old = [b for b in self.banks if self.judged_ns - int(b.head[0].now_ns) >= since_ns]
        return replace(self, banks=tuple(old[-1:]) or self.banks[:1])

    def suspecting(self, suspected: frozenset[str | int]) -> FilterHistory:
        """Return the past with its suspicion, if any."""
        if not suspected:
            return replace(self, suspected=suspected, unclear_ns=0, opened=False, in_vain=self.in_vain + 1)
        return replace(self, suspected=suspected, unclear_ns=self.unclear_ns or self.judged_ns)

    def after_verdict(self, *, tags_off: bool = False) -> FilterHistory:
        """Return the past once something has been found; what was before a new filter is of no use to it.

        ``tags_off``: the inertial tags were found to be off, which leaves the filter as it is.
        """
        if not tags_off:
            return FilterHistory(judged_ns=self.judged_ns, tags_off_ns=self.tags_off_ns)
        found = replace(self, unclear_ns=0, opened=False, in_vain=self.in_vain + 1)
        return replace(found, tags_off_ns=self.judged_ns)

    def forgotten(self) -> FilterHistory:
        """Return an empty past."""
        empty = self.after_verdict()
        return replace(empty, in_vain=self.in_vain)


def in_one_piece(epochs: EpochRanges) -> EpochRanges:
    """Return epochs in as few stretches as they fit in: each costs every rerun a call of the loop.

    A stream hands in epoch after epoch, and may learn another broadcast ionosphere between two.
    """
    alike: list[list[GnssRows]] = []
    for rows in (each.alone() for each in epochs):
        if alike and _are_alike(alike[-1][-1], rows):
            alike[-1].append(rows)
        else:
            alike.append([rows])
    return tuple(EpochRange(rows, 0, len(rows.epoch_ns)) for rows in map(joined_epochs, alike))


def _are_alike(rows: GnssRows, other: GnssRows) -> bool:
    """Return whether both have the same ionosphere, and carriers either both or neither, as far as they have rows."""
    is_empty = len(rows.observation) == 0 or len(other.observation) == 0
    return np.array_equal(rows.klobuchar, other.klobuchar) and (
        is_empty or (len(rows.carrier) > 0) == (len(other.carrier) > 0)
    )
