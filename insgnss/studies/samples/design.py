"""The loops of a receiver on samples by its settings, what their readings are worth, and its buffer of samples."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from insgnss.config.sample_receiver import SampledLoops, SampleReceiver
from insgnss.constants import C_MPS
from insgnss.gnss.signals import L1_HZ
from insgnss.tables import Float64
from insgnss.tracking.admissible import signal_ratio
from insgnss.tracking.channels import ChannelDesign, chips_per_radian
from insgnss.tracking.codes import GPS_CA_CHIP_HZ, RangingCode
from insgnss.tracking.correlators import Correlators
from insgnss.tracking.delay_discriminators import DelayDiscriminator
from insgnss.tracking.discriminators import equivalent_variance
from insgnss.tracking.loop_filters import LoopFilter, assisted_filter, digital_filter
from insgnss.tracking.phase_discriminators import PhaseDiscriminator
from insgnss.tracking.signal import Sampling, SignalSamples


def loop_designs(
    settings: SampleReceiver, loops: SampledLoops, code: RangingCode, cn0_dbhz: float
) -> tuple[ChannelDesign, ChannelDesign]:
    """Return the loops of a channel that tracks, and of one that pulls in with the help of the frequency loop.

    Raises
    ------
    ConfigError : bandwidths too large for the integration
    """
    T = settings.integration_s
    tracking = ChannelDesign(
        digital_filter(loops.order, loops.bandwidth_hz, T),
        digital_filter(1, loops.code_bandwidth_hz, T),
        cn0_dbhz,
        "atan",
        "none",
        "dot",
        settings.spacing_chips,
        chips_per_radian(code, L1_HZ),
    )
    if loops.order == 1 or loops.frequency_bandwidth_hz == 0.0:
        return tracking, tracking
    assisted = assisted_filter(loops.order, loops.bandwidth_hz, loops.frequency_bandwidth_hz, T)
    return tracking, replace(tracking, carrier=assisted, frequency_kind="atan")


def loop_sigmas(design: ChannelDesign, cn0_dbhz: float) -> tuple[float, float]:
    """Return one sigma of pseudorange [m] and range rate [m/s] that thermal noise leaves in the replica.

    Equation: P of the prediction, driven by the variance of the equivalent observation, and the code by the carrier's
              rate; the gains are those of the design                                                   [Lyapunov]
    Neglects: motion and oscillator, of which aided loops have little to follow.
    """
    a = signal_ratio(cn0_dbhz, design.step_s)
    phase = equivalent_variance(PhaseDiscriminator(design.phase_kind), a)
    delay = equivalent_variance(DelayDiscriminator(design.delay_kind, Correlators(design.spacing_chips)), a)
    carrier = design.carrier
    if isinstance(carrier, LoopFilter):
        P = carrier.prediction_covariance(phase)
        rate = math.sqrt(P[1, 1]) if len(P) > 1 else 0.0
    else:
        rate = math.sqrt(carrier.rate_covariance(phase)[0, 0])
    chips2 = design.code.prediction_covariance(delay)[0, 0]
    return C_MPS / GPS_CA_CHIP_HZ * math.sqrt(chips2), C_MPS / L1_HZ / (2.0 * math.pi) * rate


@dataclass
class RecordingBuffer:
    """The newest samples of a recording, fed block by block."""

    blocks: Iterator[SignalSamples]
    keep: int  # samples that stay when a block is added, at least
    first: int = 0  # number of the first one
    in_phase: Float64 = field(default_factory=lambda: np.zeros(0))
    quadrature: Float64 = field(default_factory=lambda: np.zeros(0))

    def reach(self, sample: int) -> bool:
        """Read on until the samples before ``sample`` are there; return whether they are."""
        while self.first + len(self.in_phase) < sample:
            block = next(self.blocks, None)
            if block is None:
                return False
            drop = max(0, len(self.in_phase) - self.keep)
            self.first += drop
            self.in_phase = np.concatenate([self.in_phase[drop:], block.in_phase])
            self.quadrature = np.concatenate([self.quadrature[drop:], block.quadrature])
        return True

    def cut(self, sampling: Sampling, first: int, last: int) -> SignalSamples:
        """Return some of the samples."""
        span = slice(first - self.first, last - self.first)
        quadrature = self.quadrature[span] if sampling.is_complex else self.quadrature
        return SignalSamples(sampling, self.in_phase[span], quadrature)
