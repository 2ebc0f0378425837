"""Which angles a set of antennas and satellites can measure, how well, and what to add if one is lost."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.attitude.baselines import AntennaArray, Sky, phases_by_rotation
from insgnss.errors import GeometryError
from insgnss.tables import Float64

# Directions that know less than this share of the best one count as lost: their standard deviation is then 100 times
# larger, degrees where the others have minutes of arc
LOST_SHARE: Final = 1e-4
SAME_DIRECTION: Final = 1e-3  # sine of the angle below which directions count as one, 3 minutes of arc


@dataclass(frozen=True)
class Observability:
    """The information of phase differences on a rotation of the body."""

    information_n: Float64  # (3, 3) of the rotation vector in n [1/rad^2]
    sd_rad: Float64  # (3,) of the rotation about the principal axes; inf where it is lost
    axes_n: Float64  # (3, 3) the principal axes, one row each, the best first
    lost_n: Float64  # (lost, 3) axes about which a rotation is not seen
    lost_b: Float64  # (lost, 3) the same in body axes
    reason: str  # the lost angle and the reason; empty if all three angles are observable

    @property
    def is_complete(self) -> bool:
        """Return whether all three angles are seen."""
        return not len(self.lost_n)

    def covariance_n(self) -> Float64:
        """Return the Cramer-Rao bound of the rotation vector in n, (3, 3) [rad^2].

        Raises
        ------
        GeometryError : an angle is lost
        """
        if not self.is_complete:
            raise GeometryError(self.reason, advice="add an antenna off the line, satellites, or gyros")
        return np.asarray(np.linalg.inv(self.information_n))


def information(jacobian: Float64, weight: Float64) -> Float64:
    """Return J^T W J, (k, k), for derivatives (M - 1, N, k) and weights (N, M - 1, M - 1) of each satellite."""
    return np.asarray(np.einsum("mni,nmk,knj->ij", jacobian, weight, jacobian))


def gradient(jacobian: Float64, weight: Float64, residual: Float64) -> Float64:
    """Return J^T W r, (k,), for residuals (M - 1, N)."""
    return np.asarray(np.einsum("mni,nmk,kn->i", jacobian, weight, residual))


def observability(C_nb: npt.ArrayLike, array: AntennaArray, sky: Sky, covariance: Float64) -> Observability:
    """Return which rotations the phase differences of one epoch observe, and how well.

    Parameters
    ----------
    C_nb : (3, 3) attitude
    covariance : (N, M - 1, M - 1) of the differences of each satellite, as from ``difference_covariance`` [rad^2]
    """
    C = np.asarray(C_nb, np.float64)
    known = information(phases_by_rotation(C, array, sky), np.asarray(np.linalg.inv(covariance)))
    values, vectors = np.linalg.eigh(known)
    values, axes = np.maximum(values[::-1], 0.0), vectors.T[::-1]
    lost = values <= LOST_SHARE * max(values[0], np.finfo(float).tiny)
    sd = np.where(lost, math.inf, 1.0 / np.sqrt(np.where(lost, 1.0, values)))
    lost_b = axes[lost] @ C
    return Observability(known, sd, axes, axes[lost], lost_b, _reason(array, sky, lost_b))


def _reason(array: AntennaArray, sky: Sky, lost_b: Float64) -> str:
    if not len(lost_b):
        return ""
    parts = []
    if is_collinear(array):
        line = array.baselines_b[0] / array.lengths_m[0]
        parts.append(
            f"the antennas are on one line: the rotation about it, body axes {_text(line)}, is lost"
            f" ({_angle_lost(line)})"
        )
    if directions(sky) < 2:
        parts.append("one direction to satellites: the rotation about it is lost")
    elif not parts:
        parts.append(f"the rotation about body axes {_text(lost_b[0])} is not seen from these satellites")
    return "; ".join(parts)


def angle_lost(array: AntennaArray) -> str:
    """Return in words the rotation that antennas on one line do not observe."""
    line = array.baselines_b[0] / array.lengths_m[0]
    return f"the rotation about body axes {_text(line)} ({_angle_lost(line)})"


def _angle_lost(line_b: Float64) -> str:
    """Return which Euler angle a rotation about a body axis is, at level attitude."""
    names = ("roll", "pitch", "yaw")
    largest = int(np.argmax(np.abs(line_b)))
    return names[largest] if abs(line_b[largest]) > 0.999 else f"mostly {names[largest]}"


def _text(vector: Float64) -> str:
    return "(" + ", ".join(f"{value + 0.0:.3g}" for value in np.round(vector, 3)) + ")"


def is_collinear(array: AntennaArray) -> bool:
    """Return whether all antennas are on one line, to 3 minutes of arc; two always do."""
    return bool(_rank(array.baselines_b / array.lengths_m[:, None]) < 2)


def directions(sky: Sky) -> int:
    """Return how many independent directions the satellites have, 1 to 3; several signals of one satellite are one."""
    return _rank(sky.los_n)


def _rank(vectors: Float64) -> int:
    return int(np.linalg.matrix_rank(vectors, tol=SAME_DIRECTION * math.sqrt(len(vectors))))


def require_attitude(array: AntennaArray, sky: Sky) -> None:
    """Refuse what cannot give three angles: fewer than two satellites, or antennas on one line.

    Raises
    ------
    GeometryError : says which angle is lost and what to add
    """
    require_two_satellites(sky)
    if is_collinear(array):
        line = array.baselines_b[0] / array.lengths_m[0]
        raise GeometryError(
            f"the antennas are on one line: the rotation about it, body axes {_text(line)}, is lost"
            f" ({_angle_lost(line)})",
            key="positions_b",
            advice="add an antenna off the line, or take the lost angle from gyros",
        )


def require_two_satellites(sky: Sky) -> None:
    """Refuse fewer than two satellites in different directions.

    Raises
    ------
    GeometryError : says how many there are
    """
    if directions(sky) < 2:
        raise GeometryError(
            f"{len(sky.los_n)} signal(s) from one direction: the rotation about it is lost",
            key="los_n",
            advice="wait for a second satellite, lower the elevation mask, or hold the attitude with gyros",
        )
