"""Runs of a receiver along one truth: errors drawn, blocks of integrations run, their statistics."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from insgnss.config.flight import ImuGrade
from insgnss.geodesy.rotations import to_scipy_quaternion
from insgnss.simulation.closed_loop_sky import ClosedLoopTruth, InertialTruth, told_motion
from insgnss.simulation.oscillator import clock_densities, simulate_clock
from insgnss.studies.receiver.antennas import ReceiverMasking
from insgnss.studies.receiver.estimated_cn0 import ESTIMATE_S, EstimatedCn0
from insgnss.studies.receiver.imu import UnknownMotion, with_gaps
from insgnss.studies.receiver.interval_noise import disturbed_states
from insgnss.studies.receiver.loop import run_receiver
from insgnss.studies.receiver.options import ReceiverOptions
from insgnss.studies.receiver.search import Searches, SearchRow
from insgnss.studies.receiver.variants import (
    InitialSigmas,
    TrueStart,
    Variant,
    feeling_nothing,
    filter_room,
    oscillator_of,
    receiver_of,
    without_ins,
)
from insgnss.studies.receiver.workspace import (
    HELD,
    INTERVAL_MESSAGE,
    NO_SIGNAL,
    RECORDED,
    SCALAR,
    AidingInputs,
    ChannelRoom,
    FilterRoom,
    ReceiverDesign,
    ReceiverHistory,
    SignalArrivals,
)
from insgnss.tables import Float64
from insgnss.tracking.admissible import seeded
from insgnss.tracking.discriminator_outputs import PHASE_KINDS
from insgnss.tracking.lock_and_cn0 import SLIP_SHARE
from insgnss.tracking.phase_discriminators import PhaseDiscriminator
from insgnss.tracking.vector_loop import N_SEEN, ChannelConstants, levels_of, noise_count

_BLOCK_S: Final = 0.5  # of integrations run at once, unless C/N0 is estimated between them
_LOST_HZ: Final = 100.0  # a frequency offset beyond it is lost, where the phase is not tracked ...
# singular value of the directions and the clock's column: below it errors of ranges count a hundredfold
_LEAST_GEOMETRY: Final = 0.01
_LOST_S: Final = 1.0  # ... if it lasts so long; the same of a delay of one chip


@dataclass(frozen=True)
class Setting:
    """Settings common to all runs of a study."""

    truth: ClosedLoopTruth
    inertial: InertialTruth | None  # None: no INS
    grade: ImuGrade | None
    channels: ChannelConstants
    drift_density: float  # of the oscillator, one-sided [rad^2/s^3]
    interval: int  # integrations between two updates of a second stage
    record_every: int  # integrations
    settle: int  # integrations that do not count
    start: InitialSigmas
    options: ReceiverOptions  # with its duration
    masking: ReceiverMasking | None = None  # by the filter's attitude

    @property
    def unknown(self) -> UnknownMotion:
        """Return the motion of a receiver without INS."""
        return UnknownMotion(self.options.unknown_mps2, self.options.unknown_s)

    @property
    def least_cn0_dbhz(self) -> float:
        """Return the C/N0 below which a channel is not used."""
        least_dbhz = self.options.least_cn0_dbhz
        return -math.inf if least_dbhz is None else least_dbhz

    @property
    def limits(self) -> tuple[float, float, int]:
        """Return when a channel is lost: range [m], rate [m/s], integrations."""
        k = self.channels.radians_per_m
        if self.channels.coherent:
            aperture = PhaseDiscriminator(PHASE_KINDS[self.channels.kinds[0]]).aperture_rad
            return SLIP_SHARE * aperture / k, math.inf, 0
        steps = round(_LOST_S / self.channels.step_s)
        return self.channels.chip_m, 2.0 * math.pi * _LOST_HZ / k, steps

    def may_lose_signals(self, cn0_dbhz: Float64) -> bool:
        """Return whether a channel may be without a signal for a time, and come back."""
        chosen = self.masking is not None or self.options.estimates_cn0
        return chosen or not bool((cn0_dbhz >= max(self.least_cn0_dbhz, -1e9)).all())

    @cached_property
    def solution(self) -> Float64:
        """What turns ranges into position and clock by least squares at the recorded integrations, (k, 4, m).

        NaN where the satellites do not fix all four: less than four of them, or all on one cone.
        """
        u = self.truth.directions(slice(None, None, self.record_every))
        H = np.concatenate([-u, np.ones((*u.shape[:2], 1))], axis=2)
        values = np.linalg.svd(H, compute_uv=False)
        fixed = (values.shape[1] == 4) & (values[:, -1] > _LEAST_GEOMETRY)
        return np.where(fixed[:, None, None], np.linalg.pinv(H), np.nan)


@dataclass(frozen=True)
class ReceiverRun:
    """Record of one run at k integrations; errors are estimate minus truth, ECEF."""

    lost_s: Float64  # (m,) when each channel was lost, from the beginning; inf: held
    rms: Float64  # (m, 2) of the replicas' offsets, range [m] and rate [m/s]
    # (m, 2) the same by the covariance of the channel, or of one stage's filter, and by what is known of each replica
    # later: the error of holding the newest inertial sample over half an integration, and of setting it in steps
    predicted: Float64
    error: Float64  # (k, 11) position, velocity, attitude [rad], clock, drift; NaN of what a receiver does not estimate
    sd: Float64  # (k, 11) sigmas of the filter
    nees: Float64  # (k,) of these errors, by the number of those that have a sigma
    cn0_dbhz: Float64  # (blocks, m) as estimated; NaN where it was given
    searches: tuple[SearchRow, ...]  # of channels whose signal was gone
    least_squares: Float64  # (k, 11) errors of all channels' ranges and rates alone
    offset: Float64  # (k, 2) truth minus the replica of the channel that was lost first, or of the first one
    apart: Float64  # (k, m, 2) of ranges by phase less those by code: error and sigma [m]; zeros without such states
    innovation: (
        Float64  # (k, m) of the filter's newest update by each channel's range [m]; NaN where it took none
    )

    @property
    def lost(self) -> bool:
        """Return whether any channel was lost."""
        return bool(np.isfinite(self.lost_s).any())


def run_many(
    setting: Setting, variant: Variant, cn0_dbhz: Float64, runs: int, seed: int, threads: int
) -> list[ReceiverRun]:
    """Return runs of one receiver, each with a seed of its own; they do not depend on the number of threads."""
    with ThreadPoolExecutor(threads) as pool:
        return list(
            pool.map(lambda run: run_once(setting, variant, cn0_dbhz, seeded(seed, run)), range(runs))
        )


def run_once(setting: Setting, variant: Variant, cn0_dbhz: Float64, rng: np.random.Generator) -> ReceiverRun:
    """Return one run of a receiver.

    Parameters
    ----------
    cn0_dbhz : broadcasts to (n, m); NaN: no signal
    """
    truth, options, ins = setting.truth, setting.options, setting.inertial is not None
    channels = setting.channels._replace(with_code=variant.with_code)
    count, m = truth.ranges.shape
    oscillator = oscillator_of(setting.drift_density, options.carrier_hz)
    clock = simulate_clock(oscillator, truth.t_s - truth.t_s[0], rng)
    ranges, rates = truth.ranges + clock.bias_m[:, None], truth.rates + clock.drift_mps[:, None]
    if setting.inertial is not None and setting.grade is not None:
        grade = setting.grade
        aiding = told_motion(setting.inertial, truth, grade, rng, options.latency_s)
        since_s = truth.t_s - truth.t_s[0]
        motion, unknown = with_gaps(aiding, since_s, grade, options.imu_gaps_s, setting.unknown)
    else:
        grade = without_ins(setting.unknown)
        motion, unknown = feeling_nothing(truth.r_e[0], count), np.zeros((count, 2))
    directions = truth.directions(slice(0, 1))[0] if variant.with_code else None
    begin, density = TrueStart.of(truth, clock), options.divergence_density
    cn0 = np.broadcast_to(cn0_dbhz, (count, m))
    phases = m if variant.has_filter and channels.coherent and setting.may_lose_signals(cn0) else 0
    disturbed = disturbed_states(ins) if variant.kind == INTERVAL_MESSAGE else ()
    f = filter_room(grade, oscillator, setting.start, begin, rng, ins, directions, density, phases, disturbed)
    receiver = receiver_of(
        variant,
        truth.step_s,
        setting.interval,
        clock_densities(oscillator)[1],
        None if ins and variant.has_filter else setting.unknown,
        setting.limits,
        setting.record_every,
        setting.settle,
        (options.replica_step_m, options.replica_step_mps),
    )
    room = channel_room(receiver, ranges[0], rates[:2], setting.start, rng, truth.step_s)
    history = new_found(receiver, count, m, _block(setting))
    level = np.where(np.isnan(cn0), NO_SIGNAL, levels_of(cn0))
    arriving = SignalArrivals(ranges, rates, level, _apart(variant, density, truth, rng))
    searches = Searches(channels, options.carrier_hz, m, setting.masking) if variant.has_filter else None
    rooms = _ReceiverWorkspace(receiver, channels, f, room, history)
    whole = AidingInputs(truth.satellites, motion.rate_b, motion.force_b, motion.ahead_b, level, unknown)
    estimates = _run_blocks(setting, rooms, arriving, whole, cn0, searches, rng)
    history.apart[:, :, 0] -= arriving.apart[:: setting.record_every]
    state_errors = _errors(setting, history, np.column_stack([clock.bias_m, clock.drift_mps]), ins)
    rows = () if searches is None else searches.all_rows()
    return _run_of(setting, variant, history, state_errors, estimates, rows)


class _ReceiverWorkspace(NamedTuple):
    """A receiver and everything that it works on."""

    receiver: ReceiverDesign
    channels: ChannelConstants
    f: FilterRoom
    room: ChannelRoom
    found: ReceiverHistory


def _block(setting: Setting) -> int:
    """Return how many integrations are run at once."""
    block_s = ESTIMATE_S if setting.options.estimates_cn0 else _BLOCK_S
    return max(round(block_s / setting.truth.step_s), 1)


def _apart(variant: Variant, density: float, truth: ClosedLoopTruth, rng: np.random.Generator) -> Float64:
    """Return the ranges by phase less those by code (n, m): a walk from zero; none where no code is tracked."""
    apart = np.zeros(truth.ranges.shape)
    if variant.with_code:
        walk = math.sqrt(density * truth.step_s) * rng.standard_normal(apart[1:].shape)
        apart[1:] = np.cumsum(walk, axis=0)
    return apart


def _run_blocks(
    setting: Setting,
    rooms: _ReceiverWorkspace,
    arriving: SignalArrivals,
    whole: AidingInputs,
    cn0: Float64,
    searches: Searches | None,
    rng: np.random.Generator,
) -> Float64:
    """Run all blocks of integrations; return the C/N0 that was estimated in each (blocks, m).

    ``whole`` is the aiding in all of them, except for the levels of the channels.
    """
    (count, m), truth, options = cn0.shape, setting.truth, setting.options
    receiver, channels, f, room, history = rooms
    # the C/N0 that the receiver takes for true
    block, estimates, believed = _block(setting), [], cn0[0]
    own = EstimatedCn0(channels, cn0[0], setting.least_cn0_dbhz, options.cn0_estimator)
    for first in range(0, count, block):
        part = slice(first, min(first + block, count))
        here = SignalArrivals._make(values[part] for values in arriving)
        told_level = np.where(cn0[part] >= setting.least_cn0_dbhz, here.level, NO_SIGNAL)
        if options.told_cn0_dbhz is not None:
            told_level = np.full_like(told_level, levels_of(options.told_cn0_dbhz))
            believed = np.full(m, options.told_cn0_dbhz)
        elif options.estimates_cn0:
            told_level, believed = np.tile(own.level, (len(here.level), 1)), own.believed
        else:
            believed = cn0[first]
        if searches is not None:
            before = max(first - 1, 0)
            off = np.column_stack([arriving.ranges[before], arriving.rates[before]]) - room.predicted
            told_level = searches.told(told_level, believed, truth.step_s * first, f, room, off)
        inputs = AidingInputs._make(values[part] for values in whole)._replace(level=told_level)
        noise = rng.standard_normal((len(here.level), m, noise_count(channels)))
        run_receiver(receiver, channels, here, inputs, f, room, noise, history)
        if options.estimates_cn0 and len(here.level) == block:
            estimates.append(own.take(history.power, told_level))
    return np.array(estimates).reshape(-1, m)


def channel_room(
    receiver: ReceiverDesign,
    ranges: Float64,
    rates: Float64,
    start: InitialSigmas,
    rng: np.random.Generator,
    step_s: float,
) -> ChannelRoom:
    """Return channels that begin with errors of the start's sigmas.

    Parameters
    ----------
    ranges : (m,) at the first middle
    rates : (2, m) at the first two
    """
    m, p = len(ranges), len(receiver.F)
    # behind a filter the acceleration is that of the channel less the filter's
    acceleration = (rates[1] - rates[0]) / step_s if receiver.kind == SCALAR else np.zeros(m)
    sigma = np.array([start.position_m, start.velocity_mps, start.acceleration_mps2])[:p]
    x = np.column_stack([ranges, rates[0], acceleration])[:, :p]
    return ChannelRoom(
        x=np.ascontiguousarray(x + sigma * rng.standard_normal((m, p))),
        P=np.tile(np.diag(sigma**2), (m, 1, 1)),
        base=np.zeros((m, 2)),
        message=np.zeros((m, p, p + 1)),
        all_messages=np.zeros((p, p + 1)),
        noise_sums=np.zeros((len(receiver.noise), 2, p, p + 1)),
        z=np.zeros(p),
        C=np.zeros((p, p)),
        u=np.zeros((m, 3)),
        g=np.zeros((m, 3)),
        predicted=np.zeros((m, 2)),
        v=np.zeros((3, p)),
        F_P=np.zeros((p, p)),
        h=np.zeros(p),
        columns=np.arange(p),
        offset=np.zeros(3),
        seen=np.zeros(N_SEEN),
        silent=np.zeros(m, np.int64),
        met=np.zeros(m, np.int64),
        pulling=np.zeros(m, np.int64),
        fresh=np.zeros(m, np.int64),
        cycles=np.zeros(m),
        innovation=np.full(m, np.nan),
        done=np.zeros(1, np.int64),
    )


def new_found(receiver: ReceiverDesign, count: int, m: int, block: int) -> ReceiverHistory:
    """Return room for what is kept of a run of ``count`` integrations."""
    records = (count - 1) // receiver.record_every + 1
    return ReceiverHistory(
        state=np.zeros((records, 12)),
        covariance=np.zeros((records, len(RECORDED), len(RECORDED))),
        offsets=np.zeros((records, m, 2)),
        squares=np.zeros((m, 2)),
        led=np.zeros((m, 2)),
        counted=np.zeros(m, np.int64),
        predicted=np.zeros((m, 3)),
        lost_at=np.full(m, HELD, np.int64),
        losing=np.zeros(m, np.int64),
        power=np.zeros((block, m)),
        innovation=np.zeros((records, m)),
        apart=np.zeros((records, m, 2)),
    )


def _errors(setting: Setting, history: ReceiverHistory, clock: Float64, ins: bool) -> Float64:
    """Return the errors (k, 11) of the filter."""
    truth, state = setting.truth, history.state
    pick = slice(None, None, setting.record_every)
    attitude = np.full((len(state), 3), np.nan)
    if ins:
        estimated = Rotation.from_quat(to_scipy_quaternion(state[:, 6:10]))
        attitude = (estimated * Rotation.from_matrix(truth.C_eb[pick]).inv()).as_rotvec()
    motion = state[:, :6] - np.hstack([truth.r_e[pick], truth.v_e[pick]])
    return np.hstack([motion, attitude, state[:, 10:12] - clock[pick]])


def _run_of(
    setting: Setting,
    variant: Variant,
    history: ReceiverHistory,
    error: Float64,
    cn0_dbhz: Float64,
    searches: tuple[SearchRow, ...],
) -> ReceiverRun:
    """Return the statistics of a run; a receiver without a filter has the least squares of its channels."""
    with np.errstate(invalid="ignore", divide="ignore"):
        rms = np.sqrt(history.squares / history.counted[:, None])
        led = history.led / history.counted[:, None]
        predicted = np.sqrt(history.predicted[:, :2] / history.predicted[:, 2:] + led)
    solved = _least_squares(setting, history)
    if variant.has_filter:
        estimated = ~np.isnan(error[0])
        P = history.covariance[:, estimated][:, :, estimated]
        sd = np.where(estimated, np.sqrt(np.einsum("kii->ki", history.covariance)), np.nan)
        nees = normalised(error[:, estimated], P)
    else:
        sd, nees = np.full_like(error, np.nan), np.full(len(error), np.nan)
        error = solved
    lost = np.where(history.lost_at == HELD, np.inf, history.lost_at * setting.truth.step_s)
    apart = np.stack([history.apart[..., 0], np.sqrt(history.apart[..., 1])], axis=-1)
    offset = history.offsets[:, int(np.argmin(lost))].copy()
    return ReceiverRun(
        lost, rms, predicted, error, sd, nees, cn0_dbhz, searches, solved, offset, apart, history.innovation
    )


def normalised(error: Float64, P: Float64) -> Float64:
    """Return e^T P^-1 e over the number of states, (k,); inf where the covariance is none."""
    scale = np.sqrt(np.maximum(np.einsum("kii->ki", P), 1e-300))
    try:
        solved = np.linalg.solve(P / (scale[:, :, None] * scale[:, None, :]), (error / scale)[..., None])
    except np.linalg.LinAlgError:
        return np.full(len(error), np.inf)
    return np.asarray(np.sum(error / scale * solved[..., 0], axis=1) / error.shape[1])


def _least_squares(setting: Setting, history: ReceiverHistory) -> Float64:
    """Return the errors (k, 11) of position, velocity and clock that all channels' ranges and rates give."""
    solved = -np.einsum("kij,kjc->kic", setting.solution, history.offsets)
    nothing = np.full((len(solved), 3), np.nan)
    return np.hstack([solved[:, :3, 0], solved[:, :3, 1], nothing, solved[:, 3]])
