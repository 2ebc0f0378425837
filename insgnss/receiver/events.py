"""A receiver's own events: read from CSV (``time_s, sv, event``), and compared with the supervisor's decisions."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from insgnss.config.log_table import LogTable, TimeScale
from insgnss.constants import NS_PER_S
from insgnss.errors import ColumnError
from insgnss.log.csv.columns import ColumnSelection
from insgnss.log.csv.table import CsvTable
from insgnss.log.csv.time_tags import read_timed_table
from insgnss.log.satellites import normalised_name
from insgnss.receiver.tracking_state import (
    ABSENT,
    CONTROL_DETECTION,
    HOLD,
    LOST,
    RESUME,
    SEARCH,
    STATE_NAMES,
    TRACK,
)
from insgnss.tables import Event, Float64, Int8, Int16, Int64

# Events of a receiver
LOCK: Final = 0  # its loops are closed
LOSS: Final = 1  # they are open
SEARCHES: Final = 2  # it begins to search
DETECTION: Final = 3  # it found a signal
EVENT_NAMES: Final = ("lock", "loss", "search", "detection")

# What comes of the comparison
VERDICT_NAMES: Final = (
    "not_covered",
    "agrees",
    "lock_while_hidden",
    "lock_not_expected",
    "loss_not_predicted",
    "search_while_hidden",
    "search_while_tracked",
    "search_for_control_detection",
    "search_for_what_was_given_up",
    "detection_while_hidden",
    "detection_not_expected",
)
_VERDICT: Final = {name: code for code, name in enumerate(VERDICT_NAMES)}
NOT_COVERED: Final = _VERDICT["not_covered"]  # the supervisor has no such satellite, or none at that time
AGREES: Final = _VERDICT["agrees"]

# States in which the supervisor expects each event, and the verdict in each other state that says more
_EXPECTED: Final = {
    LOCK: (TRACK, RESUME),
    LOSS: (HOLD, CONTROL_DETECTION, SEARCH, LOST),
    SEARCHES: (SEARCH,),
    DETECTION: (TRACK, RESUME, CONTROL_DETECTION, SEARCH),
}
_OTHERWISE: Final[dict[int, dict[int | None, str]]] = {
    LOCK: {HOLD: "lock_while_hidden", None: "lock_not_expected"},
    LOSS: {None: "loss_not_predicted"},
    SEARCHES: {
        HOLD: "search_while_hidden",
        CONTROL_DETECTION: "search_for_control_detection",
        LOST: "search_for_what_was_given_up",
        None: "search_while_tracked",
    },
    DETECTION: {HOLD: "detection_while_hidden", None: "detection_not_expected"},
}


class ReceiverEvents(NamedTuple):
    """The log of a receiver's events, by time."""

    t_ns: Int64  # (n,) GPS time
    sv: Int16  # (n,) index into ``sv_names``
    event: Int8  # (n,) LOCK, LOSS, SEARCHES, DETECTION
    sv_names: tuple[str, ...]


class EventVerdicts(NamedTuple):
    """One entry for each event, in the log's order; ``_asdict()`` makes the columns of a table."""

    t_ns: Int64
    sv: list[str]
    event: list[str]
    supervisor: list[str]  # its state at that time
    verdict: list[str]
    lag_s: Float64  # event minus the supervisor's nearest entry into a state that expects it; NaN without one


class SatelliteComparison(NamedTuple):
    """One entry for each satellite of the log."""

    sv: tuple[str, ...]
    events: Int64
    agree: Int64
    differ: Int64
    not_covered: Int64
    search_s: Float64  # the receiver's, from the beginning of a search to the next other event
    inhibited_s: Float64  # of it, while the supervisor holds: searched in vain
    needless_s: Float64  # of it, while the supervisor expects the signal at the predicted place


class EventComparison(NamedTuple):
    """A receiver's log compared with the supervisor's history."""

    verdicts: EventVerdicts
    satellites: SatelliteComparison


def compare_events(
    log: ReceiverEvents,
    t_ns: Int64,
    state: Int8,
    sv_names: tuple[str, ...],
    tolerance_s: float = 1.0,
) -> EventComparison:
    """Return whether each event agrees with the supervisor, and how long the receiver searched in vain.

    An event agrees if any of the supervisor's states within the tolerance expects it; otherwise the verdict is by the
    state at the time of the event. An event outside the supervisor's time is not covered.

    Parameters
    ----------
    t_ns, state : (n,), (n, m) the supervisor's history; a state holds until the next epoch
    sv_names : names of its m satellites
    tolerance_s : how far the times may lie apart
    """
    tolerance_ns = round(tolerance_s * NS_PER_S)
    column = {name: i for i, name in enumerate(sv_names)}
    places = np.array([column.get(name, -1) for name in log.sv_names], np.int64)
    verdict = np.zeros(len(log.t_ns), np.int64)
    at = np.zeros(len(log.t_ns), np.int64)
    lag_s = np.full(len(log.t_ns), np.nan)
    for i, (t, event) in enumerate(zip(log.t_ns, log.event, strict=True)):
        s = int(places[log.sv[i]])
        if s < 0 or not len(t_ns) or not t_ns[0] <= t <= t_ns[-1]:
            continue
        at[i] = state[np.searchsorted(t_ns, t, side="right") - 1, s]
        verdict[i], lag_s[i] = _judge(int(t), int(event), t_ns, state[:, s], int(at[i]), tolerance_ns)
    verdicts = EventVerdicts(
        log.t_ns,
        [log.sv_names[i] for i in log.sv],
        [EVENT_NAMES[i] for i in log.event],
        [STATE_NAMES[i] for i in at],
        [VERDICT_NAMES[i] for i in verdict],
        lag_s,
    )
    return EventComparison(verdicts, _by_satellite(log, verdict, t_ns, state, places))


def _judge(t: int, event: int, t_ns: Int64, state: Int8, at: int, tolerance_ns: int) -> tuple[int, float]:
    """Return the verdict on one event and its lag [s]."""
    if at == ABSENT:
        return NOT_COVERED, np.nan
    expects = np.isin(state, _EXPECTED[event])
    before = np.concatenate([[ABSENT], state[:-1]])
    # a loss begins where the signal was tracked, not where a satellite is looked for that was never seen
    begins = np.isin(before, _EXPECTED[LOCK]) if event == LOSS else ~np.isin(before, _EXPECTED[event])
    entered = t_ns[expects & begins]
    lag_s = np.nan
    if len(entered):
        nearest = int(entered[np.argmin(np.abs(entered - t))])
        lag_s = (t - nearest) / NS_PER_S
    first = max(int(np.searchsorted(t_ns, t - tolerance_ns, side="right")) - 1, 0)
    last = int(np.searchsorted(t_ns, t + tolerance_ns, side="right"))
    if expects[first:last].any():
        return AGREES, lag_s
    otherwise = _OTHERWISE[event]
    return _VERDICT[otherwise.get(at, otherwise[None])], lag_s


def _by_satellite(
    log: ReceiverEvents, verdict: Int64, t_ns: Int64, state: Int8, places: Int64
) -> SatelliteComparison:
    n = len(log.sv_names)
    agree = np.bincount(log.sv[verdict == AGREES], minlength=n)
    uncovered = np.bincount(log.sv[verdict == NOT_COVERED], minlength=n)
    events = np.bincount(log.sv, minlength=n)
    seconds = np.zeros((3, n))
    for i in range(n):
        for begin, end in _searches(log, i, t_ns):
            seconds[0, i] += (end - begin) / NS_PER_S
            if places[i] >= 0:
                of_satellite = state[:, places[i]]
                seconds[1, i] += _time_in((HOLD,), begin, end, t_ns, of_satellite)
                seconds[2, i] += _time_in((TRACK, RESUME, CONTROL_DETECTION), begin, end, t_ns, of_satellite)
    differ = events - agree - uncovered
    return SatelliteComparison(log.sv_names, events, agree, differ, uncovered, *seconds)


def _searches(log: ReceiverEvents, sv: int, t_ns: Int64) -> list[tuple[int, int]]:
    """Return beginning and end of each search of a satellite; the last one may last until the supervisor's end."""
    mine = log.sv == sv
    times, events = log.t_ns[mine], log.event[mine]
    # a search that is announced again goes on
    changes = np.flatnonzero(np.concatenate([[True], np.diff(events == SEARCHES) != 0])[: len(events)])
    found = []
    for k, first in enumerate(changes):
        if events[first] == SEARCHES:
            open_end = max(int(times[-1]), int(t_ns[-1]) if len(t_ns) else int(times[-1]))
            end = int(times[changes[k + 1]]) if k + 1 < len(changes) else open_end
            found.append((int(times[first]), end))
    return found


def _time_in(states: tuple[int, ...], begin: int, end: int, t_ns: Int64, state: Int8) -> float:
    """Return how long between two times the supervisor's state was one of these [s]."""
    start = np.clip(t_ns[:-1], begin, end)
    stop = np.clip(t_ns[1:], begin, end)
    return float(np.sum((stop - start)[np.isin(state[:-1], states)]) / NS_PER_S)


def read_receiver_events(
    path: Path, week: int, scale: TimeScale | None = None
) -> tuple[ReceiverEvents, list[Event]]:
    """Read a log of events; rows are sorted by time, a repeated row counts once.

    Raises
    ------
    InputError or a subclass : the file or a column is missing
    ColumnError : an event or a satellite is unknown; the error names the line and the nearest event
    """
    times = LogTable(time=TimeScale() if scale is None else scale)
    t_ns, table = read_timed_table(path, times, ColumnSelection(text=("sv", "event")), week)
    word_code = np.array([_event_code(word, table) for word in table.text["event"].words], np.int64)
    names = [_satellite(word, table) for word in table.text["sv"].words]
    sv_names = tuple(sorted(set(names)))
    name_code = np.array([sv_names.index(name) for name in names], np.int64)
    sv, event = name_code[table.text["sv"].codes], word_code[table.text["event"].codes]
    kept, noticed = _in_order(t_ns, sv, event, path)
    log = ReceiverEvents(t_ns[kept], sv[kept].astype(np.int16), event[kept].astype(np.int8), sv_names)
    return log, table.events + noticed


def _event_code(word: str, table: CsvTable) -> int:
    text = word.strip().lower()
    if text in EVENT_NAMES:
        return EVENT_NAMES.index(text)
    near = difflib.get_close_matches(text, EVENT_NAMES, n=1, cutoff=0.5)
    hint = f"nearest: '{near[0]}'; " if near else ""
    raise ColumnError(
        f"unknown receiver event '{word}'",
        file=table.path,
        line=_line_of(word, "event", table),
        column="event",
        advice=f"{hint}events are {', '.join(EVENT_NAMES)}",
    )


def _satellite(word: str, table: CsvTable) -> str:
    name = normalised_name(word)
    if name is None:
        raise ColumnError(
            f"unknown satellite '{word}'",
            file=table.path,
            line=_line_of(word, "sv", table),
            column="sv",
            advice="write the system's letter and the number, as RINEX 3 does: G05",
        )
    return name


def _line_of(word: str, column: str, table: CsvTable) -> int | None:
    text = table.text[column]
    rows = np.flatnonzero(text.codes == text.words.index(word))
    return int(table.line[rows[0]]) if len(rows) else None


def _in_order(t_ns: Int64, sv: Int64, event: Int64, path: Path) -> tuple[Int64, list[Event]]:
    """Return the rows to keep, by time and stable, and the events."""
    order = np.argsort(t_ns, kind="stable")
    noticed = []
    if np.any(np.diff(t_ns) < 0):
        noticed.append(Event(None, "receiver_events_order", f"{path}: rows sorted by time"))
    keys = np.column_stack([t_ns, sv, event])[order]
    _, first = np.unique(keys, axis=0, return_index=True)
    if len(first) < len(keys):
        detail = f"{path}: {len(keys) - len(first)} repeated row(s) count once"
        noticed.append(Event(None, "receiver_events_repeated", detail))
    return np.asarray(order[np.sort(first)], np.int64), noticed
