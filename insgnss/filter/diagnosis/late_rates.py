"""Range rates as suspects: the last minute with rates that lag behind the motion, since when and by how much."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from insgnss.filter.diagnosis.hindsight import Hindsight, Verdict
from insgnss.filter.diagnosis.supposed_faults import LATE_RATES
from insgnss.filter.state import Bank, copy_bank

_LATE_S: Final = (0.03, 0.1, 0.3, 1.0)
_FACTOR: Final = 10.0**0.5  # from one to the next
_HALVINGS: Final = 5  # so often the way to the next, on a logarithmic scale: the last step is 3.7 percent


def late_rates(again: Hindsight) -> Iterator[Verdict]:
    """Yield the results for range rates that lag by some times since the likeliest onset.

    If they are known to lag, they are tried without, too. The likelihoods are means over the onsets.
    """
    known_s = float(again.before[-1].state[0].rates_late_s)
    coarse_s = (0.0, known_s) if known_s else _LATE_S
    onsets = again.before[:-1:2]
    results = [_results(again, onset, coarse_s) for onset in onsets]
    largest = np.array([_largest(verdicts) for verdicts in results])
    if not np.any(largest > -np.inf):
        return
    best = int(np.argmax(largest))
    less = float(np.logaddexp.reduce(largest - largest[best])) - math.log(len(onsets))
    for verdict in _refined(again, onsets[best], results[best]):
        yield verdict._replace(log_likelihood=verdict.log_likelihood + less)


def _refined(again: Hindsight, onset: Bank, verdicts: list[Verdict]) -> list[Verdict]:
    """Return the results with those of times nearer and nearer to the likeliest one, if it is worth while."""
    factor = _FACTOR
    for _ in range(_HALVINGS if _largest(verdicts) >= again.as_it_was else 0):
        factor = factor**0.5
        top_s = max(verdicts, key=_log_likelihood).size
        verdicts = verdicts + _results(again, onset, (top_s / factor, top_s * factor))
    return verdicts


def _results(again: Hindsight, onset: Bank, tried_s: tuple[float, ...]) -> list[Verdict]:
    """Return the results for rates that lag from ``onset`` on by each of some times."""
    found = []
    for late_s in tried_s:
        bank = copy_bank(onset)
        bank.state["rates_late_s"] = late_s
        verdict = again.verdict(LATE_RATES, bank, again.stretches)
        if verdict is not None:
            found.append(verdict._replace(size=late_s))
    return found


def _largest(verdicts: list[Verdict]) -> float:
    return max(map(_log_likelihood, verdicts), default=-np.inf)


def _log_likelihood(verdict: Verdict) -> float:
    return verdict.log_likelihood
