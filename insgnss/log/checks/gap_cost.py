"""The cost of each gap: the growth of velocity and position sigma by the grade of the IMU.

Without GNSS, from a settled filter (tilt and biases known to the instability of the sensors)   [Groves 2013, 5.7]

    sd_v^2 = s_v^2 + (b_a T)^2 + (g psi T)^2 + N_a^2 T + (g b_g T^2 / 2)^2 + g^2 N_g^2 T^3 / 3
    sd_r^2 = (s_v T)^2 + (b_a T^2 / 2)^2 + (g psi T^2 / 2)^2 + N_a^2 T^3 / 3 + (g b_g T^3 / 6)^2 + g^2 N_g^2 T^5 / 20

Without inertial samples the motion itself is unknown: sd_v = a T, sd_r = a T^2 / 2 with a the rms by which the specific
force of this log leaves its mean over seconds. Neglects: heading (a turn during the gap adds to it), Schuler's period:
below 5 minutes less than a tenth.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from insgnss.config.flight import ImuGrade
from insgnss.constants import NS_PER_S, STANDARD_GRAVITY_MPS2
from insgnss.gpstime import ns_to_week_seconds
from insgnss.log.checks.report import Finding
from insgnss.log.checks.track import GNSS_GAP_STEPS
from insgnss.log.imu.time import GAP_MIN_S, IMU_GAP_STEPS
from insgnss.log.imu.windows import imu_windows
from insgnss.tables import ImuTable, Int64
from insgnss.units import MPS2_PER_MG, RAD_PER_DEG, S_PER_H, SQRT_S_PER_SQRT_H

START_SD_MPS: Final = 0.03  # velocity of a filter that has just had its epochs
TOLD: Final = 3  # gaps of each kind, the longest
EXAMPLES_S: Final = (10.0, 60.0)


def outage_sigmas(grade: ImuGrade, length_s: float) -> tuple[float, float]:
    """Return horizontal sigma per axis of velocity [m/s] and position [m] after a gap of the GNSS of ``length_s``."""
    g, T = STANDARD_GRAVITY_MPS2, length_s
    b_a = grade.accel_bias_instability_mg * MPS2_PER_MG
    b_g = grade.gyro_bias_instability_deg_per_h * RAD_PER_DEG / S_PER_H
    N_a = grade.accel_vrw_mps_per_sqrt_h / SQRT_S_PER_SQRT_H
    N_g = grade.gyro_arw_deg_per_sqrt_h * RAD_PER_DEG / SQRT_S_PER_SQRT_H
    # the part that levelling cannot separate from the bias is common to both ...
    tilt = grade.accel_bias_mg * MPS2_PER_MG / g
    known = min(tilt, b_a / g)  # ... and cancels until the vehicle turns: its instability is left
    v2 = START_SD_MPS**2 + (b_a * T) ** 2 + (g * known * T) ** 2 + N_a**2 * T
    v2 += (g * b_g * T**2 / 2.0) ** 2 + (g * N_g) ** 2 * T**3 / 3.0
    r2 = (
        (START_SD_MPS * T) ** 2
        + (b_a * T**2 / 2.0) ** 2
        + (g * known * T**2 / 2.0) ** 2
        + N_a**2 * T**3 / 3.0
    )
    r2 += (g * b_g * T**3 / 6.0) ** 2 + (g * N_g) ** 2 * T**5 / 20.0
    return math.sqrt(v2), math.sqrt(r2)


def gap_findings(imu: ImuTable | None, gnss_ns: Int64, grade: ImuGrade, week: int) -> list[Finding]:
    """Return the longest gaps of both logs with their cost."""
    findings = []
    if imu is not None:
        step_ns = np.diff(imu.t_ns)
        limit = max(IMU_GAP_STEPS * float(np.median(step_ns)), GAP_MIN_S * NS_PER_S)
        unknown = _unknown_motion(imu)
        for start, length_s in _longest(imu.t_ns, limit):
            sd_v, sd_r = unknown * length_s, 0.5 * unknown * length_s**2
            text = _text("IMU", length_s, start, week, sd_v, sd_r)
            text += f"; by the motion of this log, rms {unknown:.2g} m/s^2"
            findings.append(Finding("ok" if length_s < 1.0 else "warning", "gaps", text))
    epochs = np.unique(gnss_ns)
    if imu is not None:
        epochs = epochs[(epochs >= imu.t_ns[0]) & (epochs <= imu.t_ns[-1])]
    if len(epochs) > 2:
        for start, length_s in _longest(epochs, GNSS_GAP_STEPS * float(np.median(np.diff(epochs)))):
            sd_v, sd_r = outage_sigmas(grade, length_s)
            findings.append(Finding("ok", "gaps", _text("GNSS", length_s, start, week, sd_v, sd_r)))
    parts = []
    for length_s in EXAMPLES_S:
        sd_v, sd_r = outage_sigmas(grade, length_s)
        parts.append(f"{length_s:.0f} s: {_about(sd_v)} m/s, {_about(sd_r)} m")
    text = f"sigma without GNSS, by the grade, per horizontal axis: after {'; after '.join(parts)}"
    return [*findings, Finding("ok", "gaps", text)]


def _text(log: str, length_s: float, start_ns: int, week: int, sd_v: float, sd_r: float) -> str:
    start = float(ns_to_week_seconds(np.array([start_ns]), week)[0])
    grown = f"{_about(sd_v)} m/s and {_about(sd_r)} m"
    return f"{log} gap of {length_s:.3g} s from {start:.3f} s on: sigma grows to {grown}"


def _about(sigma: float) -> str:
    return f"{sigma:.2g}" if sigma < 99.5 else f"{sigma:.0f}"


def _longest(t_ns: Int64, limit_ns: float) -> list[tuple[int, float]]:
    """Return start [ns] and length [s] of the longest steps over a limit."""
    step = np.diff(t_ns)
    order = np.argsort(-step, kind="stable")[:TOLD]
    return [(int(t_ns[k]), float(step[k]) / NS_PER_S) for k in order if step[k] > limit_ns]


def _unknown_motion(imu: ImuTable) -> float:
    """Return the rms by which the specific force of seconds leaves its mean over the log [m/s^2]."""
    windows = imu_windows(imu, float(np.median(np.diff(imu.t_ns))))
    if windows is None:
        return 0.0
    return float(np.sqrt(np.mean(np.sum((windows.f_b - windows.f_b.mean(axis=0)) ** 2, axis=1))))
