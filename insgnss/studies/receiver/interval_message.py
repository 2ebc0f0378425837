"""A channel's range and rate at the end of an interval, from the observations of that interval alone; compiled.

In an interval of n integrations a channel sees ``z_k = e_k + noise``, e of the truth less the path that the second
stage had predicted; the corrections that the channel's own filter makes to its replica are known and taken off. With
an inertial system e = [range, rate] and A = [[1, T], [0, 1]]. Without one the acceleration of the path is an estimate
too: e = [range, rate, acceleration], whose last part fades as the motion does (Gauss-Markov). Along the path
``e_k = A^(k-n) e_n``, so that weighted least squares gives

    C = (sum A_k^T H^T R^-1 H A_k)^-1,    e_n = C sum A_k^T H^T R^-1 z_k          [receiver with two filters]

The estimate at the interval's begin does not enter, so its errors are independent of those of other intervals: a second
stage that takes it as white noise counts nothing twice.
An acceleration that no inertial sample shows, in a gap of them, is added to C on its way (``widen_message``).
What oscillator and motion do within the interval is noise of the message, which the filter knows to be that of its own
prediction (``interval_noise``).
Neglects: the noise of the inertial system within the interval; in a gap of its samples, that the motion is one error of
all channels, and what an attitude that the gap has left unsure does to the acceleration.

The sums of a channel are ``s`` (p, p + 1): the matrix L of the p offsets, and beside it the vector b; C = L^-1.
"""

from __future__ import annotations

from insgnss.kernels.jit import kernel
from insgnss.tables import Float64
from insgnss.tracking.vector_loop import SEEN_RANGE, SEEN_RATE

# of the product of the diagonal: a determinant below it leaves one offset open
_SINGULAR = 1e-12


@kernel(inline=True)
def carry_message(s: Float64, back: Float64) -> None:
    """Carry the sums over an integration: L <- B^T L B, b <- B^T b; ``back`` (p, p) is B = A^-1, upper triangular."""
    p = s.shape[0]
    # columns, then rows, the last first: each is the sum of those before it, which have not changed yet
    for j in range(p - 1, -1, -1):
        for i in range(p):
            total = 0.0
            for k in range(j + 1):
                total += s[i, k] * back[k, j]
            s[i, j] = total
    for i in range(p - 1, -1, -1):
        for j in range(p + 1):
            total = 0.0
            for k in range(i + 1):
                total += back[k, i] * s[k, j]
            s[i, j] = total


@kernel(inline=True)
def widen_message(s: Float64, U: tuple[float, float, float]) -> None:
    """Let the path have moved by an unknown noise of covariance U = [U00, U01, U11]; ``s`` is that of two offsets.

    Equation: L <- (I + L U)^-1 L, b <- (I + L U)^-1 b: the information of L^-1 + U about the same estimate
    """
    a, b = 1.0 + s[0, 0] * U[0] + s[0, 1] * U[1], s[0, 0] * U[1] + s[0, 1] * U[2]
    c, d = s[0, 1] * U[0] + s[1, 1] * U[1], 1.0 + s[0, 1] * U[1] + s[1, 1] * U[2]
    share = 1.0 / (a * d - b * c)
    for j in range(3):
        s[0, j], s[1, j] = share * (d * s[0, j] - b * s[1, j]), share * (a * s[1, j] - c * s[0, j])


@kernel(inline=True)
def add_observation(
    s: Float64, replica: Float64, path: Float64, seen: Float64, variances: tuple[float, float]
) -> None:
    """Add an observation: offsets seen at the ``replica`` (>= 2,), as offsets from the ``path`` (2,)."""
    last = s.shape[0]
    weight = 1.0 / variances[0]
    s[0, 0] += weight
    s[0, last] += weight * (seen[SEEN_RANGE] + (replica[0] - path[0]))
    if variances[1] > 0.0:
        weight = 1.0 / variances[1]
        s[1, 1] += weight
        s[1, last] += weight * (seen[SEEN_RATE] + (replica[1] - path[1]))


@kernel(apart=True)
def solve_message(s: Float64, z: Float64, C: Float64) -> bool:
    """Write the offsets ``z`` (p,) and their covariance ``C`` (p, p); return whether the interval observes all of them.

    Equation: C = L^-1 by cofactors, z = C b
    """
    p = s.shape[0]
    if p == 2:
        determinant, scale = s[0, 0] * s[1, 1] - s[0, 1] * s[0, 1], s[0, 0] * s[1, 1]
        C[0, 0], C[0, 1], C[1, 1] = s[1, 1], -s[0, 1], s[0, 0]
    else:
        C[0, 0] = s[1, 1] * s[2, 2] - s[1, 2] * s[1, 2]
        C[0, 1] = s[0, 2] * s[1, 2] - s[0, 1] * s[2, 2]
        C[0, 2] = s[0, 1] * s[1, 2] - s[0, 2] * s[1, 1]
        C[1, 1] = s[0, 0] * s[2, 2] - s[0, 2] * s[0, 2]
        C[1, 2] = s[0, 1] * s[0, 2] - s[0, 0] * s[1, 2]
        C[2, 2] = s[0, 0] * s[1, 1] - s[0, 1] * s[0, 1]
        determinant = s[0, 0] * C[0, 0] + s[0, 1] * C[0, 1] + s[0, 2] * C[0, 2]
        scale = s[0, 0] * s[1, 1] * s[2, 2]
    if not determinant > _SINGULAR * scale:
        return False
    for i in range(p):
        for j in range(i, p):
            C[i, j] /= determinant
            C[j, i] = C[i, j]
    for i in range(p):
        total = 0.0
        for j in range(p):
            total += C[i, j] * s[j, p]
        z[i] = total
    return True
