"""Aiding as an input of the loops: rates of the carrier phase from any source, with its own error, rate and latency.

One interface for an inertial system's Doppler and radial acceleration, for the profile of a planned trajectory and for
a gyro on the spin axis: samples of the rate (and of its derivative) of the carrier phase, rad/s, at times of validity.

A launch or a flight whose trajectory is planned knows its range rates beforehand (``planned_source``). The profile
takes the inertial system's place in the aided loop: its error is a random walk of the rate.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy import interpolate

from insgnss.constants import C_MPS
from insgnss.errors import InputError
from insgnss.tables import Float64
from insgnss.tracking.admissible import require_not_negative, require_positive
from insgnss.tracking.channel_kernel import Aid

_LEAST_POINTS: Final = 4  # of a cubic spline without assumptions at its ends


@dataclass(frozen=True)
class AidingSource:
    """Samples of a source's rate of the carrier phase.

    A source that is known ahead (a plan) is read between its samples; one that arrives (an inertial system) is held
    from its newest sample on, led on by its own acceleration where it has one, and is late by its latency.
    ``error_density`` is what the loops are designed for: the one-sided density of the derivative of its rate's error,
    S_INS of (5) in Shatilov 2009.
    """

    t_s: Float64  # (n,) times of validity, increasing
    rate_radps: Float64  # (n,)
    acceleration_radps2: Float64 | None = None  # (n,)
    latency_s: float = 0.0
    error_density: float = 0.0  # [rad^2/s^3]
    known_ahead: bool = False

    def __post_init__(self) -> None:
        require_not_negative(latency_s=self.latency_s, error_density=self.error_density)
        t, rate = self.t_s, self.rate_radps
        if t.ndim != 1 or len(t) < 1 or rate.shape != t.shape or np.any(np.diff(t) <= 0.0):
            advice = "give one rate for each of strictly increasing times"
            raise InputError("times and rates of the aiding do not fit", key="t_s", advice=advice)
        if not (np.all(np.isfinite(t)) and np.all(np.isfinite(rate))):
            advice = "leave samples out that are not numbers"
            raise InputError("the aiding has a value that is not finite", key="rate_radps", advice=advice)

    def rate_at(self, t_s: npt.ArrayLike) -> Float64:
        """Return the aiding rate at the times [rad/s].

        Equation: newest sample with t_i + latency <= t: y_i + y'_i (t - t_i)

        Raises
        ------
        InputError : before the first sample has arrived, or outside of a profile's span
        """
        t = np.asarray(t_s, float)
        first = self.t_s[0] + (0.0 if self.known_ahead else self.latency_s)
        last = self.t_s[-1] if self.known_ahead else math.inf
        if t.size and (t.min() < first - 1e-9 or t.max() > last + 1e-9):
            raise InputError(
                f"no aiding at {t.min():g} to {t.max():g} s: it reaches from {first:g} to {last:g} s",
                key="t_s",
                advice="begin later, or begin the aiding earlier"
                if t.min() < first
                else "give a longer profile",
            )
        if self.known_ahead:
            return np.asarray(np.interp(t, self.t_s, self.rate_radps))
        # a microsecond: times of validity and of use are sums of decimal fractions
        newest = np.maximum(np.searchsorted(self.t_s + self.latency_s, t + 1e-9, side="right") - 1, 0)
        held = self.rate_radps[newest]
        if self.acceleration_radps2 is None:
            return np.asarray(held)
        return np.asarray(held + self.acceleration_radps2[newest] * (t - self.t_s[newest]))

    def with_errors(self, rng: np.random.Generator, bias_radps: float = 0.0) -> AidingSource:
        """Return the source with a bias and a random walk of its own density added to its rate, as its errors are.

        Equation: d(dw)/dt = xi, one-sided density S: the walk's variance grows by S / 2 each second          [(5)]
        """
        steps = rng.standard_normal(len(self.t_s)) * np.sqrt(
            0.5 * self.error_density * np.diff(self.t_s, prepend=self.t_s[0])
        )
        return AidingSource(
            self.t_s,
            self.rate_radps + bias_radps + np.cumsum(steps),
            self.acceleration_radps2,
            self.latency_s,
            self.error_density,
            self.known_ahead,
        )


def source_from_doppler(
    t_s: npt.ArrayLike,
    doppler_hz: npt.ArrayLike,
    doppler_rate_hz_per_s: npt.ArrayLike | None = None,
    latency_s: float = 0.0,
    error_density: float = 0.0,
) -> AidingSource:
    """Return the source from a navigation engine's aiding: Doppler with the RINEX sign, and its rate.

    Equation: rate = 2 pi f_D
    """
    rate = None if doppler_rate_hz_per_s is None else 2.0 * math.pi * np.asarray(doppler_rate_hz_per_s, float)
    return AidingSource(
        np.asarray(t_s, float), 2.0 * math.pi * np.asarray(doppler_hz, float), rate, latency_s, error_density
    )


def aid_from(sources: Sequence[Sequence[AidingSource]], count: int, step_s: float) -> Aid:
    """Return the loops' aiding: for each channel the sum of its sources at the borders of the integrations.

    Parameters
    ----------
    sources : of each channel; none at all is allowed
    count, step_s : number and length of the integrations, the first of which begins at 0 s of the sources' time
    """
    t = step_s * np.arange(count + 1)
    rate = np.zeros((count + 1, len(sources)))
    for c, own in enumerate(sources):
        for source in own:
            rate[:, c] += source.rate_at(t)
    return Aid(rate, np.zeros_like(rate))


def acceleration_aid(acceleration_radps2: npt.ArrayLike, channels: int) -> Aid:
    """Return the aiding by radial acceleration alone, (n + 1,) or (n + 1, m), which the loop integrates itself."""
    acceleration = np.asarray(acceleration_radps2, float)
    wide = acceleration[:, None] if acceleration.ndim == 1 else acceleration
    full = np.array(np.broadcast_to(wide, (len(wide), channels)))
    return Aid(np.zeros_like(full), full)


def planned_source(
    t_s: npt.ArrayLike,
    range_m: npt.ArrayLike,
    carrier_hz: float,
    error_density: float,
    step_s: float = 1e-3,
    late_s: float = 0.0,
) -> AidingSource:
    """Return the aiding of a planned range over time to one satellite.

    Equation: rate = -2 pi f0 / c dR/dt, R a cubic spline through the plan

    Parameters
    ----------
    t_s, range_m : the plan, (n,)
    carrier_hz : f0
    error_density : one-sided, of the derivative of the rate's error [rad^2/s^3]
    step_s : between the samples of the source
    late_s : by how much the flight is behind the plan

    Raises
    ------
    InputError : too few points, times that do not grow, ranges that are not numbers
    """
    require_positive(carrier_hz=carrier_hz, step_s=step_s)
    t, distance = np.asarray(t_s, float), np.asarray(range_m, float)
    if t.ndim != 1 or t.shape != distance.shape or len(t) < _LEAST_POINTS or np.any(np.diff(t) <= 0.0):
        advice = f"give at least {_LEAST_POINTS} ranges at strictly increasing times"
        raise InputError("the plan is not a valid profile", key="t_s", advice=advice)
    if not (np.all(np.isfinite(t)) and np.all(np.isfinite(distance))):
        raise InputError("the plan has a value that is not finite", key="range_m", advice="leave it out")
    fine = np.linspace(t[0], t[-1], max(2, round((t[-1] - t[0]) / step_s) + 1))
    rate = interpolate.CubicSpline(t, distance)(fine, 1)
    return AidingSource(
        fine + late_s, -2.0 * math.pi * carrier_hz / C_MPS * rate, None, 0.0, error_density, known_ahead=True
    )
