"""Prompt correlators of all antennas, without samples: means, noise, and the phase differences taken from them.

Scaled as in ``insgnss.tracking``: a matched correlator has the mean a = 2 q T, and each of its quadratures the
variance a; the noises of the antennas are independent. One row per antenna, one column per signal.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from insgnss.errors import ConfigError
from insgnss.tables import Complex, Float64
from insgnss.tracking.admissible import signal_ratio


def signal_ratios(cn0_dbhz: npt.ArrayLike, integration_s: float) -> Float64:
    """Return a = 2 q T of C/N0 values of any shape [-].

    Raises
    ------
    ConfigError : C/N0 or the integration time make no sense
    """
    values = np.asarray(cn0_dbhz, np.float64)
    ratios = [signal_ratio(float(value), integration_s) for value in values.ravel()]
    return np.asarray(ratios, np.float64).reshape(values.shape)


def draw_correlators(psi: npt.ArrayLike, a: npt.ArrayLike, rng: np.random.Generator) -> Complex:
    """Return one integration's prompt correlators, (..., M, N); the phase of the first antenna is any, uniform.

    Equation: z_mn = a exp(j (phi_n + psi_mn)) + noise, psi_1n = 0

    Parameters
    ----------
    psi : (..., M - 1, N) phase differences [rad]
    a : (M, N) signal ratios, or one for all
    """
    psi = np.asarray(psi, np.float64)
    first = np.zeros_like(psi[..., :1, :])
    phase = np.concatenate([first, psi], axis=-2)
    phase = phase + rng.uniform(-np.pi, np.pi, first.shape)
    size = np.broadcast_to(np.asarray(a, np.float64), phase.shape)
    noise = rng.standard_normal((*phase.shape, 2))
    return np.asarray(size * np.exp(1j * phase) + np.sqrt(size) * (noise[..., 0] + 1j * noise[..., 1]))


def measured_differences(Z: Complex) -> Float64:
    """Return the phase differences of correlators against the first antenna, (..., M - 1, N) in (-pi, pi] [rad]."""
    return np.asarray(np.angle(Z[..., 1:, :] * np.conj(Z[..., :1, :])))


def phase_variances(a: npt.ArrayLike) -> Float64:
    """Return the variance of the phase of a correlator, of any shape [rad^2].

    Equation: 1 / a = 1 / (2 q T)                                                    [(2.15) of Surikov 2012]
    Neglects: what the angle of a noisy vector adds, a share 1 / (2 a).
    """
    ratio = np.asarray(a, np.float64)
    if not (np.isfinite(ratio) & (ratio > 0.0)).all():
        raise ConfigError("a signal ratio must be above 0", key="a", advice="give 2 q T of each correlator")
    return np.asarray(1.0 / ratio)
