"""GLONASS orbits: the integration against independent ones, against real messages, and its efficiency."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numba
import numpy as np
import pytest
import sidereon
from scipy.integrate import solve_ivp

from insgnss.constants import GLONASS_MU_M3PS2, GLONASS_OMEGA_RADPS, NS_PER_S
from insgnss.gnss.orbits import glonass as glonass_orbit
from insgnss.gnss.orbits.ephemeris_choice import broadcast_messages
from insgnss.gnss.orbits.glonass import (
    StateVectorArcs,
    arc_state,
    equations_of_motion,
    runge_kutta_step,
    state_vector_arcs,
)
from insgnss.gnss.orbits.plausible_messages import faults_of_states, is_plausible
from insgnss.gnss.orbits.satellite_state import SatelliteStates, satellite_states
from insgnss.status import USED
from insgnss.tables import Float64, StateVectorTable
from tests.gnss.broadcast_sample import observations
from tests.gnss.glonass_sample import FIRST_NS, GLONASS_TEXT, glonass_navigation, glonass_table

VALIDITY_S = 930


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> StateVectorTable:
    return glonass_table(tmp_path_factory.mktemp("navigation"))


def arcs_of(table: StateVectorTable, validity_s: int = VALIDITY_S) -> StateVectorArcs:
    return state_vector_arcs(table, np.full(len(table.sv_names), validity_s * NS_PER_S))


def at(arcs: StateVectorArcs, m: int, t: float) -> Float64:
    out = np.zeros((1, 9))
    arc_state(arcs, m, t, out, 0)
    return out[0]


def second_steps(table: StateVectorTable, m: int, t: float) -> tuple[Float64, Float64]:
    """Return position and velocity by steps of at most 1 s."""
    r_e, v_e, a_e = (array[m : m + 1] for array in (table.r_e, table.v_e, table.a_e))
    n = max(int(np.ceil(abs(t))), 1)
    for _ in range(n):
        r_e, v_e = runge_kutta_step(r_e, v_e, a_e, t / n)
    return r_e[0], v_e[0]


@pytest.mark.parametrize("t", [-929.9, -450.0, -30.7, 0.0, 12.5, 59.999, 60.001, 300.0, 929.9])
def test_orbit_is_that_of_steps_of_one_second(table: StateVectorTable, t: float) -> None:
    """The promise of the module: 0.1 mm, 1e-3 mm/s; acceleration follows the equations to 1e-8 m/s^2."""
    arcs = arcs_of(table)
    for m in range(len(table.sv_names)):
        r_e, v_e = second_steps(table, m, t)
        state = at(arcs, m, t)
        np.testing.assert_allclose(state[:3], r_e, rtol=0, atol=1e-4)
        np.testing.assert_allclose(state[3:6], v_e, rtol=0, atol=1e-6)
        a_e = equations_of_motion(r_e[None], v_e[None], table.a_e[m : m + 1])[0]
        np.testing.assert_allclose(state[6:], a_e, rtol=0, atol=1e-8)


def test_orbit_equals_an_integration_in_the_inertial_frame(table: StateVectorTable) -> None:
    """Other frame, other method (Dormand-Prince 8): gravity of a flattened Earth, no rotating-frame terms; 0.1 mm."""
    still = replace(table, a_e=np.zeros_like(table.a_e))
    t = 900.0
    for m in range(len(still.sv_names)):
        w = np.array([0.0, 0.0, GLONASS_OMEGA_RADPS])
        start = np.concatenate([still.r_e[m], still.v_e[m] + np.cross(w, still.r_e[m])])
        end = solve_ivp(_inertial_motion, (0.0, t), start, "DOP853", rtol=1e-13, atol=1e-6).y[:, -1]
        angle = -GLONASS_OMEGA_RADPS * t
        turn = np.array(
            [[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]]
        )
        np.testing.assert_allclose(at(arcs_of(still), m, t)[:3], turn @ end[:3], rtol=0, atol=1e-4)


def _inertial_motion(_: float, state: Float64) -> Float64:
    """Gravity as the gradient of mu/r (1 - J2 (A/r)^2 P2(z/r)), by differences of the potential's J2 part."""
    r = state[:3]
    distance = np.linalg.norm(r)
    gravity = -GLONASS_MU_M3PS2 * r / distance**3
    for axis, h in zip(np.eye(3), np.full(3, 100.0), strict=True):
        gravity = gravity + axis * (_oblate(r + h * axis) - _oblate(r - h * axis)) / (2.0 * h)
    return np.concatenate([state[3:], gravity])


def _oblate(r: Float64) -> float:
    distance = float(np.linalg.norm(r))
    legendre = 0.5 * (3.0 * (r[2] / distance) ** 2 - 1.0)
    factor = GLONASS_MU_M3PS2 * glonass_orbit.GLONASS_J2 * glonass_orbit.GLONASS_A_M**2
    return float(-factor / distance**3 * legendre)


def test_energy_of_the_rotating_frame_is_kept_without_moon_and_sun(table: StateVectorTable) -> None:
    """Jacobi's integral v^2/2 - omega^2 (x^2 + y^2)/2 - U; what 0.1 mm of height means is 6e-5 m^2/s^2."""
    still = replace(table, a_e=np.zeros_like(table.a_e))
    arcs = arcs_of(still)

    def energy(state: Float64) -> float:
        r, v = state[:3], state[3:6]
        level = r[0] ** 2 + r[1] ** 2
        potential = GLONASS_MU_M3PS2 / np.linalg.norm(r) + _oblate(r)
        return float(0.5 * v @ v - 0.5 * GLONASS_OMEGA_RADPS**2 * level - potential)

    for m in range(len(still.sv_names)):
        for t in (-900.0, 900.0):
            assert energy(at(arcs, m, t)) == pytest.approx(energy(at(arcs, m, 0.0)), abs=6e-5)


@pytest.mark.parametrize("t", [-900.0, -600.0, -60.0, 0.0, 437.25, 899.0])
def test_orbit_equals_an_independent_implementation(
    table: StateVectorTable, t: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """1 mm; that implementation rounds mu to 3.9860044e14, which alone moves the orbit by 1 mm in 15 min."""
    monkeypatch.setattr(glonass_orbit, "GLONASS_MU_M3PS2", 3.9860044e14)
    arcs, theirs = arcs_of(table), sidereon.parse_rinex_nav(GLONASS_TEXT)
    query = sidereon.ExactEpochQuery.from_binary_j2000_seconds
    for record in sidereon.parse_rinex_glonass_records(GLONASS_TEXT):
        toe = record.toe_gpst_j2000_s
        state = theirs.selected_state_at_epoch_query(record.satellite, query(toe + t), query(toe))
        m = next(
            k
            for k, name in enumerate(table.sv_names)
            if name == record.satellite and (table.r_e[k] == record.position_m).all()
        )
        np.testing.assert_allclose(at(arcs, m, t)[:3], state.position_ecef_m, rtol=0, atol=1e-3)
        clock_s = table.clock_s[m] + table.clock_rate[m] * t
        assert clock_s == pytest.approx(state.clock_s, abs=1e-15)


def test_message_agrees_with_the_next_one_of_its_satellite(table: StateVectorTable) -> None:
    """Half an hour on 4 m and 4 mm/s, half way 1.5 m; the satellite has moved by thousands of kilometres."""
    arcs = arcs_of(table, 1800)
    for m in range(0, len(table.sv_names), 2):
        assert table.sv_names[m] == table.sv_names[m + 1]
        forward, backward = at(arcs, m, 1800.0), at(arcs, m + 1, -1800.0)
        assert np.linalg.norm(table.r_e[m + 1] - table.r_e[m]) > 3e6
        assert np.linalg.norm(forward[:3] - table.r_e[m + 1]) < 4.0
        assert np.linalg.norm(backward[:3] - table.r_e[m]) < 4.0
        assert np.linalg.norm(forward[3:6] - table.v_e[m + 1]) < 4e-3
        half_way = at(arcs, m, 900.0) - at(arcs, m + 1, -900.0)
        assert np.linalg.norm(half_way[:3]) < 1.5


@pytest.mark.parametrize("what", ["moon and sun", "flattening", "rotation"])
def test_each_term_must_matter(table: StateVectorTable, what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = at(arcs_of(table), 0, 900.0)
    if what == "moon and sun":
        table = replace(table, a_e=np.zeros_like(table.a_e))
    elif what == "flattening":
        monkeypatch.setattr(glonass_orbit, "GLONASS_J2", 0.0)
    else:
        monkeypatch.setattr(glonass_orbit, "GLONASS_OMEGA_RADPS", 0.0)
    moved = np.linalg.norm(at(arcs_of(table), 0, 900.0)[:3] - whole[:3])
    # accelerations of 4e-6, 5e-5 and 0.1 m/s^2 over 900^2 / 2 s^2
    assert moved > {"moon and sun": 0.5, "flattening": 15.0, "rotation": 3e4}[what]


def test_sbas_state_is_the_quadratic_of_its_message(table: StateVectorTable) -> None:
    sbas = replace(table, sv_names=("S23",) * len(table.sv_names))
    r, v, a = table.r_e[0], table.v_e[0], table.a_e[0]
    for t in (-300.0, 0.0, 61.0, 300.0):
        expected = np.concatenate([r + v * t + 0.5 * a * t * t, v + a * t, a])
        np.testing.assert_allclose(at(arcs_of(sbas, 360), 0, t), expected, rtol=1e-15)


@pytest.mark.parametrize(
    ("column", "value"),
    [("r_e", np.nan), ("r_e", 0.0), ("r_e", 1e12), ("v_e", np.inf), ("v_e", 1e5), ("clock_s", np.nan)],
)
def test_message_of_senseless_numbers_is_not_sane(table: StateVectorTable, column: str, value: float) -> None:
    assert is_plausible(faults_of_states(table), len(table.t_ns)).all()
    changed = getattr(table, column).copy()
    changed[2] = value
    sane = is_plausible(faults_of_states(replace(table, **{column: changed})), len(table.t_ns))
    assert list(np.flatnonzero(~sane)) == [2]


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="plain Python takes minutes for a million rows")
def test_an_hour_of_ten_hertz_is_computed(tmp_path: Path, benchmark: Callable[..., SatelliteStates]) -> None:
    nav = glonass_navigation(tmp_path)
    names, n = ("R03", "R08", "R14", "R24"), 360_000
    t = FIRST_NS + np.repeat(np.arange(n // 4) * (2700 * NS_PER_S // (n // 4)), 4) - 900 * NS_PER_S
    log = observations(names, t, np.full(n, 2.1e7), sv=np.tile(np.arange(4), n // 4))
    satellite_states(observations(names[:1], t[:1], [2e7]), nav)
    states = benchmark(lambda: satellite_states(log, broadcast_messages(nav)))  # below half a second
    assert np.all(states.status == USED)
