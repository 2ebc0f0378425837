"""One scalar measurement: its predicted variance, and the update of covariance and correction, compiled.

No matrix is inverted anywhere: a measurement is a number, its row ``h`` is non-zero in a few named columns.
"""

from __future__ import annotations

import math

from insgnss.kernels.jit import kernel
from insgnss.tables import Float64, Int64


@kernel
def predicted_variance(P: Float64, h: Float64, columns: Int64) -> float:
    """Return D = h P h^T of the row ``h`` (>= k,), whose entries are in ``columns`` (k,) of the (n, n) covariance."""
    total = 0.0
    for a in range(columns.shape[0]):
        row = columns[a]
        part = 0.5 * h[a] * P[row, row]
        for b in range(a):
            part += h[b] * P[row, columns[b]]
        total += 2.0 * h[a] * part
    return total


@kernel(inline=True)
def covariance_with(P: Float64, h: Float64, columns: Int64, g: Float64) -> None:
    """Write g = P h^T (>= n,), four rows of the symmetric ``P`` (n, n) in a pass, each of which writes g once.

    The sum goes in the order of the entries: one that is zero changes no bit.
    """
    n, k = P.shape[0], columns.shape[0]
    for c in range(n):
        g[c] = 0.0
    a = 0
    while a + 4 <= k:
        h0, h1, h2, h3 = h[a], h[a + 1], h[a + 2], h[a + 3]
        r0, r1, r2, r3 = columns[a], columns[a + 1], columns[a + 2], columns[a + 3]
        for c in range(n):
            g[c] = g[c] + h0 * P[r0, c] + h1 * P[r1, c] + h2 * P[r2, c] + h3 * P[r3, c]
        a += 4
    while a < k:
        ha, row = h[a], columns[a]
        for c in range(n):
            g[c] += ha * P[row, c]
        a += 1


@kernel
def scalar_update(
    P: Float64, h: Float64, columns: Int64, innovation: float, variance: float, v: Float64
) -> tuple[float, float]:
    """Correct ``P`` (n, n) and the correction in ``v`` by one scalar; return its innovation and that one's variance.

    Equation: K = P h^T / S, S = h P h^T + r                              [Sokolov & Yurchenko 2015, (9), corrected]
              x += K (z - h x)                                              [(7), (8), corrected: running estimate]
              P = (I - K h) P (I - K h)^T + K r K^T = P - s s^T,  s = P h^T / sqrt(S)       [(10), for this very gain]
    One product for each element, and both factors commute: P stays symmetric bit for bit. Where S is not positive and
    finite, or y not a number, nothing is corrected: the return value says so.

    Parameters
    ----------
    P : (n, n) covariance, symmetric
    h : (>= k,) non-zero entries of the row
    columns : (k,) where they stand
    innovation : z minus prediction at the prior
    variance : r of the measurement
    v : (>= 3, >= n): v[0] is the correction (truth minus prior estimate as far as known), v[1] holds the gain K
        afterwards, v[2] is scratch
    """
    n = P.shape[0]
    covariance_with(P, h, columns, v[1])
    S = variance
    y = innovation
    for a in range(columns.shape[0]):
        S += h[a] * v[1, columns[a]]
        y -= h[a] * v[0, columns[a]]
    if not (0.0 < S < math.inf and math.isfinite(y)):
        return y, S
    inv_S, inv_root = 1.0 / S, 1.0 / math.sqrt(S)
    for c in range(n):
        v[2, c] = v[1, c] * inv_root  # s
        v[1, c] *= inv_S  # K
        v[0, c] += v[1, c] * y
    for b in range(n):
        s = v[2, b]
        for c in range(n):
            P[b, c] -= s * v[2, c]
    return y, S
