"""Properties common to all discriminators: equivalent noise, linear range, loss of power, and their simulation."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Final, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
from scipy import optimize, special

from insgnss.errors import ConfigError
from insgnss.tables import Complex, Float64

# steps in which the first crossing is looked for: none of the curves turns within one of them
_SCAN: Final = 2000
_BESSEL_SPREAD: Final = 9.0  # harmonics whose size is below exp(-9^2 / 2) of the first are left out


class DiscriminatorModel(Protocol):
    """Mean and variance of an output over an offset, in the discriminator's own unit."""

    def mean(self, offset: npt.ArrayLike, a: float) -> Float64:
        """Return the S-curve at the offsets for the signal ratio a."""

    def variance(self, offset: npt.ArrayLike, a: float) -> Float64:
        """Return the variance of the output."""

    def slope(self, a: float) -> float:
        """Return the derivative of the S-curve at zero."""

    def draw(self, offset: npt.ArrayLike, a: float, looks: int, rng: np.random.Generator) -> Float64:
        """Return outputs simulated from correlators, (looks, ...)."""


class SimulatedOutput(NamedTuple):
    """Mean and variance of simulated outputs, and one sigma of each estimate."""

    mean: Float64
    variance: Float64
    sd_mean: Float64
    sd_variance: Float64


def simulate(
    discriminator: DiscriminatorModel, offset: npt.ArrayLike, a: float, looks: int, rng: np.random.Generator
) -> SimulatedOutput:
    """Return mean and variance of a discriminator's output by simulating its correlators.

    The sigma of the variance follows from the fourth moment of the outputs themselves, as they are not Gaussian.
    """
    drawn = discriminator.draw(offset, a, looks, rng)
    mean = drawn.mean(axis=0)
    square = (drawn - mean) ** 2
    variance = square.mean(axis=0)
    return SimulatedOutput(mean, variance, np.sqrt(variance / looks), square.std(axis=0) / math.sqrt(looks))


def equivalent_variance(discriminator: DiscriminatorModel, a: float) -> float:
    """Return the variance of the equivalent observation: the noise divided by the slope.

    Equation: D = var u / S^2, at no offset                                           [(2.7), (2.12)]

    Raises
    ------
    ConfigError : there is no slope
    """
    slope = discriminator.slope(a)
    if not slope > 0.0:
        raise ConfigError(
            "the discriminator has no slope at zero offset",
            key="cn0_dbhz",
            advice="raise C/N0 or integrate longer",
        )
    return float(discriminator.variance(0.0, a)) / slope**2


def linear_range(discriminator: DiscriminatorModel, a: float, largest: float, share: float = 0.1) -> float:
    """Return the first offset at which the S-curve departs from its slope by a share of the straight line.

    Of -IQ it is 0.39 rad for 10 % (sin 0.8 / 0.8 = 0.897 at 0.4 rad): a limit of linearity, not of tracking, which
    ends at the unstable point pi / 2.

    Parameters
    ----------
    discriminator, a : curve and signal ratio
    largest : where to stop looking
    share : of the straight line
    """
    slope = discriminator.slope(a)

    def excess(x: float) -> float:
        return abs(float(discriminator.mean(x, a)) / (slope * x) - 1.0) - share

    return _first_crossing(excess, largest)


def pull_in_range(discriminator: DiscriminatorModel, a: float, largest: float) -> float:
    """Return the first positive offset at which the S-curve comes back to zero: the unstable point."""
    slope = discriminator.slope(a)
    return _first_crossing(lambda x: -float(discriminator.mean(x, a)) / slope, largest)


def _first_crossing(function: Callable[[float], float], largest: float) -> float:
    """Return the first zero of a function that begins below zero; the largest offset if it stays there."""
    grid = np.linspace(0.0, largest, _SCAN + 1)[1:]
    for low, high in itertools.pairwise(grid):
        if function(high) >= 0.0:
            return float(optimize.brentq(function, low, high)) if function(low) < 0.0 else float(low)
    return largest


def phase_harmonics(g: float, multiple: int = 1) -> Float64:
    """Return c_m = E exp(j m delta), m = multiple, 2 multiple, ...: delta is the phase of a mean in complex noise.

    Equation: c_m = sqrt(pi g) / 2 exp(-g/2) (I_(m-1)/2 (g/2) + I_(m+1)/2 (g/2)), g = |mean|^2 / (2 var of a quadrature)
                                                                    [Blachman 1981, IEEE Trans. IT 27, 120]
    """
    count = int((_BESSEL_SPREAD * math.sqrt(2.0 * g) + 60.0) / multiple) + 1
    m = multiple * np.arange(1.0, count + 1.0)
    half = 0.5 * g
    bessel = special.ive(0.5 * (m - 1.0), half) + special.ive(0.5 * (m + 1.0), half)
    return np.asarray(0.5 * math.sqrt(math.pi * g) * bessel)


def wrapped_mean(harmonics: Float64, angle: npt.ArrayLike) -> Float64:
    """Return the mean of an angle in (-pi, pi] that stands around ``angle`` with the given harmonics.

    Equation: E w = sum_n (2 / n) (-1)^(n+1) c_n sin(n angle)
    """
    n = np.arange(1.0, len(harmonics) + 1.0)
    terms = -2.0 * (-1.0) ** n / n * harmonics
    return np.asarray(np.sin(np.asarray(angle, float)[..., None] * n) @ terms)


def wrapped_variance(harmonics: Float64, angle: npt.ArrayLike) -> Float64:
    """Return the variance of the same angle.

    Equation: E w^2 = pi^2 / 3 + sum_n (4 / n^2) (-1)^n c_n cos(n angle), less (E w)^2
    """
    n = np.arange(1.0, len(harmonics) + 1.0)
    terms = 4.0 * (-1.0) ** n / n**2 * harmonics
    square = math.pi**2 / 3.0 + np.cos(np.asarray(angle, float)[..., None] * n) @ terms
    return np.asarray(square - wrapped_mean(harmonics, angle) ** 2)


def angle_fold(kind: str) -> int:
    """Return how many periods an angle discriminator's output has in a turn: ``atan`` ignores the data's sign."""
    return 2 if kind == "atan" else 1


def noisy_looks(mean: Complex | Float64, a: float, looks: int, rng: np.random.Generator) -> Complex:
    """Return simulated correlators, (looks, ...): their means with white noise of variance a in each part."""
    white = rng.standard_normal((looks, *mean.shape, 2))
    return np.asarray(mean + math.sqrt(a) * (white[..., 0] + 1j * white[..., 1]), np.complex128)
