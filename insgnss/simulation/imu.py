"""Inertial sensor errors drawn from a grade: bias, noise, scale, misalignment, bandwidth, range, resolution.

Model of a triad: ``measured = (I + K + M) s + G f + b_0 + b(t) + n``: ``s`` the true input after the sensor's
bandwidth, ``K`` (scale factors), ``M`` (misalignments, off the diagonal), ``G`` (a gyro's sensitivity to specific
force) and ``b_0`` constant over a run, ``b`` a stationary first-order Gauss-Markov process plus a random walk, ``n``
white. Noise is that of the sensor's output: the bandwidth does not shape it. Between sensor and file (``ImuRecord``)
time tags jitter and samples are lost.

A vibration is a spectrum of broad noise and lines, as means over sampling intervals. What lies above half
the sampling rate is not left out but folded down, as in a sensor that integrates over its interval without a filter
before. The vehicle's own place and attitude do not follow: 1 g at 50 Hz moves 0.1 mm. Of a body that spins the folded
part does not average out: what lies a rate of spin beside a multiple of the sampling rate turns back into a steady
force, which walks. 8e-4 g^2/Hz at 200 Hz and 720 deg/s leave 1.0e-5 m^2/s^3 across the axis of spin.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.signal import butter, lfilter, lfilter_zi

from insgnss.config.flight import ImuGrade
from insgnss.constants import NS_PER_S, STANDARD_GRAVITY_MPS2
from insgnss.errors import ConfigError
from insgnss.simulation.course import smoothstep
from insgnss.tables import Bool, Float64, ImuTable
from insgnss.units import (
    SQRT_S_PER_SQRT_H,
    deg_per_h_to_radps,
    deg_per_sqrt_h_to_rad_per_sqrt_s,
    deg_to_rad,
    mg_to_mps2,
    mps_per_sqrt_h_to_mps_per_sqrt_s,
    ppm_to_ratio,
)

_MOST_OF_A_STEP: Final = 0.45  # the largest jitter: tags never change their order
_FINER: Final = 4  # samples of a period at least, and of an interval: their mean represents the interval's
RISE_S: Final = 0.5  # of its begin and end: cut off at once it would leave a step of the velocity
_MOST_VALUES: Final = 60_000_000  # of the finer series that the interval means are taken from


@dataclass(frozen=True)
class TriadErrorModel:
    """The errors of one triad in SI units; ``per sqrt(s)`` densities are two-sided."""

    turn_on_bias: float  # one sigma [rad/s] or [m/s^2]
    slow_bias: float  # one sigma of the Gauss-Markov process, same unit
    correlation_time_s: float
    random_walk: float  # of the integral: [rad/sqrt(s)] or [m/s/sqrt(s)]
    scale_factor: float  # one sigma [-]
    full_scale: float | None  # readings are clipped to +- this
    resolution: float | None = None  # of an increment: [rad] or [m/s]
    bias_random_walk: float = 0.0  # of the bias itself: [rad/s/sqrt(s)] or [m/s^2/sqrt(s)]
    misalignment: float = 0.0  # one sigma of each axis against the other two [rad]
    g_sensitivity: float = 0.0  # one sigma of each element [(rad/s)/(m/s^2)]
    bandwidth_hz: float | None = None  # -3 dB of the input


@dataclass(frozen=True)
class SensorOutput:
    """A triad's output, and the bias hidden in it."""

    value: Float64  # (n, 3) mean over each interval
    bias: Float64  # (n, 3) turn-on plus slow bias at the end of each interval
    scale_factor: Float64  # (3,)


def gyro_model(grade: ImuGrade, resolution_rad: float | None = None) -> TriadErrorModel:
    """Return the gyro triad of a grade, SI units."""
    limit = grade.gyro_range_deg_per_s
    return TriadErrorModel(
        turn_on_bias=deg_per_h_to_radps(grade.gyro_bias_deg_per_h),
        slow_bias=deg_per_h_to_radps(grade.gyro_bias_instability_deg_per_h),
        correlation_time_s=grade.gyro_correlation_time_s,
        random_walk=deg_per_sqrt_h_to_rad_per_sqrt_s(grade.gyro_arw_deg_per_sqrt_h),
        scale_factor=ppm_to_ratio(grade.gyro_scale_factor_ppm),
        full_scale=None if limit is None else deg_to_rad(limit),
        resolution=resolution_rad or deg_to_rad(grade.gyro_quantisation_deg) or None,
        bias_random_walk=deg_per_h_to_radps(grade.gyro_rate_random_walk_deg_per_h_per_sqrt_h)
        / SQRT_S_PER_SQRT_H,
        misalignment=1e-3 * grade.gyro_misalignment_mrad,
        g_sensitivity=deg_per_h_to_radps(grade.gyro_g_sensitivity_deg_per_h_per_g) / STANDARD_GRAVITY_MPS2,
        bandwidth_hz=grade.gyro_bandwidth_hz,
    )


def accelerometer_model(grade: ImuGrade, resolution_mps: float | None = None) -> TriadErrorModel:
    """Return the accelerometer triad of a grade, SI units."""
    limit = grade.accel_range_g
    return TriadErrorModel(
        turn_on_bias=mg_to_mps2(grade.accel_bias_mg),
        slow_bias=mg_to_mps2(grade.accel_bias_instability_mg),
        correlation_time_s=grade.accel_correlation_time_s,
        random_walk=mps_per_sqrt_h_to_mps_per_sqrt_s(grade.accel_vrw_mps_per_sqrt_h),
        scale_factor=ppm_to_ratio(grade.accel_scale_factor_ppm),
        full_scale=None if limit is None else limit * STANDARD_GRAVITY_MPS2,
        resolution=resolution_mps or grade.accel_quantisation_mps or None,
        bias_random_walk=mg_to_mps2(grade.accel_random_walk_mg_per_sqrt_h) / SQRT_S_PER_SQRT_H,
        misalignment=1e-3 * grade.accel_misalignment_mrad,
        bandwidth_hz=grade.accel_bandwidth_hz,
    )


def gauss_markov(
    count: int,
    step_s: float,
    sigma: float,
    correlation_time_s: float,
    rng: np.random.Generator,
    *,
    from_zero: bool = False,
) -> Float64:
    """Return (count, 3) independent first-order Gauss-Markov series, exactly discretised; stationary, or from zero on.

    Equation: ``b_k = p b_{k-1} + sigma sqrt(1 - p^2) w_k``, ``p = exp(-step / correlation time)``.
    """
    decay = np.exp(-step_s / correlation_time_s)
    driven = sigma * np.sqrt(-np.expm1(-2.0 * step_s / correlation_time_s)) * rng.standard_normal((count, 3))
    driven[0] = 0.0 if from_zero else sigma * rng.standard_normal(3)
    return np.asarray(lfilter([1.0], [1.0, -decay], driven, axis=0))


def quantise(mean: Float64, step_s: float, resolution: float) -> Float64:
    """Return interval means as a sensor of increments with this resolution reports them; remainders are carried on."""
    counts = np.rint(np.cumsum(mean, axis=0) * step_s / resolution)
    return np.diff(counts, axis=0, prepend=0.0) * (resolution / step_s)


def low_pass(values: Float64, step_s: float, bandwidth_hz: float) -> Float64:
    """Return series (n, 3) after a Butterworth filter of second order, settled on the first value.

    A bandwidth at or above half the sampling rate changes nothing: the interval means themselves pass no more.
    """
    if bandwidth_hz * step_s >= 0.5:
        return values
    b, a = butter(2, 2.0 * bandwidth_hz * step_s)
    settled = lfilter_zi(b, a)[:, None] * values[0]
    return np.asarray(lfilter(b, a, values, axis=0, zi=settled)[0])


def measure(
    true_mean: Float64,
    step_s: float,
    model: TriadErrorModel,
    rng: np.random.Generator,
    *,
    force: Float64 | None = None,
    shaking: Float64 | None = None,
) -> SensorOutput:
    """Return a triad's output for the true interval means of a uniformly sampled flight.

    The mean of white noise over an interval has the deviation ``random_walk / sqrt(step)``. The slow bias is taken as
    constant over one interval: neglects step / correlation time, 1e-5 for 10 ms and 1000 s.

    Parameters
    ----------
    true_mean : (n, 3) true mean rate [rad/s] or specific force [m/s^2] over each interval
    step_s : length of the intervals [s]
    force : (n, 3) true mean specific force that disturbs gyros [m/s^2]
    shaking : (n, 3) vibration added to the input
    """
    count = len(true_mean)
    scale = model.scale_factor * rng.standard_normal(3)
    bias = model.turn_on_bias * rng.standard_normal(3) + gauss_markov(
        count, step_s, model.slow_bias, model.correlation_time_s, rng
    )
    noise = model.random_walk / np.sqrt(step_s) * rng.standard_normal((count, 3))
    felt = true_mean if shaking is None else true_mean + shaking
    if model.bandwidth_hz is not None:
        felt = low_pass(felt, step_s, model.bandwidth_hz)
    if model.bias_random_walk > 0.0:
        steps = model.bias_random_walk * np.sqrt(step_s) * rng.standard_normal((count, 3))
        bias = bias + np.cumsum(steps, axis=0)
    value = (1.0 + scale) * felt + bias + noise
    if model.misalignment > 0.0:
        across = model.misalignment * rng.standard_normal((3, 3)) * (1.0 - np.eye(3))
        value = value + felt @ across.T
    if model.g_sensitivity > 0.0 and force is not None:
        value = value + force @ (model.g_sensitivity * rng.standard_normal((3, 3))).T
    if model.full_scale is not None:
        value = np.clip(value, -model.full_scale, model.full_scale)
    if model.resolution is not None:
        value = quantise(value, step_s, model.resolution)
    return SensorOutput(value, bias, scale)


@dataclass(frozen=True)
class ImuRecord:
    """How a log is written: deviation of its tags, and how many of its samples are missing."""

    tag_jitter_s: float = 0.0  # one sigma, white
    lost_share: float = 0.0  # of the samples, on average
    lost_at_once: int = 1  # neighbouring samples that are lost together

    def log(self, imu: ImuTable, rng: np.random.Generator) -> tuple[ImuTable, Bool]:
        """Return the samples that reach the file, with its tags, and which ones they are.

        The first and the last sample are always kept, so that the span of a log is that of its scenario.
        """
        count = len(imu.t_ns)
        kept = np.ones(count, np.bool_)
        if self.lost_share > 0.0:
            begins = rng.random(count) < self.lost_share / self.lost_at_once
            for later in range(self.lost_at_once):
                kept[later:] &= ~begins[: count - later]
            kept[[0, -1]] = True
        t_ns = imu.t_ns
        if self.tag_jitter_s > 0.0:
            most = _MOST_OF_A_STEP * float(np.min(np.diff(t_ns))) / NS_PER_S
            off = np.clip(self.tag_jitter_s * rng.standard_normal(count), -most, most)
            t_ns = t_ns + np.rint(off * NS_PER_S).astype(np.int64)
        return replace(imu, t_ns=t_ns[kept], w_ib_b=imu.w_ib_b[kept], f_b=imu.f_b[kept]), kept


@dataclass(frozen=True)
class VibrationSpectrum:
    """One-sided power density between corners (straight lines in log-log), and sines; the same for each axis."""

    frequency_hz: tuple[float, ...] = ()  # of the corners, increasing
    density: tuple[float, ...] = ()  # [unit^2/Hz] at the corners; nothing outside of them
    lines: tuple[tuple[float, float], ...] = ()  # (frequency [Hz], amplitude [unit])
    from_s: float = 0.0  # it comes up within ``RISE_S`` from here on ...
    end_s: float | None = None  # ... and has faded here; None: it stays

    def at(self, frequency_hz: Float64) -> Float64:
        """Return the density at the given frequencies."""
        inside = (frequency_hz >= self.frequency_hz[0]) & (frequency_hz <= self.frequency_hz[-1])
        log_f = np.log(np.maximum(frequency_hz, 1e-12))
        return np.where(
            inside, np.exp(np.interp(log_f, np.log(self.frequency_hz), np.log(self.density))), 0.0
        )

    def rms(self) -> float:
        """Return the root mean square of the broad part, by the trapezoid on a fine logarithmic grid."""
        f: Float64 = np.asarray(np.geomspace(self.frequency_hz[0], self.frequency_hz[-1], 10_001), np.float64)
        return float(np.sqrt(np.trapezoid(self.at(f), f)))


def vibration(count: int, step_s: float, spectrum: VibrationSpectrum, rng: np.random.Generator) -> Float64:
    """Return (count, 3) means of the vibration over sampling intervals, three independent axes.

    Equation: noise ``x = sum_k sqrt(S(f_k) df) (a_k cos + b_k sin)`` with normal a, b; the mean of a sine over an
    interval is ``sin(pi f step) / (pi f step)`` times its value in the middle.
    """
    total = np.zeros((count, 3))
    if spectrum.frequency_hz:
        fold = max(_FINER, math.ceil(_FINER * spectrum.frequency_hz[-1] * step_s))
        if 3 * count * fold > _MOST_VALUES:
            raise ConfigError(
                f"a vibration up to {spectrum.frequency_hz[-1]:g} Hz over {count * step_s:g} s is too long a series",
                advice="end the spectrum nearer to the sampling rate, or simulate less",
            )
        fine = _vibration_noise(count * fold, step_s / fold, spectrum, rng)
        total += fine.reshape(count, fold, 3).mean(axis=1)
    middle: Float64 = np.asarray((np.arange(count) + 0.5) * step_s, np.float64)
    for frequency_hz, amplitude in spectrum.lines:
        phase = rng.uniform(0.0, 2.0 * np.pi, 3)
        seen = amplitude * np.sinc(frequency_hz * step_s)
        total += seen * np.sin(2.0 * np.pi * frequency_hz * middle[:, None] + phase)
    if spectrum.from_s > 0.0:
        total *= smoothstep((middle - spectrum.from_s) / RISE_S)[:, None]
    if spectrum.end_s is not None:
        total *= smoothstep((spectrum.end_s - middle) / RISE_S)[:, None]
    return total


def _vibration_noise(
    count: int, step_s: float, spectrum: VibrationSpectrum, rng: np.random.Generator
) -> Float64:
    frequency: Float64 = np.asarray(np.fft.rfftfreq(count, step_s), np.float64)
    # a real series of n values with one-sided density S has |X_k|^2 = S n / (2 step)
    size = np.sqrt(spectrum.at(frequency) * count / (2.0 * step_s))
    axes = []
    for _ in range(3):
        parts = rng.standard_normal((2, len(frequency))) / np.sqrt(2.0)
        axes.append(np.fft.irfft(size * (parts[0] + 1j * parts[1]), count))
    return np.column_stack(axes)
