"""GLONASS satellites known by their channel alone get the names of those in view."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insgnss.gnss.orbits.ephemeris_choice import broadcast_messages
from insgnss.gnss.orbits.satellite_state import satellite_states
from insgnss.log.phone_satellites import with_slots
from insgnss.log.satellites import channel_of_name, normalised_name
from insgnss.tables import Float64, GnssTable, NavigationData, StateVectorTable
from tests.gnss.broadcast_sample import TOE_NS, navigation_table, observations

NAMED = ("G02", "G03", "G04", "E14")  # within 47 deg of each other, as satellites in view are
RADIUS_M = 2.55e7


def states(*entries: tuple[str, int, Float64], age_s: float = 300.0) -> StateVectorTable:
    n, zero = len(entries), np.zeros((len(entries), 3))
    return StateVectorTable(
        tuple(name for name, _, _ in entries),
        np.full(n, TOE_NS + round(age_s * 1e9)),
        np.array([RADIUS_M * direction for _, _, direction in entries]),
        *(zero, zero, np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)),
        np.array([channel for _, channel, _ in entries], np.int16),
    )


@pytest.fixture
def sky(tmp_path: Path) -> tuple[GnssTable, NavigationData, Float64]:
    """A log of four named satellites and of the channels -3 and 6; messages of the named; their mean direction."""
    table = navigation_table(tmp_path, NAMED)
    log = observations((*NAMED, "R47", "R56"), [TOE_NS] * 6, [2.3e7] * 6)
    found = satellite_states(log.take(slice(0, 4)), broadcast_messages(table)).position
    mean = (found / np.linalg.norm(found, axis=1)[:, None]).sum(axis=0)
    return log, NavigationData(table, None, None), mean / np.linalg.norm(mean)


def turned(direction: Float64, angle_deg: float) -> Float64:
    across = np.cross(direction, [0.0, 0.0, 1.0])
    angle = np.radians(angle_deg)
    return np.asarray(np.cos(angle) * direction + np.sin(angle) * across / np.linalg.norm(across))


def names_of(log: GnssTable) -> list[str]:
    return [log.sv_names[k] for k in log.sv]


@pytest.mark.parametrize("angle_deg", [0.0, 40.0, 65.0, -65.0])
def test_satellite_in_view_and_not_its_antipode_has_the_channel(
    sky: tuple[GnssTable, NavigationData, Float64], angle_deg: float
) -> None:
    log, navigation, zenith = sky
    near = turned(zenith, angle_deg)
    of_glonass = states(("R05", -3, near), ("R01", -3, -near), ("R08", 6, -near), ("R04", 6, near))
    named, events = with_slots(log, NavigationData(navigation.ephemerides, None, None, of_glonass))
    assert names_of(named) == [*NAMED, "R05", "R04"]
    assert named.glonass_channels == {"R05": -3, "R04": 6, "R47": -3, "R56": 6}
    assert [event.kind for event in events] == ["glonass_slot_found"]
    assert np.array_equal(named.pseudorange_m, log.pseudorange_m)


def test_what_is_not_clear_keeps_its_channels_name(sky: tuple[GnssTable, NavigationData, Float64]) -> None:
    log, navigation, zenith = sky
    low = turned(zenith, 85.0)
    of_glonass = states(("R05", -3, low), ("R01", -3, -low), ("R04", 6, zenith))
    named, events = with_slots(log, NavigationData(navigation.ephemerides, None, None, of_glonass))
    assert names_of(named) == [*NAMED, "R47", "R04"]
    assert [event.kind for event in events] == ["glonass_slot_found", "glonass_slot_unknown"]


def test_without_messages_or_with_old_ones_nothing_is_named(
    sky: tuple[GnssTable, NavigationData, Float64],
) -> None:
    log, navigation, zenith = sky
    old = states(("R05", -3, zenith), age_s=2400.0)
    for given in (None, navigation, NavigationData(navigation.ephemerides, None, None, old)):
        named, events = with_slots(log, given)
        assert names_of(named) == names_of(log) and [event.kind for event in events] == [
            "glonass_slot_unknown"
        ]


def test_log_that_names_all_its_satellites_is_left_alone(
    sky: tuple[GnssTable, NavigationData, Float64],
) -> None:
    log = sky[0].take(slice(0, 4))
    assert with_slots(log, sky[1]) == (log, [])


@pytest.mark.parametrize(
    ("name", "channel"), [("R43", -7), ("R50", 0), ("R56", 6), ("R42", None), ("R57", None)]
)
def test_names_by_channel_run_from_43_to_56(name: str, channel: int | None) -> None:
    assert channel_of_name(name) == channel
    assert normalised_name(name.lower()) == (name if channel is not None else None)
    assert channel_of_name("E" + name[1:]) is None and channel_of_name("R24") is None
