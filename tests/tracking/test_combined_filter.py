"""The combined code and phase filter: table and transients of the thesis, Riccati equations, slow equalisation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import linalg

from insgnss.constants import C_MPS
from insgnss.errors import ConfigError
from insgnss.tracking.combined_filter import CODE, PHASE, RATE, CombinedModel
from insgnss.tracking.combined_loop import linear_transient, nonlinear_transient, read_response
from insgnss.tracking.loop_filters import LoopFilter

F0, CHIP_HZ = 1.6e9, 511e3  # the thesis's carrier and code
# (2.22), rms in mm, beta = 1: recalculated independently of this project
TABLE_MM = {
    1.0: (4.602, 2.794, 2.119),
    10.0: (8.183, 4.969, 3.769),
    30.0: (10.770, 6.539, 4.960),
    50.0: (12.237, 7.430, 5.636),
    100.0: (14.552, 8.836, 6.702),
}
CN0S = (32.0, 37.0, 40.0)


def difference_variance(of: CombinedModel, initial: float, epochs: int) -> float:
    """Return the variance of code minus phase range, a constant that k epochs observe, without divergence [m^2].

    Equation: 1 / (1 / P0 + k / (D_tau + D_taud))
    """
    return 1.0 / (1.0 / initial + epochs / float(np.sum(of.noise())))


def model(
    sigma_a: float = 10.0, cn0: float = 37.0, T: float = 1e-3, divergence: float = 0.0
) -> CombinedModel:
    return CombinedModel(cn0, F0, CHIP_HZ, sigma_a**2, T, divergence)


@pytest.mark.parametrize("sigma_a", TABLE_MM)
def test_steady_state_reproduces_the_table(sigma_a: float) -> None:
    found = [1e3 * math.sqrt(model(sigma_a, cn0).steady_variance()) for cn0 in CN0S]
    assert found == pytest.approx(TABLE_MM[sigma_a], abs=1e-3)


@pytest.mark.parametrize("sigma_a", TABLE_MM)
def test_steady_state_is_the_solution_of_the_continuous_riccati_equation(sigma_a: float) -> None:
    # code and phase of one range and its rate: the difference is known in the end
    of = model(sigma_a)
    S = of.noise() * of.integration_s
    F = np.array([[0.0, 1.0], [0.0, 0.0]])
    H = np.array([[1.0, 0.0], [1.0, 0.0]])
    P = linalg.solve_continuous_are(F.T, H.T, np.diag([0.0, sigma_a**2]), np.diag(S))
    assert of.steady_variance() == pytest.approx(P[0, 0], rel=1e-9)
    # (2.21)
    S_e = 1.0 / np.sum(1.0 / S)
    assert 2.0 * P[0, 1] == pytest.approx(P[0, 0] ** 2 / S_e)
    assert P[1, 1] == pytest.approx(P[0, 0] * P[0, 1] / S_e)
    assert sigma_a**2 == pytest.approx(P[0, 1] ** 2 / S_e)


def test_density_times_the_step_drives_the_rate_as_the_continuous_filter_has_it() -> None:
    # D_xi = S_xi T: the discrete filter tends to (2.22) as T becomes small; S_xi / T, as printed, would not
    found = [math.sqrt(model(T=T).steady_gains().filtered[PHASE, PHASE]) for T in (1e-3, 1e-4, 1e-5)]
    limits = [math.sqrt(model(T=T).steady_variance()) for T in (1e-3, 1e-4, 1e-5)]
    ratios = np.abs(np.array(found) / limits - 1.0)
    # the squaring loss makes shorter integrations noisier, which slows the loop: B T falls by about 6 each time
    assert ratios[0] > ratios[1] > ratios[2] and ratios[2] < 2e-3


def test_discrete_filter_predicts_and_filters_as_recalculated() -> None:
    steady = model().steady_gains()
    assert 1e3 * math.sqrt(steady.predicted[PHASE, PHASE]) == pytest.approx(5.304, abs=5e-4)
    assert 1e3 * math.sqrt(steady.filtered[PHASE, PHASE]) == pytest.approx(4.673, abs=5e-4)


def test_gains_are_those_of_the_covariance_with_the_sixth_as_corrected() -> None:
    of = model(divergence=1e-4)
    found = of.variances(np.diag([1e4, 1e2, 1e4]), 50)
    D, P, K = of.noise(), found.filtered[-1], found.gains[-1]
    expected = np.array([[P[i, CODE] / D[0], P[i, PHASE] / D[1]] for i in (CODE, RATE, PHASE)])  # (2.19)
    assert K == pytest.approx(expected, rel=1e-6)
    assert abs(K[PHASE, 1] - P[RATE, PHASE] / D[1]) > 10.0 * abs(K[PHASE, 1])  # D23 / D_d, as printed


def test_covariance_update_equals_the_information_form() -> None:
    of = model()
    P0 = np.diag([100.0, 9.0, 1e-3])
    H = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    expected = np.linalg.inv(np.linalg.inv(P0) + H.T @ np.diag(1.0 / of.noise()) @ H)  # (2.20)
    found = of.variances(P0, 1).filtered[0]
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-15)


def seconds_filter(acceleration_density: float) -> float:
    """Return the standard deviation of the predicted tau_d of the same filter in seconds [s]."""
    of = model()
    R = of.noise() / C_MPS**2
    # in units of 1 ns, for the solver's sake: the difference of code and phase known, as after infinite time
    F, h = np.array([[1.0, 1e-3], [0.0, 1.0]]), np.array([[1.0], [0.0]])
    Q = np.diag([0.0, acceleration_density * 1e-3 * 1e18])
    P = linalg.solve_discrete_are(F.T, h, Q, np.array([[1e18 / np.sum(1.0 / R)]]))
    return math.sqrt(P[0, 0]) * 1e-9


def test_acceleration_in_metres_needs_the_speed_of_light_in_a_filter_of_seconds() -> None:
    right = seconds_filter((10.0 / C_MPS) ** 2)
    assert right * C_MPS == pytest.approx(math.sqrt(model().steady_gains().predicted[PHASE, PHASE]), rel=1e-6)
    # 3.3 leaves out 1 / c^2: T^1.5 sigma_a = 3.16e-5 sigma_a seconds, which no unit fits
    assert seconds_filter(10.0**2) == pytest.approx(3.16e-5 * 10.0, rel=2e-3)


def test_start_has_variances_and_not_standard_deviations() -> None:
    found = model().initial_covariance(33.0)
    sd_m = C_MPS / CHIP_HZ / 24.0  # 24 m, of which 3.4 makes 24 m^2
    assert np.sqrt(np.diag(found)) == pytest.approx([sd_m, 33.0, sd_m])
    assert found[CODE, CODE] == pytest.approx(597.6, abs=0.1)


def test_code_is_slow_where_phase_is_instant() -> None:
    of = model()
    found = of.variances(np.diag([1e6, 1e4, 1e6]), 10_001).filtered
    seconds = (200, 1000, 10_000)
    rms = [math.sqrt(found[k - 1, CODE, CODE]) for k in seconds]
    assert rms == pytest.approx(
        [9.7, 4.34, 1.37], rel=5e-3
    )  # after 0.2, 1 and 10 s; recalculated independently
    assert math.sqrt(difference_variance(of, 1e12, 100_000)) == pytest.approx(0.43, abs=5e-3)  # after 100 s
    assert 1e3 * math.sqrt(found[100, PHASE, PHASE]) == pytest.approx(
        4.673, abs=1e-3
    )  # after a tenth of a second
    # equality of D11 and D33 holds after infinite time only
    assert found[-1, CODE, CODE] > 8e4 * found[-1, PHASE, PHASE]


def test_difference_of_code_and_phase_shrinks_as_a_constant_that_is_averaged() -> None:
    of = model()
    # range unknown to 10 km, code and phase off it by 50 and 30 m^2
    P0 = 1e8 * np.outer([1.0, 0.0, 1.0], [1.0, 0.0, 1.0]) + np.diag([50.0, 4.0, 30.0])
    found = of.variances(P0, 400).filtered
    d = np.array([1.0, 0.0, -1.0])
    variances = np.einsum("i,kij,j->k", d, found, d)
    # the range itself, unknown as it is, still carries 1e-6 of information on the difference
    assert variances[[99, 399]] == pytest.approx(
        [difference_variance(of, 80.0, k) for k in (100, 400)], rel=1e-3
    )


def test_divergence_noise_gives_the_difference_a_floor() -> None:
    steady = model(divergence=1e-4).steady_gains()
    # a random walk of 1 cm/sqrt(s) seen with 137 m at 1 kHz: sqrt(sqrt(q r)) with r = D T
    r = model().noise()[0] * 1e-3
    assert steady.filtered[CODE, CODE] == pytest.approx(math.sqrt(1e-4 * r), rel=1e-2)
    assert steady.filtered[PHASE, PHASE] == pytest.approx(
        model().steady_gains().filtered[PHASE, PHASE], rel=1e-4
    )


@pytest.mark.parametrize(
    ("sigma_a", "crossing_s", "overshoot", "settling_s"),
    [(10.0, 0.006, 0.236, 0.025), (1.0, 0.020, 0.216, 0.077)],
)
def test_linear_step_of_three_tenths(
    sigma_a: float, crossing_s: float, overshoot: float, settling_s: float
) -> None:
    of = model(sigma_a)
    found = linear_transient(of, of.steady_gains().gains, 0.3, 2000)
    read = read_response(found.time_s, found.phase_rad)
    assert (read.zero_crossing_s, read.settling_s) == pytest.approx((crossing_s, settling_s), abs=1e-9)
    assert read.overshoot == pytest.approx(overshoot, abs=5e-4)
    # a pure phase step contradicts the model: it pulls the code along by its own range, and leaves it there
    assert found.code_m[-1] == pytest.approx(-0.3 * C_MPS / F0 / (2.0 * math.pi), rel=1e-4)
    assert found.code_m[-1] == pytest.approx(-8.9e-3, abs=5e-5)


def test_unit_noise_of_the_printed_program_leaves_half_of_the_phase_error() -> None:
    # Rn = I: code and phase as if equally good; delays in seconds and S = sigma_a^2, as printed in 3.4
    T, F = 1e-3, model().transition()
    P, H = np.diag([1.957e-6 / 24.0, 330.0, 1.957e-6 / 24.0]), np.array([[1.0, 0, 0], [0, 0, 1.0]])
    for _ in range(200):
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + np.eye(2))
        P = F @ (np.eye(3) - K @ H) @ P @ F.T + np.diag([0.0, 100.0 * T, 0.0])
    found = linear_transient(model(), K, 0.3, 3000)
    assert found.phase_rad[-1] == pytest.approx(0.15, abs=2e-3)
    of = model()
    assert linear_transient(of, of.steady_gains().gains, 0.3, 3000).phase_rad[-1] == pytest.approx(
        0.0, abs=1e-6
    )


def test_nonlinear_step_is_the_linear_one_while_the_error_is_small() -> None:
    of = model()
    K = of.steady_gains().gains
    linear, bent = linear_transient(of, K, 0.01, 100), nonlinear_transient(of, K, 0.01, 100)
    # sin 2e / 2e differs by 2/3 e^2, sinc by less
    assert np.max(np.abs(bent.phase_rad - linear.phase_rad)) < 1e-4 * 0.01


def test_nonlinear_step_of_three_tenths_is_a_little_slower() -> None:
    of = model()
    found = nonlinear_transient(of, of.steady_gains().gains, 0.3, 200)
    read = read_response(found.time_s, found.phase_rad)
    assert read.zero_crossing_s == pytest.approx(0.006) and read.settling_s == pytest.approx(0.025)
    assert 0.23 < read.overshoot < 0.236


@pytest.mark.parametrize(("start", "end"), [(0.5, 0.0), (1.2, 0.0), (1.5, 0.0), (1.7, math.pi)])
def test_loop_holds_up_to_a_quarter_turn_and_not_up_to_four_tenths(start: float, end: float) -> None:
    of = model()
    found = nonlinear_transient(of, of.steady_gains().gains, start, 600)
    assert found.phase_rad[-1] == pytest.approx(end, abs=1e-3)


def test_noisy_loop_has_the_variance_of_the_linear_one(rng: np.random.Generator) -> None:
    of = model(cn0=45.0)
    found = nonlinear_transient(of, of.steady_gains().gains, np.zeros(300), 500, rng)
    scale = C_MPS / F0 / (2.0 * math.pi)
    # 300 runs of 0.4 s, independent after 1 / (2 B) of about 12 ms: 300 32 = 10 000 values; linear to 2 sigma^2 = 0.5 %
    K = of.steady_gains().gains
    phase_loop = LoopFilter(K[[PHASE, RATE], 1], np.zeros(2), of.integration_s)
    noise_part = phase_loop.prediction_covariance(of.noise()[1])[0, 0]
    ratio = (found.phase_rad[100:] * scale).var() / noise_part
    assert ratio == pytest.approx(1.0, abs=4.0 * math.sqrt(2.0 / 10_000) + 0.01)


def test_time_varying_gains_pull_in_faster_than_steady_ones(rng: np.random.Generator) -> None:
    of = model(cn0=45.0)
    start_m = 60.0  # of code: 0.1 chips
    varying = of.variances(np.diag([60.0**2, 100.0, 0.1**2]), 3000).gains
    code = np.full(100, start_m)
    found = nonlinear_transient(of, varying, np.zeros(100), 3000, rng, code)
    steady = nonlinear_transient(of, of.steady_gains().gains, np.zeros(100), 3000, rng, code)
    assert abs(np.mean(found.code_m[-1])) < 2.0  # 100 runs of 1 m
    assert (
        np.mean(steady.code_m[-1]) > 0.9 * start_m
    )  # the gain on the code's own offset is of the order 1e-9


def test_response_without_an_offset_is_refused() -> None:
    with pytest.raises(ConfigError, match="begins at zero"):
        read_response(np.arange(3.0), np.zeros(3))


@pytest.mark.parametrize(
    "make",
    [
        lambda: CombinedModel(37.0, -1.0, CHIP_HZ, 100.0),
        lambda: CombinedModel(37.0, F0, CHIP_HZ, 0.0),
        lambda: CombinedModel(5000.0, F0, CHIP_HZ, 100.0),
        lambda: CombinedModel(37.0, F0, CHIP_HZ, 100.0, divergence_density=-1.0),
        lambda: model().variances(np.eye(2), 10),
    ],
)
def test_senseless_models_are_refused(make: object) -> None:
    with pytest.raises(ConfigError):
        make()  # type: ignore[operator]
