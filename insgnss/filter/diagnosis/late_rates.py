"""Range rates as suspects: the last minute with rates that lag behind the motion, since when and by how much."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from insgnss.filter.diagnosis.hindsight import Hindsight, Verdict, log_likelihood_of
from insgnss.filter.diagnosis.supposed_faults import LATE_RATES, SURE
from insgnss.filter.rows.late_rates import set_lag
from insgnss.filter.state import OFFSETS, Bank, copy_bank, forget_state
from insgnss.filter.states.rate_lag import LOOP_SIGMA_S, RATE_LAG

_SHORTEST_LAG_S: Final = 0.02  # noise alone estimates some milliseconds
_LATE_S: Final = (0.03, 0.1, 0.3, 1.0)
_FACTOR: Final = 10.0**0.5  # from one to the next
LONG_LAG_S: Final = _LATE_S[-1] / _FACTOR**0.5  # from here on a lag is nearest to the longest that is tried
_HALVINGS: Final = 5  # so often the way to the next, on a logarithmic scale: the last step is 3.7 percent


def late_rates(again: Hindsight) -> Iterator[Verdict]:
    """Yield the results for range rates that lag by some times since the likeliest onset.

    A known lag is tried too, and none. The likelihoods are means over the onsets. A lag that is a state starts again:
    it is what the one that is tried leaves.
    """
    known_s = float(again.before[-1].state[0].rates_late_s)
    coarse_s = (0.0, known_s) if known_s else ()
    onsets = again.before[:-1:2]
    results = [[*_results(again, onset, coarse_s), *_longer(again, onset)] for onset in onsets]
    largest = np.array([_largest(verdicts) for verdicts in results])
    least = -math.inf if known_s else again.as_it_was
    if not np.any(largest > least):
        return
    best = int(np.argmax(largest))
    less = float(np.logaddexp.reduce(largest - largest[best])) - math.log(len(onsets))
    for verdict in _refined(again, onsets[best], results[best]):
        _as_one_number(verdict.bank, again.setup.layout.at(RATE_LAG))
        yield verdict._replace(log_likelihood=verdict.log_likelihood + less)


def _as_one_number(bank: Bank, at: int) -> None:
    """Add what a state has found beside a lag to this, so that the state is zero again."""
    if at >= 0:
        m = bank.state[0]
        m.rates_late_s = max(m.rates_late_s + m.optional[at - OFFSETS], 0.0)
        m.optional[at - OFFSETS] = 0.0


def _longer(again: Hindsight, onset: Bank) -> list[Verdict]:
    """Return the results for longer and longer lags, until one makes the minute far less likely."""
    found: list[Verdict] = []
    for late_s in _LATE_S:
        found += _results(again, onset, (late_s,))
        if _largest(found[-1:]) < again.as_it_was - SURE:
            break
    return found


def _refined(again: Hindsight, onset: Bank, verdicts: list[Verdict]) -> list[Verdict]:
    """Return the results with those of times nearer and nearer to the likeliest one."""
    factor = _FACTOR
    for _ in range(_HALVINGS):
        factor = factor**0.5
        top_s = max(verdicts, key=log_likelihood_of).size
        beside_s = {max(top_s / factor, _SHORTEST_LAG_S), min(top_s * factor, _LATE_S[-1])} - {top_s}
        verdicts = verdicts + _results(again, onset, tuple(sorted(beside_s)) if top_s else ())
    return verdicts


def _results(again: Hindsight, onset: Bank, tried_s: tuple[float, ...]) -> list[Verdict]:
    """Return the results for rates that lag from ``onset`` on by each of some times."""
    found, at = [], again.setup.layout.at(RATE_LAG)
    for late_s in tried_s:
        bank = copy_bank(onset)
        set_lag(bank, late_s)
        if at >= 0:
            bank.state[0].optional[at - OFFSETS] = 0.0
            forget_state(bank, 0, at, LOOP_SIGMA_S**2)
        verdict = again.verdict(LATE_RATES, bank, again.stretches)
        if verdict is not None:
            found.append(verdict._replace(size=late_s))
    return found


def _largest(verdicts: list[Verdict]) -> float:
    return max(map(log_likelihood_of, verdicts), default=-np.inf)
