"""Tracking channels on samples: jitter against the loops' own theory, readings against the truth, aiding."""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from scipy import stats

from insgnss.errors import ConfigError
from insgnss.gnss.signals import L1_HZ
from insgnss.tables import Float64
from insgnss.tracking.admissible import signal_ratio
from insgnss.tracking.channels import ChannelDesign, chips_per_radian
from insgnss.tracking.codes import gps_ca
from insgnss.tracking.correlators import Correlators
from insgnss.tracking.delay_discriminators import DelayDiscriminator
from insgnss.tracking.discriminators import equivalent_variance
from insgnss.tracking.loop_filters import LoopFilter, digital_filter
from insgnss.tracking.phase_discriminators import PhaseDiscriminator
from insgnss.tracking.sample_channel import (
    COUNT,
    DELAY_CHIPS,
    MIDDLE,
    PHASE_RAD,
    PROMPT_I,
    PROMPT_Q,
    RATE_RADPS,
    LoopAiding,
    SampleChannels,
)
from insgnss.tracking.signal import CarrierAndCode, ReceivedSignal, Sampling, SignalSamples, receive

SAMPLING = Sampling(2.5e6, 20e3, is_complex=True)
T = 0.005
SECONDS = 4.0
CN0 = 41.0
PRNS = (3, 8, 14, 22, 31)
# Dopplers that let the code slide over the samples' grid by chips: its rounding averages out
SIGNALS = [
    CarrierAndCode(70_000.25 + 100.3 * c, 2100.0 + 130.0 * c, 0.2 * c, L1_HZ) for c in range(len(PRNS))
]


class Tracked(NamedTuple):
    """Errors of the channels, replica minus truth, (n, m)."""

    phase_rad: Float64
    rate_radps: Float64
    delay_chips: Float64
    channels: SampleChannels
    samples: SignalSamples


def design(carrier: LoopFilter, code_hz: float = 2.0) -> ChannelDesign:
    return ChannelDesign(
        carrier,
        digital_filter(1, code_hz, T),
        CN0,
        spacing_chips=0.5,
        chips_per_radian=chips_per_radian(gps_ca(1), L1_HZ),
    )


def no_aid() -> LoopAiding:
    return LoopAiding(*(np.zeros(len(PRNS)) for _ in range(3)))


def true_delay(state: CarrierAndCode, t_s: Float64) -> Float64:
    """Return the delay in chips of a signal of constant Doppler."""
    return state.delay_chips - 1.023e6 * state.doppler_hz / L1_HZ * t_s


@cache
def samples() -> SignalSamples:
    """Return five signals in noise of three times the variance that the kernels assume."""
    rng = np.random.default_rng(51)
    bits = [(1 - 2 * rng.integers(0, 2, 400)).astype(np.int8) for _ in PRNS]
    received = []
    for prn, state, sign in zip(PRNS, SIGNALS, bits, strict=True):
        # periods are counted from the recording's beginning; a delay of 70 periods shifts the data's by as much
        inside = CarrierAndCode(state.delay_chips % 20460 - 20460, state.doppler_hz, state.phase_rad, L1_HZ)
        received.append(ReceivedSignal(gps_ca(prn), CN0, inside, np.repeat(sign, 20)))
    made = receive(received, SAMPLING, round(SECONDS * SAMPLING.rate_hz), rng)
    return SignalSamples(SAMPLING, math.sqrt(3.0) * made.in_phase, math.sqrt(3.0) * made.quadrature)


@cache
def tracked() -> Tracked:
    """Return what loops of 10 and 2 Hz do from a start a little off."""
    channels = SampleChannels(
        SAMPLING, [gps_ca(p) for p in PRNS], design(digital_filter(2, 10.0, T)), 3.0, 2000
    )
    for c, state in enumerate(SIGNALS):
        channels.open_channel(
            c, 1000, (state.delay_chips + 0.1) / 1.023e6, 2.0 * math.pi * (state.doppler_hz + 2.0)
        )
    made = samples()
    channels.run(made.in_phase, made.quadrature, 0, len(made.in_phase), no_aid())
    return errors(channels, made)


def errors(channels: SampleChannels, made: SignalSamples) -> Tracked:
    rows = channels.records[: channels.written.min()]
    t = rows[:, :, MIDDLE] / SAMPLING.rate_hz
    phase, rate, delay = (np.empty(t.shape) for _ in range(3))
    for c, state in enumerate(SIGNALS):
        off = rows[:, c, PHASE_RAD] - 2.0 * math.pi * state.doppler_hz * t[:, c] - state.phase_rad
        phase[:, c] = (off + 0.5 * math.pi) % math.pi - 0.5 * math.pi
        rate[:, c] = rows[:, c, RATE_RADPS] - 2.0 * math.pi * state.doppler_hz
        delay[:, c] = rows[:, c, DELAY_CHIPS] - true_delay(state, t[:, c])
    return Tracked(phase, rate, delay, channels, made)


def bounds(count: float) -> tuple[float, float]:
    """Return bounds of a mean square over its expectation for so many independent values."""
    low, high = stats.chi2.ppf([5e-4, 1.0 - 5e-4], count) / count
    return float(low), float(high)


def test_carrier_and_code_jitter_are_those_of_the_theory() -> None:
    found, made = tracked(), design(digital_filter(2, 10.0, T))
    a = signal_ratio(CN0, T)
    settled = slice(round(1.0 / T), None)
    P = made.carrier.prediction_covariance(equivalent_variance(PhaseDiscriminator("atan"), a))
    code = equivalent_variance(DelayDiscriminator("dot", Correlators(0.5)), a)
    for error, variance, bandwidth in (
        (found.phase_rad, P[0, 0], 10.0),
        (found.rate_radps, P[1, 1], 10.0),
        (found.delay_chips, made.code.prediction_covariance(code)[0, 0], 2.0),
    ):
        independent = 2.0 * bandwidth * (SECONDS - 1.0) * len(PRNS)
        low, high = bounds(independent)
        assert low < float(np.mean(error[settled] ** 2)) / variance < high


def test_prompt_correlators_have_the_mean_and_noise_of_the_told_ratio() -> None:
    found = tracked()
    rows = found.channels.records[round(1.0 / T) : found.channels.written.min()]
    a = signal_ratio(CN0, T)
    power = rows[:, :, PROMPT_I] ** 2 + rows[:, :, PROMPT_Q] ** 2
    # E|Z|^2 = a^2 p + 2 a; the loops' phase jitter turns the sum but takes nothing from it. Samples of infinite band
    # lose nothing by the code's rounding to samples but at its edges: half a sample of 2.44 in a chip, in the mean
    count = power.size
    mean, sd = a * a + 2.0 * a, math.sqrt(4.0 * a**3 + 4.0 * a * a)
    assert float(power.mean()) == pytest.approx(mean, abs=4.0 * sd / math.sqrt(count) + 0.02 * mean)
    quadrature = rows[:, :, PROMPT_Q]
    # the quadrature's variance: noise a, and the jitter of the phase
    jitter = float(np.mean(found.phase_rad[round(1.0 / T) :] ** 2))
    low, high = bounds(count)
    assert low * 0.95 < float(np.mean(quadrature**2)) / (a + a * a * jitter) < high * 1.05


def test_integrations_follow_each_other_without_a_gap_and_inside_of_data_bits() -> None:
    rows = tracked().channels.records[: tracked().channels.written.min()]
    begin = rows[:, :, MIDDLE] - 0.5 * (rows[:, :, COUNT] - 1.0)
    assert np.array_equal(begin[1:], begin[:-1] + rows[:-1, :, COUNT])
    for c, state in enumerate(SIGNALS):
        phase = 1.023e6 * begin[:, c] / SAMPLING.rate_hz - rows[:, c, DELAY_CHIPS]
        into = phase % 5115.0
        assert np.all((into < 2.0) | (into > 5113.0))  # a chip is less than a sample
        assert state.delay_chips > 0.0


def test_reading_is_the_pseudorange_without_ambiguity() -> None:
    found = tracked()
    sample = len(found.samples.in_phase) - 20_000
    sigma = math.sqrt(
        design(digital_filter(2, 10.0, T)).code.prediction_covariance(
            equivalent_variance(DelayDiscriminator("dot", Correlators(0.5)), signal_ratio(CN0, T))
        )[0, 0]
    )
    for c, state in enumerate(SIGNALS):
        reading = found.channels.reading(c, sample)
        if reading is None:  # of an earlier integration than the last one
            reading = found.channels.reading(
                c, found.channels.records[found.channels.written[c] - 1, c, MIDDLE]
            )
            sample_c = found.channels.records[found.channels.written[c] - 1, c, MIDDLE]
        else:
            sample_c = float(sample)
        assert reading is not None
        expected = float(true_delay(state, np.array([sample_c / SAMPLING.rate_hz]))[0])
        assert reading.pseudorange_s * 1.023e6 == pytest.approx(expected, abs=5.0 * sigma)
        assert reading.rate_radps / (2.0 * math.pi) == pytest.approx(state.doppler_hz, abs=6.0)
    assert found.channels.reading(0, 0.0) is None


def test_same_samples_in_pieces_give_the_same_bits() -> None:
    found, made = tracked(), samples()
    channels = SampleChannels(
        SAMPLING, [gps_ca(p) for p in PRNS], design(digital_filter(2, 10.0, T)), 3.0, 2000
    )
    for c, state in enumerate(SIGNALS):
        channels.open_channel(
            c, 1000, (state.delay_chips + 0.1) / 1.023e6, 2.0 * math.pi * (state.doppler_hz + 2.0)
        )
    piece, first = 50_000, 0
    while first < 1_000_000:
        span = slice(max(0, first - 30_000), first + 2 * piece)
        channels.run(made.in_phase[span], made.quadrature[span], span.start, first + piece, no_aid())
        first += piece
    n = channels.written.min()
    assert n > 70
    assert np.array_equal(channels.records[:n], found.channels.records[:n])


def test_aiding_takes_an_acceleration_out_of_a_narrow_loop() -> None:
    turn = 2.0 * math.pi * 250.0  # 4.8 g along the line of sight [rad/s^2]
    n = round(1.5 * SAMPLING.rate_hz)
    t = np.arange(n) / SAMPLING.rate_hz
    still = receive([ReceivedSignal(gps_ca(3), 60.0, CarrierAndCode(70_000.0 % 20460))], SAMPLING, n, None)
    moved = (still.in_phase + 1j * still.quadrature) * np.exp(0.5j * turn * t**2)
    left = {}
    for aided in (True, False):
        channels = SampleChannels(SAMPLING, [gps_ca(3)], design(digital_filter(2, 2.0, T)), 1.0, 400)
        channels.open_channel(0, 0, 70_000.0 / 1.023e6, 0.0)
        for k in range(70):
            first, last = round(k * 0.02 * SAMPLING.rate_hz), round((k + 1) * 0.02 * SAMPLING.rate_hz)
            aiding = LoopAiding(
                *(np.array([v if aided else 0.0]) for v in (turn * 0.02 * k, turn, float(first)))
            )
            channels.run(moved.real.copy(), moved.imag.copy(), 0, last, aiding)
        rows = channels.records[: channels.written[0], 0]
        rate = turn * rows[:, MIDDLE] / SAMPLING.rate_hz
        left[aided] = np.abs(rows[:, RATE_RADPS] - rate)[20:]
    # what is aiding is exact: nothing is left but rounding of code edges; unaided the narrow loop is left behind
    assert left[True].max() < 3.0
    assert left[False].max() > 100.0


def test_prompts_of_bits_begin_with_a_bit() -> None:
    found = tracked()
    Z = found.channels.prompts(0, 400, 4)
    assert len(Z) == 400
    sums = np.abs(Z.reshape(-1, 4).sum(axis=1)).mean()
    late = np.abs(found.channels.prompts(0, 402)[1:-1].reshape(-1, 4).sum(axis=1)).mean()
    assert sums > late
    assert len(found.channels.prompts(0, 1)) == 1


def test_closed_channel_and_integration_across_data_are_refused() -> None:
    channels = SampleChannels(SAMPLING, [gps_ca(3)], design(digital_filter(2, 2.0, T)), 1.0, 10)
    assert channels.reading(0, 0.0) is None
    assert len(channels.prompts(0, 5)) == 0
    assert not channels.is_open[0]
    for step in (0.0075, 0.0005, 0.008):
        wrong = ChannelDesign(digital_filter(2, 2.0, step), digital_filter(1, 1.0, step), CN0)
        with pytest.raises(ConfigError, match="does not fit"):
            SampleChannels(SAMPLING, [gps_ca(3)], wrong, 1.0, 10)


def test_channel_whose_samples_are_gone_closes() -> None:
    channels = SampleChannels(SAMPLING, [gps_ca(3)], design(digital_filter(2, 2.0, T)), 1.0, 10)
    channels.open_channel(0, 100, 0.07, 0.0)
    made = samples()
    channels.run(made.in_phase[:1000], made.quadrature[:1000], 100_000, 200_000, no_aid())
    assert not channels.is_open[0]
