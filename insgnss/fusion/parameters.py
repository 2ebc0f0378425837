"""All numbers the compiled filter needs, resolved once from the filter file, the sensor grade and the oscillator."""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from insgnss.config.filter import FilterConfig, Noise
from insgnss.config.flight import ImuGrade, Oscillator
from insgnss.gnss.noise_model import thermal_factor
from insgnss.inertial.clock_model import clock_model
from insgnss.inertial.sensor_model import sensor_model

PARAMETERS_DTYPE = np.dtype(
    (
        np.record,
        [
            ("gyro_density", np.float64),  # [rad^2/s]
            ("accel_density", np.float64),  # [m^2/s^3]
            ("gyro_scale_density", np.float64),  # times rate^2 gives [rad^2/s]
            ("accel_scale_density", np.float64),  # times (|f| - g)^2 gives [m^2/s^3]
            ("gyro_bias_density", np.float64),
            ("gyro_bias_time", np.float64),
            ("accel_bias_density", np.float64),
            ("accel_bias_time", np.float64),
            ("clock_bias_density", np.float64),  # [m^2/s]
            ("clock_drift_density", np.float64),  # [m^2/s^3]
            ("offset_density", np.float64),  # [m^2/s]
            ("covariance_step", np.float64),  # [s]
            ("longest_step", np.float64),  # [s]
            ("gap_accel_sigma", np.float64),  # [m/s^2]
            ("gap_rate_sigma", np.float64),  # [rad/s]
            ("restart_gap", np.float64),  # [s]
            ("sine_mask", np.float64),  # sine of the elevation mask
            ("cn0_mask", np.float64),  # [dBHz]
            ("use_ionosphere", np.float64),  # 1 or 0
            ("use_troposphere", np.float64),  # 1 or 0
            ("range_floor2", np.float64),  # [m^2]
            ("range_elevation2", np.float64),
            ("range_cn02", np.float64),
            ("range_missing_thermal", np.float64),
            ("rate_floor2", np.float64),  # [m^2/s^2]
            ("rate_elevation2", np.float64),
            ("rate_cn02", np.float64),
            ("rate_missing_thermal", np.float64),
            ("range_correlation", np.float64),  # [s]
            ("rate_correlation", np.float64),  # [s]
            ("range_gate2", np.float64),  # squared gate [-]
            ("rate_gate2", np.float64),
            ("clock_jump_min", np.float64),  # [m]
            ("lockout_epochs", np.float64),
            ("strain_limit", np.float64),
            ("strain_time", np.float64),  # [s]
            ("heading_known_variance", np.float64),  # [rad^2]
            ("adapt_gain", np.float64),  # 0: off
            ("adapt_least", np.float64),
            ("adapt_most", np.float64),
            ("adapt_least_at_rest", np.float64),
            ("lever_b", np.float64, (3,)),  # IMU to antenna, body [m]
        ],
    )
)
Parameters: TypeAlias = Any  # one element of PARAMETERS_DTYPE: SI units and radians, two-sided densities


def _noise(noise: Noise) -> tuple[float, float, float, float]:
    return (
        noise.floor**2,
        noise.elevation**2,
        noise.cn0_at_45_dbhz**2,
        float(thermal_factor(noise.missing_cn0_dbhz)),
    )


def resolve_parameters(
    config: FilterConfig,
    grade: ImuGrade,
    oscillator: Oscillator,
    lever_arm_m: tuple[float, float, float],
    klobuchar_known: bool,
) -> npt.NDArray[Any]:
    """Return the filter's numbers, (1,) of ``PARAMETERS_DTYPE``; no coefficients, no ionosphere."""
    sensor = sensor_model(grade)
    clock = clock_model(oscillator)
    use, gaps, gates = config.measurements, config.gaps, config.gates
    values = (
        sensor.gyro_density,
        sensor.accel_density,
        sensor.gyro_scale**2 * config.process.scale_factor_time_s,
        sensor.accel_scale**2 * config.process.scale_factor_time_s,
        sensor.gyro_bias.density,
        sensor.gyro_bias.time_s,
        sensor.accel_bias.density,
        sensor.accel_bias.time_s,
        clock.bias_density,
        clock.drift_density,
        config.process.inter_system_walk_m_per_sqrt_s**2,
        config.process.covariance_step_s,
        gaps.longest_step_s,
        gaps.acceleration_sigma_mps2,
        math.radians(gaps.rate_sigma_degps),
        gaps.restart_s,
        math.sin(math.radians(use.elevation_mask_deg)),
        use.cn0_mask_dbhz,
        float(klobuchar_known and use.ionosphere == "klobuchar"),
        float(use.troposphere == "saastamoinen"),
        *_noise(config.pseudorange_noise_m),
        *_noise(config.range_rate_noise_mps),
        config.pseudorange_noise_m.correlation_time_s,
        config.range_rate_noise_mps.correlation_time_s,
        gates.pseudorange_sigma**2,
        gates.range_rate_sigma**2,
        gates.clock_jump_min_m,
        float(config.health.lockout_epochs),
        config.health.strain_nis,
        config.health.strain_s,
        math.radians(config.heading.known_below_deg) ** 2,
        1.0 / config.adaptation.memory_s if config.adaptation.on else 0.0,
        config.adaptation.least_factor,
        config.adaptation.most_factor,
        config.adaptation.least_factor_at_rest,
        lever_arm_m,
    )
    return np.array([values], PARAMETERS_DTYPE)
