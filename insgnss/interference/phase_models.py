"""Linear models of coherent receivers: the states of the tracked phases, and their driving noise.

A receiver is a linear model of its phases: ``x' = A x + white noise of intensity Q``, phases ``H x`` in white noise.

- ``channel_model``: phase, frequency and acceleration of one line of sight. It represents a channel of the two-stage
  receiver: without INS with the vehicle's acceleration, with INS (aided) with the INS's acceleration error.
- ``one_stage_model``: position, velocity, acceleration (three each), clock and clock rate, 11 states. Discriminators
  are rows of one filter over pseudo-coordinates; without INS or with it, as above.

With INS a receiver gets the vehicle's acceleration without delay; the error of it is a Gauss-Markov process and a white
part. Attitude is not in these models: 17 states with it are in ``insgnss.studies.receiver.manoeuvring_covariance``.
                                                                    [Shatilov 2007, chapter 2, coherent receivers]

Drift is given as a one-sided density, as in the whole room; A, Q and H are those of a Kalman filter: Q is two-sided.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from insgnss.errors import ConfigError
from insgnss.interference.checks import not_negative, positive
from insgnss.interference.drift import per_mps
from insgnss.interference.optimal_loop import two_sided
from insgnss.tables import Float64

POSITION, VELOCITY, ACCELERATION = slice(0, 3), slice(3, 6), slice(6, 9)  # of ``one_stage_model``
CLOCK, CLOCK_RATE, ONE_STAGE_STATES = 9, 10, 11
FREQUENCY: Final = 1  # of ``channel_model``
CHANNEL_STATES: Final = 3


@dataclass(frozen=True)
class UnknownAcceleration:
    """The unknown acceleration of a receiver, the same on every axis: Gauss-Markov, and white samples.

    Without INS it is the vehicle's own motion, with INS the error of the INS.

    Raises
    ------
    ConfigError : a negative sigma, or a time that is not positive
    """

    sigma_mps2: float
    time_s: float  # correlation time, 1 / alpha
    white_mps2: float = 0.0  # one sigma of a sample
    white_step_s: float = 1e-3  # between two samples

    def __post_init__(self) -> None:
        not_negative("sigma_mps2", self.sigma_mps2, "one sigma in m/s^2, of each axis")
        positive("time_s", self.time_s, "the acceleration's correlation time in seconds")
        not_negative("white_mps2", self.white_mps2, "one sigma of a sample in m/s^2")
        positive("white_step_s", self.white_step_s, "the time between two samples in seconds")

    @property
    def rate_per_s(self) -> float:
        """Return alpha [1/s]."""
        return 1.0 / self.time_s

    @property
    def intensity(self) -> float:
        """Return the two-sided intensity that drives the Gauss-Markov part, 2 alpha sigma^2 [m^2/s^5]."""
        return 2.0 * self.rate_per_s * self.sigma_mps2**2

    @property
    def white_intensity(self) -> float:
        """Return the two-sided intensity of the white part, sigma^2 T [m^2/s^3]."""
        return self.white_mps2**2 * self.white_step_s


@dataclass(frozen=True)
class PhaseModel:
    """A linear model of n states and m tracked phases; intensities are two-sided.

    Raises
    ------
    ConfigError : shapes that do not fit, numbers that are not finite, or a negative intensity
    """

    A: Float64  # (n, n) [1/s]
    motion: Float64  # (n, n) what the unknown acceleration drives, part of Q
    oscillator: Float64  # (n, n) what the oscillator drives, the other part
    H: Float64  # (m, n) [rad per unit of the state]

    def __post_init__(self) -> None:
        n, m = len(self.A), len(self.H)
        if [x.shape for x in (self.A, self.motion, self.oscillator, self.H)] != [(n, n)] * 3 + [(m, n)]:
            advice = "A, motion and oscillator are (n, n), H is (m, n)"
            raise ConfigError("the matrices of a phase model do not fit", key="A", advice=advice)
        if not all(np.isfinite(x).all() for x in (self.A, self.Q, self.H)) or np.diag(self.Q).min() < 0.0:
            raise ConfigError(
                "a matrix of the phase model is not finite, or an intensity is negative",
                key="Q",
                advice="check sigmas, densities and directions",
            )

    @property
    def Q(self) -> Float64:
        """Return the intensity of the noise that drives the states, (n, n)."""
        return np.asarray(self.motion + self.oscillator)


def channel_model(
    acceleration: UnknownAcceleration, drift: float, carrier_hz: float, phase_walk: float = 0.0
) -> PhaseModel:
    """Return the model of one channel: ``phi' = w + n_f, w' = a + n, a' = -alpha a + n_a``, carrier units.

    Equation: intensities S_f / 2, S / 2 + k^2 q_w, 2 alpha (k sigma)^2, k = 2 pi f0 / c; the loop of its steady gains
    is ``third_order_gains`` where the acceleration has no white part.

    Parameters
    ----------
    acceleration : along the line of sight: of the vehicle, or the error of the INS that aids
    drift : S of the oscillator, one-sided [rad^2/s^3]
    phase_walk : S_f, one-sided density of white frequency noise [rad^2/s]
    """
    k = per_mps(carrier_hz)
    A = np.diag([1.0, 1.0], 1)
    A[2, 2] = -acceleration.rate_per_s
    motion = np.diag([0.0, k**2 * acceleration.white_intensity, k**2 * acceleration.intensity])
    return PhaseModel(A, motion, np.diag([*_oscillator(drift, phase_walk), 0.0]), np.eye(1, 3))


def one_stage_model(
    acceleration: UnknownAcceleration,
    drift: float,
    carrier_hz: float,
    directions: Float64,
    phase_walk: float = 0.0,
) -> PhaseModel:
    """Return the model of a one-stage receiver: ``phi_i = k (-u_i . x + b)``, 11 states in metres.

    Parameters
    ----------
    acceleration : on each of three axes: of the vehicle, or the error of the INS
    drift, phase_walk : of the oscillator, as in ``channel_model``
    directions : (m, 3) unit vectors from user to satellites, in any axes

    Raises
    ------
    ConfigError : the directions do not separate position from clock
    """
    u, k = checked_directions(directions), per_mps(carrier_hz)
    A = np.zeros((ONE_STAGE_STATES, ONE_STAGE_STATES))
    A[POSITION, VELOCITY] = A[VELOCITY, ACCELERATION] = np.eye(3)
    A[ACCELERATION, ACCELERATION] = -acceleration.rate_per_s * np.eye(3)
    A[CLOCK, CLOCK_RATE] = 1.0
    motion, oscillator = np.zeros_like(A), np.zeros_like(A)
    motion[VELOCITY, VELOCITY] = acceleration.white_intensity * np.eye(3)
    motion[ACCELERATION, ACCELERATION] = acceleration.intensity * np.eye(3)
    oscillator[CLOCK, CLOCK], oscillator[CLOCK_RATE, CLOCK_RATE] = (
        q / k**2 for q in _oscillator(drift, phase_walk)
    )
    H = np.zeros((len(u), ONE_STAGE_STATES))
    H[:, POSITION], H[:, CLOCK] = -k * u, k
    return PhaseModel(A, motion, oscillator, H)


def receiver_models(
    vehicle: UnknownAcceleration,
    ins_error: UnknownAcceleration,
    drift: float,
    carrier_hz: float,
    directions: Float64,
) -> dict[str, PhaseModel]:
    """Return ``two_stage``, ``two_stage_ins``, ``one_stage`` and ``one_stage_ins`` under the same conditions."""
    return {
        "two_stage": channel_model(vehicle, drift, carrier_hz),
        "two_stage_ins": channel_model(ins_error, drift, carrier_hz),
        "one_stage": one_stage_model(vehicle, drift, carrier_hz, directions),
        "one_stage_ins": one_stage_model(ins_error, drift, carrier_hz, directions),
    }


def checked_directions(directions: Float64) -> Float64:
    """Return the directions as an array after a check of shape, length and geometry."""
    u = np.asarray(directions, np.float64)
    fits = u.ndim == 2 and u.shape[1] == 3 and np.isfinite(u).all()
    if not fits or not np.allclose(np.linalg.norm(u, axis=1), 1.0, atol=1e-6):
        advice = "give (m, 3) unit vectors from user to satellites"
        raise ConfigError("directions are not unit vectors", key="directions", advice=advice)
    if np.linalg.matrix_rank(np.column_stack([u, np.ones(len(u))]), tol=1e-6) < 4:
        advice = "give at least four satellites that do not lie on a cone"
        raise ConfigError(
            "the directions do not separate position from clock", key="directions", advice=advice
        )
    return u


def _oscillator(drift: float, phase_walk: float) -> tuple[float, float]:
    """Return the two-sided intensities of phase [rad^2/s] and frequency [rad^2/s^3]."""
    S = positive("drift", drift, "the oscillator's one-sided density in rad^2/s^3 is above zero")
    S_f = not_negative("phase_walk", phase_walk, "a one-sided density in rad^2/s, zero for none")
    return float(two_sided(S_f)), float(two_sided(S))
