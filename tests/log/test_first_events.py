"""Many events of one kind: the first reported one by one, the others counted."""

from __future__ import annotations

import numpy as np

from insgnss.log.events import MAX_EVENTS_EACH, counted, first_events, listed, shortened
from insgnss.tables import Event


def stray(k: int) -> Event:
    return Event(k, "stray", f"sample {k}")


def test_as_many_as_are_told_need_no_count() -> None:
    events = [stray(k) for k in range(MAX_EVENTS_EACH)]

    assert shortened(events, "imu.csv") == events


def test_what_is_not_told_is_counted_and_dated() -> None:
    events = shortened([stray(k) for k in range(MAX_EVENTS_EACH + 5)], "imu.csv", "samples refused")

    assert events[:-1] == [stray(k) for k in range(MAX_EVENTS_EACH)]
    assert events[-1].t_ns == MAX_EVENTS_EACH
    assert events[-1].kind == "stray"
    assert events[-1].detail == "imu.csv: 5 more such, 25 in all; samples refused"


def test_each_kind_is_counted_on_its_own() -> None:
    gaps = [Event(k, "gap", "") for k in range(3)]

    events = shortened([*gaps, *(stray(k) for k in range(30))], "imu.csv")

    assert [event.kind for event in events] == ["gap"] * 3 + ["stray"] * (MAX_EVENTS_EACH + 1)
    assert events[-1].detail == "imu.csv: 10 more such, 30 in all"


def test_details_of_one_kind_have_no_time() -> None:
    assert first_events("bad_row", ["a.csv:3: cut"], "a.csv") == [Event(None, "bad_row", "a.csv:3: cut")]


def test_a_count_names_the_file_and_the_number_and_zero_says_nothing() -> None:
    rows = np.array([True, False, True])

    assert counted("lost", rows, "row(s) left out", "a.csv") == [
        Event(None, "lost", "a.csv: 2 row(s) left out")
    ]
    assert counted("lost", 3, "row(s) left out") == [Event(None, "lost", "3 row(s) left out")]
    assert counted("lost", ~np.ones(3, np.bool_), "row(s) left out", "a.csv") == []


def test_a_list_names_what_there_is_in_its_order() -> None:
    events = listed("not_used", "not read", {"of 1010": 2, "of 7": 1}, "a.rtcm")

    assert events == [Event(None, "not_used", "a.rtcm: not read: 2 of 1010, 1 of 7")]
    assert listed("not_used", "not read", {}, "a.rtcm") == []
