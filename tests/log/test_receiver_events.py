"""Logs of a receiver's events: read, sorted, and every bad word named with its line."""

from __future__ import annotations

from pathlib import Path

import pytest

from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.errors import ColumnError, InputError, MissingFileError
from insgnss.receiver.events import read_receiver_events
from tests.log.writing import WEEK, write_lines

HEADER = "time_s,sv,event"


def test_log_is_read_with_names_in_one_form(tmp_path: Path) -> None:
    path = write_lines(tmp_path / "e.csv", [HEADER, "10.5,G05,loss", "11,g7,Search", "12.25,G 5,lock"])
    log, events = read_receiver_events(path, WEEK)
    assert ((log.t_ns - WEEK * NS_PER_WEEK) / NS_PER_S).tolist() == [10.5, 11.0, 12.25]
    assert log.sv_names == ("G05", "G07") and log.sv.tolist() == [0, 1, 0]
    assert log.event.tolist() == [1, 2, 0] and events == []


def test_rows_out_of_order_are_sorted_and_twins_count_once(tmp_path: Path) -> None:
    path = write_lines(tmp_path / "e.csv", [HEADER, "12,G05,lock", "10,G05,loss", "12,G05,lock"])
    log, events = read_receiver_events(path, WEEK)
    assert log.event.tolist() == [1, 0]
    assert [event.kind for event in events] == ["receiver_events_order", "receiver_events_repeated"]


def test_events_of_one_time_keep_the_order_of_the_file(tmp_path: Path) -> None:
    path = write_lines(tmp_path / "e.csv", [HEADER, "10,G05,search", "10,G05,loss", "10,G05,detection"])
    assert read_receiver_events(path, WEEK)[0].event.tolist() == [2, 1, 3]


def test_unknown_word_names_its_line_and_the_nearest_event(tmp_path: Path) -> None:
    path = write_lines(tmp_path / "e.csv", [HEADER, "10,G05,loss", "11,G05,detektion"])
    with pytest.raises(ColumnError, match="nearest: 'detection'") as error:
        read_receiver_events(path, WEEK)
    assert (error.value.line, error.value.column) == (3, "event")


def test_name_that_is_no_satellite_names_its_line(tmp_path: Path) -> None:
    path = write_lines(tmp_path / "e.csv", [HEADER, "10,G05,loss", "11,Q99,lock"])
    with pytest.raises(ColumnError, match="Q99") as error:
        read_receiver_events(path, WEEK)
    assert (error.value.line, error.value.column) == (3, "sv")


def test_missing_column_file_and_rows_are_typed(tmp_path: Path) -> None:
    with pytest.raises(ColumnError, match="'event'"):
        read_receiver_events(write_lines(tmp_path / "a.csv", ["time_s,sv,state", "1,G05,lock"]), WEEK)
    with pytest.raises(InputError):
        read_receiver_events(write_lines(tmp_path / "b.csv", [HEADER]), WEEK)
    with pytest.raises(MissingFileError):
        read_receiver_events(tmp_path / "none.csv", WEEK)


def test_row_without_a_time_is_refused_aloud(tmp_path: Path) -> None:
    rows = [f"{t},G05,lock" for t in range(30)]
    path = write_lines(tmp_path / "e.csv", [HEADER, *rows, "later,G05,loss"])
    log, events = read_receiver_events(path, WEEK)
    assert len(log.t_ns) == 30 and [event.kind for event in events] == ["bad_row"]
