"""The search window: cells, search time, the paper's example."""

from __future__ import annotations

import math

import numpy as np
import pytest

from insgnss.config.search import Detection, Grid, Search, UnsupervisedReceiver
from insgnss.constants import C_MPS
from insgnss.receiver.detection import detector
from insgnss.receiver.search_window import (
    search_time_s,
    search_window,
    signal_scale,
    unsupervised_sweep_s,
)

SETTINGS = Search()
NEED = detector(SETTINGS.detection)
CHIP_M = C_MPS / 1.023e6


def test_example_of_the_paper_takes_three_seconds_and_a_sixth() -> None:
    # 1000 delays, 100 correlators, 20 dBHz: printed 3.16 s
    assert float(search_time_s(1000, 0.316, 100)) == pytest.approx(3.16, abs=1e-12)
    assert unsupervised_sweep_s(SETTINGS, NEED) == pytest.approx(3.16, abs=0.005)


def test_a_cell_begun_is_a_pass_begun() -> None:
    assert search_time_s([1, 100, 101], 0.5, 100).tolist() == [0.5, 0.5, 1.0]
    assert float(search_time_s(10, math.inf, 100)) == math.inf


def test_window_covers_three_sigma_on_either_side() -> None:
    sigma_delay_m, sigma_rate_mps = 100.0, 1.5
    found = search_window(25.0, sigma_delay_m**2, sigma_rate_mps**2, SETTINGS, NEED)
    sigma_hz = sigma_rate_mps * 1575.42e6 / C_MPS
    assert float(found.sigma_delay_m) == pytest.approx(sigma_delay_m)
    assert float(found.sigma_doppler_hz) == pytest.approx(sigma_hz)
    # by hand: 600 m over steps of 146.5 m, and 47.3 Hz over steps of 2/3 / 0.1 s = 6.67 Hz
    assert float(found.delay_cells) == math.ceil(6.0 * sigma_delay_m / (0.5 * CHIP_M)) == 5
    assert float(found.doppler_bins) == math.ceil(6.0 * sigma_hz * 0.10002 / (2.0 / 3.0)) == 8
    assert float(found.search_s) == pytest.approx(0.10002, rel=1e-4)  # 40 cells at once


def test_exact_prediction_is_one_cell() -> None:
    found = search_window(45.0, 0.0, 0.0, SETTINGS, NEED)
    assert (float(found.delay_cells), float(found.doppler_bins)) == (1.0, 1.0) and bool(found.within_aperture)


def test_no_window_is_wider_than_the_code() -> None:
    found = search_window(45.0, 1e14, 0.0, SETTINGS, NEED)
    assert float(found.delay_cells) == 2046.0


def test_aperture_is_strict_in_delay_and_in_doppler() -> None:
    edge_m, edge_mps = 0.5 * CHIP_M / 3.0, 25.0 * C_MPS / 1575.42e6 / 3.0
    scale = np.array([0.999, 1.001])
    assert search_window(40.0, (scale * edge_m) ** 2, 0.0, SETTINGS, NEED).within_aperture.tolist() == [1, 0]
    assert search_window(40.0, 0.0, (scale * edge_mps) ** 2, SETTINGS, NEED).within_aperture.tolist() == [
        1,
        0,
    ]


def test_worst_grade_of_the_paper_stays_within_the_aperture() -> None:
    # D of a hidden satellite at the peak, consumer MEMS with a TCXO: 5.453 m^2; sqrt(D) = 2.3 m against 146 m
    assert bool(search_window(35.0, 5.453, 0.05, SETTINGS, NEED).within_aperture)


def test_signal_of_another_code_has_its_own_chips() -> None:
    own = signal_scale(Grid())._replace(chip_m=np.array([CHIP_M, CHIP_M / 10.0]))
    found = search_window(np.full(2, 40.0), np.full(2, 900.0), np.zeros(2), SETTINGS, NEED, own)
    assert found.delay_cells.tolist() == [2.0, 13.0] and found.within_aperture.tolist() == [True, False]


def test_missing_prediction_and_hopeless_signal_are_said_so() -> None:
    need = detector(Detection(coherent_limit_s=0.02, max_looks=10))
    found = search_window([40.0, 0.0], [np.nan, 1.0], [np.nan, 1.0], SETTINGS, need)
    assert math.isnan(found.delay_cells[0]) and not found.within_aperture[0]
    assert found.search_s[1] == math.inf and math.isnan(found.doppler_bins[1])


def test_unsupervised_receiver_that_does_not_know_its_doppler_pays_for_each_bin() -> None:
    settings = Search(unsupervised=UnsupervisedReceiver(doppler_half_width_hz=50.0))
    bins = math.ceil(100.0 / (2.0 / 3.0 / 0.3163))
    assert unsupervised_sweep_s(settings, NEED) == pytest.approx(bins * 3.163, rel=1e-3)
