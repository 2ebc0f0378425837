"""C/N0 estimators and lock detectors: bias against C/N0, phase, frequency and data; hysteresis; slips."""

from __future__ import annotations

import math

import numpy as np
import pytest

from insgnss.errors import ConfigError
from insgnss.tracking.admissible import signal_ratio
from insgnss.tracking.channels import data_signs
from insgnss.tracking.lock_and_cn0 import (
    expected_frequency_lock,
    expected_phase_lock,
    frequency_lock,
    locked,
    moment_cn0_dbhz,
    narrow_wide_cn0_dbhz,
    phase_lock,
    slip_time_s,
)

T, BLOCK = 1e-3, 20


def prompts(
    cn0: float,
    count: int,
    rng: np.random.Generator,
    phase: float = 0.0,
    channels: int = 40,
    data: bool = True,
) -> np.ndarray:
    a = signal_ratio(cn0, T)
    sign = data_signs(count, channels, T, 0.02, rng) if data else np.ones((count, channels))
    white = rng.standard_normal((count, channels, 2))
    return np.asarray(a * np.exp(1j * phase) * sign + math.sqrt(a) * (white[..., 0] + 1j * white[..., 1]))


@pytest.mark.parametrize("cn0", [28.0, 32.0, 40.0, 50.0])
def test_estimators_have_no_bias(cn0: float, rng: np.random.Generator) -> None:
    Z = prompts(cn0, 20_000, rng, phase=0.7)
    for found in (moment_cn0_dbhz(Z, T, 2000), narrow_wide_cn0_dbhz(Z, T, 2000, BLOCK)):
        values = found[np.isfinite(found)]
        assert values.size > 0.99 * found.size
        # 400 windows of 2 s; beside their scatter a quarter of a decibel at 28 dBHz, where the logarithm is bent
        bound = 4.0 * values.std() / math.sqrt(values.size)
        assert np.mean(values) == pytest.approx(cn0, abs=bound + (0.25 if cn0 < 30.0 else 0.05))


def test_narrow_wide_reaches_further_down_than_moments(rng: np.random.Generator) -> None:
    Z = prompts(22.0, 20_000, rng)
    by_moments, by_bands = moment_cn0_dbhz(Z, T, 2000), narrow_wide_cn0_dbhz(Z, T, 2000)
    assert np.nanstd(by_bands) < 0.5 * np.nanstd(by_moments)
    assert np.nanmean(by_bands) == pytest.approx(22.0, abs=0.3)


def test_ratio_of_each_block_averaged_would_be_biased(rng: np.random.Generator) -> None:
    # why powers are summed before they are divided: the mean of the ratios of blocks is 0.18 dB too low at 25 dBHz
    Z = prompts(25.0, 40_000, rng, channels=80)
    blocks = Z.reshape(-1, BLOCK, Z.shape[1])
    mu = np.mean(np.abs(blocks.sum(axis=1)) ** 2 / (np.abs(blocks) ** 2).sum(axis=1))
    by_ratios = 10.0 * math.log10((mu - 1.0) / (BLOCK - mu) / T)
    by_sums = float(np.mean(narrow_wide_cn0_dbhz(Z, T, 40_000)))
    # scatter of a whole run of 40 s: 0.065 dB, over 80 channels 0.007 dB
    assert by_sums == pytest.approx(25.0, abs=0.03) and by_ratios < 24.9


def test_noise_alone_gives_no_number_or_a_low_one(rng: np.random.Generator) -> None:
    white = rng.standard_normal((4000, 50)) + 1j * rng.standard_normal((4000, 50))
    for found in (moment_cn0_dbhz(white, T, 4000), narrow_wide_cn0_dbhz(white, T, 4000)):
        assert np.isnan(found).any() and np.nanmax(found) < 28.0


@pytest.mark.parametrize(
    "make",
    [
        lambda Z: narrow_wide_cn0_dbhz(Z, T, 50, 20),
        lambda Z: narrow_wide_cn0_dbhz(Z, T, 40, 1),
        lambda Z: moment_cn0_dbhz(Z, T, 1000),
        lambda Z: moment_cn0_dbhz(Z, -1.0, 50),
        lambda Z: phase_lock(Z, 200),
        lambda Z: phase_lock(Z, 1),
        lambda Z: frequency_lock(Z, 0),
    ],
)
def test_windows_that_do_not_fit_are_refused(make: object) -> None:
    with pytest.raises(ConfigError) as caught:
        make(np.ones((100, 2), complex))  # type: ignore[operator]
    assert caught.value.advice


@pytest.mark.parametrize("cn0", [25.0, 35.0, 45.0])
@pytest.mark.parametrize("phase", [0.0, 0.4, 1.3])
def test_phase_lock_has_the_bias_it_says_and_none_without_the_noise(
    cn0: float, phase: float, rng: np.random.Generator
) -> None:
    Z = prompts(cn0, 20_000, rng, phase)
    a = signal_ratio(cn0, T)
    raw, corrected = phase_lock(Z, BLOCK, 1000, unbiased=False), phase_lock(Z, BLOCK, 1000)
    # 40 values: 4 sigma of their mean; a tenth of a percent of bias of a ratio of sums over 1000 blocks
    for found, expected in (
        (raw, float(expected_phase_lock(phase, a, BLOCK))),
        (corrected, math.cos(2.0 * phase)),
    ):
        assert np.mean(found) == pytest.approx(expected, abs=4.0 * found.std() / math.sqrt(40.0) + 1e-3)
    if cn0 < 30.0:
        assert abs(float(expected_phase_lock(0.0, a, BLOCK)) - 1.0) > 0.1  # and it matters there


@pytest.mark.parametrize("cn0", [30.0, 45.0])
@pytest.mark.parametrize("hertz", [0.0, 60.0, 125.0])
def test_frequency_lock_has_the_bias_it_says(cn0: float, hertz: float, rng: np.random.Generator) -> None:
    w, a, n = 2.0 * math.pi * hertz, signal_ratio(cn0, T), 10_000
    turning = a * np.sinc(w * T / (2.0 * math.pi)) * np.exp(1j * w * T * np.arange(n))[:, None]
    Z = prompts(cn0, n, rng, data=False) - a + turning * data_signs(n, 40, T, 0.02, rng)
    found = frequency_lock(Z, 9999)
    # data change in 1 of 40 pairs, which the square does not see
    expected = float(expected_frequency_lock(w, a, T))
    assert np.mean(found) == pytest.approx(expected, abs=4.0 * found.std() / math.sqrt(40.0) + 1e-3)


def test_lock_has_hysteresis_and_patience() -> None:
    indicator = np.array([0.2, 0.9, 0.9, 0.6, 0.6, 0.3, 0.9, 0.3, 0.3, np.nan, 0.9])
    assert locked(indicator, 0.8, 0.5).tolist() == [bool(v) for v in (0, 1, 1, 1, 1, 0, 1, 0, 0, 0, 1)]
    assert locked(indicator, 0.8, 0.5, patience=2).tolist() == [
        bool(v) for v in (0, 0, 1, 1, 1, 1, 1, 1, 0, 0, 0)
    ]
    with pytest.raises(ConfigError, match="limits in order"):
        locked(indicator, 0.5, 0.8)


def test_slip_is_seen_past_three_quarters_of_the_aperture() -> None:
    error = np.zeros((100, 3))
    error[:, 1] = 0.74 * math.pi
    error[40:, 2] = math.pi
    assert slip_time_s(error, 0.01, math.pi).tolist() == [math.inf, math.inf, pytest.approx(0.405)]
