"""The faults that protection levels bound, the probability of those that they do not, and rows without satellites.

A satellite is faulty with probability p, a constellation as a whole with q, all independently. With n_c satellites of
constellation c in view and two constellations or more, one of these happens at most:

- one satellite alone is faulty: p each, bounded by the sub-filter without it;
- one constellation alone has a fault of its own or two faulty satellites or more: at most q + n_c (n_c - 1) p^2 / 2,
  bounded by the sub-filter without the constellation;
- two constellations or more have faults: at most the sum over all pairs of (n_a p + q) (n_b p + q).

The last is not bounded by those sub-filters: it is taken off the risk, row by row, as long as it is less than half of
the risk. Beyond, and where enough satellites of others remain, sub-filters without both constellations of a pair bound
the most probable pairs; what then remains are the other pairs and three constellations at once, at most the sum over
all triples of the products. With one constellation alone its own fault is not monitored, and n (n - 1) p^2 / 2 is taken
off.

In view are the satellites that may be used within a minute of a row, which is as long as a position depends on its
ranges; in an outage those before it. Neglects: a pair of which one fault ended earlier, less than 2 % of the pairs
where faults last an hour.
[Blanch et al. 2015, Baseline advanced RAIM user algorithm, IEEE Trans. Aerosp. Electron. Syst. 51(1), III]
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np

from insgnss.config.integrity import Integrity
from insgnss.constants import NS_PER_S
from insgnss.gnss.observation_rows import N_BANDS, GnssRows, satellite_name
from insgnss.status import SWITCHED_OFF, USED
from insgnss.tables import Bool, Float64, Int64

MOST_UNMONITORED: Final = (
    0.5  # of the risk: more costs the levels more than sub-filters without two constellations
)
_FEWEST: Final = 5  # satellites of a sub-filter without two constellations: what a start needs
MEMORY_NS: Final = 60 * NS_PER_S  # of a position for its ranges


class Fault(NamedTuple):
    """Satellites that may be wrong together."""

    name: str  # a satellite's, a constellation's letter, or two letters as in "E+G"
    satellites: Int64  # their numbers in any log
    probability: float


class FaultModel(NamedTuple):
    """The faults that a log is monitored for, and the probability of all others at its epochs."""

    faults: list[Fault]
    epoch_ns: Int64  # (m,)
    unmonitored: Float64  # (m,)

    def unmonitored_at(self, t_ns: Int64) -> Float64:
        """Return the probability of the faults that are not monitored, at the last epoch before each time (n,)."""
        if not len(self.epoch_ns):
            return np.zeros(len(t_ns))
        return self.unmonitored[np.maximum(np.searchsorted(self.epoch_ns, t_ns, side="right") - 1, 0)]


def fault_model(blocks: Sequence[GnssRows], config: Integrity) -> FaultModel:
    """Return the faults of a log's satellites, constellations and, where they are probable, pairs of constellations."""
    epoch_ns = np.concatenate([np.zeros(0, np.int64), *(rows.epoch_ns for rows in blocks)])
    numbers, in_view = satellites_in_view(blocks, epoch_ns)
    letters = np.array([satellite_name(int(number))[0] for number in numbers], "U1")
    p = config.satellite_fault
    faults = [Fault(satellite_name(int(number)), np.array([number]), p) for number in numbers]
    count = {letter: in_view[letters == letter].sum(axis=0) for letter in sorted(set(letters.tolist()))}
    if len(count) < 2:
        return FaultModel(faults, epoch_ns, two_at_once(count, config) + np.zeros(len(epoch_ns)))
    for letter, n in count.items():
        faults.append(Fault(letter, numbers[letters == letter], of_constellation(int(n.max()), config)))
    pairs = _pairs(count, config)
    unmonitored: Float64 = sum(pairs.values(), np.zeros(len(epoch_ns)))
    if len(count) > 2 and unmonitored.max() > MOST_UNMONITORED * config.risk:
        faulty = [_faulty(n, config) for n in count.values()]
        unmonitored = unmonitored + sum(a * b * c for a, b, c in combinations(faulty, 3))
        for pair in sorted(pairs, key=lambda pair: -float(pairs[pair].max())):
            of_pair = np.isin(letters, pair)
            if unmonitored.max() <= MOST_UNMONITORED * config.risk:
                break
            if in_view[~of_pair].sum(axis=0).max() < _FEWEST:
                continue
            unmonitored = np.maximum(unmonitored - pairs[pair], 0.0)
            faults.append(Fault("+".join(pair), numbers[of_pair], float(pairs[pair].max())))
    return FaultModel(faults, epoch_ns, unmonitored)


def of_constellation(n: int, config: Integrity) -> float:
    """Return the probability of a constellation's fault, or of two of its ``n`` satellites in view."""
    return config.constellation_fault + float(_two_of(np.array(n), config.satellite_fault))


def two_at_once(count: Mapping[str, Int64 | int], config: Integrity) -> Float64:
    """Return the probability that two constellations or more are faulty; of the only one, two satellites or more.

    ``count`` has the satellites in view by constellation, at one epoch or at many (m,).
    """
    if len(count) < 2:
        return sum((_two_of(np.asarray(n), config.satellite_fault) for n in count.values()), np.zeros(()))
    return sum(_pairs(count, config).values(), np.zeros(()))


def _pairs(count: Mapping[str, Int64 | int], config: Integrity) -> dict[tuple[str, str], Float64]:
    """Return the probability that both constellations of a pair are faulty."""
    faulty = {letter: _faulty(np.asarray(n), config) for letter, n in count.items()}
    return {(a, b): faulty[a] * faulty[b] for a, b in combinations(faulty, 2)}


def satellites_in_view(blocks: Sequence[GnssRows], epoch_ns: Int64) -> tuple[Int64, Bool]:
    """Return the numbers of a log's usable satellites (s,), and whether each counts as in view at each epoch (s, m)."""
    counts = [np.diff(rows.first) for rows in blocks]
    epoch = np.repeat(np.arange(len(epoch_ns)), np.concatenate([np.zeros(0, np.int64), *counts]))
    number = np.concatenate([np.zeros(0, np.int64), *(numbers_of(rows) for rows in blocks)])
    usable = np.concatenate([np.zeros(0, np.bool_), *(usable_of(rows) for rows in blocks)])
    numbers = np.unique(number[usable])
    begin = np.searchsorted(epoch_ns, epoch_ns - MEMORY_NS)
    end = np.searchsorted(epoch_ns, epoch_ns + MEMORY_NS, side="right")
    in_view = np.zeros((len(numbers), len(epoch_ns)), np.bool_)
    for one, satellite in zip(in_view, numbers, strict=True):
        here = np.zeros(len(epoch_ns), np.int64)
        here[epoch[usable & (number == satellite)]] = 1
        so_far = np.concatenate([[0], np.cumsum(here)])
        one[:] = so_far[end] > so_far[begin]
    any_in_view = in_view.any(axis=0)
    last = np.maximum.accumulate(np.where(any_in_view, np.arange(len(epoch_ns)), 0))
    return numbers, in_view[:, last]


def without(rows: GnssRows, satellites: Int64) -> GnssRows:
    """Return a copy of rows in which no row of the given satellites is used."""
    off = np.isin(numbers_of(rows), satellites)
    observation, carrier = rows.observation.copy(), rows.carrier.copy()
    observation["status"][off[:, None] & (observation["status"] == USED)] = SWITCHED_OFF
    if len(carrier):
        carrier["status"][off & (carrier["status"] == USED)] = SWITCHED_OFF
    return rows._replace(observation=observation, carrier=carrier)


def _faulty(n: Int64, config: Integrity) -> Float64:
    """Return the probability of a fault among a constellation's satellites in view or of its own."""
    return np.where(n > 0, n * config.satellite_fault + config.constellation_fault, 0.0)


def _two_of(n: Int64, p: float) -> Float64:
    """Return an upper bound of the probability that two of n satellites or more are faulty."""
    return np.asarray(0.5 * p**2 * n * (n - 1), np.float64)


def numbers_of(rows: GnssRows) -> Int64:
    """Return the number of each row's satellite (n,)."""
    return np.asarray(rows.observation["slot"], np.int64) // N_BANDS


def usable_of(rows: GnssRows) -> Bool:
    """Return which rows have a measurement that may be used (n,)."""
    return np.asarray((rows.observation["status"] == USED).any(axis=1))
