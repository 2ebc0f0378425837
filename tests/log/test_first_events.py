"""Many events of one kind: the first reported one by one, the others counted."""

from __future__ import annotations

from insgnss.log.events import MAX_EVENTS_EACH, first_events, shortened
from insgnss.tables import Event


def stray(k: int) -> Event:
    return Event(k, "stray", f"sample {k}")


def test_as_many_as_are_told_need_no_count() -> None:
    assert first_events(range(MAX_EVENTS_EACH), stray, "imu.csv") == [
        stray(k) for k in range(MAX_EVENTS_EACH)
    ]


def test_what_is_not_told_is_counted_and_dated() -> None:
    events = first_events(range(MAX_EVENTS_EACH + 5), stray, "imu.csv", "samples refused")

    assert events[:-1] == [stray(k) for k in range(MAX_EVENTS_EACH)]
    assert events[-1].t_ns == MAX_EVENTS_EACH
    assert events[-1].kind == "stray"
    assert events[-1].detail == "imu.csv: 5 more such, 25 in all; samples refused"


def test_each_kind_is_counted_on_its_own() -> None:
    gaps = [Event(k, "gap", "") for k in range(3)]

    events = shortened([*gaps, *(stray(k) for k in range(30))], "imu.csv")

    assert [event.kind for event in events] == ["gap"] * 3 + ["stray"] * (MAX_EVENTS_EACH + 1)
    assert events[-1].detail == "imu.csv: 10 more such, 30 in all"
