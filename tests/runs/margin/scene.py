"""A made-up run: a level flight to the north with a turn, two satellites, and emitters beside it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas as pd

from insgnss.config.interference import InterferenceConfig
from insgnss.runs.result import Run

LAT, LON, H = 60.0, 30.0, 1000.0
SPEED, N = 100.0, 121
TURN_MPS2 = 5.0  # to the east, from 60 s to 90 s
EMITTER: dict[str, Any] = {
    "name": "mast",
    "lat_deg": 60.05,
    "lon_deg": 30.1,
    "h_m": 50.0,
    "eirp_dbw": 0.0,
    "bandwidth_hz": 20e6,
}
SETTINGS: dict[str, Any] = {
    "imu_grade": {
        "gyro_bias_deg_per_h": 1.0,
        "gyro_bias_instability_deg_per_h": 0.3,
        "gyro_correlation_time_s": 1000.0,
        "gyro_arw_deg_per_sqrt_h": 0.1,
        "accel_bias_mg": 1.0,
        "accel_bias_instability_mg": 0.1,
        "accel_correlation_time_s": 1000.0,
        "accel_vrw_mps_per_sqrt_h": 0.06,
    },
    "oscillator": {"h0_s": 8e-22, "h_minus2_per_s": 4e-25},
}


def flown(gain_dbi: float = math.nan, settings: dict[str, Any] | None = None) -> Run:
    """Return the run: G05 in the east at 30 deg, E11 in the zenith."""
    t = np.arange(N, dtype=np.float64)
    turning = (t >= 60.0) & (t < 90.0)
    east = TURN_MPS2 * np.clip(t - 60.0, 0.0, 30.0)
    nav = pd.DataFrame(
        {
            "time_s": 1000.0 + t,
            "lat_deg": LAT + np.degrees(SPEED * t / 6.39e6),
            "lon_deg": LON,
            "h_m": H,
            "vn_mps": SPEED,
            "ve_mps": east,
            "vd_mps": 0.0,
            "roll_deg": np.where(turning, 27.0, 0.0),
            "pitch_deg": 0.0,
            "yaw_deg": 0.0,
            **dict.fromkeys(("sd_n_m", "sd_e_m", "sd_d_m", "sd_vn_mps", "sd_ve_mps", "sd_vd_mps"), 0.1),
            "sd_roll_deg": 0.02,
            "sd_pitch_deg": 0.01,
            "sd_yaw_deg": 0.05,
            "n_used": 2,
        }
    )
    for axis in "xyz":
        nav[f"sd_accel_bias_{axis}_mps2"] = 0.001
    rows = {
        "time_s": np.repeat(nav["time_s"].to_numpy(), 2),
        "sv": pd.Categorical(np.tile(["G05", "E11"], N)),
        "az_deg": np.tile([90.0, 0.0], N),
        "el_deg": np.tile([30.0, 90.0], N),
        "body_az_deg": np.tile([90.0, 0.0], N),
        "body_el_deg": np.tile([30.0, 90.0], N),
        "gain_dbi": gain_dbi,
        "state": pd.Categorical(["tracked"] * 2 * N),
    }
    nothing = pd.DataFrame()
    return Run(nav, nothing, pd.DataFrame(rows), nothing, settings=SETTINGS if settings is None else settings)


def interference(
    *emitters: dict[str, Any], receiver: dict[str, Any] | None = None, dynamics: dict[str, Any] | None = None
) -> InterferenceConfig:
    """Return the settings of these emitters; one mast when none is given."""
    return InterferenceConfig.model_validate(
        {"emitter": emitters or (EMITTER,), "receiver": receiver or {}, "dynamics": dynamics or {}}
    )
