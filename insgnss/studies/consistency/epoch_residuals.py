"""What the rows of an epoch say of their own noise, the state left out: residuals of a fit through its innovations.

The innovations of an epoch share the error of the predicted state, which may be most of them: of range rates it is. A
weighted fit of three coordinates and the clocks takes that out exactly, whatever its covariance; what is left is noise.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import pandas as pd

from insgnss.tables import Float64

_PLACE: Final = 3
_MOST_LEVERAGE: Final = 0.95  # a row that the fit follows says nothing of its noise
_RANK: Final = 1e-9


def fitted(rows: pd.DataFrame) -> tuple[Float64, Float64]:
    """Return the residuals (n,) over their sigma and the leverages (n,) of used rows of one kind, NaN without a say.

    Equation: nu = [u 1] x + v, v ~ (0, diag r); e = nu - [u 1] x_hat has the variance r_i (1 - h_ii), h_ii = r_i^-1
              a_i^T (sum_j a_j a_j^T / r_j)^-1 a_i

    Parameters
    ----------
    rows : time_s clock innovation r u_n u_e u_d; ``clock`` groups rows that may differ by a clock's offset
    """
    n = len(rows)
    if n == 0:
        return np.zeros(0), np.zeros(0)
    _, epoch = np.unique(rows["time_s"].to_numpy(), return_inverse=True)
    _, clock = np.unique(rows["clock"].to_numpy(str), return_inverse=True)
    order = np.argsort(epoch, kind="stable")
    count = np.bincount(epoch)
    place = np.empty(n, np.intp)
    place[order] = np.arange(n) - np.repeat(np.cumsum(count) - count, count)
    width = _PLACE + int(clock.max()) + 1
    A = np.zeros((len(count), int(count.max()), width))
    nu = np.zeros(A.shape[:2])
    sd = np.sqrt(rows["r"].to_numpy())
    A[epoch, place, :_PLACE] = -rows[["u_n", "u_e", "u_d"]].to_numpy() / sd[:, None]
    A[epoch, place, _PLACE + clock] = 1.0 / sd
    nu[epoch, place] = rows["innovation"].to_numpy() / sd
    inverse = np.linalg.pinv(np.einsum("eij,eik->ejk", A, A), rcond=_RANK, hermitian=True)
    x = np.einsum("ejk,eik,ei->ej", inverse, A, nu)
    left = (nu - np.einsum("eij,ej->ei", A, x))[epoch, place]
    leverage = np.einsum("eij,ejk,eik->ei", A, inverse, A)[epoch, place]
    with np.errstate(invalid="ignore", divide="ignore"):
        scaled = np.where(leverage < _MOST_LEVERAGE, left / np.sqrt(1.0 - leverage), np.nan)
    return scaled, np.where(np.isfinite(scaled), leverage, np.nan)
