"""The rules of the search supervisor, compiled: the transitions of a satellite's channel.

    track --hidden--> hold --visible again--> control_detection --detected--> resume --pulled in--> track
                                                 |  failed                      ^
                                                 +----------> search -----found-+   search --failed--> lost

``hold`` extrapolates and inhibits the search. ``search`` follows ``hold`` directly where the extrapolation error
exceeds the discriminator's aperture. A hidden satellite leaves ``search`` and ``control_detection`` at once, and
``lost`` only when it is visible.
"""

from __future__ import annotations

from insgnss.antenna.visibility import HIDDEN, UNCERTAIN_HIDDEN, UNDECIDED, VISIBLE
from insgnss.kernels.jit import kernel
from insgnss.receiver.tracking_state import (
    ABSENT,
    APERTURE_EXCEEDED,
    APPEARED,
    BELOW_CN0,
    CONTROL_DETECTION,
    CONTROL_FAILED,
    DETECTED,
    FOUND,
    HELD_TOO_LONG,
    HIDDEN_AT_START,
    HIDDEN_BY_ANTENNA,
    HOLD,
    LOST,
    LOST_WHILE_UNCERTAIN,
    MISSING,
    NEVER,
    NONE,
    NOT_KNOWN,
    PREDICTION_ENDED,
    PRESENT,
    PULLED_IN,
    RESUME,
    SEARCH,
    SEARCH_FAILED,
    SIGNAL_LOST,
    TRACK,
    TRACKED_AT_START,
    TRIED_AGAIN,
    TRY,
    VISIBLE_AGAIN,
    Record,
    Records,
    Rules,
    View,
)
from insgnss.tables import Int8, Int64


@kernel
def advance(
    t_ns: Int64, view: View, rules: Rules, memory: Records, spent: Records, state: Int8, reason: Int8
) -> None:
    """Carry every satellite through the epochs.

    Parameters
    ----------
    t_ns : (n,) strictly increasing, later than the epochs before
    memory, spent : carried on
    state, reason : (n, m) output: the state after each epoch, and why it was entered (NONE: no transition)
    """
    for k in range(len(t_ns)):
        for s in range(len(memory)):
            own, sums, present = memory[s], spent[s], view.present[k, s]
            sight = _sight(view, k, s, rules, own)
            _set_clocks(t_ns[k], sight, present, own)
            _charge(t_ns[k], own, sums)
            _charge_unsupervised(t_ns[k], sight, present, rules, own, sums)
            reason[k, s] = _transition(t_ns[k], sight, view, k, s, rules, own, sums)
            state[k, s] = own["state"]
            own["last_ns"] = t_ns[k]


@kernel(inline=True)
def _sight(view: View, k: int, s: int, rules: Rules, memory: Record) -> int:
    """Return UNDECIDED, HIDDEN, UNCERTAIN_HIDDEN or VISIBLE: the stage's decision, and the threshold on C/N0.

    What is uncertain counts as it was decided before; but a received signal is no longer hidden by an
    uncertain decision, and one that was hidden needs the hysteresis more to return.
    """
    sight = int(view.decision[k, s])
    if sight != UNDECIDED:
        limit = rules.threshold_cn0_dbhz
        if memory["below"]:
            limit += rules.hysteresis_db
        if sight == HIDDEN or not view.cn0_dbhz[k, s] >= limit:
            sight = HIDDEN
            memory["below"] = True
        elif sight != UNCERTAIN_HIDDEN or view.present[k, s] == PRESENT:
            sight = VISIBLE
            memory["below"] = False
    return sight


@kernel(inline=True)
def _set_clocks(t: int, sight: int, present: int, memory: Record) -> None:
    """Start, keep or stop the clocks of the conditions that must hold for a guard time."""
    if sight != VISIBLE:
        memory["seen_since_ns"] = NEVER
    elif memory["seen_since_ns"] == NEVER:
        memory["seen_since_ns"] = t
    if sight != HIDDEN:
        memory["hidden_since_ns"] = NEVER
    elif memory["hidden_since_ns"] == NEVER:
        memory["hidden_since_ns"] = t
    if present != MISSING:
        memory["missing_since_ns"] = NEVER
    elif memory["missing_since_ns"] == NEVER:
        memory["missing_since_ns"] = t


@kernel(inline=True)
def _held(t: int, since: int, guard: int) -> bool:
    """Return whether a condition has held for its guard time."""
    return since != NEVER and t - since >= guard


@kernel(inline=True)
def _charge(t: int, memory: Record, spent: Record) -> None:
    """Add the time since the epoch before to the state it was spent in; a detection may end before the epoch."""
    if memory["last_ns"] != NEVER:
        state = memory["state"]
        if state == HOLD:
            spent["hold"] += t - memory["last_ns"]
        elif state == CONTROL_DETECTION or state == SEARCH:
            busy = max(min(t, memory["end_ns"]) - memory["last_ns"], 0)
            memory["attempt_ns"] += busy
            if state == SEARCH:
                spent["search"] += busy
            else:
                spent["control"] += busy


@kernel(inline=True)
def _charge_unsupervised(
    t: int, sight: int, present: int, rules: Rules, memory: Record, spent: Record
) -> None:
    """Carry on the receiver that searches whenever it does not track, and half a sweep once the signal is there."""
    there = present == PRESENT or (present == NOT_KNOWN and sight != HIDDEN and sight != UNDECIDED)
    left = memory["unsupervised_ns"]
    if memory["last_ns"] != NEVER and left > 0 and sight != UNDECIDED:
        step = t - memory["last_ns"]
        if there:
            spent["unsupervised"] += min(step, left)
            memory["unsupervised_ns"] = max(left - step, 0)
        else:
            spent["unsupervised"] += step
            spent["unsupervised_in_vain"] += step
    if not there:
        memory["unsupervised_ns"] = rules.half_sweep_ns


@kernel(inline=True)
def _transition(
    t: int, sight: int, view: View, k: int, s: int, rules: Rules, memory: Record, spent: Record
) -> int:
    """Enter the next state, if it is time, and return why."""
    state = memory["state"]
    after, reason = state, NONE
    if sight == UNDECIDED:
        if state != ABSENT:
            after, reason = ABSENT, PREDICTION_ENDED
    elif state == ABSENT:
        after, reason = _from_absent(sight, view.present[k, s])
    elif state == TRACK or state == RESUME:
        after, reason = _from_track(t, sight, view, k, s, rules, memory)
    elif state == HOLD or state == LOST:
        after, reason = _from_waiting(t, rules, memory)
    elif sight == HIDDEN:
        after, reason = HOLD, (HIDDEN_BY_ANTENNA if view.decision[k, s] == HIDDEN else BELOW_CN0)
    elif t >= memory["end_ns"]:
        after, reason = _from_attempt(sight, view.present[k, s], rules, memory)
    if reason != NONE:
        reason = _enter(
            t, after, reason, view.search_ns[k, s], view.within_aperture[k, s], rules, memory, spent
        )
    return reason


@kernel(inline=True)
def _from_absent(sight: int, present: int) -> tuple[int, int]:
    """Take a satellite in: as it is, if the receiver's word or the antenna settle it, else by a detection."""
    after, reason = HOLD, HIDDEN_AT_START
    if sight == VISIBLE:
        after, reason = TRY, APPEARED
        if present == PRESENT:
            after, reason = TRACK, TRACKED_AT_START
    return after, reason


@kernel(inline=True)
def _from_track(
    t: int, sight: int, view: View, k: int, s: int, rules: Rules, memory: Record
) -> tuple[int, int]:
    """Leave a signal that is hidden or lost; call it tracked once the loops have pulled in."""
    after, reason = TRACK, NONE
    if _held(t, memory["hidden_since_ns"], rules.fall_ns):
        after, reason = HOLD, (HIDDEN_BY_ANTENNA if view.decision[k, s] == HIDDEN else BELOW_CN0)
    elif _held(t, memory["missing_since_ns"], rules.loss_ns):
        after, reason = HOLD, LOST_WHILE_UNCERTAIN
        if sight == VISIBLE:
            after, reason = TRY, SIGNAL_LOST
    elif memory["state"] == RESUME and memory["missing_since_ns"] == NEVER:
        if t - memory["since_ns"] >= rules.pull_in_ns:
            reason = PULLED_IN
    return after, reason


@kernel(inline=True)
def _from_waiting(t: int, rules: Rules, memory: Record) -> tuple[int, int]:
    """Retry held and abandoned satellites when they become visible; retry abandoned ones periodically."""
    after, reason = TRY, NONE
    seen, since = memory["seen_since_ns"], memory["since_ns"]
    if _held(t, seen, rules.rise_ns):
        if memory["state"] == HOLD or seen > since:
            reason = VISIBLE_AGAIN
        elif t - since >= rules.retry_ns:
            reason = TRIED_AGAIN
    elif memory["state"] == HOLD and t - since >= rules.max_hold_ns:
        after, reason = LOST, HELD_TOO_LONG
    return after, reason


@kernel(inline=True)
def _from_attempt(sight: int, present: int, rules: Rules, memory: Record) -> tuple[int, int]:
    """Judge a detection or sweep at its end; where the receiver says nothing, a visible signal is found."""
    searching = memory["state"] == SEARCH
    if present == PRESENT or (present == NOT_KNOWN and sight == VISIBLE):
        after, reason = RESUME, (FOUND if searching else DETECTED)
    elif sight != VISIBLE:
        after, reason = HOLD, LOST_WHILE_UNCERTAIN
    elif searching:
        after, reason = SEARCH, SEARCH_FAILED
        if memory["failures"] + 1 >= rules.max_sweeps:
            after = LOST
    else:
        after, reason = CONTROL_DETECTION, CONTROL_FAILED
        if memory["failures"] + 1 >= rules.control_attempts:
            after = SEARCH
    return after, reason


@kernel(inline=True)
def _enter(
    t: int,
    after: int,
    reason: int,
    search_ns: int,
    within_aperture: bool,
    rules: Rules,
    memory: Record,
    spent: Record,
) -> int:
    """Enter a state and return why; NONE where it is the same one, with a new detection or sweep."""
    before = memory["state"]
    if before == CONTROL_DETECTION or before == SEARCH:
        if after != RESUME:
            spent["in_vain"] += memory["attempt_ns"]
            memory["failures"] += 1
    elif reason == SIGNAL_LOST and before == RESUME:
        memory["failures"] += 1  # a signal that is lost while it is pulled in was no signal
    elif after == TRY:
        memory["failures"] = 0
    if after == TRY:
        after = CONTROL_DETECTION
        if not within_aperture:
            after, reason = SEARCH, APERTURE_EXCEEDED
        elif memory["failures"] >= rules.control_attempts:
            after, reason = SEARCH, CONTROL_FAILED
    if after == CONTROL_DETECTION or after == SEARCH:
        memory["end_ns"] = t + search_ns
        memory["attempt_ns"] = 0
    if after == before:
        return NONE
    if after == SEARCH:
        memory["failures"] = 0
    memory["state"] = after
    memory["since_ns"] = t
    return reason
