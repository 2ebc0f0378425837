"""Each column of the pseudorange's and the range rate's row against finite differences of their own predictions."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pytest

from insgnss.constants import C_MPS
from insgnss.filter.state import BA, BG, CLOCK, DR, DRIFT, DV, OFFSETS, PSI, Bank, copy_bank
from insgnss.geodesy.rotations import matrix_to_quaternion, turn_left
from insgnss.gnss.observation_rows import GnssRows
from insgnss.tables import Float64
from tests.filter.scene import (
    START_NS,
    attitude,
    dense_rows,
    new_filter,
    observed,
    parameters,
    place,
    rows_of,
    sky,
)
from tests.jacobian import finite_difference_jacobian

N = OFFSETS + 1
GROUP = [0, 1] * 6
# steps: m, m/s, rad, m/s^2, rad/s, m, m/s, m; a range is rounded to 4e-9 m, which over 0.02 rad leaves 4e-7 m/rad
STEPS = np.repeat([10.0, 1.0, 0.02, 1e-2, 1e-2, 10.0, 1.0, 10.0], [3, 3, 3, 3, 3, 1, 1, 1])


class Case(NamedTuple):
    """A filter at a point, what its rows are held against, and the body's rate there."""

    bank: Bank
    par: npt.NDArray[Any]
    log: GnssRows
    w_ib_b: Float64


def make_case(
    lever_b: tuple[float, float, float] = (0.0, 0.0, 0.0),
    rate_radps: tuple[float, float, float] = (0.0, 0.0, 0.0),
    clock_m: float = 0.0,
    **changes: float,
) -> Case:
    """Return a case: 250 m/s, banked and turning, biases not zero."""
    at = place(-33.0, 151.0, 9000.0)
    bank = new_filter(
        at,
        v_n=(180.0, -170.0, 12.0),
        C_eb=attitude(at, 50.0, -20.0, 140.0),
        clock=(clock_m, -40.0),
        offsets=(17.0,),
    )
    bank.state["b_g"][0] = 1e-3, -2e-3, 5e-4
    log = rows_of([START_NS], sky(at), group=GROUP)
    return Case(bank, parameters(lever_b, **changes), log, np.array(rate_radps))


def moved(bank: Bank, d: Float64) -> Bank:
    """Return the filter with its state changed by ``d`` (n,), C_eb <- exp([d_psi x]) C_eb."""
    other = copy_bank(bank)
    m = other.state[0]
    m.r_e += d[DR : DR + 3]
    m.v_e += d[DV : DV + 3]
    m.b_a += d[BA : BA + 3]
    m.b_g += d[BG : BG + 3]
    m.clock += d[CLOCK : DRIFT + 1]
    m.optional[0] += d[OFFSETS]
    turn = np.zeros((3, 3))
    x, y, z = d[PSI : PSI + 3]
    # exact rotation by Rodrigues' formula, not through the package's quaternions
    angle = float(np.linalg.norm([x, y, z]))
    if angle > 0.0:
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        turn = np.sin(angle) / angle * cross + (1.0 - np.cos(angle)) / angle**2 * cross @ cross
    m.C_eb[:] = (np.eye(3) + turn) @ m.C_eb
    matrix_to_quaternion(m.C_eb, m.q_eb)
    return other


def predictions(case: Case, d: Float64) -> Float64:
    """Return (24,) predicted pseudoranges [m], then range rates [m/s], of the state changed by ``d``."""
    work = observed(moved(case.bank, d), case.par, case.log, w_ib_b=case.w_ib_b)
    return -work.lines["innovation"][:, :2].T.ravel()


def rows_of_H(case: Case) -> Float64:
    """Return (24, n) rows of H as the filter forms them, dense."""
    return dense_rows(observed(case.bank, case.par, case.log, w_ib_b=case.w_ib_b), N).reshape(24, N)


def differences(case: Case) -> Float64:
    """Return (24, n): rows of H minus finite differences."""
    return rows_of_H(case) - finite_difference_jacobian(lambda d: predictions(case, d), np.zeros(N), STEPS)


LEVERS = [(0.0, 0.0, 0.0), (2.5, -1.2, -4.0)]
RATES = [(0.0, 0.0, 0.0), (3.0, -2.0, 5.0)]


@pytest.mark.parametrize("rate", RATES, ids=["not turning", "at 350 deg/s"])
@pytest.mark.parametrize("lever", LEVERS, ids=["no lever arm", "lever arm of 5 m"])
def test_pseudorange_row_equals_finite_differences(
    lever: tuple[float, float, float], rate: tuple[float, float, float]
) -> None:
    d = differences(make_case(lever, rate))[:12]

    # position: the Earth's turn during the flight depends on the receiver, 2e-6 of the column
    assert np.max(np.abs(d[:, DR : DR + 3])) < 3e-6
    assert np.max(np.abs(d[:, PSI : PSI + 3])) < 3e-6 * float(np.linalg.norm(lever)) + 1e-12
    # clock: reception moves back with it, v/c = 8e-7, with the turn of the lever arm 9e-7
    assert np.max(np.abs(d[:, CLOCK])) < 1e-6
    assert np.max(np.abs(d[:, OFFSETS])) < 1e-8
    for absent in (DV, BA, BG):
        assert np.max(np.abs(d[:, absent : absent + 3])) < 1e-7
    assert np.max(np.abs(d[:, DRIFT])) < 1e-7


@pytest.mark.parametrize("rate", RATES, ids=["not turning", "at 350 deg/s"])
@pytest.mark.parametrize("lever", LEVERS, ids=["no lever arm", "lever arm of 5 m"])
def test_range_rate_row_equals_finite_differences(
    lever: tuple[float, float, float], rate: tuple[float, float, float]
) -> None:
    case = make_case(lever, rate)
    d = differences(case)[12:]
    arm, turning = float(np.linalg.norm(lever)), float(np.linalg.norm(rate))
    l_e, by_position = case.bank.state[0].C_eb @ np.array(lever), rows_of_H(case)[12:, DR : DR + 3]

    # the Doppler factor 1 + u.v_s / c and the light time's dependence on the receiver, here 1e-6 of each column
    assert np.max(np.abs(d[:, DR : DR + 3])) < 2e-6 * 2e-4
    assert np.max(np.abs(d[:, DV : DV + 3])) < 2e-6
    # attitude: the antenna's own shift turns the line of sight, l_e x g with |g| = 1.4e-4 1/s is left out
    left_out = np.cross(l_e, by_position)
    assert np.max(np.abs(left_out)) < 1.5e-4 * arm + 1e-12
    assert np.max(np.abs(d[:, PSI : PSI + 3] + left_out)) < 2e-6 * arm * turning + 1e-7 * arm + 1e-12
    assert np.max(np.abs(d[:, BG : BG + 3])) < 2e-6 * arm + 1e-12
    assert np.max(np.abs(d[:, DRIFT])) < 1e-9
    for absent in (BA, OFFSETS):
        assert np.max(np.abs(d[:, absent])) < 1e-9
    # clock: reception moves back with it, by the turning antenna's acceleration w^2 l over c
    assert np.max(np.abs(d[:, CLOCK])) < turning**2 * arm / C_MPS + 1e-9


@pytest.mark.parametrize("lever", LEVERS, ids=["no lever arm", "lever arm of 5 m"])
def test_rows_with_a_clock_one_millisecond_off_lack_only_what_reception_time_explains(
    lever: tuple[float, float, float],
) -> None:
    """The antenna is carried back by v clock / c: the range depends on the velocity by 1e-3 s, which no column has."""
    case = make_case(lever, (0.3, -0.2, 0.5), clock_m=1e-3 * C_MPS)
    H = rows_of_H(case)
    d = differences(case)

    np.testing.assert_allclose(d[:12, DV : DV + 3], 1e-3 * H[:12, DR : DR + 3], atol=1e-8)
    assert np.max(np.abs(d[:12, BG : BG + 3])) < 1.1e-3 * max(float(np.linalg.norm(lever)), 1e-3)
    assert np.max(np.abs(d[:12, DR : DR + 3])) < 3e-6
    assert np.max(np.abs(d[12:, DV : DV + 3])) < 2e-5


def test_rows_under_an_atmosphere_lack_only_its_change_with_height() -> None:
    """Saastamoinen's zenith delay falls by 2.3 m over a scale height of 7 km: 3e-4 / sin(elevation) m per metre."""
    d = differences(make_case(LEVERS[1], RATES[1], use_troposphere=1.0))[:12, DR : DR + 3]

    assert 1e-5 < np.max(np.abs(d)) < 3e-4 / np.sin(np.radians(10.0))


def test_closed_loop_turns_the_attitude_as_the_error_state_says() -> None:
    """C_eb <- exp([psi x]) C_eb: the quaternion's turn equals the matrix' own."""
    case = make_case()
    d = np.zeros(N)
    d[PSI : PSI + 3] = 0.02, -0.05, 0.03
    expected = moved(case.bank, d).state[0].q_eb
    q = case.bank.state[0].q_eb.copy()
    turn_left(q, *d[PSI : PSI + 3])

    np.testing.assert_allclose(q * np.sign(q @ expected), expected, rtol=0, atol=1e-15)
