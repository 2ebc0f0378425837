"""The order of inertial time tags: which samples stay so that time strictly increases, and where it has gaps."""

from __future__ import annotations

from array import array
from bisect import bisect_left
from typing import Final

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.errors import TimeError
from insgnss.log.events import shortened
from insgnss.tables import Event, Int64, stretches_of

IMU_GAP_STEPS: Final = 5.0  # a step of more than so many median steps is a gap ...
GAP_MIN_S: Final = 0.05  # ... if it is also longer than this: shorter ones are jitter, which the tags carry
STRAY_SAMPLES: Final = 5  # up to this many wrong tags in a row count as damage; more mean a clock error
STRAY_SHARE: Final = 0.1  # at an end, at most this part of the log counts as stray
SET_BACK_S: Final = 1.0  # wrong by more than this, many in a row: somebody set the clock
MIN_KEPT_SHARE: Final = 0.5  # with less left, the column is not time or lacks digits


def increasing_samples(t_ns: Int64, file: str) -> tuple[Int64 | None, list[Event]]:
    """Return the indices to keep so that time strictly increases (None: all of them), and what was refused.

    As many samples as possible are kept: a tag that leaps ahead is dropped, not the samples after it; of equal choices
    the earlier samples stay. A few samples at either end of the log, separated from all others by more than a second,
    are dropped too: their tags are wrong, or they are of no use.

    Raises
    ------
    TimeError : less than half of the samples would be left
    """
    if _increases(t_ns) and not len(_stray_ends(t_ns)):
        return None, []
    among = np.arange(len(t_ns))
    for _ in range(STRAY_SAMPLES):
        increasing = _longest_increasing(t_ns, among)
        stray = increasing[_stray_ends(t_ns[increasing])]
        if not len(stray):
            break
        among = np.setdiff1d(among, stray)  # what had to go for their sake may be sound
    if len(increasing) < MIN_KEPT_SHARE * len(t_ns):
        raise TimeError(
            f"only {len(increasing)} of {len(t_ns)} time tags are in increasing order",
            file=file,
            advice="the time column repeats or decreases: check that it is the right column and has enough digits",
        )
    return increasing, shortened(_refusals(t_ns, increasing, file), file)


def _increases(t_ns: Int64) -> bool:
    return len(t_ns) < 2 or int(np.diff(t_ns).min()) > 0


def _stray_ends(t_ns: Int64) -> Int64:
    """Return the indices of a few samples at either end that a long step parts from the others; time increases."""
    n = len(t_ns)
    few = min(STRAY_SAMPLES, int(STRAY_SHARE * n))
    at_ends = np.concatenate((np.diff(t_ns[: few + 1]), np.diff(t_ns[n - few - 1 :])))
    if not few or int(at_ends.max()) <= SET_BACK_S * NS_PER_S:
        return np.zeros(0, np.int64)
    long = at_ends > max(SET_BACK_S * NS_PER_S, IMU_GAP_STEPS * float(np.median(np.diff(t_ns))))
    head, tail = np.flatnonzero(long[:few]), np.flatnonzero(long[few:])
    n_head = int(head[-1]) + 1 if len(head) else 0
    n_tail = few - int(tail[0]) if len(tail) else 0
    return np.concatenate((np.arange(n_head), np.arange(n - n_tail, n)))


def _longest_increasing(t_ns: Int64, among: Int64) -> Int64:
    """Return the longest choice of the samples ``among`` whose tags strictly increase, the earlier of equal ones.

    A tag later than all before it and earlier than all after it belongs to the longest choice whatever else does: only
    the others are searched.
    """
    t = t_ns[among]
    if _increases(t):
        return among
    sound = np.ones(len(t), np.bool_)
    sound[1:] &= t[1:] > np.maximum.accumulate(t)[:-1]
    sound[:-1] &= t[:-1] < np.minimum.accumulate(t[::-1])[::-1][1:]
    doubtful = np.flatnonzero(~sound)[::-1]
    # from the end, with signs turned: of equal choices the search keeps what it meets last
    sound[doubtful[_longest_choice(-t[doubtful])]] = True
    return among[sound]


def _longest_choice(values: Int64) -> Int64:
    """Return the indices of a longest strictly increasing choice of the values (patience sorting, n log n)."""
    tops, top_at = array("q"), array("q")  # the lowest end of a choice of each length, and its index
    before = array("q", bytes(8 * len(values)))
    for index, value in enumerate(values.data):
        length = len(tops) if not tops or value > tops[-1] else bisect_left(tops, value)
        before[index] = top_at[length - 1] if length else -1
        tops[length : length + 1] = array("q", (value,))
        top_at[length : length + 1] = array("q", (index,))
    chosen = array("q")
    index = top_at[-1] if top_at else -1
    while index >= 0:
        chosen.append(index)
        index = before[index]
    return np.array(chosen, dtype=np.int64)


def _refusals(t_ns: Int64, increasing: Int64, file: str) -> list[Event]:
    """Return an event for each stretch of refused samples."""
    refused = np.ones(len(t_ns), np.bool_)
    refused[increasing] = False
    events = []
    for start, end in stretches_of(refused).tolist():
        before = int(t_ns[start - 1]) if start else None
        after = int(t_ns[end]) if end < len(t_ns) else None
        events.append(_refusal(t_ns[start:end], before, after, file))
    return events


def _refusal(t_ns: Int64, before: int | None, after: int | None, file: str) -> Event:
    """Return the report on refused tags between two kept ones (None: at an end of the log)."""
    n, first, last = len(t_ns), int(t_ns.min()), int(t_ns.max())
    at = after if before is None else before
    assert at is not None  # half of the samples are kept
    back = -1 if before is None else before - first
    ahead = -1 if after is None else last - after
    seconds = max(back, ahead) / NS_PER_S
    if max(back, ahead) < 0:
        apart = (first - at if after is None else at - last) / NS_PER_S
        detail = f"{n} time tag(s) at an end of the log, {apart:.6g} s from the others; sample(s) refused"
        return Event(at, "imu_time_spike", f"{file}: {detail}")
    if first == last == before:
        return Event(at, "imu_time_duplicate", f"{file}: time tag repeated; the later sample(s) refused")
    clock_set = n > STRAY_SAMPLES and seconds > SET_BACK_S
    if ahead > back:
        detail = f"{n} time tag(s) ahead of what follows, by {seconds:.6g} s; sample(s) refused"
        kind = "imu_time_spike"
        why = ": the clock was set back after them"
    else:
        detail = f"time falls back by {seconds:.6g} s; {n} sample(s) refused"
        kind = "imu_time_backwards"
        why = ", up to where time has caught up: the clock was set back, what follows may be shifted"
    if clock_set:
        kind, detail = "imu_time_set_back", detail + why
    return Event(at, kind, f"{file}: {detail}")


def gap_events(t_ns: Int64, step: Int64, median_ns: float, file: str) -> list[Event]:
    """Return an event for each step longer than a gap's threshold, with its start and length."""
    limit = max(IMU_GAP_STEPS * median_ns, GAP_MIN_S * NS_PER_S)
    events = [
        Event(int(t_ns[i]), "imu_gap", f"{file}: no sample for {step[i] / NS_PER_S:.6g} s")
        for i in np.flatnonzero(step > limit)
    ]
    return shortened(events, file)
