"""Channels on correlators: errors against the linear loop, reproducibility, assistance, speed."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from insgnss.errors import ConfigError
from insgnss.tracking.admissible import signal_ratio
from insgnss.tracking.channel_kernel import N_NOISE, N_OUT, N_STATE, PHASE_ERROR, Truth, run_channels
from insgnss.tracking.channels import (
    ChannelDesign,
    ChannelHistory,
    ChannelSimulation,
    InitialLoopErrors,
    chips_per_radian,
    data_signs,
    no_aid,
    scene,
)
from insgnss.tracking.codes import glonass_st, gps_ca
from insgnss.tracking.correlators import Correlators
from insgnss.tracking.delay_discriminators import DelayDiscriminator
from insgnss.tracking.discriminator_outputs import DELAY_KINDS, PHASE_KINDS
from insgnss.tracking.discriminators import equivalent_variance
from insgnss.tracking.loop_filters import assisted_filter, digital_filter, steady_covariance, transition
from insgnss.tracking.phase_discriminators import PhaseDiscriminator
from insgnss.tracking.phase_motion import phase_of_range, steady_phase

T, L1_HZ = 1e-3, 1_575.42e6
A_45 = signal_ratio(45.0, T)
STILL = np.zeros((8001, 24))


def design(phase: str = "atan", delay: str = "dot", order: int = 2, spacing: float = 1.0) -> ChannelDesign:
    loop, code = digital_filter(order, 15.0, T), digital_filter(1, 5.0, T)
    return ChannelDesign(loop, code, 45.0, phase, "none", delay, spacing)


@pytest.mark.parametrize("kind", PHASE_KINDS)
def test_phase_error_at_rest_is_that_of_the_linear_loop(kind: str) -> None:
    of = design(kind)
    found = ChannelSimulation(of, scene(STILL, 45.0)).run(7).phase_error_rad[500:]
    expected = of.carrier.prediction_covariance(equivalent_variance(PhaseDiscriminator(kind), A_45))[0, 0]
    # 24 channels of 7.5 s, independent after 1 / (2 B) = 33 ms: 5400 values; the curve bends by 2/3 sigma^2 = 0.1 %
    assert found.var() / expected == pytest.approx(1.0, abs=4.0 * math.sqrt(2.0 / 5400))


@pytest.mark.parametrize("kind", DELAY_KINDS)
@pytest.mark.parametrize("spacing", [1.0, 0.2])
def test_delay_error_at_rest_is_that_of_the_linear_loop(kind: str, spacing: float) -> None:
    of = design("atan", kind, spacing=spacing)
    found = ChannelSimulation(of, scene(STILL, 45.0)).run(3).delay_error_chips[1000:]
    noise = equivalent_variance(DelayDiscriminator(kind, Correlators(spacing)), A_45)
    expected = of.code.prediction_covariance(noise)[0, 0]
    # 24 channels of 7 s, independent after 1 / (2 B) = 0.1 s: 1680 values; prompt and phase error cost 4 % at most
    assert found.var() / expected == pytest.approx(1.0, abs=4.0 * math.sqrt(2.0 / 1680) + 0.04)


def test_recursion_of_the_kernel_is_the_filter_of_the_design() -> None:
    of, n = design("q", order=3), 200
    state, out, flat = np.zeros((1, N_STATE)), np.empty((n, 1, N_OUT)), np.zeros((n + 1, 1))
    state[0, :2] = 1e-4, 2e-3
    truth = Truth(flat, flat, np.full((n, 1), A_45), np.ones((n, 1), np.int8))
    no_noise, room = np.zeros((n, 1, N_NOISE)), np.zeros(3, np.complex128)
    run_channels(truth, no_aid(n, 1), of.gains(), no_noise, state, room, out)
    error, A = np.array([1e-4, 2e-3, 0.0]), of.carrier.closed_loop()
    for k in range(n):
        # sin e / e: 2e-9 of the error
        assert out[k, 0, PHASE_ERROR] == pytest.approx(error[0], abs=1e-11)
        error = A @ error


# the amplifier holds the noise: Q goes with the root of C/N0, I Q with C/N0, an angle with nothing
@pytest.mark.parametrize(("kind", "power"), [("q", 0.5), ("iq", 1.0), ("atan", 0.0)])
def test_gain_at_another_cn0_than_the_designs_is_that_of_a_held_noise_level(kind: str, power: float) -> None:
    of, moved = design(kind), []
    for cn0 in (45.0, 42.0):
        state, out, flat = np.zeros((1, N_STATE)), np.empty((1, 1, N_OUT)), np.zeros((2, 1))
        state[0, 0] = 1e-3
        truth = Truth(flat, flat, np.full((1, 1), signal_ratio(cn0, T)), np.ones((1, 1), np.int8))
        room = np.zeros(3, np.complex128)
        run_channels(truth, no_aid(1, 1), of.gains(), np.zeros((1, 1, N_NOISE)), state, room, out)
        moved.append(state[0, 0] - 1e-3)

    assert moved[1] / moved[0] == pytest.approx(10.0 ** (-0.3 * power), rel=1e-5)


@pytest.mark.parametrize(("order", "motion"), [(2, (8.0, 0.0)), (3, (0.0, 60.0))])
def test_steady_motion_leaves_the_error_of_the_loop_order(order: int, motion: tuple[float, float]) -> None:
    of = ChannelDesign(digital_filter(order, 15.0, T), digital_filter(1, 1.0, T), 70.0, "atan")
    phase = steady_phase(T * np.arange(3001), L1_HZ, *motion)
    found = ChannelSimulation(of, scene(phase[:, None], 70.0)).run(1)
    # A^-1 of a ramp one order above: the state after the update lacks what the next step adds
    drive = float(phase_of_range(1.0, L1_HZ)) * max(motion) * T ** (order - 1)
    step = {2: np.array([0.5 * T, 1.0]), 3: np.array([T / 6.0, 0.5 / 1.0, 1.0 / T])}[order] * drive
    if order == 3:
        step = float(phase_of_range(1.0, L1_HZ)) * motion[1] * np.array([T**3 / 6.0, T**2 / 2.0, T])
    expected = -np.linalg.solve(np.eye(order) - of.carrier.closed_loop(), step)[0]
    assert np.mean(found.phase_error_rad[2500:]) == pytest.approx(expected, rel=0.02)
    assert abs(expected) > 0.05


def test_code_follows_the_carrier_without_a_lag() -> None:
    code = gps_ca(3)
    ratio = chips_per_radian(code, L1_HZ)
    assert ratio * phase_of_range(293.05, L1_HZ) == pytest.approx(
        1.0, rel=1e-4
    )  # one chip of distance: one chip later
    of = ChannelDesign(
        digital_filter(3, 15.0, T), digital_filter(1, 0.5, T), 60.0, "atan", chips_per_radian=ratio
    )
    phase = steady_phase(T * np.arange(6001), L1_HZ, 8.0)
    found = ChannelSimulation(of, scene(phase[:, None], 60.0, ratio)).run(1)
    alone = ChannelDesign(of.carrier, of.code, 60.0, "atan")
    lagging = ChannelSimulation(alone, scene(phase[:, None], 60.0, ratio)).run(1)
    # 48 m/s at the end are 0.16 chips/s over K = 4 B = 2 / s, less what the acceleration lags; noise 0.5 mchip
    assert abs(lagging.delay_error_chips[-1, 0]) > 0.06
    assert abs(found.delay_error_chips[-1, 0]) < 3e-3


def test_frequency_assistance_pulls_in_what_the_phase_loop_alone_does_not() -> None:
    start = InitialLoopErrors(rate_radps=2.0 * math.pi * 60.0)
    still = scene(np.zeros((301, 12)), 45.0)
    code = digital_filter(1, 1.0, T)
    rms = {}
    for assisted in (True, False):
        loop = assisted_filter(3, 15.0, 10.0 if assisted else 0.0, T)
        of = ChannelDesign(loop, code, 45.0, "atan", "atan" if assisted else "none")
        found = ChannelSimulation(of, still, start=start).run(2)
        rms[assisted] = math.sqrt(np.mean(found.rate_error_radps[-50:] ** 2)) / (2.0 * math.pi)
    # after a quarter of a second: locked, or still some ten hertz off
    assert rms[True] < 2.0 and rms[False] > 10.0


@pytest.mark.parametrize("kind", ["cross", "atan", "atan2"])
def test_error_of_the_assisted_loop_is_that_of_the_linear_one(kind: str) -> None:
    loop = assisted_filter(3, 15.0, 8.0, T)
    of = ChannelDesign(loop, digital_filter(1, 1.0, T), 50.0, "atan", kind)
    found = ChannelSimulation(of, scene(STILL, 50.0)).run(5)
    noise = equivalent_variance(PhaseDiscriminator("atan"), signal_ratio(50.0, T))
    P = loop.prediction_covariance(noise)
    if kind == "cross":
        # the product of both noises, 2 a^2, is white in the rate, where the rest is a difference that telescopes
        drive = transition(3, T) @ loop.rate_gains
        product = 2.0 / (signal_ratio(50.0, T) * T) ** 2
        P = P + steady_covariance(loop.closed_loop(), product * np.outer(drive, drive))
    # about 25 Hz of bandwidth: 24 channels of 7 s hold 8400 independent values; bends and loss of power 1 %
    tolerance = 4.0 * math.sqrt(2.0 / 8400) + 0.01
    assert found.phase_error_rad[1000:].var() / P[0, 0] == pytest.approx(1.0, abs=tolerance)
    assert found.rate_error_radps[1000:].var() / P[1, 1] == pytest.approx(1.0, abs=tolerance)


def test_data_do_not_disturb_a_loop_made_for_them(rng: np.random.Generator) -> None:
    sign = data_signs(8000, 24, T, glonass_st().sign_s, rng)
    assert set(np.unique(sign)) == {-1, 1} and np.all(sign[:10] == sign[0])
    plain = ChannelSimulation(design("atan"), scene(STILL, 45.0)).run(1)
    with_data = ChannelSimulation(design("atan"), scene(STILL, 45.0, sign=sign)).run(1)
    assert with_data.phase_error_rad.std() == pytest.approx(plain.phase_error_rad.std(), rel=0.05)
    blind = ChannelSimulation(design("atan2"), scene(STILL, 45.0, sign=sign)).run(1)
    assert blind.phase_error_rad.std() > 5.0 * plain.phase_error_rad.std()


def same(first: ChannelHistory, second: ChannelHistory) -> bool:
    return np.array_equal(first.prompt, second.prompt) and np.array_equal(
        first.phase_error_rad, second.phase_error_rad
    )


def test_result_depends_on_the_seed_and_on_nothing_else() -> None:
    still = np.zeros((9001, 7))  # more than two blocks of noise
    of = ChannelSimulation(design(), scene(still, 45.0))
    first = of.run(11)
    assert same(first, of.run(11)) and same(first, of.run(11, threads=3))
    assert not same(first, of.run(12))
    alone = ChannelSimulation(design(), scene(still[:, :3], 45.0)).run(11)
    assert np.array_equal(alone.prompt, first.prompt[:, :3])  # of the channels beside it neither


def test_progress_counts_every_integration() -> None:
    done: list[int] = []
    ChannelSimulation(design(), scene(np.zeros((9001, 4)), 45.0)).run(1, 2, done.append)
    assert sum(done) == 9000 * 4


def test_twelve_channels_run_for_ten_seconds(benchmark: Callable[..., object]) -> None:
    of = ChannelSimulation(design(), scene(np.zeros((10_001, 12)), 45.0))
    of.run(1)  # compiled
    # at most half a second, twenty times faster than time; 0.04 s were measured
    assert benchmark(of.run, 1) is not None


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: ChannelDesign(digital_filter(2, 15.0, T), digital_filter(3, 1.0, T), 45.0), "do not match"),
        (
            lambda: ChannelDesign(digital_filter(2, 15.0, T), digital_filter(1, 1.0, 2 * T), 45.0),
            "do not match",
        ),
        (
            lambda: ChannelDesign(digital_filter(2, 15.0, T), digital_filter(1, 1.0, T), 45.0, "iq", "atan"),
            "incomplete",
        ),
        (lambda: design("costas"), "phase discriminator"),
        (lambda: scene(np.zeros(5), 45.0), "invalid phases"),
        (lambda: scene(np.full((5, 1), np.nan), 45.0), "invalid phases"),
        (lambda: scene(np.zeros((5, 1)), [[45.0], [45.0], [math.nan], [45.0]]), "out of range"),
        (lambda: ChannelSimulation(design(), scene(STILL, 45.0)).run(-1), "invalid seed"),
        (lambda: scene(np.zeros((5, 1)), 45.0, sign=np.zeros((4, 1), np.int8)), "invalid signs"),
        (lambda: data_signs(10, 1, 3e-3, 0.02, np.random.default_rng(1)), "do not fill"),
        (
            lambda: ChannelSimulation(design(), scene(STILL, 45.0), no_aid(10, 24)).run(1),
            "does not fit the scene",
        ),
        (lambda: ChannelSimulation(design(), scene(STILL, 45.0)).run(1, threads=0), "threads"),
    ],
)
def test_senseless_channels_are_refused(make: object, word: str) -> None:
    with pytest.raises(ConfigError, match=word):
        make()  # type: ignore[operator]
