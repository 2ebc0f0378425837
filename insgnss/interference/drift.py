"""The density of frequency drift that a phase loop must follow: from records, oscillators, inertial sensors.

Frequency drift is taken for a Wiener process: its increments over T have the variance S T / 2, S the one-sided density
of its rate [rad^2/s^3], of frequency in rad/s at the carrier. All densities here are one-sided; those of inertial
sensors and clocks elsewhere in the package are two-sided and are doubled here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import integrate, optimize, stats

from insgnss.config.flight import ImuGrade, Oscillator
from insgnss.constants import C_MPS, STANDARD_GRAVITY_MPS2
from insgnss.errors import ConfigError
from insgnss.inertial.sensor_model import sensor_model
from insgnss.interference.checks import finite, not_negative, positive
from insgnss.tables import Float64
from insgnss.units import deg_per_h_to_radps, mg_to_mps2

_CARRIER_ADVICE: Final = "give the carrier in hertz, such as 1575.42e6"
_TIME_ADVICE: Final = "give the time between two samples in seconds"
# which part of a Gaussian's largest increment counts as its sigma  [Shatilov 2009, (21)]
_SIGMAS: Final = 3.0
_FEWEST_SAMPLES: Final = 3
# The variance of the difference of two neighbouring means of a Wiener process, over that of its increment
_OF_MEANS: Final = 2.0 / 3.0


class DriftDensity(NamedTuple):
    """A density found in a record, with its confidence interval; one-sided [rad^2/s^3]."""

    density: float
    low: float  # 0 where the rule has no interval
    high: float  # inf where the rule has no interval
    increments: int


class InertialDrift(NamedTuple):
    """The parts of an inertial sensor's drift density; one-sided [rad^2/s^3]."""

    accel_noise: float
    accel_bias: float
    gyro_noise: float
    gyro_bias: float
    tilt: float

    @property
    def total(self) -> float:
        """Sum of the parts, which are independent."""
        return sum(self)


def per_mps(carrier_hz: float) -> float:
    """Return 2 pi f0 / c, what turns range rate [m/s] into frequency [rad/s]."""
    return float(2.0 * math.pi * positive("carrier_hz", carrier_hz, _CARRIER_ADVICE) / C_MPS)


def oscillator_density(greatest_hz: npt.ArrayLike, interval_s: npt.ArrayLike) -> Float64:
    """Return S_osc from the greatest increment of the frequency at the carrier [Hz] over an interval.

    Equation: S_osc = 2 (2 pi df_max / 3)^2 / T_osc                 [Shatilov 2009, (21)]
    """
    T = positive("interval_s", interval_s, _TIME_ADVICE)
    sigma = 2.0 * math.pi * not_negative("greatest_hz", greatest_hz, "give its size in hertz") / _SIGMAS
    return np.asarray(2.0 * sigma * sigma / T)


def ins_density(greatest_mps: npt.ArrayLike, interval_s: npt.ArrayLike, carrier_hz: float) -> Float64:
    """Return S_INS from the greatest increment of the velocity error [m/s] over an interval.

    Equation: S_INS = 2 (2 pi f0 / c dV_max / 3)^2 / T_INS          [Shatilov 2009, (22)]
    """
    T = positive("interval_s", interval_s, _TIME_ADVICE)
    size = not_negative("greatest_mps", greatest_mps, "give its size in m/s")
    return np.asarray(2.0 * (per_mps(carrier_hz) * size / _SIGMAS) ** 2 / T)


def total_density(oscillator: npt.ArrayLike, ins: npt.ArrayLike) -> Float64:
    """Return S = S_INS + S_osc of independent drifts                [Shatilov 2009, (23)]."""
    advice = "a one-sided density in rad^2/s^3"
    return np.asarray(not_negative("oscillator", oscillator, advice) + not_negative("ins", ins, advice))


def density_of_record(
    samples: npt.ArrayLike,
    interval_s: float,
    *,
    per_unit: float = 2.0 * math.pi,
    rule: Literal["variance", "greatest"] = "variance",
    averaged: bool = False,
    noise_sd: float = 0.0,
    confidence: float = 0.95,
) -> DriftDensity:
    """Return S from a record at equal steps: frequency drift of an oscillator or velocity error of an INS.

    Equation: "variance": S = 2 / T (mean of (k dx)^2 - 2 (k sd)^2), n S / S_true ~ chi2(n), increments dx independent
              with a mean of zero; "greatest": S = 2 (k max|dx| / 3)^2 / T          [Shatilov 2009, (21), (22)]
    The paper's rule depends on the length of the record (``greatest_rule_bias``); the variance has no bias.

    Parameters
    ----------
    samples : (n + 1,) in hertz at the carrier, or in m/s with ``per_unit`` = ``per_mps(carrier_hz)``
    averaged : samples are means over the interval (a counter's), whose differences are smaller by 2/3 in variance.
        Neighbouring differences are then correlated by 1/4 and the interval is too narrow by 6 %: it is widened
    noise_sd : one sigma of a sample's measurement noise, which counts as drift otherwise. Taking it out leaves the
        interval that of the drift and noise together: it is scaled with the density

    Raises
    ------
    ConfigError : fewer than 4 samples, one that is not finite, or an interval or confidence that makes no sense
    """
    x = finite("samples", samples, "leave out the samples that are missing, and the increments across them")
    T = float(positive("interval_s", interval_s, _TIME_ADVICE))
    if x.ndim != 1 or len(x) <= _FEWEST_SAMPLES:
        raise ConfigError(
            f"a record of {x.size} samples is too short to show drift",
            key="samples",
            advice="give one row of at least 4; some hundreds for 10 %",
        )
    if not 0.0 < confidence < 1.0:
        raise ConfigError(f"invalid confidence {confidence:g}", key="confidence", advice="0.95, say")
    dx = per_unit * np.diff(x)
    n = len(dx)
    of_means = _OF_MEANS if averaged else 1.0
    if rule == "greatest":
        sigma = np.max(np.abs(dx)) / _SIGMAS
        return DriftDensity(float(2.0 * sigma**2 / T / of_means), 0.0, math.inf, n)
    excess = np.mean(dx * dx) - 2.0 * (per_unit * not_negative("noise_sd", noise_sd, "one sigma")) ** 2
    S = max(float(2.0 * excess / T / of_means), 0.0)
    # correlation r between neighbours leaves n / (1 + 2 r^2) independent squares
    freedom = n / (1.0 + 2.0 * 0.25**2) if averaged else float(n)
    tail = 0.5 * (1.0 - confidence)
    low, high = stats.chi2.ppf([1.0 - tail, tail], freedom)
    return DriftDensity(S, float(freedom * S / low), float(freedom * S / high), n)


def greatest_rule_bias(increments: int) -> float:
    """Return the mean of the paper's max/3 rule over the true S, for a record of n increments.

    Equation: E[max z_i^2] / 9, z_i standard normal: 1/9 int_0^inf 1 - F(x)^n dx, F that of chi2(1)
    """
    if increments < 1:
        raise ConfigError("a record needs an increment", key="increments", advice="give their number")
    value, _ = integrate.quad(
        lambda x: -np.expm1(increments * stats.chi2.logcdf(x, 1)), 0.0, 200.0, limit=200
    )
    return float(value) / _SIGMAS**2


def density_of_walk(h_minus2_per_s: npt.ArrayLike, carrier_hz: float) -> Float64:
    """Return S_osc of random-walk frequency noise.

    Equation: S_osc = 4 pi^2 h_-2 (2 pi f0)^2: fractional frequency has the one-sided density h_-2 / f^2, its rate
              (2 pi f)^2 times as much                              [Brown & Hwang 2012, 9.3: 2 pi^2 h_-2 two-sided]
    """
    h = not_negative("h_minus2_per_s", h_minus2_per_s, "one-sided, in 1/s")
    w0 = 2.0 * math.pi * positive("carrier_hz", carrier_hz, _CARRIER_ADVICE)
    return np.asarray(4.0 * math.pi**2 * h * w0**2)


def phase_walk_of(h0_s: npt.ArrayLike, carrier_hz: float) -> Float64:
    """Return the one-sided density of white frequency noise at the carrier [rad^2/s], which makes the phase walk.

    Equation: S_f = h0 (2 pi f0)^2
    The paper's model has none. The h0 of a clock model for navigation is fitted at seconds and overstates the noise at
    the milliseconds of a loop, for crystals by 20 dB: a phase-noise curve shows more.
    """
    w0 = 2.0 * math.pi * positive("carrier_hz", carrier_hz, _CARRIER_ADVICE)
    return np.asarray(not_negative("h0_s", h0_s, "one-sided, in seconds") * w0**2)


def density_of_allan(deviation: npt.ArrayLike, averaging_s: npt.ArrayLike, carrier_hz: float) -> Float64:
    """Return S_osc of an oscillator whose Allan deviation at one averaging time is all random walk.

    Equation: sigma_y^2 = (2 pi^2 / 3) tau h_-2, so S_osc = 6 (2 pi f0)^2 sigma_y^2 / tau
    Where white or flicker noise has a part in the deviation, it overstates the drift: ``oscillator_of_allan``.
    """
    tau = positive("averaging_s", averaging_s, "give the averaging time in seconds")
    sigma = not_negative("deviation", deviation, "a fraction of the frequency, such as 1e-9")
    w0 = 2.0 * math.pi * positive("carrier_hz", carrier_hz, _CARRIER_ADVICE)
    return np.asarray(6.0 * (w0 * sigma) ** 2 / tau)


def oscillator_of_allan(averaging_s: Sequence[float], deviation: Sequence[float]) -> Oscillator:
    """Return the h-parameters, none negative, that fit a curve of Allan deviations best, relative to each value.

    Equation: sigma_y^2(tau) = h0 / (2 tau) + (2 pi^2 / 3) h_-2 tau     [IEEE Std 1139-2008, table B.2]
    Neglects: flicker frequency noise, the floor between both parts, which is shared out among them.

    Raises
    ------
    ConfigError : fewer than two values, or one that is not above zero
    """
    tau = positive("averaging_s", averaging_s, "give averaging times in seconds")
    variance = positive("deviation", deviation, "fractions of the frequency, such as 1e-9") ** 2
    if tau.ndim != 1 or tau.shape != variance.shape or len(tau) < 2:
        raise ConfigError(
            "a curve of Allan deviations needs two values at least, one for each averaging time",
            key="deviation",
            advice="with one value alone, use density_of_allan",
        )
    parts = np.column_stack([0.5 / tau, 2.0 * math.pi**2 / 3.0 * tau]) / variance[:, None]
    scale = np.linalg.norm(parts, axis=0)
    found, _ = optimize.nnls(parts / scale, np.ones(len(tau)))
    h0, h_minus2 = found / scale
    return Oscillator(h0_s=float(h0), h_minus2_per_s=float(h_minus2), source="fitted to Allan deviations")


def density_of_grade(
    grade: ImuGrade,
    carrier_hz: float,
    *,
    interval_s: float = 1.0,
    calibrated: bool = True,
    tilt_rad: float = 0.0,
    specific_force_mps2: float = STANDARD_GRAVITY_MPS2,
) -> InertialDrift:
    """Return S_INS of a free inertial sensor between two corrections, part by part.

    Equation: S = 2 (2 pi f0 / c)^2 E[dV^2] / T,
              E[dV^2] = N_a^2 T + (b_a T)^2 + f^2 (N_g^2 T^3 / 3 + (b_g T^2 / 2)^2 + (tilt T)^2)
    with N the walks, b the biases, f the specific force that an error of attitude turns; the paper's (22) with the
    increment's variance for (dV_max / 3)^2. Neglects: scale factors and misalignments under acceleration, and the
    line of sight, taken in the plane where the force is turned to.

    Parameters
    ----------
    interval_s : T, from correction to correction: over it biases and tilt stay as they are
    calibrated : the filter knows the constant biases, the instabilities alone are left; else both
    tilt_rad : one sigma of the attitude error across the force at the interval's beginning
    """
    T = float(positive("interval_s", interval_s, _TIME_ADVICE))
    tilt = float(not_negative("tilt_rad", tilt_rad, "one sigma in radians"))
    f2 = float(not_negative("specific_force_mps2", specific_force_mps2, "its size in m/s^2")) ** 2
    model = sensor_model(grade)
    b_a = mg_to_mps2(grade.accel_bias_instability_mg) if calibrated else model.accel_bias.sigma
    b_g = deg_per_h_to_radps(grade.gyro_bias_instability_deg_per_h) if calibrated else model.gyro_bias.sigma
    k = 2.0 * per_mps(carrier_hz) ** 2 / T
    return InertialDrift(
        accel_noise=k * model.accel_density * T,
        accel_bias=k * (b_a * T) ** 2,
        gyro_noise=k * f2 * model.gyro_density * T**3 / 3.0,
        gyro_bias=k * f2 * (0.5 * b_g * T * T) ** 2,
        tilt=k * f2 * (tilt * T) ** 2,
    )
