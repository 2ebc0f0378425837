"""One integration of m channels with externally steered replicas: correlators, discriminators, observations.

Offsets are truth minus replica in metres of range and metres per second, as a navigation filter has them:

- coherent: phase offset ``-k dr``, the carrier's phase falls while the range grows; I and Q of the prompt replica.
  With the code too (``with_code``) early and late replicas see the delay, of a code replica that may stand elsewhere
- non-coherent: delay ``dr / chip``; a frequency discriminator over the two halves of the integration (same data bit),
  ``u_f = Im(Z1* Z2)``, and a delay discriminator over the whole of it, ``|L|^2 - |E|^2``

An observation is the discriminator's output over its slope, as range and range rate; its variance is that of the
output at no offset. Slopes and variances depend on C/N0 and are in a table with a row for each 0.02 dB
(``observation_table``): no formula of a discriminator is repeated here. Where the assumed C/N0 is not the true one,
the gain is off by their ratio for products of two correlators: an amplifier holds the noise level.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.constants import C_MPS
from insgnss.errors import ConfigError
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64, Int64
from insgnss.tracking.admissible import require_known, require_positive, signal_ratio
from insgnss.tracking.channel_kernel import carrier_mean, triangle_at
from insgnss.tracking.correlators import Correlators
from insgnss.tracking.delay_discriminators import DelayDiscriminator
from insgnss.tracking.discriminator_outputs import (
    DELAY_KINDS,
    FREQUENCY_KINDS,
    PHASE_KINDS,
    delay_output,
    frequency_output,
    phase_output,
)
from insgnss.tracking.frequency_discriminators import FrequencyDiscriminator
from insgnss.tracking.phase_discriminators import PhaseDiscriminator

TRACKINGS: Final = ("coherent", "noncoherent")
LEAST_DBHZ, MOST_DBHZ, DB_STEP = -10.0, 70.0, 0.02  # of the table; a C/N0 beyond it counts as its end
# columns of the table: signal ratio of the integration, metres (m/s) by output, variance of the observation
RATIO, RANGE_BY_OUTPUT, RANGE_VARIANCE, RATE_BY_OUTPUT, RATE_VARIANCE = range(5)
CODE_BY_OUTPUT, CODE_VARIANCE = 5, 6  # of the code's range beside a phase
N_TABLE: Final = 7
# what is seen of a channel in an integration
SEEN_RANGE, SEEN_RATE, SEEN_POWER, SEEN_CODE, SEEN_ANGLE = range(5)
N_SEEN: Final = 5
OFFSET_RANGE, OFFSET_RATE, OFFSET_CODE = range(3)
# normal numbers for each channel and integration: phase, no phase, phase and code
N_NOISE: Final = (2, 12, 6)


_Q, _ATAN, _ATAN2 = (PHASE_KINDS.index(kind) for kind in ("q", "atan", "atan2"))


class ChannelConstants(NamedTuple):
    """Constants common to all channels over an integration."""

    coherent: bool
    step_s: float
    radians_per_m: float
    chip_m: float
    kinds: Int64  # (3,) of the phase, frequency and delay discriminator
    offsets: Float64  # (3,) delays of early, prompt, late [chips]
    noise_factor: Float64  # (3, 3) of their noise
    table: Float64  # (levels, 7) of C/N0 from the least on
    with_code: bool = False  # besides the phase


def levels_of(cn0_dbhz: npt.ArrayLike) -> Int64:
    """Return the table's rows of C/N0 [dBHz]."""
    level = np.rint((np.nan_to_num(np.asarray(cn0_dbhz, float), nan=LEAST_DBHZ) - LEAST_DBHZ) / DB_STEP)
    return np.asarray(np.clip(level, 0, _levels() - 1), np.int64)


def _levels() -> int:
    return round((MOST_DBHZ - LEAST_DBHZ) / DB_STEP) + 1


def noise_count(channels: ChannelConstants) -> int:
    """Return the number of normal random numbers per channel and integration."""
    return N_NOISE[2] if channels.with_code else N_NOISE[0] if channels.coherent else N_NOISE[1]


def channels_of(
    tracking: str,
    step_s: float,
    carrier_hz: float,
    chip_hz: float,
    *,
    phase_kind: str = "iq",
    spacing_chips: float = 1.0,
    frequency_kind: str = "cross",
    delay_kind: str | None = None,
) -> ChannelConstants:
    """Return channels that integrate for ``step_s`` at a time.

    ``delay_kind`` None is the product I (L - E) beside a phase, else the power.

    Raises
    ------
    ConfigError : an unknown tracking or discriminator, numbers that no signal has, or a spacing without a slope
    """
    require_known(tracking, TRACKINGS, "tracking", "kind of tracking")
    require_known(phase_kind, PHASE_KINDS, "phase_kind", "phase discriminator")
    require_known(frequency_kind, FREQUENCY_KINDS[1:], "frequency_kind", "frequency discriminator")
    delay_kind = delay_kind or ("product" if tracking == "coherent" else "power")
    require_known(delay_kind, DELAY_KINDS, "delay_kind", "delay discriminator")
    require_positive("give hertz", carrier_hz=carrier_hz, chip_hz=chip_hz)
    correlators = Correlators(spacing_chips)
    noise_factor = correlators.noise_factor()
    if DelayDiscriminator(delay_kind, correlators).slope(1.0) == 0.0:
        raise ConfigError(
            f"the delay discriminator '{delay_kind}' has no slope with a spacing of {spacing_chips:g} chips",
            key="spacing_chips",
            advice="give less: early and late must both see the peak",
        )
    k, chip_m, coherent = 2.0 * math.pi * carrier_hz / C_MPS, C_MPS / chip_hz, tracking == "coherent"
    kinds = (
        PHASE_KINDS.index(phase_kind),
        FREQUENCY_KINDS.index(frequency_kind),
        DELAY_KINDS.index(delay_kind),
    )
    return ChannelConstants(
        coherent,
        step_s,
        k,
        chip_m,
        np.array(kinds, np.int64),
        correlators.offsets,
        noise_factor,
        observation_table(coherent, step_s, k, chip_m, kinds, correlators).copy(),
    )


@lru_cache(maxsize=8)
def observation_table(
    coherent: bool,
    step_s: float,
    radians_per_m: float,
    chip_m: float,
    kinds: tuple[int, int, int],
    correlators: Correlators,
) -> Float64:
    """Return the table of slopes and variances, (levels, 7); C/N0 from -10 to 70 dBHz. Copy it to change it.

    Equation: y = u / (slope k), variance var(u) / (slope k)^2; k [rad/m] of the phase and the frequency, 1 / chip of
    the delay
    """
    step, k = step_s, radians_per_m
    cn0 = LEAST_DBHZ + DB_STEP * np.arange(_levels())
    a = np.array([signal_ratio(x, step) for x in cn0])
    table = np.zeros((len(a), N_TABLE))
    table[:, RATIO] = a
    delay = DelayDiscriminator(DELAY_KINDS[kinds[2]], correlators)
    delay_slope = np.array([delay.slope(x) for x in a]) / chip_m
    delay_variance = np.array([float(delay.variance(0.0, x)) for x in a])
    if coherent:
        table[:, CODE_BY_OUTPUT], table[:, CODE_VARIANCE] = 1.0 / delay_slope, delay_variance / delay_slope**2
        phase = PhaseDiscriminator(PHASE_KINDS[kinds[0]])
        slope = -k * np.array([phase.slope(x) for x in a])
        variance = np.array([float(phase.variance(0.0, x)) for x in a])
    else:
        slope, variance = delay_slope, delay_variance
        frequency = FrequencyDiscriminator(FREQUENCY_KINDS[kinds[1]], 0.5 * step)
        # the kernel's angles are not divided by the time between both halves
        scale = 1.0 if FREQUENCY_KINDS[kinds[1]] == "cross" else 0.5 * step
        rate_slope = -k * scale * np.array([frequency.slope(0.5 * x) for x in a])
        rate_variance = scale**2 * np.array([float(frequency.variance(0.0, 0.5 * x)) for x in a])
        table[:, RATE_BY_OUTPUT] = 1.0 / rate_slope
        table[:, RATE_VARIANCE] = rate_variance / rate_slope**2
    table[:, RANGE_BY_OUTPUT] = 1.0 / slope
    table[:, RANGE_VARIANCE] = variance / slope**2
    return table


@kernel
def correlate(
    channels: ChannelConstants, r: int, delay: float, carrier: complex, sigma: float, noise: Float64
) -> complex:
    """Return the early (0), prompt (1) or late (2) correlator.

    Parameters
    ----------
    delay : truth minus replica [chips]
    carrier : the replica's mean over the integration where the code matches
    sigma : of the noise
    noise : (>= 6,) independent normal numbers, the same for all three
    """
    Z = triangle_at(delay - channels.offsets[r]) * carrier
    for s in range(3):
        Z += sigma * channels.noise_factor[r, s] * complex(noise[s], noise[3 + s])
    return Z


@kernel(inline=True)
def is_of_pilot(channels: ChannelConstants) -> bool:
    """Return whether the phase discriminator is sensitive to the sign of data: its stable points are a cycle apart."""
    kind = channels.kinds[0]
    return bool(kind == _Q or kind == _ATAN2)


@kernel(inline=True)
def angle_range(channels: ChannelConstants, prompt: complex) -> float:
    """Return the range of the prompt's angle, linear between the neighbours of its stable point [m].

    Where the phase discriminator is that of a pilot (Q, atan2) the angle of (I, Q), else that of the line through it.
    """
    return -phase_output(_ATAN2 if is_of_pilot(channels) else _ATAN, prompt) / channels.radians_per_m


@kernel(apart=True)
def observe_channel(
    channels: ChannelConstants, arriving: int, told: int, offset: Float64, noise: Float64, seen: Float64
) -> None:
    """Write the observations of one channel over one integration.

    Parameters
    ----------
    arriving, told : the table's rows of the true C/N0 and of the one the receiver takes it for; below zero: no signal,
        and a receiver that looks for none
    offset : (3,) truth minus replica in the middle: range [m] and range rate [m/s]; range of the code beside a phase
    noise : (2,), (12,) or (6,) independent normal numbers
    seen : (5,) observed range and rate, the prompt replica's power, the code's range beside a phase, and the range of
        the prompt's angle of a phase, out
    """
    # the front end keeps the noise level: correlators are scaled as if the assumed C/N0 were the true one
    scale = channels.table[max(told, 0), RATIO]
    a = math.sqrt(scale * channels.table[arriving, RATIO]) if arriving >= 0 else 0.0
    sigma = math.sqrt(scale)
    turn = -channels.radians_per_m * offset[1] * channels.step_s
    seen[SEEN_CODE] = 0.0
    if channels.with_code:
        delay = offset[2] / channels.chip_m
        carrier = carrier_mean(a, -channels.radians_per_m * offset[0], turn)
        early = correlate(channels, 0, delay, carrier, sigma, noise)
        prompt = correlate(channels, 1, delay, carrier, sigma, noise)
        late = correlate(channels, 2, delay, carrier, sigma, noise)
        seen[SEEN_RANGE] = phase_output(channels.kinds[0], prompt) * channels.table[told, RANGE_BY_OUTPUT]
        split = delay_output(channels.kinds[2], early, prompt, late)
        seen[SEEN_CODE] = split * channels.table[told, CODE_BY_OUTPUT]
        seen[SEEN_RATE] = 0.0
        seen[SEEN_ANGLE] = angle_range(channels, prompt)
        seen[SEEN_POWER] = prompt.real * prompt.real + prompt.imag * prompt.imag
    elif channels.coherent:
        Z = carrier_mean(a, -channels.radians_per_m * offset[0], turn)
        Z += sigma * complex(noise[0], noise[1])
        seen[SEEN_RANGE] = phase_output(channels.kinds[0], Z) * channels.table[told, RANGE_BY_OUTPUT]
        seen[SEEN_RATE] = 0.0
        seen[SEEN_ANGLE] = angle_range(channels, Z)
        seen[SEEN_POWER] = Z.real * Z.real + Z.imag * Z.imag
    else:
        delay = offset[0] / channels.chip_m
        # both halves, whose middles stand a quarter before and after
        half, turned = math.sqrt(0.5) * sigma, 0.5 * turn
        before = carrier_mean(0.5 * a, -0.25 * turn, turned)
        after = carrier_mean(0.5 * a, 0.25 * turn, turned)
        early = correlate(channels, 0, delay, before, half, noise)
        early += correlate(channels, 0, delay, after, half, noise[6:])
        first = correlate(channels, 1, delay, before, half, noise)
        second = correlate(channels, 1, delay, after, half, noise[6:])
        late = correlate(channels, 2, delay, before, half, noise)
        late += correlate(channels, 2, delay, after, half, noise[6:])
        prompt = first + second
        rate = frequency_output(channels.kinds[1], first, second)
        seen[SEEN_RATE] = rate * channels.table[told, RATE_BY_OUTPUT]
        split = delay_output(channels.kinds[2], early, prompt, late)
        seen[SEEN_RANGE] = split * channels.table[told, RANGE_BY_OUTPUT]
        seen[SEEN_POWER] = prompt.real * prompt.real + prompt.imag * prompt.imag


@kernel
def observe_channels(
    channels: ChannelConstants, arriving: Int64, told: Int64, offsets: Float64, noise: Float64, seen: Float64
) -> None:
    """Write the observations of n channels, each over its own integration: ``observe_channel`` for arrays."""
    for c in range(len(arriving)):
        observe_channel(channels, arriving[c], told[c], offsets[c], noise[c], seen[c])
