"""Where a receiver study flies: motion, sky, signal and sensors, checked, as the setting of its runs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from insgnss.config.flight import ImuGrade
from insgnss.config.library import file_of, imu_grade
from insgnss.config.library import oscillator as oscillator_named
from insgnss.config.manoeuvres import Straight
from insgnss.config.simulation import SimulationConfig
from insgnss.config.strict import load_toml
from insgnss.errors import ConfigError
from insgnss.interference.drift import density_of_walk
from insgnss.interference.margin import db
from insgnss.simulation.assembly import Inputs, trajectory_of
from insgnss.simulation.closed_loop_sky import (
    closed_loop_truth,
    inertial_truth,
    orbits_towards,
)
from insgnss.simulation.trajectory import Trajectory
from insgnss.studies.receiver.admission import (
    check_options,
    integrations,
    require_imu,
    require_slow_oscillator,
    with_duration,
)
from insgnss.studies.receiver.options import AVERAGED_S, ReceiverOptions
from insgnss.studies.receiver.runs import Setting
from insgnss.studies.receiver.variants import STARTS
from insgnss.tables import Float64
from insgnss.tracking.admissible import require_known, require_within
from insgnss.tracking.vector_loop import TRACKINGS, channels_of

# after the scenario's first moment: inertial samples come before the first integration
_BEGINS_S: Final = 1.0
_RECORD_S: Final = 0.1
_MAX_DRIFT: Final = (
    1e9  # of an oscillator: a hundred thousand times a crystal without compensation [rad^2/s^3]
)


class LaidCourse(NamedTuple):
    """A scenario and the motion that its manoeuvres make."""

    config: SimulationConfig
    trajectory: Trajectory
    whole_s: float  # how long it lasts


@dataclass(frozen=True)
class StudyScene:
    """A study's setting, and what its tables say of it."""

    course: LaidCourse
    setting: Setting
    azimuth_deg: Float64
    elevation_deg: Float64
    begins_s: float  # seconds of the scenario at the study's begin
    fall: int  # integration at which C/N0 falls

    @property
    def name(self) -> str:
        """Return the name of the scenario."""
        return self.course.config.name or "scenario"

    @property
    def trajectory(self) -> Trajectory:
        """Return the vehicle's motion."""
        return self.course.trajectory

    @property
    def options(self) -> ReceiverOptions:
        """Return the study's options, with its duration."""
        return self.setting.options

    @property
    def bandwidth_hz(self) -> float:
        """Return the bandwidth of the spectrum that a jammer of J/S lies in."""
        return self.options.chip_hz

    @property
    def start_s(self) -> float:
        """Return the seconds of the week at the trajectory's begin."""
        return self.course.config.start_s

    @property
    def channels(self) -> int:
        """Return the number of channels."""
        return len(self.azimuth_deg)

    def js_db(self, cn0_dbhz: float) -> float:
        """Return J/S that leaves a C/N0, thermal noise left out."""
        return float(db(self.bandwidth_hz)) - cn0_dbhz


def scene_of(
    scenario: str | Path | SimulationConfig,
    tracking: str,
    imu: str | ImuGrade | None,
    oscillator: str | Mapping[str, float],
    options: ReceiverOptions,
    *,
    whole: bool = False,
) -> StudyScene:
    """Return the scene of a study.

    Parameters
    ----------
    whole : a study whose duration is not given lasts as long as the motion

    Raises
    ------
    ConfigError, ModelError : an unknown name, numbers that make no sense, or a motion shorter than the study
    """
    require_known(tracking, TRACKINGS, "tracking", "kind of tracking")
    require_imu(imu)
    check_options(options)
    course = _laid(scenario)
    trajectory, whole_s = course.trajectory, course.whole_s
    begins_s = _begin_s(course.config, whole_s, options)
    o, step = with_duration(options, whole_s - begins_s, whole=whole), options.step_s
    interval, fall, average, count = integrations(o)
    r_e = trajectory.position_e(np.array([trajectory.first_s]))[0]
    lowest_m = float(np.linalg.norm(r_e))
    require_within(lowest_m, math.inf, "give metres from the Earth's centre", orbit_radius_m=o.orbit_radius_m)
    sky = orbits_towards(r_e, o.azimuth_deg, o.elevation_deg, o.orbit_radius_m)
    truth = closed_loop_truth(trajectory, sky, step, begins_s, count)
    sample_s = step if o.imu_rate_hz is None else 1.0 / o.imu_rate_hz
    setting = Setting(
        truth=truth,
        inertial=None if imu is None else inertial_truth(trajectory, truth, sample_s, o.latency_s),
        grade=imu_grade(imu) if isinstance(imu, str) else imu,
        channels=channels_of(
            tracking, step, o.carrier_hz, o.chip_hz, phase_kind=o.phase_kind, spacing_chips=o.spacing_chips
        ),
        drift_density=_drift_density(oscillator, o.carrier_hz),
        interval=interval,
        record_every=max(round(_RECORD_S / step), 1),
        settle=average,
        start=STARTS[tracking],
        options=o,
    )
    require_slow_oscillator(setting.drift_density, setting.channels)
    azimuth, elevation = (np.asarray(x, float) for x in (o.azimuth_deg, o.elevation_deg))
    return StudyScene(course, setting, azimuth, elevation, begins_s, fall)


def _begin_s(config: SimulationConfig, whole_s: float, o: ReceiverOptions) -> float:
    """Return when the study begins, in seconds of the scenario.

    Straight flight ahead of the first manoeuvre is cut short to ``settle_s``, as far as the motion lasts long enough:
    the manoeuvre begins when C/N0 falls, at the latest.
    """
    straight_s = 0.0
    for part in config.manoeuvre:
        if not isinstance(part, Straight):
            break
        straight_s += part.duration_s
    else:
        return _BEGINS_S
    latest_s = whole_s - (o.settle_s + AVERAGED_S if o.duration_s is None else o.duration_s)
    return max(_BEGINS_S, min(straight_s - o.settle_s, latest_s))


def _laid(scenario: str | Path | SimulationConfig) -> LaidCourse:
    """Return the course of a scenario.

    Raises
    ------
    ConfigError, ModelError : it does not exist, or it has no list of manoeuvres
    """
    if isinstance(scenario, SimulationConfig):
        config = scenario
    else:
        config = load_toml(file_of("scenarios", scenario), SimulationConfig)
    if not config.manoeuvre:
        raise ConfigError(
            "the scenario follows a logged reference",
            key="manoeuvre",
            advice="give one with a list of manoeuvres",
        )
    return _course(config)


@lru_cache(maxsize=2)
def _course(config: SimulationConfig) -> LaidCourse:
    """Return the course of a list of manoeuvres; studies that follow each other fly the one that has been laid."""
    return LaidCourse(config, *trajectory_of(config, Inputs(), 0))


def _drift_density(oscillator: str | Mapping[str, float], carrier_hz: float) -> float:
    """Return S of the carrier's frequency, one-sided [rad^2/s^3]; 0 of an oscillator without drift.

    Raises
    ------
    ConfigError, ModelError : an unknown oscillator or key
    """
    if isinstance(oscillator, str):
        return float(density_of_walk(oscillator_named(oscillator).h_minus2_per_s, carrier_hz))
    if not isinstance(oscillator, Mapping):
        advice = 'give a name, or {"drift_density": 100.0}'
        raise ConfigError(f"{oscillator!r} is not an oscillator", key="oscillator", advice=advice)
    unknown = set(oscillator) - {"drift_density"}
    if unknown or "drift_density" not in oscillator:
        key = ", ".join(sorted(unknown)) or "nothing"
        raise ConfigError(
            f"an oscillator of {key}", key="oscillator", advice='give a name, or {"drift_density": 100.0}'
        )
    advice = "one-sided, rad^2/s^3: 0.02 of an oven, 100 and more of a cheap crystal"
    require_within(0.0, _MAX_DRIFT, advice, drift_density=oscillator["drift_density"])
    return float(oscillator["drift_density"])
