"""The transition of the error state against its differential equations and against the mechanization itself."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from insgnss.constants import WGS84_GM_M3PS2, WGS84_OMEGA_RADPS
from insgnss.geodesy.gravity import normal_gravity_ecef
from insgnss.geodesy.rotations import matrix_to_quaternion, quaternion_to_matrix
from insgnss.inertial.error_dynamics import (
    COUPLING_DTYPE,
    StepSpace,
    apply_transition,
    carry_covariance,
    step_space,
    transition_step,
)
from insgnss.inertial.mechanization import mechanize
from tests.inertial.held_height import place_at_rest
from tests.inertial.strapdown import EARTH, skew
from tests.jacobian import finite_difference_jacobian

N = 17
BLOCKS = {
    "dr": slice(0, 3),
    "dv": slice(3, 6),
    "psi": slice(6, 9),
    "b_a": slice(9, 12),
    "b_g": slice(12, 15),
    "clock": slice(15, 17),
}
PLACE_E = np.array([2.8e6, 1.6e6, 5.5e6])
FORCE_E = np.array([30.0, -20.0, 12.0])  # [m/s^2]
C_EB = Rotation.from_rotvec([0.3, -1.0, 2.0]).as_matrix()


NO_COUPLINGS = np.zeros(0, COUPLING_DTYPE)


def decays(n: int, dt: float, time_a: float, time_g: float) -> np.ndarray:
    """Return what a step leaves of each state of first order (n,)."""
    keep = np.ones(n)
    keep[9:12], keep[12:15] = math.exp(-dt / time_a), math.exp(-dt / time_g)
    return keep


def dynamics(time_a: float, time_g: float) -> np.ndarray:
    """Return F (17, 17) of the error equations, block by block."""
    dr, dv, psi, b_a, b_g, clock = BLOCKS.values()
    size = float(np.linalg.norm(PLACE_E))
    u = PLACE_E / size
    F = np.zeros((N, N))
    F[dr, dv] = np.eye(3)
    F[dv, dr] = -WGS84_GM_M3PS2 / size**3 * (np.eye(3) - 3.0 * np.outer(u, u)) - skew(EARTH) @ skew(EARTH)
    F[dv, dv] = -2.0 * skew(EARTH)
    F[dv, psi] = -skew(FORCE_E)
    F[dv, b_a] = -C_EB
    F[psi, psi] = -skew(EARTH)
    F[psi, b_g] = -C_EB
    F[b_a, b_a] = -np.eye(3) / time_a
    F[b_g, b_g] = -np.eye(3) / time_g
    F[clock, clock] = [[0.0, 1.0], [0.0, 0.0]]
    return F


def transition(dt: float, time_a: float, time_g: float) -> np.ndarray:
    """Return the compiled Phi (17, 17): what it makes of the unit matrix."""
    Phi = np.zeros((N, N))
    step = transition_step(dt, *(FORCE_E * dt), PLACE_E)
    apply_transition(step, C_EB * dt, NO_COUPLINGS, decays(N, dt, time_a, time_g), np.eye(N), Phi)
    return Phi


def shortfall(dt: float, row: str, column: str, time_s: float) -> tuple[float, float]:
    """Return the largest error of a block of Phi, and its largest element."""
    exact = expm(dynamics(time_s, time_s) * dt)[BLOCKS[row], BLOCKS[column]]
    found = transition(dt, time_s, time_s)[BLOCKS[row], BLOCKS[column]]
    return float(np.max(np.abs(found - exact))), float(np.max(np.abs(exact)))


@pytest.mark.parametrize("dt", [0.005, 0.02, 0.05])
@pytest.mark.parametrize("column", BLOCKS)
@pytest.mark.parametrize("row", BLOCKS)
def test_transition_equals_the_matrix_exponential(row: str, column: str, dt: float) -> None:
    error, size = shortfall(dt, row, column, 600.0)

    # what is neglected of a block: the Earth's turn and the bias's decay inside the step; and the third order, of which
    # only position from gyro bias consists: f dt^3/4 in the place of f dt^3/6, 1.5e-4 s^3 m/s^2 at 20 ms
    allowed = (2.0 * WGS84_OMEGA_RADPS * dt + dt / 600.0) * size
    if (row, column) == ("dr", "b_g"):
        allowed = 0.11 * float(np.linalg.norm(FORCE_E)) * dt**3
    elif row == "dr":
        allowed = 1e-3 * size
    assert error <= allowed + 1e-16


@pytest.mark.parametrize(
    ("row", "column"),
    [("dr", "dr"), ("dr", "dv"), ("dr", "psi"), ("dr", "b_a"), ("dr", "b_g"), ("dv", "b_g")],
)
def test_transition_is_right_to_second_order_where_the_second_order_is_the_first_to_appear(
    row: str, column: str
) -> None:
    coarse, fine = (shortfall(dt, row, column, math.inf)[0] for dt in (0.04, 0.02))

    assert coarse / fine == pytest.approx(8.0, rel=1e-2)


def test_transition_keeps_what_no_row_moves() -> None:
    n, step = N + 2, transition_step(0.02, *(FORCE_E * 0.02), PLACE_E)
    A, B = np.random.default_rng(1).standard_normal((n, n)), np.zeros((n, n))

    apply_transition(step, C_EB * 0.02, NO_COUPLINGS, decays(n, 0.02, 100.0, math.inf), A, B)

    assert B[16:].tolist() == A[16:].tolist()  # clock drift and inter-system offsets
    assert B[12:15].tolist() == A[12:15].tolist()  # a gyro bias without end
    assert B[9:12] == pytest.approx(math.exp(-0.02 / 100.0) * A[9:12], rel=1e-15)
    assert B[15] == pytest.approx(A[15] + 0.02 * A[16], rel=1e-15)
    assert B[:15] == pytest.approx((transition(0.02, 100.0, math.inf) @ A[:N])[:15], abs=1e-13)


def spoilt_space(n: int) -> StepSpace:
    """Return scratch in which something is left of an earlier step."""
    space = step_space(n)
    space.along[:] = space.after[:] = space.before[:, :9] = np.nan
    return space


def test_covariance_is_carried_as_phi_p_phi_transposed_and_stays_symmetric() -> None:
    root = np.random.default_rng(2).standard_normal((N + 3, N + 3))
    P = root @ root.T
    step = transition_step(0.02, *(FORCE_E * 0.02), PLACE_E)
    Phi = np.eye(N + 3)
    Phi[:N, :N] = transition(0.02, 100.0, 300.0)
    wanted = Phi @ P @ Phi.T

    keep = decays(N + 3, 0.02, 100.0, 300.0)
    carry_covariance(step, C_EB * 0.02, NO_COUPLINGS, keep, P, spoilt_space(len(P)))

    assert (P == P.T).all()
    np.testing.assert_allclose(P, wanted, rtol=0.0, atol=1e-13 * np.abs(wanted).max())


def test_further_errors_of_the_sensors_enter_as_the_matrix_exponential_has_them() -> None:
    """A scale factor of gyro x, an error of accelerometer y that turns with gyro z: columns of C times a factor."""
    dt, rate, force = 0.02, 0.7, 11.0
    F = np.zeros((N + 2, N + 2))
    F[:N, :N] = dynamics(math.inf, math.inf)
    F[BLOCKS["psi"], N] = -C_EB[:, 0] * rate
    F[BLOCKS["dv"], N + 1] = -C_EB[:, 1] * force
    F[N + 1, N + 1] = -1.0 / 50.0
    couplings = np.zeros(2, COUPLING_DTYPE)
    couplings["at"], couplings["bias"] = [N, N + 1], [12, 10]
    couplings["factor"] = [rate, force]
    keep = np.ones(N + 2)
    keep[N + 1] = math.exp(-dt / 50.0)
    step = transition_step(dt, *(FORCE_E * dt), PLACE_E)
    Phi, exact = np.zeros_like(F), expm(F * dt)

    apply_transition(step, C_EB * dt, couplings, keep, np.eye(N + 2), Phi)

    for row in ("psi", "dv"):
        np.testing.assert_allclose(
            Phi[BLOCKS[row], N:], exact[BLOCKS[row], N:], atol=3e-4 * np.abs(exact[:9, N:]).max()
        )
    root = np.random.default_rng(3).standard_normal((N + 2, N + 2))
    P = root @ root.T
    wanted = Phi @ P @ Phi.T
    carry_covariance(step, C_EB * dt, couplings, keep, P, spoilt_space(len(P)))
    assert (P == P.T).all()
    np.testing.assert_allclose(P, wanted, rtol=0.0, atol=1e-13 * np.abs(wanted).max())


def test_further_errors_act_through_the_mean_of_what_they_go_with() -> None:
    """A turn that speeds up from 0.5 to 1.5 rad/s in 25 ms: a scale factor's way into the attitude, in fine steps."""
    dt, count, n = 0.025, 50, N + 1
    rates = 0.5 + (np.arange(count) + 0.5) / count
    attitudes = [
        C_EB @ Rotation.from_rotvec([0.0, 0.0, a]).as_matrix() for a in np.cumsum(rates) * dt / count
    ]

    def carried(length: float, C_dt: np.ndarray, rate: float) -> np.ndarray:
        couplings, Phi = np.zeros(1, COUPLING_DTYPE), np.zeros((n, n))
        couplings["at"], couplings["bias"], couplings["factor"] = N, 12, rate
        apply_transition(
            transition_step(length, *(FORCE_E * length), PLACE_E), C_dt, couplings, np.ones(n), np.eye(n), Phi
        )
        return Phi

    fine = np.eye(n)
    for C, rate in zip(attitudes, rates, strict=True):
        fine = carried(dt / count, C * dt / count, rate) @ fine
    whole = carried(dt, np.mean(attitudes, axis=0) * dt, float(np.mean(rates)))

    off = np.linalg.norm(whole[BLOCKS["psi"], N] - fine[BLOCKS["psi"], N])
    assert 0.0 < off < 3e-3 * np.linalg.norm(fine[BLOCKS["psi"], N])


# --- against the mechanization --------------------------------------------------------------------------------------


RATE_B = np.array([0.4, -0.3, 0.6])
FORCE_B = C_EB.T @ FORCE_E
VELOCITY_E = np.array([-900.0, 5000.0, 3000.0])


def estimate(error: np.ndarray, dt: float, steps: int) -> tuple[np.ndarray, ...]:
    """Return position, velocity and attitude of an estimate with this error (15,) after mechanizing it."""
    dr, dv, psi, b_a, b_g = (error[block] for block in list(BLOCKS.values())[:5])
    C, q = Rotation.from_rotvec(psi).as_matrix() @ C_EB, np.zeros(4)
    matrix_to_quaternion(C, q)
    quaternion_to_matrix(q, C)
    r, v = PLACE_E + dr, VELOCITY_E + dv
    for _ in range(steps):
        # the estimated bias is taken out: too large a bias makes force and rate too small
        mechanize(q, C, r, v, RATE_B - b_g, FORCE_B - b_a, dt / steps, np.zeros(3))
    return r, v, C


def propagated(dt: float) -> np.ndarray:
    """Return d(dr, dv, psi) / d(error) (9, 15) over ``dt`` by finite differences of the mechanization."""
    r, v, C = estimate(np.zeros(15), dt, 8)

    def error_after(error: np.ndarray) -> np.ndarray:
        r_hat, v_hat, C_hat = estimate(error, dt, 8)
        return np.concatenate([r_hat - r, v_hat - v, Rotation.from_matrix(C_hat @ C.T).as_rotvec()])

    # the larger the step, the less the rounding of 6e6 m matters: 10 km, 10 m/s, 1 mrad, 1 m/s^2, 0.01 rad/s
    steps = np.repeat([1e4, 10.0, 1e-3, 1.0, 1e-2], 3)
    return finite_difference_jacobian(error_after, np.zeros(15), steps)


def transition_of_flight(dt: float) -> np.ndarray:
    """Return Phi with the sums of force and attitude that the mechanization itself made over ``dt``."""
    C, q, count = C_EB.copy(), np.zeros(4), 8
    matrix_to_quaternion(C, q)
    r, v = PLACE_E.copy(), VELOCITY_E.copy()
    sum_dv, sum_C = np.zeros(3), np.zeros((3, 3))
    for _ in range(count):
        sum_C += 0.5 * dt / count * C
        sum_dv += mechanize(q, C, r, v, RATE_B, FORCE_B, dt / count, np.zeros(3))
        sum_C += 0.5 * dt / count * C
    Phi = np.zeros((N, N))
    apply_transition(transition_step(dt, *sum_dv, r), sum_C, NO_COUPLINGS, np.ones(N), np.eye(N), Phi)
    return Phi


@pytest.mark.parametrize(
    ("row", "column", "share"),
    [
        ("dr", "dr", 1e-8),  # rounding of 6e6 m, each time
        ("dr", "dv", 1e-6),
        ("dr", "psi", 1e-2),  # the force turns by 0.016 rad inside the step: its halves weigh alike here
        ("dr", "b_a", 1e-2),
        ("dr", "b_g", 0.6),  # third order alone: f dt^3 / 4 stands for f dt^3 / 6
        ("dv", "dr", 1e-2),  # the gradient of J2, 0.5 %
        ("dv", "dv", 1e-8),  # Coriolis, 3e-6, to 1e-3 of it
        ("dv", "psi", 1e-5),
        ("dv", "b_a", 1e-5),
        ("dv", "b_g", 1e-2),
        ("psi", "psi", 1e-10),
        ("psi", "b_g", 1e-5),
    ],
)
def test_transition_predicts_how_the_mechanization_carries_an_error_on(
    row: str, column: str, share: float
) -> None:
    numeric = propagated(0.02)[BLOCKS[row], BLOCKS[column]]
    linear = transition_of_flight(0.02)[BLOCKS[row], BLOCKS[column]]

    assert numeric == pytest.approx(linear, abs=share * float(np.max(np.abs(linear))))


def test_transition_leaves_attitude_alone_with_position_velocity_and_accelerometers() -> None:
    for Phi in (propagated(0.02), transition_of_flight(0.02)):
        for column in ("dr", "dv", "b_a"):
            assert not np.any(Phi[BLOCKS["psi"], BLOCKS[column]])


@pytest.mark.parametrize("lat_deg", [0.0, 45.0, 90.0])
def test_gravity_gradient_is_that_of_the_field_but_for_j2(lat_deg: float) -> None:
    def field(r_e: np.ndarray) -> np.ndarray:
        g_e = np.zeros(3)
        normal_gravity_ecef(r_e, g_e)
        return g_e

    r_e = place_at_rest(lat_deg, 30.0, 0.0, np.eye(3)).r_e
    s = transition_step(1.0, 0.0, 0.0, 0.0, r_e)
    found = np.array([[s.g00, s.g01, s.g02], [s.g01, s.g11, s.g12], [s.g02, s.g12, s.g22]])

    numeric = finite_difference_jacobian(field, r_e, 1e4)
    # 3.1e-6 /s^2, of which J2 is 6 J2 = 0.65 % at a pole
    assert found == pytest.approx(numeric, abs=7e-3 * float(np.max(np.abs(numeric))))
    assert np.trace(found) == pytest.approx(2.0 * WGS84_OMEGA_RADPS**2, rel=1e-6, abs=0.0)  # Poisson
