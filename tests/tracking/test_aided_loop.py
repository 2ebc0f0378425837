"""The aided loop: closed forms of Shatilov 2009, Riccati and simulation agree; aiding with error, rate and latency."""

from __future__ import annotations

import math

import numpy as np
import pytest

from insgnss.errors import ConfigError, InputError
from insgnss.tracking.aided_loop import (
    aided_loop,
    aiding_curve,
    held_error_radps,
    inertial_sources,
    optimum_loop,
    perfect_aid,
    threshold_cn0_dbhz,
)
from insgnss.tracking.aiding_source import (
    AidingSource,
    acceleration_aid,
    aid_from,
    planned_source,
    source_from_doppler,
)
from insgnss.tracking.channels import ChannelDesign, ChannelHistory, ChannelSimulation, scene
from insgnss.tracking.lock_and_cn0 import slip_time_s
from insgnss.tracking.loop_filters import continuous_gains, digital_filter, filter_from_continuous
from insgnss.tracking.phase_motion import phase_of_range, steady_phase, wandering_phase

L1_HZ = 1_575.42e6
DF_C_HZ = 1.022e6  # the paper's reference bandwidth for J/S
# J/S type 1 and 2 [dB] and bandwidth there [Hz] for C_A = 0.076, Ts = 10 ms: recalculated independently of this project
REFERENCE = {
    0.1: (56.8745, 0.359, 44.8669, 0.570),
    1.0: (53.5412, 0.773, 42.7008, 1.228),
    10.0: (50.2079, 1.666, 40.3371, 2.645),
    100.0: (46.8745, 3.590, 37.7389, 5.698),
}


@pytest.mark.parametrize("density", REFERENCE)
@pytest.mark.parametrize("T", [1e-3, 1e-2])
def test_threshold_and_bandwidth_agree_with_the_closed_forms(density: float, T: float) -> None:
    js_1, bandwidth_1, _, _ = REFERENCE[density]
    found = aiding_curve([density], 40.0, T, "q")
    # the digital loop predicts over a step: to first order its error is larger by K1 T = 8/3 B T
    bt = bandwidth_1 * T
    assert DF_C_HZ / 10 ** (0.1 * found.threshold_dbhz[0]) == pytest.approx(
        10 ** (0.1 * js_1), rel=4.0 * bt + 1e-4
    )
    assert found.threshold_bandwidth_hz[0] == pytest.approx(bandwidth_1, rel=2.0 * bt + 2e-3)


@pytest.mark.parametrize("density", REFERENCE)
def test_threshold_with_squaring_loss_agrees_with_the_corrected_form(density: float) -> None:
    _, _, js_2, bandwidth_2 = REFERENCE[density]
    T = 1e-2  # the loss belongs to this integration time, so that B T is what it is
    found = aiding_curve([density], 40.0, T, "iq")
    assert 10 * math.log10(DF_C_HZ) - found.threshold_dbhz[0] == pytest.approx(
        js_2, abs=10.0 * bandwidth_2 * T
    )
    assert found.threshold_bandwidth_hz[0] == pytest.approx(bandwidth_2, rel=1.5 * bandwidth_2 * T + 2e-3)


@pytest.mark.parametrize("T", [1e-5, 1e-4, 1e-3])
def test_optimum_tends_to_the_continuous_loop(T: float) -> None:
    S_S, S_n = 100.0, 1e-4
    found = optimum_loop(S_S, S_n / (2.0 * T), T)
    K2 = math.sqrt(S_S / S_n)
    K1 = math.sqrt(2.0 * K2)
    assert found.filter.gains / T == pytest.approx([K1, K2], rel=1.5 * K1 * T)  # (10)
    assert found.bandwidth_hz == pytest.approx(
        3.0 / (4.0 * math.sqrt(2.0)) * (S_S / S_n) ** 0.25, rel=K1 * T
    )  # (13)
    assert found.predicted[0, 0] == pytest.approx(
        (S_S * S_n**3) ** 0.25 / math.sqrt(2.0), rel=K1 * T
    )  # (16) + (17)


def test_error_of_the_continuous_gains_has_the_two_parts_of_the_paper() -> None:
    T, S_S, S_n = 1e-5, 100.0, 1e-4
    K2 = math.sqrt(S_S / S_n)
    loop = filter_from_continuous([math.sqrt(2.0 * K2), K2], T)
    noise = loop.prediction_covariance(S_n / (2.0 * T))[0, 0]
    process = 0.5 * S_S * np.array([[T**3 / 3.0, T**2 / 2.0], [T**2 / 2.0, T]])
    motion = loop.prediction_covariance(0.0, process)[0, 0]
    size = (S_S * S_n**3) ** 0.25
    assert noise == pytest.approx(3.0 / (4.0 * math.sqrt(2.0)) * size, rel=2e-3)  # (16)
    assert motion == pytest.approx(1.0 / (4.0 * math.sqrt(2.0)) * size, rel=2e-3)  # (17)


def test_optimum_is_better_than_loops_beside_it() -> None:
    T, S_S, variance = 1e-3, 100.0, 0.05
    best = optimum_loop(S_S, variance, T)
    process = 0.5 * S_S * np.array([[T**3 / 3.0, T**2 / 2.0], [T**2 / 2.0, T]])
    assert best.filter.prediction_covariance(variance, process) == pytest.approx(best.predicted, rel=1e-8)
    for factor in (0.8, 1.25):
        other = digital_filter(2, factor * best.bandwidth_hz, T)
        assert other.prediction_covariance(variance, process)[0, 0] > best.predicted[0, 0]


def closed_loops(
    S_osc: float, S_ins: float, cn0: float, seconds: float, kind: str, aided: bool, channels: int = 40
) -> tuple[ChannelHistory, float]:
    """Return loops at their optimum under a strong motion, and the rms that the Riccati equation promises."""
    T = 1e-3
    n = round(seconds / T)
    rng = np.random.default_rng([9, channels])
    t = T * np.arange(n + 1)
    motion = phase_of_range(40.0 * np.cos(2.0 * math.pi * 0.5 * t), L1_HZ)  # 40 g at most, 0.5 Hz
    phase = motion[:, None] + wandering_phase(S_osc, n, channels, T, rng)
    best = aided_loop(S_osc + S_ins, cn0, T, kind)
    aid = None
    if aided:
        fine = np.arange(-0.01, seconds + 0.02, T)
        w = 2.0 * math.pi * 0.5
        rate = phase_of_range(-40.0 * w * np.sin(w * fine), L1_HZ)
        acceleration = phase_of_range(-40.0 * w * w * np.cos(w * fine), L1_HZ)
        wide = np.repeat(rate[:, None], channels, 1), np.repeat(acceleration[:, None], channels, 1)
        aid = aid_from(inertial_sources(fine, *wide, S_ins, 2e-3, rng), n, T)
    # a code loop as slow as that keeps its delay where nothing moves, at any C/N0
    of = ChannelDesign(best.filter, digital_filter(1, 1e-3, T), cn0, kind)
    return ChannelSimulation(of, scene(phase, cn0), aid).run(4), math.sqrt(best.predicted[0, 0])


@pytest.mark.parametrize(("S_osc", "S_ins"), [(5.0, 5.0), (0.0, 50.0), (200.0, 2.0)])
def test_closed_aided_loop_has_the_error_of_its_riccati_equation(S_osc: float, S_ins: float) -> None:
    found, expected = closed_loops(S_osc, S_ins, 45.0, 6.0, "iq", aided=True)
    rms = math.sqrt(np.mean(found.phase_error_rad[1500:] ** 2))
    # 40 channels of 4.5 s at B = 7 to 20 Hz: at least 2500 independent values, 3 % of a variance at one sigma; noise
    # of the curve's bend below 1 %
    assert rms == pytest.approx(expected, rel=0.07)


def test_loop_without_the_aiding_loses_the_same_motion() -> None:
    found, _ = closed_loops(5.0, 5.0, 45.0, 3.0, "iq", aided=False)
    assert np.all(np.isfinite(slip_time_s(found.phase_error_rad, 1e-3, math.pi)))
    held, _ = closed_loops(5.0, 5.0, 45.0, 3.0, "iq", aided=True)
    assert not np.any(np.isfinite(slip_time_s(held.phase_error_rad, 1e-3, math.pi)))


@pytest.mark.parametrize("S", [10.0, 1000.0])
def test_loops_hold_above_the_threshold_and_slip_below(S: float) -> None:
    threshold = threshold_cn0_dbhz(S, 1e-3, "q")
    shares = []
    for cn0 in (threshold + 3.0, threshold - 4.0):
        found, _ = closed_loops(S, 0.0, cn0, 6.0 if S > 100.0 else 20.0, "q", aided=True)
        shares.append(np.mean(np.isfinite(slip_time_s(found.phase_error_rad, 1e-3, 2.0 * math.pi))))
    # mean time to slip: about 300 / B at the threshold, thousands 3 dB above, a few 4 dB below; these are 20 to 40 / B
    assert shares[0] <= 0.05 and shares[1] >= 0.5


def test_better_aiding_lowers_threshold_bandwidth_and_error() -> None:
    found = aiding_curve([0.1, 1.0, 10.0, 100.0, 1000.0], 40.0, 1e-3, "iq")
    for values in (found.rms_rad, found.bandwidth_hz, found.threshold_dbhz, found.threshold_bandwidth_hz):
        assert np.all(np.diff(values) > 0.0)
    # four powers of ten of S are 40/3 dB of noise density in linear theory, fewer of C/N0 under squaring loss at 1 ms
    assert found.threshold_dbhz[-1] - found.threshold_dbhz[0] < 40.0 / 3.0


def test_dynamics_too_fast_for_the_integration_are_refused() -> None:
    with pytest.raises(ConfigError, match="cannot follow"):
        threshold_cn0_dbhz(1e7, 1e-2)
    with pytest.raises(ConfigError, match="above 0"):
        optimum_loop(0.0, 1.0, 1e-3)
    with pytest.raises(ConfigError, match="no loop of order"):
        optimum_loop(1.0, 1.0, 1e-3, 4)


# ------------------------------------------------------------ sources


def test_held_aiding_is_late_by_its_latency_and_its_rate() -> None:
    acceleration, update, latency = 190.0, 0.1, 0.03
    t = np.arange(0.0, 5.0, update)
    source = AidingSource(t, acceleration * t, None, latency)
    use = np.linspace(1.0, 4.0, 3001)
    error = acceleration * use - source.rate_at(use)
    mean, largest = held_error_radps(acceleration, update, latency)
    assert np.mean(error) == pytest.approx(mean, rel=0.01)  # read each millisecond of a step of a tenth
    assert (
        np.max(error) == pytest.approx(largest, rel=0.02) and np.min(error) >= acceleration * latency - 1e-6
    )
    led = AidingSource(t, acceleration * t, np.full(len(t), acceleration), latency)
    assert led.rate_at(use) == pytest.approx(acceleration * use)


def test_latency_costs_the_loop_the_error_of_its_bandwidth() -> None:
    # a steady acceleration: the held rate lags by a constant, whose step the second-order loop takes out again
    T, n = 1e-3, 4000
    phase = steady_phase(T * np.arange(n + 1), L1_HZ, 5.0)
    t = np.arange(-0.2, 4.1, 0.01)
    rate = float(phase_of_range(5.0, L1_HZ)) * t
    of = ChannelDesign(digital_filter(2, 5.0, T), digital_filter(1, 1.0, T), 55.0, "atan")
    errors = []
    for latency in (0.0, 0.05):
        aid = aid_from([[AidingSource(t, rate, None, latency)]], n, T)
        errors.append(
            np.std(ChannelSimulation(of, scene(phase[:, None], 55.0), aid).run(1).phase_error_rad[2000:])
        )
    alone = ChannelSimulation(of, scene(phase[:, None], 55.0)).run(1).phase_error_rad[2000:]
    assert max(errors) < 0.1 < abs(np.mean(alone))


def test_acceleration_alone_takes_out_the_lag_of_a_second_order_loop() -> None:
    T, n = 1e-3, 3000
    phase = steady_phase(T * np.arange(n + 1), L1_HZ, 3.0)
    of = ChannelDesign(digital_filter(2, 10.0, T), digital_filter(1, 1.0, T), 60.0, "atan")
    told = acceleration_aid(np.full(n + 1, float(phase_of_range(3.0, L1_HZ))), 1)
    aided = ChannelSimulation(of, scene(phase[:, None], 60.0), told).run(1)
    alone = ChannelSimulation(of, scene(phase[:, None], 60.0)).run(1)
    assert abs(np.mean(aided.phase_error_rad[1500:])) < 0.01
    assert abs(np.mean(alone.phase_error_rad[1500:])) == pytest.approx(
        3.0 * abs(float(phase_of_range(1.0, L1_HZ))) / continuous_gains(2, 10.0)[1], rel=0.05
    )


def test_error_of_a_source_is_a_random_walk_of_its_density(rng: np.random.Generator) -> None:
    t = np.arange(0.0, 10.0, 0.01)
    plain = AidingSource(t, np.zeros(len(t)), None, 0.0, 8.0)
    ends = np.array([plain.with_errors(rng).rate_radps[-1] for _ in range(2000)])
    # S / 2 per second, one-sided density: 4 * 9.99; 4 sigma of a variance from 2000 runs
    assert ends.var() == pytest.approx(4.0 * 9.99, rel=4.0 * math.sqrt(2.0 / 2000))
    assert plain.with_errors(rng, bias_radps=5.0).rate_radps[0] == 5.0


def test_source_of_the_engine_has_the_sign_of_rinex() -> None:
    # positive Doppler, shrinking distance, carrier phase that grows
    source = source_from_doppler([0.0, 1.0], [100.0, 110.0], [10.0, 10.0])
    assert source.rate_at([0.5, 1.5]) == pytest.approx(2.0 * math.pi * np.array([105.0, 115.0]))


def test_planned_profile_replaces_the_inertial_system() -> None:
    T, n = 1e-3, 3000
    plan_t = np.linspace(-1.0, 5.0, 61)

    def distance(t: np.ndarray) -> np.ndarray:
        return np.asarray(2e7 + 200.0 * t + 30.0 * t**2 + 8.0 * np.sin(t))

    phase = phase_of_range(distance(T * np.arange(n + 1)) - 2e7, L1_HZ)
    source = planned_source(plan_t, distance(plan_t), L1_HZ, error_density=20.0)
    assert source.known_ahead and source.error_density == 20.0
    told = aid_from([[source]], n, T).rate_radps[:, 0]
    exact = perfect_aid(phase[:, None], T).rate_radps[:, 0]
    # a cubic spline through points 0.1 s apart: 8 sin t h^3 / 24 of the rate, 0.3 mm/s; 33 rad/s per m/s
    assert np.max(np.abs(told - exact)[1:-1]) < 0.05
    of = ChannelDesign(digital_filter(2, 3.0, T), digital_filter(1, 1.0, T), 45.0, "iq")
    aided = ChannelSimulation(of, scene(phase[:, None], 45.0), aid_from([[source]], n, T)).run(1)
    alone = ChannelSimulation(of, scene(phase[:, None], 45.0)).run(1)
    assert np.max(np.abs(aided.phase_error_rad)) < 0.3
    assert np.max(np.abs(alone.phase_error_rad)) > math.pi


def test_planned_profile_is_worth_what_its_density_is() -> None:
    # "+4 dB" of seed 001's text: S smaller by 15.8 for a pilot (10 log10(15.8) / 3)
    gain = threshold_cn0_dbhz(15.8 * 2.0, 1e-3, "q") - threshold_cn0_dbhz(2.0, 1e-3, "q")
    assert gain == pytest.approx(4.0, abs=0.02)


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: AidingSource(np.array([0.0, 0.0]), np.zeros(2)), "strictly increasing"),
        (lambda: AidingSource(np.array([0.0, 1.0]), np.array([0.0, np.nan])), "not finite"),
        (lambda: AidingSource(np.zeros(1), np.zeros(1), latency_s=0.5).rate_at([0.2]), "no aiding"),
        (lambda: planned_source([0.0, 1.0, 2.0], [1.0, 2.0, 3.0], L1_HZ, 1.0), "at least 4"),
        (lambda: planned_source([0.0, 1.0, 2.0, 3.0], [1.0, np.nan, 2.0, 3.0], L1_HZ, 1.0), "not finite"),
        (
            lambda: aid_from([[planned_source([0.0, 1.0, 2.0, 3.0], np.ones(4), L1_HZ, 1.0)]], 5000, 1e-3),
            "reaches from 0 to 3 s",
        ),
    ],
)
def test_aiding_that_cannot_be_used_is_refused(make: object, word: str) -> None:
    with pytest.raises(InputError, match=word) as caught:
        make()  # type: ignore[operator]
    assert caught.value.advice
