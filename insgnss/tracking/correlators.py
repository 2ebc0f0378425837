"""Correlators without samples: mean and covariance of in-phase and quadrature of early, prompt and late replicas."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.tables import Complex, Float64
from insgnss.tracking.admissible import require_within
from insgnss.tracking.codes import triangle

Correlation = Callable[[npt.ArrayLike], Float64]
EARLY, PROMPT, LATE = 0, 1, 2
# beyond it the outer replicas have left the peak when the prompt one is on it
_SPACING_LIMIT: Final = 2.0


def replica_offsets(spacing_chips: float) -> Float64:
    """Return the delays of the early, prompt and late replica against the prompt one [chips].

    Parameters
    ----------
    spacing_chips : from early to late, 1 in the thesis

    Raises
    ------
    ConfigError : the outer replicas would not be on the peak
    """
    require_within(
        1e-3,
        _SPACING_LIMIT,
        "early and late must both see the peak: 0.1 to 1 is usual",
        spacing_chips=spacing_chips,
    )
    return np.array([-0.5 * spacing_chips, 0.0, 0.5 * spacing_chips])


def frequency_loss(frequency_radps: npt.ArrayLike, integration_s: float) -> Float64:
    """Return the share of amplitude that remains under a frequency offset.

    Equation: sinc(w T / 2), sinc x = sin x / x                                                            [(2.9)]
    """
    return np.asarray(np.sinc(np.asarray(frequency_radps, float) * integration_s / (2.0 * np.pi)))


@dataclass(frozen=True)
class Correlators:
    """A set of replicas and the correlation function they see; early, prompt, late."""

    spacing_chips: float = 1.0
    correlation: Correlation = triangle

    @property
    def offsets(self) -> Float64:
        """Return the replicas' delays [chips], (3,)."""
        return replica_offsets(self.spacing_chips)

    def mean(
        self,
        a: npt.ArrayLike,
        delay_chips: npt.ArrayLike = 0.0,
        phase_rad: npt.ArrayLike = 0.0,
        frequency_radps: npt.ArrayLike = 0.0,
        integration_s: float = 1e-3,
    ) -> Complex:
        """Return the means of the three correlators, (..., 3), of offsets that broadcast.

        Equation: a rho(e_tau - d) sinc(e_w T/2) exp(j (e_phi + e_w T/2))                        [(1.13), (2.9)]
        The phase offset is that at the beginning of the integration, the delay offset that of its middle.
        Neglects: the change of the delay offset within it, below 0.01 chips for 10 ms and 1 kHz of Doppler offset.
        """
        w = np.asarray(frequency_radps, float)
        size = np.asarray(a, float) * frequency_loss(w, integration_s)
        turned = size * np.exp(1j * (np.asarray(phase_rad, float) + 0.5 * w * integration_s))
        return np.asarray(
            turned[..., None] * self.correlation(np.asarray(delay_chips, float)[..., None] - self.offsets)
        )

    def covariance(self, a: float) -> Float64:
        """Return the covariance of the three in-phase values, (3, 3); the same holds for the quadratures.

        Equation: cov(I_i, I_j) = cov(Q_i, Q_j) = a rho(d_i - d_j), cov(I_i, Q_j) = 0
        """
        return np.asarray(a * self.correlation(self.offsets[:, None] - self.offsets[None, :]))

    def noise_factor(self) -> Float64:
        """Return F with F F^T = covariance / a, (3, 3), also where replicas nearly coincide or are uncorrelated."""
        values, vectors = np.linalg.eigh(self.covariance(1.0))
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))

    def draw(self, mean: Complex, a: float, rng: np.random.Generator) -> Complex:
        """Return the means with the noise of one integration each, (..., 3)."""
        white = rng.standard_normal((*mean.shape, 2))
        noise = (white[..., 0] + 1j * white[..., 1]) @ self.noise_factor().T
        return np.asarray(mean + np.sqrt(a) * noise)
