"""A vehicle in strong rotation with MEMS gyros and four antennas: how well the gyro-aided filter does.

The truth is a smooth law of roll, pitch and yaw, from which rates follow exactly; gyro samples are integrals of the
rate over each sample (Simpson's rule), so that nothing here repeats the filter's own recursion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.attitude.baselines import AntennaArray, Sky, attitude_matrices, phase_differences, wrapped
from insgnss.attitude.gyro_attitude import GyroAttitude, GyroErrors, GyroState, PhaseUpdate
from insgnss.errors import ConfigError
from insgnss.geodesy.rotations import rotation_matrix, rotation_vector
from insgnss.tables import Float64
from insgnss.tracking.admissible import require_positive

# Amplitudes [rad], angular frequencies (before scaling) [rad/s] and phases [rad] of two sines for each angle: the
# frequencies have no common multiple, so that all axes are turned about in all combinations
_AMPLITUDE: Final = np.array([[0.5, 0.2], [0.4, 0.15], [0.7, 0.3]])
_FREQUENCY: Final = np.array([[1.0, 1.93], [0.83, 2.21], [0.71, 1.57]])
_PHASE: Final = np.array([[0.0, 1.0], [2.0, 0.5], [1.3, 2.7]])


@dataclass(frozen=True)
class Swing:
    """An angular motion about all axes whose largest angular acceleration is given."""

    acceleration_radps2: float

    def __post_init__(self) -> None:
        require_positive(acceleration_radps2=self.acceleration_radps2)

    @property
    def tempo(self) -> float:
        """Return the factor of all frequencies: accelerations grow with its square."""
        t = np.arange(0.0, 300.0, 0.02)
        w = _rates(t, 1.0)
        return math.sqrt(self.acceleration_radps2 / np.linalg.norm(np.gradient(w, t, axis=0), axis=1).max())

    def angles(self, t: npt.ArrayLike) -> Float64:
        """Return roll, pitch, yaw at times (n,), (n, 3) [rad]."""
        return _angles(np.asarray(t, np.float64), self.tempo)

    def rates(self, t: npt.ArrayLike) -> Float64:
        """Return the rate of the body against n, body axes, (n, 3) [rad/s]."""
        return _rates(np.asarray(t, np.float64), self.tempo)


def _angles(t: Float64, tempo: float) -> Float64:
    return np.asarray(np.sum(_AMPLITUDE * np.sin(tempo * t[:, None, None] * _FREQUENCY + _PHASE), axis=2))


def _rates(t: Float64, tempo: float) -> Float64:
    phase = tempo * t[:, None, None] * _FREQUENCY + _PHASE
    roll, pitch, _ = np.sum(_AMPLITUDE * np.sin(phase), axis=2).T
    d_roll, d_pitch, d_yaw = np.sum(tempo * _AMPLITUDE * _FREQUENCY * np.cos(phase), axis=2).T
    sr, cr, sp, cp = np.sin(roll), np.cos(roll), np.sin(pitch), np.cos(pitch)
    rows = [d_roll - d_yaw * sp, d_pitch * cr + d_yaw * sr * cp, d_yaw * cr * cp - d_pitch * sr]
    return np.stack(rows, axis=-1)


@dataclass(frozen=True)
class Trial:
    """What to simulate; the filter is given the same noise levels."""

    array: AntennaArray
    sky: Sky
    gyros: GyroErrors
    swing: Swing = Swing(14.0)
    w_ie_n: Float64 | None = None
    phase_sd_m: float = 0.003  # of each antenna, noise and multipath as white [m]
    gyro_step_s: float = 0.0025
    epoch_s: float = 0.1
    seconds: float = 120.0
    loss_s: float = math.inf  # from then on no signals
    start_sd_rad: float = math.radians(0.5)

    def __post_init__(self) -> None:
        require_positive(phase_sd_m=self.phase_sd_m, gyro_step_s=self.gyro_step_s, epoch_s=self.epoch_s)
        require_positive(seconds=self.seconds, start_sd_rad=self.start_sd_rad)
        if self.epoch_s < self.gyro_step_s or self.seconds < self.epoch_s:
            raise ConfigError("epochs are longer than gyro samples", key="epoch_s", advice="0.1 s and 2.5 ms")

    def run(self, rng: np.random.Generator) -> History:
        """Return the filter's errors along one drawn run."""
        per_epoch = round(self.epoch_s / self.gyro_step_s)
        epochs = int(self.seconds / self.epoch_s + 1e-9)
        w_ie_n = np.zeros(3) if self.w_ie_n is None else self.w_ie_n
        bias, M, w_meas = self._gyro_samples(epochs * per_epoch, w_ie_n, rng)
        t = np.asarray(self.epoch_s * np.arange(epochs + 1.0), np.float64)
        C_true = attitude_matrices(self.swing.angles(t))
        wavelength = self.sky.wavelength_m
        sd = np.broadcast_to(
            2.0 * math.pi * self.phase_sd_m / wavelength, (len(self.array.positions_b), len(wavelength))
        )
        model = GyroAttitude(self.array, self.gyros, w_ie_n)
        away = rotation_matrix(self.start_sd_rad * rng.standard_normal(3))
        state = model.start(away @ C_true[0], self.start_sd_rad)
        states, corrections = [], []
        for k in range(epochs):
            state = model.predicted(state, w_meas[k * per_epoch : (k + 1) * per_epoch], self.gyro_step_s)
            if t[k + 1] < self.loss_s:
                noise = sd * rng.standard_normal(sd.shape)
                psi = phase_differences(C_true[k + 1], self.array, self.sky) + noise[1:] - noise[:1]
                state, correction = model.corrected(state, wrapped(psi), sd**2, self.sky)
                corrections.append(correction)
            states.append(state)
        return History(t[1:], C_true[1:], bias[per_epoch - 1 :: per_epoch], M, states, corrections)

    def _gyro_samples(
        self, count: int, w_ie_n: Float64, rng: np.random.Generator
    ) -> tuple[Float64, Float64, Float64]:
        """Return drawn biases (count, 3), M (3, 3) and samples (count, 3): w_meas = (I + M) w + b + n."""
        dt, gyros = self.gyro_step_s, self.gyros
        edges = dt * np.arange(2 * count + 1) / 2.0
        w = self.swing.rates(edges) + np.einsum(
            "tji,j->ti", attitude_matrices(self.swing.angles(edges)), w_ie_n
        )
        mean = (w[:-2:2] + 4.0 * w[1:-1:2] + w[2::2]) / 6.0
        errors = np.sqrt(np.diag(gyros.covariance())) * rng.standard_normal(12)
        M = errors[3:].reshape(3, 3, order="F")
        walk = math.sqrt(2.0 * dt / gyros.correlation_s) * gyros.instability_radps
        bias = errors[:3] + np.cumsum(walk * rng.standard_normal((count, 3)), axis=0)
        noise = gyros.random_walk / math.sqrt(dt) * rng.standard_normal((count, 3))
        return bias, M, mean @ (np.eye(3) + M).T + bias + noise


@dataclass(frozen=True)
class History:
    """A run: truth, and the filter's states after each epoch."""

    t: Float64  # (n,) [s]
    C_true: Float64  # (n, 3, 3)
    bias_true: Float64  # (n, 3) [rad/s]
    M_true: Float64  # (3, 3)
    states: list[GyroState]
    corrections: list[PhaseUpdate]

    def attitude_errors(self) -> Float64:
        """Return the attitude errors, rotation vectors in n, (n, 3) [rad]."""
        return np.array(
            [rotation_vector(s.C_nb @ C.T) for s, C in zip(self.states, self.C_true, strict=True)]
        )

    def state_errors(self, k: int) -> Float64:
        """Return the error of all states after epoch ``k``, (15,): estimate minus truth."""
        state = self.states[k]
        psi = rotation_vector(state.C_nb @ self.C_true[k].T)
        M = (state.M - self.M_true).ravel(order="F")
        return np.concatenate([psi, state.bias - self.bias_true[k], M])
