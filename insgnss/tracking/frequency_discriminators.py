"""Frequency discriminators of two integrations that follow each other: S-curve, slope and variance in closed form."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from insgnss.tables import Complex, Float64
from insgnss.tracking.admissible import require_known, require_positive
from insgnss.tracking.correlators import frequency_loss
from insgnss.tracking.discriminator_outputs import FREQUENCY_KINDS, outputs
from insgnss.tracking.discriminators import (
    angle_fold,
    noisy_looks,
    phase_harmonics,
    wrapped_mean,
    wrapped_variance,
)


@dataclass(frozen=True)
class FrequencyDiscriminator:
    """One frequency discriminator; offsets in rad/s.

    ``cross`` and ``atan2`` need two integrations of one sign; ``atan`` does not feel the data. Both angles are divided
    by T, so that their outputs are in rad/s; that of ``cross`` has no unit.
    """

    kind: str = "cross"
    integration_s: float = 1e-3

    def __post_init__(self) -> None:
        require_known(self.kind, FREQUENCY_KINDS[1:], "kind", "frequency discriminator")
        require_positive(integration_s=self.integration_s)

    @property
    def pull_in_radps(self) -> float:
        """Return the largest offset that still pulls back: a quarter of 1/T with data, half without.

        Equation: atan: |w T| < pi / 2, so |f| < 1 / (4 T); cross, atan2: |f| < 1 / (2 T)
        """
        return (0.5 if self.kind == "atan" else 1.0) * math.pi / self.integration_s

    def output(self, Z: Complex) -> Float64:
        """Return the outputs of pairs of prompt correlators (..., 2), the earlier one first."""
        scale = 1.0 if self.kind == "cross" else 1.0 / self.integration_s
        return outputs(2, FREQUENCY_KINDS.index(self.kind), Z) * scale

    def mean(self, offset: npt.ArrayLike, a: float) -> Float64:
        """Return the S-curve at frequency offsets [rad/s].

        Equation: cross a^2 sinc^2(w T/2) sin(w T); the angles: mean of a wrapped difference of two phases, whose
                  harmonics are the products c_m c_m of those of each
        """
        w = np.asarray(offset, float)
        power = frequency_loss(w, self.integration_s) ** 2
        if self.kind == "cross":
            return np.asarray(a**2 * power * np.sin(w * self.integration_s))
        return self._of_angle(wrapped_mean, w, a * power) / (angle_fold(self.kind) * self.integration_s)

    def variance(self, offset: npt.ArrayLike, a: float) -> Float64:
        """Return the variance of the output at frequency offsets [rad/s].

        Equation: cross 2 a^3 sinc^2 + 2 a^2
        """
        w = np.asarray(offset, float)
        power = frequency_loss(w, self.integration_s) ** 2
        if self.kind == "cross":
            return np.asarray(2.0 * a**3 * power + 2.0 * a**2)
        return (
            self._of_angle(wrapped_variance, w, a * power) / (angle_fold(self.kind) * self.integration_s) ** 2
        )

    def _of_angle(
        self, moment: Callable[[Float64, npt.ArrayLike], Float64], w: Float64, ratio: Float64
    ) -> Float64:
        """Return a moment of the wrapped angle, folded, at each offset with its own signal ratio."""
        fold = angle_fold(self.kind)
        found = [
            moment(phase_harmonics(0.5 * r, fold) ** 2, fold * x * self.integration_s)
            for x, r in zip(w.ravel(), np.ravel(ratio), strict=True)
        ]
        return np.asarray(found, float).reshape(w.shape)

    def slope(self, a: float) -> float:
        """Return the slope at no offset: of ``cross`` a^2 T [s], of the angles below 1 [-].

        Equation: of a wrapped angle sum_n 2 (-1)^(n+1) c_n^2
        """
        if self.kind == "cross":
            return a**2 * self.integration_s
        harmonics = phase_harmonics(0.5 * a, angle_fold(self.kind)) ** 2
        n = np.arange(1, len(harmonics) + 1)
        return float(np.sum(-2.0 * (-1.0) ** n * harmonics))

    def draw(self, offset: npt.ArrayLike, a: float, looks: int, rng: np.random.Generator) -> Float64:
        """Return simulated outputs, (looks, ...)."""
        w = np.asarray(offset, float)
        size = a * frequency_loss(w, self.integration_s)
        turn = np.exp(0.5j * w * self.integration_s)
        mean = np.stack([size / turn, size * turn], axis=-1)
        return self.output(noisy_looks(mean, a, looks, rng))
