"""The one-stage filter: angles and their rates straight from the correlators of all antennas.

Dneprov and Korogodin (2015), (5)-(9): X~ = F X^, X^ = X~ + D (dF/dX)^T, D^-1 = D~^-1 - d2F/dX2, with the expected
second derivative of the log-likelihood in the place of the drawn one. No phase difference is ever formed, so
there is no ambiguity to resolve; in exchange the first attitude must be right to half of the aperture.

With gyros the attitude is carried on by their increments, and the state has their biases in the place of the rates:

    C_nb <- C_nb exp([theta - b T] x),    psi' = -C_nb delta b,    b' = white noise

Against phase differences of the same integrations with the same gyros (``GyroAttitude``; three antennas 1 m apart,
eight satellites, 10 ms, MEMS): the same errors from 45 to 28 dBHz (1.4 to 5 arc minutes), 6.0 and 7.6 at 25 dBHz; from
24 dBHz down no cycle of a phase difference is known in 10 ms, and one stage goes on (6.2 at 24 dBHz, 9.3 at 22 dBHz).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from insgnss.attitude.angular_discriminators import (
    likelihood_discriminator,
    likelihood_weights,
    pair_covariance,
    pair_discriminator,
    pair_slopes,
)
from insgnss.attitude.array_observability import gradient, information, require_two_satellites
from insgnss.attitude.baselines import (
    AntennaArray,
    Sky,
    attitude_matrices,
    phase_differences,
    phases_by_euler,
    phases_by_rotation,
)
from insgnss.errors import ConfigError, GeometryError
from insgnss.geodesy.rotations import rotation_matrix, to_euler
from insgnss.tables import Complex, Float64
from insgnss.tracking.admissible import require_known, require_positive

Parameters = Literal["euler", "rotation"]
Source = Literal["likelihood", "pairs"]
ANGLE: Final = slice(0, 3)
RATE: Final = slice(3, 6)
# Euler angles: from here on roll and yaw are so nearly one angle that their rates exceed the body's tenfold
_STEEPEST_PITCH_RAD: Final = math.radians(84.0)
# of the range of lock: narrower than the lobes of any curve of 2 m baselines
_SCAN_RAD: Final = math.radians(0.5)
_BACK_SHARE: Final = 0.1  # of the first offset that may be left of a start that came back


@dataclass(frozen=True)
class AttitudeState:
    """The filter's state after an epoch."""

    C_nb: Float64  # (3, 3)
    rpy: Float64  # (3,) [rad]; unwrapped where the filter works in Euler angles
    rate: Float64  # (3,) of roll, pitch, yaw, or of the rotation vector in n; with gyros their biases, body [rad/s]
    covariance: Float64  # (6, 6) of angles (or rotation vector in n) and rates
    agreement: float = math.nan  # mean cosine of the phases left over: near 1 in lock, lower on a false zero


@dataclass(frozen=True)
class OneStage:
    """The filter's model: antennas, signals, and how the attitude may change.

    ``parameters``: "euler" is the paper's state of angles and their rates, and is refused near a pitch of 90 deg;
    "rotation" keeps the matrix and corrects it by a rotation vector in n, for all attitudes. ``source``: "likelihood"
    uses all antennas' correlators as their joint likelihood does, "pairs" the paper's products with the first antenna,
    summed as if their noises were independent: its covariance is too modest or too confident by what they share.
    ``increment_noise`` makes it a filter with gyros, whose increments every step takes; ``rate_noise`` is then that of
    their biases. Neglects: the turn of n itself, 7e-5 rad/s, which the biases take.
    """

    array: AntennaArray
    sky: Sky
    a: Float64  # (M, N) signal ratios 2 q T of one integration
    integration_s: float
    rate_noise: Float64  # (3,) variance by which the rates change in one integration [(rad/s)^2]
    parameters: Parameters = "euler"
    source: Source = "likelihood"
    increment_noise: float | None = None  # variance of an angle increment, each axis [rad^2]; None: no gyros

    def __post_init__(self) -> None:
        if self.increment_noise is not None and not (
            self.parameters == "rotation" and 0.0 <= self.increment_noise < math.inf
        ):
            raise ConfigError(
                "gyros need parameters of a rotation, and a variance of 0 or more",
                key="increment_noise",
                advice='give parameters = "rotation" and the angular random walk squared times the integration time',
            )
        require_positive("integrations last 1 to 20 ms", integration_s=self.integration_s)
        require_known(self.parameters, ("euler", "rotation"), "parameters", "set of parameters")
        require_known(self.source, ("likelihood", "pairs"), "source", "discriminator")
        require_two_satellites(self.sky)
        shape = (len(self.array.positions_b), len(self.sky.los_n))
        a = np.asarray(self.a, np.float64)
        if a.shape not in ((), shape):
            advice = "give one for each antenna and satellite, or one for all"
            raise ConfigError(f"signal ratios of shape {a.shape}, not {shape}", key="a", advice=advice)
        a = np.broadcast_to(a, shape)
        noise = _three_of(self.rate_noise, "rate_noise")
        if not ((a > 0.0) & np.isfinite(a)).all() or not ((noise >= 0.0) & np.isfinite(noise)).all():
            raise ConfigError(
                "signal ratios must be above 0, variances not below, and both finite",
                key="a",
                advice="leave a satellite that is not received out of the sky",
            )
        object.__setattr__(self, "a", a)
        object.__setattr__(self, "rate_noise", noise)

    def start(
        self, rpy: npt.ArrayLike, sd_angle_rad: npt.ArrayLike, sd_rate_radps: npt.ArrayLike
    ) -> AttitudeState:
        """Return the first state: at rest, with standard deviations of one number or three each.

        Raises
        ------
        ConfigError : not three angles, or standard deviations that are not above zero
        """
        angles = np.asarray(rpy, np.float64)
        if angles.shape != (3,) or not np.isfinite(angles).all():
            raise ConfigError(
                f"invalid angles {angles}", key="rpy", advice="give roll, pitch, yaw in radians"
            )
        for key, value in (("sd_angle_rad", sd_angle_rad), ("sd_rate_radps", sd_rate_radps)):
            for number in _three_of(value, key):
                require_positive(**{key: number})
        sd = np.r_[np.broadcast_to(sd_angle_rad, 3), np.broadcast_to(sd_rate_radps, 3)]
        return AttitudeState(attitude_matrices(angles), angles, np.zeros(3), np.diag(sd**2))

    def predicted(self, state: AttitudeState, increment_b: npt.ArrayLike | None = None) -> AttitudeState:
        """Return the state one integration later  [(5), (8), (9)].

        Parameters
        ----------
        increment_b : (3,) of the gyros over the integration [rad]; None without gyros

        Raises
        ------
        ConfigError : increments without gyros, gyros without increments, or increments that are not numbers
        """
        T = self.integration_s
        F, turned = np.eye(6), self._turned(state, increment_b)
        if turned is not None:
            C = state.C_nb @ rotation_matrix(turned)
            F[ANGLE, RATE] = -0.5 * T * (state.C_nb + C)
            moved = replace(state, C_nb=C, rpy=to_euler(C))
        else:
            F[ANGLE, RATE] = T * np.eye(3)
            if self.parameters == "rotation":
                F[ANGLE, ANGLE] = rotation_matrix(T * state.rate)
            moved = self._moved(state, T * state.rate)
        D = F @ state.covariance @ F.T
        D[ANGLE, ANGLE] += (self.increment_noise or 0.0) * np.eye(3)
        D[RATE, RATE] += np.diag(self.rate_noise)
        return replace(moved, covariance=D)

    def _turned(self, state: AttitudeState, increment_b: npt.ArrayLike | None) -> Float64 | None:
        """Return the gyros' increment without their biases, (3,); None without gyros."""
        if (increment_b is None) != (self.increment_noise is None):
            raise ConfigError(
                "increments and their noise go together",
                key="increment_b",
                advice="give each step (3,) increments, and increment_noise to the filter, or neither",
            )
        if increment_b is None:
            return None
        increment = np.asarray(increment_b, np.float64)
        if increment.shape != (3,) or not np.isfinite(increment).all():
            raise ConfigError(
                f"invalid increments {increment}", key="increment_b", advice="give three angles in radians"
            )
        return np.asarray(increment - self.integration_s * state.rate)

    def corrected(self, state: AttitudeState, Z: Complex) -> AttitudeState:
        """Return the state after the correlators (M, N) of one integration  [(8), (9)].

        Raises
        ------
        GeometryError : Euler angles too near to a pitch of +-90 deg
        ConfigError : not a finite correlator for each antenna and satellite
        """
        if np.shape(Z) != self.a.shape or not np.isfinite(Z).all():
            raise ConfigError(
                f"correlators are {self.a.shape[0]} x {self.a.shape[1]} finite numbers",
                key="Z",
                advice="predict over an integration whose correlators are missing",
            )
        Z = np.asarray(Z, np.complex128)
        psi = phase_differences(state.C_nb, self.array, self.sky)
        J = self._derivatives(state)
        known, slope = self._score(Z, psi, J)
        D_inverse = np.linalg.inv(state.covariance)
        D_inverse[ANGLE, ANGLE] += known
        D = np.linalg.inv(D_inverse)
        dX = D[:, ANGLE] @ slope
        moved = self._moved(state, dX[ANGLE])
        return replace(
            moved, rate=state.rate + dX[RATE], covariance=0.5 * (D + D.T), agreement=_agreement(Z, psi)
        )

    def step(
        self, state: AttitudeState, Z: Complex, increment_b: npt.ArrayLike | None = None
    ) -> AttitudeState:
        """Return the state after prediction and correction by one integration's correlators (M, N)."""
        return self.corrected(self.predicted(state, increment_b), Z)

    def _score(self, Z: Complex, psi: Float64, J: Float64) -> tuple[Float64, Float64]:
        """Return the expected information (3, 3) and the gradient (3,) of the log-likelihood by the angles."""
        if self.source == "likelihood":
            u = likelihood_discriminator(Z, psi)
            return information(J, likelihood_weights(self.a)), np.asarray(np.einsum("mni,mn->i", J, u))
        D_psi = np.einsum("nmm->nm", pair_covariance(self.a))
        W = np.eye(D_psi.shape[1]) / D_psi[:, None, :]
        return information(J, W), gradient(J, W, pair_discriminator(Z, psi) / pair_slopes(self.a))

    def _derivatives(self, state: AttitudeState) -> Float64:
        if self.parameters == "rotation":
            return phases_by_rotation(state.C_nb, self.array, self.sky)
        if abs(math.sin(state.rpy[1])) > math.sin(_STEEPEST_PITCH_RAD):
            raise GeometryError(
                f"pitch {math.degrees(state.rpy[1]):.1f} deg: roll and yaw cannot be separated there",
                key="parameters",
                advice="use parameters = 'rotation', which has no such singularity",
            )
        return phases_by_euler(state.rpy, self.array, self.sky)

    def _moved(self, state: AttitudeState, step: Float64) -> AttitudeState:
        if self.parameters == "euler":
            rpy = state.rpy + step
            return replace(state, rpy=rpy, C_nb=attitude_matrices(rpy))
        C = rotation_matrix(step) @ state.C_nb
        return replace(state, C_nb=C, rpy=to_euler(C))


def _agreement(Z: Complex, psi: Float64) -> float:
    """Return the mean cosine between each satellite's correlators, turned back by the prediction, and their sum."""
    turned = Z.copy()
    turned[1:] *= np.exp(-1j * psi)
    total = np.sum(turned, axis=0)
    return float(np.sum(np.abs(total)) / max(np.sum(np.abs(turned)), np.finfo(float).tiny))


def recovery_curve(model: OneStage, rpy: npt.ArrayLike, angle: int, offsets_rad: npt.ArrayLike) -> Float64:
    """Return the mean correction of one angle when the filter's is off by ``offsets_rad`` (n,), without noise, (n,).

    The curve of (27)-(30) holds the derivatives at the true attitude and moves the truth; in the filter they move with
    its own attitude, so that the unstable points differ. Negative slope at zero: it leads back.
    """
    true = np.asarray(rpy, np.float64)
    Z = _noise_free(model, true)
    curve = []
    for offset in np.atleast_1d(np.asarray(offsets_rad, np.float64)):
        state = model.start(true + offset * np.eye(3)[angle], 1.0, 1.0)
        psi = phase_differences(state.C_nb, model.array, model.sky)
        J = phases_by_euler(state.rpy, model.array, model.sky)
        curve.append(model._score(Z, psi, J)[1][angle])
    return np.array(curve)


def lock_range(model: OneStage, state: AttitudeState, angle: int, steps: int = 400) -> tuple[float, float]:
    """Return how far one Euler angle may be off below and above for the filter to come back, without noise [rad].

    The true attitude is ``state``'s, at rest; the filter starts off it with ``state``'s covariance. It needs some
    ``rate_noise``, or the gain dies away before a distant start has come back.
    """
    Z = _noise_free(model, state.rpy)

    def comes_back(offset: float) -> bool:
        rpy = state.rpy + offset * np.eye(3)[angle]
        now = replace(state, rpy=rpy, C_nb=attitude_matrices(rpy))
        for _ in range(steps):
            now = model.step(now, Z)
            if np.abs(now.rpy - state.rpy).max() < _BACK_SHARE * abs(offset):
                return True
        return False

    limits = []
    for sign in (-1.0, 1.0):
        inner, outer = _SCAN_RAD, 2.0 * _SCAN_RAD
        while outer < math.pi and comes_back(sign * outer):
            inner, outer = outer, outer + _SCAN_RAD
        for _ in range(4):
            middle = 0.5 * (inner + outer)
            inner, outer = (middle, outer) if comes_back(sign * middle) else (inner, middle)
        limits.append(sign * 0.5 * (inner + outer))
    return limits[0], limits[1]


def _noise_free(model: OneStage, rpy: Float64) -> Complex:
    psi = phase_differences(attitude_matrices(rpy), model.array, model.sky)
    return np.asarray(model.a * np.exp(1j * np.concatenate([np.zeros_like(psi[:1]), psi])))


def _three_of(value: npt.ArrayLike, key: str) -> Float64:
    """Return three numbers, or one for all three."""
    numbers = np.asarray(value, np.float64)
    if numbers.shape not in ((), (3,)):
        raise ConfigError(f"{key} has the shape {numbers.shape}", key=key, advice="give one number or three")
    return np.broadcast_to(numbers, (3,))
