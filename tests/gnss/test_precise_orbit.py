"""Precise orbits and clocks: against the published day, an independent interpolation and held-out places."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sidereon

from insgnss.constants import C_MPS, NS_PER_S
from insgnss.gnss.orbits.precise import clock_between, orbit_between, pair_delays, precise_states
from insgnss.gnss.orbits.satellite_state import satellite_states
from insgnss.gnss.phase_centre import SatelliteAntennas
from insgnss.gnss.signals import L1_HZ, L2_HZ
from insgnss.simulation.constellation import satellite_states as simulated_states
from insgnss.simulation.sky import nominal_constellation
from insgnss.status import NO_EPHEMERIS, STALE_EPHEMERIS, UNKNOWN_SIGNAL, USED
from insgnss.tables import EphemerisTable, Float64, GnssTable, PreciseProducts
from tests.gnss.broadcast_sample import copies, navigation_table, observations, with_signals
from tests.gnss.precise_sample import START_NS, messages, products, sp3_text

HOUR_NS = 3600 * NS_PER_S


@pytest.fixture(scope="module")
def day(tmp_path_factory: pytest.TempPathFactory) -> PreciseProducts:
    return products(tmp_path_factory.mktemp("precise"))


@pytest.fixture(scope="module")
def broadcast(tmp_path_factory: pytest.TempPathFactory) -> EphemerisTable:
    return messages(tmp_path_factory.mktemp("broadcast"))


def row_of(sv: str, t_ns: int, range_m: float = 2.2e7) -> GnssTable:
    return observations((sv,), [t_ns], [range_m])


def simulated(step_s: float, hours: float) -> tuple[PreciseProducts, EphemerisTable]:
    """Return an orbit with all usual perturbations as nodes, and its message."""
    eph = nominal_constellation(START_NS).ephemerides
    seconds = np.arange(0.0, hours * 3600.0 + 1.0, step_s)
    at = simulated_states(eph, START_NS, np.repeat(seconds[:, None], len(eph.sv_names), axis=1))
    nodes = START_NS + np.rint(seconds * NS_PER_S).astype(np.int64)
    clock = np.zeros((len(eph.sv_names), len(nodes)))
    return PreciseProducts(eph.sv_names, nodes, np.moveaxis(at.r_e, 0, 1), nodes, clock), eph


def held_out_error(step_s: float, first_h: float, last_h: float) -> Float64:
    """Return the largest errors of position, velocity and acceleration between nodes of a day."""
    nodes, eph = simulated(step_s, 6.0)
    seconds = np.arange(first_h * 3600.0 + 0.5 * step_s, last_h * 3600.0, step_s)
    truth = simulated_states(eph, START_NS, np.repeat(seconds[:, None], len(eph.sv_names), axis=1))
    t_ns = START_NS + (seconds * NS_PER_S).astype(np.int64)
    worst = np.zeros(2)
    for s in range(len(eph.sv_names)):
        sat, _ = orbit_between(nodes, s, t_ns)
        of_both = [np.abs(sat[:, 0:3] - truth.r_e[:, s]).max(), np.abs(sat[:, 3:6] - truth.v_e[:, s]).max()]
        worst = np.maximum(worst, of_both)
    return worst


def test_orbit_between_nodes_fifteen_minutes_apart_is_within_a_tenth_of_a_millimetre() -> None:
    position, velocity = held_out_error(900.0, 1.25, 4.75)
    assert position < 1e-4
    assert velocity < 1e-7


def test_orbit_at_the_end_of_a_file_is_within_what_the_module_says() -> None:
    position, velocity = held_out_error(900.0, 0.0, 6.0)
    assert 1e-3 < position < 2e-3
    assert velocity < 1e-5


def test_orbit_between_nodes_five_minutes_apart_is_within_ten_micrometres_to_the_end() -> None:
    assert held_out_error(300.0, 0.0, 6.0)[0] < 1e-5


def test_orbit_agrees_with_an_independent_interpolation_of_the_published_day(
    day: PreciseProducts, rng: np.random.Generator
) -> None:
    theirs = sidereon.load_sp3(sp3_text().encode())
    seconds = rng.uniform(5400.0, 6300.0, 40)  # the middle of the excerpt
    for s, name in enumerate(day.sv_names):
        sat, age_s = orbit_between(day, s, START_NS + (seconds * NS_PER_S).astype(np.int64))
        reference = theirs.interpolate(name, theirs.epochs_j2000_seconds[0] + seconds)
        np.testing.assert_allclose(sat[:, :3], reference.position_m, rtol=0, atol=1e-3)
        assert np.all((age_s >= 0.0) & (age_s <= 450.0))


def test_orbit_at_a_node_is_the_node(day: PreciseProducts) -> None:
    sat, age_s = orbit_between(day, 0, day.orbit_ns)
    np.testing.assert_allclose(sat[:, :3], day.r_e[0], rtol=0, atol=1e-6)
    assert np.all(age_s == 0.0)


def test_velocity_and_acceleration_continue_the_position(day: PreciseProducts) -> None:
    t_ns = START_NS + 6_000 * NS_PER_S + np.arange(3) * (NS_PER_S // 2)
    sat, _ = orbit_between(day, 1, t_ns)
    np.testing.assert_allclose(sat[2, :3] - sat[0, :3], sat[1, 3:6], rtol=0, atol=1e-5)
    np.testing.assert_allclose(sat[2, 3:6] - sat[0, 3:6], sat[1, 6:9], rtol=0, atol=1e-8)


def test_clock_is_linear_between_its_nodes_and_nowhere_else(day: PreciseProducts) -> None:
    t_ns = day.clock_ns[3] + np.array([0, 300, 900]) * NS_PER_S
    clock, rate = clock_between(day, 0, t_ns)
    a, b = day.clock_s[0, 3:5]
    np.testing.assert_allclose(clock, [a, a + (b - a) / 3.0, b], rtol=1e-15)
    assert rate[0] == pytest.approx((b - a) / 900.0, rel=1e-12)
    outside, _ = clock_between(day, 0, np.array([day.clock_ns[0] - 1, day.clock_ns[-1] + 1]))
    assert np.isnan(outside).all()


@pytest.mark.parametrize("what", ["orbit", "clock"])
def test_gap_is_not_bridged(day: PreciseProducts, what: str) -> None:
    # twelve nodes of orbit before the gap
    r_e, clock_s = day.r_e.copy(), day.clock_s.copy()
    (r_e if what == "orbit" else clock_s)[:, 12] = np.nan
    holed = replace(day, r_e=r_e, clock_s=clock_s)
    t_ns = [int(day.orbit_ns[10]), int(day.orbit_ns[11]) + 100 * NS_PER_S, int(day.orbit_ns[12]) + 10**9]
    log = observations(("G05",), t_ns, [2.2e7] * 3, sv=[0] * 3)
    assert list(precise_states(log, holed).status) == [USED, STALE_EPHEMERIS, STALE_EPHEMERIS]


def test_every_reason_for_a_missing_state_is_told(day: PreciseProducts) -> None:
    start = int(day.orbit_ns[5])
    log = observations(
        ("G05", "G07"), [start - HOUR_NS * 9, start, start, start], [2.2e7] * 4, sv=[0, 0, 1, 0]
    )
    log = with_signals(log, ("C1C", "C9Z"), [0, 0, 0, 1])
    states = precise_states(log, day)
    assert list(states.status) == [STALE_EPHEMERIS, USED, NO_EPHEMERIS, UNKNOWN_SIGNAL]
    assert list(np.isfinite(states.sat).all(axis=1)) == [False, True, False, True]
    assert np.isnan(states.clock_m[[0, 2]]).all()


def test_short_arc_gives_no_state(tmp_path: Path) -> None:
    from_file = products(tmp_path, sp3_text({"G05": [(2.0e4, 0.0, 0.0, 1.0)] * 10}))
    assert list(precise_states(row_of("G05", START_NS + HOUR_NS), from_file).status) == [STALE_EPHEMERIS]


def test_broadcast_orbit_and_clock_are_metres_from_the_precise_ones(
    day: PreciseProducts, broadcast: EphemerisTable
) -> None:
    """Broadcast in 2010: 2 m of orbit (one sigma), 1 m of clock; velocity 1 mm/s; the group delay cancels."""
    for sv in ("G05", "G20"):
        log = row_of(sv, START_NS + 6_300 * NS_PER_S)
        ours, theirs = precise_states(log, day, broadcast), satellite_states(log, broadcast)
        assert ours.status[0] == theirs.status[0] == USED
        assert np.linalg.norm(ours.position - theirs.position) < 4.0
        assert np.linalg.norm(ours.velocity - theirs.velocity) < 2e-3
        assert np.abs(ours.acceleration - theirs.acceleration).max() < 1e-6
        assert ours.clock_m[0] == pytest.approx(theirs.clock_m[0], abs=3.0)
        assert ours.drift_mps[0] == pytest.approx(theirs.drift_mps[0], abs=2e-3)
        assert ours.message[0] == theirs.message[0] >= 0


def test_relativity_must_matter(day: PreciseProducts) -> None:
    """-2 r.v / c of e = 0.0042: up to 2 sqrt(mu a) e / c = 2.9 m."""
    t_ns = START_NS + 6_300 * NS_PER_S
    states = precise_states(row_of("G20", t_ns), day)
    alone = C_MPS * clock_between(day, 1, np.array([t_ns]))[0]
    relativity = -2.0 / C_MPS * np.sum(states.position * states.velocity)
    assert states.clock_m[0] - alone[0] == pytest.approx(relativity, abs=1e-4)
    assert 0.3 < abs(relativity) < 2.95


def test_state_is_that_of_the_time_of_transmission(day: PreciseProducts) -> None:
    t_ns = START_NS + 6_300 * NS_PER_S
    states = precise_states(row_of("G20", t_ns, 2.4e7), day)
    clock_s = clock_between(day, 1, np.array([t_ns]))[0][0]
    sent_ns = t_ns - round((2.4e7 / C_MPS + clock_s) * NS_PER_S)
    # a nanosecond of rounding is 4 um of orbit
    np.testing.assert_allclose(states.sat, orbit_between(day, 1, np.array([sent_ns]))[0], rtol=0, atol=2e-5)


def test_antenna_offset_lowers_the_satellite(day: PreciseProducts) -> None:
    antennas = SatelliteAntennas(("G20",), np.array([0]), np.array([2**62]), np.array([[0.0, 0.0, 1.154]]))
    log = row_of("G20", START_NS + 6_300 * NS_PER_S)
    without, with_offset = precise_states(log, day), precise_states(log, day, antennas=antennas)
    shorter = np.linalg.norm(without.position) - np.linalg.norm(with_offset.position)
    assert shorter == pytest.approx(1.154, abs=1e-6)
    np.testing.assert_array_equal(without.clock_m, with_offset.clock_m)


def test_gps_group_delay_is_the_broadcast_one_and_nothing_without_a_message(
    day: PreciseProducts, broadcast: EphemerisTable
) -> None:
    log = with_signals(
        observations(("G05",), [START_NS + HOUR_NS * 2] * 3, [2.2e7] * 3, sv=[0] * 3),
        ("C1C", "C2W", "C1W"),
        [0, 1, 2],
    )
    tgd_m = -8.84756445885e-9 * C_MPS
    delay, message = pair_delays(log, broadcast)
    np.testing.assert_allclose(delay, [tgd_m, (L1_HZ / L2_HZ) ** 2 * tgd_m, tgd_m], atol=1e-8)
    assert np.all(message >= 0)
    bare, whole = precise_states(log, day), precise_states(log, day, broadcast)
    np.testing.assert_allclose(bare.clock_m - whole.clock_m, delay, atol=1e-6)
    assert list(bare.message) == [-1] * 3


@pytest.mark.parametrize("kind", ["INAV", "FNAV"])
def test_galileo_group_delay_counts_against_e1_and_e5a_whatever_the_message(
    tmp_path: Path, kind: str
) -> None:
    table = navigation_table(tmp_path)
    e02 = copies(table, table.sv_names.index("E02"), message=[kind])
    log = observations(("E02",), [int(e02.toe_ns[0])], [2.4e7])
    # BGD(E1, E5a), as a clock of F/NAV would have it
    assert pair_delays(log, e02)[0][0] == pytest.approx(C_MPS * 2.3e-9, abs=1e-6)


def test_beidou_group_delay_counts_against_b1i_and_b3i(tmp_path: Path) -> None:
    table = navigation_table(tmp_path)
    toe_ns = int(table.toe_ns[table.sv_names.index("C19")])
    log = with_signals(observations(("C19",), [toe_ns] * 2, [2.4e7] * 2, sv=[0, 0]), ("C2I", "C6I"), [0, 1])
    delay, _ = pair_delays(log, table)
    # TGD1 = B1I against B3I: the difference stays, the combination g1 d1 - g2 d3 is zero
    assert delay[0] - delay[1] == pytest.approx(C_MPS * 1.2e-8, abs=1e-6)
    g1 = 1561.098**2 / (1561.098**2 - 1268.52**2)
    assert g1 * delay[0] - (g1 - 1.0) * delay[1] == pytest.approx(0.0, abs=1e-6)


def test_empty_log_gives_no_rows(day: PreciseProducts, broadcast: EphemerisTable) -> None:
    assert len(precise_states(observations((), [], []), day, broadcast).status) == 0
