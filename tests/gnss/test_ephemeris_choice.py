"""Which message serves: the rule, its limits, and the reason when there is none."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest

from insgnss.constants import NS_PER_S
from insgnss.gnss.orbits.ephemeris_choice import (
    VALIDITY_S,
    BroadcastMessages,
    broadcast_messages,
    choose_message,
)
from insgnss.status import NO_EPHEMERIS, STALE_EPHEMERIS, UNHEALTHY, USED
from insgnss.tables import EphemerisTable
from tests.gnss.broadcast_sample import TOE_NS, copies, navigation_table

HOUR_NS = 3600 * NS_PER_S


@pytest.fixture(scope="module")
def sample(tmp_path_factory: pytest.TempPathFactory) -> EphemerisTable:
    return navigation_table(tmp_path_factory.mktemp("navigation"), ("G01", "E02", "C19", "J02"))


def gps(sample: EphemerisTable, toe_hours: Iterable[float], **changes: Iterable[object]) -> EphemerisTable:
    """Return messages of G01 at the given hours after the sample's toe, without a fit interval."""
    toe = [TOE_NS + round(h * HOUR_NS) for h in toe_hours]
    given = {"fit_interval_s": [np.nan] * len(toe)} | changes
    return copies(sample, sample.sv_names.index("G01"), toe_ns=toe, toc_ns=toe, **given)


def chosen(messages: BroadcastMessages, hours: float, sv: str = "G01") -> tuple[int, int]:
    number = messages.satellites.index(sv) if sv in messages.satellites else -1
    return choose_message(
        TOE_NS + round(hours * HOUR_NS), number, messages.index, messages.index.first.copy()
    )


@pytest.mark.parametrize(
    ("hours", "row"), [(-1.9, 0), (0.0, 0), (0.9, 0), (1.0, 0), (1.1, 1), (2.5, 1), (3.5, 2), (5.9, 2)]
)
def test_nearest_toe_is_taken_before_and_after_it(sample: EphemerisTable, hours: float, row: int) -> None:
    assert chosen(broadcast_messages(gps(sample, [0, 2, 4])), hours) == (row, USED)


def test_order_in_the_file_does_not_matter(sample: EphemerisTable) -> None:
    messages = broadcast_messages(gps(sample, [4, 0, 2]))
    assert [chosen(messages, h)[0] for h in (0.0, 2.0, 4.0)] == [1, 2, 0]


def test_walk_ends_at_the_same_message_from_anywhere(sample: EphemerisTable) -> None:
    messages = broadcast_messages(gps(sample, range(0, 24, 2)))
    hours = np.linspace(-1.5, 23.5, 401)
    forward, backward = messages.index.first.copy(), messages.index.first.copy()
    ahead = [choose_message(TOE_NS + int(h * HOUR_NS), 0, messages.index, forward)[0] for h in hours]
    back = [choose_message(TOE_NS + int(h * HOUR_NS), 0, messages.index, backward)[0] for h in hours[::-1]]
    assert ahead == back[::-1] == [chosen(messages, h)[0] for h in hours]


def test_message_beyond_its_validity_is_stale(sample: EphemerisTable) -> None:
    messages = broadcast_messages(gps(sample, [0]))
    assert chosen(messages, 2.0)[1] == USED
    assert chosen(messages, 2.001) == (-1, STALE_EPHEMERIS)
    assert chosen(messages, -2.001) == (-1, STALE_EPHEMERIS)


def test_fit_interval_of_the_message_counts_before_the_constellation_limit(sample: EphemerisTable) -> None:
    messages = broadcast_messages(gps(sample, [0], fit_interval_s=[6 * 3600.0]))
    assert chosen(messages, 2.9)[1] == USED
    assert chosen(messages, 3.1)[1] == STALE_EPHEMERIS


@pytest.mark.parametrize("fit_interval_s", [0.0, -1.0, np.nan])
def test_meaningless_fit_interval_counts_as_none(sample: EphemerisTable, fit_interval_s: float) -> None:
    messages = broadcast_messages(gps(sample, [0], fit_interval_s=[fit_interval_s]))
    assert chosen(messages, 1.9)[1] == USED


def test_given_age_limit_replaces_every_other(sample: EphemerisTable) -> None:
    table = gps(sample, [0], fit_interval_s=[4 * 3600.0])
    assert chosen(broadcast_messages(table, max_age_s=600.0), 0.2)[1] == STALE_EPHEMERIS
    assert chosen(broadcast_messages(table, max_age_s=86_400.0), 23.0)[1] == USED


@pytest.mark.parametrize("sv", ["E02", "C19"])
def test_each_constellation_has_its_own_validity(sample: EphemerisTable, sv: str) -> None:
    messages = broadcast_messages(sample)
    limit = VALIDITY_S[sv[0]] / 3600.0
    assert chosen(messages, limit - 0.01, sv)[1] == USED
    assert chosen(messages, limit + 0.01, sv)[1] == STALE_EPHEMERIS


def test_unhealthy_message_is_passed_over_for_a_healthy_one(sample: EphemerisTable) -> None:
    messages = broadcast_messages(gps(sample, [0, 2], health=[0.0, 1.0]))
    assert chosen(messages, 1.5) == (0, USED)


def test_satellite_with_unhealthy_messages_alone_is_unhealthy_then_stale(sample: EphemerisTable) -> None:
    messages = broadcast_messages(gps(sample, [0, 2], health=[1.0, 63.0]))
    assert chosen(messages, 1.5) == (-1, UNHEALTHY)
    assert chosen(messages, 9.0) == (-1, STALE_EPHEMERIS)


def test_unhealthy_message_explains_a_stale_healthy_one(sample: EphemerisTable) -> None:
    messages = broadcast_messages(gps(sample, [0, 6], health=[0.0, 1.0]))
    assert chosen(messages, 6.0) == (-1, UNHEALTHY)


def test_satellite_without_messages_has_no_ephemeris(sample: EphemerisTable) -> None:
    assert chosen(broadcast_messages(sample), 0.0, "G31") == (-1, NO_EPHEMERIS)


def test_later_row_wins_among_messages_of_one_toe(sample: EphemerisTable) -> None:
    assert chosen(broadcast_messages(gps(sample, [0, 0, 0])), 0.1) == (2, USED)


def galileo(sample: EphemerisTable, messages: tuple[str, ...], **changes: Iterable[object]) -> EphemerisTable:
    return copies(sample, sample.sv_names.index("E02"), message=messages, **changes)


@pytest.mark.parametrize(("preferred", "row"), [("INAV", 0), ("FNAV", 1)])
def test_preferred_galileo_message_is_taken(sample: EphemerisTable, preferred: str, row: int) -> None:
    messages = broadcast_messages(galileo(sample, ("INAV", "FNAV")), galileo_message=preferred)
    assert chosen(messages, 0.5, "E02") == (row, USED)
    assert messages.index.is_fnav[row] == (preferred == "FNAV")


def test_other_galileo_message_serves_when_the_preferred_one_is_stale(sample: EphemerisTable) -> None:
    table = galileo(sample, ("INAV", "FNAV"), toe_ns=[TOE_NS - 9 * HOUR_NS, TOE_NS])
    assert chosen(broadcast_messages(table), 0.0, "E02") == (1, USED)


def test_message_kind_that_the_table_has_no_place_for_is_not_used(sample: EphemerisTable) -> None:
    messages = broadcast_messages(gps(sample, [0], message=["CNAV"]))
    assert chosen(messages, 0.0) == (-1, NO_EPHEMERIS)


@pytest.mark.parametrize(
    ("column", "value"), [("e", 1.0), ("e", -0.1), ("sqrt_a", 0.0), ("m0", np.nan), ("af0", np.inf)]
)
def test_message_that_describes_no_ellipse_counts_as_absent(
    sample: EphemerisTable, column: str, value: float
) -> None:
    messages = broadcast_messages(gps(sample, [0], **{column: [value]}))
    assert chosen(messages, 0.0) == (-1, NO_EPHEMERIS)


def test_empty_table_has_no_satellites(sample: EphemerisTable) -> None:
    # tuples and arrays alike
    empty = EphemerisTable(**{name: value[:0] for name, value in vars(sample).items()})
    messages = broadcast_messages(empty)
    assert messages.satellites == ()
    assert chosen(messages, 0.0) == (-1, NO_EPHEMERIS)
