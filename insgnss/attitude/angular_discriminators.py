"""The discriminator of roll, pitch and yaw of the one-stage algorithm, its mean, slope and noise.

V. V. Dneprov, I. V. Korogodin, Analysis of the angular discriminator in a one-stage GNSS attitude algorithm,
Radioengineering 12 (2015); equations by their numbers there. Two discriminators of the phase differences feed it: the
paper's product of pairs, and the gradient of the likelihood of all antennas together.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import special

from insgnss.attitude.baselines import (
    AntennaArray,
    Sky,
    angle_index,
    attitude_matrices,
    phase_differences,
    phases_by_euler,
)
from insgnss.tables import Complex, Float64


def pair_discriminator(Z: Complex, psi: npt.ArrayLike) -> Float64:
    """Return the paper's discriminator of phase differences, (..., M - 1, N).

    Equation: u_psi,mn = Im[z_mn z_1n* exp(-j psi~_mn)], mean S_psi sin(psi - psi~), S_psi = a_m a_1    [(12), (34)]

    Parameters
    ----------
    Z : (..., M, N) correlators
    psi : (..., M - 1, N) predicted phase differences [rad]
    """
    pairs = Z[..., 1:, :] * np.conj(Z[..., :1, :])
    return np.asarray(np.imag(pairs * np.exp(-1j * np.asarray(psi, np.float64))))


def pair_slopes(a: npt.ArrayLike) -> Float64:
    """Return S_psi of correlators with signal ratios a (M, N): (M - 1, N); the paper's (A L / 2)^2."""
    ratio = np.asarray(a, np.float64)
    return np.asarray(ratio[1:] * ratio[:1])


def pair_covariance(a: npt.ArrayLike) -> Float64:
    """Return the covariance of the pair discriminator over its slope, (N, M - 1, M - 1) [rad^2], at no offset.

    Equation: D_psi = 1/a_1 + 1/a_m + 2/(a_1 a_m) = 1/(qT) (1 + 1/(2qT)) for like antennas [(34)]; the off-diagonal
    elements are 1/a_1, as the noise of antenna 1 is in all of them
    """
    ratio = np.asarray(a, np.float64).T  # (N, M)
    first, other = ratio[:, :1], ratio[:, 1:]
    own = 1.0 / other + 2.0 / (first * other)
    return np.asarray(own[:, :, None] * np.eye(other.shape[1]) + 1.0 / first[:, :, None])


def likelihood_discriminator(Z: Complex, psi: npt.ArrayLike) -> Float64:
    """Return the gradient of the log-likelihood of all antennas by the phase differences, (..., M - 1, N) [1/rad].

    Equation: F = ln I0(|s|), s = sum_m z_m exp(-j psi~_m), dF/dpsi_m = I1/I0(|s|) Im[z_m exp(-j psi~_m) s*] / |s|
    The common phase is unknown and uniform. The gradient weighs the baselines by the inverse of their correlated noise:
    to first order it is R^-1 (psi - psi~) with R of ``difference_covariance``.
    """
    predicted = np.asarray(psi, np.float64)
    turned = Z.copy()
    turned[..., 1:, :] *= np.exp(-1j * predicted)
    s = np.sum(turned, axis=-2, keepdims=True)
    size = np.abs(s)
    share = special.i1e(size) / special.i0e(size)
    unit = np.conj(s) / np.where(size > 0.0, size, 1.0)
    return np.asarray(np.imag(turned[..., 1:, :] * unit) * share)


def likelihood_weights(a: npt.ArrayLike) -> Float64:
    """Return the Fisher information of the phase differences of each satellite, (N, M - 1, M - 1) [1/rad^2].

    Equation: W_mk = a_m delta_mk - a_m a_k / sum a, the inverse of diag(1/a_m) + 1/a_1 (all antennas in the sum)
    It bounds any estimate that does not know the common phase.
    """
    ratio = np.asarray(a, np.float64).T  # (N, M)
    other = ratio[:, 1:]
    shared = other[:, :, None] * other[:, None, :] / np.sum(ratio, axis=1)[:, None, None]
    return np.asarray(other[:, :, None] * np.eye(other.shape[1]) - shared)


def partial_discriminators(u_psi: npt.ArrayLike, derivatives: npt.ArrayLike) -> Float64:
    """Return the discriminators of each angle for each baseline and satellite, (..., M - 1, N, 3).

    Equation: u_a,mn = 2 pi / lambda_n k_n^T L_a,m u_psi,mn                                          [(24)]

    Parameters
    ----------
    u_psi : (..., M - 1, N) discriminators of the phase differences
    derivatives : (..., M - 1, N, 3) of the phase differences by the angles
    """
    return np.asarray(np.asarray(derivatives) * np.asarray(u_psi, np.float64)[..., None])


def angular_discriminator(u_psi: npt.ArrayLike, derivatives: npt.ArrayLike) -> Float64:
    """Return the discriminators of roll, pitch and yaw, (..., 3): the sums of the partial ones  [(18), (23), (25)]."""
    return np.asarray(np.sum(partial_discriminators(u_psi, derivatives), axis=(-3, -2)))


def partial_slopes(rpy: npt.ArrayLike, array: AntennaArray, sky: Sky, S_psi: npt.ArrayLike = 1.0) -> Float64:
    """Return the slopes of the partial discriminators, (..., M - 1, N, 3) [1/rad^2].

    Equation: S_a,mn = (2 pi / lambda_n)^2 S_psi (k_n^T L_a,m)^2                                     [(31)]
    """
    J = phases_by_euler(rpy, array, sky)
    return np.asarray(J * J * np.asarray(S_psi, np.float64)[..., None])


def slopes(rpy: npt.ArrayLike, array: AntennaArray, sky: Sky, S_psi: npt.ArrayLike = 1.0) -> Float64:
    """Return the slopes of the discriminators of roll, pitch, yaw, (..., 3)  [(32), (33)]."""
    return np.asarray(np.sum(partial_slopes(rpy, array, sky, S_psi), axis=(-3, -2)))


def discriminator_curve(
    angle: str,
    offsets_rad: npt.ArrayLike,
    rpy: npt.ArrayLike,
    array: AntennaArray,
    sky: Sky,
    S_psi: npt.ArrayLike = 1.0,
) -> Float64:
    """Return the S-curve of one angle: the mean output when the angle is off by ``offsets_rad`` (n,), the others right.

    Equation: U_a = sum_mn 2 pi / lambda_n k_n^T L_a,m(alpha~) S_psi sin(psi_mn(a) - psi_mn(alpha~))    [(27)-(30)]

    Raises
    ------
    ConfigError : the angle is none of roll, pitch, yaw
    """
    axis = angle_index(angle)
    estimate = np.asarray(rpy, np.float64)
    truth = estimate + np.asarray(offsets_rad, np.float64)[:, None] * np.eye(3)[axis]
    away = phase_differences(attitude_matrices(truth), array, sky)
    away -= phase_differences(attitude_matrices(estimate), array, sky)
    weight = phases_by_euler(estimate, array, sky)[..., axis] * np.asarray(S_psi, np.float64)
    return np.asarray(np.sum(weight * np.sin(away), axis=(-2, -1)))


def partial_variances(rpy: npt.ArrayLike, array: AntennaArray, sky: Sky, a: npt.ArrayLike) -> Float64:
    """Return the variance of each partial discriminator's equivalent observation, (M - 1, N, 3) [rad^2].

    Equation: D_a,mn = S_psi / S_a D_psi, inversely proportional to the slope                     [(36), (37)]
    """
    D_psi = np.diagonal(pair_covariance(a), axis1=1, axis2=2).T
    J = phases_by_euler(rpy, array, sky)
    with np.errstate(divide="ignore"):
        return np.asarray(D_psi[..., None] / (J * J))


def angular_noise(rpy: npt.ArrayLike, array: AntennaArray, sky: Sky, a: npt.ArrayLike) -> Float64:
    """Return the covariance of the three discriminators fed by pairs, (3, 3), with the noise that baselines share.

    Equation: J^T S R S J. The sum over (37) alone, which the paper stops at, leaves out the shared antenna.
    """
    weight = phases_by_euler(rpy, array, sky) * pair_slopes(a)[..., None]
    return np.asarray(np.einsum("mni,nmk,knj->ij", weight, pair_covariance(a), weight))
