"""Satellite states of a log: time of transmission, clock, statuses, states from the log itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numba
import numpy as np
import pytest
import sidereon

from insgnss.constants import C_MPS, NS_PER_S
from insgnss.gnss.orbits.ephemeris_choice import broadcast_messages
from insgnss.gnss.orbits.satellite_state import SatelliteStates, flight_times, range_rates, satellite_states
from insgnss.status import BAD_VALUE, NO_EPHEMERIS, STALE_EPHEMERIS, UNHEALTHY, UNKNOWN_SIGNAL, USED
from insgnss.tables import EphemerisTable, GnssTable, NavigationData
from tests.gnss.broadcast_sample import (
    ORBITS,
    TOE_NS,
    copies,
    navigation_table,
    navigation_text,
    observations,
    with_signals,
)

DEFAULT_CODE = {"G": "C1C", "E": "C1C", "C": "C2I", "J": "C1C"}


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> EphemerisTable:
    return navigation_table(tmp_path_factory.mktemp("navigation"))


@pytest.fixture(scope="module")
def log() -> GnssTable:
    """Return one epoch with every sample satellite, 10 min after toe."""
    names = tuple(ORBITS)
    ranges = np.linspace(2.1e7, 3.9e7, len(names))
    codes = ("C1C", "C2I")
    one = observations(names, [TOE_NS + 600 * NS_PER_S + 123_456_789] * len(names), ranges)
    return with_signals(one, codes, [codes.index(DEFAULT_CODE[name[0]]) for name in names])


def test_state_is_that_of_the_time_of_transmission(table: EphemerisTable, log: GnssTable) -> None:
    """tag - pseudorange / c - satellite clock, by an independent evaluation: 1 mm, clock 1e-5 m."""
    states = satellite_states(log, table)
    assert list(states.status) == [USED] * len(log.t_ns)
    for record in sidereon.parse_rinex_nav_records(navigation_text()):
        i = log.sv_names.index(record.satellite)
        tag = 600.123456789 - log.pseudorange_m[i] / C_MPS
        clock_s = record.evaluate(record.toe_tow_s + tag).clock_s + record.group_delay_s
        theirs = record.evaluate(record.toe_tow_s + tag - clock_s)
        np.testing.assert_allclose(states.position[i], theirs.position_m, rtol=0, atol=1e-3)
        assert states.clock_m[i] == pytest.approx(C_MPS * theirs.clock_s, abs=1e-5)
        assert states.age_s[i] == pytest.approx(tag - clock_s, abs=1e-9)


def test_velocity_and_acceleration_continue_the_position(table: EphemerisTable, log: GnssTable) -> None:
    now = satellite_states(log, table)
    later = satellite_states(replace(log, t_ns=log.t_ns + NS_PER_S // 10), table)
    moved = now.position + 0.1 * now.velocity + 0.005 * now.acceleration
    # the next term of the series, 0.1^3 / 6 of 1e-4 m/s^3
    np.testing.assert_allclose(later.position, moved, rtol=0, atol=1e-6)
    np.testing.assert_allclose(later.clock_m, now.clock_m + 0.1 * now.drift_mps, rtol=0, atol=1e-6)


def test_satellite_clock_must_matter_in_the_time_of_transmission(
    table: EphemerisTable, log: GnssTable
) -> None:
    fast = replace(table, af0=table.af0 + 1e-3)
    moved = satellite_states(log, fast).position - satellite_states(log, table).position
    # 1 ms at 2 to 4 km/s; the geostationary one stays
    assert np.all(np.linalg.norm(moved, axis=1)[[name != "C03" for name in log.sv_names]] > 0.5)


def test_row_without_pseudorange_takes_the_median_of_its_epoch() -> None:
    tau = np.zeros(6)
    ranges = np.array([2.1e7, np.nan, 2.3e7, 2.6e7, np.nan, np.inf])
    flight_times(np.array([0, 0, 0, 0, 1, 1]), ranges, tau)
    assert tau[1] == 2.3e7 / C_MPS
    assert list(tau[[0, 2, 3]]) == list(ranges[[0, 2, 3]] / C_MPS)
    assert list(tau[4:]) == [0.075, 0.075]


@pytest.mark.parametrize("absurd", [9e9, -9e9, 1e300, -np.inf])
def test_absurd_pseudorange_takes_the_median_of_its_epoch(absurd: float) -> None:
    tau = np.zeros(3)
    flight_times(np.zeros(3, np.int64), np.array([2.2e7, absurd, 2.2e7]), tau)
    assert tau[1] == 2.2e7 / C_MPS


def test_pseudoranges_of_a_receiver_clock_seconds_off_are_taken_as_they_are() -> None:
    tau = np.zeros(2)
    ranges = np.array([2.1e7, 2.3e7]) - 0.4 * C_MPS
    flight_times(np.zeros(2, np.int64), ranges, tau)
    assert list(tau) == list(ranges / C_MPS)


def test_state_for_a_range_rate_alone_is_good_to_a_centimetre_per_second(
    table: EphemerisTable, log: GnssTable
) -> None:
    names = ("G01", "G02", "G03", "G04")
    full = observations(names, [TOE_NS] * 4, [2.0e7, 2.2e7, 2.3e7, 2.5e7])
    without = replace(full, pseudorange_m=np.array([np.nan, 2.2e7, 2.3e7, 2.5e7]))
    exact, approximate = satellite_states(full, table), satellite_states(without, table)
    assert np.linalg.norm(exact.position[0] - approximate.position[0]) < 40.0
    assert np.linalg.norm(exact.velocity[0] - approximate.velocity[0]) < 6e-3


def test_every_reason_for_a_missing_state_is_told(table: EphemerisTable) -> None:
    g1 = table.sv_names.index("G01")
    nav = copies(
        table,
        g1,
        sv_names=["G01", "G02", "G03"],
        toe_ns=[TOE_NS, TOE_NS - 9 * 3600 * NS_PER_S, TOE_NS],
        health=[0, 0, 1],
    )
    names = ("G01", "G02", "G03", "G04", "G01", "R05")
    log = observations(names[:4] + names[5:], [TOE_NS] * 6, [2.2e7] * 6, sv=[0, 1, 2, 3, 0, 4])
    log = with_signals(log, ("C1C", "C9Z"), [0, 0, 0, 0, 1, 0])
    states = satellite_states(log, nav)
    reasons = [USED, STALE_EPHEMERIS, UNHEALTHY, NO_EPHEMERIS, UNKNOWN_SIGNAL, NO_EPHEMERIS]
    assert list(states.status) == reasons
    assert list(states.message) == [0, -1, -1, -1, 0, -1]
    present = np.isfinite(states.position).all(axis=1)
    assert list(present) == [True, False, False, False, True, False]
    # an unknown signal keeps its orbit, and a clock without group delay
    np.testing.assert_array_equal(states.sat[0], states.sat[4])
    assert states.clock_m[4] - states.clock_m[0] == pytest.approx(C_MPS * 5.1e-9)


def test_group_delay_must_matter_and_follows_the_message(table: EphemerisTable) -> None:
    e2 = table.sv_names.index("E02")
    both = copies(table, e2, message=["INAV", "FNAV"])
    log = observations(("E02",), [TOE_NS], [2.4e7])
    inav = satellite_states(log, both).clock_m[0]
    fnav = satellite_states(log, both, galileo_message="FNAV").clock_m[0]
    assert fnav - inav == pytest.approx(C_MPS * (2.8e-9 - 2.3e-9), abs=1e-6)
    none = satellite_states(log, replace(both, group_delay_s=np.full((2, 2), np.nan))).clock_m[0]
    assert none - inav == pytest.approx(C_MPS * 2.8e-9, abs=1e-6)


def test_epoch_by_epoch_gives_the_bits_of_the_whole_log(
    table: EphemerisTable, rng: np.random.Generator
) -> None:
    epochs, names = 40, tuple(ORBITS)
    t = TOE_NS + np.repeat(np.arange(epochs) * 173 * NS_PER_S, len(names))
    ranges = rng.uniform(2e7, 4e7, t.size)
    ranges[rng.random(t.size) < 0.1] = np.nan
    log = observations(names, t, ranges, sv=np.tile(np.arange(len(names)), epochs))
    whole = satellite_states(log, table)
    source = broadcast_messages(table)
    for e in range(epochs):
        rows = slice(e * len(names), (e + 1) * len(names))
        part = observations(names, t[rows], ranges[rows])
        for of_part, of_whole in zip(satellite_states(part, source), whole, strict=True):
            np.testing.assert_array_equal(of_part, of_whole[rows])


@pytest.mark.parametrize(
    ("code", "place", "name"), [("C1C", 0, "L1 C/A"), ("C2L", 1, "L2C"), ("C5I", 2, "L5I"), ("C5Q", 3, "L5Q")]
)
def test_inter_signal_correction_of_cnav_is_added_to_the_clock_less_tgd(
    table: EphemerisTable, code: str, place: int, name: str
) -> None:
    """IS-GPS-200N, 30.3.3.3.1.1, and IS-GPS-705J, 20.3.3.3.1.2: dt - TGD + ISC, on every frequency."""
    corrections = np.full(6, np.nan)
    corrections[place] = 3.5e-9
    nav = NavigationData(table, None, None, inter_signal_s={"G01": corrections})
    log = observations(("G01", "G02"), [TOE_NS] * 2, [2.2e7] * 2, code=code)
    reference = replace(log, signal_names=("C1W",))
    with_it, plain = satellite_states(log, nav).clock_m, satellite_states(log, table).clock_m
    of_l1p = satellite_states(reference, table).clock_m
    assert with_it[0] - of_l1p[0] == pytest.approx(C_MPS * 3.5e-9, abs=1e-6), name
    # a satellite without CNAV stays as it was
    assert with_it[1] == plain[1]


def test_states_in_the_log_are_passed_through(table: EphemerisTable, log: GnssTable) -> None:
    own = satellite_states(log, table)
    given = np.column_stack([own.sat[:, :6], own.clock_m, own.drift_mps])
    given[1, 0] = np.nan
    given[2, :3] = 0.0
    given[3, 6] = np.inf
    states = satellite_states(replace(log, sat=given), None)
    good = np.array([i not in (1, 2, 3) for i in range(len(given))])
    # an empty cell is no satellite; a clock that is infinite is a value that nothing has
    refused = {1: NO_EPHEMERIS, 2: NO_EPHEMERIS, 3: BAD_VALUE}
    assert states.status.tolist() == [refused.get(i, USED) for i in range(len(given))]
    np.testing.assert_array_equal(states.sat[good, :6], given[good, :6])
    np.testing.assert_array_equal(states.clock_m[good], given[good, 6])
    np.testing.assert_array_equal(states.drift_mps[good], given[good, 7])
    assert np.isnan(states.sat[~good]).all()
    # a point mass against the broadcast orbit's own acceleration
    np.testing.assert_allclose(states.acceleration[good], own.acceleration[good], rtol=0, atol=2e-4)


def test_row_without_a_state_of_its_own_takes_the_message(table: EphemerisTable, log: GnssTable) -> None:
    of_messages = satellite_states(log, table)
    given = np.column_stack([of_messages.sat[:, :6], of_messages.clock_m, of_messages.drift_mps])
    given[:, 0] += 100.0
    given[1:4] = np.nan
    states = satellite_states(replace(log, sat=given), table)
    empty = np.isnan(given[:, 0])
    assert (states.status == USED).all()
    np.testing.assert_array_equal(states.message >= 0, empty)
    np.testing.assert_array_equal(states.sat[empty], of_messages.sat[empty])
    np.testing.assert_array_equal(states.clock_m[empty], of_messages.clock_m[empty])
    np.testing.assert_array_equal(states.position[~empty], given[~empty, :3])


def test_log_without_navigation_data_has_no_states(log: GnssTable) -> None:
    states = satellite_states(log, None)
    assert set(states.status) == {NO_EPHEMERIS}
    assert np.isnan(states.position).all()


def test_empty_log_gives_no_rows(table: EphemerisTable) -> None:
    assert len(satellite_states(observations((), [], []), table).status) == 0
    assert len(range_rates(observations((), [], []))) == 0


def test_range_rate_is_taken_as_logged_else_from_doppler() -> None:
    log = observations(("G01", "G02", "R03", "G04"), [0] * 4, [2e7] * 4)
    log = replace(
        log,
        doppler_hz=np.array([1000.0, 1000.0, 1000.0, np.nan]),
        range_rate_mps=np.array([np.nan, -7.0, np.nan, np.nan]),
    )
    rates = range_rates(log)
    # RINEX: positive Doppler when the distance shrinks
    assert rates[0] == pytest.approx(-1000.0 * C_MPS / 1575.42e6)
    assert rates[1] == -7.0
    assert np.isnan(rates[2:]).all()
    # GLONASS: with the channel, of the log's header or given
    in_header = range_rates(replace(log, glonass_channels={"R03": 5}))
    given = range_rates(log, {"R03": 5})
    assert in_header[2] == given[2] == pytest.approx(-1000.0 * C_MPS / (1602e6 + 5 * 562.5e3))


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="plain Python takes minutes for a million rows")
def test_a_million_rows_are_computed(
    table: EphemerisTable, rng: np.random.Generator, benchmark: Callable[..., SatelliteStates]
) -> None:
    names = tuple(name for name in table.sv_names if name[0] in "GE")
    n = 1_000_000 // len(names) * len(names)
    t = TOE_NS + np.repeat(np.arange(n // len(names)) * (NS_PER_S // 40), len(names))
    log = observations(
        names, t, rng.uniform(2e7, 2.6e7, n), sv=np.tile(np.arange(len(names)), n // len(names))
    )
    satellite_states(observations(names[:1], t[:1], [2e7]), table)
    states = benchmark(satellite_states, log, table)  # below a second on any machine of today
    assert np.all(states.status == USED)
