"""Sample calls of the kernels in ``insgnss.tracking``."""

from __future__ import annotations

import numpy as np

from insgnss.tables import Float64
from insgnss.tracking.channels import ChannelDesign, Simulation, Start, scene
from insgnss.tracking.codes import glonass_st
from insgnss.tracking.discriminator_outputs import DELAY_KINDS, FREQUENCY_KINDS, PHASE_KINDS, outputs
from insgnss.tracking.loop_filters import assisted_filter, digital_filter
from insgnss.tracking.phase_extrapolation import RULES, accumulated_ranges
from insgnss.tracking.signal import CarrierAndCode, Received, Sampling, correlate, receive
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
        signal = Received(glonass_st(), 45.0, CarrierAndCode(510.4, 812.0, 0.6), signs)
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
    history = Simulation(design, scene(phase, 45.0, -1e-4), start=Start(0.2, 5.0, 0.1)).run(3)
    return [history.phase_error_rad, history.rate_error_radps, history.delay_error_chips, history.prompt.real]


def extrapolated_ranges() -> list[Float64]:
    """Return the ranges of two channels by every rule."""
    rng = np.random.default_rng(8)
    u = rng.standard_normal((6, 2, 3))
    u /= np.linalg.norm(u, axis=2, keepdims=True)
    v_sat, v, a = 3e3 * rng.standard_normal((6, 2, 3)), *(100.0 * rng.standard_normal((2, 6, 3)))
    return [accumulated_ranges(u, v_sat, v, a, 0.02, np.arange(6.0), rule) for rule in RULES]


CASES = [
    KernelCase("tests.kernels.tracking:discriminators"),
    KernelCase("tests.kernels.tracking:extrapolated_ranges"),
    KernelCase("tests.kernels.tracking:sampled_correlators", rtol=1e-11),
    # 200 steps of a loop that is stable: no growth of rounding
    KernelCase("tests.kernels.tracking:channels", rtol=1e-11),
]
