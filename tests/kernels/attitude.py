"""Sample calls of the kernels in ``insgnss.attitude``."""

from __future__ import annotations

import numpy as np

from insgnss.attitude.aperture import apertures
from insgnss.attitude.baselines import sky_of_angles, triangle
from insgnss.attitude.gyro_attitude import advance
from insgnss.attitude.integer_search import nearest_integers
from insgnss.tables import Float64
from tests.kernels import KernelCase


def aperture_of_attitudes() -> list[Float64]:
    """Return zeros of S-curves at three attitudes."""
    sky = sky_of_angles([30.0, 120.0, 250.0], [15.0, 55.0, 40.0], [0.19, 0.187, 0.24])
    found = apertures([[0.1, 0.2, 0.3], [-2.0, 1.0, 3.0], [0.0, 0.0, 0.0]], triangle(1.0), sky, "yaw")
    return [found.slope, found.below, found.above]


def integers() -> list[Float64]:
    """Return the nearest vectors to a real one whose components hang together."""
    Q = np.array([[6.29, 5.978, 0.544], [5.978, 6.292, 2.34], [0.544, 2.34, 6.288]])
    found = nearest_integers([5.45, 3.1, 2.97], Q, 4)
    near = nearest_integers([5.45, 3.1, 2.97], Q, 9, 1.5)
    return [found.integers.astype(float), found.distance, near.distance]


def turned_by_gyros() -> list[Float64]:
    """Return an attitude after five samples, and how errors of the gyros turn it."""
    q, last, coupling = np.array([0.5, -0.5, 0.5, 0.5]), np.array([0.01, 0.0, -0.02]), np.empty((3, 12))
    w = np.linspace(-2.0, 3.0, 15).reshape(5, 3)
    A = np.eye(3) + 0.01 * np.arange(9.0).reshape(3, 3)
    advance(q, w, np.array([0.1, 0.0, -0.1]), A, 0.01, np.array([1e-4, 0.0, 2e-4]), last, coupling)
    return [q, last, coupling]


CASES = [
    KernelCase("tests.kernels.attitude:integers"),
    KernelCase("tests.kernels.attitude:turned_by_gyros"),
    # a bisection to the rounding of the curve at its zero
    KernelCase("tests.kernels.attitude:aperture_of_attitudes", rtol=1e-11),
]
