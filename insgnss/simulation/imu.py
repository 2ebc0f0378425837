"""Inertial sensor errors drawn from a grade: turn-on bias, slow bias, white noise, scale factor, range, resolution.

Model per axis: ``measured = (1 + k) true + b_0 + b(t) + n`` with ``k`` and ``b_0`` constant over a run, ``b`` a
stationary first-order Gauss-Markov process and ``n`` white.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from insgnss.config.flight import ImuGrade
from insgnss.constants import STANDARD_GRAVITY_MPS2
from insgnss.tables import Float64
from insgnss.units import (
    deg_per_h_to_radps,
    deg_per_sqrt_h_to_rad_per_sqrt_s,
    deg_to_rad,
    mg_to_mps2,
    mps_per_sqrt_h_to_mps_per_sqrt_s,
    ppm_to_ratio,
)


@dataclass(frozen=True)
class SensorModel:
    """The errors of one triad in SI units; ``per sqrt(s)`` densities are two-sided."""

    turn_on_bias: float  # one sigma [rad/s] or [m/s^2]
    slow_bias: float  # one sigma of the Gauss-Markov process, same unit
    correlation_time_s: float
    random_walk: float  # of the integral: [rad/sqrt(s)] or [m/s/sqrt(s)]
    scale_factor: float  # one sigma [-]
    full_scale: float | None  # readings are clipped to +- this
    resolution: float | None = None  # of an increment: [rad] or [m/s]


@dataclass(frozen=True)
class SensorOutput:
    """What a triad reports, and the bias hidden in it."""

    value: Float64  # (n, 3) mean over each interval
    bias: Float64  # (n, 3) turn-on plus slow bias at the end of each interval
    scale_factor: Float64  # (3,)


def gyro_model(grade: ImuGrade, resolution_rad: float | None = None) -> SensorModel:
    """Return the gyro triad of a grade, SI units."""
    limit = grade.gyro_range_deg_per_s
    return SensorModel(
        turn_on_bias=deg_per_h_to_radps(grade.gyro_bias_deg_per_h),
        slow_bias=deg_per_h_to_radps(grade.gyro_bias_instability_deg_per_h),
        correlation_time_s=grade.gyro_correlation_time_s,
        random_walk=deg_per_sqrt_h_to_rad_per_sqrt_s(grade.gyro_arw_deg_per_sqrt_h),
        scale_factor=ppm_to_ratio(grade.gyro_scale_factor_ppm),
        full_scale=None if limit is None else deg_to_rad(limit),
        resolution=resolution_rad,
    )


def accelerometer_model(grade: ImuGrade, resolution_mps: float | None = None) -> SensorModel:
    """Return the accelerometer triad of a grade, SI units."""
    limit = grade.accel_range_g
    return SensorModel(
        turn_on_bias=mg_to_mps2(grade.accel_bias_mg),
        slow_bias=mg_to_mps2(grade.accel_bias_instability_mg),
        correlation_time_s=grade.accel_correlation_time_s,
        random_walk=mps_per_sqrt_h_to_mps_per_sqrt_s(grade.accel_vrw_mps_per_sqrt_h),
        scale_factor=ppm_to_ratio(grade.accel_scale_factor_ppm),
        full_scale=None if limit is None else limit * STANDARD_GRAVITY_MPS2,
        resolution=resolution_mps,
    )


def gauss_markov(
    count: int, step_s: float, sigma: float, correlation_time_s: float, rng: np.random.Generator
) -> Float64:
    """Return (count, 3) independent stationary first-order Gauss-Markov series, exactly discretised.

    Equation: ``b_k = p b_{k-1} + sigma sqrt(1 - p^2) w_k``, ``p = exp(-step / correlation time)``.
    """
    decay = np.exp(-step_s / correlation_time_s)
    driven = sigma * np.sqrt(-np.expm1(-2.0 * step_s / correlation_time_s)) * rng.standard_normal((count, 3))
    driven[0] = sigma * rng.standard_normal(3)
    return np.asarray(lfilter([1.0], [1.0, -decay], driven, axis=0))


def quantise(mean: Float64, step_s: float, resolution: float) -> Float64:
    """Return interval means as a sensor of increments with this resolution reports them; remainders are carried on."""
    counts = np.rint(np.cumsum(mean, axis=0) * step_s / resolution)
    return np.diff(counts, axis=0, prepend=0.0) * (resolution / step_s)


def measure(true_mean: Float64, step_s: float, model: SensorModel, rng: np.random.Generator) -> SensorOutput:
    """Return what a triad reports for the true interval means of a uniformly sampled flight.

    The mean of white noise over an interval has the deviation ``random_walk / sqrt(step)``. The slow bias is taken as
    constant over one interval: neglects step / correlation time, 1e-5 for 10 ms and 1000 s.

    Parameters
    ----------
    true_mean : (n, 3) true mean rate [rad/s] or specific force [m/s^2] over each interval
    step_s : length of the intervals [s]
    """
    count = len(true_mean)
    scale = model.scale_factor * rng.standard_normal(3)
    bias = model.turn_on_bias * rng.standard_normal(3) + gauss_markov(
        count, step_s, model.slow_bias, model.correlation_time_s, rng
    )
    noise = model.random_walk / np.sqrt(step_s) * rng.standard_normal((count, 3))
    value = (1.0 + scale) * true_mean + bias + noise
    if model.full_scale is not None:
        value = np.clip(value, -model.full_scale, model.full_scale)
    if model.resolution is not None:
        value = quantise(value, step_s, model.resolution)
    return SensorOutput(value, bias, scale)
