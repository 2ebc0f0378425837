"""Inertial samples of a receiver study that are missing or saturated.

While samples are missing the newest one is held. Rate and force change meanwhile as Gauss-Markov processes. The
difference from the held sample enters the filter as white noise whose integral has the same variance since the gap's
begin, with a = t / tau

    var = sigma^2 tau^2 [2 (a - 1 + e^-a) - 2 a (1 - e^-a) + a^2],    q(t) = d var / dt = 2 sigma^2 t (1 - e^-a)

A tenth of a second leaves an angle of 0.7 deg (0.5 rad/s, 1 s) where white noise of the motion's density 2 sigma^2 tau
would leave 13 deg, for which the filter's equations are not linear any more. The motion in the axes of a saturated
sensor has that density, as the reading says nothing of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from insgnss.config.flight import ImuGrade
from insgnss.constants import STANDARD_GRAVITY_MPS2
from insgnss.errors import ConfigError
from insgnss.simulation.closed_loop_sky import InertialAiding
from insgnss.tables import Float64
from insgnss.units import RAD_PER_DEG

TURNING: Final = (0.5, 1.0)  # one sigma of an unknown rate on each axis [rad/s], and its correlation time [s]
_FULL: Final = 0.999  # of the range: a saturated reading
_ROUNDING: Final = 1e-9  # of an integration


@dataclass(frozen=True)
class UnknownMotion:
    """The acceleration, or the angular rate, that no INS measures, on each axis: a Gauss-Markov process."""

    sigma: float = 49.03  # [m/s^2], [rad/s] of a rate
    time_s: float = 1.0 / 0.3

    @property
    def density(self) -> float:
        """Return the density of the white noise that moves as far in the end [m^2/s^3], [rad^2/s]."""
        return 2.0 * self.sigma**2 * self.time_s

    def density_since(self, held_s: Float64) -> Float64:
        """Return the density of white noise that grows as the change since a sample was held does, as ``density``.

        Equation: q(t) = 2 sigma^2 t (1 - exp(-t / tau))
        """
        return np.asarray(-2.0 * self.sigma**2 * held_s * np.expm1(-held_s / self.time_s))


def with_gaps(
    aiding: InertialAiding,
    since_s: Float64,
    grade: ImuGrade,
    gaps_s: Sequence[tuple[float, float]],
    unknown: UnknownMotion,
) -> tuple[InertialAiding, Float64]:
    """Return the aiding with samples missing, and the densities of the motion in the gaps, (n, 2).

    Parameters
    ----------
    since_s : (n,) from the first integration on
    gaps_s : begin and end of each gap
    """
    missing = np.zeros(len(since_s), np.bool_)
    for begin_s, end_s in gaps_s:
        missing |= (since_s >= begin_s) & (since_s < end_s)
    held = np.maximum.accumulate(np.where(missing, 0, np.arange(len(since_s))))
    rate, force = aiding.rate_b[held], aiding.force_b[held]
    ahead = np.where(missing[:, None], 0.0, aiding.ahead_b)  # a replica is led on by the sample that is held
    densities = np.zeros((len(since_s), 2))
    turning = UnknownMotion(*TURNING)
    densities[_is_full(rate, grade.gyro_range_deg_per_s, RAD_PER_DEG), 0] = turning.density
    densities[_is_full(force, grade.accel_range_g, STANDARD_GRAVITY_MPS2), 1] = unknown.density
    since_held_s = (since_s - since_s[held])[missing]
    for column, motion in enumerate((turning, unknown)):
        densities[missing, column] = np.maximum(
            densities[missing, column], motion.density_since(since_held_s)
        )
    return InertialAiding(rate, force, ahead), densities


def _is_full(values: Float64, limit: float | None, unit: float) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return where any axis is saturated, (n,)."""
    if limit is None:
        return np.zeros(len(values), np.bool_)
    return np.asarray((np.abs(values) >= _FULL * limit * unit).any(axis=1))


def require_gaps(gaps_s: Any, duration_s: float, step_s: float) -> None:
    """Refuse gaps that are none.

    Raises
    ------
    ConfigError : one that ends before it begins, lies outside of the study, or between two integrations
    """
    if isinstance(gaps_s, str) or not isinstance(gaps_s, Sequence | np.ndarray):
        advice = "give pairs of begin and end [s], as ((50.0, 50.2),); () for none"
        raise ConfigError(f"{gaps_s!r} is not a list of gaps", key="imu_gaps_s", advice=advice)
    for gap in gaps_s:
        try:
            begin_s, end_s = (float(edge) for edge in gap)
        except (TypeError, ValueError):
            advice = "give pairs of begin and end [s], as ((50.0, 50.2),)"
            raise ConfigError(f"{gap!r} is not a gap", key="imu_gaps_s", advice=advice) from None
        if not 0.0 < begin_s < end_s <= duration_s:
            raise ConfigError(
                f"a gap from {begin_s:g} to {end_s:g} s",
                key="imu_gaps_s",
                advice=f"give pairs of begin and end within {duration_s:g} s, after the first integration",
            )
        if not math.ceil(begin_s / step_s - _ROUNDING) * step_s < end_s:
            raise ConfigError(
                f"no integration of {step_s:g} s falls into the gap from {begin_s:g} to {end_s:g} s",
                key="imu_gaps_s",
                advice=f"give a gap of {step_s:g} s at least",
            )
