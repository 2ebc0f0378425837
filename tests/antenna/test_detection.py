"""Detection: the paper's table 1, Albersheim against Marcum, Marcum against integration and against drawn noise."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import integrate, special, stats

from insgnss.config.search import Detection
from insgnss.errors import ConfigError
from insgnss.receiver.detection import (
    accumulation,
    albersheim_snr_db,
    coherent_detection_probability,
    coherent_snr_db,
    detection_probability,
    detector,
    exact_snr_db,
    marcum_q,
)
from tests.statistics_bounds import share_below_bounds

TABLE_CN0_DBHZ = (35.0, 30.0, 25.0, 20.0)
TABLE_MS = (10.0, 31.6, 100.0, 316.0)  # Sokolov and Yurchenko 2015, table 1, printed to three digits


def test_ratio_of_the_paper_is_what_both_formulas_give() -> None:
    # seed's recalculation, to two decimals: 12.50 dB by Albersheim, 12.46 dB by Marcum's Q
    assert float(albersheim_snr_db(0.99, 1e-3)) == pytest.approx(12.50, abs=0.005)
    assert float(exact_snr_db(0.99, 1e-3)) == pytest.approx(12.46, abs=0.005)


def test_albersheim_gives_the_textbook_example() -> None:
    # Richards 2014, chapter 6: Pd 0.9, Pfa 1e-6: 13.14 dB for one look, -1.26 dB for each of a hundred
    found = albersheim_snr_db(0.9, 1e-6, [1, 100])
    assert found == pytest.approx([13.14, -1.26], abs=0.005)


def test_table_one_is_reproduced_to_its_printed_digits() -> None:
    found = accumulation(TABLE_CN0_DBHZ, detector(Detection()))
    # three printed digits: half a unit of the last one, 0.05 ms for 10.0 and 31.6, 0.5 ms for 100 and 316
    assert np.abs(found.time_s * 1e3 - TABLE_MS) == pytest.approx(0.0, abs=0.5)
    assert np.abs(found.time_s[:2] * 1e3 - TABLE_MS[:2]) == pytest.approx(0.0, abs=0.05)
    assert found.looks.tolist() == [1, 1, 1, 1]


def test_table_one_by_the_exact_method_is_one_percent_shorter() -> None:
    found = accumulation(TABLE_CN0_DBHZ, detector(Detection(method="exact")))
    assert found.time_s * 1e3 == pytest.approx([9.91, 31.3, 99.1, 313.0], rel=2e-3)


def test_twenty_milliseconds_are_reached_at_32_dbhz_not_at_35() -> None:
    found = accumulation([35.0, 32.0, 31.9], detector(Detection()))
    assert found.time_s[0] < 0.0101 and found.time_s[1] < 0.020 < found.time_s[2]


@pytest.mark.parametrize(("order", "a", "b"), [(1, 3.0, 2.0), (1, 5.0, 7.5), (4, 3.0, 5.0), (20, 6.0, 9.0)])
def test_marcum_q_is_the_integral_that_defines_it(order: int, a: float, b: float) -> None:
    def density(x: float) -> float:
        # x^m / a^(m-1) exp(-(x^2 + a^2) / 2) I_(m-1)(a x), with the scaled Bessel function
        return x * (x / a) ** (order - 1) * math.exp(-0.5 * (x - a) ** 2) * special.ive(order - 1, a * x)

    value, error = integrate.quad(density, b, max(a, b) + 40.0, epsabs=1e-13, epsrel=1e-12, limit=200)
    assert float(marcum_q(order, a, b)) == pytest.approx(value, abs=max(1e-11, 2.0 * error))


def test_marcum_q_agrees_with_the_noncentral_chi_square_where_integrals_are_hard() -> None:
    order, h, y = np.meshgrid([1.0, 8.0, 400.0], [0.5, 30.0, 4000.0], [0.5, 1.0, 1.1], indexing="ij")
    b2 = y * (2.0 * order + 2.0 * h)
    found = marcum_q(order, np.sqrt(2.0 * h), np.sqrt(b2))
    assert found == pytest.approx(stats.ncx2.sf(b2, 2.0 * order, 2.0 * h), abs=1e-9)


def test_marcum_q_without_signal_is_the_false_alarm() -> None:
    assert float(detection_probability(0.0, 1e-3, 7)) == pytest.approx(1e-3, rel=1e-10)


@pytest.mark.parametrize("looks", [1, 4])
def test_drawn_signals_are_detected_as_often_as_marcum_says(looks: int) -> None:
    rng = np.random.default_rng(11)
    n, pfa, snr = 200_000, 1e-2, 10.0 ** (3.0 / 10.0)
    threshold = stats.chi2.isf(pfa, 2 * looks) / 2.0  # of the sum of |z|^2, complex noise of variance one
    noise = rng.normal(scale=math.sqrt(0.5), size=(2, n, looks, 2)).view(np.complex128)[..., 0]
    phase = np.exp(2j * np.pi * rng.random((n, looks)))
    power_noise = np.sum(np.abs(noise[0]) ** 2, axis=1)
    power_signal = np.sum(np.abs(noise[1] + math.sqrt(snr) * phase) ** 2, axis=1)
    pd = float(detection_probability(snr, pfa, looks))
    low, high = share_below_bounds(pd, n)
    assert 0.2 < pd < 0.95 and low <= np.mean(power_signal > threshold) <= high
    low, high = share_below_bounds(pfa, n)
    assert low <= np.mean(power_noise > threshold) <= high


def test_drawn_signals_of_known_phase_are_detected_as_often_as_stated() -> None:
    rng = np.random.default_rng(12)
    n, pfa, snr = 200_000, 1e-2, 2.0
    in_phase = math.sqrt(snr) + rng.normal(scale=math.sqrt(0.5), size=n)
    threshold = stats.norm.isf(pfa) * math.sqrt(0.5)
    pd = float(coherent_detection_probability(snr, pfa))
    low, high = share_below_bounds(pd, n)
    assert 0.2 < pd < 0.95 and low <= np.mean(in_phase > threshold) <= high


@pytest.mark.parametrize("pd", [0.05, 0.5, 0.99, 0.99999])
@pytest.mark.parametrize("pfa", [1e-3, 1e-9])
def test_exact_ratio_gives_back_its_probability(pd: float, pfa: float) -> None:
    looks = np.array([1.0, 3.0, 100.0])
    snr = 10.0 ** (exact_snr_db(pd, pfa, looks) / 10.0)
    assert detection_probability(snr, pfa, looks) == pytest.approx(pd, abs=1e-11)
    known = 10.0 ** (coherent_snr_db(pd, pfa) / 10.0)
    assert float(coherent_detection_probability(known, pfa)) == pytest.approx(pd, abs=1e-12)


def test_albersheim_is_as_near_to_exact_as_published_where_that_holds() -> None:
    # Published: 0.2 dB for Pfa 1e-7 ... 1e-3. One look: it holds from Pd 0.4 on, not at 0.1 as is often written.
    for pfa in (1e-7, 1e-5, 1e-3):
        for pd in (0.4, 0.5, 0.7, 0.9, 0.99):
            looks = np.array([1.0, 2.0, 8.0, 64.0, 512.0])
            off = albersheim_snr_db(pd, pfa, looks) - exact_snr_db(pd, pfa, looks)
            assert abs(off[0]) < 0.1
            # the formula is for a linear detector, the exact one for squares: 0.2 dB more between the two
            assert np.max(np.abs(off)) < 0.4
    assert float(albersheim_snr_db(0.1, 1e-3) - exact_snr_db(0.1, 1e-3)) < -4.0


def test_known_phase_needs_less_than_one_look_and_many_looks_more_in_all() -> None:
    looks = np.array([1.0, 10.0, 100.0])
    in_all_db = exact_snr_db(0.99, 1e-3, looks) + 10.0 * np.log10(looks)
    assert coherent_snr_db(0.99, 1e-3) < in_all_db[0] < in_all_db[1] < in_all_db[2]
    # summing squares gains between K^(1/2) and K
    assert 5.0 * math.log10(100.0) < in_all_db[0] + 20.0 - in_all_db[2] < 10.0 * math.log10(100.0)


@pytest.mark.parametrize("method", ["albersheim", "exact"])
def test_limited_accumulation_takes_the_fewest_looks_that_suffice(method: str) -> None:
    settings = Detection(method=method, coherent_limit_s=0.02, max_looks=60)  # type: ignore[arg-type]
    need = detector(settings)
    cn0_dbhz = np.array([45.0, 35.0, 31.0, 27.0, 25.0, 21.0])
    found = accumulation(cn0_dbhz, need)
    assert np.all(found.look_s <= 0.02) and np.all(np.diff(found.looks) >= 0) and found.looks[-1] > 10
    assert found.time_s == pytest.approx(found.looks * found.look_s)
    for k, looks in enumerate(found.looks):
        snr = 10.0 ** ((cn0_dbhz[k] - settings.loss_db) / 10.0) * found.look_s[k]
        tolerance = 1e-10 if method == "exact" else 0.02  # Albersheim's error, up to 0.4 dB
        assert float(detection_probability(snr, 1e-3, looks)) == pytest.approx(0.99, abs=tolerance)
        if looks > 1:  # one look less, of the full length, is not enough
            budget = 10.0 ** (cn0_dbhz[k] / 10.0) * 0.02
            assert need.required_snr[looks - 2] > budget


def test_signal_too_weak_or_absent_takes_for_ever() -> None:
    limited = detector(Detection(coherent_limit_s=0.02, max_looks=10))
    assert accumulation([15.0, -math.inf, math.nan], limited).time_s.tolist() == [math.inf] * 3
    assert accumulation([-math.inf, math.nan], detector(Detection())).time_s.tolist() == [math.inf] * 2
    assert accumulation(30.0, limited).time_s.shape == ()


@pytest.mark.parametrize(("pd", "pfa", "key"), [(0.5, 0.6, "pfa"), (1.0, 1e-3, "pd"), (0.9, 0.0, "pfa")])
def test_impossible_probabilities_are_refused_by_name(pd: float, pfa: float, key: str) -> None:
    for formula in (albersheim_snr_db, exact_snr_db, coherent_snr_db):
        with pytest.raises(ConfigError) as error:
            formula(pd, pfa)
        assert error.value.key == key


def test_albersheim_outside_its_domain_points_to_the_exact_method() -> None:
    with pytest.raises(ConfigError, match="exact"):
        albersheim_snr_db(0.05, 1e-3)
