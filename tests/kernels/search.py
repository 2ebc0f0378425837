"""Sample calls of the kernels of the search supervisor in ``insgnss.antenna``."""

from __future__ import annotations

import numpy as np

from insgnss.receiver.tracking_state import Rules, View, new_memory, new_spent
from tests.kernels import KernelCase

_N, _M = 400, 6
_RNG = np.random.default_rng(3)
_SECOND = 1_000_000_000


def _held(values: list[float]) -> np.ndarray:
    """Return values that stay for eight epochs each, (n, m)."""
    return np.repeat(_RNG.choice(values, size=(_N // 8, _M)), 8, axis=0)


_RULES = Rules(
    20.0, 1.0, 0, _SECOND // 5, _SECOND // 2, _SECOND // 2, 2 * _SECOND, 5 * _SECOND, 2, 2, _SECOND
)
_VIEW = View(
    _held([-1, 0, 1, 1, 1, 2, 3]).astype(np.int8),
    _held([40.0, 20.5, 19.5]),
    _held([0, 1, 1]).astype(np.bool_),
    _held([1e6, 3e8]).astype(np.int64),
    _held([-1, 0, 1]).astype(np.int8),
)

# integers alone: the two must be equal
CASES = [
    KernelCase(
        "insgnss.receiver.tracking_rules:advance",
        (
            np.arange(_N, dtype=np.int64) * (_SECOND // 10),
            _VIEW,
            _RULES,
            new_memory(_M),
            new_spent(_M),
            np.zeros((_N, _M), np.int8),
            np.zeros((_N, _M), np.int8),
        ),
        rtol=0.0,
    )
]
