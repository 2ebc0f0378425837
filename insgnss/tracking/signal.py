"""The signal as samples at an intermediate frequency or at baseband, with noise for a C/N0, and its correlation.

The noise of each sample (of each component, where samples are complex) has the variance 1. With sampling interval Td
the amplitude follows from C/N0: A^2 = 4 q Td of real samples, 2 q Td of complex ones.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from insgnss.errors import ConfigError
from insgnss.tables import Complex, Float64, Int8
from insgnss.tracking.admissible import linear_cn0_hz, require_positive
from insgnss.tracking.codes import RangingCode
from insgnss.tracking.correlators import replica_offsets
from insgnss.tracking.sample_kernels import Steps, add_signal, correlate_samples

# The image at twice the carrier, folded to f, leaves 1 / (pi f T) of the amplitude in an integration at most: 1 %
_LEAST_FOLDED_PERIODS: Final = 32.0
_NO_QUADRATURE: Final = np.zeros(0)
_ALWAYS_PLUS: Final[Int8] = np.ones(1, np.int8)


@dataclass(frozen=True)
class Sampling:
    """How the signal is sampled."""

    rate_hz: float
    intermediate_hz: float = 0.0  # the carrier without Doppler
    is_complex: bool = False
    bandpass: bool = False  # real samples of a higher Nyquist zone are wanted

    def check(self, chip_hz: float, integration_s: float = 1e-3, doppler_hz: float = 0.0) -> None:
        """Refuse a sampling that folds the main lobe, or that kills a quadrature.

        Real samples have a sum and a difference frequency after the replica's carrier. If the carrier is a multiple of
        half the sampling rate (20 MHz at 40 MHz) the sum frequency is zero: cos^2 averages to 1 and sin to 0, in-phase
        and quadrature carry the same noise, and the -IQ curve is four times too high.

        Raises
        ------
        ConfigError : with the rate that would do
        """
        require_positive(rate_hz=self.rate_hz, chip_hz=chip_hz, integration_s=integration_s)
        carrier, half = self.intermediate_hz + doppler_hz, 0.5 * self.rate_hz
        if not math.isfinite(carrier):
            advice = "give the intermediate frequency and the Doppler in Hz"
            raise ConfigError(f"a carrier of {carrier:g} Hz", key="intermediate_hz", advice=advice)
        if self.is_complex:
            self._check_lobe(abs(carrier) + chip_hz, half)
            return
        if not self.bandpass:
            if carrier < chip_hz:
                advice = f"take an intermediate frequency above {chip_hz:g} Hz, or complex samples"
                raise ConfigError(
                    f"the main lobe around {carrier:g} Hz reaches below 0",
                    key="intermediate_hz",
                    advice=advice,
                )
            self._check_lobe(carrier + chip_hz, half)
        sum_hz = 2.0 * carrier
        folded = abs(sum_hz - self.rate_hz * round(sum_hz / self.rate_hz))
        if folded * integration_s < _LEAST_FOLDED_PERIODS:
            raise ConfigError(
                f"sampling at {self.rate_hz:g} Hz kills a quadrature: twice the carrier {carrier:g} Hz folds to "
                f"{folded:g} Hz",
                key="rate_hz",
                advice=f"keep the carrier {_LEAST_FOLDED_PERIODS / integration_s / 2:g} Hz away from every multiple of "
                f"half the sampling rate, for example at {1.125 * self.rate_hz:g} Hz",
            )
        if math.floor((carrier - chip_hz) / half) != math.floor((carrier + chip_hz) / half):
            advice = "move the carrier towards an odd multiple of a quarter of the sampling rate"
            raise ConfigError(
                "the main lobe lies across the edge of two Nyquist zones", key="rate_hz", advice=advice
            )

    def _check_lobe(self, edge_hz: float, half_hz: float) -> None:
        if edge_hz > half_hz:
            raise ConfigError(
                f"sampling at {self.rate_hz:g} Hz is below Nyquist: the main lobe reaches {edge_hz:g} Hz",
                key="rate_hz",
                advice=f"sample at {2.0 * edge_hz:g} Hz or faster"
                + (
                    ""
                    if self.is_complex
                    else ", or say that a higher Nyquist zone is meant: Sampling(..., bandpass=True)"
                ),
            )

    def amplitude(self, cn0_dbhz: float) -> float:
        """Return the amplitude in noise of variance 1.

        Equation: A^2 = 4 q Td sigma_n^2 (real), 2 q Td sigma_n^2 (complex)
        """
        return math.sqrt((2.0 if self.is_complex else 4.0) * linear_cn0_hz(cn0_dbhz) / self.rate_hz)


@dataclass(frozen=True)
class CarrierAndCode:
    """Delay, Doppler and phase at the first sample: of a signal or of a replica."""

    delay_chips: float = 0.0
    doppler_hz: float = 0.0
    phase_rad: float = 0.0
    # the code's Doppler is that of the carrier in their ratio; inf: no code Doppler
    carrier_hz: float = math.inf

    def steps(self, code: RangingCode, sampling: Sampling) -> Steps:
        """Return code phase and step [chips], carrier phase and step [cycles], as the kernels want them."""
        chip_rate = code.rate_hz * (1.0 + self.doppler_hz / self.carrier_hz)
        cycle_step = (sampling.intermediate_hz + self.doppler_hz) / sampling.rate_hz
        cycles = self.phase_rad / (2.0 * math.pi)
        return Steps(-self.delay_chips, chip_rate / sampling.rate_hz, cycles, cycle_step)


@dataclass(frozen=True)
class ReceivedSignal:
    """One satellite's signal as it arrives."""

    code: RangingCode
    cn0_dbhz: float
    state: CarrierAndCode = CarrierAndCode()
    signs: Int8 = field(default_factory=lambda: _ALWAYS_PLUS)  # of the data, per code period


@dataclass(frozen=True)
class SignalSamples:
    """Samples with noise of variance 1 in each component."""

    sampling: Sampling
    in_phase: Float64  # (n,)
    quadrature: Float64  # (n,) or (0,)


def receive(
    signals: Sequence[ReceivedSignal],
    sampling: Sampling,
    count: int,
    rng: np.random.Generator | None,
    integration_s: float = 1e-3,
) -> SignalSamples:
    """Return samples of all signals and noise.

    Equation: y_k = sum A h(t_k - tau) d cos(w_if t_k + w_d t_k + phi) + n_k, var n = N0 / (2 Td)           [(3.1)]

    Parameters
    ----------
    rng : of the noise; None for none
    integration_s : of the correlators to come, within which a folded carrier must average out

    Raises
    ------
    ConfigError : the sampling folds a signal or kills a quadrature
    """
    if count < 1:
        raise ConfigError(f"{count} samples", key="count", advice="ask for at least one sample")
    for signal in signals:
        sampling.check(signal.code.rate_hz, integration_s, signal.state.doppler_hz)
    in_phase = np.zeros(count) if rng is None else rng.standard_normal(count)
    quadrature = _NO_QUADRATURE
    if sampling.is_complex:
        quadrature = np.zeros(count) if rng is None else rng.standard_normal(count)
    for signal in signals:
        steps = signal.state.steps(signal.code, sampling)
        add_signal(
            sampling.amplitude(signal.cn0_dbhz), signal.code.chips, signal.signs, steps, in_phase, quadrature
        )
    return SignalSamples(sampling, in_phase, quadrature)


def correlate(
    samples: SignalSamples,
    code: RangingCode,
    replica: CarrierAndCode,
    cn0_dbhz: float,
    spacing_chips: float = 1.0,
) -> Complex:
    """Return early, prompt and late correlators, (3,), scaled to the mean and variance a = 2 q T.

    Equation: Z = A / sigma_n^2 sum y h(t - tau~ - d) exp(-j theta~)                                      [(1.10)]
    The replicas may have any delay, whole samples or not.

    Parameters
    ----------
    samples : with noise of variance 1
    code, replica : the replica's code, delay, Doppler and phase at the first sample
    cn0_dbhz : for the scale only
    spacing_chips : from early to late
    """
    out = np.zeros((3, 2))
    correlate_samples(
        samples.in_phase,
        samples.quadrature,
        code.chips,
        replica_offsets(spacing_chips),
        replica.steps(code, samples.sampling),
        out,
    )
    return np.asarray(samples.sampling.amplitude(cn0_dbhz) * (out[:, 0] + 1j * out[:, 1]))
