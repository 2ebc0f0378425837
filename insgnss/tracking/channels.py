"""Channels of a receiver on correlators: their design, the scene they see, and their simulation.

Every channel (or trial) draws its noise from a generator of its own, seeded by the seed and the channel's number: the
result depends neither on how many run together, nor on blocks, nor on threads.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.errors import ConfigError
from insgnss.tables import Complex, Float64, Int8, Int64
from insgnss.tracking.admissible import CN0_SPAN_DBHZ, require_known, require_positive, seeded, signal_ratio
from insgnss.tracking.channel_kernel import (
    DELAY_ERROR,
    N_NOISE,
    N_OUT,
    N_STATE,
    PHASE_ERROR,
    PROMPT_I,
    PROMPT_Q,
    RATE_ERROR,
    Aid,
    ChannelGains,
    Truth,
    run_channels,
)
from insgnss.tracking.codes import RangingCode
from insgnss.tracking.correlators import Correlators
from insgnss.tracking.delay_discriminators import DelayDiscriminator
from insgnss.tracking.discriminator_outputs import DELAY_KINDS, FREQUENCY_KINDS, PHASE_KINDS
from insgnss.tracking.frequency_discriminators import FrequencyDiscriminator
from insgnss.tracking.frequency_loop import FrequencyLoop
from insgnss.tracking.loop_filters import LoopFilter
from insgnss.tracking.phase_discriminators import PhaseDiscriminator

# integrations whose noise is drawn at once: 200 kB for a channel, few enough for the cache
_BLOCK: Final = 4096
_NO_ASSISTANCE: Final = "none"
Progress = Callable[[int], None]  # is called with the number of integrations done of a channel


@dataclass(frozen=True)
class ChannelDesign:
    """The loops of a channel.

    Outputs of the discriminators are divided by their slopes at ``cn0_dbhz``, as a receiver does that knows what it was
    designed for; where the true C/N0 differs, IQ and the products change the loops' gains with its square.
    """

    carrier: LoopFilter | FrequencyLoop  # [rad]; a frequency loop uses no phase discriminator
    code: LoopFilter  # [chips], order 1 or 2
    cn0_dbhz: float
    phase_kind: str = "atan"
    frequency_kind: str = _NO_ASSISTANCE
    delay_kind: str = "dot"
    spacing_chips: float = 1.0
    chips_per_radian: float = 0.0  # of carrier aiding; ``chips_per_radian(code, carrier)`` gives it

    def __post_init__(self) -> None:
        if self.code.order > 2 or self.code.step_s != self.carrier.step_s:
            advice = "give both loops one interval, and the code loop order 1 or 2"
            raise ConfigError("code and carrier loop do not match", key="code", advice=advice)
        require_known(self.frequency_kind, FREQUENCY_KINDS, "frequency_kind", "frequency discriminator")
        assisted = bool(np.any(self.carrier.rate_gains))
        if assisted != (self.frequency_kind != _NO_ASSISTANCE):
            advice = (
                "take a loop of assisted_filter or frequency_filter and a frequency discriminator, or neither"
            )
            raise ConfigError(
                "frequency assistance is incomplete: gains and discriminator do not match",
                key="frequency_kind",
                advice=advice,
            )
        self.gains()

    @property
    def step_s(self) -> float:
        """Return the integration time [s]."""
        return self.carrier.step_s

    def gains(self) -> ChannelGains:
        """Return the kernel's inputs."""
        a = signal_ratio(self.cn0_dbhz, self.step_s)
        correlators = Correlators(self.spacing_chips)
        slopes = [PhaseDiscriminator(self.phase_kind).slope(a), 1.0]
        slopes.append(DelayDiscriminator(self.delay_kind, correlators).slope(a))
        if self.frequency_kind != _NO_ASSISTANCE:
            # the kernel's angles are not yet divided by the integration time
            scale = 1.0 if self.frequency_kind == "cross" else self.step_s
            slopes[1] = scale * FrequencyDiscriminator(self.frequency_kind, self.step_s).slope(a)
        kinds = (
            PHASE_KINDS.index(self.phase_kind),
            FREQUENCY_KINDS.index(self.frequency_kind),
            DELAY_KINDS.index(self.delay_kind),
        )
        return ChannelGains(
            self.step_s,
            _padded(self.carrier.gains, 3),
            _padded(self.carrier.rate_gains, 3),
            _padded(self.code.gains, 2),
            np.array(kinds, np.int64),
            np.array(slopes),
            correlators.offsets,
            correlators.noise_factor(),
            self.chips_per_radian,
            a,
        )


def chips_per_radian(code: RangingCode, carrier_hz: float) -> float:
    """Return the change of the delay in chips per radian of carrier phase.

    Equation: - R_chip / (2 pi f0)
    """
    require_positive(carrier_hz=carrier_hz)
    return -code.rate_hz / (2.0 * math.pi * carrier_hz)


@dataclass(frozen=True)
class ChannelSignals:
    """The signals that arrive at m channels over n integrations."""

    phase_rad: Float64  # (n + 1, m) at the borders of the integrations
    delay_chips: Float64  # (n + 1, m)
    cn0_dbhz: Float64  # (n, m)
    sign: Int8  # (n, m) of the data

    @property
    def shape(self) -> tuple[int, int]:
        """Return the numbers of integrations and channels."""
        return self.sign.shape[0], self.sign.shape[1]


def scene(
    phase_rad: npt.ArrayLike, cn0_dbhz: npt.ArrayLike, chips_per_radian: float = 0.0, sign: Int8 | None = None
) -> ChannelSignals:
    """Return a scene of phases (n + 1, m) and a C/N0 that broadcasts to (n, m).

    The delay follows the carrier and begins at zero; signs are all plus unless given.

    Raises
    ------
    ConfigError : shapes that do not fit, or numbers that are none
    """
    phase = np.asarray(phase_rad, float)
    if phase.ndim != 2 or phase.shape[0] < 2 or not np.all(np.isfinite(phase)):
        advice = "give finite phases (n + 1, m): borders of the integrations by channels"
        raise ConfigError(f"invalid phases of shape {phase.shape}", key="phase_rad", advice=advice)
    n, m = phase.shape[0] - 1, phase.shape[1]
    cn0 = np.array(np.broadcast_to(np.asarray(cn0_dbhz, float), (n, m)))
    if not np.all((cn0 >= CN0_SPAN_DBHZ[0]) & (cn0 <= CN0_SPAN_DBHZ[1])):
        advice = "give C/N0 in dBHz, between {:g} and {:g}, for every integration".format(*CN0_SPAN_DBHZ)
        raise ConfigError("C/N0 is out of range", key="cn0_dbhz", advice=advice)
    signs = np.ones((n, m), np.int8) if sign is None else np.asarray(sign, np.int8)
    if signs.shape != (n, m) or not np.all(np.abs(signs) == 1):
        raise ConfigError("invalid signs", key="sign", advice=f"give +1 or -1, shaped {(n, m)}")
    return ChannelSignals(phase, (phase - phase[0]) * chips_per_radian, cn0, signs)


def data_signs(count: int, channels: int, step_s: float, sign_s: float, rng: np.random.Generator) -> Int8:
    """Return random signs of the data, (count, channels), which change between integrations only.

    Raises
    ------
    ConfigError : the integration is longer than a symbol, or no whole number of integrations fills one
    """
    require_positive(step_s=step_s, sign_s=sign_s)
    per_symbol = round(sign_s / step_s)
    if per_symbol < 1 or abs(per_symbol * step_s / sign_s - 1.0) > 1e-6:
        raise ConfigError(
            f"integrations of {step_s:g} s do not fill symbols of {sign_s:g} s",
            key="step_s",
            advice=f"take {sign_s:g} s over a whole number, or a signal without data",
        )
    symbols = rng.integers(0, 2, (-(-count // per_symbol), channels), np.int8)
    return np.asarray(1 - 2 * np.repeat(symbols, per_symbol, axis=0)[:count], np.int8)


@dataclass(frozen=True)
class ChannelHistory:
    """History of the loops, (n, m): errors are replica minus truth in the middle of each integration."""

    step_s: float
    phase_error_rad: Float64
    rate_error_radps: Float64
    delay_error_chips: Float64
    prompt: Complex

    @property
    def time_s(self) -> Float64:
        """Return the middle of each integration, (n,)."""
        return np.asarray((np.arange(len(self.prompt)) + 0.5) * self.step_s)


@dataclass(frozen=True)
class InitialLoopErrors:
    """Errors of the loops at the start, replica minus truth.

    A rate of None leaves it to the aiding: the loop's own rate begins at zero where the aiding gives one, and
    without error where it does not.
    """

    phase_rad: npt.ArrayLike = 0.0  # (m,) or one for all; also the two others
    rate_radps: npt.ArrayLike | None = None
    delay_chips: npt.ArrayLike = 0.0


def no_aid(count: int, channels: int) -> Aid:
    """Return zero aiding for a number of integrations and channels."""
    return Aid(np.zeros((count + 1, channels)), np.zeros((count + 1, channels)))


@dataclass(frozen=True)
class ChannelSimulation:
    """A run of channels on correlators: reproducible by its seed."""

    design: ChannelDesign
    scene: ChannelSignals
    aid: Aid | None = None
    start: InitialLoopErrors = field(default_factory=InitialLoopErrors)

    def run(self, seed: int, threads: int = 1, progress: Progress | None = None) -> ChannelHistory:
        """Run the loops; return their history.

        Parameters
        ----------
        seed : of all noise; the result depends on nothing else
        threads : over which the channels are spread
        progress : is called with the number of integrations that were done in a channel

        Raises
        ------
        ConfigError : aiding of another shape, or no threads
        """
        n, m = self.scene.shape
        aid = self.aid or no_aid(n, m)
        if aid.rate_radps.shape != (n + 1, m) or aid.acceleration_radps2.shape != (n + 1, m):
            advice = f"give rates and accelerations at the borders of the integrations, {(n + 1, m)}"
            raise ConfigError("the aiding does not fit the scene", key="aid", advice=advice)
        if threads < 1:
            raise ConfigError(f"{threads} threads", key="threads", advice="take at least one")
        out = np.empty((n, m, N_OUT))
        if threads == 1:
            self._run_group(np.arange(m), aid, seed, out, progress)
        else:
            groups = np.array_split(np.arange(m), min(threads, m))
            with ThreadPoolExecutor(threads) as pool:
                list(pool.map(lambda group: self._run_group(group, aid, seed, out, progress), groups))
        prompt = out[:, :, PROMPT_I] + 1j * out[:, :, PROMPT_Q]
        errors = (out[:, :, PHASE_ERROR], out[:, :, RATE_ERROR], out[:, :, DELAY_ERROR])
        return ChannelHistory(self.design.step_s, *errors, prompt)

    def _run_group(
        self, channels: Int64, aid: Aid, seed: int, out: Float64, progress: Progress | None
    ) -> None:
        """Run some of the channels, block by block, each with its own noise."""
        n, gains = len(out), self.design.gains()
        noise = [seeded(seed, int(c)) for c in channels]
        state, Z = self._first_state(channels, aid), np.zeros(3, np.complex128)
        for first in range(0, n, _BLOCK):
            last = min(first + _BLOCK, n)
            borders, inside = np.s_[first : last + 1, channels], np.s_[first:last, channels]
            a = 2.0 * self.design.step_s * 10.0 ** (self.scene.cn0_dbhz[inside] / 10.0)
            truth = Truth(
                self.scene.phase_rad[borders], self.scene.delay_chips[borders], a, self.scene.sign[inside]
            )
            part = Aid(aid.rate_radps[borders], aid.acceleration_radps2[borders])
            drawn = np.stack([rng.standard_normal((last - first, N_NOISE)) for rng in noise], axis=1)
            written = np.empty((last - first, len(channels), N_OUT))
            run_channels(truth, part, gains, drawn, state, Z, written)
            out[first:last, channels] = written
            if progress is not None:
                progress((last - first) * len(channels))

    def _first_state(self, channels: Int64, aid: Aid) -> Float64:
        """Return the state that has the wanted errors in the middle of the first integration."""
        m, T = self.scene.shape[1], self.design.step_s
        phase, delay = self.scene.phase_rad[:2], self.scene.delay_chips[:2]
        state = np.zeros((m, N_STATE))
        mean_rate = 0.5 * (aid.rate_radps[0] + aid.rate_radps[1])
        state[:, 0] = phase.mean(axis=0) + np.asarray(self.start.phase_rad, float)
        left = (phase[1] - phase[0]) / T - mean_rate
        if self.start.rate_radps is not None:
            state[:, 1] = left + np.asarray(self.start.rate_radps, float)
        else:
            state[:, 1] = np.where(np.any(aid.rate_radps != 0.0, axis=0), 0.0, left)
        state[:, 3] = delay.mean(axis=0) + np.asarray(self.start.delay_chips, float)
        if self.design.chips_per_radian == 0.0:
            state[:, 4] = (delay[1] - delay[0]) / T
        return np.ascontiguousarray(state[channels])


def _padded(gains: Float64, size: int) -> Float64:
    return np.pad(gains, (0, size - len(gains)))
