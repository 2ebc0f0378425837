"""The aperture of the angular discriminator: how far an angle may be off before the loop runs to another zero.

Defined as the distance between the two nearest zero crossings of the S-curve on either side of the stable zero, which
are the unstable points, with the other two angles right. This definition reproduces the paper's statistics (13...32
deg and 7...16 deg); from peak to peak it would be half as wide.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.attitude.baselines import (
    AntennaArray,
    Sky,
    angle_index,
    phases_by_euler,
    phases_by_euler_twice,
)
from insgnss.errors import ConfigError
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

# The scan walks in steps in which no phase difference moves by more than this: a sum of sines of such phases that
# crosses zero twice within a step touches it
_PHASE_STEP_RAD: Final = 0.1
_BISECTIONS: Final = 40
_SMALLEST_STEP_RAD: Final = 1e-4


@kernel
def curve_at(x: float, slopes: Float64, bends: Float64, weights: Float64) -> float:
    """Return the S-curve at the offset x of one angle [rad].

    Equation: U(x) = sum_i w_i s_i sin(s_i sin x + d_i (1 - cos x)), s = dpsi/da, d = d2psi/da2; exact, as every psi is
    a constant plus a cosine and a sine of any one angle
    """
    sine, versine = math.sin(x), 1.0 - math.cos(x)
    total = 0.0
    for i in range(slopes.size):
        total += weights[i] * slopes[i] * math.sin(slopes[i] * sine + bends[i] * versine)
    return total


@kernel
def nearest_zeros(slopes: Float64, bends: Float64, weights: Float64, step: float, zeros: Float64) -> None:
    """Write the nearest zeros of S-curves below and above the stable one, +-pi where there is none.

    Parameters
    ----------
    slopes, bends : (n, terms) first and second derivatives of the phase differences of n attitudes
    weights : (terms,) slopes of the discriminators of the phase differences
    step : of the scan [rad]
    zeros : (n, 2) result [rad]
    """
    for k in range(slopes.shape[0]):
        for side in range(2):
            sign = -1.0 if side == 0 else 1.0
            inner, outer = 0.0, step
            while outer < math.pi and sign * curve_at(sign * outer, slopes[k], bends[k], weights) > 0.0:
                inner = outer
                outer += step
            if outer >= math.pi:
                zeros[k, side] = sign * math.pi
                continue
            for _ in range(_BISECTIONS):
                middle = 0.5 * (inner + outer)
                if sign * curve_at(sign * middle, slopes[k], bends[k], weights) > 0.0:
                    inner = middle
                else:
                    outer = middle
            zeros[k, side] = sign * 0.5 * (inner + outer)


@dataclass(frozen=True)
class Apertures:
    """Slopes and apertures of one angle over n attitudes."""

    angle: str
    rpy: Float64  # (n, 3) [rad]
    slope: Float64  # (n,) of the S-curve at the stable zero
    below: Float64  # (n,) offset of the nearest unstable point on the negative side [rad]
    above: Float64  # (n,) on the positive side [rad]
    # (n, k) slopes and bends of the phase differences, which give the whole curve
    terms: tuple[Float64, Float64]

    @property
    def width(self) -> Float64:
        """Return the apertures, (n,) [rad]."""
        return np.asarray(self.above - self.below)

    def interval(self, share: float = 0.95) -> tuple[float, float]:
        """Return the narrowest aperture and the one that ``share`` of the sample stays below [rad], as in the paper."""
        return float(np.nanmin(self.width)), float(np.nanquantile(self.width, share))

    def curves(self, offsets_rad: npt.ArrayLike) -> Float64:
        """Return the S-curves over their slopes at offsets (k,): (n, k) [rad]."""
        x = np.asarray(offsets_rad, np.float64)
        s, d = self.terms
        phase = s[:, :, None] * np.sin(x) + d[:, :, None] * (1.0 - np.cos(x))
        return np.asarray(np.sum(s[:, :, None] * np.sin(phase), axis=1) / self.slope[:, None])


def apertures(
    rpy: npt.ArrayLike, array: AntennaArray, sky: Sky, angle: str = "pitch", S_psi: npt.ArrayLike = 1.0
) -> Apertures:
    """Return slopes and apertures of one angle's discriminator at attitudes (n, 3) [rad].

    An attitude at which no phase difference depends on the angle has no slope, no discriminator and no aperture: nan.

    Raises
    ------
    ConfigError : the angle is none of roll, pitch, yaw
    """
    axis = angle_index(angle)
    attitudes = np.atleast_2d(np.asarray(rpy, np.float64))
    shape = (len(attitudes), -1)
    s = np.ascontiguousarray(phases_by_euler(attitudes, array, sky)[..., axis].reshape(shape))
    d = np.ascontiguousarray(phases_by_euler_twice(attitudes, array, sky)[..., axis].reshape(shape))
    weights = np.broadcast_to(
        np.asarray(S_psi, np.float64), (len(array.baselines_b), len(sky.los_n))
    ).flatten()
    fastest = float(np.max(array.lengths_m) * 2.0 * math.pi / np.min(sky.wavelength_m))
    zeros = np.empty((len(attitudes), 2))
    nearest_zeros(s, d, weights, max(_PHASE_STEP_RAD / fastest, _SMALLEST_STEP_RAD), zeros)
    slope = np.sum(weights * s * s, axis=1)
    zeros[slope <= 0.0] = math.nan
    return Apertures(angle, attitudes, slope, zeros[:, 0], zeros[:, 1], (s, d))


def random_attitudes(count: int, rng: np.random.Generator, law: str = "angles") -> Float64:
    """Return random attitudes, (count, 3) [rad].

    Parameters
    ----------
    law : "angles" for roll and yaw uniform in +-180 deg and pitch in +-90 deg, which gives the paper's statistics;
        "rotations" for all attitudes equally (the sine of the pitch is uniform)
    """
    if count < 1 or law not in ("angles", "rotations"):
        raise ConfigError(
            f"{count} attitudes by the law '{law}'", key="law", advice="give 1 or more; 'angles', 'rotations'"
        )
    rpy = rng.uniform(-math.pi, math.pi, (count, 3))
    rpy[:, 1] = 0.5 * rpy[:, 1] if law == "angles" else np.arcsin(rpy[:, 1] / math.pi)
    return rpy
