"""The flight file of a simulated log: the declarations that a user would make, and nothing of the truth.

Among them are the sizes of the receiver's range errors that last (``[gnss.slow_errors]``).
"""

from __future__ import annotations

import json
import math
import re
from operator import itemgetter
from pathlib import Path
from typing import Final

import numpy as np

from insgnss.config.flight import ImuGrade, MountedAntenna, Oscillator
from insgnss.config.simulated_sensors import SimulatedSensor
from insgnss.config.simulation import SimulatedGnss, SimulationConfig
from insgnss.config.slow_errors import NO_SLOW_ERRORS, SlowErrorSizes
from insgnss.constants import C_MPS
from insgnss.gnss.noise_model import REFERENCE_CN0_DBHZ
from insgnss.gnss.signals import L1_HZ, wavelength_m
from insgnss.simulation.log_files import sensor_file_name
from insgnss.simulation.reception import CarrierLoopNoise
from insgnss.simulation.simulated_log import Scenario
from insgnss.tables import Float64

_SKY_POINTS: Final = 201
# share of an orbit's error along the line of sight, of radial, and of along and cross: GPS, averaged over the Earth
# [Montenbruck, Steigenberger & Hauschild 2015, Broadcast versus precise ephemerides, GPS Solutions 19(2)]
_RADIAL, _ACROSS2 = 0.98, 1.0 / 49.0
_SINE_RATE: Final = (
    8e-5  # rate of sin E [1/s], rms of the GPS satellites above 5 deg at latitudes of 45 to 60 deg
)
_DECLARED: Final = {  # keys of a simulated sensor that the flight file has under another name
    "noise_time_s": "correlation_time_s",
    "noise_m": "sigma_m",
    "noise_mps": "sigma_mps",
    "noise_deg": "sigma_deg",
    "noise_ut": "sigma_ut",
}
_OF_THE_TRUTH: Final = {"kind", "name", "rate_hz", "time_offset_s", "down_ut"}


def slow_errors_of(gnss: SimulatedGnss) -> SlowErrorSizes:
    """Return the sizes of what lasts in a simulated log: errors of messages and air, and reflections.

    Reflections vary with elevation and the file has one size for them: the rms over an even sky above the mask. A
    satellite has one correlation time: that of the larger of its errors.
    """
    orbit, air = gnss.ephemeris_errors, gnss.air_errors
    across2 = orbit.along_m**2 + orbit.cross_m**2
    message2 = orbit.clock_m**2 + (_RADIAL * orbit.radial_m) ** 2 + _ACROSS2 * across2
    lasting = [(message2, NO_SLOW_ERRORS.satellite_time_s)]
    if gnss.multipath is not None:
        lasting.append((reflections_m(gnss) ** 2, gnss.multipath.correlation_time_s))
    if gnss.specular is not None:
        lasting.append((mirrored_m(gnss) ** 2, mirrored_s(gnss.specular.height_m)))
    variance = sum(variance for variance, _ in lasting)
    _, time_s = max(lasting, key=itemgetter(0))
    return NO_SLOW_ERRORS.model_copy(
        update={
            "satellite_m": {"G": math.sqrt(variance)},
            "satellite_time_s": time_s,
            "ionosphere_zenith_m": air.ionosphere_m,
            "no_ionosphere_zenith_m": air.ionosphere_m,
            "troposphere_zenith_m": air.troposphere_m,
            "air_time_s": air.correlation_time_s,
        }
    )


def reflections_m(gnss: SimulatedGnss) -> float:
    """Return the rms of the code's reflections without a geometry, over an even sky above the mask [m]."""
    echo = gnss.multipath
    if echo is None:
        return 0.0
    elevation_deg = np.degrees(np.arcsin(_sines(gnss)))
    sigma = echo.floor_m + echo.horizon_m * np.exp(-elevation_deg / echo.scale_deg)
    return float(np.sqrt(np.mean(sigma**2)))


def mirrored_m(gnss: SimulatedGnss) -> float:
    """Return the rms of what a mirror below the antenna adds to the code [m].

    Equation: a path longer by 2 h sin E, of relative amplitude a and any phase, moves the code by a 2 h sin E cos phi.
    """
    mirror = gnss.specular
    if mirror is None:
        return 0.0
    longer = 2.0 * mirror.height_m * _sines(gnss)
    return float(mirror.amplitude * np.sqrt(np.mean(longer**2) / 2.0))


def mirrored_s(height_m: float) -> float:
    """Return the correlation time [s] of the error of a mirror below the antenna by ``height_m``.

    Equation: the phase phi = 2 pi 2 h sin E / lambda turns at w = 4 pi h (sin E)' / lambda as the satellite rises. Over
    times longer than 1 / w the sine averages out, and faster than a Gauss-Markov error of that correlation time.
    """
    return C_MPS / L1_HZ / (4.0 * math.pi * height_m * _SINE_RATE)


def _sines(gnss: SimulatedGnss) -> Float64:
    return np.linspace(np.sin(np.radians(gnss.horizon_mask_deg)), 1.0, _SKY_POINTS)


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
