"""One trial of a loop from start to finish: a motion, its channels, and what is read off them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from insgnss.errors import ConfigError
from insgnss.tables import Complex, Int8, rms
from insgnss.tracking.admissible import require_not_negative, seeded, signal_ratio
from insgnss.tracking.aided_loop import perfect_aid
from insgnss.tracking.channels import (
    ChannelDesign,
    ChannelHistory,
    ChannelSimulation,
    chips_per_radian,
    data_signs,
    no_aid,
    scene,
)
from insgnss.tracking.codes import RangingCode
from insgnss.tracking.correlators import Correlators
from insgnss.tracking.delay_discriminators import DelayDiscriminator
from insgnss.tracking.discriminators import equivalent_variance
from insgnss.tracking.frequency_loop import FrequencyLoop
from insgnss.tracking.lock_and_cn0 import (
    SYMBOL_BLOCK,
    moment_cn0_dbhz,
    narrow_wide_cn0_dbhz,
    phase_lock,
    slip_time_s,
)
from insgnss.tracking.loop_filters import LoopFilter
from insgnss.tracking.phase_discriminators import PhaseDiscriminator
from insgnss.tracking.phase_motion import steady_phase, wandering_phase

_SEEN_SIGMAS: Final = 4.0  # of noise by which the power of a signal stands out: once in 30 000 without one
_SETTLING_SHARE: Final = 0.2  # of the time is left to the transients of the start
_MOTION_KEY, _SIGN_KEY = 1_000_001, 1_000_002  # seeds apart from those of the channels' noise


@dataclass(frozen=True)
class CarrierDynamics:
    """Dynamics of the carrier phase: motion along the line of sight, and the oscillator."""

    acceleration_mps2: float = 0.0
    jerk_mps3: float = 0.0
    wander: float = 0.0  # one-sided density of the derivative of the angular frequency [rad^2/s^3]


class Assessment(NamedTuple):
    """Errors of the channels that did not slip, NaN if all did, beside the noise of the linear loop."""

    channels: int
    slipped: int
    phase_rms_rad: float
    phase_noise_rad: float
    rate_rms_radps: float
    delay_rms_chips: float
    delay_noise_chips: float
    phase_lock: float
    moment_dbhz: float
    narrow_wide_dbhz: float


def design_channels(
    code: RangingCode,
    carrier_hz: float,
    cn0_dbhz: float,
    carrier: LoopFilter,
    delay: LoopFilter,
    phase_kind: str = "atan",
    spacing_chips: float = 1.0,
) -> ChannelDesign:
    """Return channels with carrier-aided code loops, and a frequency discriminator where the carrier loop wants one.

    Raises
    ------
    ConfigError : something of it does not fit together
    """
    assisted = bool(np.any(carrier.rate_gains))
    return ChannelDesign(
        carrier,
        delay,
        cn0_dbhz,
        phase_kind,
        "atan" if assisted else "none",
        "dot",
        spacing_chips,
        chips_per_radian(code, carrier_hz),
    )


def simulation_of(
    design: ChannelDesign,
    code: RangingCode,
    carrier_hz: float,
    motion: CarrierDynamics,
    seconds: float,
    channels: int,
    seed: int,
    aided: bool = False,
) -> ChannelSimulation:
    """Return the simulation of a motion: data on the carrier if the discriminator tolerates them.

    With aiding the motion along the line of sight is known to the loops, the wandering frequency is not: it is that of
    the oscillator and of the aiding's own error.
    """
    require_not_negative(wander=motion.wander)
    n, T = round(seconds / design.step_s), design.step_s
    rng = seeded(seed, _MOTION_KEY)
    steady = steady_phase(
        np.asarray(T * np.arange(n + 1)), carrier_hz, motion.acceleration_mps2, motion.jerk_mps3
    )
    phase = wandering_phase(motion.wander, n, channels, T, rng) + steady[:, None]
    sign = _signs(design, code, n, channels, seed)
    known = np.repeat(steady[:, None], channels, axis=1)
    aid = perfect_aid(known, T) if aided else no_aid(n, channels)
    return ChannelSimulation(design, scene(phase, design.cn0_dbhz, design.chips_per_radian, sign), aid)


def _signs(design: ChannelDesign, code: RangingCode, count: int, channels: int, seed: int) -> Int8 | None:
    if PhaseDiscriminator(design.phase_kind).aperture_rad > math.pi:
        return None
    return data_signs(count, channels, design.step_s, code.sign_s, seeded(seed, _SIGN_KEY))


def assess(simulation: ChannelSimulation, history: ChannelHistory) -> Assessment:
    """Return errors, lock and C/N0 of a simulation of phase loops, the first fifth of its time left out.

    Raises
    ------
    ConfigError : the carrier loop is a frequency loop, which does not track phase
    """
    design, T = simulation.design, simulation.design.step_s
    if isinstance(design.carrier, FrequencyLoop):
        advice = "judge the rate_error_radps of the history instead"
        raise ConfigError("a frequency loop has no phase error to assess", key="carrier", advice=advice)
    phase_discriminator = PhaseDiscriminator(design.phase_kind)
    slipped = np.isfinite(slip_time_s(history.phase_error_rad, T, phase_discriminator.aperture_rad))
    block = _block(simulation)
    first = int(len(history.prompt) * _SETTLING_SHARE) // block * block
    kept = np.s_[first:, ~slipped]
    a = signal_ratio(design.cn0_dbhz, T)
    noise = equivalent_variance(phase_discriminator, a)
    delay = DelayDiscriminator(design.delay_kind, Correlators(design.spacing_chips))
    prompt = history.prompt[first:]
    return Assessment(
        len(slipped),
        int(slipped.sum()),
        rms(history.phase_error_rad[kept]),
        math.sqrt(design.carrier.prediction_covariance(noise)[0, 0]),
        rms(history.rate_error_radps[kept]),
        rms(history.delay_error_chips[kept]),
        math.sqrt(design.code.prediction_covariance(equivalent_variance(delay, a))[0, 0]),
        _mean_lock(prompt, block),
        *_estimates(prompt, T, block),
    )


def _block(simulation: ChannelSimulation) -> int:
    """Return how many integrations hold one sign of the data, by where the signs change."""
    changes = np.flatnonzero(np.diff(simulation.scene.sign, axis=0).any(axis=1))
    return int(np.gcd.reduce(changes + 1)) if changes.size else min(SYMBOL_BLOCK, len(simulation.scene.sign))


def _estimates(prompt: Complex, step_s: float, block: int) -> tuple[float, float]:
    """Return the medians over the channels of both estimators, from the whole time; NaN where one fails."""
    window = len(prompt) // block * block
    if window < 2:
        return math.nan, math.nan
    moments = float(np.median(moment_cn0_dbhz(prompt, step_s, window)))
    if block < 2:
        return moments, math.nan
    return moments, float(np.median(narrow_wide_cn0_dbhz(prompt, step_s, window, block)))


def _mean_lock(prompt: Complex, block: int) -> float:
    """Return the phase lock over the channels that see a signal; NaN without one, or with one integration a symbol.

    Noise alone makes the power of sums over M integrations that of the single ones, with a relative deviation of
    sqrt((M - 1) / (M blocks)). Where the signal is lost the phase lock is a ratio of two such noises, of any size.
    """
    blocks = len(prompt) // block
    if block < 2 or blocks < 1:
        return math.nan
    Z = prompt[: blocks * block].reshape(blocks, block, -1)
    power = (np.abs(Z.sum(axis=1)) ** 2).sum(axis=0) / (np.abs(Z) ** 2).sum(axis=(0, 1))
    seen = power - 1.0 > _SEEN_SIGMAS * math.sqrt((block - 1.0) / (block * blocks))
    return float(np.mean(phase_lock(prompt, block, blocks).ravel()[seen])) if seen.any() else math.nan
