"""The interference margin of a phase loop that an inertial system aids.

::

    from insgnss.interference import PhaseLoop, discriminator, greatest_drift, margin_db, margin_in_motion_db

    loop = PhaseLoop(discriminator("IQ"), bandwidth_hz=1.022e6, accumulation_s=0.01)
    margin_db(3167.0, loop)           # J/S in dB for a drift of 3167 rad^2/s^3, one-sided
    greatest_drift(40.0, loop)        # the drift that allows 40 dB
    margin_in_motion_db(100.0, 49.0, 3.3, 1.6e9, loop)    # of a loop without aiding that turns with 5 g

All spectral densities of phase, frequency and their rates are one-sided in this room unless a name says otherwise:
twice the two-sided intensities that the filter's models use (``optimal_loop.one_sided``, ``two_sided``).
"""

from __future__ import annotations

from insgnss.interference.discriminators import (
    DISCRIMINATORS,
    ENGINEERING_RATIO,
    Discriminator,
    discriminator,
    equivalent_noise,
)
from insgnss.interference.drift import (
    density_of_allan,
    density_of_grade,
    density_of_record,
    density_of_walk,
    greatest_rule_bias,
    ins_density,
    oscillator_density,
    oscillator_of_allan,
    total_density,
)
from insgnss.interference.linear_threshold import (
    PhaseThreshold,
    one_stage_velocity_mps,
    phase_covariance,
    phase_rms_rad,
    phase_threshold,
    two_stage_velocity_mps,
)
from insgnss.interference.lock_thresholds import LockThreshold, lock_threshold
from insgnss.interference.margin import (
    PhaseLoop,
    bandwidth_at_margin_hz,
    diagram,
    greatest_drift,
    margin_db,
    margin_in_motion_db,
    threshold_cn0_dbhz,
    trade_off,
)
from insgnss.interference.optimal_loop import (
    discrete_gains,
    discrete_noise_bandwidth,
    gains,
    noise_bandwidth,
    noise_bandwidth_of_gains,
    threshold_noise,
)
from insgnss.interference.phase_models import (
    PhaseModel,
    UnknownAcceleration,
    channel_model,
    one_stage_model,
    receiver_models,
)
from insgnss.interference.third_order import third_order_gains

__all__ = [
    "DISCRIMINATORS",
    "ENGINEERING_RATIO",
    "Discriminator",
    "LockThreshold",
    "PhaseLoop",
    "PhaseModel",
    "PhaseThreshold",
    "UnknownAcceleration",
    "bandwidth_at_margin_hz",
    "channel_model",
    "density_of_allan",
    "density_of_grade",
    "density_of_record",
    "density_of_walk",
    "diagram",
    "discrete_gains",
    "discrete_noise_bandwidth",
    "discriminator",
    "equivalent_noise",
    "gains",
    "greatest_drift",
    "greatest_rule_bias",
    "ins_density",
    "lock_threshold",
    "margin_db",
    "margin_in_motion_db",
    "noise_bandwidth",
    "noise_bandwidth_of_gains",
    "one_stage_model",
    "one_stage_velocity_mps",
    "oscillator_density",
    "oscillator_of_allan",
    "phase_covariance",
    "phase_rms_rad",
    "phase_threshold",
    "receiver_models",
    "third_order_gains",
    "threshold_cn0_dbhz",
    "threshold_noise",
    "total_density",
    "trade_off",
    "two_stage_velocity_mps",
]
