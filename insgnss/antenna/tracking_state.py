"""The states of a satellite's tracking channel as the supervisor sees it, and the rules that lead from one to the next.

    track --hidden--> hold --visible again--> control_detection --detected--> resume --pulled in--> track
                                                 |  failed                      ^
                                                 +----------> search -----found-+   search --failed--> lost

``hold`` extrapolates and inhibits the search. ``search`` follows ``hold`` directly where the extrapolation error
exceeds the discriminator's aperture. A hidden satellite leaves ``search`` and ``control_detection`` at once, and
``lost`` only when it is visible. Times are integer nanoseconds, so that sums of them have no rounding.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.antenna.visibility import HIDDEN, UNCERTAIN_HIDDEN, UNDECIDED, VISIBLE
from insgnss.jit import inlined, kernel
from insgnss.tables import Float64, Int8, Int64

# Whether the receiver itself sees the signal where it was predicted
NOT_KNOWN: Final = -1
MISSING: Final = 0
PRESENT: Final = 1

# States
ABSENT: Final = 0  # nothing is predicted for the satellite
TRACK: Final = 1
HOLD: Final = 2
CONTROL_DETECTION: Final = 3
RESUME: Final = 4
SEARCH: Final = 5
LOST: Final = 6
TRY: Final = 7  # no state: a control detection or a search, as the prediction is
STATE_NAMES: Final = ("absent", "track", "hold", "control_detection", "resume", "search", "lost")

# Reasons of a transition
NONE: Final = 0
REASON_NAMES: Final = (
    "none",
    "tracked_at_start",
    "hidden_at_start",
    "appeared",
    "prediction_ended",
    "hidden",
    "below_cn0",
    "lost_while_uncertain",
    "signal_lost",
    "visible_again",
    "aperture_exceeded",
    "detected",
    "pulled_in",
    "control_failed",
    "found",
    "search_failed",
    "held_too_long",
    "tried_again",
)
(
    TRACKED_AT_START,
    HIDDEN_AT_START,
    APPEARED,
    PREDICTION_ENDED,
    HIDDEN_BY_ANTENNA,
    BELOW_CN0,
    LOST_WHILE_UNCERTAIN,
    SIGNAL_LOST,
    VISIBLE_AGAIN,
    APERTURE_EXCEEDED,
    DETECTED,
    PULLED_IN,
    CONTROL_FAILED,
    FOUND,
    SEARCH_FAILED,
    HELD_TOO_LONG,
    TRIED_AGAIN,
) = range(1, 18)

NEVER: Final = -(2**63)  # a clock that does not run


class Rules(NamedTuple):
    """The settings as the kernel needs them (``insgnss.config.search.Guards``)."""

    threshold_cn0_dbhz: float
    hysteresis_db: float
    fall_ns: int
    rise_ns: int
    loss_ns: int
    pull_in_ns: int
    retry_ns: int
    max_hold_ns: int
    control_attempts: int
    max_sweeps: int
    half_sweep_ns: int  # what an unsupervised receiver needs on average for a signal that is there


class View(NamedTuple):
    """What is known of each satellite at each epoch, (n, m)."""

    decision: Int8  # UNDECIDED (no prediction), HIDDEN, VISIBLE, ... of ``insgnss.antenna.visibility``
    cn0_dbhz: Float64
    within_aperture: npt.NDArray[np.bool_]
    search_ns: Int64  # of one look through the window
    present: Int8  # NOT_KNOWN, MISSING, PRESENT


class Memory(NamedTuple):
    """What is carried from epoch to epoch for each satellite, (m,)."""

    state: Int8
    below: npt.NDArray[np.bool_]  # below the threshold: to come back takes the hysteresis more
    last_ns: Int64  # time of the epoch before
    since_ns: Int64  # when the state was entered
    seen_since_ns: Int64  # visible without a break
    hidden_since_ns: Int64
    missing_since_ns: Int64  # not seen by the receiver
    end_ns: Int64  # of the detection or sweep in progress
    attempt_ns: Int64  # spent in it so far
    failures: Int64  # of detections, since the satellite was tracked, or of sweeps in this search
    unsupervised_ns: Int64  # what the unsupervised receiver still needs; 0: it tracks


class Spent(NamedTuple):
    """Time in integer nanoseconds, for each satellite, (m,)."""

    hold: Int64
    control: Int64
    search: Int64
    in_vain: Int64  # of control and search: what failed, or was broken off
    unsupervised: Int64  # the receiver without a supervisor, searching
    unsupervised_in_vain: Int64  # of it: while there was no signal to be found


def new_memory(m: int) -> Memory:
    """Return the memory of m satellites before the first epoch."""
    clocks = [np.full(m, NEVER, np.int64) for _ in range(5)]
    counts = [np.zeros(m, np.int64) for _ in range(4)]
    return Memory(np.full(m, ABSENT, np.int8), np.zeros(m, np.bool_), *clocks, *counts)


def new_spent(m: int) -> Spent:
    """Return the sums of m satellites before the first epoch."""
    return Spent(*(np.zeros(m, np.int64) for _ in Spent._fields))


@kernel
def advance(
    t_ns: Int64, view: View, rules: Rules, memory: Memory, spent: Spent, state: Int8, reason: Int8
) -> None:
    """Carry every satellite through the epochs.

    Parameters
    ----------
    t_ns : (n,) strictly increasing, later than the epochs before
    view, rules : input
    memory, spent : carried on
    state, reason : (n, m) output: the state after each epoch, and why it was entered (NONE: no transition)
    """
    for k in range(len(t_ns)):
        for s in range(len(memory.state)):
            sight = _sight(view, k, s, rules, memory)
            _set_clocks(t_ns[k], sight, view.present[k, s], memory, s)
            _charge(t_ns[k], memory, spent, s)
            _charge_unsupervised(t_ns[k], sight, view.present[k, s], rules, memory, spent, s)
            reason[k, s] = _transition(t_ns[k], sight, view, k, s, rules, memory, spent)
            state[k, s] = memory.state[s]
            memory.last_ns[s] = t_ns[k]


@inlined
def _sight(view: View, k: int, s: int, rules: Rules, memory: Memory) -> int:
    """Return UNDECIDED, HIDDEN, UNCERTAIN_HIDDEN or VISIBLE: the stage's decision, and the threshold on C/N0.

    What is uncertain counts as it was decided before; but a signal that the receiver sees is no longer hidden by an
    uncertain decision, and one that was hidden needs the hysteresis more to return.
    """
    sight = int(view.decision[k, s])
    if sight != UNDECIDED:
        limit = rules.threshold_cn0_dbhz
        if memory.below[s]:
            limit += rules.hysteresis_db
        if sight == HIDDEN or not view.cn0_dbhz[k, s] >= limit:
            sight = HIDDEN
            memory.below[s] = True
        elif sight != UNCERTAIN_HIDDEN or view.present[k, s] == PRESENT:
            sight = VISIBLE
            memory.below[s] = False
    return sight


@inlined
def _set_clocks(t: int, sight: int, present: int, memory: Memory, s: int) -> None:
    """Start, keep or stop the clocks of the conditions that must hold for a guard time."""
    if sight != VISIBLE:
        memory.seen_since_ns[s] = NEVER
    elif memory.seen_since_ns[s] == NEVER:
        memory.seen_since_ns[s] = t
    if sight != HIDDEN:
        memory.hidden_since_ns[s] = NEVER
    elif memory.hidden_since_ns[s] == NEVER:
        memory.hidden_since_ns[s] = t
    if present != MISSING:
        memory.missing_since_ns[s] = NEVER
    elif memory.missing_since_ns[s] == NEVER:
        memory.missing_since_ns[s] = t


@inlined
def _held(t: int, since: int, guard: int) -> bool:
    """Return whether a condition has held for its guard time."""
    return since != NEVER and t - since >= guard


@inlined
def _charge(t: int, memory: Memory, spent: Spent, s: int) -> None:
    """Add the time since the epoch before to the state it was spent in; a detection may end before the epoch."""
    if memory.last_ns[s] != NEVER:
        state = memory.state[s]
        if state == HOLD:
            spent.hold[s] += t - memory.last_ns[s]
        elif state == CONTROL_DETECTION or state == SEARCH:
            busy = max(min(t, memory.end_ns[s]) - memory.last_ns[s], 0)
            memory.attempt_ns[s] += busy
            if state == SEARCH:
                spent.search[s] += busy
            else:
                spent.control[s] += busy


@inlined
def _charge_unsupervised(
    t: int, sight: int, present: int, rules: Rules, memory: Memory, spent: Spent, s: int
) -> None:
    """Carry on the receiver that searches whenever it does not track, and half a sweep once the signal is there."""
    there = present == PRESENT or (present == NOT_KNOWN and sight != HIDDEN and sight != UNDECIDED)
    left = memory.unsupervised_ns[s]
    if memory.last_ns[s] != NEVER and left > 0 and sight != UNDECIDED:
        step = t - memory.last_ns[s]
        if there:
            spent.unsupervised[s] += min(step, left)
            memory.unsupervised_ns[s] = max(left - step, 0)
        else:
            spent.unsupervised[s] += step
            spent.unsupervised_in_vain[s] += step
    if not there:
        memory.unsupervised_ns[s] = rules.half_sweep_ns


@inlined
def _transition(
    t: int, sight: int, view: View, k: int, s: int, rules: Rules, memory: Memory, spent: Spent
) -> int:
    """Enter the next state, if it is time, and return why."""
    state = memory.state[s]
    after, reason = state, NONE
    if sight == UNDECIDED:
        if state != ABSENT:
            after, reason = ABSENT, PREDICTION_ENDED
    elif state == ABSENT:
        after, reason = _from_absent(sight, view.present[k, s])
    elif state == TRACK or state == RESUME:
        after, reason = _from_track(t, sight, view, k, s, rules, memory)
    elif state == HOLD or state == LOST:
        after, reason = _from_waiting(t, s, rules, memory)
    elif sight == HIDDEN:
        after, reason = HOLD, (HIDDEN_BY_ANTENNA if view.decision[k, s] == HIDDEN else BELOW_CN0)
    elif t >= memory.end_ns[s]:
        after, reason = _from_attempt(sight, view.present[k, s], s, rules, memory)
    if reason != NONE:
        reason = _enter(t, after, reason, view, k, s, rules, memory, spent)
    return reason


@inlined
def _from_absent(sight: int, present: int) -> tuple[int, int]:
    """Take a satellite in: as it is, if the receiver's word or the antenna settle it, else by a detection."""
    after, reason = HOLD, HIDDEN_AT_START
    if sight == VISIBLE:
        after, reason = TRY, APPEARED
        if present == PRESENT:
            after, reason = TRACK, TRACKED_AT_START
    return after, reason


@inlined
def _from_track(
    t: int, sight: int, view: View, k: int, s: int, rules: Rules, memory: Memory
) -> tuple[int, int]:
    """Leave a signal that is hidden or lost; call it tracked once the loops have pulled in."""
    after, reason = TRACK, NONE
    if _held(t, memory.hidden_since_ns[s], rules.fall_ns):
        after, reason = HOLD, (HIDDEN_BY_ANTENNA if view.decision[k, s] == HIDDEN else BELOW_CN0)
    elif _held(t, memory.missing_since_ns[s], rules.loss_ns):
        after, reason = HOLD, LOST_WHILE_UNCERTAIN
        if sight == VISIBLE:
            after, reason = TRY, SIGNAL_LOST
    elif memory.state[s] == RESUME and t - memory.since_ns[s] >= rules.pull_in_ns:
        reason = PULLED_IN
    return after, reason


@inlined
def _from_waiting(t: int, s: int, rules: Rules, memory: Memory) -> tuple[int, int]:
    """Try a held satellite when it is visible again, one that was given up then too, and now and again."""
    after, reason = TRY, NONE
    seen, since = memory.seen_since_ns[s], memory.since_ns[s]
    if _held(t, seen, rules.rise_ns):
        if memory.state[s] == HOLD or seen > since:
            reason = VISIBLE_AGAIN
        elif t - since >= rules.retry_ns:
            reason = TRIED_AGAIN
    elif memory.state[s] == HOLD and t - since >= rules.max_hold_ns:
        after, reason = LOST, HELD_TOO_LONG
    return after, reason


@inlined
def _from_attempt(sight: int, present: int, s: int, rules: Rules, memory: Memory) -> tuple[int, int]:
    """Judge a detection or sweep at its end; where the receiver says nothing, a visible signal is found."""
    searching = memory.state[s] == SEARCH
    if present == PRESENT or (present == NOT_KNOWN and sight == VISIBLE):
        after, reason = RESUME, (FOUND if searching else DETECTED)
    elif sight != VISIBLE:
        after, reason = HOLD, LOST_WHILE_UNCERTAIN
    elif searching:
        after, reason = SEARCH, SEARCH_FAILED
        if memory.failures[s] + 1 >= rules.max_sweeps:
            after = LOST
    else:
        after, reason = CONTROL_DETECTION, CONTROL_FAILED
        if memory.failures[s] + 1 >= rules.control_attempts:
            after = SEARCH
    return after, reason


@inlined
def _enter(
    t: int,
    after: int,
    reason: int,
    view: View,
    k: int,
    s: int,
    rules: Rules,
    memory: Memory,
    spent: Spent,
) -> int:
    """Enter a state and return why; NONE where it is the same one, with a new detection or sweep."""
    before = memory.state[s]
    if before == CONTROL_DETECTION or before == SEARCH:
        if after != RESUME:
            spent.in_vain[s] += memory.attempt_ns[s]
            memory.failures[s] += 1
    elif reason == SIGNAL_LOST and before == RESUME:
        memory.failures[s] += 1  # a signal that is lost while it is pulled in was no signal
    elif after == TRY:
        memory.failures[s] = 0
    if after == TRY:
        after = CONTROL_DETECTION
        if not view.within_aperture[k, s]:
            after, reason = SEARCH, APERTURE_EXCEEDED
        elif memory.failures[s] >= rules.control_attempts:
            after, reason = SEARCH, CONTROL_FAILED
    if after == CONTROL_DETECTION or after == SEARCH:
        memory.end_ns[s] = t + view.search_ns[k, s]
        memory.attempt_ns[s] = 0
    if after == before:
        return NONE
    if after == SEARCH:
        memory.failures[s] = 0
    memory.state[s] = after
    memory.since_ns[s] = t
    return reason
