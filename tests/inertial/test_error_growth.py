"""How errors grow without aiding: the mechanization against the linear model, and a crowd of sensors against P."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from insgnss.config.flight import ImuGrade
from insgnss.constants import NS_PER_S
from insgnss.filter.prediction import ImuSamples, carry, new_scratch
from insgnss.filter.state import BA, BG, CLOCK, DR, DV, OFFSETS, PSI
from insgnss.simulation import sample_trajectories
from insgnss.simulation.imu import gauss_markov
from tests.inertial.filter_state import NOTHING_UNKNOWN, bank_at, parameters
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
    trajectory, edges = sample_trajectories.airborne_turns(600.0), even_edges(600.0, RATE_HZ)
    increments, start = trajectory.increments(edges), trajectory.motion(edges[:1])
    return Nominal(
        increments.mean_rate(), increments.mean_specific_force(), start.C_eb[0], start.r_e[0], start.v_e[0]
    )


def flown_error(
    flight: Nominal,
    count: int,
    error: np.ndarray,
    w_error: np.ndarray | float = 0.0,
    f_error: np.ndarray | float = 0.0,
) -> np.ndarray:
    """Return (dr, dv, psi) (9,) after ``count`` samples, from an initial ``error`` (17,) and errors of the samples."""
    dr, dv, psi, b_a, b_g = error[:CLOCK].reshape(5, 3)
    w, f = flight.w[:count], flight.f[:count]
    true = fly(DT, w, f, flight.C_eb, flight.r_e, flight.v_e, every=count)
    C_hat = Rotation.from_rotvec(psi).as_matrix() @ flight.C_eb
    hat = fly(DT, w + w_error - b_g, f + f_error - b_a, C_hat, flight.r_e + dr, flight.v_e + dv, every=count)
    turned = Rotation.from_matrix(hat.C_eb[0] @ true.C_eb[0].T).as_rotvec()
    return np.concatenate([hat.r_e[0] - true.r_e[0], hat.v_e[0] - true.v_e[0], turned])


# small enough that their squares do not matter: 10 m, 0.1 m/s, 0.1 mrad, 0.1 mg, 0.2 deg/h, each on its own
SIZES = np.repeat([10.0, 0.1, 1e-4, 1e-3, 1e-6], 3)


@pytest.mark.parametrize(("duration_s", "share"), [(60.0, 1e-4), (600.0, 4e-3)])
def test_error_without_aiding_grows_as_the_linear_model_says(
    flight: Nominal, duration_s: float, share: float
) -> None:
    count = round(duration_s * RATE_HZ)
    start = np.zeros((ERRORS, ERRORS))
    start[:CLOCK, :CLOCK] = np.diag(SIZES)

    linear = linear_growth(
        DT, 2, flight.w[:count], flight.f[:count], flight.C_eb, flight.r_e, flight.v_e, start
    )

    for k in range(CLOCK):
        grown = flown_error(flight, count, start[:, k])
        for block in (slice(DR, DV), slice(DV, PSI), slice(PSI, BA)):
            size = float(np.linalg.norm(linear[block, k]))
            # the gradient lacks J2: up to 0.75 % of the velocity that it alone makes of a position error; of the rest
            # 5e-5 after a minute and 2.6e-3 after ten
            allowed = 8e-3 if k < DV and block.start == DV else share
            assert np.linalg.norm(grown[block] - linear[block, k]) < allowed * size + 1e-7


GRADE = (
    ImuGrade(  # a bias without constant part is the plain Gauss-Markov process that the covariance stands for
        gyro_bias_deg_per_h=0.0,
        gyro_bias_instability_deg_per_h=30.0,
        gyro_correlation_time_s=40.0,
        gyro_arw_deg_per_sqrt_h=0.3,
        accel_bias_mg=0.0,
        accel_bias_instability_mg=2.0,
        accel_correlation_time_s=25.0,
        accel_vrw_mps_per_sqrt_h=0.2,
    )
)
RUNS = 200
SECONDS = 60.0
START_SIGMA = np.repeat([5.0, 0.1, 2e-3], 3)  # position [m], velocity [m/s], attitude [rad]


def stationary_sigma(par: Any) -> np.ndarray:
    """Return the initial sigmas (17,): of both biases what their noise keeps up."""
    sigma = np.zeros(OFFSETS)
    sigma[:BA] = START_SIGMA
    sigma[BA:BG] = np.sqrt(0.5 * par.accel_bias_density * par.accel_bias_time)
    sigma[BG:CLOCK] = np.sqrt(0.5 * par.gyro_bias_density * par.gyro_bias_time)
    return sigma


def predicted(flight: Nominal, count: int, par: Any) -> np.ndarray:
    """Return the filter's covariance (15, 15) after ``count`` samples without measurements."""
    bank = bank_at(flight.C_eb, flight.r_e, flight.v_e, stationary_sigma(par))
    t_ns = np.arange(count + 1) * round(DT * NS_PER_S)
    w, f = (np.concatenate([x[:1], x[:count]]) for x in (flight.w, flight.f))
    imu = ImuSamples(t_ns, w, f, NOTHING_UNKNOWN)
    carry(bank.state[0], bank.P[0], 0, 1, int(t_ns[-1]), imu, par, new_scratch(OFFSETS))
    return np.asarray(bank.P[0, :CLOCK, :CLOCK])


def drawn_error(flight: Nominal, count: int, par: Any, rng: np.random.Generator) -> np.ndarray:
    """Return the error state (15,) after ``count`` samples of one drawn sensor and start."""
    sigma = stationary_sigma(par)
    b_a = gauss_markov(count, DT, sigma[BA], float(par.accel_bias_time), rng)
    b_g = gauss_markov(count, DT, sigma[BG], float(par.gyro_bias_time), rng)
    noise_a, noise_g = rng.standard_normal((2, count, 3)) / np.sqrt(DT)
    w = b_g + np.sqrt(par.gyro_density) * noise_g
    f = b_a + np.sqrt(par.accel_density) * noise_a
    start = np.zeros(OFFSETS)
    start[:BA] = START_SIGMA * rng.standard_normal(BA)
    # a filter without aiding has estimated no bias: the error of its bias is the true one, reversed
    return np.concatenate([flown_error(flight, count, start, w, f), -b_a[-1], -b_g[-1]])


def test_errors_of_many_sensors_without_aiding_are_as_large_as_the_covariance_says(
    flight: Nominal, rng: np.random.Generator
) -> None:
    count, par = round(SECONDS * RATE_HZ), parameters(GRADE)
    P = predicted(flight, count, par)

    errors = np.array([drawn_error(flight, count, par, rng) for _ in range(RUNS)])

    assert_mean_chi_square(nees(errors, P), CLOCK)
    for block in (DR, DV, PSI, BA, BG):
        part = slice(block, block + 3)
        assert_mean_chi_square(nees(errors[:, part], P[part, part]), 3)
