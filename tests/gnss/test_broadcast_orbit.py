"""The broadcast orbit: Kepler's equation, analytic derivatives, and an independent implementation."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import sidereon
from hypothesis import example, given
from hypothesis import strategies as st

from insgnss.constants import WGS84_OMEGA_RADPS
from insgnss.gnss.orbits.broadcast import eccentric_anomaly, orbit_state
from insgnss.gnss.orbits.ephemeris_rows import M0, E, N, ephemeris_rows, is_beidou_geo
from insgnss.tables import EphemerisTable, Float64
from tests.gnss.broadcast_sample import ORBITS, navigation_table, navigation_text
from tests.jacobian import finite_difference_jacobian

EPSILON = np.finfo(np.float64).eps
AGES_S = (-7200.0, -1000.123, 0.0, 0.001, 3333.3, 7200.0)


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> EphemerisTable:
    return navigation_table(tmp_path_factory.mktemp("navigation"))


def state_at(rows: Float64, k: int, t: float) -> Float64:
    """Return position, velocity, acceleration (9,) of message ``k``, ``t`` seconds after its toe."""
    mean = rows[k, M0] + rows[k, N] * t
    _, sine, cosine = eccentric_anomaly(mean, rows[k, E], mean)
    out = np.zeros((1, 9))
    orbit_state(rows, k, t, sine, cosine, out, 0)
    return out[0]


@given(
    st.floats(-20.0, 20.0),
    st.one_of(st.floats(0.0, 0.999999), st.floats(1e-16, 1e-6).map(lambda gap: 1.0 - gap)),
    st.floats(-20.0, 20.0),
)
@example(0.0, 1.0 - 1e-16, 0.0)
@example(math.pi, 0.99, 0.0)
@example(1e-9, 0.9999999, 3.0)
def test_kepler_equation_holds_to_machine_precision_for_any_ellipse(
    mean: float, e: float, start: float
) -> None:
    anomaly, sine, cosine = eccentric_anomaly(mean, e, start)
    # the terms of E - e sin E = M are each rounded once or twice
    assert abs(anomaly - e * math.sin(anomaly) - mean) <= 4.0 * EPSILON * (1.0 + abs(mean))
    # they belong to the anomaly before it was rounded
    assert sine == pytest.approx(math.sin(anomaly), abs=4.0 * EPSILON * (1.0 + abs(anomaly)))
    assert cosine == pytest.approx(math.cos(anomaly), abs=4.0 * EPSILON * (1.0 + abs(anomaly)))


@given(st.floats(-3.1, 3.1), st.floats(0.0, 0.9))
def test_kepler_solution_does_not_depend_on_the_first_guess(mean: float, e: float) -> None:
    results = [eccentric_anomaly(mean, e, start)[0] for start in (mean, mean + e, -10.0, 0.0)]
    assert max(results) - min(results) <= 4.0 * EPSILON * (1.0 + abs(mean)) / (1.0 - e)


@pytest.mark.parametrize("sv", ORBITS)
def test_velocity_and_acceleration_are_the_derivatives_of_position(table: EphemerisTable, sv: str) -> None:
    rows = ephemeris_rows(table)
    k = table.sv_names.index(sv)
    for t in AGES_S:
        state = state_at(rows, k, t)
        slope = finite_difference_jacobian(lambda x: state_at(rows, k, x[0])[:6], [t], 10.0)[:, 0]
        # rounding 4e-9 m over a step of 10 s, then of 1e-12 m/s
        np.testing.assert_allclose(slope[:3], state[3:6], rtol=0, atol=1e-8)
        np.testing.assert_allclose(slope[3:], state[6:9], rtol=0, atol=1e-11)


def agreement(table: EphemerisTable, records: list[sidereon.BroadcastRecord]) -> tuple[float, float]:
    """Return the largest differences of position [m] and velocity [m/s] from the independent evaluation."""
    rows = ephemeris_rows(table)
    own = {(sv, int(toe)): k for k, (sv, toe) in enumerate(zip(table.sv_names, table.toe_sow_s, strict=True))}
    position, velocity = 0.0, 0.0
    for record in records:
        k = own[record.satellite, round(record.toe_tow_s)]

        def place(x: Float64, record: sidereon.BroadcastRecord = record) -> Float64:
            return np.asarray(record.evaluate(record.toe_tow_s + float(x[0])).position_m)

        for t in AGES_S:
            state = state_at(rows, k, t)
            position = max(position, float(np.abs(state[:3] - place(np.array([t]))).max()))
            slope = finite_difference_jacobian(place, [t], 20.0)[:, 0]
            velocity = max(velocity, float(np.abs(state[3:6] - slope).max()))
    return position, velocity


def test_self_made_messages_agree_with_an_independent_evaluation(table: EphemerisTable) -> None:
    records = sidereon.parse_rinex_nav_records(navigation_text())
    assert sorted({record.satellite for record in records}) == sorted(ORBITS)
    position, velocity = agreement(table, records)
    assert position < 1e-3
    assert velocity < 1e-5


@pytest.mark.real_data
@pytest.mark.parametrize(
    "name",
    [
        "instinct_static_20230629/nav_reach_m2.rnx",
        "walk_boulder_20250828/nav_decoded_from_ubx.rnx",
        "xian_psins_20211108/nav_from_mat.rnx",
    ],
)
def test_recorded_messages_agree_with_an_independent_evaluation(data_root: Path, name: str) -> None:
    from insgnss.log.rinex.navigation import read_navigation

    data, _ = read_navigation([data_root / name])
    records = sidereon.parse_rinex_nav_records((data_root / name).read_text())
    position, velocity = agreement(data.ephemerides, records)
    assert position < 1e-3
    assert velocity < 1e-5


def test_geostationary_satellite_stays_where_it_is(table: EphemerisTable) -> None:
    rows = ephemeris_rows(table)
    k = table.sv_names.index("C03")
    start, later = state_at(rows, k, 0.0), state_at(rows, k, 3600.0)
    assert np.linalg.norm(start[:3]) == pytest.approx(4.216e7, rel=1e-3)
    assert np.linalg.norm(later[:3] - start[:3]) < 1e6
    assert np.linalg.norm(start[3:6]) < 300.0


def test_tilt_of_geostationary_elements_must_matter(table: EphemerisTable) -> None:
    rows = ephemeris_rows(table)
    k = table.sv_names.index("C03")
    as_others = rows.copy()
    as_others[k, 17] = 0.0  # EARTH_RATE: no second rotation
    assert np.linalg.norm(state_at(rows, k, 0.0)[:3] - state_at(as_others, k, 0.0)[:3]) > 1e6


def test_geostationary_message_is_known_by_its_kind_or_else_its_number() -> None:
    assert is_beidou_geo("C03", "D2") and is_beidou_geo("C60", "")
    assert not is_beidou_geo("C19", "") and not is_beidou_geo("C03", "D1")


def test_acceleration_is_gravity_in_the_turning_frame(table: EphemerisTable) -> None:
    """a + 2 omega x v + omega x (omega x r) = -mu r / r^3, up to the perturbations in the elements (1e-4)."""
    rows = ephemeris_rows(table)
    omega = np.array([0.0, 0.0, WGS84_OMEGA_RADPS])
    for k, sv in enumerate(table.sv_names):
        r, v, a = np.split(state_at(rows, k, 100.0), 3)
        inertial = a + 2.0 * np.cross(omega, v) + np.cross(omega, np.cross(omega, r))
        gravity = -3.986e14 * r / np.linalg.norm(r) ** 3
        assert np.linalg.norm(inertial - gravity) < 2e-4, sv
