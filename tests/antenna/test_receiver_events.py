"""A receiver's events beside the supervisor's words."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.antenna.visibility import HIDDEN, VISIBLE
from insgnss.constants import NS_PER_S
from insgnss.receiver.events import (
    DETECTION,
    LOCK,
    LOSS,
    SEARCHES,
    EventComparison,
    ReceiverEvents,
    compare_events,
)
from insgnss.receiver.supervisor import Predictions, Supervision, supervise
from tests.antenna.gain_history import T0_NS, predictions, spans

EVENTS = {"lock": LOCK, "loss": LOSS, "search": SEARCHES, "detection": DETECTION}


def bank() -> tuple[Predictions, Supervision]:
    """Return one satellite: tracked from 0.6 s, hidden from 10 to 30 s, tracked again from 30.8 s, until 40 s."""
    predicted = predictions(spans((VISIBLE, 10), (HIDDEN, 20), (VISIBLE, 10)))
    return predicted, supervise(predicted)


def compare(*rows: tuple[float, str], sv: str = "G05", tolerance_s: float = 1.0) -> EventComparison:
    predicted, result = bank()
    t_ns = np.array([T0_NS + round(t * NS_PER_S) for t, _ in rows], np.int64)
    events = np.array([EVENTS[word] for _, word in rows], np.int8)
    log = ReceiverEvents(t_ns, np.zeros(len(rows), np.int16), events, (sv,))
    return compare_events(log, predicted.t_ns, result.state, ("G05",), tolerance_s)


def test_supervised_receiver_agrees_throughout() -> None:
    found = compare((10.05, "loss"), (30.3, "detection"), (30.8, "lock"))
    assert found.verdicts.verdict == ["agrees"] * 3
    assert found.verdicts.supervisor == ["hold", "resume", "track"]
    # after the supervisor's entry into hold (10.0 s), control detection (30.2 s), resume (30.3 s)
    assert found.verdicts.lag_s == pytest.approx([0.05, 0.1, 0.5], abs=1e-9)
    assert (found.satellites.agree[0], found.satellites.differ[0], found.satellites.search_s[0]) == (
        3,
        0,
        0.0,
    )


def test_unsupervised_receiver_searched_what_was_hidden() -> None:
    found = compare((10.2, "loss"), (10.3, "search"), (33.4, "detection"), (33.5, "lock"))
    assert found.verdicts.verdict == ["agrees", "search_while_hidden", "agrees", "agrees"]
    assert found.satellites.search_s[0] == pytest.approx(23.1, abs=1e-9)
    assert found.satellites.inhibited_s[0] == pytest.approx(30.2 - 10.3, abs=1e-9)
    assert found.satellites.needless_s[0] == pytest.approx(33.4 - 30.2, abs=1e-9)


def test_false_lock_while_hidden_is_called_so() -> None:
    found = compare((10.1, "loss"), (15.0, "detection"), (16.0, "lock"))
    assert found.verdicts.verdict == ["agrees", "detection_while_hidden", "lock_while_hidden"]


def test_loss_in_full_view_was_not_predicted() -> None:
    found = compare((5.0, "loss"), (5.1, "search"), (5.5, "lock"))
    assert found.verdicts.verdict == ["loss_not_predicted", "search_while_tracked", "agrees"]
    assert found.verdicts.lag_s[0] == pytest.approx(-5.0, abs=1e-9) and np.isnan(found.verdicts.lag_s[1])
    assert found.satellites.needless_s[0] == pytest.approx(0.4, abs=1e-9)


def test_search_in_place_of_a_control_detection_is_called_so() -> None:
    assert compare((30.25, "search"), tolerance_s=0.01).verdicts.verdict == ["search_for_control_detection"]


def test_tolerance_decides_what_is_near() -> None:
    assert compare((9.5, "loss"), tolerance_s=0.6).verdicts.verdict == ["agrees"]
    assert compare((9.5, "loss"), tolerance_s=0.4).verdicts.verdict == ["loss_not_predicted"]


def test_tolerance_reaches_back_as_well() -> None:
    assert compare((10.3, "detection"), tolerance_s=0.5).verdicts.verdict == ["agrees"]
    assert compare((10.3, "detection"), tolerance_s=0.2).verdicts.verdict == ["detection_while_hidden"]


def test_search_without_an_end_lasts_to_the_end_and_one_told_twice_counts_once() -> None:
    found = compare((35.0, "search"), (36.0, "search"))
    assert found.satellites.search_s[0] == pytest.approx(4.9, abs=1e-9)


@pytest.mark.parametrize(("sv", "time_s"), [("G06", 5.0), ("G05", -3.0), ("G05", 99.0)])
def test_what_the_supervisor_did_not_see_is_not_covered(sv: str, time_s: float) -> None:
    found = compare((time_s, "lock"), sv=sv)
    assert found.verdicts.verdict == ["not_covered"] and found.satellites.not_covered[0] == 1


def test_counts_add_up_to_the_log() -> None:
    found = compare(
        (-1.0, "lock"), (5.0, "loss"), (10.1, "loss"), (15.0, "search"), (39.0, "lock")
    ).satellites
    assert found.events[0] == found.agree[0] + found.differ[0] + found.not_covered[0] == 5
