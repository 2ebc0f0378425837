"""Inertial time tags: what is refused so that time strictly increases, and what is only told."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.errors import TimeError
from insgnss.log.imu.time import gap_events, increasing_samples
from insgnss.tables import Int64

STEP = 10_000_000


def tags(n: int = 200) -> Int64:
    return np.arange(n, dtype=np.int64) * STEP


def kinds(t_ns: Int64) -> tuple[list[int], list[str]]:
    kept, events = increasing_samples(t_ns, "imu.csv")
    assert kept is not None
    assert (np.diff(t_ns[kept]) > 0).all()
    return sorted(set(range(len(t_ns))) - set(kept.tolist())), [event.kind for event in events]


def test_increasing_tags_are_all_kept_without_an_event() -> None:
    assert increasing_samples(tags(), "imu.csv") == (None, [])


def test_repeated_tag_refuses_the_later_sample() -> None:
    t = np.insert(tags(), 50, 49 * STEP)
    assert kinds(t) == ([50], ["imu_time_duplicate"])


def test_tag_that_falls_back_by_one_sample_is_refused() -> None:
    t = tags()
    t[50] = 47 * STEP + 5
    assert kinds(t) == ([50], ["imu_time_backwards"])


@pytest.mark.parametrize("count", [1, 2, 3])
def test_tags_ahead_of_both_neighbours_are_refused_instead_of_what_follows(count: int) -> None:
    t = tags()
    t[50 : 50 + count] += 100 * STEP
    assert kinds(t) == (list(range(50, 50 + count)), ["imu_time_spike"])


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5])
@pytest.mark.parametrize("off_s", [-3e5, -500.0, -1.5, 1.5, 500.0, 3e5])
@pytest.mark.parametrize("where", ["head", "middle", "tail", "last but one"])
def test_stray_tags_go_and_every_other_sample_stays(where: str, off_s: float, count: int) -> None:
    t = tags(2000) + 10**15
    start = {"head": 0, "middle": 700, "tail": len(t) - count, "last but one": len(t) - count - 1}[where]
    t[start : start + count] += round(off_s * 1e9)
    refused, events = kinds(t)
    assert refused == list(range(start, start + count))
    kind = "imu_time_backwards" if off_s < 0 and where != "head" else "imu_time_spike"
    assert events == [kind]


@pytest.mark.parametrize("seed", range(20))
def test_stray_tags_all_over_the_log_cost_only_themselves(seed: int) -> None:
    rng = np.random.default_rng(seed)
    t = tags(3000)
    wrong = np.unique(np.concatenate(([0, 2, 2999], rng.choice(3000, 40, replace=False))))
    t[wrong] += rng.choice([-1, 1], len(wrong)) * rng.integers(40, 10**6, len(wrong)) * 10**9
    refused, events = kinds(t)
    assert refused == wrong.tolist()
    _, told = increasing_samples(t, "imu.csv")
    assert set(events) <= {"imu_time_spike", "imu_time_backwards"} and len(told) <= 42


def test_events_count_the_stray_tags_and_tell_how_far_they_are() -> None:
    t = tags()
    t[:3] += 10**12
    t[-2:] += 10**12
    _, events = increasing_samples(t, "imu.csv")
    assert [event.detail for event in events] == [
        "imu.csv: 3 time tag(s) ahead of what follows, by 999.99 s; sample(s) refused",
        "imu.csv: 2 time tag(s) at an end of the log, 1000.01 s from the others; sample(s) refused",
    ]


def test_clock_set_back_after_a_short_start_keeps_what_follows() -> None:
    t = np.concatenate([tags(300) + 1000 * STEP, tags(500)])
    assert kinds(t) == (list(range(300)), ["imu_time_set_back"])


def test_samples_beyond_a_gap_stay_when_they_are_more_than_a_few() -> None:
    t = tags()
    t[-6:] += 10**10
    t[:6] -= 10**10
    assert increasing_samples(t, "imu.csv") == (None, [])


def test_clock_set_back_keeps_the_increasing_part_and_says_so() -> None:
    t = np.concatenate([tags(500), tags(500) + 200 * STEP])
    refused, events = kinds(t)
    assert refused == list(range(500, 800))
    assert events == ["imu_time_set_back"]


def test_clock_that_is_set_back_for_good_refuses_all_that_follows() -> None:
    t = np.concatenate([tags(500) + 1000 * STEP, tags(300)])
    refused, events = kinds(t)
    assert refused == list(range(500, 800))
    assert events == ["imu_time_set_back"]


def test_many_repeated_tags_are_told_twenty_times_and_counted() -> None:
    t = np.sort(np.concatenate([tags(200), tags(200)[:50]]))
    refused, events = kinds(t)
    assert len(refused) == 50
    assert len(events) == 21


def test_column_that_mostly_repeats_is_an_error() -> None:
    with pytest.raises(TimeError, match="enough digits"):
        increasing_samples(tags() // (100 * STEP) * 100 * STEP, "imu.csv")


@pytest.mark.parametrize(
    ("gap_s", "told"), [(0.02, False), (0.049, False), (0.1, True), (1.0, True), (10.0, True)]
)
def test_gaps_are_told_with_start_and_length(gap_s: float, told: bool) -> None:
    t = tags()
    t[100:] += round(gap_s * 1e9) - STEP
    events = gap_events(t, np.diff(t), STEP, "imu.csv")
    assert len(events) == told
    if told:
        assert events[0].t_ns == t[99]
        assert f"{gap_s:g} s" in events[0].detail


def test_steps_of_a_slow_log_are_no_gaps() -> None:
    t = tags() * 20
    assert not gap_events(t, np.diff(t), 20 * STEP, "imu.csv")
