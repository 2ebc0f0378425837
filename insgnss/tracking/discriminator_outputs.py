"""What discriminators compute from correlators: one place for the formulas, compiled, for loops and for studies.

Kinds are numbers here; the modules of the delay, phase and frequency discriminators name them.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from insgnss.kernels.jit import kernel
from insgnss.tables import Complex, Float64

DELAY_KINDS: Final = ("product", "sign", "tanh", "power", "dot")
PHASE_KINDS: Final = ("q", "iq", "sign", "atan", "atan2")
FREQUENCY_KINDS: Final = ("none", "cross", "atan", "atan2")
_DELAY, _PHASE = 0, 1


@kernel(inline=True)
def delay_output(kind: int, early: complex, prompt: complex, late: complex) -> float:
    """Return a delay discriminator's output.

    Equation: product I (I_L - I_E), sign sign(I) (I_L - I_E), tanh th(I) (I_L - I_E)        [(1.11), (1.12), (1.9)]
              power |L|^2 - |E|^2, dot Re(P* (L - E))                          [Kaplan & Hegarty 2017, table 8.4]
    """
    split = late - early
    if kind == 0:
        return prompt.real * split.real
    if kind == 1:
        return math.copysign(1.0, prompt.real) * split.real
    if kind == 2:
        return math.tanh(prompt.real) * split.real
    if kind == 3:
        return (late.real**2 + late.imag**2) - (early.real**2 + early.imag**2)
    return prompt.real * split.real + prompt.imag * split.imag


@kernel(inline=True)
def phase_output(kind: int, prompt: complex) -> float:
    """Return a phase discriminator's output.

    Equation: Q, I Q (2.8), sign(I) Q, atan(Q / I), atan2(Q, I)
    """
    i, q = prompt.real, prompt.imag
    if kind == 0:
        return q
    if kind == 1:
        return i * q
    if kind == 2:
        return math.copysign(1.0, i) * q
    if kind == 3:
        return math.atan2(math.copysign(1.0, i) * q, abs(i))
    return math.atan2(q, i)


@kernel(inline=True)
def frequency_output(kind: int, before: complex, prompt: complex) -> float:
    """Return a frequency discriminator's output, of two integrations that follow each other.

    Equation: cross Im(Z1* Z2), atan(cross / dot), atan2(cross, dot); 0 for none
    """
    cross = before.real * prompt.imag - before.imag * prompt.real
    dot = before.real * prompt.real + before.imag * prompt.imag
    if kind == 0:
        return 0.0
    if kind == 1:
        return cross
    if kind == 2:
        return math.atan2(math.copysign(1.0, dot) * cross, abs(dot))
    return math.atan2(cross, dot)


@kernel
def fill_outputs(family: int, kind: int, Z: Complex, out: Float64) -> None:
    """Write the output of each row of correlators.

    Parameters
    ----------
    family : 0 delay, 1 phase, 2 frequency
    kind : place in the family's list
    Z : (n, 3) early, prompt, late; (n, 1) prompt; (n, 2) the one before and prompt
    out : (n,)
    """
    for k in range(Z.shape[0]):
        if family == _DELAY:
            out[k] = delay_output(kind, Z[k, 0], Z[k, 1], Z[k, 2])
        elif family == _PHASE:
            out[k] = phase_output(kind, Z[k, 0])
        else:
            out[k] = frequency_output(kind, Z[k, 0], Z[k, 1])


def outputs(family: int, kind: int, Z: Complex) -> Float64:
    """Return the outputs of correlators (..., r), shaped (...)."""
    flat = np.ascontiguousarray(Z, np.complex128).reshape(-1, Z.shape[-1])
    out = np.empty(len(flat))
    fill_outputs(family, kind, flat, out)
    return out.reshape(Z.shape[:-1])
