"""The integer vectors nearest to a real one in the metric of its covariance: LAMBDA, decorrelation and search.

P. J. G. Teunissen (1995), The least-squares ambiguity decorrelation adjustment, J. Geodesy 70; the search shrinks its
ellipsoid as in X.-W. Chang, X. Yang, T. Zhou (2005), MLAMBDA, J. Geodesy 79.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.errors import ConfigError
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64, Int64


class Candidates(NamedTuple):
    """The nearest integer vectors, the nearest first."""

    integers: Int64  # (count, n)
    distance: Float64  # (count,) (z - a)^T Q^-1 (z - a)


@kernel
def factorise(Q: Float64, L: Float64, D: Float64) -> None:
    """Write unit lower triangular ``L`` (n, n) and ``D`` (n,) with Q = L^T diag(D) L."""
    n = D.size
    for i in range(n - 1, -1, -1):
        D[i] = Q[i, i]
        for k in range(i + 1, n):
            D[i] -= L[k, i] * L[k, i] * D[k]
        for j in range(i):
            rest = Q[i, j]
            for k in range(i + 1, n):
                rest -= L[k, i] * L[k, j] * D[k]
            L[i, j] = rest / D[i]
        L[i, i] = 1.0


@kernel
def decorrelate(L: Float64, D: Float64, Z: Float64) -> None:
    """Make ``L`` nearly diagonal and ``D`` nearly sorted by integer steps, gathered in ``Z`` (n, n), starting at I.

    The transformed vector is Z^T a. Neighbours change places where that lowers the later one's conditional variance.
    """
    n = D.size
    j = n - 2
    while j >= 0:
        for i in range(j + 1, n):
            whole = math.floor(L[i, j] + 0.5)
            if whole != 0.0:
                for k in range(i, n):
                    L[k, j] -= whole * L[k, i]
                for k in range(n):
                    Z[k, j] -= whole * Z[k, i]
        slope = L[j + 1, j]
        together = D[j] + slope * slope * D[j + 1]
        if together < (1.0 - 1e-10) * D[j + 1]:
            share, turned = D[j] / together, D[j + 1] * slope / together
            D[j], D[j + 1] = share * D[j + 1], together
            for k in range(j):
                upper, lower = L[j, k], L[j + 1, k]
                L[j, k] = lower - slope * upper
                L[j + 1, k] = share * upper + turned * lower
            L[j + 1, j] = turned
            for k in range(j + 2, n):
                L[k, j], L[k, j + 1] = L[k, j + 1], L[k, j]
            for k in range(n):
                Z[k, j], Z[k, j + 1] = Z[k, j + 1], Z[k, j]
            j = min(j + 1, n - 2)
        else:
            j -= 1


@kernel
def search(L: Float64, D: Float64, a: Float64, limit: float, integers: Float64, distance: Float64) -> int:
    """Write the nearest integer vectors to ``a`` (n,) and their squared distances, in no order; return how many.

    Depth first from the last component; each level walks outward from its conditional mean, and the worst of the
    vectors found so far bounds the rest.

    Parameters
    ----------
    L, D : Q = L^T diag(D) L
    limit : squared distance at which the search ends
    integers : (count, n) result
    distance : (count,) result
    """
    n, count = a.size, distance.size
    mean, z, stride, spent = np.empty(n), np.empty(n), np.empty(n), np.zeros(n + 1)
    n_vectors, worst, bound = 0, 0, limit
    k, is_new = n - 1, True
    while True:
        if is_new:
            mean[k] = a[k]
            for i in range(k + 1, n):
                mean[k] += (z[i] - mean[i]) * L[i, k]
            z[k] = math.floor(mean[k] + 0.5)
            stride[k] = 1.0 if mean[k] >= z[k] else -1.0
        else:
            z[k] += stride[k]
            stride[k] = -stride[k] - math.copysign(1.0, stride[k])
        away = z[k] - mean[k]
        total = spent[k + 1] + away * away / D[k]
        if not total < bound:
            k += 1
            if k == n:
                return n_vectors
            is_new = False
            continue
        if k > 0:
            spent[k] = total
            k -= 1
            is_new = True
            continue
        place = n_vectors if n_vectors < count else worst
        integers[place] = z
        distance[place] = total
        n_vectors = min(n_vectors + 1, count)
        if n_vectors == count:
            worst = int(np.argmax(distance))
            bound = distance[worst]
        is_new = False


def nearest_integers(
    a: npt.ArrayLike, Q: npt.ArrayLike, count: int = 2, limit: float = math.inf
) -> Candidates:
    """Return the ``count`` integer vectors with the smallest (z - a)^T Q^-1 (z - a), the nearest first.

    Parameters
    ----------
    a : (n,) real-valued estimates
    Q : (n, n) their covariance
    limit : of the distance; there may be fewer vectors below it

    Raises
    ------
    ConfigError : the covariance is not positive definite, or a value is not finite
    """
    real, Q = np.asarray(a, np.float64), np.asarray(Q, np.float64)
    n = real.size
    if Q.shape != (n, n) or n < 1 or count < 1 or not (np.isfinite(Q).all() and np.isfinite(real).all()):
        raise ConfigError(
            "ambiguities need (n,) and (n, n) finite numbers", key="a", advice="check the phases"
        )
    L, D, Z = np.zeros((n, n)), np.zeros(n), np.eye(n)
    factorise(np.ascontiguousarray(0.5 * (Q + Q.T)), L, D)
    if not ((D > 0.0) & np.isfinite(D)).all():
        raise ConfigError(
            "the covariance of the ambiguities is not positive definite",
            key="Q",
            advice="give codes or a guess of the attitude with standard deviations above zero",
        )
    decorrelate(L, D, Z)
    whole = np.floor(real)  # large ambiguities cost digits: only the rest is transformed
    integers, distance = np.empty((count, n)), np.empty(count)
    n_vectors = search(L, D, np.ascontiguousarray(Z.T @ (real - whole)), limit, integers, distance)
    order = np.argsort(distance[:n_vectors], kind="stable")
    back = np.rint(np.linalg.solve(Z.T, integers[order].T).T) + whole
    return Candidates(back.astype(np.int64), distance[order])
