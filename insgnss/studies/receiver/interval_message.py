"""What the observations of one interval alone say of a channel's range and rate at its end, compiled.

In an interval of n integrations a channel sees ``z_k = e_k + noise``, e = [range, rate] of the truth less the path that
the second stage had predicted; the corrections that the channel's own filter makes to its replica are known and taken
off. Along the path ``e_k = A^(k-n) e_n``, A = [[1, T], [0, 1]], so that weighted least squares gives

    C = (sum A_k^T H^T R^-1 H A_k)^-1,    e_n = C sum A_k^T H^T R^-1 z_k          [receiver with two filters]

The estimate at the interval's begin does not enter, so its errors are independent of those of other intervals: a second
stage that takes it as white noise counts nothing twice.
An acceleration that no inertial sample shows, in a gap of them, is added to C on its way (``widen_message``).
Neglects: the oscillator's and the inertial system's noise within the interval, with it what an attitude that a gap has
left unsure does to the acceleration: after 0.1 s at 5 g NEES is 10 to 18 for a second (phases, 40 dBHz, 100 ms).
The oscillator's is one error of all channels: with phases at 40 dBHz and S = 100 rad^2/s^3 the drift's squared error is
6.4 of its variance for intervals of 100 ms, 1.4 for 40 ms and 1.04 for 20 ms; velocity and attitude do not feel it
(1.07 for all).
"""

from __future__ import annotations

from insgnss.kernels.jit import kernel
from insgnss.tables import Float64
from insgnss.tracking.vector_loop import SEEN_RANGE, SEEN_RATE


@kernel(inline=True)
def carry_message(s: Float64, dt: float) -> None:
    """Carry the sums over an integration: L <- A^-T L A^-1, b <- A^-T b; s = [L00, L01, L11, b0, b1]."""
    s[2] += dt * (dt * s[0] - 2.0 * s[1])
    s[1] -= dt * s[0]
    s[4] -= dt * s[3]


@kernel(inline=True)
def widen_message(s: Float64, U: tuple[float, float, float]) -> None:
    """Let the path have moved by an unknown noise of covariance U = [U00, U01, U11].

    Equation: L <- (I + L U)^-1 L, b <- (I + L U)^-1 b: the information of L^-1 + U about the same estimate
    """
    a, b = 1.0 + s[0] * U[0] + s[1] * U[1], s[0] * U[1] + s[1] * U[2]
    c, d = s[1] * U[0] + s[2] * U[1], 1.0 + s[1] * U[1] + s[2] * U[2]
    share = 1.0 / (a * d - b * c)
    s[0], s[1], s[2] = (
        share * (d * s[0] - b * s[1]),
        share * (d * s[1] - b * s[2]),
        share * (a * s[2] - c * s[1]),
    )
    s[3], s[4] = share * (d * s[3] - b * s[4]), share * (a * s[4] - c * s[3])


@kernel(inline=True)
def add_observation(
    s: Float64, replica: Float64, path: Float64, seen: Float64, variances: tuple[float, float]
) -> None:
    """Add an observation: offsets seen at the ``replica`` (>= 2,), as offsets from the ``path`` (2,)."""
    weight = 1.0 / variances[0]
    s[0] += weight
    s[3] += weight * (seen[SEEN_RANGE] + (replica[0] - path[0]))
    if variances[1] > 0.0:
        weight = 1.0 / variances[1]
        s[2] += weight
        s[4] += weight * (seen[SEEN_RATE] + (replica[1] - path[1]))


@kernel(inline=True)
def solve_message(s: Float64) -> tuple[tuple[float, float], tuple[float, float, float]]:
    """Return range and rate offset, and their covariance; variances of 0 if the interval does not observe both."""
    determinant = s[0] * s[2] - s[1] * s[1]
    if not determinant > 1e-12 * s[0] * s[2]:
        return (0.0, 0.0), (0.0, 0.0, 0.0)
    C = s[2] / determinant, -s[1] / determinant, s[0] / determinant
    return (C[0] * s[3] + C[1] * s[4], C[1] * s[3] + C[2] * s[4]), C
