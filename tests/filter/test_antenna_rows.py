"""Phase differences between antennas as rows of the filter: derivatives, shared noise, clocks, who counts from whom."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from insgnss.antenna.equipment import limits_of
from insgnss.attitude.baselines import attitude_matrices
from insgnss.attitude.cycle_search import clock_columns
from insgnss.filter.antennas.rows import (
    Antennas,
    Differences,
    attitude_rows,
    baselines,
    directions,
    form_differences,
    predicted,
    whitened,
    without_clocks,
)
from insgnss.filter.antennas.visibility import AntennaMasking, hidden_reasons
from insgnss.filter.state import PSI
from insgnss.geodesy.rotations import rotation_matrix
from insgnss.gnss.antenna_phases import AntennaPhases
from insgnss.gnss.line_of_sight import line_of_sight_range
from insgnss.status import MASKED_GAIN, USED
from tests.antenna.vehicle import vehicle
from tests.jacobian import finite_difference_jacobian
from tests.receiver.banking import MASK

LEVER_B = np.array([[0.4, 0.1, -1.3], [1.4, 0.1, -1.3], [0.9, 1.0, -1.2]])
R_E = np.array([2_762_000.0, 1_618_000.0, 5_498_000.0])
C_EB = attitude_matrices([0.3, -0.5, 2.0])
# antennas 0, 1, 2 see channels 0 to 3 but for: channel 1 not the main one, channel 3 one alone
SEEN = ((0, 0), (0, 2), (1, 0), (1, 1), (1, 2), (2, 0), (2, 1), (2, 2), (2, 3))


def antennas(*, separate: bool = False) -> Antennas:
    """Return three parallel antennas."""
    return Antennas(
        ("main", "ahead", "right"), LEVER_B, np.zeros(3), np.stack([np.eye(3)] * 3), separate, 0.002, 0.003
    )


def satellites() -> np.ndarray:
    """Return position and velocity of four satellites above, (4, 6)."""
    up = R_E / np.linalg.norm(R_E)
    towards = up + np.array([[0.5, 0.1, 0.2], [-0.4, 0.5, 0.0], [0.1, -0.6, 0.3], [0.0, 0.2, -0.5]])
    r = R_E + 2.2e7 * towards / np.linalg.norm(towards, axis=1, keepdims=True)
    return np.hstack([r, np.array([[900.0, 2000.0, -1500.0]] * 4)])


def phases(C_eb: np.ndarray = C_EB, clocks_m: tuple[float, ...] = (0.0, 0.0, 0.0)) -> AntennaPhases:
    """Return the phases of one epoch without noise and whole cycles."""
    antenna, channel = (np.array(column) for column in zip(*SEEN, strict=True))
    sat = satellites()[channel]
    place = R_E + LEVER_B[antenna] @ C_eb.T
    path = np.array([line_of_sight_range(sat, k, place[k], np.zeros(3)) for k in range(len(sat))])
    n = len(SEEN)
    return AntennaPhases(
        names=(("G01", "C1C"), ("G02", "C1C"), ("G03", "C1C"), ("G04", "C1C")),
        epoch_ns=np.array([1_000_000_000]),
        first=np.array([0, n]),
        t_ns=np.full(n, 1_000_000_000),
        antenna=antenna.astype(np.int8),
        channel=channel,
        phase_m=path + np.array(clocks_m)[antenna],
        code_m=path + np.array(clocks_m)[antenna],
        wavelength_m=np.full(n, 0.19),
        cn0_dbhz=np.array([45.0, 40.0, 48.0, 44.0, 41.0, 45.0, 38.0, 46.0, 50.0]),
        sat=sat,
        has_slipped=np.zeros(n, np.bool_),
        status=np.full(n, USED, np.int8),
    )


def differences(*, separate: bool = False, clocks_m: tuple[float, ...] = (0.0, 0.0, 0.0)) -> Differences:
    """Return the differences of the epoch."""
    return form_differences(
        phases(clocks_m=clocks_m), np.arange(len(SEEN)), antennas(separate=separate), R_E, np.zeros(3)
    )


def test_a_satellite_that_the_main_antenna_lacks_counts_between_the_others() -> None:
    found = [(a, b, sv) for a, b, (sv, _) in differences().keys]

    assert found == [(0, 1, "G01"), (0, 1, "G03"), (0, 2, "G01"), (1, 2, "G02"), (0, 2, "G03")]


def test_prediction_is_the_difference_of_ranges() -> None:
    d = differences()

    value = predicted(d, baselines(d, antennas()), C_EB, antennas())

    # left out: the curvature of the wave between the IMU, 1.7 m off, and a baseline of 1.4 m: 1e-7 m each, 3e-7 at most
    assert d.value_m == pytest.approx(value, abs=3e-7)


def test_attitude_columns_are_the_derivative_of_the_prediction() -> None:
    d = differences()
    l_b = baselines(d, antennas())

    # C_eb_hat = (I + [psi x]) C_eb, psi estimate minus truth
    J = finite_difference_jacobian(
        lambda psi: predicted(d, l_b, rotation_matrix(psi) @ C_EB, antennas()), np.zeros(3), 1e-3
    )

    assert attitude_rows(d, l_b, C_EB) == pytest.approx(J, abs=1e-9)


def test_tilted_antennas_have_their_wind_up_in_the_prediction() -> None:
    d = differences()
    turned = np.stack([np.eye(3), attitude_matrices([0.0, 0.0, 0.5]), np.eye(3)])
    tilted = replace(antennas(), C_ba=turned)
    l_b = baselines(d, antennas())

    more = predicted(d, l_b, C_EB, tilted) - predicted(d, l_b, C_EB, antennas())

    # half a radian about the axis that points down: 0.5 / 2 pi of a wavelength where a satellite stands above it
    assert np.abs(more).max() < 0.19
    assert (np.abs(more[[0, 1, 3]]) > 0.001).all()
    assert more[[2, 4]] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("separate", [False, True])
def test_whitened_rows_hold_the_information_of_the_correlated_ones(separate: bool) -> None:
    d = differences(separate=separate)
    H = attitude_rows(d, baselines(d, antennas()), C_EB)
    y = np.linspace(-0.01, 0.01, len(H))

    rows, rest = whitened(d, H, y, 3.0)

    W, B = np.linalg.inv(d.white + 3.0 * d.slow), clock_columns(d.clock)
    if separate:
        W = W - W @ B @ np.linalg.inv(B.T @ W @ B) @ B.T @ W
    assert len(rows) == len(H) - B.shape[1]
    assert rows.T @ rows == pytest.approx(H.T @ W @ H, rel=1e-9)
    assert rows.T @ rest == pytest.approx(H.T @ W @ y, rel=1e-8)


def test_differences_that_count_from_one_phase_share_its_noise() -> None:
    d = differences()

    shared = 0.002**2  # G01 at the main antenna, 45 dBHz
    assert d.white[0, 2] == pytest.approx(shared)
    assert d.white[0, 1] == 0.0
    assert d.white[0, 0] == pytest.approx(shared * (1.0 + 10.0**-0.3))  # and 48 dBHz at the other


def test_noise_of_a_phase_is_thermal_and_plain_and_grows_towards_the_horizon() -> None:
    d = differences()
    array = replace(antennas(), phase_floor_m=0.003, phase_elevation_m=0.001)
    more = form_differences(phases(), np.arange(len(SEEN)), array, R_E, np.zeros(3))

    sine = d.u_e @ (R_E / np.linalg.norm(R_E))
    of_one = 0.003**2 + (0.001 / sine) ** 2
    assert np.diag(more.white) - np.diag(d.white) == pytest.approx(2.0 * of_one, rel=1e-9)
    assert more.white[0, 2] - d.white[0, 2] == pytest.approx(of_one[0], rel=1e-9)
    assert more.slow == pytest.approx(d.slow)


def test_phase_of_a_satellite_that_may_be_hidden_has_a_share_of_a_cycles_spread() -> None:
    d, doubt = differences(), np.zeros(len(SEEN))
    doubt[SEEN.index((1, 0))] = 0.3  # of antenna 1 alone; antenna 2 has its own view
    more = form_differences(phases(), np.arange(len(SEEN)), antennas(), R_E, np.zeros(3), doubt)

    expected = np.zeros_like(d.white)
    expected[0, 0] = 0.3 * 0.19**2 / 12.0
    assert more.white - d.white == pytest.approx(expected, abs=1e-15)
    doubt[:] = 0.0
    doubt[SEEN.index((0, 0))] = 1.0  # the one that two differences count from
    shared = form_differences(phases(), np.arange(len(SEEN)), antennas(), R_E, np.zeros(3), doubt)
    assert (shared.white - d.white)[np.ix_([0, 2], [0, 2])] == pytest.approx(0.19**2 / 12.0)


@pytest.mark.parametrize("name", ["keep", "hide", "deweight"])
def test_antenna_that_may_not_see_a_satellite_hides_it_or_doubts_it(name: str) -> None:
    hiding = AntennaMasking((vehicle("cardioid"),), limits_of(MASK.model_copy(update={"uncertain": name})))
    # 1 deg above the edge at 5 deg, 1 deg below it, and far above
    elevation = np.radians([6.0, 4.0, 60.0])
    u_n = np.column_stack([np.cos(elevation), np.zeros(3), -np.sin(elevation)])
    P = np.zeros((15, 15))
    P[PSI : PSI + 3, PSI : PSI + 3] = np.radians(1.0) ** 2 * np.eye(3)
    reasons, doubt = hidden_reasons(hiding, np.zeros(3, np.int8), u_n, np.eye(3), np.eye(3), P)

    hidden = [MASKED_GAIN, MASKED_GAIN, USED] if name == "hide" else [USED] * 3
    assert reasons.tolist() == hidden
    expected = stats.norm.sf([1.0, -1.0, math.inf]) if name == "deweight" else np.zeros(3)
    assert doubt == pytest.approx(expected, abs=0.02)


def test_clocks_of_their_own_fall_out_even_a_millisecond_apart() -> None:
    clocks_m = (1000.0, 290_000.0, -40_000.0)
    # what a receiver of a late clock measures later: the ranges have moved on
    base, sat = phases(clocks_m=clocks_m), satellites()
    rate = np.sum(directions(sat, R_E) * sat[:, 3:], axis=1)
    moved = -rate[base.channel] * np.array(clocks_m)[base.antenna] / 299_792_458.0
    late = replace(base, phase_m=base.phase_m + moved, code_m=base.code_m + moved)
    array = antennas(separate=True)
    d = form_differences(late, np.arange(len(SEEN)), array, R_E, np.zeros(3))

    y = d.value_m - predicted(d, baselines(d, array), C_EB, array)
    rest = without_clocks(d, np.ones(len(y), np.bool_)) @ y

    assert np.ptp(y) > 1000.0
    # the codes' differences hold a metre of the baseline: 3 ns times the satellites' 2000 m/s
    assert rest == pytest.approx(0.0, abs=2e-5)


def test_satellites_are_turned_by_the_earth_while_their_signal_travels() -> None:
    sat, u = satellites(), np.zeros(3)
    for k, towards in enumerate(directions(sat, R_E)):
        line_of_sight_range(sat, k, R_E, u)
        assert towards == pytest.approx(u, abs=1e-10)
