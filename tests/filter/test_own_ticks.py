"""Own rows at ticks without end, kinds that contradict, and headings that lose weight once."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from insgnss.constants import NS_PER_S
from insgnss.errors import MeasurementError
from insgnss.filter.layout_names import StateLayout
from insgnss.filter.own_rows.contradiction import changes, contradicting, watch
from insgnss.filter.own_rows.declared import own_measurements
from insgnss.filter.own_rows.ledger import OwnEntry, complete_ledger
from insgnss.filter.own_rows.state_estimate import LONGEST_WINDOW_S, state_estimate
from insgnss.filter.own_update import use_own_rows
from insgnss.filter.prediction import ImuSamples, new_scratch
from insgnss.filter.state import MAX_WATCHED, OFFSETS, joined_banks
from insgnss.status import USED
from tests.filter.scene import START_NS, attitude, new_filter, place
from tests.filter.test_own_update import AT, IMU, giving, setup_with

SECOND: Any = SimpleNamespace(name="ticking", period_ns=NS_PER_S, rows=lambda state, layout: (), watched=True)


def test_ticks_are_whole_multiples_of_the_period_beside_listed_times() -> None:
    listed = giving((), times_ns=np.array([5, 3 * NS_PER_S]))
    own = own_measurements([SECOND, listed])
    assert own is not None
    assert own.due(-NS_PER_S, 3 * NS_PER_S) == [0, 5, NS_PER_S, 2 * NS_PER_S, 3 * NS_PER_S]
    assert own.due(NS_PER_S, 2 * NS_PER_S - 1) == []
    assert [kind.name for kind in own.at(3 * NS_PER_S)] == ["ticking", "mine"]
    assert [kind.name for kind in own.at(5)] == ["mine"]
    epochs = np.array([1, 2, NS_PER_S, NS_PER_S + 1, 3 * NS_PER_S])
    assert [own.epochs_before_next(epochs, epoch, 5) for epoch in range(4)] == [2, 2, 4, 4]


def test_ledger_has_the_ticks_that_were_taken_and_all_listed_times() -> None:
    own = own_measurements([SECOND, giving((), times_ns=np.array([5, 7 * NS_PER_S]))])
    assert own is not None
    found = {NS_PER_S: [OwnEntry(NS_PER_S, "ticking", 0.1, 1.0, USED)]}
    entries = complete_ledger(own, found, [(0, 4 * NS_PER_S)], (-(2**62), 2**62))
    assert [(entry.t_ns, entry.kind) for entry in entries] == [
        (5, "mine"),
        (NS_PER_S, "ticking"),
        (7 * NS_PER_S, "mine"),
    ]


@pytest.mark.parametrize("period", [0, -5, 1.0, True, 10])
def test_impossible_period_is_refused(period: Any) -> None:
    with pytest.raises(MeasurementError, match="period_ns of measurement 'mine'"):
        own_measurements([SimpleNamespace(name="mine", period_ns=period, rows=lambda state, layout: ())])


def test_recent_samples_are_those_up_to_the_time_and_read_only() -> None:
    t_ns = START_NS + np.arange(-100, 5) * 10_000_000
    imu = ImuSamples(t_ns, np.arange(315.0).reshape(105, 3), np.zeros((105, 3)))
    bank = new_filter(place())
    state = state_estimate(bank.state[0], START_NS, imu.w_ib_b[0], imu.f_b[0], StateLayout({}), imu)
    found = state.recent(0.25)
    np.testing.assert_array_equal(found.t_ns, t_ns[76:101])
    np.testing.assert_array_equal(found.w_ib_b, imu.w_ib_b[76:101])
    assert not found.unknown and len(state.recent(5.0).t_ns) == 101
    with pytest.raises(ValueError, match="read-only"):
        found.w_ib_b[0, 0] = 1.0
    with pytest.raises(ValueError, match="0 to 5 s"):
        state.recent(LONGEST_WINDOW_S + 0.1)


def watched_with(
    nis: float, seconds: int, head: Any, begin: int = 0, variances: tuple[float, float] = (1.0, 0.5)
) -> list[str]:
    """Return the events of a kind with rows of a normalised squared innovation once a second.

    ``variances``: of the innovation, and of its prediction alone.
    """
    own = own_measurements([SECOND])
    assert own is not None
    told = []
    S, predicted = variances[0], np.array([variances[1]])
    for k in range(begin, begin + seconds):
        before = contradicting(head, own.kinds)
        entry = OwnEntry(k, "ticking", math.sqrt(nis * S), S, USED)
        watch(head, own.kinds, [entry], predicted, START_NS + k * NS_PER_S)
        told += [event.kind for event in changes(before, head, own.kinds, k)]
    return told


def test_kind_whose_rows_are_off_is_not_used_until_they_agree_again() -> None:
    head = new_filter(place()).head[0]
    assert watched_with(1.0, 100, head) == []
    assert watched_with(16.0, 10, head, 100) == ["rows_contradict"]
    assert watched_with(0.5, 60, head, 110) == ["rows_agree"]
    assert watched_with(1e6, 1, head, 170) == []  # one wild row is no contradiction


@pytest.mark.parametrize(("off_sigma", "shows_at"), [(4.0, 1.7), (30.0, 99.0)])
def test_rows_do_not_agree_by_a_prediction_that_has_grown_vague(off_sigma: float, shows_at: float) -> None:
    """Four sigma off are 1.3 sigma of a prediction ten times as vague; thirty sigma off still show there."""
    head = new_filter(place()).head[0]
    head.epoch_ns = START_NS + 8 * NS_PER_S
    assert watched_with(off_sigma**2, 10, head) == ["rows_contradict"]
    assert watched_with(0.1, 60, head, 10, (400.5, 400.0)) == []
    assert watched_with(0.1, 60, head, 70, (shows_at + 0.5, shows_at)) == ["rows_agree"]


def test_rows_that_only_a_filter_without_gnss_contradicts_agree_as_it_grows_vague() -> None:
    head = new_filter(place()).head[0]
    head.epoch_ns = START_NS - 60 * NS_PER_S
    assert watched_with(16.0, 10, head) == ["rows_contradict"]
    assert watched_with(0.1, 60, head, 10, (400.5, 400.0)) == ["rows_agree"]


def test_heading_loses_its_odds_once_and_not_at_each_tick() -> None:
    """Two headings at equal weights; the second does what is unlikely, at three ticks."""
    north, south = new_filter(AT), new_filter(AT, C_eb=attitude(AT, 0.0, 0.0, 180.0))
    bank = joined_banks(north, south)
    bank.state["log_weight"] = -math.log(2.0)
    measurement = giving(())
    measurement.unlikely = lambda state: math.log(1e-3) if abs(state.yaw_rad) > 1.5 else 0.0
    measurement.times_ns = START_NS + np.arange(3)
    setup = setup_with(measurement)
    for k in range(3):
        use_own_rows(bank, START_NS + k, setup, IMU, setup.parameters(), new_scratch(OFFSETS))
    odds = math.exp(bank.state[1].log_weight - bank.state[0].log_weight)
    assert odds == pytest.approx(1e-3)


def test_kind_that_gives_one_heading_no_rows_gives_none_to_all() -> None:
    north, south = new_filter(AT), new_filter(AT, C_eb=attitude(AT, 0.0, 0.0, 180.0))
    bank = joined_banks(north, south)
    bank.state["log_weight"] = -math.log(2.0)
    measurement = giving(())
    measurement.rows = lambda state, layout: (
        [(0.0, {"position": np.ones(3)}, 1.0)] * (abs(state.yaw_rad) > 1.5)
    )
    setup = setup_with(measurement)
    before = bank.P.tobytes()
    assert use_own_rows(bank, START_NS, setup, IMU, setup.parameters(), new_scratch(OFFSETS)).entries == []
    assert bank.P.tobytes() == before


def test_more_watched_measurements_than_there_is_room_for_are_an_error() -> None:
    names = [f"kind_{i}" for i in range(MAX_WATCHED + 1)]
    kinds: list[Any] = [
        SimpleNamespace(name=name, period_ns=NS_PER_S, rows=lambda state, layout: (), watched=True)
        for name in names
    ]
    with pytest.raises(
        MeasurementError, match=f"{MAX_WATCHED + 1} measurements have 'watched' or 'tells_heading' set"
    ):
        own_measurements(kinds)
    own = own_measurements(kinds[:MAX_WATCHED])
    assert own is not None and [kind.watch for kind in own.kinds] == list(range(MAX_WATCHED))
