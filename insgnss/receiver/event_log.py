"""Logs of a receiver's own events, as CSV: ``time_s, sv, event`` with the events lock, loss, search, detection."""

from __future__ import annotations

import difflib
from pathlib import Path

import numpy as np

from insgnss.config.log_table import LogTable, TimeScale
from insgnss.errors import ColumnError
from insgnss.log.csv.columns import ColumnSelection
from insgnss.log.csv.table import CsvTable
from insgnss.log.csv.time_tags import read_timed_table
from insgnss.log.satellites import normalised_name
from insgnss.receiver.events import EVENT_NAMES, ReceiverEvents
from insgnss.tables import Event, Int64


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
