"""Samples made from a scenario: the signals stand where the true pseudoranges, carriers and data say."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import stats

from insgnss.constants import C_MPS
from insgnss.errors import ConfigError
from insgnss.runs.simulate import simulate
from insgnss.simulation.observations import WAVELENGTH_M
from insgnss.simulation.signal_samples import SignalSky, sample_blocks, signal_sky
from insgnss.simulation.simulated_log import Scenario
from insgnss.tracking.signal import CarrierAndCode, Sampling, SignalSamples, correlate

SAMPLING = Sampling(2.5e6, 15e3, is_complex=True)
CHIPS_PER_M = 1.023e6 / C_MPS


@cache
def scenario() -> Scenario:
    return simulate("steep_turns", duration_s=4.0).scenario


@cache
def sky() -> SignalSky:
    return signal_sky(scenario(), 1.2, np.random.default_rng(7))


def clean() -> SignalSamples:
    blocks = list(sample_blocks(sky(), SAMPLING, 1, noise=False))
    assert [len(b.in_phase) for b in blocks] == [2_500_000, 500_000]
    return SignalSamples(
        SAMPLING, *(np.concatenate([getattr(b, n) for b in blocks]) for n in ("in_phase", "quadrature"))
    )


def at(samples: SignalSamples, satellite: int, k: int, periods: int = 1) -> complex:
    """Return the prompt correlator over code periods from a satellite's k-th on, by the true values there."""
    s = sky()
    t = np.arange(len(s.pseudorange_m)) * 1e-3
    # the first sample of the period: where the code phase is a multiple of 1023
    phase = 1.023e6 * t - CHIPS_PER_M * s.pseudorange_m[:, satellite]
    begin = math.ceil(np.interp((math.ceil(phase[0] / 1023.0) + k) * 1023.0, phase, t) * SAMPLING.rate_hz)
    now = begin / SAMPLING.rate_hz
    delay = CHIPS_PER_M * np.interp(now, t, s.pseudorange_m[:, satellite]) - 1.023e6 * now
    cycles = -np.interp(now, t, s.carrier_m[:, satellite]) / WAVELENGTH_M + SAMPLING.intermediate_hz * now
    rate = np.interp(now + 0.0005 * periods, t[:-1] + 0.0005, np.diff(s.carrier_m[:, satellite]) / 1e-3)
    replica = CarrierAndCode(delay % 1023.0, -rate / WAVELENGTH_M, 2.0 * math.pi * (cycles % 1.0), 1575.42e6)
    span = slice(begin, begin + round(periods * 2500))
    cut = SignalSamples(SAMPLING, samples.in_phase[span], samples.quadrature[span])
    return complex(correlate(cut, s.codes[satellite], replica, float(s.cn0_dbhz[0, satellite]), 0.5)[1])


def test_each_signal_has_the_true_delay_phase_and_strength_at_any_time() -> None:
    samples, s = clean(), sky()
    a = 2.0 * 10.0 ** (0.1 * s.cn0_dbhz[0, 0]) * 1e-3
    for satellite in range(len(s.sv_names)):
        for k in (3, 511, 1003, 1100):
            Z = at(samples, satellite, k)
            # 65 of 1023 chips are what another code's correlation may reach, of each of seven others
            assert abs(Z.imag) / a < 0.16
            assert abs(abs(Z.real) / a - 1.0) < 0.16


def test_data_bits_stand_where_the_satellites_clock_says() -> None:
    samples, s = clean(), sky()
    for satellite in (0, 5):
        signs = np.array([np.sign(at(samples, satellite, k).real) for k in range(100)])
        # number of the first whole code period
        first = math.ceil(-s.pseudorange_m[0, satellite] / C_MPS / 1e-3)
        changes = np.flatnonzero(np.diff(signs)) + 1
        assert len(changes) > 0
        assert np.all((first + changes) % 20 == 0)
        bit = (first + np.arange(100)) // 20 - s.first_bit[satellite]
        assert np.array_equal(signs, s.bits[bit, satellite])


def test_noise_has_variance_one_and_does_not_repeat() -> None:
    weak = replace(sky(), cn0_dbhz=np.full_like(sky().cn0_dbhz, np.nan))
    first, second = sample_blocks(weak, SAMPLING, 3)
    for part in (first.in_phase, first.quadrature):
        low, high = stats.chi2.ppf([5e-4, 1.0 - 5e-4], part.size) / part.size
        assert low < float(np.mean(part**2)) < high
    n = len(second.in_phase)
    for a, b in ((first.in_phase[:n], second.in_phase), (first.in_phase, first.quadrature)):
        assert abs(float(np.mean(a * b))) < 4.0 / math.sqrt(a.size)
    again = next(sample_blocks(weak, SAMPLING, 3))
    other = next(sample_blocks(weak, SAMPLING, 4))
    assert np.array_equal(first.in_phase, again.in_phase)
    assert not np.array_equal(first.in_phase, other.in_phase)


def test_real_samples_at_an_intermediate_frequency_hold_the_same_signal() -> None:
    sampling = Sampling(6.5e6, 1.5e6)
    block = next(sample_blocks(sky(), sampling, 1, noise=False))
    assert block.quadrature.size == 0
    s, k = sky(), 200
    delay = CHIPS_PER_M * s.pseudorange_m[k, 2] - 1.023e6 * k * 1e-3
    rate = (s.carrier_m[k + 1, 2] - s.carrier_m[k, 2]) / 1e-3
    cycles = -s.carrier_m[k, 2] / WAVELENGTH_M + 1.5e6 * k * 1e-3
    replica = CarrierAndCode(delay % 1023.0, -rate / WAVELENGTH_M, 2.0 * math.pi * (cycles % 1.0), 1575.42e6)
    cut = SignalSamples(sampling, block.in_phase[k * 6500 : (k + 1) * 6500], block.quadrature)
    a = 2.0 * 10.0 ** (0.1 * s.cn0_dbhz[0, 2]) * 1e-3
    Z = complex(correlate(cut, s.codes[2], replica, float(s.cn0_dbhz[0, 2]))[1])
    # a data bit may change inside of this millisecond
    assert abs(Z.imag) / a < 0.16
    assert 0.0 < abs(Z.real) / a < 1.16


def test_loss_lowers_every_signal_and_hidden_ones_are_absent() -> None:
    rng = np.random.default_rng(7)
    lower = signal_sky(scenario(), 1.2, rng, cn0_change_db=-10.0)
    assert lower.cn0_dbhz == pytest.approx(sky().cn0_dbhz - 10.0)
    assert np.array_equal(lower.pseudorange_m, sky().pseudorange_m)
    hidden = sky().cn0_dbhz.copy()
    hidden[:, 1:] = np.nan
    alone = next(sample_blocks(replace(sky(), cn0_dbhz=hidden), SAMPLING, 1, noise=False))
    amplitude = SAMPLING.amplitude(float(sky().cn0_dbhz[0, 0]))
    # not pytest.approx, which compares 2.5 million samples one by one
    np.testing.assert_allclose(np.hypot(alone.in_phase, alone.quadrature), amplitude, rtol=1e-6)


def test_recordings_that_cannot_be_made_are_refused() -> None:
    rng = np.random.default_rng(7)
    for seconds in (0.0, 5.0, math.nan):
        with pytest.raises(ConfigError, match="a recording of"):
            signal_sky(scenario(), seconds, rng)
    with pytest.raises(ConfigError, match="inside a data bit"):
        signal_sky(replace(scenario(), start_ns=scenario().start_ns + 1), 1.0, rng)
    with pytest.raises(ConfigError, match="Nyquist"):
        next(sample_blocks(sky(), Sampling(1.5e6, is_complex=True), 1))
    high = replace(scenario(), receiver=replace(scenario().receiver, horizon_mask_deg=89.0))
    with pytest.raises(ConfigError, match="no satellite"):
        signal_sky(high, 1.0, rng)
