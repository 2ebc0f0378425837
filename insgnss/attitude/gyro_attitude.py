"""The gyro-aided attitude filter: phase differences of several antennas calibrate MEMS gyros, which carry the attitude.

After A. Yu. Shatilov (2007), attitude unit of four receivers. His state is quaternion, angular rate, bias and the nine
errors of scale and alignment; here the gyros drive the prediction in the place of a state of the rate, and the
quaternion's error is a rotation vector in n, so that no norm has to be kept: 15 states. Between epochs

    q_k = dm* (x) q_(k-1) (x) dlambda(w), dm the Earth's rotation in a step                      [Shatilov 2007]

with w the rate of the body against inertial space in body axes (the thesis's words have it the other way round).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy import stats

from insgnss.attitude.array_observability import gradient, information
from insgnss.attitude.baselines import (
    AntennaArray,
    Sky,
    difference_covariance,
    phase_differences,
    phases_by_rotation,
    wrapped,
)
from insgnss.config.flight import ImuGrade
from insgnss.errors import ConfigError
from insgnss.geodesy.rotations import (
    matrix_to_quaternion,
    quaternion_to_matrix,
    rotation_matrix,
    rotation_vector_quaternion,
    turn_left,
)
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64
from insgnss.tracking.admissible import require_not_negative, require_positive
from insgnss.units import RAD_PER_DEG, S_PER_H, SQRT_S_PER_SQRT_H

N_GYRO_ERRORS: Final = 12  # three biases and nine elements of M, by columns
PSI: Final = slice(0, 3)
BIAS: Final = slice(3, 6)
SCALE: Final = slice(6, 15)  # M by columns: scale factors at 0, 4, 8, misalignments between
N_STATES: Final = 15
_GATE_SHARE: Final = 1e-4  # of right differences that a gate may refuse
# A phase difference gives the attitude only if the whole cycle is known beforehand: half a cycle is five of its
# predicted standard deviations, one row in two million is then taken a cycle off
_SIGMAS_TO_HALF_CYCLE: Final = 5.0


@kernel
def turn_right(q: Float64, x: float, y: float, z: float) -> None:
    """Turn ``q`` (4,) by the rotation vector (x, y, z) [rad] of its own body: q <- q (x) dq."""
    b0, b1, b2, b3 = rotation_vector_quaternion(x, y, z)
    p0, p1, p2, p3 = q[0], q[1], q[2], q[3]
    q[0] = p0 * b0 - p1 * b1 - p2 * b2 - p3 * b3
    q[1] = p0 * b1 + p1 * b0 + p2 * b3 - p3 * b2
    q[2] = p0 * b2 - p1 * b3 + p2 * b0 + p3 * b1
    q[3] = p0 * b3 + p1 * b2 - p2 * b1 + p3 * b0


@kernel
def advance(
    q_nb: Float64,
    w_meas: Float64,
    bias: Float64,
    A: Float64,
    dt: float,
    w_ie_n: Float64,
    last: Float64,
    coupling: Float64,
) -> None:
    """Turn ``q_nb`` by gyro samples, and write how errors of the gyros turn it meanwhile.

    Equation: w = A (w_meas - b), A = (I + M)^-1; rotation vector = w dt + (last x w dt) / 12, the second term the
    coning between two samples; d psi / d [b, vec M] = -sum C_nb A [I, w^T (x) I] dt
    Neglects: the change of C_nb within a sample in the last sum, its second order.

    Parameters
    ----------
    q_nb : (4,) changed in place
    w_meas : (k, 3) mean rates over each sample [rad/s]
    bias, A : (3,), (3, 3) of the gyros as estimated
    dt : length of a sample [s]
    w_ie_n : (3,) Earth's rate in the reference frame, which is fixed to the Earth [rad/s]
    last : (3,) increment of the sample before, changed in place [rad]
    coupling : (3, 12) result: derivatives of the attitude error by bias and by M, by columns
    """
    C = quaternion_matrix(q_nb)
    coupling[:] = 0.0
    turned = coupling[:, :3].copy()
    increment = last.copy()
    for k in range(w_meas.shape[0]):
        for i in range(3):
            increment[i] = 0.0
            for j in range(3):
                increment[i] += A[i, j] * (w_meas[k, j] - bias[j]) * dt
        x = increment[0] + (last[1] * increment[2] - last[2] * increment[1]) / 12.0
        y = increment[1] + (last[2] * increment[0] - last[0] * increment[2]) / 12.0
        z = increment[2] + (last[0] * increment[1] - last[1] * increment[0]) / 12.0
        before = C
        turn_right(q_nb, x, y, z)
        turn_left(q_nb, -w_ie_n[0] * dt, -w_ie_n[1] * dt, -w_ie_n[2] * dt)
        C = quaternion_matrix(q_nb)
        for i in range(3):
            for j in range(3):
                turned[i, j] = 0.0
                for m in range(3):
                    turned[i, j] -= 0.5 * (before[i, m] + C[i, m]) * A[m, j]
        for i in range(3):
            for j in range(3):
                coupling[i, j] += turned[i, j] * dt
                for column in range(3):
                    coupling[i, 3 + 3 * column + j] += turned[i, j] * increment[column]
        last[:] = increment


@kernel
def quaternion_matrix(q: Float64) -> Float64:
    """Return the rotation matrix (3, 3) of unit quaternion ``q`` (4,)."""
    C = np.empty((3, 3))
    quaternion_to_matrix(q, C)
    return C


USED, NOT_SEEN, GATED, AMBIGUOUS = "used", "not seen", "refused by the gate", "whole cycle not known"


@dataclass(frozen=True)
class GyroErrors:
    """Standard deviations of the filter's unknowns, and the noise of the gyros."""

    bias_radps: float
    scale: float  # [-]
    misalignment_rad: float
    random_walk: float  # angle random walk [rad/sqrt(s)]
    instability_radps: float
    correlation_s: float

    def __post_init__(self) -> None:
        require_positive(random_walk=self.random_walk, correlation_s=self.correlation_s)
        require_not_negative(bias_radps=self.bias_radps, scale=self.scale)
        require_not_negative(misalignment_rad=self.misalignment_rad, instability_radps=self.instability_radps)

    def covariance(self) -> Float64:
        """Return the covariance of bias and M before anything is known, (12, 12)."""
        M_sd = np.where(np.eye(3) > 0.0, self.scale, self.misalignment_rad)
        bias = math.hypot(self.bias_radps, self.instability_radps)
        return np.diag(np.square(np.r_[np.full(3, bias), M_sd.ravel(order="F")]))


def gyro_errors(grade: ImuGrade, misalignment_deg: float = 0.5) -> GyroErrors:
    """Return the errors of a grade from ``models/imus``, which state no misalignments; MEMS have about 0.5 deg."""
    return GyroErrors(
        grade.gyro_bias_deg_per_h * RAD_PER_DEG / S_PER_H,
        grade.gyro_scale_factor_ppm * 1e-6,
        misalignment_deg * RAD_PER_DEG,
        grade.gyro_arw_deg_per_sqrt_h * RAD_PER_DEG / SQRT_S_PER_SQRT_H,
        grade.gyro_bias_instability_deg_per_h * RAD_PER_DEG / S_PER_H,
        grade.gyro_correlation_time_s,
    )


@dataclass(frozen=True)
class GyroState:
    """The filter's state; errors are estimate minus truth."""

    q_nb: Float64  # (4,)
    bias: Float64  # (3,) [rad/s]
    M: Float64  # (3, 3) scale factors and misalignments: w_meas = (I + M) w + b + n
    covariance: Float64  # (15, 15) of psi_n, bias, M by columns
    last: Float64 = field(default_factory=lambda: np.zeros(3))  # increment of the newest sample [rad]

    @property
    def C_nb(self) -> Float64:
        """Return the attitude, (3, 3)."""
        C = np.empty((3, 3))
        quaternion_to_matrix(self.q_nb, C)
        return C


@dataclass(frozen=True)
class PhaseUpdate:
    """The status of an epoch's phase differences."""

    status: tuple[str, ...]  # for each signal: used, or why not
    # (N,) chi-square with M - 1 degrees of freedom where the filter is right; nan where not seen
    nis: Float64

    @property
    def n_used(self) -> int:
        """Return how many signals were used."""
        return self.status.count(USED)


@dataclass(frozen=True)
class GyroAttitude:
    """The filter: antennas, gyros, and the Earth's rate in the frame of the attitude.

    ``w_ie_n`` is zero for short times, or the Earth's rate resolved in the frame of the satellites' directions, which
    stands still on the Earth: [0, 0, omega] where that is ECEF.
    """

    array: AntennaArray
    gyros: GyroErrors
    w_ie_n: Float64 = field(default_factory=lambda: np.zeros(3))

    def start(self, C_nb: npt.ArrayLike, sd_rad: float) -> GyroState:
        """Return the first state: an attitude, as from ``two_stage.solve``, and gyros of which nothing is known yet."""
        require_positive("a first attitude from phases is good to 0.1...1 deg", sd_rad=sd_rad)
        q, P = np.empty(4), np.zeros((N_STATES, N_STATES))
        matrix_to_quaternion(np.ascontiguousarray(C_nb, np.float64), q)
        P[PSI, PSI] = sd_rad**2 * np.eye(3)
        P[3:, 3:] = self.gyros.covariance()
        return GyroState(q, np.zeros(3), np.zeros((3, 3)), P)

    def predicted(self, state: GyroState, w_meas: npt.ArrayLike, dt: float) -> GyroState:
        """Return the state after gyro samples (k, 3) [rad/s], each the mean over ``dt``.

        Equation: psi' = -w_ie x psi - C_nb A (db + dM w), P = Phi P Phi^T + Q; the bias walks with 2 sigma^2 / tau

        Raises
        ------
        ConfigError : a sample is not finite
        """
        samples = np.ascontiguousarray(w_meas, np.float64)
        if samples.ndim != 2 or samples.shape[1] != 3 or not np.isfinite(samples).all():
            raise ConfigError(
                "gyro samples are three finite numbers each",
                key="w_meas",
                advice="leave the faulty samples out and predict over the gap with the mean of its neighbours",
            )
        require_positive(dt=dt)
        q, last = state.q_nb.copy(), state.last.copy()
        coupling = np.empty((3, N_GYRO_ERRORS))
        A = np.linalg.inv(np.eye(3) + state.M)
        advance(q, samples, state.bias, np.ascontiguousarray(A), dt, self.w_ie_n, last, coupling)
        T = dt * len(samples)
        Phi = np.eye(N_STATES)
        Phi[PSI, PSI] = rotation_matrix(-self.w_ie_n * T)
        Phi[PSI, 3:] = coupling
        P = Phi @ state.covariance @ Phi.T
        P[PSI, PSI] += self.gyros.random_walk**2 * T * np.eye(3)
        P[BIAS, BIAS] += 2.0 * self.gyros.instability_radps**2 * T / self.gyros.correlation_s * np.eye(3)
        return replace(state, q_nb=q, last=last, covariance=P)

    def corrected(
        self, state: GyroState, phase: npt.ArrayLike, variance_rad2: npt.ArrayLike, sky: Sky
    ) -> tuple[GyroState, PhaseUpdate]:
        """Return the state after the phase differences of an epoch, and the status of each signal.

        Each signal's differences pass the gate together. One whose whole cycle the prediction does not resolve is left
        out, with that reason: after a long loss of all signals start again from ``two_stage.solve``.

        Parameters
        ----------
        phase : (M - 1, N) differences against the first antenna, any whole cycles; nan where not seen [rad]
        variance_rad2 : (M, N) of each antenna's phase
        """
        measured = np.asarray(phase, np.float64)
        C = state.C_nb
        J = phases_by_rotation(C, self.array, sky)
        residual = wrapped(measured - phase_differences(C, self.array, sky))
        R = difference_covariance(variance_rad2)
        S = np.einsum("mni,ij,knj->nmk", J, state.covariance[PSI, PSI], J) + R
        status, nis = _judged(residual, S)
        used = np.array([one == USED for one in status])
        if not used.any():
            return state, PhaseUpdate(status, nis)
        W = np.asarray(np.linalg.inv(R[used]))
        known = information(J[:, used], W)
        slope = gradient(J[:, used], W, residual[:, used])
        # (I + Lambda P)^-1 in the place of a gain over all rows: the same numbers, also where Lambda is singular
        P = state.covariance
        inner = np.linalg.inv(np.eye(3) + known @ P[PSI, PSI])
        step = P[:, PSI] @ inner @ slope  # what to add: the error with the other sign
        after = P - P[:, PSI] @ inner @ known @ P[PSI, :]
        q = state.q_nb.copy()
        turn_left(q, step[0], step[1], step[2])
        M = state.M + step[SCALE].reshape(3, 3, order="F")
        moved = replace(state, q_nb=q, bias=state.bias + step[BIAS], M=M, covariance=0.5 * (after + after.T))
        return moved, PhaseUpdate(status, nis)


def _judged(residual: Float64, S: Float64) -> tuple[tuple[str, ...], Float64]:
    """Return for each signal whether it is used, and its normalised innovation squared."""
    limit = float(stats.chi2.ppf(1.0 - _GATE_SHARE, len(residual)))
    status, nis = [], np.full(residual.shape[1], math.nan)
    for n, own in enumerate(residual.T):
        if not np.isfinite(own).all():
            status.append(NOT_SEEN)
            continue
        nis[n] = own @ np.linalg.solve(S[n], own)
        if _SIGMAS_TO_HALF_CYCLE * math.sqrt(float(np.max(np.diagonal(S[n])))) > math.pi:
            status.append(AMBIGUOUS)
        else:
            status.append(USED if nis[n] <= limit else GATED)
    return tuple(status), nis
