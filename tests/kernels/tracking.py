"""Sample calls of the kernels in ``insgnss.tracking``."""

from __future__ import annotations

import numpy as np

from insgnss.tables import Float64
from insgnss.tracking.channels import ChannelDesign, ChannelSimulation, InitialLoopErrors, scene
from insgnss.tracking.codes import glonass_st, gps_ca
from insgnss.tracking.discriminator_outputs import DELAY_KINDS, FREQUENCY_KINDS, PHASE_KINDS, outputs
from insgnss.tracking.loop_filters import assisted_filter, digital_filter
from insgnss.tracking.phase_extrapolation import RULES, accumulated_ranges
from insgnss.tracking.sample_channel import LoopAiding, SampleChannels
from insgnss.tracking.sample_kernels import add_signal
from insgnss.tracking.signal import (
    CarrierAndCode,
    ReceivedSignal,
    Sampling,
    SignalSamples,
    correlate,
    receive,
)
from tests.kernels import KernelCase


def discriminators() -> list[Float64]:
    """Return the outputs of all discriminators for correlators in all quadrants."""
    angles = np.linspace(-3.0, 3.0, 11)
    prompt = 2.0 * np.exp(1j * angles)
    Z = np.stack([0.4 * prompt + 0.1j, prompt, 0.7 * prompt - 0.2], axis=-1)
    found = [outputs(0, kind, Z) for kind in range(len(DELAY_KINDS))]
    found += [outputs(1, kind, Z[:, 1:2]) for kind in range(len(PHASE_KINDS))]
    return found + [outputs(2, kind, Z[:, :2]) for kind in range(len(FREQUENCY_KINDS))]


def sampled_correlators() -> list[np.ndarray]:
    """Return real and complex samples, correlated with a replica beside them."""
    found = []
    for sampling in (Sampling(11.3e6, 3.07e6), Sampling(5.3e6, 0.2e6, is_complex=True)):
        signs = np.array([1, -1], np.int8)
        signal = ReceivedSignal(glonass_st(), 45.0, CarrierAndCode(510.4, 812.0, 0.6), signs)
        samples = receive([signal], sampling, 600, None)
        Z = correlate(samples, glonass_st(), CarrierAndCode(510.1, 655.0), 45.0, 0.37)
        found += [samples.in_phase, samples.quadrature, Z.real, Z.imag]
    return found


def channels() -> list[np.ndarray]:
    """Return three moving channels with frequency assistance, and what their loops do."""
    step = 1e-3
    phase = np.outer(np.arange(201.0) * step, [0.0, 20.0, -40.0])
    design = ChannelDesign(
        assisted_filter(3, 15.0, 5.0, step), digital_filter(2, 1.0, step), 45.0, "atan", "atan", "tanh"
    )
    history = ChannelSimulation(
        design, scene(phase, 45.0, -1e-4), start=InitialLoopErrors(0.2, 5.0, 0.1)
    ).run(3)
    return [history.phase_error_rad, history.rate_error_radps, history.delay_error_chips, history.prompt.real]


def extrapolated_ranges() -> list[Float64]:
    """Return the ranges of two channels by every rule."""
    rng = np.random.default_rng(8)
    u = rng.standard_normal((6, 2, 3))
    u /= np.linalg.norm(u, axis=2, keepdims=True)
    v_sat, v, a = 3e3 * rng.standard_normal((6, 2, 3)), *(100.0 * rng.standard_normal((2, 6, 3)))
    return [accumulated_ranges(u, v_sat, v, a, 0.02, np.arange(6.0), rule) for rule in RULES]


def _folded(signal: ReceivedSignal, sampling: Sampling, count: int) -> SignalSamples:
    """Return samples too few for the code: a folded signal is good enough for numbers to compare."""
    in_phase, quadrature = np.zeros(count), np.zeros(count if sampling.is_complex else 0)
    steps = signal.state.steps(signal.code, sampling)
    add_signal(0.5, signal.code.chips, signal.signs, steps, in_phase, quadrature)
    return SignalSamples(sampling, in_phase, quadrature)


def sampled_channels() -> list[np.ndarray]:
    """Return what two channels do with real and with complex samples, aided and not, one of them too late."""
    step, found = 1e-3, []
    design = ChannelDesign(
        assisted_filter(2, 15.0, 5.0, step),
        digital_filter(1, 5.0, step),
        50.0,
        "atan",
        "atan",
        "dot",
        0.5,
        -1e-4,
    )
    for sampling in (Sampling(0.3e6, 0.07e6), Sampling(0.2e6, 0.01e6, is_complex=True)):
        signal = ReceivedSignal(gps_ca(5), 50.0, CarrierAndCode(300.0, 20.0, 0.3))
        samples = _folded(signal, sampling, round(0.02 * sampling.rate_hz))
        channels = SampleChannels(sampling, [gps_ca(5), gps_ca(6)], design, 1.0, 30)
        for c, sample in enumerate((100, 4)):
            channels.open_channel(c, sample, 300.0 / 1.023e6, 100.0)
        aiding = LoopAiding(np.array([30.0, 0.0]), np.array([5.0, 0.0]), np.array([0.0, 0.0]))
        channels.run(samples.in_phase, samples.quadrature, 0, round(0.015 * sampling.rate_hz), aiding)
        channels.run(samples.in_phase, samples.quadrature, 10_000, 20_000, aiding)
        found += [channels.state, np.nan_to_num(channels.records), channels.written]
    return found


CASES = [
    KernelCase("tests.kernels.tracking:sampled_channels"),
    KernelCase("tests.kernels.tracking:discriminators"),
    KernelCase("tests.kernels.tracking:extrapolated_ranges"),
    KernelCase("tests.kernels.tracking:sampled_correlators", rtol=1e-11),
    # 200 steps of a loop that is stable: no growth of rounding
    KernelCase("tests.kernels.tracking:channels", rtol=1e-11),
]
