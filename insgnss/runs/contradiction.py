"""The event at the end of a run whose logs contradict each other: units, signs, axes or times are declared wrongly."""

from __future__ import annotations

from typing import Final

import pandas as pd

from insgnss.tables import Event

KIND: Final = "logs_contradict"
RESET: Final = "reset"  # gaps of a sound log restart the filter, too
# More resets than a filter of sound logs has; more refusals, except among reflections
MOST_RESETS: Final = 2
MOST_REFUSED: Final = 1.0 / 3.0
LEAST_ROWS: Final = 100
REFUSED: Final = ("gated", "inconsistent", "drifting", "contradicts")
KINDS: Final = ("pseudorange", "range_rate")


def contradiction(events: pd.DataFrame, counts: pd.DataFrame, t_ns: int) -> list[Event]:
    """Return the event that sends the reader to the check of the logs; none of a run that looks sound.

    Parameters
    ----------
    events : of the run so far
    counts : how many measurements of each kind (columns) have each status (rows)
    t_ns : time of the event
    """
    signs = []
    times = int((events["kind"] == RESET).sum())
    if times > MOST_RESETS:
        signs.append(f"the filter was reset {times} times")
    for kind in KINDS:
        share = _refused_share(counts, kind)
        if share > MOST_REFUSED:
            signs.append(f"it refused {share:.0%} of the {kind.replace('_', ' ')}s")
    if not signs:
        return []
    detail = (
        f"{' and '.join(signs)}: units, signs, axes or times may not be as declared, and errors may exceed"
        " their sigmas; 'insgnss check FLIGHT' compares the logs"
    )
    return [Event(t_ns, KIND, detail)]


def _refused_share(counts: pd.DataFrame, kind: str) -> float:
    """Return which share of the measurements of a kind that reached the filter it refused; 0 of few."""
    if kind not in counts:
        return 0.0
    column = counts[kind]
    refused = sum(int(column.get(status, 0)) for status in REFUSED)
    reached = refused + int(column.get("used", 0))
    return refused / reached if reached >= LEAST_ROWS else 0.0
