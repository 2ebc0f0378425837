"""The margin against the reference table, its inverse, and an answer found without any of its formulas."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import linalg, optimize

from insgnss.errors import ConfigError, ModelError
from insgnss.interference.discriminators import ENGINEERING_RATIO, discriminator
from insgnss.interference.margin import (
    PhaseLoop,
    bandwidth_at_margin_hz,
    greatest_drift,
    margin_db,
    threshold_cn0_dbhz,
)
from insgnss.interference.spectra import modulation_of, signal_named

TYPE_1 = PhaseLoop(discriminator("Q", ENGINEERING_RATIO), 1.022e6, 0.01)
TYPE_2 = PhaseLoop(discriminator("IQ", ENGINEERING_RATIO), 1.022e6, 0.01)

# S, J/S and bandwidth of type 1, of type 2: computed independently of this package, C_A 0.076, 1.022 MHz, 10 ms
TABLE = np.array(
    [
        [0.1, 56.8745, 0.359, 44.8669, 0.570],
        [1.0, 53.5412, 0.773, 42.7008, 1.228],
        [2.0, 52.5378, 0.974, 42.0121, 1.547],
        [7.1144, 50.7007, 1.487, 40.7007, 2.361],
        [10.0, 50.2079, 1.666, 40.3371, 2.645],
        [100.0, 46.8745, 3.590, 37.7389, 5.698],
        [1000.0, 43.5412, 7.734, 34.9020, 12.276],
        [3167.0, 41.8724, 11.357, 33.4030, 18.028],
        [10000.0, 40.2079, 16.661, 31.8656, 26.448],
        [100000.0, 36.8745, 35.896, 28.6926, 56.981],
    ]
)
GREATEST_1 = {30: 1.1544e7, 35: 3.6506e5, 40: 1.1544e4, 45: 365.06, 50: 11.544, 55: 0.36506}
GREATEST_2 = {30: 3.9074e4, 35: 926.19, 40: 13.653, 42: 2.0241, 45: 0.086294, 50: 2.2042e-4}


def searched_js_db(S: float, loop: PhaseLoop) -> float:
    """Return J/S at the threshold by searching over it, with SciPy's Riccati solution at every step."""
    F, H = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[1.0, 0.0]])
    squared = loop.discriminator.type == 2

    def excess(js_db: float) -> float:
        n0 = 10.0 ** (js_db / 10.0) / loop.bandwidth_hz  # of unit carrier power
        sums = n0 / (2.0 * loop.accumulation_s)  # variance of I and of Q
        r = loop.accumulation_s * (sums * (1.0 + sums) if squared else sums)  # two-sided
        P = linalg.solve_continuous_are(F.T, H.T, np.diag([0.0, S / 2.0]), np.array([[r]]))
        return math.sqrt(P[0, 0]) - 0.076 * loop.discriminator.aperture_rad

    return float(optimize.brentq(excess, 20.0, 65.0, xtol=1e-9))


def test_margins_are_those_of_the_reference_table() -> None:
    # four printed decimals of dB, three of hertz
    assert margin_db(TABLE[:, 0], TYPE_1) == pytest.approx(TABLE[:, 1], abs=6e-5)
    assert bandwidth_at_margin_hz(TABLE[:, 0], TYPE_1) == pytest.approx(TABLE[:, 2], abs=6e-4)
    assert margin_db(TABLE[:, 0], TYPE_2) == pytest.approx(TABLE[:, 3], abs=6e-5)
    assert bandwidth_at_margin_hz(TABLE[:, 0], TYPE_2) == pytest.approx(TABLE[:, 4], abs=6e-4)


@pytest.mark.parametrize("S", [0.5, 3167.0])
@pytest.mark.parametrize("loop", [TYPE_1, TYPE_2], ids=["type 1", "type 2"])
def test_margin_is_what_a_search_with_riccati_finds(S: float, loop: PhaseLoop) -> None:
    assert float(margin_db(S, loop)) == pytest.approx(searched_js_db(S, loop), abs=1e-6)


def test_greatest_drifts_are_those_of_figures_5_and_6() -> None:
    for table, loop in ((GREATEST_1, TYPE_1), (GREATEST_2, TYPE_2)):
        found = greatest_drift(list(table), loop)
        assert found == pytest.approx(list(table.values()), rel=6e-5)  # five printed digits


@pytest.mark.parametrize("cn0_dbhz", [None, 35.0])
@pytest.mark.parametrize("loop", [TYPE_1, TYPE_2], ids=["type 1", "type 2"])
def test_greatest_drift_undoes_the_margin(loop: PhaseLoop, cn0_dbhz: float | None) -> None:
    S = np.logspace(-2.0, 4.0, 13)
    assert greatest_drift(margin_db(S, loop, cn0_dbhz), loop, cn0_dbhz) == pytest.approx(S, rel=1e-10)


def test_cube_root_stands_inside_the_square_root() -> None:
    # as printed, with the cube root outside, (25) is negative above 50.03 rad^2/s^3
    def printed(S: float) -> float:
        return math.sqrt(1.0 + 2.0 * (math.pi * 0.076) ** (8.0 / 3.0) / 0.01) * (4.0 / S) ** (1.0 / 3.0) - 1.0

    assert printed(50.0) > 0.0 > printed(50.1)
    assert float(margin_db(50.1, TYPE_2)) == pytest.approx(searched_js_db(50.1, TYPE_2), abs=1e-6)


def test_type_1_gains_ten_db_only_below_seven_and_eight_in_the_limit() -> None:
    def gain(S: float) -> float:
        return float(margin_db(S, TYPE_1) - margin_db(S, TYPE_2))

    assert gain(7.1144) == pytest.approx(10.0, abs=1e-4)
    assert gain(3167.0) == pytest.approx(8.469, abs=1e-3)
    assert gain(1e12) == pytest.approx(
        10.0 * math.log10(2.0 ** (8.0 / 3.0)), abs=0.01
    )  # 8.03 dB, S -> infinity


def test_thermal_noise_takes_what_the_table_says() -> None:
    # 35 dBHz, S = 3169, type 2: 33.40 dB falls to 32.71 dB
    assert float(margin_db(3169.0, TYPE_2)) == pytest.approx(33.40, abs=0.005)
    assert float(margin_db(3169.0, TYPE_2, 35.0)) == pytest.approx(32.71, abs=0.005)
    assert float(margin_db(3169.0, TYPE_2) - margin_db(3169.0, TYPE_2, 45.0)) < 0.25


def test_no_interference_is_allowed_where_noise_alone_breaks_lock() -> None:
    least = float(threshold_cn0_dbhz(3169.0, TYPE_2))
    assert float(margin_db(3169.0, TYPE_2, least - 0.01)) == -math.inf
    assert float(margin_db(3169.0, TYPE_2, least + 0.01)) > 0.0


def test_threshold_cn0_is_the_band_over_the_margin() -> None:
    assert float(threshold_cn0_dbhz(100.0, TYPE_2)) == pytest.approx(
        10.0 * math.log10(1.022e6) - 37.7389, abs=1e-4
    )


def test_white_frequency_noise_lowers_the_margin_and_none_leaves_it() -> None:
    assert float(margin_db(77.0, TYPE_2, phase_walk=1e-9)) == pytest.approx(
        float(margin_db(77.0, TYPE_2)), abs=1e-5
    )
    assert float(margin_db(77.0, TYPE_2, phase_walk=1.0)) < float(margin_db(77.0, TYPE_2)) - 1.0


@pytest.mark.parametrize(("band", "period"), [(0.0, 0.01), (1e6, -0.01), (math.nan, 0.01)])
def test_bands_and_times_that_make_no_sense_are_refused(band: float, period: float) -> None:
    with pytest.raises(ConfigError) as caught:
        PhaseLoop(discriminator("Q"), band, period)
    assert caught.value.key in ("bandwidth_hz", "accumulation_s") and caught.value.advice


def test_unknown_signal_names_the_nearest() -> None:
    with pytest.raises(ModelError) as caught:
        signal_named("GPS L1CA2")
    assert "GPS L1 C/A" in caught.value.advice
    with pytest.raises(ModelError, match="no signal C9Z"):
        signal_named("G:C9Z")


def test_paper_example_has_the_band_of_its_signal() -> None:
    modulation = modulation_of(signal_named("GLONASS G1 C/A"))
    assert modulation.null_to_null_hz == pytest.approx(1.022e6) and modulation.symbol_s == 0.010
