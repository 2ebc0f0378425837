"""A simulated flight as a folder of files, the way a user has it."""

from __future__ import annotations

import datetime as dt
from pathlib import Path

import numpy as np

from insgnss.gpstime import ns_to_datetime
from insgnss.simulation.log_files import write_gnss, write_imu, write_reference
from insgnss.simulation.rinex_nav import write_rinex_navigation
from insgnss.simulation.simulated_log import Simulator
from insgnss.simulation.trajectory import reference_table
from insgnss.tables import GnssTable, ImuTable
from tests.runs.scenes import LEVER_ARM_B, TACTICAL, TCXO, WEEK


def write_flight(
    folder: Path,
    base: Simulator,
    *,
    seed: int = 1,
    imu: ImuTable | None = None,
    gnss: GnssTable | None = None,
) -> Path:
    """Write a drawn flight, its truth and its flight file; return the flight file."""
    folder.mkdir(parents=True, exist_ok=True)
    log = base.draw(np.random.default_rng(seed))
    write_imu(folder / "imu.csv", imu or log.imu, WEEK)
    write_gnss(folder / "gnss.csv", gnss or log.gnss, WEEK)
    created: dt.datetime = ns_to_datetime(base.scenario.start_ns)
    write_rinex_navigation(folder / "nav.rnx", base.scenario.navigation, created)
    write_reference(folder / "reference.csv", reference_table(base.imu_motion, base.scenario.start_ns), WEEK)
    path = folder / "flight.toml"
    path.write_text(flight_file(), encoding="utf-8")
    return path


def flight_file() -> str:
    """Return the text of the flight file."""
    grade = "\n".join(f"{name} = {value}" for name, value in TACTICAL if isinstance(value, float))
    return f"""\
name = "simulated"
gps_week = {WEEK}

[imu]
files = ["imu.csv"]

[imu.grade]
{grade}

[gnss]
files = ["gnss.csv"]
navigation = ["nav.rnx"]
lever_arm_m = {list(LEVER_ARM_B)}

[gnss.oscillator]
h0_s = {TCXO.h0_s}
h_minus2_per_s = {TCXO.h_minus2_per_s}

[reference]
file = "reference.csv"
"""
