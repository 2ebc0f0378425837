"""Runs of one receiver along one truth: noise drawn, blocks run, errors and their consistency."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from insgnss.config.flight import ImuGrade
from insgnss.simulation.closed_loop_sky import ClosedLoopTruth, InertialTruth, told_motion
from insgnss.simulation.oscillator import simulate_clock
from insgnss.studies.receiver_loop import HELD, Arriving, ChannelRoom, Found, Receiver, Told, run_receiver
from insgnss.studies.receiver_variants import (
    STARTS,
    Start,
    Truth0,
    UnknownMotion,
    Variant,
    drift_density_mps,
    feeling_nothing,
    filter_room,
    oscillator_of,
    receiver_of,
    without_ins,
)
from insgnss.tables import Float64, Int64
from insgnss.tracking.lock_detectors import SLIP_SHARE
from insgnss.tracking.phase_discriminators import PhaseDiscriminator
from insgnss.tracking.discriminator_outputs import PHASE_KINDS
from insgnss.tracking.vector_loop import Channels, levels_of, noise_count

_BLOCK: Final = 250  # integrations whose noise is drawn at once
_LOST_HZ: Final = 100.0  # a frequency offset beyond it is lost, where the phase is not tracked ...
_LOST_S: Final = 1.0  # ... if it lasts so long; the same of one chip


@dataclass(frozen=True)
class Setting:
    """What all runs of a study have in common."""

    truth: ClosedLoopTruth
    inertial: InertialTruth | None  # None: no INS
    grade: ImuGrade | None
    channels: Channels
    carrier_hz: float
    drift_density: float  # one-sided [rad^2/s^3]
    interval: int
    record_every: int
    settle: int
    start: Start
    unknown: UnknownMotion = UnknownMotion()
    latency_s: float = 0.0

    @property
    def limits(self) -> tuple[float, float, int]:
        """Return when a channel is lost: range [m], rate [m/s], integrations."""
        k = self.channels.radians_per_m
        if self.channels.coherent:
            aperture = PhaseDiscriminator(PHASE_KINDS[self.channels.kinds[0]]).aperture_rad
            return SLIP_SHARE * aperture / k, math.inf, 0
        steps = round(_LOST_S / self.channels.step_s)
        return self.channels.chip_m, 2.0 * math.pi * _LOST_HZ / k, steps


@dataclass(frozen=True)
class ReceiverRun:
    """What one run left."""

    t_s: Float64  # (k,) since the begin
    lost_s: Float64  # (m,) inf: held
    range_rms: Float64  # (m,) of the replicas' offsets [m]
    rate_rms: Float64  # (m,) [m/s]
    position: Float64  # (k, 3) errors, ECEF [m]
    velocity: Float64  # (k, 3)
    attitude: Float64  # (k, 3) [rad]; nan without INS
    clock: Float64  # (k, 2)
    covariance: Float64  # (k, 17, 17)
    offsets: Float64  # (k, m, 2) of the channels' estimates: truth minus estimate


def run_once(setting: Setting, variant: Variant, cn0_dbhz: Float64, rng: np.random.Generator) -> ReceiverRun:
    """Return one run of a receiver; C/N0 broadcasts to (n, m)."""
    truth, channels = setting.truth, setting.channels
    count, m = truth.ranges.shape
    oscillator = oscillator_of(setting.drift_density, setting.carrier_hz)
    clock = simulate_clock(oscillator, truth.t_s - truth.t_s[0], rng)
    ins = setting.inertial is not None
    grade = setting.grade if ins else without_ins(setting.unknown)
    motion = (
        told_motion(setting.inertial, truth, grade, rng, setting.latency_s)
        if ins
        else feeling_nothing(truth.r_e[0], count)
    )
    acceleration = np.gradient(truth.v_e[:3], truth.step_s, axis=0)[0]
    at = Truth0(truth.r_e[0], truth.v_e[0], truth.C_eb[0], clock.bias_m[0], clock.drift_mps[0], acceleration)
    f = filter_room(grade, oscillator, setting.start, at, rng, ins)
    receiver = receiver_of(
        variant,
        truth.step_s,
        setting.interval,
        drift_density_mps(oscillator),
        None if ins else setting.unknown,
        setting.limits,
        setting.record_every,
        setting.settle,
    )
    level = np.broadcast_to(levels_of(cn0_dbhz), (count, m))
    ranges, rates = truth.ranges + clock.bias_m[:, None], truth.rates + clock.drift_mps[:, None]
    room = channel_room(receiver, ranges[0], rates[0], setting.start, rng, truth, ins)
    found = new_found(receiver, count, m)
    for first in range(0, count, _BLOCK):
        part = slice(first, min(first + _BLOCK, count))
        here = np.ascontiguousarray(level[part])
        arriving = Arriving(ranges[part], rates[part], here)
        told = Told(truth.satellites[part], motion.rate_b[part], motion.force_b[part], motion.ahead_b[part], here)
        noise = rng.standard_normal((len(here), m, noise_count(channels)))
        run_receiver(receiver, channels, arriving, told, f, room, noise, found)
    return outcome(setting, found, clock.bias_m, clock.drift_mps, ins)


def channel_room(
    receiver: Receiver,
    ranges: Float64,
    rates: Float64,
    start: Start,
    rng: np.random.Generator,
    truth: ClosedLoopTruth,
    ins: bool,
) -> ChannelRoom:
    """Return channels that begin with errors of the start's sigmas."""
    m, p = len(ranges), len(receiver.F)
    sigma = np.array([start.position_m, start.velocity_mps, start.acceleration_mps2])[:p]
    x = np.column_stack([ranges, rates, np.diff(truth.rates[:2], axis=0)[0] / truth.step_s])[:, :p]
    x = np.ascontiguousarray(x + sigma * rng.standard_normal((m, p)))
    return ChannelRoom(
        x,
        np.tile(np.diag(sigma**2), (m, 1, 1)),
        np.zeros((m, 2)),
        np.zeros((m, 5)),
        np.zeros((m, 3)),
        np.zeros((m, 3)),
        np.zeros((m, 2)),
        np.zeros((3, p)),
        np.zeros((p, p)),
        np.zeros(p),
        np.arange(p),
        np.zeros(2),
        np.zeros(3),
        np.zeros(1, np.int64),
    )


def new_found(receiver: Receiver, count: int, m: int) -> Found:
    """Return room for what is kept of a run of ``count`` integrations."""
    records = (count - 1) // receiver.record_every + 1
    return Found(
        np.zeros((records, 12)),
        np.zeros((records, 17, 17)),
        np.zeros((records, m, 2)),
        np.zeros((m, 2)),
        np.zeros(m, np.int64),
        np.full(m, HELD, np.int64),
        np.zeros(m, np.int64),
        np.zeros((_BLOCK, m)),
    )


def outcome(setting: Setting, found: Found, bias_m: Float64, drift_mps: Float64, ins: bool) -> ReceiverRun:
    """Return the errors of a run."""
    truth, every = setting.truth, setting.record_every
    state = found.state
    pick = slice(None, None, every)
    q = state[:, 6:10]
    attitude = np.full((len(state), 3), np.nan)
    if ins:
        from insgnss.geodesy.rotations import to_scipy_quaternion
        from scipy.spatial.transform import Rotation

        estimated = Rotation.from_quat(to_scipy_quaternion(q))
        true = Rotation.from_matrix(truth.C_eb[pick])
        attitude = (estimated * true.inv()).as_rotvec()
    with np.errstate(invalid="ignore", divide="ignore"):
        rms = np.sqrt(found.squares / found.counted[:, None])
    lost = np.where(found.lost_at == HELD, np.inf, found.lost_at * truth.step_s)
    return ReceiverRun(
        truth.t_s[pick] - truth.t_s[0],
        lost,
        rms[:, 0],
        rms[:, 1],
        state[:, 0:3] - truth.r_e[pick],
        state[:, 3:6] - truth.v_e[pick],
        attitude,
        np.column_stack([state[:, 10] - bias_m[pick], state[:, 11] - drift_mps[pick]]),
        found.covariance,
        found.offsets,
    )
