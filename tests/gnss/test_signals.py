"""The table of signals: every RINEX code is answered or has a reason; carriers and group delays."""

from __future__ import annotations

import math

import pytest
import sidereon

from insgnss.constants import C_MPS
from insgnss.gnss.signals import (
    CHANNELS,
    INTER_SIGNAL,
    L1_HZ,
    SIGNALS,
    UNSUPPORTED,
    Signal,
    carrier_hz,
    inter_signal_index,
    ionosphere_factor,
    reason_unsupported,
    signal_of,
    wavelength_m,
)

# RINEX 3.05, tables 4 to 10: band digit and attributes of the pseudorange codes (codeless and semi-codeless included)
RINEX_CODES = {
    "G": {"1": "CSLXPWYM", "2": "CDSLXPWYM", "5": "IQX"},
    "R": {"1": "CP", "4": "ABX", "2": "CP", "6": "ABX", "3": "IQX"},
    "E": {"1": "ABCXZ", "5": "IQX", "7": "IQX", "8": "IQX", "6": "ABCXZ"},
    "S": {"1": "C", "5": "IQX"},
    "J": {"1": "CESLXZ", "2": "SLX", "5": "IQXDPZ", "6": "SLXEZ"},
    "C": {"2": "IQX", "1": "DPXSLZ", "5": "DPX", "7": "IQXDPZ", "8": "DPX", "6": "IQXDPZ"},
    "I": {"1": "DPX", "5": "ABCX", "9": "ABCX"},
}
ALL_CODES = [
    (system, f"C{band}{attribute}")
    for system, bands in RINEX_CODES.items()
    for band, attributes in bands.items()
    for attribute in attributes
]
SYSTEMS = {
    "G": sidereon.GnssSystem.GPS,
    "E": sidereon.GnssSystem.GALILEO,
    "C": sidereon.GnssSystem.BEIDOU,
    "J": sidereon.GnssSystem.QZSS,
    "I": sidereon.GnssSystem.NAVIC,
    "S": sidereon.GnssSystem.SBAS,
}
CHANNEL = 5  # of the GLONASS satellite in these tests


@pytest.mark.parametrize(("system", "code"), ALL_CODES)
def test_every_rinex_code_is_answered_or_has_a_reason(system: str, code: str) -> None:
    signal = signal_of(system, code)
    if signal is None:
        assert any(e.system == system and code in e.codes for e in UNSUPPORTED)
        assert reason_unsupported(system, code)
        assert math.isnan(wavelength_m(system, code))
    else:
        assert reason_unsupported(system, code) == ""


@pytest.mark.parametrize("signal", SIGNALS, ids=lambda s: f"{s.system} {s.name}")
def test_every_signal_answers_everything(signal: Signal) -> None:
    assert signal.system in RINEX_CODES
    assert signal.name and signal.band and signal.source and signal.codes
    assert len(signal.group_delay) == 2
    assert (signal.group_delay_fnav is not None) == (signal.system == "E")
    assert (signal.channel_step_hz > 0.0) == (signal.system == "R")
    for code in signal.codes:
        assert signal_of(signal.system, code) is signal
        carrier = signal.carrier_hz + CHANNEL * signal.channel_step_hz
        assert carrier_hz(signal.system, code, CHANNEL) == carrier
        assert wavelength_m(signal.system, code, CHANNEL) == C_MPS / carrier
        assert ionosphere_factor(signal.system, code, CHANNEL) == pytest.approx((L1_HZ / carrier) ** 2)


@pytest.mark.parametrize(
    "signal", [s for s in SIGNALS if s.system != "R"], ids=lambda s: f"{s.system} {s.name}"
)
def test_carrier_equals_an_independent_table(signal: Signal) -> None:
    band = signal.codes[0][1]
    assert sidereon.rinex_band_frequency_hz(SYSTEMS[signal.system], band) == pytest.approx(signal.carrier_hz)


@pytest.mark.parametrize("channel", range(-7, 7))
@pytest.mark.parametrize("code", ["C1C", "C1P", "C2C", "C2P"])
def test_glonass_carrier_of_each_channel_equals_an_independent_table(code: str, channel: int) -> None:
    theirs = sidereon.rinex_observation_wavelength_m(sidereon.GnssSystem.GLONASS, code, 3.05, channel)
    assert wavelength_m("R", code, channel) == pytest.approx(theirs, rel=1e-12)


def test_glonass_bands_stand_as_nine_to_seven_on_every_channel() -> None:
    """GLONASS ICD 5.1, 3.3.1.1: f2 / f1 = 7/9."""
    for channel in CHANNELS:
        ratio = carrier_hz("R", "C2C", channel) / carrier_hz("R", "C1C", channel)
        assert ratio == pytest.approx(7.0 / 9.0, abs=1e-12)


@pytest.mark.parametrize("channel", [None, -8, 14, -128, 99])
def test_glonass_has_no_carrier_without_a_channel(channel: int | None) -> None:
    assert math.isnan(carrier_hz("R", "C1C", channel))
    assert math.isnan(wavelength_m("R", "C1C", channel))
    assert math.isnan(ionosphere_factor("R", "C1C", channel))


def test_channel_is_of_no_account_to_other_systems() -> None:
    assert wavelength_m("G", "C1C", 4) == wavelength_m("G", "C1C")


def test_no_code_stands_twice() -> None:
    known = [(s.system, code) for s in SIGNALS for code in s.codes]
    refused = [(e.system, code) for e in UNSUPPORTED for code in e.codes]
    assert len(set(known + refused)) == len(known) + len(refused)


def test_unknown_code_has_a_reason_that_names_it() -> None:
    assert signal_of("G", "C9Z") is None
    assert "C9Z" in reason_unsupported("G", "C9Z")


@pytest.mark.parametrize("code", ["C3I", "C4A", "C6X"])
def test_glonass_cdma_is_refused_with_its_reason(code: str) -> None:
    assert "CDMA" in reason_unsupported("R", code)


def test_every_inter_signal_correction_belongs_to_a_signal_without_it() -> None:
    """Codes with a correction say that it may be missing; those that define TGD have none."""
    for code, place in INTER_SIGNAL.items():
        signal = signal_of("G", code)
        assert signal is not None and "inter-signal" in signal.neglects
        assert inter_signal_index("G", code) == inter_signal_index("J", code) == place
    assert {inter_signal_index("G", code) for code in ("C1W", "C2W", "C1P", "C2P")} == {-1}
    assert inter_signal_index("E", "C1C") == inter_signal_index("R", "C1C") == -1


def _ionosphere_free(system: str, first: str, second: str, fnav: bool = False) -> tuple[float, float]:
    """Return the factors of the group delay that is left in the ionosphere-free combination of two signals."""
    a, b = signal_of(system, first), signal_of(system, second)
    assert a is not None and b is not None
    gamma = (a.carrier_hz / b.carrier_hz) ** 2
    of_a = (a.group_delay_fnav if fnav else a.group_delay) or a.group_delay
    of_b = (b.group_delay_fnav if fnav else b.group_delay) or b.group_delay
    return tuple((gamma * x - y) / (gamma - 1.0) for x, y in zip(of_a, of_b, strict=True))  # type: ignore[return-value]


@pytest.mark.parametrize(
    ("system", "first", "second", "fnav"),
    [
        ("G", "C1W", "C2W", False),
        ("E", "C1C", "C7Q", False),
        ("E", "C1C", "C5Q", True),
        ("I", "C9A", "C5A", False),
    ],
)
def test_group_delay_vanishes_for_the_pair_that_the_clock_holds_for(
    system: str, first: str, second: str, fnav: bool
) -> None:
    assert _ionosphere_free(system, first, second, fnav) == pytest.approx((0.0, 0.0), abs=1e-12)


def test_the_two_galileo_clocks_differ_by_the_same_delay_on_every_signal() -> None:
    """I/NAV and F/NAV clocks differ by one number, so a signal's delay must differ by that number as well."""
    differences = [
        (s.group_delay[0] - s.group_delay_fnav[0], s.group_delay[1] - s.group_delay_fnav[1])
        for s in SIGNALS
        if s.group_delay_fnav is not None
    ]
    assert len(differences) == 5
    for difference in differences:
        assert difference == pytest.approx((-1.0, 1.0))


def test_beidou_clock_holds_for_b3i_alone() -> None:
    b3i, b1i, b2i = (signal_of("C", code) for code in ("C6I", "C2I", "C7I"))
    assert b3i is not None and b1i is not None and b2i is not None
    assert (b3i.group_delay, b1i.group_delay, b2i.group_delay) == ((0, 0), (1, 0), (0, 1))
