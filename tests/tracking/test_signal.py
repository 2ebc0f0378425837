"""Samples: the guard on sampling, and agreement with the correlators that are drawn without samples."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from insgnss.errors import ConfigError
from insgnss.tracking.admissible import signal_ratio
from insgnss.tracking.codes import correlation, glonass_st, gps_ca
from insgnss.tracking.correlators import Correlators
from insgnss.tracking.sample_kernels import Steps, add_signal, correlate_samples
from insgnss.tracking.signal import CarrierAndCode, ReceivedSignal, Sampling, correlate, receive

CODE = glonass_st()
REAL = Sampling(11.3e6, 3.07e6)
COMPLEX = Sampling(5.3e6, 0.2e6, is_complex=True)
CN0_DBHZ = 43.0
N_MS = 1e-3
SAMPLES = {REAL: round(REAL.rate_hz * N_MS), COMPLEX: round(COMPLEX.rate_hz * N_MS)}


@pytest.mark.parametrize("sampling", [REAL, COMPLEX], ids=["real", "complex"])
@pytest.mark.parametrize("spacing", [1.0, 0.37])
def test_mean_of_sampled_correlators_equals_that_of_drawn_ones(sampling: Sampling, spacing: float) -> None:
    received = CarrierAndCode(7.31, 812.0, 0.6)
    replica = CarrierAndCode(7.13, 655.0, 0.25)  # 0.18 chips early, 157 Hz too low
    samples = receive([ReceivedSignal(CODE, CN0_DBHZ, received)], sampling, SAMPLES[sampling], None)
    found = correlate(samples, CODE, replica, CN0_DBHZ, spacing)
    a = signal_ratio(CN0_DBHZ, SAMPLES[sampling] / sampling.rate_hz)
    drawn = Correlators(spacing, lambda x: correlation(CODE, x))
    expected = drawn.mean(a, 0.18, 0.35, 2.0 * math.pi * 157.0)
    # each of the 256 chip edges falls anywhere between two samples: 2 sqrt(256) / sqrt(12) / 5300 = 0.2 % at one sigma;
    # the folded sum frequency of real samples leaves 1 % at most
    assert np.abs(found - expected) / a == pytest.approx(0.0, abs=0.012)


@pytest.mark.parametrize("sampling", [REAL, COMPLEX], ids=["real", "complex"])
def test_covariance_of_sampled_correlators_equals_that_of_drawn_ones(
    sampling: Sampling, rng: np.random.Generator
) -> None:
    looks, count = 2000, SAMPLES[sampling]
    found = np.empty((looks, 3), np.complex128)
    for k in range(looks):
        found[k] = correlate(
            receive([ReceivedSignal(CODE, CN0_DBHZ)], sampling, count, rng),
            CODE,
            CarrierAndCode(),
            CN0_DBHZ,
            0.4,
        )
    a = signal_ratio(CN0_DBHZ, count / sampling.rate_hz)
    drawn = Correlators(0.4, lambda x: correlation(CODE, x))
    quadratures = np.concatenate([found.real, found.imag], axis=1)
    expected = np.kron(np.eye(2), drawn.covariance(a))
    covariance = np.cov(quadratures.T)
    # sigma of a sample covariance: sqrt((C_ii C_jj + C_ij^2) / looks); 36 elements: 4.5 sigma, and 1 % of sampled edges
    variances = np.diag(expected)
    sigma = np.sqrt((np.outer(variances, variances) + expected**2) / looks)
    assert np.max(np.abs(covariance - expected) / (4.5 * sigma + 0.01 * a)) < 1.0
    mean = drawn.mean(a)
    assert np.max(np.abs(found.mean(axis=0) - mean)) < 4.5 * math.sqrt(2.0 * a / looks) + 0.012 * a


def test_drawn_correlators_have_the_covariance_they_promise(rng: np.random.Generator) -> None:
    correlators, a, looks = Correlators(0.6), 30.0, 100_000
    drawn = correlators.draw(np.broadcast_to(correlators.mean(a, 0.1, 0.3), (looks, 3)), a, rng)
    expected = correlators.covariance(a)
    # 4.5 sigma of nine elements, the largest of which is sqrt(2 / looks) of the variance
    assert np.cov(drawn.real.T) == pytest.approx(expected, abs=4.5 * a * math.sqrt(2.0 / looks))
    assert np.cov(drawn.imag.T) == pytest.approx(expected, abs=4.5 * a * math.sqrt(2.0 / looks))
    assert np.mean((drawn.real - drawn.real.mean(0)) * drawn.imag, axis=0) == pytest.approx(
        0.0, abs=4.5 * a / math.sqrt(looks)
    )


def test_data_change_the_sign_of_their_period_only() -> None:
    signs = np.array([1, -1, 1], np.int8)
    count = 3 * SAMPLES[COMPLEX]
    samples = receive([ReceivedSignal(CODE, CN0_DBHZ, signs=signs)], COMPLEX, count, None)
    a = signal_ratio(CN0_DBHZ, 3e-3)
    found = correlate(samples, CODE, CarrierAndCode(), CN0_DBHZ)[1]
    assert found.real == pytest.approx(a / 3.0, rel=0.01)  # + - +: a third is left


def test_two_signals_add_and_another_code_is_suppressed() -> None:
    sampling, count = Sampling(5.3e6, 0.0, is_complex=True), 5300
    both = [ReceivedSignal(gps_ca(1), 45.0), ReceivedSignal(gps_ca(2), 45.0)]
    a = signal_ratio(45.0, 1e-3)
    found = correlate(receive(both, sampling, count, None), gps_ca(1), CarrierAndCode(), 45.0)[1]
    assert abs(found - a) < 66.0 / 1023.0 * a + 0.012 * a  # Gold codes: 65 of 1023 at most


def test_code_doppler_moves_the_delay_with_the_carrier() -> None:
    carrier_hz, doppler, seconds = 1602e6, 4000.0, 0.2
    state = CarrierAndCode(0.0, doppler, 0.0, carrier_hz)
    count = round(COMPLEX.rate_hz * seconds)
    samples = receive([ReceivedSignal(CODE, CN0_DBHZ, state)], COMPLEX, count, None)
    a = signal_ratio(CN0_DBHZ, seconds)
    assert abs(correlate(samples, CODE, state, CN0_DBHZ)[1]) == pytest.approx(a, rel=0.01)
    still = correlate(samples, CODE, CarrierAndCode(0.0, doppler), CN0_DBHZ)[1]
    # the delay runs off by 511 kHz 4000 / 1602e6 0.2 s = 0.255 chips, 0.128 on average
    assert abs(still) == pytest.approx(a * (1.0 - 0.1276), rel=0.01)


# ------------------------------------------------------------ what sampling can do to the signal


def thesis_correlators(noise: bool, phase_rad: float, rng: np.random.Generator, looks: int = 1) -> np.ndarray:
    """Return prompt correlators of 20 MHz sampled at 40 MHz, past the guard, as the thesis's program computed them."""
    sampling, count = Sampling(40e6, 20e6), 40_000
    A, found = sampling.amplitude(37.0), np.empty(looks, np.complex128)
    for k in range(looks):
        x = rng.standard_normal(count) if noise else np.zeros(count)
        add_signal(
            A, CODE.chips, np.ones(1, np.int8), Steps(0.0, CODE.rate_hz / 40e6, 0.0, 0.5), x, np.zeros(0)
        )
        out = np.empty((1, 2))
        correlate_samples(
            x,
            np.zeros(0),
            CODE.chips,
            np.zeros(1),
            Steps(0.0, CODE.rate_hz / 40e6, phase_rad / (2 * math.pi), 0.5),
            out,
        )
        found[k] = A * (out[0, 0] + 1j * out[0, 1])
    return found


def test_carrier_at_half_the_sampling_rate_gives_four_times_the_curve_and_correlated_noise(
    rng: np.random.Generator,
) -> None:
    replica = -0.3  # the signal's phase is 0: an offset of 0.3 rad
    Z = thesis_correlators(False, replica, rng)[0]
    a = signal_ratio(37.0, 1e-3)
    assert Z.real * Z.imag == pytest.approx(4.0 * 0.5 * a**2 * math.sin(0.6), rel=0.01)
    noisy = thesis_correlators(True, replica, rng, 60)
    assert np.corrcoef(noisy.real, noisy.imag)[0, 1] == pytest.approx(1.0, abs=1e-6)


def test_carrier_at_half_the_sampling_rate_is_refused_and_the_other_program_of_the_thesis_too() -> None:
    with pytest.raises(ConfigError, match="kills a quadrature"):
        Sampling(40e6, 20e6, bandpass=True).check(511e3)
    with pytest.raises(ConfigError, match="below Nyquist"):
        Sampling(40e6, 20e6).check(511e3)
    with pytest.raises(ConfigError, match="kills a quadrature"):
        receive([ReceivedSignal(CODE, 40.0)], Sampling(20e6, 10e6, bandpass=True), 100, None)


def test_sampling_of_the_signal_chapter_is_accepted() -> None:
    # 20 MHz at 45 MHz: the sum frequency folds to 5 MHz
    assert Sampling(45e6, 20e6).check(511e3) is None


@pytest.mark.parametrize(
    ("sampling", "word"),
    [
        (Sampling(6e6, 3.07e6), "below Nyquist"),
        (Sampling(0.9e6, 0.0, is_complex=True), "below Nyquist"),
        (Sampling(11e6, 0.3e6), "reaches below 0"),
        (Sampling(4e6, 3.9e6, bandpass=True), "edge of two Nyquist zones"),
        (Sampling(math.nan, 1e6), "finite"),
        (Sampling(5e6, math.nan), "a carrier of nan"),
    ],
)
def test_sampling_that_folds_the_main_lobe_is_refused_with_advice(sampling: Sampling, word: str) -> None:
    with pytest.raises(ConfigError, match=word) as caught:
        sampling.check(511e3)
    assert caught.value.advice


def test_bandpass_sampling_in_a_higher_zone_works_when_asked_for() -> None:
    sampling = Sampling(5.7e6, 9.9e6, bandpass=True)  # 9.9 MHz lies in the fourth zone, 8.55 to 11.4 MHz
    samples = receive([ReceivedSignal(CODE, CN0_DBHZ)], sampling, 5700, None)
    found = correlate(samples, CODE, CarrierAndCode(phase_rad=-0.5), CN0_DBHZ)[1]
    a = signal_ratio(CN0_DBHZ, 1e-3)
    assert abs(found / a - np.exp(0.5j)) < 0.02


def test_no_samples_are_refused() -> None:
    with pytest.raises(ConfigError, match="at least one"):
        receive([ReceivedSignal(CODE, 40.0)], COMPLEX, 0, None)


@pytest.mark.parametrize("cn0", [-40.0, 10_000.0, math.nan])
def test_cn0_of_a_wrong_unit_is_refused(cn0: float) -> None:
    with pytest.raises(ConfigError, match="dBHz"):
        signal_ratio(cn0, 1e-3)


def test_a_million_samples_are_made_and_correlated(
    rng: np.random.Generator, benchmark: Callable[..., object]
) -> None:
    signal = [ReceivedSignal(CODE, CN0_DBHZ)]
    correlate(receive(signal, REAL, 1000, rng), CODE, CarrierAndCode(), CN0_DBHZ)  # compiled

    def work() -> object:
        return correlate(receive(signal, REAL, 1_000_000, rng), CODE, CarrierAndCode(), CN0_DBHZ)

    # at most 0.1 s: 10 Msamples/s; about 40 were measured
    assert benchmark(work) is not None


@pytest.mark.parametrize(
    ("phase", "step"),
    [(math.nan, 0.1), (math.inf, 0.1), (0.0, math.nan), (0.0, -1.0), (0.0, 1e300), (1e300, 0.1)],
)
def test_code_phase_that_tells_no_chip_adds_nothing_and_correlates_with_nothing(
    phase: float, step: float
) -> None:
    x, out = np.ones(200), np.ones((1, 2))

    add_signal(1.0, CODE.chips, np.ones(1, np.int8), Steps(phase, step, 0.0, 0.1), x, np.zeros(0))
    correlate_samples(x, np.zeros(0), CODE.chips, np.zeros(1), Steps(phase, step, 0.0, 0.1), out)

    np.testing.assert_array_equal(x, 1.0)
    np.testing.assert_array_equal(out, 0.0)


def test_replica_farther_away_than_a_period_correlates_with_nothing() -> None:
    out = np.ones((3, 2))
    offsets = np.array([0.0, math.nan, 2.0 * len(CODE.chips)])
    correlate_samples(np.ones(200), np.zeros(0), CODE.chips, offsets, Steps(0.0, 0.1, 0.0, 0.01), out)

    assert out[0].any()
    np.testing.assert_array_equal(out[1:], 0.0)
