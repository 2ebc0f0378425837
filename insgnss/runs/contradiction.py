"""The event at the end of a run whose logs contradict each other or their declarations."""

from __future__ import annotations

from typing import Final

import pandas as pd

from insgnss.filter.diagnosis.inertial_credit import DISTRUSTED, TRUSTED
from insgnss.tables import Event

KIND: Final = "logs_contradict"
RESET: Final = "reset"  # gaps of a sound log restart the filter, too
# More resets than a filter of sound logs has; more refusals, except among reflections
MOST_RESETS: Final = 2
MOST_REFUSED: Final = 1.0 / 3.0
LEAST_ROWS: Final = 100
# A receiver tracks what its antenna sees: of a sound log the attitude hides little, in inverted flight all for a while
MOST_HIDDEN: Final = 2.0 / 3.0
# One fault has two or three events: that something has failed, and what it is
SUSPECTS: Final = ("sensor_suspect", "time_tag_suspect")
MOST_SUSPICIONS: Final = 3
# Satellites fail one by one: where most of them drift away from the others, the fault is what they have in common
MOST_DRIFTING: Final = 0.5
WITHIN_S: Final = 300.0
LEAST_SATELLITES: Final = 6
HIDDEN: Final = ("masked_gain", "masked_obstruction")
REFUSED: Final = ("gated", "inconsistent", "drifting", "contradicts")
KINDS: Final = ("pseudorange", "range_rate")


def contradiction(
    events: pd.DataFrame, measurements: pd.DataFrame, counts: pd.DataFrame, t_ns: int
) -> list[Event]:
    """Return the event that recommends ``insgnss check``; none if the run looks consistent.

    Parameters
    ----------
    events, measurements : of the run so far
    counts : how many measurements of each kind (columns) have each status (rows)
    """
    signs = []
    times = int((events["kind"] == RESET).sum())
    if times > MOST_RESETS:
        signs.append(f"the filter was reset {times} times")
    for kind in KINDS:
        rows = f"{kind.replace('_', ' ')}s"
        refused = _share(counts, kind, REFUSED, ("used", *REFUSED))
        hidden = _share(counts, kind, HIDDEN, ("used", *REFUSED, *HIDDEN))
        if refused > MOST_REFUSED:
            signs.append(f"it refused {refused:.0%} of the {rows}")
        if hidden > MOST_HIDDEN:
            signs.append(
                f"by its attitude {hidden:.0%} of the {rows} come from satellites that the antenna cannot see"
            )
    suspicions = int(events["kind"].isin(SUSPECTS).sum())
    if suspicions > MOST_SUSPICIONS:
        signs.append(f"it suspected the inertial sensors or the time tags {suspicions} times")
    if (events["kind"] == DISTRUSTED).sum() > (events["kind"] == TRUSTED).sum():
        signs.append("it no longer trusted the inertial samples")
    drifting, of = _most_drifting(measurements)
    if of >= LEAST_SATELLITES and drifting > MOST_DRIFTING * of:
        signs.append(
            f"it left out {drifting} of {of} satellites within five minutes as drifting away from the others"
        )
    if not signs:
        return []
    detail = (
        f"{', '.join(signs)}: units, signs, axes, times, lever arm or antenna may not be as declared, and errors may"
        " exceed their sigmas; 'insgnss check FLIGHT' compares the logs"
    )
    return [Event(t_ns, KIND, detail)]


def _most_drifting(measurements: pd.DataFrame) -> tuple[int, int]:
    """Return how many satellites drifted in those five minutes in which most of them did, and of how many.

    Spans overlap by half.
    """
    if not (measurements["status"] == "drifting").any():
        return 0, 0
    rates = measurements.loc[measurements["kind"] == "range_rate", ["time_s", "sv", "status"]]
    each = []
    for shift_s in (0.0, 0.5 * WITHIN_S):
        span = (rates["time_s"] + shift_s) // WITHIN_S
        used, drifted = (
            rates.loc[rates["status"] == status, "sv"].astype("str").groupby(span).unique()
            for status in ("used", "drifting")
        )
        each += [(len(gone), len(set(gone) | set(used.get(at, ())))) for at, gone in drifted.items()]
    return max(each, key=lambda counts: counts[0] / counts[1], default=(0, 0))


def _share(counts: pd.DataFrame, kind: str, such: tuple[str, ...], of: tuple[str, ...]) -> float:
    """Return the share of statuses ``such`` among those ``of`` for one kind of measurement; 0 of few."""
    if kind not in counts:
        return 0.0
    some, all_of = (sum(int(counts[kind].get(status, 0)) for status in each) for each in (such, of))
    return some / all_of if all_of >= LEAST_ROWS else 0.0
