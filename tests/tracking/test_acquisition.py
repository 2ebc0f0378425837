"""Acquisition against the theory of detection: false alarms, probability of detection, errors of delay and Doppler."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import special, stats

from insgnss.errors import ConfigError, InputError
from insgnss.gnss.signals import L1_HZ
from insgnss.receiver.detection import detection_probability, threshold
from insgnss.tracking.acquisition import SearchSpan, acquire
from insgnss.tracking.codes import gps_ca
from insgnss.tracking.signal import CarrierAndCode, ReceivedSignal, Sampling, SignalSamples, receive
from tests.statistics_bounds import share_below_bounds

COMPLEX = Sampling(2.5e6, 0.1e6, is_complex=True)
REAL = Sampling(5.3e6, 1.3e6)
CODE = gps_ca(7)


def signal(
    sampling: Sampling, cn0: float | None, ms: int, state: CarrierAndCode, rng: np.random.Generator | None
) -> SignalSamples:
    """Return a code in noise, or noise alone."""
    received = [] if cn0 is None else [ReceivedSignal(CODE, cn0, state)]
    return receive(received, sampling, round(ms * 1e-3 * sampling.rate_hz), rng)


@pytest.mark.parametrize("sampling", [COMPLEX, REAL], ids=["complex", "real"])
def test_signal_is_found_at_its_delay_and_doppler(sampling: Sampling, rng: np.random.Generator) -> None:
    truth = CarrierAndCode(321.4, 1730.0, 0.7, L1_HZ)
    found = acquire(signal(sampling, 45.0, 20, truth, rng), [CODE], SearchSpan(0.0, 4000.0, looks=2), L1_HZ)[
        0
    ]
    # the replica's sampling: half a sample at most of a period that is no whole number of them
    assert found.delay_chips == pytest.approx(321.4, abs=0.15)
    # sigma of a frequency by 20 ms at 45 dBHz: sqrt(12 / (2 q T)) / (2 pi T) = 2 Hz; the grid is of 4 Hz
    assert found.doppler_hz == pytest.approx(1730.0, abs=10.0)
    assert found.cn0_dbhz == pytest.approx(45.0, abs=1.5)
    assert found.statistic > threshold(1e-6 / found.cells, 2)


@pytest.mark.parametrize("offset_hz", [0.0, 15.0, 30.0, -31.0])
@pytest.mark.parametrize("sampling", [COMPLEX, REAL], ids=["complex", "real"])
def test_cn0_of_known_data_bits_does_not_depend_on_the_place_in_the_doppler_bin(
    sampling: Sampling, offset_hz: float, rng: np.random.Generator
) -> None:
    # bins of looks of 10 ms are 67 Hz wide; the bits begin 7.3 ms after the first sample
    delay = 7300.0 * 1.023
    truth, signs = (
        CarrierAndCode(delay, 200.0 + offset_hz, 0.7, L1_HZ),
        np.repeat([1, -1, -1, 1, -1, 1, -1, 1], 20),
    )
    # code periods are counted from the signal's own beginning, a bit earlier
    received = ReceivedSignal(
        CODE, 42.0, replace(truth, delay_chips=delay - 20.0 * 1023.0), signs.astype(np.int8)
    )
    samples = receive([received], sampling, round(0.12 * sampling.rate_hz), rng)
    span = SearchSpan(200.0, 34.0, looks=12)

    found = acquire(samples, [CODE], span, L1_HZ, [delay])[0]
    assert found.doppler_hz == pytest.approx(200.0 + offset_hz, abs=1.0)
    # sigma of 120 ms at 42 dBHz: 4.34 sqrt(2 / (q t)) = 0.14 dB; the code's side lobes count as noise, 0.5 dB
    assert found.cn0_dbhz == pytest.approx(42.0 - 0.5, abs=0.6)


def test_sums_of_noise_alone_exceed_the_threshold_as_often_as_stated(rng: np.random.Generator) -> None:
    # one cell far apart from the others in every search: its false-alarm rate is that of the threshold
    span = SearchSpan(0.0, 1.0, 200.0, 1e-3, coherent_s=1e-3, looks=3)
    pfa, runs = 0.1, 300
    count = 0
    for _ in range(runs):
        found = acquire(signal(COMPLEX, None, 3, CarrierAndCode(), rng), [CODE], span, L1_HZ)[0]
        assert found.cells == 1
        count += found.statistic > threshold(pfa, 3)
    low, high = share_below_bounds(pfa, runs)
    assert low <= count / runs <= high


def test_whole_search_of_noise_stays_below_the_stated_false_alarm_rate(rng: np.random.Generator) -> None:
    # of 2.4 cells a chip some share their noise, so the rate lies below the sum over cells, but not by an order
    span = SearchSpan(0.0, 1500.0, coherent_s=1e-3, looks=4)
    pfa, runs = 0.3, 120
    count = 0
    for _ in range(runs):
        found = acquire(signal(COMPLEX, None, 4, CarrierAndCode(), rng), [CODE], span, L1_HZ)[0]
        count += found.statistic > threshold(pfa / found.cells, 4)
    high = stats.binom.ppf(0.999, runs, pfa) / runs
    low = stats.binom.ppf(0.001, runs, pfa / 5.0) / runs
    assert low <= count / runs <= high


def test_probability_of_detection_is_that_of_the_theory(rng: np.random.Generator) -> None:
    # delay and Doppler in the middle of a cell: a sample's edge alone costs something
    cn0, looks, pfa, runs = 34.0, 3, 1e-2, 300
    delay = CODE.length * 100 / 2500.0
    truth = CarrierAndCode(delay, 0.0, 0.3)
    span = SearchSpan(0.0, 1.0, delay, 1e-3, coherent_s=1e-3, looks=looks)
    count = 0
    for _ in range(runs):
        found = acquire(signal(COMPLEX, cn0, 3, truth, rng), [CODE], span, L1_HZ)[0]
        count += found.statistic > threshold(pfa, looks)
    expected = float(detection_probability(10.0 ** (0.1 * cn0) * 1e-3, pfa, looks))
    assert 0.3 < expected < 0.99
    # the median of 2500 cells, which scale the sum, is good to 2 %: one more per cent of probability
    low, high = share_below_bounds(expected, runs)
    assert low - 0.02 <= count / runs <= high + 0.02


def test_noise_floor_is_estimated_in_coloured_noise_too(rng: np.random.Generator) -> None:
    white = signal(COMPLEX, None, 200, CarrierAndCode(), rng)
    smooth = SignalSamples(
        COMPLEX, *(np.convolve(x, [0.5, 0.5], "same") for x in (white.in_phase, white.quadrature))
    )
    found = acquire(
        smooth, [gps_ca(p) for p in range(1, 9)], SearchSpan(0.0, 1000.0, coherent_s=1e-3, looks=100), L1_HZ
    )
    largest = max(each.statistic for each in found)
    # noise of half the power: scaled by that power, 1.2 times what white noise gives lies near the carrier
    assert threshold(0.999 / found[0].cells, 100) < largest < threshold(1e-4 / found[0].cells, 100)


def test_delay_of_later_looks_follows_the_doppler(rng: np.random.Generator) -> None:
    # 6 kHz for 0.4 s: 1.6 chips, by which the looks would miss each other
    truth = CarrierAndCode(40.0, 6000.0, 0.0, L1_HZ)
    samples = signal(COMPLEX, 40.0, 400, truth, rng)
    found = acquire(samples, [CODE], SearchSpan(6000.0, 100.0, coherent_s=0.01, looks=40), L1_HZ)[0]
    apart = acquire(samples, [CODE], SearchSpan(6000.0, 100.0, coherent_s=0.01, looks=40), 1e15)[0]
    assert found.delay_chips == pytest.approx(40.0, abs=0.1)
    assert found.statistic > 1.8 * apart.statistic


def test_window_limits_the_cells_and_holds_around_the_end_of_the_code(rng: np.random.Generator) -> None:
    truth = CarrierAndCode(1022.6, 100.0, 0.0, L1_HZ)
    samples = signal(COMPLEX, 47.0, 10, truth, rng)
    found = acquire(samples, [CODE], SearchSpan(100.0, 30.0, 0.3, 5.0), L1_HZ)[0]
    assert (found.delay_chips + 10.4) % 1023.0 == pytest.approx(10.0, abs=0.15)
    assert found.cells == pytest.approx(10.0 * 2500 / 1023, abs=2.0)


def test_told_doppler_rate_keeps_the_looks_together(rng: np.random.Generator) -> None:
    t = np.arange(round(0.3 * COMPLEX.rate_hz)) / COMPLEX.rate_hz
    still, noise = (
        signal(COMPLEX, 40.0, 300, CarrierAndCode(5.0), None),
        signal(COMPLEX, None, 300, CarrierAndCode(), rng),
    )
    turn = np.exp(1j * np.pi * 2600.0 * (t - 0.15) ** 2)  # 50 g along the line of sight
    moved = (still.in_phase + 1j * still.quadrature) * turn
    samples = SignalSamples(COMPLEX, moved.real + noise.in_phase, moved.imag + noise.quadrature)
    span = SearchSpan(0.0, 30.0, coherent_s=0.01, looks=30, doppler_rate_hz_per_s=2600.0)
    led = acquire(samples, [CODE], span, L1_HZ)[0]
    blind = acquire(samples, [CODE], SearchSpan(0.0, 30.0, coherent_s=0.01, looks=30), L1_HZ)[0]
    assert led.doppler_hz == pytest.approx(0.0, abs=5.0)
    assert led.statistic > 3.0 * blind.statistic


def test_doppler_refined_over_known_data_bits_is_better_than_over_looks(rng: np.random.Generator) -> None:
    span, errors = SearchSpan(500.0, 30.0, 300.0, 5.0, coherent_s=0.01, looks=40), []
    for _ in range(12):
        signs = np.repeat((1 - 2 * rng.integers(0, 2, 30)).astype(np.int8), 20)
        doppler = float(rng.uniform(480.0, 520.0))
        received = ReceivedSignal(
            CODE, 28.0, CarrierAndCode(300.0 + 7 * 1023.0 - 20460.0, doppler, 0.3, L1_HZ), signs
        )
        samples = receive([received], COMPLEX, round(0.4 * COMPLEX.rate_hz), rng)
        by_bits = acquire(samples, [CODE], span, L1_HZ, [300.0 + 7 * 1023.0 + 200.0])[0]
        by_looks = acquire(samples, [CODE], span, L1_HZ)[0]
        errors.append((by_bits.doppler_hz - doppler, by_looks.doppler_hz - doppler))
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    # a sum of unknown sign over T tells the frequency to sqrt(6 / (q T^3)) / 2 pi: 5.5 Hz of 20 ms, 15 Hz of 10 ms,
    # over the root of their number 1.2 and 2.4 Hz, at these ratios more
    assert rms[0] < 3.0
    assert rms[0] < 0.8 * rms[1]


def test_too_few_samples_a_broken_look_and_a_folded_signal_are_refused(rng: np.random.Generator) -> None:
    samples = signal(COMPLEX, None, 5, CarrierAndCode(), rng)
    with pytest.raises(InputError, match="fewer than"):
        acquire(samples, [CODE], SearchSpan(0.0, 100.0, looks=2), L1_HZ)
    with pytest.raises(ConfigError, match="whole number of code periods"):
        acquire(samples, [CODE], SearchSpan(0.0, 100.0, coherent_s=1.5e-3), L1_HZ)
    with pytest.raises(ConfigError, match="Nyquist"):
        acquire(samples, [CODE], SearchSpan(0.0, 1e6, coherent_s=1e-3), L1_HZ)
    with pytest.raises(ConfigError, match="0 looks"):
        SearchSpan(0.0, 1.0, looks=0)


def test_threshold_is_the_quantile_of_the_gamma_distribution() -> None:
    assert float(threshold(math.exp(-3.0))) == pytest.approx(3.0)
    assert float(special.gammaincc(7, threshold(1e-5, 7))) == pytest.approx(1e-5)
