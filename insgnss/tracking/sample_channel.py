"""Tracking channels on samples: integrate and dump from code border to code border, loops, and latched observables.

Time is counted in samples of the recording, from its first one. The delay of a channel is the whole pseudorange in
chips: the code phase that arrives at sample n is ``R n / fs - delay``, counted from the beginning of a data bit at the
recording's first sample. So an integration that begins at a multiple of its own length in chips never crosses a data
bit, and a reading of the replica at any sample is a pseudorange without ambiguity. Which period of the code the first
one was must be known when a channel is opened (``open_channel``): a receiver's time good to half a millisecond is
enough.

The carrier phase is that of the baseband signal, without the intermediate frequency. Both loops are those of
``channel_kernel``: the same discriminators, gains and prediction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from insgnss.errors import ConfigError
from insgnss.kernels.jit import kernel
from insgnss.tables import Complex, Float64, Int8, Int64
from insgnss.tracking.channel_kernel import (
    ACCELERATION,
    DELAY,
    DELAY_RATE,
    N_STATE,
    PHASE,
    RATE,
    ChannelGains,
    correct_and_lead,
)
from insgnss.tracking.channels import ChannelDesign
from insgnss.tracking.codes import RangingCode
from insgnss.tracking.sample_kernels import Steps, correlate_samples
from insgnss.tracking.signal import Sampling

# State of a channel beyond that of its loops: for which sample they hold, and where the next integration begins
AT: Final = N_STATE
BORDER: Final = N_STATE + 1  # code phase there, a multiple of the integration's length [chips]
START: Final = N_STATE + 2  # sample
PULLED_IN: Final = N_STATE + 3  # sample up to which the gains of the pull-in are used
N_SAMPLE_STATE: Final = N_STATE + 4
# What is written of each integration; values hold at its middle, before it corrects the loops
MIDDLE, COUNT, PROMPT_I, PROMPT_Q, PHASE_RAD, RATE_RADPS, TURN_RADPS2, DELAY_CHIPS, DELAY_RATE_CHIPS = range(
    9
)
N_RECORD: Final = 9


class LoopAiding(NamedTuple):
    """The channels' aiding, (m,); zeros without aiding."""

    rate_radps: Float64  # of the carrier phase
    acceleration_radps2: Float64  # by which the rate is led on
    at_sample: Float64  # for which sample the rate holds


class SampleScale(NamedTuple):
    """Scale factors from samples to the units of the loops."""

    rate_hz: float  # of the samples
    intermediate_hz: float
    chip_hz: float
    border_chips: float  # length of an integration


class SignalBuffer(NamedTuple):
    """Samples of a recording."""

    in_phase: Float64  # (n,)
    quadrature: Float64  # (n,), (0,) for real samples
    first: int  # number of the first one


class SampleLoops(NamedTuple):
    """The design of the channels."""

    chips: Int8  # (m, length) one period of each channel's code
    scale: SampleScale
    gains: ChannelGains
    pull_in: ChannelGains  # of a channel that was opened lately
    amplitude: Float64  # (m,) factor of the sums: A / sigma_n^2 for the C/N0 that the slopes are for
    slopes: Float64  # (m, 3) of the discriminators


@kernel
def track_samples(
    buffer: SignalBuffer,
    until: int,
    loops: SampleLoops,
    aiding: LoopAiding,
    state: Float64,
    out: Float64,
    written: Int64,
) -> None:
    """Run channels over all integrations that begin before a sample and whose samples are all there.

    Equation: code phase R n / fs - delay, carrier w_if n / fs + phase; Z = A / sigma_n^2 sum y h(t - tau~ - d)
              exp(-j theta~)                                                                              [(1.10)]
    Neglects: the curvature of phase and delay within an integration: 1e-4 rad for 5 g and 5 ms, 1e-3 rad for 20 ms.

    Parameters
    ----------
    until : number of a sample
    state : (m, 11) of the channels, led on; a channel whose START is negative is closed
    out : (rows, m, 9) records; a channel stops where they are full
    written : (m,) number of rows, led on
    """
    in_phase, quadrature, first = buffer
    scale, gains = loops.scale, loops.gains
    sums, Z = np.empty((3, 2)), np.empty(3, np.complex128)
    per_sample = scale.chip_hz / scale.rate_hz
    for c in range(state.shape[0]):
        x = state[c]
        while 0.0 <= x[START] < until and written[c] < out.shape[0]:
            start = int(x[START])
            if start < first:
                x[START] = -1.0
                break
            # the rate at this integration, and the delay's
            rate = x[RATE] + aiding.rate_radps[c]
            rate += aiding.acceleration_radps2[c] * (x[AT] - aiding.at_sample[c]) / scale.rate_hz
            slip = (x[DELAY_RATE] + gains.chips_per_radian * rate) / scale.rate_hz
            delay = x[DELAY] + slip * (start - x[AT])
            step = per_sample - slip
            next_border = x[BORDER] + scale.border_chips
            count = math.ceil((next_border - (per_sample * start - delay)) / step)
            if start + count - first > in_phase.size:
                break
            middle = start + 0.5 * (count - 1)
            x[PHASE] += rate * (middle - x[AT]) / scale.rate_hz
            x[DELAY] += slip * (middle - x[AT])
            x[AT] = middle
            cycle_step = (scale.intermediate_hz + rate / (2.0 * math.pi)) / scale.rate_hz
            turned = scale.intermediate_hz / scale.rate_hz * middle % 1.0 + x[PHASE] / (2.0 * math.pi)
            correlate_samples(
                in_phase[start - first : start - first + count],
                quadrature[start - first : start - first + count] if quadrature.size > 0 else quadrature,
                loops.chips[c],
                gains.offsets,
                Steps(
                    per_sample * start - (x[DELAY] + slip * (start - middle)),
                    step,
                    turned + cycle_step * (start - middle),
                    cycle_step,
                ),
                sums,
            )
            for r in range(3):
                Z[r] = loops.amplitude[c] * complex(sums[r, 0], sums[r, 1])
            row = out[written[c], c]
            row[MIDDLE], row[COUNT], row[PROMPT_I], row[PROMPT_Q] = middle, count, Z[1].real, Z[1].imag
            row[PHASE_RAD], row[RATE_RADPS] = x[PHASE], rate
            row[TURN_RADPS2] = x[ACCELERATION] + aiding.acceleration_radps2[c]
            row[DELAY_CHIPS], row[DELAY_RATE_CHIPS] = x[DELAY], slip * scale.rate_hz
            written[c] += 1
            # the aiding at the border to the next integration
            since_s = (start + count - aiding.at_sample[c]) / scale.rate_hz
            aid_rate = aiding.rate_radps[c] + aiding.acceleration_radps2[c] * since_s
            used = loops.pull_in if start < x[PULLED_IN] else gains
            correct_and_lead(x, Z, used, loops.slopes[c], gains.step_s, aid_rate, 0.0)
            x[AT] = middle + gains.step_s * scale.rate_hz
            x[START], x[BORDER] = start + count, next_border


@dataclass(frozen=True)
class ReplicaReading:
    """State of a channel's replica at a sample: measured values of the satellite's signal."""

    pseudorange_s: float
    phase_rad: float
    rate_radps: float


class SampleChannels:
    """The channels of a receiver on samples: one for each code, closed until ``open_channel``.

    Parameters
    ----------
    codes : of the channels, all of one length and rate
    design : of their loops; an integration is a whole number of code periods
    pull_in : of the loops while a channel pulls in, with the same integrations and discriminators; None: as later. A
        frequency discriminator that helps from hertz away would lose lock in noise that the phase loop alone stands:
        at 24 dBHz and 10 ms within a second
    noise_variance : of each component of the samples
    rows : how many integrations are recorded of each channel at most

    Raises
    ------
    ConfigError : an integration that is not a whole number of code periods, or that does not divide a data bit
    """

    def __init__(
        self,
        sampling: Sampling,
        codes: list[RangingCode],
        design: ChannelDesign,
        noise_variance: float,
        rows: int,
        pull_in: ChannelDesign | None = None,
    ) -> None:
        code = codes[0]
        periods = design.step_s / code.period_s
        per_sign = code.sign_s / design.step_s
        if abs(periods - round(periods)) > 1e-6 or periods < 0.5 or abs(per_sign - round(per_sign)) > 1e-6:
            advice = f"take {code.sign_s * 1e3:g} ms over a whole number, and whole code periods"
            message = f"an integration of {design.step_s * 1e3:g} ms does not fit the code and its data"
            raise ConfigError(message, key="integration_s", advice=advice)
        self.sampling, self.design, self._wide = sampling, design, pull_in or design
        m = len(codes)
        self._scale = SampleScale(
            sampling.rate_hz, sampling.intermediate_hz, code.rate_hz, round(periods) * float(code.length)
        )
        self._loops = SampleLoops(
            chips=np.stack([each.chips for each in codes]),
            scale=self._scale,
            gains=design.gains(),
            pull_in=self._wide.gains(),
            amplitude=np.zeros(m),
            slopes=np.zeros((m, 3)),
        )
        self._variance = noise_variance
        self.state = np.zeros((m, N_SAMPLE_STATE))
        self.state[:, START] = -1.0
        self.records = np.full((rows, m, N_RECORD), np.nan)
        self.written = np.zeros(m, np.int64)
        for c in range(m):
            self.set_cn0(c, design.cn0_dbhz)

    @property
    def is_open(self) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """Return which channels track, (m,)."""
        return np.asarray(self.state[:, START] >= 0.0)

    def set_cn0(self, channel: int, cn0_dbhz: float) -> None:
        """Let a channel's discriminators be scaled for a C/N0, as the receiver has estimated it."""
        self._loops.slopes[channel] = replace(self._wide, cn0_dbhz=cn0_dbhz).gains().slopes
        self._loops.amplitude[channel] = self.sampling.amplitude(cn0_dbhz) / math.sqrt(self._variance)

    def open_channel(
        self,
        channel: int,
        sample: int,
        pseudorange_s: float,
        own_rate_radps: float,
        pull_in_s: float = 0.0,
    ) -> None:
        """Open a channel at the first border of its integrations at or after a sample.

        Parameters
        ----------
        sample : from which on its samples are there
        pseudorange_s : at that sample, the whole number of code periods known
        own_rate_radps : of the carrier phase, less the aiding
        pull_in_s : for how long the gains of the pull-in are used
        """
        s, x = self._scale, self.state[channel]
        delay = pseudorange_s * s.chip_hz
        phase = s.chip_hz / s.rate_hz * sample - delay
        border = math.ceil(phase / s.border_chips) * s.border_chips
        start = sample + math.ceil((border - phase) * s.rate_hz / s.chip_hz)
        x[:] = 0.0
        x[RATE], x[DELAY], x[BORDER], x[START] = own_rate_radps, delay, border, start
        x[AT], x[PULLED_IN] = sample, sample + pull_in_s * s.rate_hz

    def close_channel(self, channel: int) -> None:
        """Stop a channel."""
        self.state[channel, START] = -1.0

    def run(self, in_phase: Float64, quadrature: Float64, first: int, until: int, aiding: LoopAiding) -> None:
        """Run the open channels over the integrations that begin before sample ``until``; see ``track_samples``."""
        buffer = SignalBuffer(in_phase, quadrature, first)
        track_samples(buffer, until, self._loops, aiding, self.state, self.records, self.written)

    def reading(self, channel: int, sample: float) -> ReplicaReading | None:
        """Return the replica's state at a sample of its last integration, before that corrects the loops.

        The rate is led from the integration's middle by the derivative that the loop and its aiding have: at 4 g and
        5 ms it would be 0.2 m/s late. None where the channel is closed, or has no integration there.
        """
        if self.state[channel, START] < 0.0 or self.written[channel] == 0:
            return None
        row = self.records[self.written[channel] - 1, channel]
        if abs(sample - row[MIDDLE]) > 1.5 * row[COUNT]:
            return None
        since_s = (sample - row[MIDDLE]) / self._scale.rate_hz
        delay = row[DELAY_CHIPS] + row[DELAY_RATE_CHIPS] * since_s
        phase = row[PHASE_RAD] + row[RATE_RADPS] * since_s
        rate = row[RATE_RADPS] + row[TURN_RADPS2] * since_s
        return ReplicaReading(delay / self._scale.chip_hz, phase, rate)

    def prompts(self, channel: int, count: int, per_bit: int = 1) -> Complex:
        """Return the newest prompt correlators of a channel, at most so many, the oldest one first.

        ``per_bit`` of them make a data bit: the first one returned begins a bit, and whole bits are returned.
        """
        last = int(self.written[channel])
        if last == 0:
            return np.zeros(0, np.complex128)
        row = self.records[last - 1, channel]
        code = self._scale.chip_hz / self._scale.rate_hz * row[MIDDLE] - row[DELAY_CHIPS]
        last -= (int(code // self._scale.border_chips) + 1) % per_bit
        first = max(last - count, last - last // per_bit * per_bit, 0)
        rows = self.records[first:last, channel]
        return np.asarray(rows[:, PROMPT_I] + 1j * rows[:, PROMPT_Q])
