"""The two loops over samples: a signal added to a buffer, and a buffer correlated with replicas.

Phases are re-anchored every 64 samples and turned by a constant rotation between, so that rounding does not grow.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from insgnss.kernels.jit import kernel
from insgnss.tables import Float64, Int8

_LARGEST_PHASE: Final = 1e15  # [chips]; a double then resolves an eighth of a chip
_ROTATION_BLOCK: Final = 64  # a rotation repeated as often has lost 1e-14; a sine and cosine cost 20 of them


@kernel(inline=True)
def has_places(chip_phase: float, chip_step: float, n: int, length: int) -> bool:
    """Return whether ``n`` samples' code phases [chips] are numbers that resolve a chip of a code of some length.

    A sample is no longer than a period of the code, runs forward, and no phase is so large that its chip is lost.
    """
    return 0.0 <= chip_step <= length and abs(chip_phase) + chip_step * n < _LARGEST_PHASE


class Steps(NamedTuple):
    """Phases of the first sample, and from sample to sample."""

    chip_phase: float  # of the code [chips]
    chip_step: float
    cycle_phase: float  # of the carrier [cycles]
    cycle_step: float


@kernel
def add_signal(
    amplitude: float, chips: Int8, signs: Int8, steps: Steps, in_phase: Float64, quadrature: Float64
) -> None:
    """Add A d h cos(theta), and A d h sin(theta) where a quadrature is wanted, to a buffer.

    Of code phases that ``has_places`` refuses nothing is added.

    Parameters
    ----------
    amplitude : A
    chips : (length,) one period of the code
    signs : (n_periods,) of the data in each period of the code, the first one that of period 0; the last one holds on
    in_phase : (n,) added to
    quadrature : (n,) added to, or (0,) for real samples
    """
    chip_phase, chip_step, cycle_phase, cycle_step = steps
    n, length, is_complex = in_phase.size, chips.size, quadrature.size > 0
    if not has_places(chip_phase, chip_step, n, length) or signs.size == 0:
        return
    turn_c, turn_s = math.cos(2.0 * math.pi * cycle_step), math.sin(2.0 * math.pi * cycle_step)
    for first in range(0, n, _ROTATION_BLOCK):
        angle = 2.0 * math.pi * ((cycle_phase + cycle_step * first) % 1.0)
        c, s = math.cos(angle), math.sin(angle)
        phase = chip_phase + chip_step * first
        period = math.floor(phase / length)
        phase -= period * length
        for k in range(first, min(first + _ROTATION_BLOCK, n)):
            if phase >= length:
                phase -= length
                period += 1
            sign = signs[min(max(int(period), 0), signs.size - 1)]
            value = amplitude * sign * chips[min(int(phase), length - 1)]
            in_phase[k] += value * c
            if is_complex:
                quadrature[k] += value * s
            c, s = c * turn_c - s * turn_s, s * turn_c + c * turn_s
            phase += chip_step


@kernel
def correlate_samples(
    in_phase: Float64,
    quadrature: Float64,
    chips: Int8,
    offsets: Float64,
    steps: Steps,
    out: Float64,
) -> None:
    """Sum a buffer times the replicas: Z = sum x h exp(-j theta), real and imaginary part.

    Of code phases that ``has_places`` refuses, and of a replica a period or more away, the sum is zero.

    Parameters
    ----------
    in_phase, quadrature : (n,) samples; quadrature (0,) for real ones
    chips : (length,) one period of the code
    offsets : (r,) delays of the replicas against the prompt one [chips], each shorter than a period
    steps : of the prompt replica
    out : (r, 2) sums
    """
    chip_phase, chip_step, cycle_phase, cycle_step = steps
    n, length, is_complex = in_phase.size, chips.size, quadrature.size > 0
    turn_c, turn_s = math.cos(2.0 * math.pi * cycle_step), math.sin(2.0 * math.pi * cycle_step)
    out[:] = 0.0
    if not has_places(chip_phase, chip_step, n, length):
        return
    for first in range(0, n, _ROTATION_BLOCK):
        angle = 2.0 * math.pi * ((cycle_phase + cycle_step * first) % 1.0)
        c, s = math.cos(angle), math.sin(angle)
        phase = chip_phase + chip_step * first
        phase -= math.floor(phase / length) * length
        for k in range(first, min(first + _ROTATION_BLOCK, n)):
            x = in_phase[k]
            y = quadrature[k] if is_complex else 0.0
            i, q = x * c + y * s, y * c - x * s
            for r in range(offsets.size):
                chip = phase - offsets[r]
                if not abs(offsets[r]) < length:
                    continue
                if chip >= length:
                    chip -= length
                elif chip < 0.0:
                    chip += length
                h = chips[min(int(chip), length - 1)]
                out[r, 0] += h * i
                out[r, 1] += h * q
            c, s = c * turn_c - s * turn_s, s * turn_c + c * turn_s
            phase += chip_step
            if phase >= length:
                phase -= length
