"""The attitude that turns vectors known in the body into vectors measured in n: Wahba's problem, by singular values.

F. L. Markley (1988), Attitude determination using vector observations and the singular value decomposition.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.errors import GeometryError
from insgnss.tables import Float64

# second singular value over the first, below which the vectors are one line (0.6 deg)
_ONE_LINE: Final = 1e-4


class AttitudeEstimate(NamedTuple):
    """An attitude with the covariance of its error, a rotation vector in n."""

    C_nb: Float64  # (3, 3)
    covariance_n: Float64  # (3, 3) [rad^2]
    loss: float  # sum |v_n - C v_b|^2 / sd^2; chi-square with 3 k - 3 degrees of freedom


def wahba(vectors_n: npt.ArrayLike, vectors_b: npt.ArrayLike, sd: npt.ArrayLike) -> AttitudeEstimate:
    """Return the attitude with the least weighted squares.

    Equation: min sum |v_n - C v_b|^2 / sd^2, C = U diag(1, 1, det U det V) V^T of B = sum v_n v_b^T / sd^2,
    P = (sum (|l|^2 I - l l^T) / sd^2)^-1, l = C v_b
    Neglects: correlation between the vectors and between their components; ``two_stage`` ends with a fit that has both.

    Parameters
    ----------
    vectors_n : (k, 3) measured
    vectors_b : (k, 3) known, in the body
    sd : (k,) standard deviation of each component of each vector, in the vectors' unit

    Raises
    ------
    GeometryError : the vectors lie on one line, so that the rotation about it is lost
    """
    v_n, v_b = (
        np.atleast_2d(np.asarray(vectors_n, np.float64)),
        np.atleast_2d(np.asarray(vectors_b, np.float64)),
    )
    weight = 1.0 / np.square(np.broadcast_to(np.asarray(sd, np.float64), len(v_b)))
    U, S, Vt = np.linalg.svd(np.einsum("k,ki,kj->ij", weight, v_n, v_b))
    if not S[1] > _ONE_LINE * S[0]:
        raise GeometryError(
            "the vectors lie on one line: the rotation about it is lost",
            advice="add an antenna off the line, or take the lost angle from gyros",
        )
    C = U @ np.diag([1.0, 1.0, np.linalg.det(U) * np.linalg.det(Vt)]) @ Vt
    turned = v_b @ C.T
    square = np.sum(turned**2, axis=1)
    known = np.einsum(
        "k,kij->ij", weight, square[:, None, None] * np.eye(3) - turned[:, :, None] * turned[:, None]
    )
    loss = float(np.sum(weight * np.sum((v_n - turned) ** 2, axis=1)))
    return AttitudeEstimate(C, np.asarray(np.linalg.inv(known)), loss)
