"""The attitude that fits an epoch best: its vectors, or its phase differences with the noise that they share.

Vectors known in the body and measured in n are Wahba's problem, solved by singular values; phase differences, whole
cycles given, are fitted from a rough attitude.

F. L. Markley (1988), Attitude determination using vector observations and the singular value decomposition.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.attitude.baselines import AntennaArray, Sky, phase_differences, phases_by_rotation
from insgnss.errors import GeometryError
from insgnss.geodesy.rotations import rotation_matrix
from insgnss.tables import Float64

# second singular value over the first, below which the vectors are one line (0.6 deg)
_ONE_LINE: Final = 1e-4
_NEWTON_STEPS: Final = 4  # Newton's steps from an attitude right to a degree: the third is below 1e-12 rad


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


@dataclass(frozen=True)
class CoarseBaselines:
    """Baselines in n as codes or a guess of the attitude give them, to metres or decimetres."""

    vectors_n: Float64  # (M - 1, 3) [m]
    covariance: Float64  # (M - 1, 3, 3), independent of each other [m^2]


@dataclass(frozen=True)
class PhaseRows:
    """Phase differences of one epoch, whole cycles left open, as rows that may be differences of satellites too."""

    array: AntennaArray
    sky: Sky
    phase: Float64  # (M - 1, R) [rad]
    covariance: Float64  # (R (M - 1), R (M - 1)) of all rows, baselines slowest [rad^2]
    differences: Float64  # (R, N) rows from satellites: unit matrix, or differences against one satellite

    def predicted(self, C_nb: Float64) -> Float64:
        """Return the rows of an attitude, (M - 1, R) [rad]."""
        return np.asarray(phase_differences(C_nb, self.array, self.sky) @ self.differences.T)

    def derivatives(self, C_nb: Float64) -> Float64:
        """Return their derivatives by a rotation in n, (rows, 3)."""
        J = phases_by_rotation(C_nb, self.array, self.sky)
        return np.asarray(np.einsum("rn,mni->mri", self.differences, J).reshape(-1, 3))

    def wave_rows(self) -> Float64:
        """Return the derivatives of the rows of one baseline by it, (R, 3) [rad/m]."""
        return np.asarray(self.differences @ self.sky.wave_vectors_n)


def fit_attitude(
    start: npt.ArrayLike, rows: PhaseRows, cycles: npt.ArrayLike, rough: CoarseBaselines
) -> AttitudeEstimate:
    """Return the attitude of least squares over phases and rough baselines, from a start right to some degrees.

    The loss is chi-square with rows + 3 (M - 1) - 3 degrees of freedom where the whole cycles are right.

    Parameters
    ----------
    start : (3, 3) C_nb
    cycles : (M - 1, R) whole cycles to add to the phases
    """
    C = np.asarray(start, np.float64)
    W = np.linalg.inv(rows.covariance)
    W_rough = np.asarray(np.linalg.inv(rough.covariance))
    measured = rows.phase + 2.0 * np.pi * np.asarray(cycles, np.float64)
    for step in range(_NEWTON_STEPS + 1):
        residual = (measured - rows.predicted(C)).ravel()
        l_n = rows.array.baselines_b @ C.T
        rest = rough.vectors_n - l_n
        if step == _NEWTON_STEPS:
            break
        J = rows.derivatives(C)
        # phi x l, one column per component of phi
        J_rough = np.cross(np.eye(3)[None], l_n[:, None]).swapaxes(1, 2)
        known = J.T @ W @ J + np.einsum("mai,mab,mbj->ij", J_rough, W_rough, J_rough)
        slope = J.T @ W @ residual + np.einsum("mai,mab,mb->i", J_rough, W_rough, rest)
        C = rotation_matrix(np.linalg.solve(known, slope)) @ C
    loss = float(residual @ W @ residual + np.einsum("ma,mab,mb->", rest, W_rough, rest))
    return AttitudeEstimate(C, np.asarray(np.linalg.inv(known)), loss)
