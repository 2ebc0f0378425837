"""From the hypotheses that the logs leave to a declaration of axes: the simplest, and whether it is the only one."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from insgnss.log.checks.axis_search import Hypothesis
from insgnss.log.checks.longitudinal_axis import STEADY
from insgnss.log.checks.motion_fit import signed_permutations
from insgnss.tables import Float64

# -2 log of the belief in axes before the log is seen: as declared, turned as a whole, of reversed sign in one sensor,
# and for every row in which the sensors differ, the accelerometers' being turned besides counting as one more
STRANGE: Final = (0.0, 10.0, 12.0)
STRANGE_FIRST_ROW: Final = 30.0
STRANGE_ROW: Final = 25.0
# Cosines of a declared axis with the direction that it should have
AGAINST: Final = 0.5  # more than 60 deg away ...
ALONG: Final = 0.8  # ... while another axis is nearer than 37 deg


class VehicleAxes(NamedTuple):
    """Maps from sensor columns to body axes, and the evidence for them."""

    accel: Float64  # (3, 3) A
    gyro: Float64  # (3, 3) G
    factor: float  # on the gyros' declared unit
    hypothesis: Hypothesis
    turned: bool  # the accelerometers' axes are not the declared ones
    gyro_kept: bool  # the gyros' are
    rank: int  # 0 as declared, 1 both sensors equal, 2 equal except for the sign of all, then more for each row apart

    @property
    def cost(self) -> float:
        """-2 log likelihood above the best."""
        return self.hypothesis.cost

    @property
    def mounted(self) -> bool:
        """Whether a sensor that is right in itself, mounted otherwise, gives these axes."""
        return np.array_equal(self.accel, self.gyro) and bool(np.linalg.det(self.accel) > 0.0)


def relative(accel: Float64, gyro: Float64) -> Float64:
    """Return H = det(A) A^T G, the gyros' map in the accelerometers' own axes."""
    return np.asarray(np.rint(np.linalg.det(accel)) * accel.T @ gyro)


def candidates(ranked: list[Hypothesis], accel_0: Float64, gyro_0: Float64) -> list[VehicleAxes]:
    """Return the declarations that the hypotheses allow, the most credible first, each with its cost above that.

    A with det A = handed turns the mean motion forward and mean gravity down, and G = det(A) A H; declared axes that
    the log does not contradict stay. Stranger declarations need more evidence: in a coordinated flight the
    accelerometers see no side force, and only the prior separates a reversed axis from a right one.
    """
    by_declaration: dict[tuple[tuple[str, ...], tuple[str, ...], float], VehicleAxes] = {}
    for one in sorted(ranked, key=lambda one: one.cost):
        accel = _accel(one, accel_0)
        gyro = one.handed * accel @ one.gyro_map
        turned = not np.array_equal(accel, accel_0)
        axes = VehicleAxes(
            accel,
            gyro,
            one.factor,
            one,
            turned,
            bool(np.array_equal(gyro, gyro_0)),
            _rank(accel, gyro, accel_0, gyro_0),
        )
        by_declaration.setdefault((names(accel), names(gyro), one.factor), axes)
    return sorted(by_declaration.values(), key=credibility)


def credibility(axes: VehicleAxes) -> float:
    """Return -2 log of how credible a declaration is, with the evidence of the log: the least is the best."""
    if axes.rank < len(STRANGE):
        twice = axes.rank == 2 and axes.turned and not axes.gyro_kept
        return axes.cost + STRANGE[axes.rank] + (STRANGE_ROW if twice else 0.0)
    rows = axes.rank - len(STRANGE) + (1 if axes.turned else 0)
    return axes.cost + STRANGE_FIRST_ROW + STRANGE_ROW * rows


def strangeness(axes: VehicleAxes) -> float:
    """Return -2 log of the prior of a declaration among those that fit the log: those of a mounting come first.

    A whole log of the wrong hand, or a sensor of the wrong sign, is hardly likelier than one column that is wrong.
    """
    if axes.rank == 0:
        return 0.0
    if axes.mounted:
        return STRANGE[1]
    both = STRANGE_ROW if axes.turned and not axes.gyro_kept else 0.0
    if axes.rank < len(STRANGE):
        return STRANGE_FIRST_ROW + (both if axes.rank == 2 else 0.0)
    apart = int(np.sum((axes.accel != axes.gyro).any(axis=1)))
    exchanged = not np.array_equal(np.abs(axes.accel), np.abs(axes.gyro))  # of two rows, which is one slip
    return STRANGE_FIRST_ROW + STRANGE_ROW * (apart - 1 - int(exchanged)) + both


def _accel(one: Hypothesis, accel_0: Float64) -> Float64:
    if np.rint(np.linalg.det(accel_0)) == one.handed and not contradicted(one, accel_0):
        return accel_0
    allowed = [A for A in signed_permutations() if np.rint(np.linalg.det(A)) == one.handed]
    score = np.round([float(A[0] @ one.along_s + A[2] @ one.down_s) for A in allowed], 3)
    # of equals the one that changes least: where the motion has no direction, gravity alone decides
    unchanged = np.array([float(np.sum(accel_0 == A)) for A in allowed])
    best: Float64 = allowed[int(np.lexsort((unchanged, score))[-1])]
    return best


def contradicted(one: Hypothesis, accel: Float64) -> bool:
    """Return whether motion or gravity lies clearly along another axis than declared."""
    return _against(accel[0], one.along_s) or _against(accel[2], one.down_s)


def _against(axis: Float64, direction: Float64) -> bool:
    length = float(np.linalg.norm(direction))
    if length < STEADY:
        return False
    return float(axis @ direction) / length < AGAINST and float(np.abs(direction).max()) / length > ALONG


def forward_known(one: Hypothesis) -> bool:
    """Return whether the vehicle moves along one sensor axis."""
    length = float(np.linalg.norm(one.along_s))
    return length > STEADY and float(np.abs(one.along_s).max()) / length > ALONG


def _rank(accel: Float64, gyro: Float64, accel_0: Float64, gyro_0: Float64) -> int:
    if np.array_equal(accel, accel_0) and np.array_equal(gyro, gyro_0):
        return 0
    if np.array_equal(accel, gyro):
        return 1
    if np.array_equal(accel, -gyro):
        return 2
    return 2 + int(np.sum((accel != gyro).any(axis=1)))


def names(matrix: Float64) -> tuple[str, str, str]:
    """Return a signed permutation as the flight file writes it: ("-y", "+x", "+z")."""
    words = []
    for row in matrix:
        at = int(np.argmax(np.abs(row)))
        words.append(("+" if row[at] > 0.0 else "-") + "xyz"[at])
    return (words[0], words[1], words[2])
