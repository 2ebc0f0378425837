"""Evidence from the ledger of the last seconds: satellites that drift away from the others, and late tags."""

from __future__ import annotations

import itertools
from collections import Counter
from typing import Any, Final, NamedTuple

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.filter.output.writing import Table
from insgnss.filter.update.creeping import LEAST_AGREEING, RATE_FLOOR2
from insgnss.gnss.observation_rows import CARRIER, N_BANDS, RANGE_RATE
from insgnss.status import GATED, INCONSISTENT, USED
from insgnss.tables import Bool, Float64, Int64

MOST_SATELLITES: Final = 3
_TELLING_S: Final = 5.0  # over which the means of the range rates say which satellites run away
_COUNTING_S: Final = 12.0
_FAR2: Final = 2.5**2
_MOST_CANDIDATES: Final = 9
FEW: Final = 3  # rows, below which nothing is said
_FITS: Final = (0.75, 0.85)  # share of the rows of each kind that must fit what is believed
_FITTING_EPOCHS: Final = 5
_LARGEST_NIS: Final = (2.5, 1.7)  # averaged over the rows that fit


class KindColumns(NamedTuple):
    """The ledger's columns of one kind."""

    innovation: Float64
    variance: Float64
    predicted: Float64
    status: Int64


class EpochLog(NamedTuple):
    """The filter's output of an epoch."""

    t_ns: int
    slot: Int64
    ledger: Table
    carrier: Table  # (0,) where no carrier is used

    def of_kind(self, kind: int) -> KindColumns:
        """Return its output of the rows of one kind."""
        if kind == CARRIER:
            return KindColumns(*(self.carrier[name] for name in KindColumns._fields))
        return _of_kind(self.ledger, kind)


def used_and_refused(status: Int64) -> tuple[Bool, Bool]:
    """Return which rows of a status were used, and which were refused because they contradict the filter."""
    return status == USED, (status == GATED) | (status == INCONSISTENT)


def judged(status: Int64) -> tuple[int, int]:
    """Return how many rows of a status were used, and how many refused."""
    used, refused = used_and_refused(status)
    return int(np.sum(used)), int(np.sum(refused))


def fits(written: list[EpochLog], strict: bool) -> bool:
    """Return whether most rows of each kind fit in the last epochs, and on average as well as they should.

    ``strict`` is for what explains much in any case: sensors whose errors are unknown.
    """
    late = written[-_FITTING_EPOCHS:]
    if not late:
        return False
    epoch = np.repeat(np.arange(len(late)), [len(w.slot) for w in late])
    for kind in range(2):
        # column by column: arrays of records are joined far more slowly
        rows = KindColumns(*map(np.concatenate, zip(*(w.of_kind(kind) for w in late), strict=True)))
        n_used, n_refused = judged(rows.status)
        if n_used + n_refused < FEW:
            continue
        if n_used < _FITS[strict] * (n_used + n_refused):
            return False
        used = rows.status == USED
        fitting = KindColumns(*(column[used] for column in rows))
        if np.sum(least_nis(fitting, epoch[used])) > _LARGEST_NIS[strict] * n_used:
            return False
    return True


def _of_kind(ledger: Table, kind: int) -> KindColumns:
    return KindColumns(*(ledger[name][:, kind] for name in KindColumns._fields))


def least_nis(used: KindColumns, epoch: Int64) -> Float64:
    """Return the normalised squares of each epoch's used rows of one kind, summed (m,).

    Equation: y^T S^-1 y with S = diag(s), s the variances of the innovations, or with S = diag(s - p) + q q^T,
    q_i = sqrt(p_i), p their predicted parts: as if the errors of the prediction were independent, or all the same as
    the clock's is. The smaller of the two: a clock that wanders by three sigmas is one event and not one of each row.

    Parameters
    ----------
    epoch : (n,) place of each row's epoch among the m, from 0 on
    """
    y, s, p = used.innovation, used.variance, used.predicted
    r = np.maximum(s - p, np.finfo(np.float64).eps * s)  # a far larger p leaves nothing of it but rounding

    def summed(each: Float64) -> Float64:
        return np.bincount(epoch, each).astype(np.float64)

    common = summed(y**2 / r) - summed(y * np.sqrt(p) / r) ** 2 / (1.0 + summed(p / r))
    return np.minimum(summed(y**2 / s), common)


def singles(written: list[EpochLog], since_ns: int) -> list[tuple[int, ...]]:
    """Return each satellite of the epochs after ``since_ns`` as a set of its own, also one that has set meanwhile."""
    slots = [w.slot for w in written if w.t_ns > since_ns]
    return [(int(name),) for name in np.unique(np.concatenate(slots) // N_BANDS)] if slots else []


def most_satellites(written: list[EpochLog]) -> int:
    """Return how many satellites may be left out: five must be left that agree, or they agree on anything."""
    used_slots = [w.slot[np.any(used_and_refused(w.ledger["status"]), axis=(0, 2))] for w in written[-1:]]
    in_view = len({int(slot) // N_BANDS for slots in used_slots for slot in slots})
    return min(MOST_SATELLITES, in_view - LEAST_AGREEING)


def run_away_sets(written: list[EpochLog], end_ns: int) -> list[tuple[int, ...]]:
    """Return sets of one, two and three satellites that may run away, by two witnesses.

    The means of the last seconds' range rates are judged by the satellites against each other, whatever the filter
    believes. What each of them showed against the prediction, many times beyond two and a half sigmas, tells where
    those are too few for that.
    """
    by_means = _apart_from_the_others([w for w in written if end_ns - w.t_ns <= _TELLING_S * NS_PER_S])
    by_count = _often_far_off([w for w in written if end_ns - w.t_ns <= _COUNTING_S * NS_PER_S])
    return list(dict.fromkeys(tuple(sorted(chosen)) for chosen in (*by_means, *by_count)))


def _often_far_off(written: list[EpochLog]) -> list[tuple[int, ...]]:
    """Return the one, two and three satellites whose range rates were far from the prediction most often."""
    often: Counter[int] = Counter()
    for epoch in written:
        status = epoch.ledger["status"][:, RANGE_RATE]
        is_judged = (status == USED) | (status == GATED)
        ledger, slot = epoch.ledger[is_judged], epoch.slot[is_judged]
        far = ledger["innovation"][:, RANGE_RATE] ** 2 > _FAR2 * ledger["variance"][:, RANGE_RATE]
        often.update(int(number) for number in np.unique(slot[far] // N_BANDS))
    names = [number for number, count in often.most_common(MOST_SATELLITES) if count >= FEW]
    return [tuple(names[: i + 1]) for i in range(len(names))]


def _apart_from_the_others(written: list[EpochLog]) -> list[tuple[int, ...]]:
    """Return the one, two and three satellites without which the means of the range rates agree best.

    Equation: the set without which the weighted sum of squares of the means' parity part is least, see ``integrity``
    """
    sums: dict[int, Any] = {}
    for epoch in written:
        status = epoch.ledger["status"][:, RANGE_RATE]
        for k in np.flatnonzero((status == USED) | (status == GATED)):
            entry = epoch.ledger[k]
            r = float(entry.variance[RANGE_RATE] - entry.predicted[RANGE_RATE])
            row = np.array([1.0, entry.innovation[RANGE_RATE], r, *(-entry.u_n), 1.0])
            total = sums.setdefault(int(epoch.slot[k]) // N_BANDS, np.zeros(7))
            total += row
    names = [number for number, total in sums.items() if total[0] >= FEW]
    if len(names) <= LEAST_AGREEING:
        return []
    table = np.array([sums[number] / sums[number][0] for number in names])
    count = np.array([sums[number][0] for number in names])
    weight = 1.0 / np.sqrt(table[:, 2] / count + RATE_FLOOR2)
    y, G = table[:, 1] * weight, table[:, 3:] * weight[:, None]

    def left(out: tuple[int, ...]) -> float:
        keep = np.delete(np.arange(len(names)), out)
        x = np.linalg.lstsq(G[keep], y[keep], rcond=None)[0]
        return float(np.sum((y[keep] - G[keep] @ x) ** 2))

    likely = sorted(range(len(names)), key=lambda i: left((i,)))[:_MOST_CANDIDATES]
    sizes = range(1, min(MOST_SATELLITES, len(names) - LEAST_AGREEING) + 1)
    best = [min(itertools.combinations(likely, size), key=left) for size in sizes]
    return [tuple(names[i] for i in chosen) for chosen in best]
