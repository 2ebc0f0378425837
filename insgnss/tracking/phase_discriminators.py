"""Phase discriminators: S-curve, slope and variance in closed form.

``q`` needs a signal without data, and ``atan2`` too (aperture 2 pi); ``iq``, ``sign`` and ``atan`` do not feel the sign
of the data (aperture pi).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import special

from insgnss.tables import Complex, Float64
from insgnss.tracking.admissible import require_known, require_within
from insgnss.tracking.discriminator_outputs import PHASE_KINDS, outputs
from insgnss.tracking.discriminators import (
    angle_fold,
    noisy_looks,
    phase_harmonics,
    wrapped_mean,
    wrapped_variance,
)


@dataclass(frozen=True)
class PhaseDiscriminator:
    """One phase discriminator.

    The offset is the mean phase offset over the integration: where the frequency is off by w it is the phase at
    e_phi + w T/2, so that the zero crossing in terms of e_phi shifts to -w T/2.
    """

    kind: str = "iq"
    loss: float = 1.0  # p = rho^2 sinc^2: power that delay and frequency offsets leave

    def __post_init__(self) -> None:
        require_known(self.kind, PHASE_KINDS, "kind", "phase discriminator")
        require_within(1e-6, 1.0, "the loss is the share of power left", loss=self.loss)

    @property
    def aperture_rad(self) -> float:
        """Return the distance between two stable points."""
        return 2.0 * math.pi if self.kind in ("q", "atan2") else math.pi

    def output(self, prompt: Complex) -> Float64:
        """Return the outputs of prompt correlators, same shape."""
        return outputs(1, PHASE_KINDS.index(self.kind), np.asarray(prompt, np.complex128)[..., None])

    def mean(self, offset: npt.ArrayLike, a: float) -> Float64:
        """Return the S-curve at phase offsets [rad].

        Equation: iq (a^2 p / 2) sin 2 e (2.9); q a sqrt(p) sin e; sign erf(sqrt(a p / 2) cos e) a sqrt(p) sin e;
                  atan, atan2: mean of the wrapped phase by its harmonics
        """
        e = np.asarray(offset, float)
        m = a * math.sqrt(self.loss)
        if self.kind == "iq":
            return np.asarray(0.5 * m**2 * np.sin(2.0 * e))
        if self.kind == "q":
            return np.asarray(m * np.sin(e))
        if self.kind == "sign":
            return np.asarray(self._sign_mean(e, a) * m * np.sin(e))
        return wrapped_mean(self._harmonics(a), angle_fold(self.kind) * e) / angle_fold(self.kind)

    def variance(self, offset: npt.ArrayLike, a: float) -> Float64:
        """Return the variance of the output at phase offsets [rad].

        Equation: iq a^3 p + a^2 (2.10), whatever the offset; q a; sign a + (a^2 p sin^2 e)(1 - erf^2)
        """
        e = np.asarray(offset, float)
        m = a * math.sqrt(self.loss)
        if self.kind == "iq":
            return np.asarray(np.full(e.shape, a * m**2 + a**2))
        if self.kind == "q":
            return np.asarray(np.full(e.shape, a))
        if self.kind == "sign":
            return np.asarray(a + (m * np.sin(e)) ** 2 * (1.0 - self._sign_mean(e, a) ** 2))
        return wrapped_variance(self._harmonics(a), angle_fold(self.kind) * e) / angle_fold(self.kind) ** 2

    def slope(self, a: float) -> float:
        """Return the slope at no offset [1/rad].

        Equation: iq a^2 p (2.11); q a sqrt(p); sign erf(sqrt(a p / 2)) a sqrt(p); with g = a p / 2
                  atan 1 - exp(-g); atan2 1 - exp(-g) + sqrt(pi g) erfc(sqrt(g))
        """
        m, g = a * math.sqrt(self.loss), 0.5 * a * self.loss
        if self.kind == "iq":
            return m**2
        if self.kind == "q":
            return m
        if self.kind == "sign":
            return math.erf(math.sqrt(g)) * m
        if self.kind == "atan":
            return -math.expm1(-g)
        return -math.expm1(-g) + math.sqrt(math.pi * g) * math.erfc(math.sqrt(g))

    def draw(self, offset: npt.ArrayLike, a: float, looks: int, rng: np.random.Generator) -> Float64:
        """Return simulated outputs, (looks, ...)."""
        mean = a * math.sqrt(self.loss) * np.exp(1j * np.asarray(offset, float))
        return self.output(noisy_looks(mean, a, looks, rng))

    def _harmonics(self, a: float) -> Float64:
        return phase_harmonics(0.5 * a * self.loss, angle_fold(self.kind))

    def _sign_mean(self, e: Float64, a: float) -> Float64:
        return np.asarray(special.erf(math.sqrt(0.5 * a * self.loss) * np.cos(e)))
