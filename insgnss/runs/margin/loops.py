"""The phase loops of a run's satellites: carrier, accumulation, separation from each emitter, thresholds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from insgnss.config.flight import ImuGrade, Oscillator
from insgnss.config.interference import Emitter, InterferenceConfig, LoopReceiver
from insgnss.errors import ConfigError, ModelError
from insgnss.gnss.signals import L1_HZ, carrier_hz, signal_of
from insgnss.inertial.sensor_model import sensor_model
from insgnss.interference.discriminators import Discriminator, discriminator, inverse_cn0
from insgnss.interference.drift import density_of_walk, per_mps, phase_walk_of
from insgnss.interference.margin import PhaseLoop
from insgnss.interference.spectra import (
    Modulation,
    broadband_separation,
    line_separation,
    modulation_of,
    power_within,
    signal_name,
)
from insgnss.interference.steady_acceleration import threshold_in_motion
from insgnss.runs.result import Run
from insgnss.tables import Float64, Int64

_LEAST_POWER: Final = 0.5  # of a signal that a front end has to pass


@dataclass(frozen=True)
class SignalLoop:
    """The loop of one satellite's signal."""

    carrier_hz: float
    loop: PhaseLoop
    separation: Float64  # (m,) of each emitter [1/Hz]


@dataclass(frozen=True)
class Disturbances:
    """The inputs that do not depend on the satellite; densities one-sided, at 1575.42 MHz unless in metres."""

    oscillator: float  # [rad^2/s^3]
    phase_walk: float  # [rad^2/s]
    accel_noise: float  # of the inertial sensor [m^2/s^3]


def disturbances(run: Run, config: InterferenceConfig) -> Disturbances:
    """Return the run's oscillator and inertial noise, or the settings' replacements.

    Raises
    ------
    ConfigError : the run does not say which oscillator it had, or that has no random walk
    """
    oscillator, grade = _sensor(run, "oscillator", Oscillator), _sensor(run, "imu_grade", ImuGrade)
    walk = config.dynamics.oscillator_density
    if walk is None:
        if oscillator is None or oscillator.h_minus2_per_s == 0.0:
            raise ConfigError(
                "the run states no drift of its oscillator",
                key="dynamics.oscillator_density",
                advice="give its one-sided density in rad^2/s^3 at 1575.42 MHz, 77 for a common TCXO",
            )
        walk = float(density_of_walk(oscillator.h_minus2_per_s, L1_HZ))
    white = oscillator is not None and config.dynamics.white_frequency_noise
    return Disturbances(
        walk,
        float(phase_walk_of(oscillator.h0_s, L1_HZ)) if white and oscillator is not None else 0.0,
        0.0 if grade is None else 2.0 * sensor_model(grade).accel_density,
    )


def _sensor(run: Run, key: str, model: type[Any]) -> Any:
    value = run.settings.get(key)
    if isinstance(value, Mapping):
        return model.model_validate(dict(value))
    return value if isinstance(value, model) else None


def signal_loop(
    sv: str, receiver: LoopReceiver, emitters: tuple[Emitter, ...], channels: Mapping[str, int]
) -> SignalLoop:
    """Return the loop of a satellite.

    Raises
    ------
    ModelError : there is no such signal or discriminator
    ConfigError : the front end is too narrow for the signal
    """
    # mypy knows the letters of the dictionary as literals, a satellite's name as a text
    code = {str(letter): code for letter, code in receiver.signals.items()}.get(sv[0])
    signal = None if code is None else signal_of(sv[0], code)
    if signal is None:
        raise ModelError(
            f"no signal '{code}' of this constellation",
            satellite=sv,
            advice=f'name a RINEX code under receiver.signals, {sv[0]} = "C1C"',
        )
    modulation = modulation_of(signal)
    power = power_within(modulation, receiver.front_end_hz)
    if power < _LEAST_POWER:
        raise ConfigError(
            f"a front end of {receiver.front_end_hz / 1e6:g} MHz passes {power:.0%} of {signal_name(signal)}",
            key="receiver.front_end_hz",
            advice=f"its main lobes take {modulation.null_to_null_hz / 1e6:.4g} MHz",
        )
    carrier = carrier_hz(sv[0], signal.codes[0], channels.get(sv, 0))
    kind: Discriminator = discriminator(receiver.discriminator, receiver.threshold_ratio)
    period = receiver.accumulation_s or modulation.symbol_s
    loop = PhaseLoop(kind, modulation.null_to_null_hz, period)
    separations = [separation(modulation, receiver.front_end_hz, carrier, emitter) for emitter in emitters]
    return SignalLoop(carrier, loop, np.array(separations))


def separation(modulation: Modulation, front_end_hz: float, carrier: float, emitter: Emitter) -> float:
    """Return the spectral separation of a signal and an emitter [1/Hz]."""
    offset = emitter.frequency_hz - carrier
    if emitter.bandwidth_hz is None:
        return line_separation(modulation, front_end_hz, offset)
    return broadband_separation(modulation, front_end_hz, offset, emitter.bandwidth_hz)


class LoopThreshold(NamedTuple):
    """Where a loop loses lock, (n,): the better of second and third order."""

    drift: Float64  # S of the Wiener drift of the same threshold, one-sided [rad^2/s^3]
    inverse_cn0: Float64  # 1/q [1/Hz]
    order: Int64


def unaided_and_aided(
    loop: SignalLoop,
    disturbance: Disturbances,
    motion_mps2: Float64,
    residual_mps2: Float64,
    config: InterferenceConfig,
) -> tuple[LoopThreshold, LoopThreshold]:
    """Return the thresholds without and with aiding.

    Equation: without: oscillator and the acceleration along the line of sight; with: oscillator, the inertial sensor's
    white noise 2 (2 pi f0 / c)^2 N_a^2, and what the aiding's acceleration is off by. Both accelerations last, and
    either loop may carry its acceleration as a third state (``threshold_in_motion``).
    """
    to_carrier = (loop.carrier_hz / L1_HZ) ** 2
    base = disturbance.oscillator * to_carrier
    noise = per_mps(loop.carrier_hz) ** 2 * disturbance.accel_noise
    times = config.dynamics

    def of(density: float, sigma: Float64, time_s: float) -> LoopThreshold:
        kind, walk = loop.loop.discriminator, disturbance.phase_walk * to_carrier
        found_at = threshold_in_motion(density, sigma, time_s, loop.carrier_hz, kind.threshold_rms_rad, walk)
        inverse = inverse_cn0(kind, found_at.noise, loop.loop.accumulation_s)
        return LoopThreshold(found_at.density, inverse, found_at.order)

    return (
        of(base, motion_mps2, times.manoeuvre_time_s),
        of(base + noise, residual_mps2, times.aiding_time_s),
    )
