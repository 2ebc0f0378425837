"""GLONASS and SBAS satellites of a log: time of transmission, clock, channel, validity, mixed with the others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sidereon

from insgnss.constants import C_MPS, NS_PER_S
from insgnss.gnss.orbits.ephemeris_choice import LONGEST_STATE_VECTOR_S, VALIDITY_S, broadcast_messages
from insgnss.gnss.orbits.satellite_state import SatelliteStates, glonass_channels, satellite_states
from insgnss.status import NO_CHANNEL, STALE_EPHEMERIS, UNHEALTHY, UNKNOWN_SIGNAL, USED
from insgnss.tables import EphemerisTable, NavigationData, StateVectorTable
from tests.gnss.broadcast_sample import TOE_NS, navigation_table, observations
from tests.gnss.glonass_sample import FIRST_NS, GLONASS_SATELLITES, GLONASS_TEXT, glonass_navigation


@pytest.fixture(scope="module")
def nav(tmp_path_factory: pytest.TempPathFactory) -> NavigationData:
    return glonass_navigation(tmp_path_factory.mktemp("navigation"))


def states_table(nav: NavigationData) -> StateVectorTable:
    assert nav.state_vectors is not None
    return nav.state_vectors


def changed(nav: NavigationData, **columns: object) -> NavigationData:
    """Return the data with other columns of the states."""
    return replace(nav, state_vectors=replace(states_table(nav), **columns))


def seen(nav: NavigationData, after_s: float, code: str = "C1C") -> SatelliteStates:
    """Return the states of one epoch, all satellites 0.07 s away, received ``after_s`` after 00:15 UTC."""
    t = FIRST_NS + round(after_s * NS_PER_S)
    log = observations(GLONASS_SATELLITES, [t] * 4, [0.07 * C_MPS] * 4, code=code)
    return satellite_states(log, nav)


def test_reference_time_is_utc_with_the_leap_seconds_of_its_date(nav: NavigationData) -> None:
    assert states_table(nav).t_ns.tolist() == [FIRST_NS, FIRST_NS + 1800 * NS_PER_S] * 4


def test_state_is_that_of_the_time_of_transmission(nav: NavigationData) -> None:
    """An independent evaluation at tag - 0.07 s - satellite clock: 1 mm, clock 1e-6 m; 500 s after t_b."""
    states = seen(nav, 500.0)
    theirs = sidereon.parse_rinex_nav(GLONASS_TEXT)
    query = sidereon.ExactEpochQuery.from_binary_j2000_seconds
    records = {r.satellite: r for r in sidereon.parse_rinex_glonass_records(GLONASS_TEXT)[:4]}
    for i, sv in enumerate(GLONASS_SATELLITES):
        toe = records[sv].toe_gpst_j2000_s
        clock_s = records[sv].clock_bias_at(toe + 499.93)
        # the query's own time resolves 1e-7 s (0.4 mm): the whole second, then on along the velocity
        state = theirs.selected_state_at_epoch_query(sv, query(toe + 500.0), query(toe))
        before = -0.07 - clock_s
        v, a = states.velocity[i], states.acceleration[i]
        expected = np.array(state.position_ecef_m) + before * v - 0.5 * before**2 * a
        np.testing.assert_allclose(states.position[i], expected, rtol=0, atol=1e-3)
        assert states.clock_m[i] == pytest.approx(C_MPS * clock_s, abs=1e-6)
        assert states.drift_mps[i] == C_MPS * records[sv].gamma_n
        assert states.age_s[i] == pytest.approx(500.0 + before, abs=1e-9)


def test_velocity_and_acceleration_continue_the_position(nav: NavigationData) -> None:
    now, later = seen(nav, 123.0), seen(nav, 123.1)
    moved = now.position + 0.1 * now.velocity + 0.005 * now.acceleration
    np.testing.assert_allclose(later.position, moved, rtol=0, atol=1e-6)


def test_nearest_message_is_taken_and_numbered_after_the_ephemerides(nav: NavigationData) -> None:
    assert seen(nav, 890.0).message.tolist() == [0, 2, 4, 6]
    assert seen(nav, 910.0).message.tolist() == [1, 3, 5, 7]
    jump = np.linalg.norm(
        seen(nav, 900.6).position - seen(nav, 899.6).position - seen(nav, 900.0).velocity, axis=1
    )
    assert np.all(jump < 2.0)


@pytest.mark.parametrize(
    ("after_s", "status"), [(-925.0, USED), (-935.0, STALE_EPHEMERIS), (1800 + 925.0, USED)]
)
def test_message_serves_a_quarter_of_an_hour_and_half_a_minute(
    nav: NavigationData, after_s: float, status: int
) -> None:
    assert VALIDITY_S["R"] == 930.0
    assert set(seen(nav, after_s).status) == {status}


def test_given_age_limit_stretches_a_state_to_half_an_hour_at_most(nav: NavigationData) -> None:
    log = observations(("R03",), [FIRST_NS - 1790 * NS_PER_S], [2e7])
    far = observations(("R03",), [FIRST_NS - 1810 * NS_PER_S], [2e7])
    messages = broadcast_messages(nav, max_age_s=86_400.0)
    assert LONGEST_STATE_VECTOR_S == 1800.0
    assert satellite_states(log, messages).status[0] == USED
    assert satellite_states(far, messages).status[0] == STALE_EPHEMERIS
    assert satellite_states(log, broadcast_messages(nav, max_age_s=60.0)).status[0] == STALE_EPHEMERIS


def test_unhealthy_satellite_is_refused(nav: NavigationData) -> None:
    health = np.array([1.0, 1.0, 0.0, 4.0, 0.0, 0.0, 0.0, 0.0])
    assert seen(changed(nav, health=health), 0.0).status.tolist() == [UNHEALTHY, USED, USED, USED]
    assert seen(changed(nav, health=health), 1800.0).status.tolist() == [UNHEALTHY, UNHEALTHY, USED, USED]


def test_senseless_state_is_passed_over(nav: NavigationData) -> None:
    r_e = states_table(nav).r_e.copy()
    r_e[0] = np.nan
    r_e[2] = 0.0
    states = seen(changed(nav, r_e=r_e), 0.0)
    assert states.status.tolist() == [STALE_EPHEMERIS, STALE_EPHEMERIS, USED, USED]


def test_group_delay_is_that_of_the_second_band_alone(nav: NavigationData) -> None:
    delay = np.array([4e-9, 4e-9, np.nan, np.nan, -2e-9, -2e-9, 0.0, 0.0])
    with_delay = changed(nav, group_delay_s=delay)
    for code in ("C1C", "C1P"):
        np.testing.assert_array_equal(seen(with_delay, 0.0, code).clock_m, seen(nav, 0.0, code).clock_m)
    for code in ("C2C", "C2P"):
        less = seen(nav, 0.0, code).clock_m - seen(with_delay, 0.0, code).clock_m
        np.testing.assert_allclose(less, C_MPS * np.array([4e-9, 0.0, -2e-9, 0.0]), rtol=0, atol=1e-9)


def test_channel_is_that_of_the_messages_else_of_the_log_else_the_row_is_refused(nav: NavigationData) -> None:
    unknown = states_table(nav).channel.copy()
    unknown[:4] = -128  # R03 and R08
    without = changed(nav, channel=unknown)
    log = observations(GLONASS_SATELLITES, [FIRST_NS] * 4, [2.1e7] * 4)
    states = satellite_states(log, without)
    assert states.status.tolist() == [NO_CHANNEL, NO_CHANNEL, USED, USED]
    # the orbit is there all the same
    assert np.isfinite(states.sat).all()
    told = replace(log, glonass_channels={"R03": 5, "R14": 0})
    assert satellite_states(told, without).status.tolist() == [USED, NO_CHANNEL, USED, USED]
    assert glonass_channels(told, broadcast_messages(without)) == {"R03": 5, "R14": -7, "R24": 2}


def test_both_kinds_of_message_serve_one_log(nav: NavigationData, tmp_path: Path) -> None:
    table = navigation_table(tmp_path)
    shift = TOE_NS - FIRST_NS
    both = replace(changed(nav, t_ns=states_table(nav).t_ns + shift), ephemerides=table)
    log = observations(("G01", "R03", "E14", "R24"), [TOE_NS] * 4, [2.1e7] * 4)
    states = satellite_states(log, both)
    assert set(states.status) == {USED}
    alone = satellite_states(log, table)
    np.testing.assert_array_equal(states.sat[[0, 2]], alone.sat[[0, 2]])
    assert states.message[1] >= len(table.sv_names) and states.message[0] < len(table.sv_names)


@pytest.mark.parametrize("sv", ["R27", "R60", "R99", "S58"])
def test_satellite_of_a_high_number_is_served_like_any_other(nav: NavigationData, sv: str) -> None:
    high = changed(nav, sv_names=(sv,) * 2 + states_table(nav).sv_names[2:])
    log = observations((sv, "C63", "J10", "I14"), [FIRST_NS] * 4, [2.1e7] * 4)
    states = satellite_states(log, high)
    assert states.status[0] == USED
    assert states.status[3] == UNKNOWN_SIGNAL and np.isnan(states.sat[1:]).all()


def test_epoch_by_epoch_gives_the_bits_of_the_whole_log(
    nav: NavigationData, rng: np.random.Generator
) -> None:
    epochs, n = 60, len(GLONASS_SATELLITES)
    t = FIRST_NS + np.repeat(np.arange(-20, epochs - 20) * 41 * NS_PER_S, n)
    ranges = rng.uniform(1.9e7, 2.4e7, t.size)
    whole = satellite_states(
        observations(GLONASS_SATELLITES, t, ranges, sv=np.tile(np.arange(n), epochs)), nav
    )
    messages = broadcast_messages(nav)
    for e in range(epochs):
        rows = slice(e * n, (e + 1) * n)
        part = satellite_states(observations(GLONASS_SATELLITES, t[rows], ranges[rows]), messages)
        for of_part, of_whole in zip(part, whole, strict=True):
            np.testing.assert_array_equal(of_part, of_whole[rows])


def test_navigation_without_states_is_that_of_the_ephemerides(tmp_path: Path) -> None:
    table: EphemerisTable = navigation_table(tmp_path)
    log = observations(("G01", "C08"), [TOE_NS] * 2, [2.1e7, 3.6e7])
    for a, b in zip(
        satellite_states(log, table), satellite_states(log, NavigationData(table, None, None)), strict=True
    ):
        np.testing.assert_array_equal(a, b)
