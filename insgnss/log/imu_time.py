"""The order of inertial time tags: which samples stay so that time strictly increases, and where it has gaps."""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.errors import TimeError
from insgnss.tables import Event, Int64

GAP_STEPS: Final = 5.0  # a step of more than so many median steps is a gap ...
GAP_MIN_S: Final = 0.05  # ... if it is also longer than this: shorter ones are jitter, which the tags carry
SET_BACK_S: Final = 1.0  # a backward jump of more than this that persists: somebody set the clock
SPIKE_SAMPLES: Final = 3  # so few tags in a row, ahead of both neighbours, are wrong themselves
SPIKE_STEPS: Final = 3.0  # ahead by more than so many median steps
MIN_KEPT_SHARE: Final = 0.5  # with less left, the column is no time or lacks digits
MAX_EVENTS_EACH: Final = 20


def increasing_samples(t_ns: Int64, file: str) -> tuple[Int64 | None, list[Event]]:
    """Return the indices to keep so that time strictly increases (None: all of them), and what was refused.

    A repeated tag refuses the later sample. Where a tag falls back, the samples up to where time has caught up are
    refused, unless a few tags just before had jumped ahead of both neighbours: then those are the wrong ones.

    Raises
    ------
    TimeError : less than half of the samples would be left
    """
    step = np.diff(t_ns)
    if not len(step) or int(step.min()) > 0:
        return None, []
    kept, events = _walk_runs(t_ns, step, file)
    if len(kept) < MIN_KEPT_SHARE * len(t_ns):
        raise TimeError(
            f"only {len(kept)} of {len(t_ns)} time tags are in increasing order",
            file=file,
            advice="the time column repeats or falls: is it the right column, with enough digits?",
        )
    return kept, _shorten(events, file)


def _walk_runs(t_ns: Int64, step: Int64, file: str) -> tuple[Int64, list[Event]]:
    """Go through the strictly increasing runs and keep of each what lies after all that was kept before."""
    median = float(np.median(step[step > 0])) if (step > 0).any() else float(NS_PER_S)
    starts = np.concatenate(([0], np.flatnonzero(step <= 0) + 1, [len(t_ns)])).tolist()
    kept: list[tuple[int, int]] = [(0, starts[1])]
    events: list[Event] = []
    for start, end in pairwise(starts[1:]):
        last = int(t_ns[kept[-1][1] - 1])
        behind = int(np.searchsorted(t_ns[start:end], last, side="right"))
        ahead = _spikes_before(t_ns, kept, int(t_ns[start]), median)
        if 0 < ahead < behind:
            kept[-1] = (kept[-1][0], kept[-1][1] - ahead)
            detail = f"{file}: {ahead} time tag(s) ahead of both neighbours, by {(last - t_ns[start]) / NS_PER_S:.6g} s"
            events.append(Event(int(t_ns[start]), "imu_time_spike", f"{detail}; sample(s) refused"))
            behind = 0
        elif behind:
            events.append(_refusal(t_ns, start, behind, last, file))
        if start + behind < end:
            kept.append((start + behind, end))
    return np.concatenate([np.arange(a, b) for a, b in kept]), events


def _spikes_before(t_ns: Int64, kept: list[tuple[int, int]], now: int, median: float) -> int:
    """Return how many of the newest kept samples are spikes: later than ``now``, far ahead of their neighbour."""
    begin, end = kept[-1]
    for count in range(1, SPIKE_SAMPLES + 1):
        first = end - count
        if first <= begin:
            return 0
        if t_ns[first - 1] < now:
            return count if t_ns[first] - t_ns[first - 1] > SPIKE_STEPS * median else 0
    return 0


def _refusal(t_ns: Int64, start: int, behind: int, last: int, file: str) -> Event:
    back = last - int(t_ns[start])
    if back == 0 and behind == 1:
        return Event(last, "imu_time_duplicate", f"{file}: time tag repeated; the later sample refused")
    kind = "imu_time_backwards"
    detail = f"{file}: time falls back by {back / NS_PER_S:.6g} s; {behind} sample(s) refused"
    if back > SET_BACK_S * NS_PER_S and behind > SPIKE_SAMPLES:
        kind = "imu_time_set_back"
        detail += ", up to where time has caught up: the clock was set back, what follows may be shifted"
    return Event(last, kind, detail)


def _shorten(events: list[Event], file: str) -> list[Event]:
    """Return the first events of each kind and one that counts the rest."""
    short: list[Event] = []
    for kind in dict.fromkeys(event.kind for event in events):
        same = [event for event in events if event.kind == kind]
        short += same[:MAX_EVENTS_EACH]
        if len(same) > MAX_EVENTS_EACH:
            detail = f"{file}: {len(same) - MAX_EVENTS_EACH} more such, {len(same)} in all"
            short.append(Event(same[MAX_EVENTS_EACH].t_ns, kind, detail))
    return short


def gap_events(t_ns: Int64, step: Int64, median_ns: float, file: str) -> list[Event]:
    """Return an event for each step longer than a gap's threshold, with its start and length."""
    limit = max(GAP_STEPS * median_ns, GAP_MIN_S * NS_PER_S)
    events = [
        Event(int(t_ns[i]), "imu_gap", f"{file}: no sample for {step[i] / NS_PER_S:.6g} s")
        for i in np.flatnonzero(step > limit)
    ]
    return _shorten(events, file)
