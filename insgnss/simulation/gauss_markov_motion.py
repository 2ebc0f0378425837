"""Random manoeuvring: acceleration and angular rate are Gauss-Markov processes, the same on every axis.

The motion that the linear theory of receivers assumes, as a figure of a course: three accelerations in the level frame,
each of one sigma and correlation time, and three angular rates in body axes. The attitude is independent of the track.
A weak pull keeps the vehicle where there is air: without one, 5 g with 3.3 s of correlation lead 34 km away within a
minute.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import signal
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation, RotationSpline

from insgnss.errors import ConfigError
from insgnss.simulation.course import MARGIN_S, LevelMotion
from insgnss.simulation.imu import gauss_markov
from insgnss.tables import Float64

GRID_S: Final = 0.02  # of the processes, and of the knots that such a course needs
_DAMPING: Final = math.sqrt(0.5)  # of the pull
_LONGEST_S: Final = 3600.0


@dataclass(frozen=True)
class GaussMarkovProcess:
    """One process on three axes; it begins at zero and has its sigma after a few correlation times.

    Raises
    ------
    ConfigError : a sigma below zero, or a time not above the grid's
    """

    sigma: float
    time_s: float  # correlation time, 1 / alpha

    def __post_init__(self) -> None:
        if not (math.isfinite(self.sigma) and self.sigma >= 0.0):
            raise ConfigError(f"sigma is {self.sigma:g}", key="sigma", advice="give 0 or more")
        if not (math.isfinite(self.time_s) and self.time_s > GRID_S):
            raise ConfigError(
                f"a correlation time of {self.time_s:g} s is too short",
                key="time_s",
                advice=f"give more than the {GRID_S:g} s between two values",
            )

    def values(self, count: int, rng: np.random.Generator) -> Float64:
        """Return values ``GRID_S`` apart, (count, 3), the first of them zero."""
        return gauss_markov(count, GRID_S, self.sigma, self.time_s, rng, from_zero=True)


class GaussMarkovFigure:
    """The random part of a motion, added to the course that goes on; the last thing on it.

    Equation: v' = a - 2 zeta W v - W^2 x, W = 2 pi / return_s, a between its values a straight line; the attitude turns
    by the mean of two rates over each step. Truth is the splines through both.
    """

    def __init__(
        self,
        acceleration: GaussMarkovProcess,
        turning: GaussMarkovProcess,
        duration_s: float,
        rng: np.random.Generator,
        return_s: float | None = None,
    ) -> None:
        """Draw the processes of acceleration [m/s^2] and angular rate [rad/s] for ``duration_s``.

        Parameters
        ----------
        return_s : natural period of the pull back to the course; it bounds distance and speed and removes slower
            parts of the acceleration. None leaves the process as it is

        Raises
        ------
        ConfigError : a duration or period that makes no sense
        """
        if not 0.0 < duration_s <= _LONGEST_S:
            advice = f"give up to {_LONGEST_S:g} s"
            raise ConfigError(
                f"invalid duration {duration_s:g} s of a random motion", key="duration_s", advice=advice
            )
        if return_s is not None and not return_s > acceleration.time_s:
            advice = "give some ten correlation times, or leave it out"
            raise ConfigError("the pull back is faster than the acceleration", key="return_s", advice=advice)
        count = math.ceil((duration_s + 2.0 * MARGIN_S) / GRID_S) + 1
        t = GRID_S * np.arange(count)
        a = acceleration.values(count, rng)
        self.velocity = make_interp_spline(t, _velocities(a, return_s), k=5)
        rates = turning.values(count, rng)
        self.turn = RotationSpline(t, _attitudes(rates))

    def __call__(self, elapsed_s: Float64, motion: LevelMotion) -> LevelMotion:
        """Return the motion with the velocities added and the attitude turned."""
        if len(elapsed_s) == 0:
            return motion
        forward, right, up = self.velocity(elapsed_s).T
        before = Rotation.from_euler("ZYX", np.column_stack([motion.yaw, motion.pitch, motion.roll]))
        yaw, pitch, roll = (before * self.turn(elapsed_s)).as_euler("ZYX").T
        return motion._replace(
            forward=motion.forward + forward,
            right=motion.right + right,
            up=motion.up + up,
            yaw=yaw,
            pitch=pitch,
            roll=roll,
        )


def _velocities(a: Float64, return_s: float | None) -> Float64:
    """Return the velocity from accelerations (n, 3) on the grid, (n, 3); exact for straight lines between."""
    W = 0.0 if return_s is None else 2.0 * math.pi / return_s
    A = np.array([[0.0, 1.0], [-W * W, -2.0 * _DAMPING * W]])
    system = (A, np.array([[0.0], [1.0]]), np.array([[0.0, 1.0]]), np.zeros((1, 1)))
    t = GRID_S * np.arange(len(a))
    return np.column_stack([signal.lsim(system, axis, t)[1] for axis in a.T])


def _attitudes(rates: Float64) -> Rotation:
    """Return the attitudes that body rates (n, 3) on the grid lead to, from none on."""
    steps = Rotation.from_rotvec(0.5 * GRID_S * (rates[1:] + rates[:-1])).as_quat()
    found = np.empty((len(rates), 4))
    found[0] = x, y, z, w = 0.0, 0.0, 0.0, 1.0
    for k, (a, b, c, d) in enumerate(steps.tolist(), 1):
        # q (x) dq, the scalar last
        x, y, z, w = (
            w * a + x * d + y * c - z * b,
            w * b - x * c + y * d + z * a,
            w * c + x * b - y * a + z * d,
            w * d - x * a - y * b - z * c,
        )
        found[k] = x, y, z, w
    return Rotation.from_quat(found)
