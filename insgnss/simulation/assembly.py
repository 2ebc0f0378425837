"""From a scenario file's settings to the scenario itself: trajectory, sky, sensors, receiver and faults."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from insgnss.antenna.equipment import mounting
from insgnss.config import signal_faults as told
from insgnss.config.flight import ImuGrade, Oscillator
from insgnss.config.library import imu_grade, oscillator
from insgnss.config.simulated_sensors import SensorFault
from insgnss.config.simulation import (
    NominalSky,
    SimulatedGnss,
    SimulationConfig,
    TableSky,
    Vibration,
    WhiteNoise,
)
from insgnss.constants import NS_PER_S, STANDARD_GRAVITY_MPS2
from insgnss.errors import ConfigError
from insgnss.geodesy.local_level import geodetic
from insgnss.gnss.signals import wavelength_m
from insgnss.gpstime import week_seconds_to_ns
from insgnss.simulation import faults
from insgnss.simulation.atmosphere import broadcast_atmosphere, vacuum
from insgnss.simulation.chosen_messages import nearest_messages, referred_to
from insgnss.simulation.further_receivers import LOCAL, FurtherReceiver, FurtherReceivers
from insgnss.simulation.imu import ImuRecord, VibrationSpectrum
from insgnss.simulation.itinerary import course_of, knot_s_of
from insgnss.simulation.logged_reference import follow_reference
from insgnss.simulation.observations import SYSTEM, Fault, NoiseTerms, SimulatedReceiver
from insgnss.simulation.reception import (
    CA_CHIP_M,
    CarrierLoopNoise,
    CodeLoopNoise,
    FrequencyLoopNoise,
    ReceivingAntenna,
    Reception,
    TrackingRules,
)
from insgnss.simulation.signal_errors import (
    AirResiduals,
    Disturbance,
    MarkovMultipath,
    MessageErrors,
    SpecularReflection,
)
from insgnss.simulation.simulated_log import ClockStart, Scenario
from insgnss.simulation.sky import (
    KLOBUCHAR,
    LEAP_SECONDS,
    SkyTrack,
    constellation_over,
    nominal_constellation,
)
from insgnss.simulation.trajectory import Trajectory
from insgnss.tables import NavigationData, ReferenceTable
from insgnss.units import deg_to_rad

LONGEST_S: Final = 13_500.0  # one message for each satellite, which holds for 4 h
_TOE_STEP_S: Final = 600
_L5_CHIP_M: Final = CA_CHIP_M / 10.0  # IS-GPS-705J, 3.3.2.1: 10.23 MHz


@dataclass(frozen=True)
class Inputs:
    """A scenario's data from files, read by the code that knows their formats."""

    navigation: NavigationData | None = None  # of a sky from a RINEX file or an almanac
    reference: ReferenceTable | None = None  # to follow


def assemble(
    config: SimulationConfig, folder: Path, inputs: Inputs = Inputs(), duration_s: float | None = None
) -> Scenario:
    """Return the scenario of a file in ``folder``, or its first ``duration_s``.

    Raises
    ------
    ManoeuvreError : an entry of the list of manoeuvres cannot be flown
    ConfigError, ModelError, NavigationDataError : an impossible or unknown setting, or a sky that is not of this time
    """
    start_ns = int(week_seconds_to_ns(config.gps_week, config.start_s))
    trajectory, whole_s = trajectory_of(config, inputs, start_ns)
    wanted_s = min(filter(None, (duration_s, config.duration_s, whole_s)))
    if wanted_s > LONGEST_S:
        raise ConfigError(
            f"the scenario lasts {wanted_s:.0f} s, longer than one message of each satellite holds",
            key="duration_s",
            advice=f"give at most {LONGEST_S:.0f}",
        )
    navigation = _with_qzss(config, _sky(config, trajectory, inputs, start_ns, wanted_s))
    present = set(navigation.ephemerides.sv_names)
    _check_satellites(config, present)
    shaking = config.imu.vibration
    receiver = _receiver(config.gnss, navigation, folder)
    return Scenario(
        trajectory=trajectory,
        navigation=navigation,
        grade=_grade(config, folder),
        oscillator=_oscillator(config, folder),
        start_ns=start_ns,
        duration_s=wanted_s,
        imu_rate_hz=config.imu.rate_hz,
        receiver=receiver,
        further=_further(config, receiver, folder),
        clock=ClockStart(
            config.clock.bias_m,
            config.clock.drift_mps,
            config.clock.jump_beyond_m,
            tuple((f.at_s, f.size_m) for f in config.fault if isinstance(f, told.ClockJump)),
        ),
        faults=(
            *([faults.system_offset("J", config.sky.qzss_offset_m)] if config.sky.qzss else ()),
            *(fault for entry in config.fault for fault in _faults(entry)),
        ),
        gyro_vibration=_spectrum(
            shaking, shaking.gyro_deg2_per_s2_per_hz, shaking.gyro_lines_hz_deg_per_s, deg_to_rad(1.0)
        ),
        accel_vibration=_spectrum(
            shaking, shaking.accel_g2_per_hz, shaking.accel_lines_hz_g, STANDARD_GRAVITY_MPS2
        ),
        record=ImuRecord(config.imu.tag_jitter_s, config.imu.lost_share, config.imu.lost_at_once),
        sensors=config.sensor,
        sensor_faults=config.sensor_faults,
    )


def missing_messages(config: SimulationConfig) -> set[str]:
    """Return the satellites whose messages a fault keeps out of the navigation file."""
    return {sv for fault in config.fault if isinstance(fault, told.MissingMessage) for sv in fault.sv}


def trajectory_of(config: SimulationConfig, inputs: Inputs, start_ns: int) -> tuple[Trajectory, float]:
    """Return the trajectory and how long it can be followed from the scenario's start.

    Raises
    ------
    ManoeuvreError : an entry of the list of manoeuvres cannot be flown
    ConfigError : a reference that does not cover the start
    """
    if inputs.reference is not None and config.follow is not None:
        trajectory = follow_reference(inputs.reference, config.follow.smoothing_s, start_ns)
        if trajectory.first_s > 0.0 or trajectory.last_s < 1.0:
            raise ConfigError(
                f"the reference covers {config.start_s + trajectory.first_s:.1f} to "
                f"{config.start_s + trajectory.last_s:.1f} s, not start_s = {config.start_s:.1f} s",
                key="start_s",
            )
        # clocks that are ahead or behind ask for moments around the tags
        return trajectory, trajectory.last_s - 0.5
    place = config.place
    assert place is not None
    course = course_of(config.manoeuvre, config.speed_mps)
    where = place.lat_deg, place.lon_deg, place.h_m, place.heading_deg
    return course.lay(*where, knot_s=knot_s_of(config.manoeuvre)), course.clock_s


def _sky(
    config: SimulationConfig, trajectory: Trajectory, inputs: Inputs, start_ns: int, duration_s: float
) -> NavigationData:
    """Return one message of each satellite, exactly as the navigation file will hold it."""
    middle_ns = start_ns + round(0.5 * duration_s * NS_PER_S)
    step_ns = _TOE_STEP_S * NS_PER_S
    toe_ns = (middle_ns + step_ns // 2) // step_ns * step_ns
    sky = config.sky
    if isinstance(sky, NominalSky):
        return nominal_constellation(toe_ns, sky.planes, sky.per_plane)
    if isinstance(sky, TableSky):
        lat, lon, h = geodetic(trajectory.position_e(np.zeros(1)))[0]
        tracks = tuple(SkyTrack(int(s.sv[1:]), s.azimuth_deg, s.elevation_deg) for s in sky.satellite)
        place = float(np.degrees(lat)), float(np.degrees(lon)), float(h)
        return constellation_over(place, tracks, start_ns, duration_s, toe_ns)
    navigation = inputs.navigation
    assert navigation is not None
    if sky.kind == "yuma":
        # an almanac has no ionosphere: an ordinary day's is used
        known = NavigationData(navigation.ephemerides, np.array(KLOBUCHAR), LEAP_SECONDS)
        return referred_to(known, toe_ns)
    return nearest_messages(navigation, middle_ns, 0.5 * duration_s)


def _with_qzss(config: SimulationConfig, navigation: NavigationData) -> NavigationData:
    """Return the messages with the names of the satellites that belong to QZSS."""
    names = navigation.ephemerides.sv_names
    for sv in config.sky.qzss:
        if sv not in names:
            raise ConfigError(
                "a satellite that should belong to QZSS is not in the sky",
                key="sky.qzss",
                satellite=sv,
                advice=f"in the sky: {', '.join(sorted(names))}",
            )
    renamed = {sv: f"J{number:02d}" for number, sv in enumerate(config.sky.qzss, 1)}
    names = tuple(renamed.get(sv, sv) for sv in names)
    return replace(navigation, ephemerides=replace(navigation.ephemerides, sv_names=names))


def _check_satellites(config: SimulationConfig, present: set[str]) -> None:
    """Refuse faults of satellites that are not in the sky."""
    for number, fault in enumerate(config.fault, 1):
        named = getattr(fault, "sv", ())
        for sv in (named,) if isinstance(named, str) else named:
            if sv not in present:
                raise ConfigError(
                    f"fault {number} ({fault.kind}) concerns a satellite that is not in the sky",
                    key="fault.sv",
                    satellite=sv,
                    advice=f"in the sky: {', '.join(sorted(present))}",
                )


def _grade(config: SimulationConfig, folder: Path) -> ImuGrade:
    grade = config.imu.grade
    return imu_grade(grade, (folder,)) if isinstance(grade, str) else grade


def _oscillator(config: SimulationConfig, folder: Path) -> Oscillator:
    clock = config.clock.oscillator
    return oscillator(clock, (folder,)) if isinstance(clock, str) else clock


def _spectrum(
    vibration: Vibration, density: tuple[float, ...], lines: tuple[tuple[float, float], ...], unit: float
) -> VibrationSpectrum | None:
    if not density and not lines:
        return None
    corners = vibration.frequency_hz if density else ()
    return VibrationSpectrum(
        corners,
        tuple(value * unit**2 for value in density),
        tuple((f, size * unit) for f, size in lines),
        vibration.from_s,
        vibration.end_s,
    )


def _receiver(gnss: SimulatedGnss, navigation: NavigationData, folder: Path) -> SimulatedReceiver:
    carrier = gnss.carrier_noise_m
    lever = next((a.lever_arm_m for a in gnss.antenna if a.lever_arm_m is not None), gnss.lever_arm_m)
    receiver = SimulatedReceiver(
        lever_arm_b=lever,
        rate_hz=gnss.rate_hz,
        first_tag_s=0.0,
        horizon_mask_deg=gnss.horizon_mask_deg,
        boresight_cn0_dbhz=gnss.cn0_dbhz,
        cn0_sigma_db=gnss.cn0_sigma_db,
        pseudorange_noise=_terms(gnss.pseudorange_noise_m),
        range_rate_noise=_terms(gnss.range_rate_noise_mps),
        atmosphere=vacuum if gnss.atmosphere == "none" else broadcast_atmosphere(navigation.klobuchar),
        signals=tuple(gnss.signals),
        carrier_noise=None if carrier is None else _terms(carrier),
        reception=_reception(gnss, folder),
        tracking=TrackingRules(
            gnss.threshold_dbhz, gnss.reacquire_s, gnss.slips_per_hour, gnss.slips_indicated
        ),
        disturbances=_disturbances(gnss),
    )
    return (
        receiver if gnss.loops is None else _with_loops(receiver, gnss, len(navigation.ephemerides.sv_names))
    )


def _further(config: SimulationConfig, main: SimulatedReceiver, folder: Path) -> FurtherReceivers:
    """Return the receivers of the further antennas: like the main one, at their own places."""
    attitude = config.attitude
    if attitude is None:
        return FurtherReceivers()
    C_main = mounting(config.gnss.antenna[0]) if config.gnss.antenna else np.eye(3)
    receivers = []
    for antenna in attitude.antenna:
        plain = antenna.pattern == "isotropic" and antenna.obstruction is None
        own = (ReceivingAntenna.mounted(antenna, folder),)
        receiver = replace(
            main,
            lever_arm_b=antenna.lever_arm_m,
            reception=main.reception if plain else Reception(own, config.gnss.cn0_dbhz),
            disturbances=tuple(one for one in main.disturbances if isinstance(one, LOCAL)),
        )
        C_ba = mounting(antenna)
        tilted = attitude.wind_up and not np.allclose(C_ba, C_main, rtol=0.0, atol=1e-9)
        axes = (C_main, C_ba) if tilted else None
        receivers.append(FurtherReceiver(antenna.name, receiver, antenna.clock_bias_m, axes))
    return FurtherReceivers(tuple(receivers), attitude.clocks == "separate")


def _terms(noise: WhiteNoise) -> NoiseTerms:
    return NoiseTerms(noise.floor, noise.elevation, noise.cn0_at_45_dbhz)


def _reception(gnss: SimulatedGnss, folder: Path) -> Reception | None:
    if not gnss.antenna:
        return None
    antennas = tuple(ReceivingAntenna.mounted(antenna, folder) for antenna in gnss.antenna)
    return Reception(antennas, gnss.cn0_dbhz)


def _with_loops(receiver: SimulatedReceiver, gnss: SimulatedGnss, satellites: int) -> SimulatedReceiver:
    """Return the receiver with the thermal noise of its loops in place of the white noise of the file."""
    loops = gnss.loops
    assert loops is not None
    wavelength = np.repeat([wavelength_m(SYSTEM, code) for code in gnss.signals], satellites)
    chip = np.repeat([_L5_CHIP_M if code[1] == "5" else CA_CHIP_M for code in gnss.signals], satellites)
    time_s = loops.integration_s
    carrier = CarrierLoopNoise(loops.carrier_bandwidth_hz, time_s, wavelength)
    return replace(
        receiver,
        pseudorange_noise=CodeLoopNoise(loops.code_bandwidth_hz, loops.spacing_chips, time_s, chip),
        range_rate_noise=FrequencyLoopNoise(loops.frequency_bandwidth_hz, time_s, wavelength),
        carrier_noise=None if receiver.carrier_noise is None else carrier,
    )


def _disturbances(gnss: SimulatedGnss) -> tuple[Disturbance, ...]:
    """Return the sources that the file gives any size."""
    sources: list[Disturbance] = []
    wrong, air, echo, mirror = gnss.ephemeris_errors, gnss.air_errors, gnss.multipath, gnss.specular
    if any((wrong.radial_m, wrong.along_m, wrong.cross_m, wrong.clock_m)):
        sources.append(MessageErrors(wrong.radial_m, wrong.along_m, wrong.cross_m, wrong.clock_m))
    if air.ionosphere_m or air.troposphere_m:
        sources.append(AirResiduals(air.ionosphere_m, air.troposphere_m, air.correlation_time_s))
    if echo is not None:
        scale = deg_to_rad(echo.scale_deg)
        sources.append(
            MarkovMultipath(echo.floor_m, echo.horizon_m, scale, echo.correlation_time_s, echo.carrier_ratio)
        )
    if mirror is not None:
        sources.append(SpecularReflection(mirror.height_m, mirror.amplitude))
    return tuple(sources)


def _faults(entry: told.SignalFault | SensorFault) -> tuple[Fault, ...]:
    """Return a fault's effect on the observations; a clock's jump and a missing message do nothing to them.

    Nor do the faults of further sensors.
    """
    match entry:
        case told.RangeStep():
            return (faults.range_step(entry.sv, entry.size_m, entry.from_s, entry.end_s),)
        case told.RangeRamp():
            return (faults.range_ramp(entry.sv, entry.rate_mps, entry.from_s, entry.end_s),)
        case told.Outage():
            return (faults.outage(entry.sv or None, entry.from_s, entry.end_s),)
        case told.FalseLock():
            drop = entry.cn0_drop_db
            return (
                faults.carrier_false_lock(
                    entry.sv, entry.offset_hz, entry.from_s, entry.end_s, cn0_drop_db=drop
                ),
            )
        case told.CycleSlip():
            return (faults.cycle_slip(entry.sv, entry.cycles, entry.at_s, indicated=entry.indicated),)
        case told.HalfCycle():
            return (faults.half_cycle(entry.sv, entry.from_s, entry.end_s, flagged=entry.flagged),)
        case told.ReversedRangeRate():
            return (faults.reversed_range_rate(),)
    return ()
