"""Sample calls of the kernels in ``insgnss.antenna``."""

from __future__ import annotations

from typing import Any

import numpy as np

from insgnss.antenna.gain_pattern import GainTable, gain_at, pattern_of
from insgnss.antenna.installation import Installation, clearance_at
from insgnss.antenna.visibility import (
    HIDE,
    VisibilityLimits,
    attitude_covariance,
    look_at_all,
    new_looks,
    variance_along,
)
from tests.kernels import KernelCase

_TABLE = GainTable(
    "two lobes",
    1575.42e6,
    "RHCP",
    "test",
    np.array([-90.0, 0.0, 30.0, 90.0]),
    np.array([0.0, 90.0, 180.0, 270.0]),
    np.array([[-20.0] * 4, [-5.0, -4.0, -6.0, -7.0], [0.0, 1.0, -1.0, 0.5], [5.0] * 4]),
)


def installation() -> Installation:
    """Return two antennas, one on top and one below turned over, the first with a tail behind it."""
    clearance = np.full((2, 180, 360), 127, np.int8)
    clearance[0, :110, 170:190] = -3
    over = np.diag([1.0, -1.0, -1.0])
    return Installation(
        pattern_of([_TABLE, _TABLE]),
        np.stack([np.eye(3), over]),
        np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]),
        clearance,
        np.array([True, False]),
    )


def gains() -> list[Any]:
    """Return gains and clearances towards a pole, the seam, behind and between."""
    antennas = installation()
    found: list[Any] = []
    for u in ((0.0, 0.0, -1.0), (0.8, -1e-9, -0.6), (-0.8, 0.0, 0.6), (0.48, 0.64, -0.6)):
        found += [gain_at(antennas.pattern, 1, *u), clearance_at(antennas.clearance_deg, 0, *u)]
    return found


def covariances() -> list[Any]:
    """Return a covariance turned into the body, and the variance along one direction."""
    P = np.arange(36.0).reshape(6, 6)
    C = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
    P_b = np.zeros((3, 3))
    attitude_covariance(P + P.T, 2, C, P_b)
    return [P_b, variance_along(P_b, 0.6, 0.0, 0.8)]


def decisions() -> list[np.ndarray]:
    """Return all decisions over a roll of the vehicle: seen, hidden, uncertain, waiting, without a direction."""
    n = 9
    C_nb = np.zeros((n, 3, 3))
    for t, roll in enumerate(np.linspace(0.0, 2.0 * np.pi, n)):
        c, s = np.cos(roll), np.sin(roll)
        C_nb[t] = [[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]
    P_b = np.repeat(np.diag([1e-4, 1e-4, 1e-3])[None], n, axis=0)
    P_b[0] *= 1e4
    u_n = np.array([[0.6, 0.0, -0.8], [-0.96, 0.0, -0.28], [0.0, 0.8, -0.6], [np.nan] * 3])
    out = new_looks(n, 4)
    limits = VisibilityLimits(-2.0, 1.0, 3.0, 0.01)
    look_at_all(C_nb, P_b, np.repeat(u_n[None], n, axis=0), installation(), limits, out)
    hide = new_looks(n, 4, with_doubt=True)
    look_at_all(
        C_nb, P_b, np.repeat(u_n[None], n, axis=0), installation(), limits._replace(uncertain=HIDE), hide
    )
    return [*out, *hide]


CASES = [
    KernelCase("tests.kernels.antenna:gains"),
    KernelCase("tests.kernels.antenna:covariances"),
    KernelCase("tests.kernels.antenna:decisions"),
]
