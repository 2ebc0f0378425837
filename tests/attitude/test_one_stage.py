"""The one-stage filter: noise at the Cramer-Rao bound, range of lock, motion, false zeros, Euler's singularity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insgnss.attitude.angular_discriminators import likelihood_weights
from insgnss.attitude.aperture import apertures
from insgnss.attitude.array_observability import information, observability
from insgnss.attitude.baselines import attitude_matrices, difference_covariance, phase_differences, triangle
from insgnss.attitude.correlator_bank import draw_correlators, phase_variances, signal_ratios
from insgnss.attitude.gyro_attitude import GyroAttitude, GyroErrors
from insgnss.attitude.gyro_trial import Swing
from insgnss.attitude.one_stage import ANGLE, OneStage, lock_range, recovery_curve
from insgnss.errors import ConfigError, GeometryError
from insgnss.geodesy.rotations import rotation_matrix, rotation_vector, to_euler
from tests.attitude.arrays import eight, mixed
from tests.statistics_bounds import assert_mean_chi_square, nees

RPY = np.radians([5.0, -3.0, 30.0])
A40 = signal_ratios(np.full((3, 8), 40.0), 0.01)  # 40 dBHz over 10 ms: a = 200


def model(**changes: object) -> OneStage:
    return replace(OneStage(triangle(1.0), eight(), A40, 0.01, np.zeros(3)), **changes)


@pytest.mark.parametrize("parameters", ["euler", "rotation"])
def test_static_errors_are_consistent_and_reach_the_bound(parameters: str) -> None:
    one = model(parameters=parameters)
    rng, runs, epochs, sd = np.random.default_rng(3), 60, 20, np.radians(1.0)
    psi = phase_differences(attitude_matrices(RPY), one.array, one.sky)
    errors = []
    for _ in range(runs):
        state = one.start(RPY, sd, 1e-9)
        C = rotation_matrix(sd * rng.standard_normal(3)) @ state.C_nb
        state = replace(state, C_nb=C, rpy=to_euler(C))
        if parameters == "euler":
            rpy = RPY + sd * rng.standard_normal(3)
            state = replace(state, rpy=rpy, C_nb=attitude_matrices(rpy))
        for _ in range(epochs):
            state = one.step(state, draw_correlators(psi, A40, rng))
        away = rotation_vector(state.C_nb @ attitude_matrices(RPY).T)
        errors.append(state.rpy - RPY if parameters == "euler" else away)
    bound = observability(
        attitude_matrices(RPY), one.array, one.sky, difference_covariance(phase_variances(A40))
    )
    P = np.linalg.inv(epochs * bound.information_n + np.eye(3) / sd**2)

    # the filter's own covariance is the bound of 20 looks and the start; it linearises at its own attitude, 0.1 deg off
    assert_mean_chi_square(nees(errors, state.covariance[ANGLE, ANGLE]), 3)
    if parameters == "rotation":
        assert np.allclose(state.covariance[ANGLE, ANGLE], P, rtol=0.02, atol=0.02 * P.max())
    assert np.degrees(np.sqrt(np.trace(P))) * 60.0 < 3.0


def test_pairs_are_noisier_than_the_likelihood() -> None:
    # unequal antennas: the first, which every pair shares, is 6 dB weaker
    a = signal_ratios(np.array([[34.0], [40.0], [40.0]]) + np.zeros((3, 8)), 0.01)
    rng, squares = np.random.default_rng(4), {}
    psi = phase_differences(attitude_matrices(RPY), triangle(1.0), eight())
    for source in ("likelihood", "pairs"):
        one, errors = model(source=source, a=a), []
        for _ in range(150):
            state = one.corrected(one.start(RPY, 0.01, 1e-9), draw_correlators(psi, a, rng))
            errors.append(state.rpy - RPY)
        squares[source] = np.mean(np.square(errors), axis=0)

    assert np.sum(squares["pairs"]) > 1.15 * np.sum(squares["likelihood"])


@pytest.mark.parametrize("source", ["likelihood", "pairs"])
def test_lock_range_ends_at_the_unstable_points_of_the_filters_own_curve(source: str) -> None:
    one = model(source=source, rate_noise=np.array([0.0, 1e-6, 0.0]))
    state = one.start(RPY, [1e-9, np.radians(1.0), 1e-9], [1e-9, 1e-3, 1e-9])
    low, high = lock_range(one, state, 1, steps=300)
    x = np.radians(np.arange(-25.0, 25.0, 0.05))
    curve = recovery_curve(one, RPY, 1, x)
    runs_away = curve * x > 0.0
    below, above = x[runs_away & (x < -0.01)].max(), x[runs_away & (x > 0.01)].min()

    # 300 steps do not suffice for a start nearer than 0.2 deg to an unstable point; the curve has steps of 0.05 deg
    assert np.degrees(low) == pytest.approx(np.degrees(below), abs=0.25)
    assert np.degrees(high) == pytest.approx(np.degrees(above), abs=0.25)
    # the aperture holds the derivatives at the true attitude: the filter's own range stays inside it
    aperture = apertures(RPY, one.array, one.sky)
    assert aperture.below[0] < low < high < aperture.above[0]


def test_likelihood_of_all_antennas_locks_from_further_away_than_pairs() -> None:
    x = np.radians(np.arange(0.5, 30.0, 0.1))
    ends = [x[recovery_curve(model(source=s), RPY, 1, x) > 0.0].min() for s in ("likelihood", "pairs")]

    assert ends[0] > 1.4 * ends[1]


@pytest.mark.parametrize("parameters", ["euler", "rotation"])
def test_rates_of_a_turning_vehicle_are_found(parameters: str) -> None:
    rng, rate, T = np.random.default_rng(5), np.array([0.0, 0.0, 0.3]), 0.01
    one = model(parameters=parameters, sky=mixed(), rate_noise=np.full(3, 1e-8))
    state = one.start(RPY, 0.02, 0.5)
    for k in range(150):
        psi = phase_differences(attitude_matrices(RPY + rate * T * (k + 1)), one.array, one.sky)
        state = one.step(state, draw_correlators(psi, A40, rng))

    # yaw turns about down: the rate of yaw and the rotation vector's third component are the same
    sd = np.sqrt(np.diag(state.covariance))
    away = rotation_vector(state.C_nb @ attitude_matrices(RPY + rate * T * 150).T)
    assert np.all(np.abs(state.rate - rate) < 4.0 * sd[3:])
    assert np.linalg.norm(away) < 4.0 * np.sqrt(np.sum(sd[:3] ** 2))
    assert np.degrees(sd[5]) < 0.5


def test_false_zero_shows_in_the_agreement_of_the_antennas() -> None:
    one = model(rate_noise=np.full(3, 1e-6))
    Z = A40 * np.exp(
        1j * np.r_[np.zeros((1, 8)), phase_differences(attitude_matrices(RPY), one.array, one.sky)]
    )
    agreements = {}
    for offset in (2.0, 25.0):
        start = one.start(RPY + np.radians([0.0, offset, 0.0]), 0.02, 1e-3)
        for _ in range(200):
            start = one.step(start, Z)
        agreements[offset] = start.agreement, np.linalg.norm(start.rpy - RPY)

    assert agreements[2.0][0] > 0.999 and agreements[2.0][1] < 1e-3
    assert agreements[25.0][0] < 0.9 and agreements[25.0][1] > 0.1


def test_euler_angles_are_refused_where_they_fail_and_the_rotation_is_not() -> None:
    steep = np.radians([10.0, 88.0, 20.0])
    psi = phase_differences(attitude_matrices(steep), triangle(1.0), eight())
    Z = A40 * np.exp(1j * np.r_[np.zeros((1, 8)), psi])

    with pytest.raises(GeometryError, match="rotation"):
        model().step(model().start(steep, 0.01, 1e-3), Z)
    one = model(parameters="rotation")
    state = one.start(steep, 0.02, 1e-3)
    state = replace(state, C_nb=rotation_matrix([0.01, 0.0, 0.01]) @ state.C_nb)
    for _ in range(30):
        state = one.step(state, Z)
    assert np.linalg.norm(rotation_vector(state.C_nb @ attitude_matrices(steep).T)) < 1e-3


def test_bad_models_are_refused() -> None:
    with pytest.raises(ConfigError):
        model(a=-1.0 * A40)
    with pytest.raises(ConfigError, match="shape"):
        model(a=A40[:2])
    one = model()
    for rpy, sd in (([np.nan, 0.0, 0.0], 0.01), ([0.0, 0.0], 0.01), (RPY, -0.01)):
        with pytest.raises(ConfigError):
            one.start(rpy, sd, 0.01)
    state, missing = one.start(RPY, 0.01, 0.01), A40 + 0j
    missing[1, 3] = np.nan
    for Z in (missing, A40[:2] + 0j):
        with pytest.raises(ConfigError, match="finite numbers") as refused:
            one.step(state, Z)
        assert refused.value.key == "Z"
    with pytest.raises(ConfigError, match="likelihood"):
        model(source="likelihod")
    with pytest.raises(GeometryError, match="second satellite"):
        model(sky=eight().only(np.arange(8) == 2), a=A40[:, :1])


def test_information_of_weights_and_of_covariance_agree() -> None:
    J = np.random.default_rng(6).standard_normal((2, 8, 3))
    W = np.linalg.inv(difference_covariance(phase_variances(A40)))

    assert np.allclose(information(J, W), information(J, likelihood_weights(A40)), rtol=1e-12)


# MEMS gyros: 1 deg/sqrt(h), biases of 300 deg/h; turning in all combinations with up to 2 rad/s^2
ARW, BIAS_SD = np.radians(1.0) / 60.0, np.radians(300.0) / 3600.0


def flown_with_gyros(
    cn0_dbhz: float, seed: int, steps: int = 400
) -> tuple[list[np.ndarray], OneStage, list[np.ndarray]]:
    """Return errors of attitude and biases at the end of 30 runs, the filter, and its last covariances."""
    T = 0.01
    a = signal_ratios(np.full((3, 8), cn0_dbhz), T)
    one = model(parameters="rotation", a=a, increment_noise=ARW**2 * T)
    swing, rng = Swing(2.0), np.random.default_rng(seed)
    attitudes = attitude_matrices(swing.angles(T * np.arange(steps + 1)))
    psi = [phase_differences(C, one.array, one.sky) for C in attitudes]
    errors, covariances = [], []
    for _ in range(30):
        bias, sd = BIAS_SD * rng.standard_normal(3), np.radians(1.0)
        state = one.start(to_euler(attitudes[0]), sd, BIAS_SD)
        C = rotation_matrix(sd * rng.standard_normal(3)) @ state.C_nb
        state = replace(state, C_nb=C, rpy=to_euler(C))
        for k in range(steps):
            turned = rotation_vector(attitudes[k].T @ attitudes[k + 1])
            increment = turned + T * bias + ARW * np.sqrt(T) * rng.standard_normal(3)
            state = one.step(state, draw_correlators(psi[k + 1], a, rng), increment)
        errors.append(np.r_[rotation_vector(state.C_nb @ attitudes[-1].T), state.rate - bias])
        covariances.append(state.covariance)
    return errors, one, covariances


@pytest.mark.parametrize(("cn0_dbhz", "seed"), [(45.0, 31), (35.0, 32), (25.0, 33)])
def test_with_gyros_attitude_and_biases_are_consistent_in_rotation(cn0_dbhz: float, seed: int) -> None:
    errors, _, covariances = flown_with_gyros(cn0_dbhz, seed)

    assert_mean_chi_square(
        np.array([e @ np.linalg.solve(P, e) for e, P in zip(errors, covariances, strict=True)]), 6
    )


def test_gyros_carry_through_rotation_what_white_rates_do_not() -> None:
    errors, one, _ = flown_with_gyros(30.0, 34)
    T, steps = one.integration_s, 400
    swing, rng = Swing(2.0), np.random.default_rng(34)
    attitudes = attitude_matrices(swing.angles(T * np.arange(steps + 1)))
    alone = replace(one, increment_noise=None, rate_noise=np.full(3, (2.0 * T) ** 2))
    state = alone.start(to_euler(attitudes[0]), np.radians(1.0), 1.0)
    square = []
    for C in attitudes[1:]:
        state = alone.step(state, draw_correlators(phase_differences(C, one.array, one.sky), one.a, rng))
        square.append(np.sum(rotation_vector(state.C_nb @ C.T) ** 2))
    with_gyros = np.sqrt(np.mean([np.sum(e[:3] ** 2) for e in errors]))

    assert with_gyros < 0.5 * np.sqrt(np.mean(square[200:]))


def against_phase_differences(cn0_dbhz: float, seed: int) -> tuple[float, float, float]:
    """Return rms errors of attitude after 3 s with the same correlators and gyros, and the share of phases used.

    First of one stage, then of the gyro-aided filter that takes the phase differences of each integration [rad].
    """
    T, steps, sd, runs = 0.01, 300, np.radians(0.6), 12
    a, rng = signal_ratios(np.full((3, 8), cn0_dbhz), T), np.random.default_rng(seed)
    one = model(parameters="rotation", a=a, increment_noise=ARW**2 * T)
    two = GyroAttitude(one.array, GyroErrors(BIAS_SD, 0.0, 0.0, ARW, 0.0, 1e6))
    attitudes = attitude_matrices(Swing(2.0).angles(T * np.arange(steps + 1)))
    psi, squares, used = [phase_differences(C, one.array, one.sky) for C in attitudes], np.zeros(2), 0
    for _ in range(runs):
        bias, C = (
            BIAS_SD * rng.standard_normal(3),
            rotation_matrix(sd * rng.standard_normal(3)) @ attitudes[0],
        )
        first = replace(one.start(to_euler(attitudes[0]), sd, BIAS_SD), C_nb=C, rpy=to_euler(C))
        second = two.start(C, sd)
        for k in range(steps):
            increment = rotation_vector(attitudes[k].T @ attitudes[k + 1]) + T * bias
            increment += ARW * np.sqrt(T) * rng.standard_normal(3)
            Z = draw_correlators(psi[k + 1], a, rng)
            first = one.step(first, Z, increment)
            second = two.predicted(second, increment[None] / T, T)
            second, update = two.corrected(
                second, np.angle(Z[1:] * np.conj(Z[:1])), phase_variances(a), one.sky
            )
            used += update.n_used
        for i, C_nb in enumerate((first.C_nb, second.C_nb)):
            squares[i] += np.sum(rotation_vector(C_nb @ attitudes[-1].T) ** 2)
    return *np.sqrt(squares / runs), used / (runs * steps * len(one.sky.los_n))


@pytest.mark.parametrize(("cn0_dbhz", "seed"), [(45.0, 41), (35.0, 42), (30.0, 43)])
def test_one_stage_is_as_good_as_phase_differences_while_their_cycles_are_known(
    cn0_dbhz: float, seed: int
) -> None:
    one_stage, differences, used = against_phase_differences(cn0_dbhz, seed)

    assert one_stage == pytest.approx(
        differences, rel=0.1
    )  # the noise is the same: what is left is the squares' bias
    assert used > 0.99


def test_one_stage_goes_on_at_a_level_at_which_no_cycle_of_a_phase_difference_is_known() -> None:
    one_stage, differences, used = against_phase_differences(23.0, 44)

    assert used < 0.3
    assert one_stage < 0.5 * differences


def test_gyros_that_are_half_there_are_told() -> None:
    with_gyros = model(parameters="rotation", increment_noise=1e-8)
    state = with_gyros.start(RPY, 0.01, 0.01)
    with pytest.raises(ConfigError, match="go together"):
        with_gyros.predicted(state)
    with pytest.raises(ConfigError, match="go together"):
        model(parameters="rotation").predicted(state, np.zeros(3))
    with pytest.raises(ConfigError, match="invalid increments"):
        with_gyros.predicted(state, [0.0, np.nan, 0.0])
    with pytest.raises(ConfigError, match="parameters of a rotation"):
        model(increment_noise=1e-8)
