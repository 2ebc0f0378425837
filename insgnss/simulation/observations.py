"""Pseudorange, Doppler and carrier phase as a receiver reports them: light time and Earth's turn in the inertial frame.

A receiver tags its measurements with its own clock: at tag T the true time is ``t = T - bias / c``. The pseudorange is
``c (T - the satellite's clock reading at transmission)`` plus the atmosphere, and the range rate its derivative by T.
The carrier phase, where it is asked for, is the same path with the sign of the ionosphere turned, and cycles of its
own for each signal.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from insgnss.constants import C_MPS, NS_PER_S, NS_PER_WEEK
from insgnss.geodesy.directions import unit_vectors
from insgnss.geodesy.local_level import ned_axes
from insgnss.geodesy.rotations import EARTH_RATE_E
from insgnss.gnss.noise_model import REFERENCE_CN0_DBHZ
from insgnss.gnss.signals import ionosphere_factor, signal_of, wavelength_m
from insgnss.simulation.atmosphere import Atmosphere, vacuum
from insgnss.simulation.oscillator import ClockTruth
from insgnss.simulation.signal_errors import Disturbance, ObservationNoise, PathErrors, SkyGeometry
from insgnss.simulation.signal_paths import AntennaMotion as AntennaMotion
from insgnss.simulation.signal_paths import SignalPaths as SignalPaths
from insgnss.simulation.signal_paths import antenna_motion as antenna_motion
from insgnss.simulation.signal_paths import paths_to as paths_to
from insgnss.simulation.signal_paths import signal_paths as signal_paths
from insgnss.simulation.trajectory import Trajectory
from insgnss.tables import Bool, EphemerisTable, Float64, GnssTable, Int8

SYSTEM = "G"  # all simulated satellites are GPS's
SIGNAL = "C1C"
WAVELENGTH_M = wavelength_m(SYSTEM, SIGNAL)
MOST_AMBIGUITY_CYCLES = 1_000_000
AIR_RATE_STEP_S = 0.5  # a delay's third derivative leaves 1e-8 m/s
LOWEST_ANTENNA_GAIN = 1e-3  # of the field: -60 dB, straight below the antenna


class StrengthOf(Protocol):
    """Antennas and link budget."""

    def cn0_dbhz(self, direction_b: Float64) -> Float64:
        """Return C/N0 (m, n) towards unit directions (m, n, 3), body axes."""


class Tracking(Protocol):
    """The treatment of weak or lost signals."""

    def apply(
        self, seen: SignalObservations, strength_dbhz: Float64, rng: np.random.Generator | None
    ) -> SignalObservations:
        """Return the receiver's measurements of signals whose mean C/N0 is ``strength_dbhz`` (m, n)."""


@dataclass(frozen=True)
class NoiseTerms:
    """One sigma of white noise: ``s^2 = floor^2 + (elevation / sin el)^2 + cn0^2 10^((45 - C/N0) / 10)``, one unit."""

    floor: float
    elevation: float = 0.0
    cn0: float = 0.0

    def sigma(self, elevation: Float64, cn0_dbhz: Float64) -> Float64:
        """Return sigma for elevations [rad] and C/N0 [dBHz]."""
        sine = np.maximum(np.sin(elevation), 0.05)
        thermal = 10.0 ** (0.1 * (REFERENCE_CN0_DBHZ - cn0_dbhz))
        return np.asarray(np.sqrt(self.floor**2 + (self.elevation / sine) ** 2 + self.cn0**2 * thermal))


@dataclass(frozen=True)
class SimulatedReceiver:
    """The antenna and the receiver's measurements."""

    lever_arm_b: tuple[float, float, float] = (0.0, 0.0, 0.0)  # IMU to antenna, forward-right-down [m]
    rate_hz: float = 1.0
    first_tag_s: float = 0.0
    horizon_mask_deg: float = 5.0  # lowest elevation above the horizon
    # lowest elevation above the antenna's own plane; None: no such mask
    antenna_mask_deg: float | None = None
    boresight_cn0_dbhz: float = 48.0
    cn0_sigma_db: float = 0.5
    pseudorange_noise: ObservationNoise = NoiseTerms(2.0)
    range_rate_noise: ObservationNoise = NoiseTerms(0.1)
    atmosphere: Atmosphere = vacuum
    signals: tuple[str, ...] = (SIGNAL,)  # RINEX codes, each tracked on every satellite
    carrier_noise: ObservationNoise | None = (
        None  # of one phase, not of a difference; None: no carrier phase is logged
    )
    reception: StrengthOf | None = None  # antennas by their patterns; None: one patch upwards, by its formula
    tracking: Tracking | None = None
    disturbances: tuple[Disturbance, ...] = ()


@dataclass(frozen=True)
class SignalObservations:
    """Observations of all signals at all tags, tracked or not: the form in which faults are put in."""

    sv_names: tuple[str, ...]  # of each column
    signals: tuple[str, ...]  # RINEX code of each column
    tag_s: Float64  # (m,)
    pseudorange_m: Float64  # (m, n)
    range_rate_mps: Float64  # (m, n)
    cn0_dbhz: Float64  # (m, n)
    tracked: Bool  # (m, n)
    carrier_cycles: Float64 | None = None  # (m, n)
    lli: Int8 | None = None  # (m, n) loss-of-lock indicator of the carrier


Fault = Callable[[SignalObservations], SignalObservations]


def observe(
    trajectory: Trajectory,
    eph: EphemerisTable,
    start_ns: int,
    clock: ClockTruth,
    receiver: SimulatedReceiver,
    rng: np.random.Generator | None,
    faults: Sequence[Fault] = (),
) -> SignalObservations:
    """Return the receiver's observations of the satellites of ephemerides, one each; see ``observe_paths``."""
    t_s = clock.true_s
    antenna = antenna_motion(trajectory, t_s, receiver.lever_arm_b)
    paths = signal_paths(antenna, eph, start_ns, t_s)
    group_delay_s = eph.group_delay_s[:, 0]
    return observe_paths(
        paths, eph.sv_names, group_delay_s, start_ns, clock, receiver, rng, faults, C_eb=antenna.C_eb
    )


def observe_paths(
    paths: SignalPaths,
    sv_names: tuple[str, ...],
    group_delay_s: Float64,
    start_ns: int,
    clock: ClockTruth,
    receiver: SimulatedReceiver,
    rng: np.random.Generator | None,
    faults: Sequence[Fault] = (),
    *,
    C_eb: Float64 | None = None,
) -> SignalObservations:
    """Return the receiver's observations at the tags of its clock; without a generator, free of noise.

    Equation: ``P = rho + b - c (dt_s - k TGD) + T + I``;
    ``d Phi/dT = c - c (1 + dt_s') (1 - rho'/c) (1 - b'/c) + T' - I'``, the range rate, which is the carrier's;
    ``lambda Phi = rho + b - c dt_s + T - I + lambda N``. The columns are all satellites of the first signal, then of
    the next.

    Parameters
    ----------
    paths : to n satellites, at the true times of the clock's m tags
    sv_names : of the satellites
    group_delay_s : (n,) their TGD
    start_ns : GPS time of the trajectory's t = 0
    clock : bias and drift at each tag
    faults : applied in order to the finished observations
    C_eb : (m, 3, 3) attitudes, for a receiver with antenna patterns
    """
    week_s = start_ns % NS_PER_WEEK / NS_PER_S + clock.true_s
    codes = receiver.signals
    elevation = np.tile(paths.elevation, len(codes))
    ticks = (1.0 + paths.satellite.clock_rate) * (1.0 - paths.range_rate_mps / C_MPS)
    range_rate = np.tile(C_MPS * (1.0 - ticks * (1.0 - clock.drift_mps[:, None] / C_MPS)), len(codes))
    range_rate = range_rate + _air_rate_mps(paths, receiver, week_s)
    pseudorange = _code_m(paths, group_delay_s, clock, receiver, week_s)
    strength = cn0 = np.tile(_strength_dbhz(C_eb, paths, receiver), len(codes))
    if rng is not None:
        white = rng.standard_normal((3, *pseudorange.shape))
        cn0 = cn0 + receiver.cn0_sigma_db * white[0]
        pseudorange = pseudorange + receiver.pseudorange_noise.sigma(elevation, cn0) * white[1]
        range_rate = range_rate + receiver.range_rate_noise.sigma(elevation, cn0) * white[2]
    observations = SignalObservations(
        sv_names=sv_names * len(codes),
        signals=tuple(code for code in codes for _ in sv_names),
        tag_s=clock.tag_s,
        pseudorange_m=pseudorange,
        range_rate_mps=range_rate,
        cn0_dbhz=cn0,
        tracked=np.tile(_above_masks(paths, receiver), len(codes)),
    )
    if receiver.carrier_noise is not None:
        phase = _carrier_m(paths, clock, receiver, week_s)
        observations = _with_carrier(observations, phase, receiver.carrier_noise, elevation, rng)
    if rng is not None and receiver.disturbances:
        sky = _sky_geometry(paths, clock.true_s, receiver)
        for disturbance in receiver.disturbances:
            observations = _disturbed(observations, disturbance(sky, rng), sky)
    if receiver.tracking is not None:
        observations = receiver.tracking.apply(observations, strength, rng)
    for fault in faults:
        observations = fault(observations)
    return observations


def _strength_dbhz(C_eb: Float64 | None, paths: SignalPaths, receiver: SimulatedReceiver) -> Float64:
    """Return the mean C/N0 of all satellites (m, n); an antenna's own pattern needs the attitude."""
    if receiver.reception is None or C_eb is None:
        return receiver.boresight_cn0_dbhz + cardioid_gain_db(paths.antenna_elevation)
    return receiver.reception.cn0_dbhz(np.einsum("mib,mni->mnb", C_eb, directions_e(paths)))


def directions_e(paths: SignalPaths) -> Float64:
    """Return unit directions (m, n, 3) towards the satellites in ECEF axes."""
    u_n = unit_vectors(paths.azimuth, paths.elevation)
    return np.asarray(np.einsum("mij,mni->mnj", ned_axes(paths.geodetic), u_n))


def _sky_geometry(paths: SignalPaths, t_s: Float64, receiver: SimulatedReceiver) -> SkyGeometry:
    satellite, count = paths.satellite, paths.range_m.shape[1]
    columns = [code for code in receiver.signals for _ in range(count)]
    return SkyGeometry(
        t_s=t_s,
        elevation=paths.elevation,
        direction_e=directions_e(paths),
        satellite_r_e=satellite.r_e,
        satellite_inertial_v_e=satellite.v_e + np.cross(EARTH_RATE_E, satellite.r_e),
        codes=len(receiver.signals),
        wavelength_m=np.array([wavelength_m(SYSTEM, code) for code in columns]),
        ionosphere_factor=np.array([ionosphere_factor(SYSTEM, code) for code in columns]),
    )


def _disturbed(seen: SignalObservations, added: PathErrors, sky: SkyGeometry) -> SignalObservations:
    """Return the observations with a disturbance; the range rate gets the slope of the carrier's part."""
    carrier = seen.carrier_cycles
    slope = np.gradient(added.carrier_m, sky.t_s, axis=0) if len(sky.t_s) > 1 else 0.0
    return replace(
        seen,
        pseudorange_m=seen.pseudorange_m + added.code_m,
        range_rate_mps=seen.range_rate_mps + slope,
        carrier_cycles=None if carrier is None else carrier + added.carrier_m / sky.wavelength_m,
    )


def _code_m(
    paths: SignalPaths,
    group_delay_s: Float64,
    clock: ClockTruth,
    receiver: SimulatedReceiver,
    week_s: Float64,
) -> Float64:
    """Return the pseudoranges of all signals without noise."""
    parts = []
    for code in receiver.signals:
        signal = signal_of(SYSTEM, code)
        assert signal is not None, code
        satellite_clock = paths.satellite.clock_s - signal.group_delay[0] * group_delay_s
        delay = receiver.atmosphere(
            paths.geodetic, paths.azimuth, paths.elevation, week_s, ionosphere_factor(SYSTEM, code)
        )
        parts.append(paths.range_m + clock.bias_m[:, None] - C_MPS * satellite_clock + delay)
    return np.hstack(parts)


def _carrier_m(
    paths: SignalPaths, clock: ClockTruth, receiver: SimulatedReceiver, week_s: Float64
) -> Float64:
    """Return the carrier phases of all signals without noise and ambiguity [m]; a group delay is part of the latter."""
    path = paths.range_m + clock.bias_m[:, None] - C_MPS * paths.satellite.clock_s
    where = paths.geodetic, paths.azimuth, paths.elevation, week_s
    return np.hstack(
        [path + receiver.atmosphere(*where, -ionosphere_factor(SYSTEM, code)) for code in receiver.signals]
    )


def _air_rate_mps(paths: SignalPaths, receiver: SimulatedReceiver, week_s: Float64) -> Float64:
    """Return by how much the air lengthens the carriers of all signals per second: central differences of its delay."""
    rates = []
    for code in receiver.signals:
        before, after = (
            receiver.atmosphere(*paths.sky_at(step), week_s + step, -ionosphere_factor(SYSTEM, code))
            for step in (-AIR_RATE_STEP_S, AIR_RATE_STEP_S)
        )
        rates.append((after - before) / (2.0 * AIR_RATE_STEP_S))
    return np.hstack(rates)


def _with_carrier(
    observations: SignalObservations,
    phase_m: Float64,
    noise: ObservationNoise,
    elevation: Float64,
    rng: np.random.Generator | None,
) -> SignalObservations:
    """Return the observations with carrier phases: white noise and an ambiguity for each column."""
    wavelength = np.array([wavelength_m(SYSTEM, code) for code in observations.signals])
    ambiguity = np.zeros(len(wavelength))
    if rng is not None:
        phase_m = phase_m + noise.sigma(elevation, observations.cn0_dbhz) * rng.standard_normal(phase_m.shape)
        ambiguity += rng.integers(-MOST_AMBIGUITY_CYCLES, MOST_AMBIGUITY_CYCLES, len(wavelength))
    return replace(
        observations, carrier_cycles=phase_m / wavelength + ambiguity, lli=np.zeros(phase_m.shape, np.int8)
    )


def cardioid_gain_db(antenna_elevation: Float64) -> Float64:
    """Return the gain against boresight of a patch antenna, ``20 log10((1 + sin el) / 2)``."""
    field = np.maximum(0.5 * (1.0 + np.sin(antenna_elevation)), LOWEST_ANTENNA_GAIN)
    return np.asarray(20.0 * np.log10(field))


def _above_masks(paths: SignalPaths, receiver: SimulatedReceiver) -> Bool:
    above = paths.elevation >= np.deg2rad(receiver.horizon_mask_deg)
    if receiver.antenna_mask_deg is not None:
        above &= paths.antenna_elevation >= np.deg2rad(receiver.antenna_mask_deg)
    return np.asarray(above)


def to_table(observations: SignalObservations, start_ns: int) -> GnssTable:
    """Return the tracked observations as a log would give them: rows by epoch, Doppler only."""
    names, codes = (tuple(dict.fromkeys(n)) for n in (observations.sv_names, observations.signals))
    epoch, column = np.nonzero(observations.tracked)
    t_ns = start_ns + np.rint(observations.tag_s * NS_PER_S).astype(np.int64)
    wavelength = np.array([wavelength_m(SYSTEM, code) for code in observations.signals])
    carrier, lli = observations.carrier_cycles, observations.lli
    return GnssTable(
        t_ns=t_ns[epoch],
        sv=np.array([names.index(name) for name in observations.sv_names], np.int16)[column],
        signal=np.array([codes.index(code) for code in observations.signals], np.int16)[column],
        pseudorange_m=observations.pseudorange_m[epoch, column],
        doppler_hz=-observations.range_rate_mps[epoch, column] / wavelength[column],
        range_rate_mps=np.full(len(column), np.nan),
        cn0_dbhz=observations.cn0_dbhz[epoch, column],
        sv_names=names,
        signal_names=codes,
        carrier_cycles=None if carrier is None else carrier[epoch, column],
        lli=None if lli is None else lli[epoch, column],
    )
