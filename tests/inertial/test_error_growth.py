"""How errors grow without aiding: the mechanization against the linear model, and a crowd of sensors against P."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from insgnss.config.filter import FilterConfig
from insgnss.config.flight import ImuGrade, Oscillator
from insgnss.constants import NS_PER_S
from insgnss.fusion.parameters import resolve_parameters
from insgnss.fusion.prediction import carry, new_scratch
from insgnss.fusion.state import BA, BG, DR, DV, OFFSETS, PSI, new_bank
from insgnss.geodesy.rotations import matrix_to_quaternion, quaternion_to_matrix
from insgnss.simulation import journeys
from insgnss.simulation.imu import gauss_markov
from tests.inertial.linear_growth import ERRORS, linear_growth
from tests.inertial.strapdown import even_edges, fly
from tests.statistics_bounds import assert_mean_chi_square, nees

RATE_HZ = 100.0
DT = 1.0 / RATE_HZ


@dataclass(frozen=True)
class Nominal:
    """A flight with ideal sensors: samples, start and end."""

    w: np.ndarray
    f: np.ndarray
    C_eb: np.ndarray
    r_e: np.ndarray
    v_e: np.ndarray


@pytest.fixture(scope="module")
def flight() -> Nominal:
    trajectory, edges = journeys.airborne_turns(600.0), even_edges(600.0, RATE_HZ)
    increments, start = trajectory.increments(edges), trajectory.motion(edges[:1])
    return Nominal(
        increments.mean_rate(), increments.mean_specific_force(), start.C_eb[0], start.r_e[0], start.v_e[0]
    )


def flown_error(flight: Nominal, count: int, error: np.ndarray) -> np.ndarray:
    """Return (dr, dv, psi) (9,) that an initial ``error`` (17,) has become after ``count`` samples."""
    dr, dv, psi, b_a, b_g = error[:15].reshape(5, 3)
    w, f = flight.w[:count], flight.f[:count]
    true = fly(DT, w, f, flight.C_eb, flight.r_e, flight.v_e, every=count)
    C_hat = Rotation.from_rotvec(psi).as_matrix() @ flight.C_eb
    hat = fly(DT, w - b_g, f - b_a, C_hat, flight.r_e + dr, flight.v_e + dv, every=count)
    turned = Rotation.from_matrix(hat.C_eb[0] @ true.C_eb[0].T).as_rotvec()
    return np.concatenate([hat.r_e[0] - true.r_e[0], hat.v_e[0] - true.v_e[0], turned])


# small enough that their squares do not matter: 10 m, 0.1 m/s, 0.1 mrad, 0.1 mg, 0.2 deg/h, each on its own
SIZES = np.repeat([10.0, 0.1, 1e-4, 1e-3, 1e-6], 3)


@pytest.mark.parametrize(
    ("duration_s", "share"),
    [
        (60.0, 1e-3),  # reached LATER
        (600.0, 1e-2),  # gravity's gradient lacks J2: 0.5 % of what it adds
    ],
)
def test_error_without_aiding_grows_as_the_linear_model_says(
    flight: Nominal, duration_s: float, share: float
) -> None:
    count = round(duration_s * RATE_HZ)
    start = np.zeros((ERRORS, ERRORS))
    start[:15, :15] = np.diag(SIZES)

    linear = linear_growth(
        DT, 2, flight.w[:count], flight.f[:count], flight.C_eb, flight.r_e, flight.v_e, start
    )

    for k in range(15):
        grown = flown_error(flight, count, start[:, k])
        for block in (slice(0, 3), slice(3, 6), slice(6, 9)):
            size = float(np.linalg.norm(linear[block, k]))
            assert np.linalg.norm(grown[block] - linear[block, k]) < share * size + 1e-7


GRADE = ImuGrade(  # a bias without constant part is the plain Gauss-Markov process that the covariance stands for
    gyro_bias_deg_per_h=0.0,
    gyro_bias_instability_deg_per_h=30.0,
    gyro_correlation_time_s=40.0,
    gyro_arw_deg_per_sqrt_h=0.3,
    accel_bias_mg=0.0,
    accel_bias_instability_mg=2.0,
    accel_correlation_time_s=25.0,
    accel_vrw_mps_per_sqrt_h=0.2,
)
RUNS = 200
SECONDS = 60.0
START_SIGMA = np.repeat([5.0, 0.1, 2e-3], 3)
"""Position [m], velocity [m/s], attitude [rad]."""


def predicted(flight: Nominal, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the covariance (15, 15) after ``count`` samples, and its initial sigmas and densities' record."""
    par = resolve_parameters(
        FilterConfig(), GRADE, Oscillator(h0_s=0.0, h_minus2_per_s=0.0), (0.0, 0.0, 0.0), False
    )
    bank = new_bank(1, 0)
    m, P = bank.state[0], bank.P[0]
    sigma = np.zeros(OFFSETS)
    sigma[:BA] = START_SIGMA
    sigma[BA : BA + 3] = np.sqrt(0.5 * par["accel_bias_density"][0] * par["accel_bias_time"][0])
    sigma[BG : BG + 3] = np.sqrt(0.5 * par["gyro_bias_density"][0] * par["gyro_bias_time"][0])
    P[:] = np.diag(sigma**2)
    matrix_to_quaternion(flight.C_eb, m.q_eb)
    quaternion_to_matrix(m.q_eb, m.C_eb)
    m.r_e[:], m.v_e[:] = flight.r_e, flight.v_e
    t_ns = np.arange(count + 1) * round(DT * NS_PER_S)
    w, f = (np.concatenate([x[:1], x[:count]]) for x in (flight.w, flight.f))
    carry(m, P, 0, 1, int(t_ns[-1]), t_ns, w, f, par[0], new_scratch(OFFSETS))
    return P[:15, :15], sigma, par


def one_run(flight: Nominal, count: int, sigma: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the error state (15,) after ``count`` samples of one drawn sensor and start."""
    par = resolve_parameters(
        FilterConfig(), GRADE, Oscillator(h0_s=0.0, h_minus2_per_s=0.0), (0.0, 0.0, 0.0), False
    )[0]
    b_a = gauss_markov(count, DT, sigma[BA], float(par.accel_bias_time), rng)
    b_g = gauss_markov(count, DT, sigma[BG], float(par.gyro_bias_time), rng)
    noise_a, noise_g = rng.standard_normal((2, count, 3)) / np.sqrt(DT)
    w = flight.w[:count] + b_g + np.sqrt(par.gyro_density) * noise_g
    f = flight.f[:count] + b_a + np.sqrt(par.accel_density) * noise_a
    dr, dv, psi = sigma[:BA].reshape(3, 3) * rng.standard_normal((3, 3))
    C_hat = Rotation.from_rotvec(psi).as_matrix() @ flight.C_eb
    # a filter without aiding estimates no bias: what is wrong with its bias is the true one, reversed
    hat = fly(DT, w, f, C_hat, flight.r_e + dr, flight.v_e + dv, every=count)
    true = fly(DT, flight.w[:count], flight.f[:count], flight.C_eb, flight.r_e, flight.v_e, every=count)
    turned = Rotation.from_matrix(hat.C_eb[0] @ true.C_eb[0].T).as_rotvec()
    return np.concatenate(
        [hat.r_e[0] - true.r_e[0], hat.v_e[0] - true.v_e[0], turned, -b_a[-1], -b_g[-1]]
    )


def test_errors_of_many_sensors_without_aiding_are_as_large_as_the_covariance_says(
    flight: Nominal, rng: np.random.Generator
) -> None:
    count = round(SECONDS * RATE_HZ)
    P, sigma, _ = predicted(flight, count)

    errors = np.array([one_run(flight, count, sigma, rng) for _ in range(RUNS)])

    assert_mean_chi_square(nees(errors, P), 15)
    for block in (DR, DV, PSI, BA, BG):
        part = slice(block, block + 3)
        assert_mean_chi_square(nees(errors[:, part], P[part, part]), 3)
