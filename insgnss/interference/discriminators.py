"""Phase discriminators as the margin sees them: aperture, threshold ratio, equivalent noise, true slope.

With coherent in-phase and quadrature sums over T, ``I = cos(e) + n_I``, ``Q = sin(e) + n_Q``, each noise of variance
``1 / (2 q T)``, q the power of the carrier over the one-sided density of interference and noise [Hz].

| name | output | aperture | data bits |
|------|--------|----------|-----------|
| Q | Q | 2 pi | must be absent or wiped off (type 1) |
| atan(Q/I) | atan(Q / I), both quadrants of I alike | pi | allowed (type 2) |
| sign(I)Q | sign(I) Q | pi | allowed |
| IQ | I Q | pi | allowed |

All noise densities are one-sided [rad^2/Hz]: white noise of density S_n has the variance B S_n behind a filter of the
one-sided noise bandwidth B.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy import special

from insgnss.errors import ConfigError
from insgnss.interference.checks import named, positive
from insgnss.tables import Float64

# One number for all of them, good to 0.5 dB of J/S                   [Shatilov 2009, below table 1]
ENGINEERING_RATIO: Final = 0.076
_APERTURES: Final = (2.0 * math.pi, math.pi)
_NODES: Final = 96  # of the integral over the angle: to 1e-10 of the variance
_REACH: Final = 10.0  # sigmas of a strong signal's angle, beyond which nothing is left
TIME_ADVICE: Final = "give the coherent accumulation in seconds, such as 0.01"


@dataclass(frozen=True)
class Discriminator:
    """One phase discriminator; ``threshold_ratio`` is C_A, rms of the linear theory over the aperture at loss of lock.

    Raises
    ------
    ConfigError : the aperture is not 2 pi (type 1) or pi (type 2), or the ratio is none between 0 and 0.5
    """

    name: str
    aperture_rad: float
    threshold_ratio: float

    def __post_init__(self) -> None:
        if not any(math.isclose(self.aperture_rad, known, rel_tol=1e-6) for known in _APERTURES):
            raise ConfigError(
                f"an aperture of {self.aperture_rad:g} rad fits no phase discriminator",
                key="aperture_rad",
                advice="2 pi without data bits (type 1), pi with them (type 2); degrees have to be converted",
            )
        if not 0.0 < self.threshold_ratio < 0.5:
            raise ConfigError(
                f"a threshold ratio of {self.threshold_ratio:g} is out of range",
                key="threshold_ratio",
                advice="rms over aperture: 0.06 to 0.09, 0.5 is the unstable point itself",
            )

    @property
    def type(self) -> int:
        """1: no data, aperture 2 pi; 2: data, aperture pi."""
        return 1 if self.aperture_rad > 1.5 * math.pi else 2

    @property
    def threshold_rms_rad(self) -> float:
        """A_d C_A: the rms of the phase error, by the linear theory, at which lock is lost."""
        return self.aperture_rad * self.threshold_ratio


# Threshold ratios of table 1 [Shatilov 2009]. Simulated (``lock_threshold``), 0.076, 0.069 to 0.078, 0.076 and 0.078
# correspond to a mean time to slip of about 300 / B; the lower value of atan is that of an output whose true slope,
# below one in noise, was left out of the loop's design.
Q: Final = Discriminator("Q", 2.0 * math.pi, 0.076)
ATAN: Final = Discriminator("atan(Q/I)", math.pi, 0.067)
SIGN_I_Q: Final = Discriminator("sign(I)Q", math.pi, 0.076)
I_Q: Final = Discriminator("IQ", math.pi, 0.078)
DISCRIMINATORS: Final = (Q, ATAN, SIGN_I_Q, I_Q)
_ALSO: Final = {"atan": ATAN, "I*Q": I_Q, "sign(I)*Q": SIGN_I_Q}


def discriminator(name: str, threshold_ratio: float | None = None) -> Discriminator:
    """Return a discriminator by name, with the threshold ratio of table 1 or the user's own.

    Raises
    ------
    ModelError : the name is unknown; the advice names the nearest
    ConfigError : the ratio makes no sense
    """
    found = named("phase discriminator", name, [*((d.name, d) for d in DISCRIMINATORS), *_ALSO.items()])
    return found if threshold_ratio is None else replace(found, threshold_ratio=threshold_ratio)


def equivalent_noise(
    kind: Discriminator, inverse_cn0_s: npt.ArrayLike, accumulation_s: npt.ArrayLike
) -> Float64:
    """Return the one-sided density of the white phase noise equivalent to the discriminator's [rad^2/Hz].

    Equation: type 1: S_n = x; type 2: S_n = x (1 + x / (2 T)), x = 1 / q = (J/S) / DF_c + N_0 / C
                                                                    [Shatilov 2009, (19), (20)]
    Neglects: (20) is exact for IQ; sign(I)Q and atan differ from it in noise, by some 10 % at q T = 3 (``true_noise``).

    Parameters
    ----------
    inverse_cn0_s : x [1/Hz], one-sided density of interference and noise over the carrier's power
    accumulation_s : T; of no account to type 1
    """
    x = positive("inverse_cn0_s", inverse_cn0_s, "the density over the power is above zero")
    if kind.type == 1:
        return x
    T = positive("accumulation_s", accumulation_s, TIME_ADVICE)
    return np.asarray(x * (1.0 + x / (2.0 * T)))


def inverse_cn0(kind: Discriminator, noise: npt.ArrayLike, accumulation_s: npt.ArrayLike) -> Float64:
    """Return x = 1 / q [1/Hz] at which the discriminator has the equivalent one-sided noise density ``noise``.

    Equation: type 1: x = S_n; type 2: x = T (sqrt(1 + 2 S_n / T) - 1), in the form without cancellation
                                                                    [inverse of (19), (20)]
    """
    S_n = positive("noise", noise, "a one-sided density in rad^2/Hz is above zero")
    if kind.type == 1:
        return S_n
    T = positive("accumulation_s", accumulation_s, TIME_ADVICE)
    return np.asarray(2.0 * S_n / (np.sqrt(1.0 + 2.0 * S_n / T) + 1.0))


def true_slope(kind: Discriminator, qt: npt.ArrayLike) -> Float64:
    """Return the slope of the mean output over the phase error at zero, in noise; 1 without noise.

    Equation: Q, IQ: 1; sign(I)Q: erf(sqrt(q T)); atan: 1 - exp(-q T)
    The last two follow from d/de of E[sign(cos e + n)] sin e, and from the density of a noisy phasor's angle at the
    discontinuity of the saw-tooth, p(pi/2) = exp(-q T) / (2 pi).

    Parameters
    ----------
    qt : q T, power over noise of one accumulation [-]
    """
    rho = positive("qt", qt, "q T is C/N0 [Hz] times the accumulation [s]")
    if kind.name == SIGN_I_Q.name:
        return np.asarray(special.erf(np.sqrt(rho)))
    if kind.name == ATAN.name:
        return np.asarray(-np.expm1(-rho))
    return np.ones_like(rho)


def true_noise(kind: Discriminator, inverse_cn0_s: npt.ArrayLike, accumulation_s: npt.ArrayLike) -> Float64:
    """Return the one-sided density of a discriminator's phase noise when its output is divided by its true slope.

    Equation: S_n = 2 T var(u) / slope^2 at zero error; var(Q) = s^2, var(sign(I) Q) = s^2, var(I Q) = s^2 (1 + s^2),
              s^2 = 1 / (2 q T); atan: int a^2 p(a) da over half a turn,
              p(a) = e^-r (1 + sqrt(pi r) cos a e^(r cos^2 a) erf(sqrt(r) cos a)) / pi, r = q T
                                                        [density of a noisy phasor's angle, folded: Middleton 1960, 9.2]
    Q gives (19) and IQ gives (20). Against (20) sign(I)Q has at most 12 % less, at q T = 3; atan has 1 % more at 10,
    13 % at 3, 35 % at 1.5.
    """
    x = positive("inverse_cn0_s", inverse_cn0_s, "the density over the power is above zero")
    T = positive("accumulation_s", accumulation_s, TIME_ADVICE)
    rho = T / x
    variance = np.asarray(0.5 / rho)
    if kind.name == I_Q.name:
        variance = variance * (1.0 + variance)
    elif kind.name == ATAN.name:
        variance = _angle_variance(rho)
    return np.asarray(2.0 * T * variance / true_slope(kind, rho) ** 2)


def _angle_variance(rho: Float64) -> Float64:
    """Return the variance of atan(Q / I) around a true angle of zero [rad^2]."""
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    half = np.minimum(0.5 * math.pi, _REACH / np.sqrt(2.0 * rho))[..., None]
    a = half * nodes
    c, r = np.cos(a), rho[..., None]
    density = np.exp(-r) + np.sqrt(math.pi * r) * c * np.exp(-r * np.sin(a) ** 2) * special.erf(
        np.sqrt(r) * c
    )
    return np.asarray(np.sum(weights * half * a * a * density, axis=-1) / math.pi)
