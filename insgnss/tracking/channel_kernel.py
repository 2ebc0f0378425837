"""The loops of many channels, epoch by epoch, on correlators drawn without samples."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from insgnss.kernels.jit import kernel
from insgnss.tables import Complex, Float64, Int8, Int64
from insgnss.tracking.discriminator_outputs import delay_output, frequency_output, phase_output

# State of a channel: predicted carrier phase and its derivatives in the middle of the next integration (aiding not in
# the rate), code delay and its rate, and the prompt correlator of the last integration
PHASE, RATE, ACCELERATION, DELAY, DELAY_RATE, BEFORE_I, BEFORE_Q = range(7)
N_STATE: Final = 7
# What is written of each epoch: errors are replica minus truth in the middle of the integration
PHASE_ERROR, RATE_ERROR, DELAY_ERROR, PROMPT_I, PROMPT_Q = range(5)
N_OUT: Final = 5
N_NOISE: Final = 6  # normal numbers per epoch and channel: three of each quadrature


class Truth(NamedTuple):
    """The arriving signals: values at the borders of the integrations, (n + 1, m), or in them, (n, m)."""

    phase_rad: Float64  # (n + 1, m)
    delay_chips: Float64  # (n + 1, m)
    a: Float64  # (n, m) signal ratio 2 q T
    sign: Int8  # (n, m) of the data


class Aid(NamedTuple):
    """The aiding of the loops at the borders of the integrations, (n + 1, m); zeros without aiding."""

    rate_radps: Float64  # taken over into the replica's frequency
    acceleration_radps2: Float64  # added to the loop's own rate


class ChannelGains(NamedTuple):
    """Constants of the loops, the same for all channels."""

    step_s: float
    phase: Float64  # (3,) gains on the phase observation, zeros above the order
    rate: Float64  # (3,) on the frequency observation
    delay: Float64  # (2,) on the delay observation
    kinds: Int64  # (3,) of the phase, frequency and delay discriminator
    slopes: Float64  # (3,) theirs, by which the outputs are divided
    offsets: Float64  # (3,) delays of early, prompt, late [chips]
    noise_factor: Float64  # (3, 3) F with F F^T the correlators' covariance over a
    # delay by carrier phase: minus chip rate over 2 pi carrier; 0 without carrier aiding
    chips_per_radian: float
    a: float  # signal ratio of the C/N0 that the loops are designed for


@kernel(inline=True)
def triangle_at(offset_chips: float) -> float:
    """Return the correlation of an endless random code at an offset [chips]."""
    return max(0.0, 1.0 - abs(offset_chips))


@kernel(inline=True)
def carrier_mean(a: float, phase: float, turn: float) -> complex:
    """Return the mean of a correlator whose code matches; ``phase`` is that in the middle of the integration.

    Equation: a sinc(turn / 2) exp(j phase), turn the angle by which the offset turns within it
    """
    half = 0.5 * turn
    size = a
    if abs(half) > 1e-8:
        size *= math.sin(half) / half
    return complex(size * math.cos(phase), size * math.sin(phase))


@kernel(inline=True)
def correct_and_lead(
    x: Float64,
    Z: Complex,
    gains: ChannelGains,
    slopes: Float64,
    step_s: float,
    aid_rate: float,
    aid_acceleration: float,
) -> None:
    """Correct a channel's state by its discriminators and propagate it to the middle of the next integration.

    Equation: x^ = x~ + L e; phase~_next = phase^ + T (rate^ + y) + T^2/2 (acceleration^ + y'), rate~_next = rate^ +
              T (acceleration^ + y'), with the aiding y, y' at the border between           [(8) of Shatilov 2009]

    Parameters
    ----------
    x : (7,) of the channel, led on
    Z : (3,) early, prompt, late correlators
    slopes : (3,) by which the outputs of the phase, frequency and delay discriminator are divided
    step_s : T, from the middle of this integration to that of the next
    aid_rate, aid_acceleration : y, y' [rad/s], [rad/s^2]
    """
    before = complex(x[BEFORE_I], x[BEFORE_Q])
    e_phase = phase_output(gains.kinds[0], Z[1]) / slopes[0]
    e_rate = 0.0
    if before != 0.0:
        e_rate = frequency_output(gains.kinds[1], before, Z[1]) / slopes[1]
    e_delay = delay_output(gains.kinds[2], Z[0], Z[1], Z[2]) / slopes[2]
    step_phase = gains.phase[0] * e_phase + gains.rate[0] * e_rate
    x[RATE] += gains.phase[1] * e_phase + gains.rate[1] * e_rate
    x[ACCELERATION] += gains.phase[2] * e_phase + gains.rate[2] * e_rate
    x[DELAY_RATE] += gains.delay[1] * e_delay
    acceleration = x[ACCELERATION] + aid_acceleration
    led = step_s * (x[RATE] + aid_rate) + 0.5 * step_s * step_s * acceleration
    x[PHASE] += step_phase + led
    x[RATE] += step_s * acceleration
    x[DELAY] += gains.delay[0] * e_delay + step_s * x[DELAY_RATE] + gains.chips_per_radian * led
    # as the corrected replica would have seen it: the next pair then turns by T times the offset of the rate
    turned = complex(math.cos(step_phase), -math.sin(step_phase)) * Z[1]
    x[BEFORE_I], x[BEFORE_Q] = turned.real, turned.imag


@kernel
def run_channels(
    truth: Truth, aid: Aid, gains: ChannelGains, noise: Float64, state: Float64, Z: Complex, out: Float64
) -> None:
    """Run all channels over a block of integrations.

    Equation: E Z = sqrt(a a_d), variance a_d, a_d the design's ratio: an amplifier holds the noise level, so that the
    amplitude alone follows C/N0 and the slope of a product of two correlators goes with a / a_d
    Neglects: the phase's curvature within an integration, T^2/12 of the acceleration's offset.

    Parameters
    ----------
    truth, aid, gains : of n integrations and m channels
    noise : (n, m, 6) independent normal numbers
    state : (m, 7) of the loops, led on
    Z : (3,) room for the correlators
    out : (n, m, 5) errors and prompt correlators
    """
    T = gains.step_s
    for k in range(out.shape[0]):
        for c in range(out.shape[1]):
            x = state[c]
            rate = x[RATE] + 0.5 * (aid.rate_radps[k, c] + aid.rate_radps[k + 1, c])
            # offsets, received minus replica, in the middle of the integration
            phase = 0.5 * (truth.phase_rad[k, c] + truth.phase_rad[k + 1, c]) - x[PHASE]
            turn = truth.phase_rad[k + 1, c] - truth.phase_rad[k, c] - T * rate
            delay = 0.5 * (truth.delay_chips[k, c] + truth.delay_chips[k + 1, c]) - x[DELAY]
            a, sigma = math.sqrt(gains.a * truth.a[k, c]), math.sqrt(gains.a)
            matched = truth.sign[k, c] * carrier_mean(a, phase, turn)
            for r in range(3):
                i = q = 0.0
                for s in range(3):
                    i += gains.noise_factor[r, s] * noise[k, c, s]
                    q += gains.noise_factor[r, s] * noise[k, c, 3 + s]
                Z[r] = matched * triangle_at(delay - gains.offsets[r]) + sigma * complex(i, q)
            out[k, c, PHASE_ERROR], out[k, c, RATE_ERROR], out[k, c, DELAY_ERROR] = -phase, -turn / T, -delay
            out[k, c, PROMPT_I], out[k, c, PROMPT_Q] = Z[1].real, Z[1].imag
            correct_and_lead(
                x, Z, gains, gains.slopes, T, aid.rate_radps[k + 1, c], aid.acceleration_radps2[k + 1, c]
            )
