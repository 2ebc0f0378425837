"""Navigation data of another week than the log are an error with advice, a gap is told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.errors import NavigationDataError
from insgnss.log.overlap import check_navigation_time
from insgnss.tables import NavigationData
from tests.gnss.broadcast_sample import TOE_NS, WEEK, navigation_table
from tests.gnss.glonass_sample import FIRST_NS, glonass_navigation

HOUR_NS = 3600 * NS_PER_S
PATHS = (Path("brdc.rnx"),)


@pytest.fixture
def navigation(tmp_path: Path) -> NavigationData:
    return NavigationData(navigation_table(tmp_path), None, None)


@pytest.mark.parametrize("weeks", [-1, 1, -1024, 52])
def test_messages_of_another_week_are_an_error_that_names_both(
    navigation: NavigationData, weeks: int
) -> None:
    log = TOE_NS + weeks * NS_PER_WEEK + np.arange(3) * NS_PER_S
    with pytest.raises(NavigationDataError, match="gps_week") as error:
        check_navigation_time(navigation, log, PATHS)
    assert f"GPS week {WEEK})" in str(error.value) and f"GPS week {WEEK + weeks})" in str(error.value)
    assert "brdc.rnx" in str(error.value)


def test_log_within_its_messages_is_quiet(navigation: NavigationData) -> None:
    assert check_navigation_time(navigation, TOE_NS + np.arange(-2, 2) * HOUR_NS, PATHS) == []


def test_epochs_far_from_every_message_are_told(navigation: NavigationData) -> None:
    (event,) = check_navigation_time(navigation, TOE_NS + np.arange(6) * HOUR_NS, PATHS)
    assert event.kind == "navigation_gap" and event.detail.startswith("3 of 6")
    assert event.t_ns == TOE_NS + 3 * HOUR_NS


def test_log_of_days_that_begins_with_its_messages_is_no_error(navigation: NavigationData) -> None:
    log = TOE_NS + np.arange(0, 72, 6) * HOUR_NS
    assert [event.kind for event in check_navigation_time(navigation, log, PATHS)] == ["navigation_gap"]


def test_states_count_as_messages(tmp_path: Path) -> None:
    glonass = glonass_navigation(tmp_path)
    assert check_navigation_time(glonass, np.array([FIRST_NS]), PATHS) == []
    with pytest.raises(NavigationDataError):
        check_navigation_time(glonass, np.array([FIRST_NS + NS_PER_WEEK]), PATHS)


def test_empty_log_is_quiet(navigation: NavigationData) -> None:
    assert check_navigation_time(navigation, np.zeros(0, np.int64), PATHS) == []
