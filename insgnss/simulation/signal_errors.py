"""Signal errors beyond noise: reflections, wrong messages, atmosphere that differs from the model.

Each source is a function that draws its part of code and carrier along the whole scenario; the range rate's part is
the derivative of the carrier's. ``ObservationNoise`` and ``Disturbance`` are the forms that a receiver takes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol

import numpy as np

from insgnss.tables import Float64

# Earth's radius over the shell's, 350 km higher up [IS-GPS-200N, 20.3.3.5.2.5]
_IONOSPHERE_SHELL: Final = 0.948
_LOWEST_MAPPED_SINE: Final = 0.05


class ObservationNoise(Protocol):
    """White noise of one kind of observation."""

    def sigma(self, elevation: Float64, cn0_dbhz: Float64) -> Float64:
        """Return sigma for elevations [rad] and C/N0 [dBHz]."""


class PathErrors(NamedTuple):
    """A disturbance of code and carrier of all columns, (m, n) each [m]."""

    code_m: Float64
    carrier_m: Float64


@dataclass(frozen=True)
class SkyGeometry:
    """The sky as disturbances see it: n satellites for each of ``codes`` signals."""

    t_s: Float64  # (m,) true time
    elevation: Float64  # (m, n) [rad]
    direction_e: Float64  # (m, n, 3) unit, towards the satellites
    satellite_r_e: Float64  # (m, n, 3) [m]
    satellite_inertial_v_e: Float64  # (m, n, 3) [m/s]
    codes: int
    wavelength_m: Float64  # (codes n,) of each column
    ionosphere_factor: Float64  # (codes n,) delay of the code over that on L1


class Disturbance(Protocol):
    """A source of errors that is not white noise."""

    def __call__(self, sky: SkyGeometry, rng: np.random.Generator) -> PathErrors:
        """Return one realisation along the whole scenario."""


def markov(t_s: Float64, columns: int, correlation_time_s: float, rng: np.random.Generator) -> Float64:
    """Return (m, columns) independent Gauss-Markov series of unit variance at increasing times."""
    white = rng.standard_normal((len(t_s), columns))
    kept = np.exp(-np.diff(t_s) / correlation_time_s)
    series = white.copy()
    for k, decay in enumerate(kept, start=1):
        series[k] = decay * series[k - 1] + np.sqrt(1.0 - decay**2) * white[k]
    return series


def smooth_markov(t_s: Float64, columns: int, correlation_time_s: float, rng: np.random.Generator) -> Float64:
    """Return (m, columns) series of unit variance with a derivative: a Gauss-Markov process through a lag of its time.

    Equation: ``x`` Gauss-Markov, ``y' = (x - y) / T``; stationary with the covariance ``[[1, 1/2], [1/2, 1/2]]``,
    carried over a step h by ``[[d, 0], [h d / T, d]]``, d = exp(-h / T); ``sqrt(2) y`` is returned, correlated by
    ``(1 + h / T) exp(-h / T)``. A first-order process would shake rates by ``sqrt(2 / (T h))`` of its sigma.
    """
    covariance = np.array([[1.0, 0.5], [0.5, 0.5]])
    white = rng.standard_normal((len(t_s), 2, columns))
    state = np.linalg.cholesky(covariance) @ white[0]
    series = np.empty((len(t_s), columns))
    series[0] = state[1]
    for k, step in enumerate(np.diff(t_s) / correlation_time_s, start=1):
        phi = np.exp(-step) * np.array([[1.0, 0.0], [step, 1.0]])
        state = phi @ state + _step_factor(float(step)) @ white[k]
        series[k] = state[1]
    return np.asarray(np.sqrt(2.0) * series)


def _step_factor(step: float) -> Float64:
    """Return a square root of the covariance that a step of ``step`` correlation times adds to (x, y).

    Equation: the integral of ``2 exp(-2 s) [[1, s], [s, s^2]]`` over 0 to ``step``, by two Gauss nodes, whose vectors
    are the columns of the root. The difference of P and phi P phi^T would lose its digits for small steps.
    Neglects: the fourth derivative of the integrand; 2 % of the variance for a step of three correlation times.
    """
    node, weight = np.polynomial.legendre.leggauss(2)
    s = 0.5 * step * (1.0 + node)
    size = np.sqrt(step * weight * np.exp(-2.0 * s))
    return np.stack([size, size * s])


@dataclass(frozen=True)
class MarkovMultipath:
    """Reflections without a geometry: ``sigma = floor + horizon exp(-elevation / scale)``, each signal its own.

    The defaults of the scenario file are those of an airliner's antenna after smoothing [RTCA DO-229D, J.2.4].
    """

    floor_m: float
    horizon_m: float
    scale_rad: float
    correlation_time_s: float
    carrier_ratio: float

    def __call__(self, sky: SkyGeometry, rng: np.random.Generator) -> PathErrors:
        """Return the errors of all signals."""
        elevation = np.tile(np.maximum(sky.elevation, 0.0), sky.codes)
        sigma = self.floor_m + self.horizon_m * np.exp(-elevation / self.scale_rad)
        code, carrier = (
            sigma * markov(sky.t_s, sigma.shape[1], self.correlation_time_s, rng) for _ in range(2)
        )
        return PathErrors(code, self.carrier_ratio * carrier)


@dataclass(frozen=True)
class SpecularReflection:
    """A plane level mirror below the antenna.

    Equation: with ``p = 2 pi 2 h sin(el) / wavelength`` the carrier is late by ``atan2(a sin p, 1 + a cos p)`` and
    the code, for a delay within its correlation peak, by ``2 h sin(el) a cos p / (1 + a cos p)``   [van Nee (1993)]
    """

    height_m: float
    amplitude: float

    def __call__(self, sky: SkyGeometry, rng: np.random.Generator) -> PathErrors:
        """Return the errors of all signals; nothing is drawn."""
        a = self.amplitude
        longer = np.tile(2.0 * self.height_m * np.sin(np.maximum(sky.elevation, 0.0)), sky.codes)
        phase = 2.0 * np.pi * longer / sky.wavelength_m
        code = longer * a * np.cos(phase) / (1.0 + a * np.cos(phase))
        late = np.arctan2(a * np.sin(phase), 1.0 + a * np.cos(phase))
        return PathErrors(code, late * sky.wavelength_m / (2.0 * np.pi))


@dataclass(frozen=True)
class MessageErrors:
    """Orbits and clocks that are not where the messages say: constant in radial, along, cross axes, one sigma."""

    radial_m: float
    along_m: float
    cross_m: float
    clock_m: float

    def __call__(self, sky: SkyGeometry, rng: np.random.Generator) -> PathErrors:
        """Return the errors of all signals: the offset's part along the line of sight, and the clock's."""
        count = sky.elevation.shape[1]
        size = np.array([self.radial_m, self.along_m, self.cross_m])
        offset = size * rng.standard_normal((count, 3))
        clock = self.clock_m * rng.standard_normal(count)
        radial = sky.satellite_r_e / np.linalg.norm(sky.satellite_r_e, axis=-1, keepdims=True)
        cross = np.cross(sky.satellite_r_e, sky.satellite_inertial_v_e)
        cross /= np.linalg.norm(cross, axis=-1, keepdims=True)
        axes = np.stack([radial, np.cross(cross, radial), cross], axis=-2)  # rows
        moved = np.einsum("nk,mnkc->mnc", offset, axes)
        # the satellite moved away from the receiver makes the range longer; its clock ahead makes it shorter
        longer = np.sum(sky.direction_e * moved, axis=-1) - clock
        both = np.tile(longer, sky.codes)
        return PathErrors(both, both)


@dataclass(frozen=True)
class AirResiduals:
    """What the models of ionosphere and troposphere leave: one zenith value for the sky, mapped to each elevation."""

    ionosphere_m: float  # on L1
    troposphere_m: float
    correlation_time_s: float

    def __call__(self, sky: SkyGeometry, rng: np.random.Generator) -> PathErrors:
        """Return the errors of all signals; the ionosphere turns its sign on the carrier."""
        sine = np.maximum(np.sin(sky.elevation), _LOWEST_MAPPED_SINE)
        at_shell = _IONOSPHERE_SHELL * np.cos(sky.elevation)
        zenith = smooth_markov(sky.t_s, 2, self.correlation_time_s, rng)
        ion = self.ionosphere_m * zenith[:, :1] / np.sqrt(1.0 - at_shell**2)
        trop = np.tile(self.troposphere_m * zenith[:, 1:] / sine, sky.codes)
        ion = np.tile(ion, sky.codes) * sky.ionosphere_factor
        return PathErrors(trop + ion, trop - ion)
