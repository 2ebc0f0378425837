"""Sample calls of the kernels in ``insgnss.simulation``."""

from __future__ import annotations

import numpy as np

from tests.kernels import KernelCase

_R_E = np.array([[2_762_000.0, 1_615_000.0, 5_498_000.0], [1.0, 0.0, 6_366_752.0]])
_LEVEL = np.zeros((4, 3, 3))
_LEVEL[0] = np.eye(3)  # on the equator of the z axis: forward, right, down need only be orthogonal here
_KLOBUCHAR = np.array([1.1e-8, 1.5e-8, -6e-8, -6e-8, 9e4, 1.6e4, -2e5, -6.6e4])
_GEODETIC = np.array([[1.0, 0.5, 300.0], [0.2, -1.0, 20.0]])
_ANGLES = np.array([[0.3, 2.0, -1.0], [0.1, 0.2, 3.0]])


def _way() -> tuple[np.ndarray, ...]:
    t = np.arange(7.0)
    return 60.0 + t, 3.0 * np.cos(t), 2.0 * np.sin(t), 0.05 * np.cos(t)


def _sky(quadrature: int) -> tuple[np.ndarray, ...]:
    """Return two milliseconds of two signals, one of them hidden in the second, and their samples."""
    rng = np.random.default_rng(4)
    code = np.stack([rng.uniform(0.0, 2000.0, (2, 2)), np.full((2, 2), 5.1)], axis=-1)
    cycles = np.stack([rng.uniform(0.0, 1.0, (2, 2)), rng.uniform(0.0, 0.2, (2, 2))], axis=-1)
    chips, signs = (1 - 2 * rng.integers(0, 2, shape).astype(np.int8) for shape in ((2, 31), (90, 2)))
    amplitude = np.array([[0.3, 0.4], [0.3, 0.0]])
    return np.array([0, 200, 400]), amplitude, chips, signs, code, cycles, np.zeros(400), np.zeros(quadrature)


def _first_rows() -> np.ndarray:
    r_e = np.zeros((4, 3))
    r_e[0] = _R_E[0]
    return r_e


CASES = [
    KernelCase("insgnss.simulation.signal_samples:add_sky", _sky(0), label="real"),
    KernelCase("insgnss.simulation.signal_samples:add_sky", _sky(400), label="complex"),
    KernelCase("insgnss.simulation.trajectory:gravity_along", (_R_E, np.zeros((2, 3)))),
    KernelCase("insgnss.simulation.course:lay_over_ellipsoid", (*_way(), 0.1, _first_rows(), _LEVEL)),
    KernelCase(
        "insgnss.simulation.atmosphere:delays_along",
        (
            _KLOBUCHAR,
            _GEODETIC,
            _ANGLES,
            0.2 + np.abs(_ANGLES) / 3.0,
            np.array([4e4, 5e4]),
            1.0,
            np.zeros((2, 3)),
        ),
        rtol=1e-12,
    ),
]
