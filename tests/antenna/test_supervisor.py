"""The search supervisor on scripted gain histories: every transition, every guard, and what it must never do."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.antenna.visibility import HIDDEN, UNCERTAIN_HIDDEN, UNCERTAIN_VISIBLE, UNDECIDED, VISIBLE
from insgnss.config.search import Guards, Search
from insgnss.receiver.supervisor import Predictions, Supervision, supervise
from insgnss.receiver.tracking_state import (
    CONTROL_DETECTION,
    HOLD,
    MISSING,
    NOT_KNOWN,
    PRESENT,
    REASON_NAMES,
    RESUME,
    SEARCH,
    STATE_NAMES,
    TRACK,
)
from tests.antenna.gain_history import STEP_S, predictions, spans, story

STARTED = [(0.0, "control_detection", "appeared"), (0.1, "resume", "detected"), (0.6, "track", "pulled_in")]
BEYOND_M2 = 60.0**2  # 3 sigma: 180 m, the aperture is 147 m


def test_bank_is_held_checked_and_resumed() -> None:
    result = supervise(predictions(spans((VISIBLE, 5), (HIDDEN, 20), (VISIBLE, 5))))
    assert story(result) == [
        *STARTED,
        (5.0, "hold", "hidden"),
        (25.2, "control_detection", "visible_again"),
        (25.3, "resume", "detected"),
        (25.8, "track", "pulled_in"),
    ]
    assert result.totals.search_s[0] == 0.0
    # in hold from 5.0 to 25.2 s
    assert result.totals.hold_s[0] == pytest.approx(20.2, abs=1e-9)


def test_satellite_that_the_receiver_tracks_is_tracked_from_the_start() -> None:
    result = supervise(predictions(n=5), present=np.full((5, 1), PRESENT))
    assert story(result) == [(0.0, "track", "tracked_at_start")]


def test_satellite_hidden_at_the_start_is_held() -> None:
    result = supervise(predictions(spans((HIDDEN, 2), (VISIBLE, 1))))
    assert story(result)[:2] == [
        (0.0, "hold", "hidden_at_start"),
        (2.2, "control_detection", "visible_again"),
    ]


def test_extrapolation_beyond_the_aperture_is_searched() -> None:
    d = spans((1.0, 5), (BEYOND_M2, 25))
    result = supervise(predictions(spans((VISIBLE, 5), (HIDDEN, 20), (VISIBLE, 5)), d_range_m2=d))
    assert story(result)[3:] == [
        (5.0, "hold", "hidden"),
        (25.2, "search", "aperture_exceeded"),
        (25.3, "resume", "found"),
        (25.8, "track", "pulled_in"),
    ]
    row = np.flatnonzero(result.transitions.after == SEARCH)[0]
    assert result.transitions.sigma_delay_m[row] == 60.0
    assert result.transitions.delay_cells[row] == 3.0  # 360 m over steps of 146.5 m
    # -100 m/s over 0.1903 m: positive Doppler is a shrinking distance
    assert result.transitions.doppler_hz[row] == pytest.approx(-525.50, abs=0.01)


def test_doppler_beyond_the_aperture_is_searched_too() -> None:
    rate = spans((0.01, 5), (4.0, 25))  # 3 sigma: 31.5 Hz, the aperture is 25 Hz
    result = supervise(predictions(spans((VISIBLE, 5), (HIDDEN, 20), (VISIBLE, 5)), d_rate_m2ps2=rate))
    assert story(result)[4] == (25.2, "search", "aperture_exceeded")


def test_failed_control_detection_becomes_a_search_and_then_lost() -> None:
    decision = spans((VISIBLE, 5), (HIDDEN, 5), (VISIBLE, 40))
    present = spans((PRESENT, 5), (MISSING, 45)).astype(int)[:, None]
    result = supervise(predictions(decision), present)
    assert story(result) == [
        (0.0, "track", "tracked_at_start"),
        (5.0, "hold", "hidden"),
        (10.2, "control_detection", "visible_again"),
        (10.3, "search", "control_failed"),
        (10.6, "lost", "search_failed"),  # three sweeps, each judged at the next epoch
        (40.6, "control_detection", "tried_again"),
        (40.7, "search", "control_failed"),
        (41.0, "lost", "search_failed"),
    ]
    T = 10.0 ** ((12.50099 + 2.5 - 45.0) / 10.0)  # one cell at 45 dBHz
    assert result.totals.control_s[0] == pytest.approx(2 * T, rel=1e-4)
    assert result.totals.search_s[0] == pytest.approx(6 * T, rel=1e-4)
    assert result.totals.in_vain_s[0] == pytest.approx(8 * T, rel=1e-4)


def test_more_control_detections_are_tried_where_the_setting_says_so() -> None:
    settings = Search(guards=Guards(control_attempts=3))
    present = spans((PRESENT, 1), (MISSING, 3)).astype(int)[:, None]
    assert story(supervise(predictions(n=40), present, settings))[1:3] == [
        (1.5, "control_detection", "signal_lost"),
        (1.8, "search", "control_failed"),
    ]


def test_signal_lost_in_view_is_checked_after_its_guard() -> None:
    present = spans((PRESENT, 1), (MISSING, 0.4), (PRESENT, 1), (MISSING, 0.6), (PRESENT, 2)).astype(int)
    result = supervise(predictions(n=len(present)), present[:, None])
    # the first gap of 0.4 s is shorter than the guard of 0.5 s
    assert story(result)[1:] == [
        (2.9, "control_detection", "signal_lost"),
        (3.0, "resume", "detected"),
        (3.5, "track", "pulled_in"),
    ]


def test_signal_that_does_not_stay_is_searched_not_detected_for_ever() -> None:
    present = spans((MISSING, 0.1), (PRESENT, 0.1), (MISSING, 2.0)).astype(int)[:, None]
    told = story(supervise(predictions(n=len(present)), present))
    assert told[:3] == [
        (0.0, "control_detection", "appeared"),
        (0.1, "resume", "detected"),
        (0.7, "search", "control_failed"),
    ]


def test_lost_satellite_is_tried_as_soon_as_it_reappears() -> None:
    decision = spans((VISIBLE, 2), (HIDDEN, 3), (VISIBLE, 2))
    present = spans((MISSING, 5), (NOT_KNOWN, 2)).astype(int)[:, None]
    told = story(supervise(predictions(decision), present))
    assert told[2] == (0.4, "lost", "search_failed")
    assert told[3:5] == [(5.2, "control_detection", "visible_again"), (5.3, "resume", "detected")]


def test_satellite_held_too_long_is_given_up_and_still_not_searched() -> None:
    settings = Search(guards=Guards(max_hold_s=10.0))
    result = supervise(predictions(spans((VISIBLE, 1), (HIDDEN, 50))), settings=settings)
    assert story(result)[3:] == [(1.0, "hold", "hidden"), (11.0, "lost", "held_too_long")]
    assert result.totals.search_s[0] == 0.0


def test_prediction_that_ends_leaves_no_state() -> None:
    decision = spans((VISIBLE, 2), (UNDECIDED, 1), (VISIBLE, 1))
    told = story(supervise(predictions(decision)))
    assert told[3:5] == [(2.0, "absent", "prediction_ended"), (3.0, "control_detection", "appeared")]


@pytest.mark.parametrize("name", ["cn0_dbhz", "d_range_m2", "d_rate_m2ps2"])
def test_nan_in_any_part_of_a_prediction_is_no_prediction(name: str) -> None:
    values = spans((1.0 if name != "cn0_dbhz" else 45.0, 2), (np.nan, 1))
    result = supervise(predictions(n=30, **{name: values}))
    assert story(result)[3:] == [(2.0, "absent", "prediction_ended")]


def test_search_is_broken_off_when_the_satellite_is_hidden() -> None:
    settings = Search(guards=Guards(threshold_cn0_dbhz=20.0))
    cn0 = spans((20.5, 10))  # a cell takes 0.28 s, and the window several passes
    d = spans((2e6, 10))
    decision = spans((VISIBLE, 0.5), (HIDDEN, 9.5))
    result = supervise(predictions(decision, cn0, d_range_m2=d, d_rate_m2ps2=9.0), settings=settings)
    assert story(result) == [(0.0, "search", "aperture_exceeded"), (0.5, "hold", "hidden")]
    assert result.totals.search_s[0] == result.totals.in_vain_s[0] == pytest.approx(0.5, abs=1e-9)


def test_hidden_guard_rides_over_a_short_shadow() -> None:
    decision = spans((VISIBLE, 2), (HIDDEN, 0.9), (VISIBLE, 1), (HIDDEN, 2))
    patient = Search(guards=Guards(fall_s=1.0))
    assert story(supervise(predictions(decision), settings=patient))[3:] == [(4.9, "hold", "hidden")]
    assert story(supervise(predictions(decision)))[3] == (2.0, "hold", "hidden")


def test_rise_guard_waits_for_a_lasting_return() -> None:
    decision = spans((HIDDEN, 1), (VISIBLE, 0.9), (HIDDEN, 0.1), (VISIBLE, 2))
    patient = Search(guards=Guards(rise_s=1.0))
    told = story(supervise(predictions(decision), settings=patient))
    assert told[1] == (3.0, "control_detection", "visible_again")


def test_pull_in_guard_delays_tracking() -> None:
    slow = Search(guards=Guards(pull_in_s=2.0))
    assert story(supervise(predictions(n=40), settings=slow))[-1] == (2.1, "track", "pulled_in")


def test_hysteresis_asks_more_of_a_signal_that_was_weak() -> None:
    guards = Guards(threshold_cn0_dbhz=30.0, hysteresis_db=2.0, rise_s=0.0)
    cn0 = spans((31.0, 2), (29.9, 1), (31.9, 2), (32.0, 1))
    told = story(supervise(predictions(cn0_dbhz=cn0), settings=Search(guards=guards)))
    assert told[3:5] == [(2.0, "hold", "below_cn0"), (5.0, "control_detection", "visible_again")]


def test_signal_that_wavers_within_the_hysteresis_changes_state_once() -> None:
    rng = np.random.default_rng(5)
    cn0 = 30.0 + rng.uniform(-0.99, 0.99, 5000)
    settings = Search(guards=Guards(threshold_cn0_dbhz=30.0, hysteresis_db=1.0))
    told = story(supervise(predictions(cn0_dbhz=cn0), settings=settings))
    assert [state for _, state, _ in told].count("hold") == 1 and told[-1][1] == "hold"
    bare = Search(guards=Guards(threshold_cn0_dbhz=30.0, hysteresis_db=0.0, rise_s=0.0))
    assert len(story(supervise(predictions(cn0_dbhz=cn0), settings=bare))) > 1000


def test_decision_that_flickers_is_held_by_the_rise_guard() -> None:
    decision = np.where(np.arange(2000) % 2, VISIBLE, HIDDEN)
    told = story(supervise(predictions(decision)))
    assert told == [(0.0, "hold", "hidden_at_start")]


def test_uncertain_decision_keeps_what_was_decided() -> None:
    tracked = spans((VISIBLE, 2), (UNCERTAIN_VISIBLE, 5))
    assert story(supervise(predictions(tracked))) == STARTED
    held = spans((VISIBLE, 2), (HIDDEN, 1), (UNCERTAIN_HIDDEN, 5))
    assert story(supervise(predictions(held)))[3:] == [(2.0, "hold", "hidden")]


def test_signal_seen_while_uncertain_is_checked_and_one_lost_then_is_held() -> None:
    decision = spans((VISIBLE, 2), (HIDDEN, 1), (UNCERTAIN_HIDDEN, 5))
    present = spans((PRESENT, 2), (MISSING, 2), (PRESENT, 2), (MISSING, 2)).astype(int)[:, None]
    assert story(supervise(predictions(decision), present)) == [
        (0.0, "track", "tracked_at_start"),
        (2.0, "hold", "hidden"),
        (4.2, "control_detection", "visible_again"),
        (4.3, "resume", "detected"),
        (4.8, "track", "pulled_in"),
        (6.5, "hold", "lost_while_uncertain"),
    ]


def test_detection_that_ends_in_uncertainty_is_not_counted_as_one() -> None:
    decision = spans((VISIBLE, 0.1), (UNCERTAIN_HIDDEN, 2))
    result = supervise(predictions(decision))
    told = [(0.0, "control_detection", "appeared"), (0.1, "hold", "lost_while_uncertain")]
    assert story(result) == told and result.totals.in_vain_s[0] == result.totals.control_s[0] > 0.0


def test_false_lock_of_a_hidden_satellite_does_not_keep_it_tracked() -> None:
    decision = spans((VISIBLE, 2), (HIDDEN, 10))
    result = supervise(predictions(decision), np.full((120, 1), PRESENT))
    assert story(result)[1:] == [(2.0, "hold", "hidden")]


def random_scene(seed: int, n: int = 3000, m: int = 8) -> tuple[Predictions, np.ndarray]:
    """Return predictions and presence that change at random times, every value among them."""
    rng = np.random.default_rng(seed)

    def telegraph(values: list[float], mean_epochs: float) -> np.ndarray:
        fresh = rng.choice(values, size=(n, m))
        switch = rng.random((n, m)) < 1.0 / mean_epochs
        switch[0] = True
        last = np.maximum.accumulate(np.where(switch, np.arange(n)[:, None], 0), axis=0)
        return np.take_along_axis(fresh, last, axis=0)

    decision = telegraph([UNDECIDED, HIDDEN, VISIBLE, VISIBLE, UNCERTAIN_HIDDEN, UNCERTAIN_VISIBLE], 40)
    cn0 = telegraph([45.0, 35.0, 22.0, 20.5, 19.5, np.nan, -np.inf], 60) + rng.normal(0, 0.3, (n, m))
    d_range = telegraph([0.3, 5.0, BEYOND_M2, 1e6], 50)
    d_rate = telegraph([0.01, 0.1, 9.0], 50)
    present = telegraph([MISSING, PRESENT, NOT_KNOWN], 20).astype(np.int8)
    return predictions(decision, cn0, d_range, d_rate), present


@pytest.mark.parametrize("seed", range(5))
def test_hidden_satellite_is_never_searched_whatever_happens(seed: int) -> None:
    predicted, present = random_scene(seed)
    result = supervise(predicted, present)
    looked_for = np.isin(result.state, (SEARCH, CONTROL_DETECTION))
    # the bare threshold; with the hysteresis the supervisor asks for more
    hidden = (predicted.decision == HIDDEN) | (predicted.cn0_dbhz < 20.0)
    assert looked_for.any() and hidden.any()
    assert not (looked_for & hidden).any()
    assert not (np.isin(result.state, (TRACK, RESUME)) & hidden).any()  # fall_s is zero
    # a search follows an exceeded aperture or a failed control detection, nothing else
    into_search = result.transitions.after == SEARCH
    why = {REASON_NAMES[i] for i in result.transitions.reason[into_search]}
    assert why == {"aperture_exceeded", "control_failed"}
    assert len(np.unique(result.state)) == len(STATE_NAMES)


@pytest.mark.parametrize("seed", range(3))
def test_time_in_states_adds_up_to_the_log(seed: int) -> None:
    predicted, present = random_scene(seed)
    result = supervise(predicted, present)
    held = np.count_nonzero(result.state[:-1] == HOLD, axis=0) * STEP_S
    assert result.totals.hold_s == pytest.approx(held, abs=1e-6)
    for state, spent in ((SEARCH, result.totals.search_s), (CONTROL_DETECTION, result.totals.control_s)):
        in_state = np.count_nonzero(result.state[:-1] == state, axis=0) * STEP_S
        assert np.all(spent <= in_state + 1e-6) and np.any(spent > 0.0)
    assert np.all(result.totals.in_vain_s <= result.totals.search_s + result.totals.control_s)
    assert np.all(result.totals.unsupervised_in_vain_s <= result.totals.unsupervised_s)


def test_unsupervised_receiver_searches_through_the_outage_and_half_a_sweep_more() -> None:
    result = supervise(predictions(spans((VISIBLE, 5), (HIDDEN, 20), (VISIBLE, 10))))
    # from 5.0 s, the first hidden epoch, to 25.0 s, of which the last interval ends with a signal: 19.9 s in vain
    assert result.totals.unsupervised_in_vain_s[0] == pytest.approx(19.9, abs=1e-9)
    assert result.totals.unsupervised_s[0] == pytest.approx(19.9 + 3.163 / 2, abs=1e-3)
    supervised_s = result.totals.search_s[0] + result.totals.control_s[0]
    assert supervised_s < 0.01


def test_control_detection_by_drawn_outcomes_fails_as_often_as_pd_says() -> None:
    # Every two seconds a shadow of one second; each control detection is drawn with Pd 0.9
    rng = np.random.default_rng(8)
    cycles = 2000
    decision = np.tile(spans((VISIBLE, 1), (HIDDEN, 1)), cycles)
    drawn = np.repeat(rng.random(cycles) < 0.9, 20)
    present = np.where(drawn, PRESENT, MISSING)[:, None]
    result = supervise(predictions(decision), present, Search(guards=Guards(loss_s=5.0)))
    tried = np.count_nonzero(result.transitions.after == CONTROL_DETECTION)
    failed = np.count_nonzero(result.transitions.after == SEARCH)
    assert tried >= cycles - 1
    # binomial: 200 of 2000 with a sigma of 13.4; the first cycle may begin tracked
    assert abs(failed - np.count_nonzero(~drawn[::20])) <= 1 and abs(failed - 200) < 4.5 * 13.4


def test_transitions_are_sorted_and_say_where_they_came_from() -> None:
    predicted, present = random_scene(3)
    result: Supervision = supervise(predicted, present)
    rows = result.transitions
    assert np.all(np.diff(rows.t_ns) >= 0) and np.all(rows.before != rows.after) and np.all(rows.reason > 0)
    for s in range(result.state.shape[1]):
        mine = rows.sv == s
        assert rows.before[mine][1:].tolist() == rows.after[mine][:-1].tolist()
        assert np.count_nonzero(mine) == np.count_nonzero(np.diff(result.state[:, s])) + (
            result.state[0, s] != 0
        )


def test_doppler_of_a_perfectly_known_rate_is_still_told() -> None:
    result = supervise(predictions(d_rate_m2ps2=0.0, n=3))
    assert result.transitions.doppler_hz[0] == pytest.approx(-525.50, abs=0.01)
