"""Spectra: unit power, published separations, every signal of the package, and what is outside the front end."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import integrate

from insgnss.errors import ConfigError, ModelError
from insgnss.gnss.signals import SIGNALS
from insgnss.interference.spectra import (
    MODULATIONS,
    Modulation,
    Part,
    broadband_separation,
    line_separation,
    modulation_of,
    power_within,
    signal_name,
    signal_named,
    spectrum,
)

BPSK_1 = Modulation((Part(1.0, 1.023e6),), 0.02)
BOC_1_1 = Modulation((Part(1.0, 1.023e6, 2),), 0.01)
BOC_6_1 = Modulation((Part(1.0, 1.023e6, 12),), 0.01)


def test_every_signal_of_the_package_has_a_spectrum_and_no_other() -> None:
    assert {(s.system, s.name) for s in SIGNALS} == set(MODULATIONS)
    for signal in SIGNALS:
        assert signal_named(signal_name(signal)) == signal
        assert signal_named(f"{signal.system}:{signal.codes[0]}").carrier_hz > 1e9
        assert sum(part.weight for part in modulation_of(signal).parts) == pytest.approx(1.0)


@pytest.mark.parametrize("modulation", [BPSK_1, BOC_1_1, BOC_6_1])
def test_power_over_all_frequencies_is_one(modulation: Modulation) -> None:
    f = np.linspace(-5e8, 5e8, 200_001)
    # beyond 0.5 GHz: 2 R / (2 pi^2 f) of a BPSK, 24 times as much of BOC(6,1): 2e-4, 5e-3
    assert integrate.trapezoid(spectrum(modulation, f), f) == pytest.approx(1.0, abs=6e-3)


def test_spectra_are_the_textbook_forms() -> None:
    f = np.array([0.11e6, 0.9e6, 3.3e6, 7.7e6])
    rate = 1.023e6
    bpsk = np.sinc(f / rate) ** 2 / rate
    # sine BOC with an even number of half periods [Betz 2001]
    for modulation, fs in ((BOC_1_1, rate), (BOC_6_1, 6.0 * rate)):
        boc = rate * (np.tan(math.pi * f / (2.0 * fs)) * np.sin(math.pi * f / rate) / (math.pi * f)) ** 2
        assert spectrum(modulation, f) == pytest.approx(boc, rel=1e-9)
    assert spectrum(BPSK_1, f) == pytest.approx(bpsk, rel=1e-12)


def test_line_on_the_carrier_is_worth_one_chip_rate() -> None:
    # kappa = 1 / R in a wide front end; 24 MHz loses 0.8 % of the power, twice in the coefficient
    assert 1.0 / line_separation(BPSK_1, 1e9, 0.0) == pytest.approx(1.023e6, rel=2e-3)
    assert 1.0 / line_separation(BPSK_1, 24e6, 0.0) == pytest.approx(
        1.023e6 * power_within(BPSK_1, 24e6) ** 2
    )
    assert line_separation(BPSK_1, 24e6, 1.023e6) == pytest.approx(0.0, abs=1e-20)


def test_flat_interference_is_worth_its_bandwidth_where_the_signal_lies_inside() -> None:
    # nothing is lost but the signal's power outside of the front end
    kappa = broadband_separation(BPSK_1, 20e6, 0.0, 40e6)
    assert 1.0 / kappa == pytest.approx(40e6 * power_within(BPSK_1, 20e6), rel=1e-9)


def test_boc_stands_a_line_on_the_carrier_and_not_beside() -> None:
    assert line_separation(BOC_1_1, 20e6, 0.0) == pytest.approx(0.0, abs=1e-20)
    assert line_separation(BOC_1_1, 20e6, 0.8e6) > line_separation(BPSK_1, 20e6, 0.8e6)


def test_interference_outside_the_front_end_adds_nothing() -> None:
    assert broadband_separation(BPSK_1, 4e6, 10e6, 2e6) == 0.0
    assert line_separation(BPSK_1, 4e6, 2.1e6) == 0.0
    assert broadband_separation(BPSK_1, 4e6, 2e6, 2e6) > 0.0


def test_unknown_signals_and_impossible_bands_are_refused() -> None:
    with pytest.raises(ModelError) as caught:
        signal_named("Galileo E1")
    assert "Galileo E1 OS" in caught.value.advice
    with pytest.raises(ModelError, match="RINEX 3"):
        signal_named("X:C1C")
    with pytest.raises(ConfigError, match="front_end_hz"):
        power_within(BPSK_1, 0.0)
    with pytest.raises(ConfigError, match="bandwidth_hz"):
        broadband_separation(BPSK_1, 20e6, 0.0, -1.0)
