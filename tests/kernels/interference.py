"""Sample calls of the kernels in ``insgnss.interference``."""

from __future__ import annotations

import numpy as np

from insgnss.interference.discriminators import DISCRIMINATORS
from insgnss.interference.lock_thresholds import count_slips, slip_loop
from tests.kernels import KernelCase


def slips() -> list[np.ndarray]:
    """Return slips, errors and their squares of every discriminator's loop, in noise that makes some of them slip."""
    draws = np.random.default_rng(4).standard_normal((3, 120, 4))
    found: list[np.ndarray] = []
    for kind in DISCRIMINATORS:
        state, count, squares = np.zeros((3, 2)), np.zeros(3, np.int64), np.zeros(3)
        count_slips(slip_loop(kind, 0.2, 0.2), draws, state, count, squares)
        found += [state, count, squares]
    return found


# An error is a sum over all periods since the last slip, so rounding of sin and cos adds up
CASES = [KernelCase("tests.kernels.interference:slips", rtol=1e-9)]
