"""The flight file of a simulated log: the declarations that a user would make, and nothing of the truth."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Final

import numpy as np

from insgnss.config.flight import ImuGrade, MountedAntenna, Oscillator
from insgnss.config.simulated_sensors import SimulatedSensor
from insgnss.config.simulation import SimulatedGnss, SimulationConfig
from insgnss.gnss.noise_model import REFERENCE_CN0_DBHZ
from insgnss.gnss.signals import wavelength_m
from insgnss.simulation.log_files import sensor_file_name
from insgnss.simulation.reception import CarrierLoopNoise
from insgnss.simulation.simulated_log import Scenario
from insgnss.simulation.slow_error_sizes import reflections_m, slow_errors_of

IMU_FILE = "imu.csv"
GNSS_FILE = "gnss.csv"
NAVIGATION_FILE = "nav.rnx"
REFERENCE_FILE = "reference.csv"
FLIGHT_FILE = "flight.toml"
_LEAST_PHASE_SIGMA_M = 1e-5  # a flight file has no phases without thermal noise


def flight_text(config: SimulationConfig, scenario: Scenario) -> str:
    """Return the text of the flight file; grade and oscillator are numbers in it."""
    units = {"rates": ("rad/s", "m/s^2"), "increments": ("rad", "m/s")}[config.imu.values]
    lines = [
        "# A simulated log: see the scenario file for what was put into it.",
        f"name = {json.dumps(config.name)}",
        f"gps_week = {config.gps_week}",
        'start = "automatic"',
        "",
        "[imu]",
        f'files = ["{IMU_FILE}"]',
        f'values = "{config.imu.values}"',
        f'gyro_unit = "{units[0]}"',
        f'accel_unit = "{units[1]}"',
        'axes = ["+x", "+y", "+z"]',
        "",
        "[imu.grade]",
        *grade_lines(scenario.grade),
        "",
        "[gnss]",
        f'files = ["{GNSS_FILE}"]',
        f'navigation = ["{NAVIGATION_FILE}"]',
        f"lever_arm_m = {list(scenario.receiver.lever_arm_b)}",
        "",
        "[gnss.oscillator]",
        *grade_lines(scenario.oscillator),
        "",
        "[gnss.slow_errors]",
        *(f"{key} = {_toml_of(value)}" for key, value in slow_errors_of(config.gnss).model_dump().items()),
    ]
    for antenna in config.gnss.antenna:
        lines += ["", "[[gnss.antenna]]", *_antenna_lines(antenna)]
    if config.attitude is not None:
        lines += ["", "[attitude]", f'clocks = "{config.attitude.clocks}"', *_phase_noise_lines(config.gnss)]
        for antenna in config.attitude.antenna:
            lines += ["", "[[attitude.antenna]]", f'files = ["{antenna_file_name(antenna.name)}"]']
            lines += _antenna_lines(antenna)
    for sensor in config.sensor:
        lines += ["", "[[sensor]]", *sensor_lines(sensor)]
    return "\n".join([*lines, "", "[reference]", f'file = "{REFERENCE_FILE}"', 'point = "imu"', ""])


def _toml_of(value: float | dict[str, float]) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {size:.6g}" for key, size in value.items()) + " }"
    return f"{value:.6g}"


def _phase_noise_lines(gnss: SimulatedGnss) -> list[str]:
    """Return the noise settings of the antennas' phases, as a user would declare them.

    Equation: reflections vary with elevation, the file has one sigma for them: the rms over an even sky above the mask.
    Neglects: the mirror below the antennas (``specular``), which is the same in all of them and cancels.
    """
    noise, echo = gnss.carrier_noise_m, gnss.multipath
    assert noise is not None  # as the scenario's schema demands
    floor, elevation, thermal = noise.floor, noise.elevation, noise.cn0_at_45_dbhz
    if gnss.loops is not None:
        waves = np.array([wavelength_m("G", code) for code in gnss.signals])
        loop = CarrierLoopNoise(gnss.loops.carrier_bandwidth_hz, gnss.loops.integration_s, waves)
        sigmas = loop.sigma(np.zeros(len(waves)), np.full(len(waves), REFERENCE_CN0_DBHZ))
        floor, elevation, thermal = 0.0, 0.0, float(np.sqrt(np.mean(sigmas**2)))
    values = {
        "phase_sigma_m": max(thermal, _LEAST_PHASE_SIGMA_M),
        "phase_floor_m": floor,
        "phase_elevation_m": elevation,
        "multipath_sigma_m": 0.0,
    }
    if echo is not None:
        values["multipath_sigma_m"] = echo.carrier_ratio * reflections_m(gnss)
        values["multipath_time_s"] = echo.correlation_time_s
    return [f"{key} = {value:.6g}" for key, value in values.items()]


def antenna_file_name(name: str) -> str:
    """Return the file of a further antenna's log."""
    return f"gnss_{re.sub(r'[^A-Za-z0-9]+', '_', name)}.csv"


_DECLARED: Final = {  # keys of a simulated sensor that the flight file has under another name
    "noise_time_s": "correlation_time_s",
    "noise_m": "sigma_m",
    "noise_mps": "sigma_mps",
    "noise_deg": "sigma_deg",
    "noise_ut": "sigma_ut",
}
_OF_THE_TRUTH: Final = {"kind", "name", "rate_hz", "time_offset_s", "down_ut"}


def sensor_lines(sensor: SimulatedSensor) -> list[str]:
    """Return the lines of a further sensor: where it is, and the sigmas that its errors were drawn with."""
    values = sensor.model_dump(exclude=_OF_THE_TRUTH, mode="json")
    declared = {_DECLARED.get(key, key): value for key, value in values.items()}
    if sensor.kind == "odometer":
        declared |= {"sigma_share": 0.0, "scale_walk_per_sqrt_h": 0.0}
    lines = [
        f'kind = "{sensor.kind}"',
        f'name = "{sensor.label}"',
        f'files = ["{sensor_file_name(sensor.label)}"]',
    ]
    return lines + [f"{key} = {json.dumps(value)}" for key, value in declared.items()]


def grade_lines(model: ImuGrade | Oscillator) -> list[str]:
    """Return the lines of a sensor's or oscillator's table: all keys that are not left at their default."""
    values = model.model_dump(exclude_defaults=True)
    return [f"{key} = {json.dumps(value)}" for key, value in values.items()]


def _antenna_lines(antenna: MountedAntenna) -> list[str]:
    """Return the lines of an antenna; its own files are named as their copies are (``antenna_files``)."""
    values = antenna.model_dump(exclude_defaults=True, exclude={"clock_bias_m"}, mode="json")
    for key in ("pattern", "obstruction"):
        if str(values.get(key, "")).endswith((".csv", ".toml")):
            values[key] = Path(values[key]).name
    return [f"{key} = {json.dumps(value)}" for key, value in values.items()]


def antenna_files(config: SimulationConfig, folder: Path, to: Path) -> list[Path]:
    """Return patterns and obstructions that are files of the scenario's folder and not in the folder ``to`` already."""
    found: dict[Path, None] = {}
    further = () if config.attitude is None else config.attitude.antenna
    for antenna in (*config.gnss.antenna, *further):
        named = [Path(antenna.pattern)] if antenna.pattern.endswith(".csv") else []
        named += [] if antenna.obstruction is None else [antenna.obstruction]
        found |= {
            folder / path: None for path in named if (folder / path).resolve() != (to / path.name).resolve()
        }
    return list(found)
