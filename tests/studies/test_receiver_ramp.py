"""Jamming that grows: loops lose lock at the J/S that the flown interference margin gives as their limit.

The limit is the J/S at which a loop lives for some 300 / B on average, 11 s of a loop that follows 5 g and 53 s of an
aided one. How far a ramp gets beyond it depends on how long each decibel lasts, here 20 s.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import pandas as pd
import pymap3d
import pytest
from scipy.spatial.transform import Rotation

from insgnss.config.interference import Emitter, InterferenceConfig, LoopDynamics, LoopReceiver
from insgnss.constants import C_MPS
from insgnss.geodesy.directions import angle_columns
from insgnss.geodesy.local_level import geodetic, ned_axes
from insgnss.gnss.signals import L1_HZ
from insgnss.runs.margin import flown_margin
from insgnss.runs.result import Run
from insgnss.studies import ReceiverOptions
from insgnss.studies.receiver.antennas import jammed_cn0_dbhz
from insgnss.studies.receiver.runs import run_many
from insgnss.studies.receiver.scene import StudyScene, scene_of
from insgnss.studies.receiver.variants import VARIANTS
from insgnss.tables import Float64
from tests.studies.test_receiver_study import LOW, motion

LASTS_S: Final = 105.0
BEGINS_S: Final = 5.0
STEP_S: Final = 1.0  # of the ramp's stairs
RAMP_DB_PER_S: Final = 0.05
DRIFT: Final = 100.0
UNKNOWN_S: Final = 1.0 / 0.3


def scene(with_ins: bool) -> StudyScene:
    """Return 5 g on each axis, with an IMU of 80 deg/h or without one."""
    options = ReceiverOptions(duration_s=LASTS_S, settle_s=BEGINS_S, average_s=BEGINS_S, unknown_s=UNKNOWN_S)
    return scene_of(motion(), "coherent", LOW if with_ins else None, {"drift_density": DRIFT}, options)


def mast(of: StudyScene, begins_db: float) -> InterferenceConfig:
    """Return emitters at one place, one after the other, whose power at the antenna grows from J/S ``begins_db`` on."""
    truth, receiver = (
        of.setting.truth,
        LoopReceiver(discriminator="IQ", threshold_ratio=0.076, accumulation_s=5e-3),
    )
    lat_deg, lon_deg, h_m = 55.0, 37.5, 20e3
    at_e = np.array(pymap3d.geodetic2ecef(lat_deg, lon_deg, h_m))
    emitters = []
    for k in range(math.ceil((LASTS_S - BEGINS_S) / STEP_S)):
        from_s = truth.t_s[0] + BEGINS_S + STEP_S * k
        middle = int(np.searchsorted(truth.t_s, from_s + 0.5 * STEP_S))
        distance = float(np.linalg.norm(truth.r_e[min(middle, len(truth.t_s) - 1)] - at_e))
        emitter = Emitter(
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            h_m=h_m,
            eirp_dbw=begins_db
            + RAMP_DB_PER_S * STEP_S * k
            + receiver.signal_dbw
            + 20.0 * math.log10(4.0 * math.pi * L1_HZ * distance / C_MPS),
            bandwidth_hz=20e6,
            from_s=of.start_s + from_s,
            until_s=of.start_s + from_s + STEP_S,
        )
        emitters.append(emitter)
    dynamics = LoopDynamics(oscillator_density=DRIFT, window_s=LASTS_S, manoeuvre_time_s=UNKNOWN_S)
    return InterferenceConfig(emitter=tuple(emitters), receiver=receiver, dynamics=dynamics)


def run_of(of: StudyScene) -> Run:
    """Return the flight as a saved run: the truth as its navigation, the study's sky, ten rows a second."""
    truth, pick = of.setting.truth, slice(None, None, 20)
    place = geodetic(truth.r_e[pick])
    C_ne = ned_axes(place)
    C_nb = Rotation.from_matrix(np.einsum("kij,kjl->kil", C_ne, truth.C_eb[pick]))
    time_s = of.start_s + truth.t_s[pick]
    nav = pd.DataFrame({"time_s": time_s, "h_m": place[:, 2]})
    nav[["lat_deg", "lon_deg"]] = np.degrees(place[:, :2])
    nav[["vn_mps", "ve_mps", "vd_mps"]] = np.einsum("kij,kj->ki", C_ne, truth.v_e[pick])
    nav[["yaw_deg", "pitch_deg", "roll_deg"]] = C_nb.as_euler("ZYX", degrees=True)
    u_n = np.einsum("kij,kmj->kmi", C_ne, truth.directions(pick)).reshape(-1, 3)
    names = [f"G{c + 1:02d}" for c in range(of.channels)]
    rows: dict[str, Any] = {
        "time_s": np.repeat(time_s, of.channels),
        "sv": pd.Categorical(np.tile(names, len(time_s))),
        **angle_columns(u_n),
        "gain_dbi": 0.0,
    }
    nothing, table = pd.DataFrame(), pd.DataFrame(rows)
    run = Run(nav, nothing, table, nothing, settings={})
    # of the IMU's accelerometers
    run.aiding = table[["time_s", "sv"]].assign(sd_range_acceleration_mps2=0.06)
    return run


def beyond_limit_db(name: str, begins_db: float) -> Float64:
    """Return J/S at each channel's loss less the limit that the margin has for it then, (runs, m); inf: never lost."""
    with_ins = name != "scalar"
    of, loop = scene(with_ins), "aided" if with_ins else "unaided"
    emitters, truth = mast(of, begins_db), of.setting.truth
    table = flown_margin(run_of(of), emitters, step_s=0.0).satellites
    above = (table["js_db"] - table[f"js_limit_{loop}_db"]).to_numpy().reshape(-1, of.channels)
    time_s = table["time_s"].to_numpy()[:: of.channels] - of.start_s - truth.t_s[0]
    cn0 = jammed_cn0_dbhz(truth, emitters, of.start_s)
    lost_s = np.array([run.lost_s for run in run_many(of.setting, VARIANTS[name], cn0, 4, 3, 1)])
    beyond = np.full_like(lost_s, np.inf)
    for c in range(of.channels):
        lost = np.isfinite(lost_s[:, c])
        beyond[lost, c] = np.interp(lost_s[lost, c], time_s, above[:, c])
    return beyond


@pytest.mark.parametrize(("name", "begins_db"), [("scalar", 42.0), ("two_stage", 47.5)])
def test_ramp_of_jamming_breaks_lock_at_the_limit_of_the_flown_margin(name: str, begins_db: float) -> None:
    beyond = beyond_limit_db(name, begins_db)

    # -0.9 dB without aiding and 1.1 dB with it; at 0.5 dB/s 0.6 and 4.6 dB: a fast ramp outruns a narrow loop
    assert abs(float(np.median(beyond))) < 1.5
    assert np.isfinite(beyond).mean() > 0.9
