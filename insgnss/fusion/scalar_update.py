"""One scalar measurement: its predicted variance, and the Joseph update of the covariance and the correction, compiled.

No matrix is inverted anywhere: a measurement is a number, its row ``h`` is non-zero in a few named columns.
"""

from __future__ import annotations

import math

from insgnss.jit import borrowing
from insgnss.tables import Float64, Int64


@borrowing
def predicted_variance(P: Float64, h: Float64, columns: Int64) -> float:
    """Return D = h P h^T of the row ``h`` (>= k,), whose entries stand in ``columns`` (k,) of the (n, n) covariance."""
    total = 0.0
    for a in range(columns.shape[0]):
        row = columns[a]
        part = 0.5 * h[a] * P[row, row]
        for b in range(a):
            part += h[b] * P[row, columns[b]]
        total += 2.0 * h[a] * part
    return total


@borrowing
def scalar_update(
    P: Float64, h: Float64, columns: Int64, innovation: float, variance: float, v: Float64
) -> tuple[float, float]:
    """Correct ``P`` (n, n) and the correction in ``v`` by one scalar; return its innovation and that one's variance.

    Equation: K = P h^T / S, S = h P h^T + r                              [Sokolov & Yurchenko 2015, (9), corrected]
              x += K (z - h x)                                              [(7), (8), corrected: running estimate]
              P = (I - K h) P (I - K h)^T + K r K^T = P - K g^T - g K^T + S K K^T,  g = P h^T   [(10), Joseph form]
    The last form is Joseph's for any gain K, so an error of K enters squared. It is computed as
    P -= K w^T + w K^T with w = g - S K / 2, whose products commute: P stays symmetric bit for bit. Where S is not
    positive and finite, or y no number, nothing is corrected: what is returned tells it.

    Parameters
    ----------
    P : (n, n) covariance, symmetric
    h : (>= k,) non-zero entries of the row
    columns : (k,) where they stand
    innovation : z minus prediction at the prior
    variance : r of the measurement
    v : (>= 3, >= n): v[0] is the correction (truth minus prior estimate as far as known), v[1], v[2] are scratch
    """
    n = P.shape[0]
    for c in range(n):
        v[1, c] = 0.0  # g
    for a in range(columns.shape[0]):
        ha = h[a]
        row = columns[a]
        for c in range(n):
            v[1, c] += ha * P[row, c]
    S = variance
    y = innovation
    for a in range(columns.shape[0]):
        S += h[a] * v[1, columns[a]]
        y -= h[a] * v[0, columns[a]]
    if not (0.0 < S < math.inf and math.isfinite(y)):
        return y, S
    inv_S = 1.0 / S
    for c in range(n):
        gain = v[1, c] * inv_S
        v[0, c] += gain * y
        v[2, c] = v[1, c] - 0.5 * S * gain  # w
        v[1, c] = gain  # K
    for b in range(n):
        gain = v[1, b]
        wb = v[2, b]
        for c in range(n):
            P[b, c] -= gain * v[2, c] + wb * v[1, c]
    return y, S
