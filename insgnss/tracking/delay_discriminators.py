"""Delay discriminators: S-curve, slope and variance, in closed form but for one integral of the hyperbolic tangent.

Prompt and late minus early have uncorrelated noise, because both outer replicas stand equally far from the prompt one;
so have late plus early and late minus early. All moments follow from those of two independent Gaussian numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy import special

from insgnss.tables import Complex, Float64
from insgnss.tracking.admissible import require_known, require_within
from insgnss.tracking.correlators import EARLY, LATE, PROMPT, Correlators
from insgnss.tracking.discriminator_outputs import DELAY_KINDS, outputs

_STEP_CHIPS: Final = 1e-4  # correlation functions are straight on both sides of +-D/2


@dataclass(frozen=True)
class DelayDiscriminator:
    """One delay discriminator; offsets in chips."""

    kind: str = "product"
    correlators: Correlators = field(default_factory=Correlators)
    phase_rad: float = 0.0  # phase offset, which costs the coherent kinds cos^2
    loss: float = 1.0  # sinc^2: power that a frequency offset leaves

    def __post_init__(self) -> None:
        require_known(self.kind, DELAY_KINDS, "kind", "delay discriminator")
        require_within(1e-6, 1.0, "the loss is the share of power left", loss=self.loss)

    def output(self, Z: Complex) -> Float64:
        """Return the outputs of early, prompt and late correlators (..., 3)."""
        return outputs(0, DELAY_KINDS.index(self.kind), Z)

    def mean(self, offset: npt.ArrayLike, a: float) -> Float64:
        """Return the S-curve at delay offsets [chips].

        Equation: product a^2 cos^2 e_phi rho(e) (rho(e - D/2) - rho(e + D/2))                     [(1.13) = (2.3)]
                  sign, tanh: E[sign I], E[tanh I] times the mean of late minus early
                  power a^2 (rho^2(e - D/2) - rho^2(e + D/2)); dot as product without the cosine
        """
        early, prompt, late = self._means(offset, a)
        split = late - early
        if self.kind == "power":
            return np.asarray(np.abs(late) ** 2 - np.abs(early) ** 2)
        if self.kind == "dot":
            return np.asarray((np.conj(prompt) * split).real)
        return np.asarray(self._decision(prompt.real, a)[0] * split.real)

    def variance(self, offset: npt.ArrayLike, a: float) -> Float64:
        """Return the variance of the output at delay offsets [chips].

        Equation: of X Y, independent: m_x^2 v_y + m_y^2 v_x + v_x v_y; at e = 0 and D of one chip the product has
                  16 q^3 T^3 cos^2 (1 + 1 / (2 q T cos^2))                                                  [(2.4)]
        """
        early, prompt, late = self._means(offset, a)
        split, both = late - early, late + early
        v_split = 2.0 * a * (1.0 - self._rho_spacing)
        if self.kind == "power":
            v_both = 2.0 * a * (1.0 + self._rho_spacing)
            return np.asarray(
                np.abs(both) ** 2 * v_split + np.abs(split) ** 2 * v_both + 2.0 * v_split * v_both
            )
        if self.kind == "dot":
            return np.asarray(np.abs(prompt) ** 2 * v_split + np.abs(split) ** 2 * a + 2.0 * v_split * a)
        first, second = self._decision(prompt.real, a)
        return np.asarray(second * (v_split + split.real**2) - (first * split.real) ** 2)

    def slope(self, a: float) -> float:
        """Return the slope at no offset [1/chip].

        Equation: product 2 s a^2 cos^2, s = -rho'(D/2), 1 per chip of a random code; 8 q^2 T^2 cos^2      [(2.5)]
        """
        m, half = a * math.sqrt(self.loss), 0.5 * self.correlators.spacing_chips
        around = self.correlators.correlation(np.array([half - _STEP_CHIPS, half + _STEP_CHIPS]))
        s = float(around[0] - around[1]) / (2.0 * _STEP_CHIPS)
        if self.kind == "power":
            return 4.0 * m**2 * s * float(self.correlators.correlation(half))
        if self.kind == "dot":
            return 2.0 * m**2 * s
        in_phase = m * math.cos(self.phase_rad)
        return float(self._decision(np.array(in_phase), a)[0]) * 2.0 * s * in_phase

    def draw(self, offset: npt.ArrayLike, a: float, looks: int, rng: np.random.Generator) -> Float64:
        """Return simulated outputs, (looks, ...)."""
        mean = np.stack(self._means(offset, a), axis=-1)
        return self.output(self.correlators.draw(np.broadcast_to(mean, (looks, *mean.shape)), a, rng))

    @property
    def _rho_spacing(self) -> float:
        return float(self.correlators.correlation(self.correlators.spacing_chips))

    def _means(self, offset: npt.ArrayLike, a: float) -> tuple[Complex, Complex, Complex]:
        m = a * math.sqrt(self.loss)
        Z = self.correlators.mean(m, offset, self.phase_rad)
        return Z[..., EARLY], Z[..., PROMPT], Z[..., LATE]

    def _decision(self, mean: Float64, a: float) -> tuple[Float64, Float64]:
        """Return mean and mean square of what the prompt value becomes: I, sign(I) or tanh(I)."""
        mean = np.asarray(mean, float)
        if self.kind == "product":
            return mean, np.asarray(mean**2 + a)
        if self.kind == "sign":
            return np.asarray(special.erf(mean / math.sqrt(2.0 * a))), np.ones(mean.shape)
        return _tanh_moments(mean, a)


def _tanh_moments(mean: Float64, a: float) -> tuple[Float64, Float64]:
    """Return E tanh(I) and E tanh(I)^2 of I with this mean and the variance a, by the trapezoidal rule.

    For a mean of exactly a both are equal, as for every log-likelihood ratio. The rule converges exponentially for
    analytic functions: tanh has its nearest pole at j pi/2, and half a sigma and a quarter leave less than 1e-15.
    """
    sigma = math.sqrt(a)
    step = min(0.5, 0.25 / sigma)
    u = step * np.arange(-math.ceil(9.0 / step), math.ceil(9.0 / step) + 1)
    weights = step * np.exp(-0.5 * u**2) / math.sqrt(2.0 * math.pi)
    values = np.tanh(mean[..., None] + sigma * u)
    return np.asarray(values @ weights), np.asarray(values**2 @ weights)
