"""The satellite's clock: polynomial, relativity, drift, group delay."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import sidereon

from insgnss.constants import C_MPS, WGS84_OMEGA_RADPS
from insgnss.gnss.orbits.broadcast import eccentric_anomaly, orbit_state
from insgnss.gnss.orbits.ephemeris_rows import CIC, CUS, M0, RELATIVITY, TOC_MINUS_TOE, E, N, ephemeris_rows
from insgnss.gnss.orbits.satellite_clock import group_delay, satellite_clock
from insgnss.gnss.signals import signal_of
from insgnss.tables import EphemerisTable, Float64
from tests.gnss.broadcast_sample import ORBITS, TOE_SOW, navigation_table, navigation_text
from tests.jacobian import finite_difference_jacobian


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> EphemerisTable:
    return navigation_table(tmp_path_factory.mktemp("navigation"))


def clock_at(rows: Float64, k: int, t: float) -> tuple[float, float]:
    _, sine, cosine = eccentric_anomaly(rows[k, M0] + rows[k, N] * t, rows[k, E], 0.0)
    return satellite_clock(rows, k, t, sine, cosine)


def test_clock_agrees_with_an_independent_evaluation(table: EphemerisTable) -> None:
    rows = ephemeris_rows(table)
    for record in sidereon.parse_rinex_nav_records(navigation_text()):
        k = table.sv_names.index(record.satellite)
        for t in (-7200.0, -12.5, 0.0, 3600.0):
            theirs = record.evaluate(record.toe_tow_s + t)
            clock, _ = clock_at(rows, k, t)
            assert clock == pytest.approx(C_MPS * (theirs.clock_s + theirs.group_delay_s), abs=1e-6)


def test_clock_time_counts_from_toc_not_toe(table: EphemerisTable) -> None:
    rows = ephemeris_rows(table)[:1].copy()
    before, _ = clock_at(rows, 0, 0.0)
    rows[0, TOC_MINUS_TOE] = -3600.0
    later, _ = clock_at(rows, 0, 0.0)
    assert later - before == pytest.approx(C_MPS * (4.5e-12 * 3600.0 + 2e-18 * 3600.0**2), abs=1e-6)


def test_periodic_relativity_equals_minus_two_r_dot_v_over_c(table: EphemerisTable) -> None:
    """For an undisturbed ellipse F e sqrt(a) sin E = -2 r.v / c^2, v inertial (IS-GPS-200N, 20.3.3.3.3.1)."""
    rows = ephemeris_rows(table)
    rows[:, CUS : CIC + 1] = 0.0
    out = np.zeros((1, 9))
    for sv in ("G04", "E14", "J02"):
        k = table.sv_names.index(sv)
        mu = 3.986005e14 if sv[0] in "GJ" else 3.986004418e14
        rows[k, N] = np.sqrt(mu / rows[k, 0] ** 3)
        rows[k, 8], rows[k, 10] = 0.0, -7.2921151467e-5  # the plane stands still in space
        _, sine, cosine = eccentric_anomaly(rows[k, M0] + rows[k, N] * 500.0, rows[k, E], 0.0)
        orbit_state(rows, k, 500.0, sine, cosine, out, 0)
        r, v = out[0, :3], out[0, 3:6] + np.cross([0.0, 0.0, WGS84_OMEGA_RADPS], out[0, :3])
        assert C_MPS * rows[k, RELATIVITY] * sine == pytest.approx(-2.0 * (r @ v) / C_MPS, rel=1e-6)


def test_drift_is_the_derivative_of_the_clock(table: EphemerisTable) -> None:
    rows = ephemeris_rows(table)
    for k in range(len(rows)):
        # rounding of 1e5 m over 20 s
        slope = finite_difference_jacobian(lambda t: clock_at(rows, k, t[0])[0], [1234.5], 20.0)[0, 0]  # noqa: B023
        assert clock_at(rows, k, 1234.5)[1] == pytest.approx(slope, abs=1e-10)


@pytest.mark.parametrize(("sv", "least_m"), [("G04", 10.0), ("E14", 70.0), ("J02", 40.0)])
def test_relativity_must_matter(table: EphemerisTable, sv: str, least_m: float) -> None:
    rows = ephemeris_rows(table)
    without = rows.copy()
    without[:, RELATIVITY] = 0.0
    k = table.sv_names.index(sv)
    effect = [
        clock_at(rows, k, t)[0] - clock_at(without, k, t)[0] for t in np.linspace(-40_000.0, 40_000.0, 41)
    ]
    assert max(effect) > least_m and min(effect) < -least_m


@pytest.mark.parametrize(
    ("sv", "code", "fnav", "delay_s"),
    [
        ("G04", "C1C", 0, 5.1e-9),
        ("G04", "C2W", 0, 5.1e-9 * (77 / 60) ** 2),
        ("E02", "C1C", 0, 2.8e-9),  # I/NAV: BGD E5b/E1
        ("E02", "C1C", 1, 2.3e-9),  # F/NAV: BGD E5a/E1
        ("E02", "C5Q", 1, 2.3e-9 * (1575.42 / 1176.45) ** 2),
        ("E02", "C7Q", 0, 2.8e-9 * (1575.42 / 1207.14) ** 2),
        ("C19", "C2I", 0, 1.2e-8),
        ("C19", "C7I", 0, 3.0e-9),
        ("C19", "C6I", 0, 0.0),
        ("J02", "C1C", 0, -4.2e-9),
    ],
)
def test_group_delay_of_each_signal(
    table: EphemerisTable, sv: str, code: str, fnav: int, delay_s: float
) -> None:
    signal = signal_of(sv[0], code)
    assert signal is not None
    factors = (signal.group_delay_fnav if fnav else None) or signal.group_delay
    delay = group_delay(ephemeris_rows(table), table.sv_names.index(sv), *factors)
    assert delay == pytest.approx(C_MPS * delay_s, abs=1e-9)


def test_sample_message_is_at_its_reference_time(tmp_path: Path) -> None:
    """BeiDou's times, 14 s behind, come out at the same instant as the others'."""
    table = navigation_table(tmp_path)
    assert set(table.sv_names) == set(ORBITS)
    assert len(set(table.toe_ns)) == 1 and len(set(table.toc_ns)) == 1
    assert set(table.toe_sow_s) == {TOE_SOW, TOE_SOW - 14.0}
