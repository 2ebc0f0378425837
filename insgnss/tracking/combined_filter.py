"""The combined filter of code delay and carrier phase (Surikov 2012, (2.16)-(2.23)), in metres.

State [code range, rate, phase range]: c times delay, its rate, and the delay tau_d = phi / (2 pi f0) that the phase
stands for. One white acceleration-like noise drives the rate; the difference of the two ranges has none of its own
unless ``divergence_density`` gives it some (the ionosphere moves code and phase apart).

Without it the difference is a constant. Its variance falls as 1 / (1 / P0 + k / (D_tau + D_taud)) and never settles, so
the equality of both variances that the steady equations promise holds after infinite time only: the phase range is good
to millimetres at once, the code range to metres after a second and to decimetres after minutes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import linalg

from insgnss.constants import C_MPS
from insgnss.errors import ConfigError
from insgnss.tables import Float64
from insgnss.tracking.admissible import require_not_negative, require_positive, signal_ratio

CODE, RATE, PHASE = 0, 1, 2
_H: Final = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


class SteadyGains(NamedTuple):
    """Gains after infinite time, and the covariances of the two-state filter they come from."""

    gains: Float64  # (3, 2) by state; by code and phase observation
    predicted: Float64  # (3, 3) covariance of the prediction
    filtered: Float64  # (3, 3) after the update


class Variances(NamedTuple):
    """Gains and variances epoch by epoch."""

    gains: Float64  # (n, 3, 2)
    filtered: Float64  # (n, 3, 3)


@dataclass(frozen=True)
class CombinedModel:
    """What the filter assumes.

    ``acceleration_density`` S_xi and ``divergence_density`` are two-sided, as in (2.21); sigma_a^2 / beta is the
    thesis's figure, 2 sigma_a^2 / beta the exact one for an acceleration with the correlation exp(-beta t).
    """

    cn0_dbhz: float
    carrier_hz: float
    chip_hz: float
    acceleration_density: float  # [m^2/s^3]
    integration_s: float = 1e-3
    divergence_density: float = 0.0  # of code minus phase range [m^2/s]

    def __post_init__(self) -> None:
        require_positive(
            carrier_hz=self.carrier_hz, chip_hz=self.chip_hz, acceleration_density=self.acceleration_density
        )
        require_not_negative(divergence_density=self.divergence_density)
        signal_ratio(self.cn0_dbhz, self.integration_s)

    @property
    def wavelength_m(self) -> float:
        """Return the wavelength [m]."""
        return C_MPS / self.carrier_hz

    def noise(self) -> Float64:
        """Return the variances of both equivalent observations [m^2], (2,): code with one chip of spacing, and phase.

        Equation: D_tau = c^2 tau^2 / (4 q T) (1 + 1 / (2 q T)), D_taud = (lambda / 2 pi)^2 / (2 q T) (1 + 1 / (2 q T))
                                                                                        [(2.7), (2.15)]
        """
        a = signal_ratio(self.cn0_dbhz, self.integration_s)
        loss = 1.0 + 1.0 / a
        chip_m = C_MPS / self.chip_hz
        return np.array([chip_m**2 / (2.0 * a), (self.wavelength_m / (2.0 * math.pi)) ** 2 / a]) * loss

    def initial_covariance(self, rate_sd_mps: float, chip_share: float = 1.0 / 24.0) -> Float64:
        """Return the covariance of a start from acquisition, (3, 3) [m^2]: variances, squares of standard deviations.

        Parameters
        ----------
        rate_sd_mps : standard deviation of the rate
        chip_share : standard deviation of both ranges over a chip, 1/24 in the thesis (which leaves out the square)
        """
        require_positive(chip_share=chip_share)
        require_not_negative(rate_sd_mps=rate_sd_mps)
        range_sd_m = chip_share * C_MPS / self.chip_hz
        return np.diag(np.square([range_sd_m, rate_sd_mps, range_sd_m]))

    def transition(self) -> Float64:
        """Return F of (2.16) and (2.17), (3, 3)."""
        F = np.eye(3)
        F[CODE, RATE] = F[PHASE, RATE] = self.integration_s
        return F

    def process(self) -> Float64:
        """Return the covariance that a step adds, (3, 3).

        Equation: G G^T D_xi, G = [0 1 0]^T, D_xi = S_xi T (the print has S_xi = D_xi T, right for a rate that grows by
        T xi)                                                                                      [(2.16), (2.20)]
        """
        density = np.array([self.divergence_density, self.acceleration_density, 0.0])
        return np.diag(density * self.integration_s)

    def steady_variance(self) -> float:
        """Return the variance of both ranges after infinite time, of the continuous filter [m^2].

        Equation: D11 = sqrt(2 sqrt(S_xi S_e^3)), 1 / S_e = 1 / S_tau + 1 / S_taud, S = D T                    [(2.22)]
        """
        information = np.sum(1.0 / (self.noise() * self.integration_s))
        return math.sqrt(2.0 * math.sqrt(self.acceleration_density / information**3))

    def steady_gains(self) -> SteadyGains:
        """Return the gains to which the filter tends.

        Without divergence the difference of code and phase is known in the end, so that both observe one range with
        the variance 1 / (1 / D_tau + 1 / D_taud); with it the three states have a steady covariance of their own.
        """
        D = self.noise()
        if self.divergence_density > 0.0:
            P = linalg.solve_discrete_are(self.transition().T, _H.T, self.process(), np.diag(D))
        else:
            F, h = self.transition()[1:, 1:][::-1, ::-1], np.array([[1.0], [0.0]])
            Q = np.diag([0.0, self.acceleration_density * self.integration_s])
            two = linalg.solve_discrete_are(F.T, h, Q, np.array([[1.0 / np.sum(1.0 / D)]]))
            spread = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 0.0]])
            P = spread @ two @ spread.T
        filtered, gains = _updated(P, D)
        return SteadyGains(gains, P, filtered)

    def variances(self, initial: npt.ArrayLike, count: int) -> Variances:
        """Return gains and covariances from an initial covariance on.

        Equation: K = P~ H^T (H P~ H^T + R)^-1, P = (P~^-1 + H^T R^-1 H)^-1, P~_next = F P F^T + Q      [(2.19), (2.20)]
        The gains are P H^T R^-1: K1 = D11 / D_tau ... K6 = D33 / D_taud (printed as D23).

        Parameters
        ----------
        initial : (3, 3) covariance of the first prediction [m^2]
        """
        P = np.asarray(initial, float)
        if P.shape != (3, 3) or not np.all(np.isfinite(P)) or count < 1:
            advice = "give a (3, 3) covariance of [code, rate, phase] and at least one epoch"
            raise ConfigError("no initial covariance", key="initial", advice=advice)
        F, Q, D = self.transition(), self.process(), self.noise()
        gains, filtered = np.empty((count, 3, 2)), np.empty((count, 3, 3))
        for k in range(count):
            filtered[k], gains[k] = _updated(P, D)
            P = F @ filtered[k] @ F.T + Q
        return Variances(gains, filtered)


def _updated(P: Float64, D: Float64) -> tuple[Float64, Float64]:
    """Return covariance and gains after both observations, in Joseph's form: D_tau is 10^8 times D_taud."""
    K = np.linalg.solve(_H @ P @ _H.T + np.diag(D), _H @ P).T
    left = np.eye(3) - K @ _H
    return np.asarray(left @ P @ left.T + (K * D) @ K.T), np.asarray(K)
