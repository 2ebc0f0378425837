"""The satellites' pieces against the orbits they are made of."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insgnss.aiding.satellite_arcs import (
    PIECE_NS,
    SatelliteArcs,
    broadcast_arcs,
    earth_turn_matrix,
    elevations,
    precise_arcs,
)
from insgnss.constants import C_MPS, NS_PER_S, WGS84_OMEGA_RADPS
from insgnss.gnss.orbits.ephemeris_choice import broadcast_messages
from insgnss.gnss.orbits.satellite_state import satellite_states
from insgnss.simulation.sky import nominal_constellation
from insgnss.simulation.sky import satellite_states as simulated_states
from insgnss.tables import Float64, PreciseProducts
from tests.gnss.broadcast_sample import TOE_NS, navigation_table, observations

SIGNALS = {"G": "C1C", "E": "C1C", "J": "C1C", "C": "C2I"}


def states_of(arcs: SatelliteArcs, satellite: int, t_ns: int) -> Float64:
    """Return position, velocity, acceleration in ECEF, clock and drift, of a piece."""
    since_ns = t_ns - arcs.arcs.start_ns
    p = since_ns // PIECE_NS
    t = (since_ns - p * PIECE_NS) / NS_PER_S
    c = arcs.arcs.pieces[satellite, p]
    k = np.arange(6)
    r, v, a = (
        c @ (t**k),
        c[:, 1:] @ (k[1:] * t ** k[:-1]),
        c[:, 2:] @ (k[2:] * k[1:-1] * t ** k[:-2]),
    )
    back = earth_turn_matrix(t).T
    r_e, V, A = back @ r[:3], back @ v[:3], back @ a[:3]
    w = np.array([0.0, 0.0, WGS84_OMEGA_RADPS])
    v_e = V - np.cross(w, r_e)
    a_e = A - 2.0 * np.cross(w, v_e) - np.cross(w, np.cross(w, r_e))
    return np.concatenate([r_e, v_e, a_e, [r[3], v[3]]])


def test_pieces_are_the_orbits_of_the_messages(tmp_path: Path) -> None:
    messages = broadcast_messages(navigation_table(tmp_path))
    start = TOE_NS + 600 * NS_PER_S
    arcs = broadcast_arcs(messages, SIGNALS, start, start + 1800 * NS_PER_S)
    times = start + np.arange(0, 1800, 7, dtype=np.int64) * NS_PER_S + 123_456_789

    for satellite, name in enumerate(arcs.sv_names):
        code = SIGNALS[name[0]]
        # a pseudorange of minus the satellite's clock makes the transmission fall on the tag itself
        blank = observations((name,), times, np.zeros(len(times)), sv=np.zeros(len(times), int), code="")
        clock = satellite_states(blank, messages).clock_m
        at = observations((name,), times, -clock, sv=np.zeros(len(times), int), code=code)
        states = satellite_states(at, messages)
        found = np.array([states_of(arcs, satellite, int(t)) for t in times])
        error = np.abs(found[:, :9] - states.sat)
        # the perigee of e = 0.17 bends ten times as much
        worse = 20.0 if name == "E14" else 1.0
        assert error[:, 0:3].max() < 1e-6 * worse, name
        assert error[:, 3:6].max() < 1e-8 * worse, name
        assert error[:, 6:9].max() < 1e-9 * worse, name
        np.testing.assert_allclose(found[:, 9], states.clock_m, atol=1e-6, rtol=0.0)
        np.testing.assert_allclose(found[:, 10], states.drift_mps, atol=1e-8, rtol=0.0)


def test_satellite_without_a_valid_message_has_no_state(tmp_path: Path) -> None:
    messages = broadcast_messages(navigation_table(tmp_path))
    late = TOE_NS + 3 * 3600 * NS_PER_S  # beyond GPS's two hours, within Galileo's four
    arcs = broadcast_arcs(messages, SIGNALS, late, late)

    known = np.isfinite(arcs.arcs.pieces[:, 0, 0, 0])
    assert known[[name[0] == "E" for name in arcs.sv_names]].all()
    assert not known[[name[0] == "G" for name in arcs.sv_names]].any()


def test_pieces_made_bit_by_bit_are_those_made_at_once(tmp_path: Path) -> None:
    messages = broadcast_messages(navigation_table(tmp_path))
    start = TOE_NS + 600 * NS_PER_S
    whole = broadcast_arcs(messages, SIGNALS, start, start + 1000 * NS_PER_S)
    live = broadcast_arcs(messages, SIGNALS, start, start)
    while not live.covers(start, start + 1000 * NS_PER_S):
        live = live.joined(broadcast_arcs(messages, SIGNALS, live.end_ns, live.end_ns + 200 * NS_PER_S))
    n = whole.arcs.pieces.shape[1]

    np.testing.assert_array_equal(live.arcs.pieces[:, :n], whole.arcs.pieces)
    past_gone = live.since(start + 500 * NS_PER_S)
    assert past_gone.covers(start + 500 * NS_PER_S, start + 1000 * NS_PER_S)
    assert not past_gone.covers(start, start)
    k = (past_gone.arcs.start_ns - live.arcs.start_ns) // PIECE_NS
    np.testing.assert_array_equal(past_gone.arcs.pieces, live.arcs.pieces[:, k:])


def test_elevation_of_a_satellite_overhead_is_ninety_degrees(tmp_path: Path) -> None:
    messages = broadcast_messages(navigation_table(tmp_path))
    start = TOE_NS + 600 * NS_PER_S
    arcs = broadcast_arcs(messages, SIGNALS, start, start)
    below = states_of(arcs, 2, start)[:3]
    up = below / np.linalg.norm(below)
    sine = elevations(arcs.arcs, np.array([start]), 6.4e6 * up[None], up[None])

    assert sine[0, 2] == pytest.approx(1.0, abs=1e-9)
    assert (sine[0] <= 1.0).all()


def test_pieces_of_precise_products_are_the_simulated_orbits(rng: np.random.Generator) -> None:
    broadcast = nominal_constellation(TOE_NS).ephemerides
    seconds = np.arange(0.0, 6.0 * 3600.0 + 1.0, 900.0)
    count = len(broadcast.sv_names)
    at = simulated_states(broadcast, TOE_NS, np.repeat(seconds[:, None], count, axis=1))
    bias_s, drift = rng.normal(0.0, 1e-4, count), rng.normal(0.0, 1e-10, count)
    nodes_ns = TOE_NS + np.rint(seconds * NS_PER_S).astype(np.int64)
    clock_s = bias_s[:, None] + drift[:, None] * seconds
    products = PreciseProducts(broadcast.sv_names, nodes_ns, np.moveaxis(at.r_e, 0, 1), nodes_ns, clock_s)

    begin_s = 3.0 * 3600.0
    begin_ns = TOE_NS + int(begin_s) * NS_PER_S
    arcs = precise_arcs(products, SIGNALS, begin_ns, begin_ns + 900 * NS_PER_S)
    times_s = begin_s + np.arange(0.5, 900.0, 77.0)
    truth = simulated_states(broadcast, TOE_NS, np.repeat(times_s[:, None], count, axis=1))

    assert arcs.sv_names == broadcast.sv_names
    for s in range(0, count, 5):
        found = np.array([states_of(arcs, s, TOE_NS + int(t * NS_PER_S)) for t in times_s])
        r_e, v_e = truth.r_e[:, s], truth.v_e[:, s]
        # the interpolation of nodes a quarter of an hour apart is good to a tenth of a millimetre
        assert np.abs(found[:, 0:3] - r_e).max() < 1e-4
        assert np.abs(found[:, 3:6] - v_e).max() < 1e-6
        # a satellite's clock runs slower near its perigee: -2 r.v / c^2
        relativity_m = -2.0 * np.sum(r_e * v_e, axis=1) / C_MPS
        assert np.abs(found[:, 9] - C_MPS * (bias_s[s] + drift[s] * times_s) - relativity_m).max() < 1e-5
        rate = np.gradient(relativity_m, times_s)
        assert np.abs(found[:, 10] - C_MPS * drift[s] - rate)[1:-1].max() < 1e-7  # one-sided at both ends
