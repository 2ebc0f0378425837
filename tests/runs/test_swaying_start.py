"""A log that begins while the vehicle sways slowly: what the gyros read is the sway, not their bias."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

import insgnss
from insgnss.config.simulation import SimulationConfig
from insgnss.constants import NS_PER_S
from insgnss.log.flight import FlightInMemory
from insgnss.simulation.assembly import assemble
from insgnss.simulation.simulated_log import Simulator
from insgnss.tables import ImuTable
from tests.runs.scenes import rows_where
from tests.sensors.scenes import flown

CUT_S = 60.0  # until then the sea rises
BOAT = """
gps_week = 2385
start_s = 293700.0
place = { lat_deg = 54.3, lon_deg = 10.1, h_m = 40.0, heading_deg = 30.0 }
speed_mps = 0.0

[[manoeuvre]]
kind = "sea"
duration_s = 200.0
roll_deg = ROLL
roll_period_s = PERIOD

[imu]
grade = "GRADE"

[gnss]
lever_arm_m = [0.8, 0.0, -1.1]
"""


def moored(grade: str, roll_deg: float, period_s: float) -> FlightInMemory:
    """Return a boat's log that begins in the middle of its swaying."""
    text = BOAT.replace("ROLL", str(roll_deg)).replace("PERIOD", str(period_s)).replace("GRADE", grade)
    flight = flown(Simulator(assemble(SimulationConfig.model_validate(tomllib.loads(text)), Path())), 3)
    imu, gnss = flight.logs.imu, flight.logs.gnss
    from_ns = imu.t_ns[0] + int(CUT_S * NS_PER_S)
    k = imu.t_ns > from_ns
    late = ImuTable(imu.t_ns[k], imu.w_ib_b[k], imu.f_b[k])
    return replace(flight, logs=replace(flight.logs, imu=late, gnss=rows_where(gnss, gnss.t_ns > from_ns)))


@pytest.mark.parametrize(
    ("grade", "roll_deg", "period_s"),
    [("navigation", 1.5, 25.0), ("tactical", 1.0, 12.0), ("industrial", 3.0, 20.0)],
)
def test_sway_does_not_pass_for_a_gyro_bias(grade: str, roll_deg: float, period_s: float) -> None:
    """Roll was up to 63 deg wrong at 114 sigma, without an event."""
    run = insgnss.replay(moored(grade, roll_deg, period_s), output=1.0)
    assert run.errors is not None
    after = run.errors[run.errors["time_s"] > run.errors["time_s"].iloc[0] + 10.0]
    for name in ("roll_deg", "pitch_deg", "vn_mps", "ve_mps", "vd_mps", "n_m", "e_m", "d_m"):
        assert (after[f"d_{name}"].abs() < 5.0 * after[f"sd_{name}"]).all(), name
    assert after["sd_roll_deg"].iloc[-1] < 1.0
