"""What each answer to an uncertain attitude lets through, hides and costs, and by hand where that can be done."""

from __future__ import annotations

from functools import cache

import numpy as np
import pandas as pd
import pytest

from insgnss.config.library import scenario_config
from insgnss.studies.masking.decisions import BANKS_DEG, HEADINGS_DEG, decision_table, position_sigma

SATELLITES = 11
ERRORS = 9


@cache
def table(sigma_deg: float = 3.0) -> pd.DataFrame:
    return decision_table(scenario_config("sokolov_2015"), sigma_deg).set_index("uncertain")


def test_hidden_satellites_are_kept_by_keep_and_by_no_other_without_more_noise() -> None:
    of = table()

    assert (of["decisions"] == len(HEADINGS_DEG) * len(BANKS_DEG) * ERRORS * SATELLITES).all()
    # 60 of 264 attitudes with hidden satellites in use, with no error of the heading: 23 %
    share = of.loc["keep", "attitudes_with_hidden"] / (len(HEADINGS_DEG) * len(BANKS_DEG) * ERRORS)
    assert 0.15 < share < 0.35
    assert of.loc["keep", "hidden_although_visible"] == 0
    assert of.loc["hide", ["kept_although_hidden", "attitudes_with_hidden"]].tolist() == [0, 0]
    counts = ["undecided", "kept_although_hidden", "hidden_although_visible", "deepest_db"]
    pd.testing.assert_series_equal(of.loc["deweight", counts], of.loc["keep", counts], check_names=False)
    # every undecided one is one or the other, whatever is done with it
    undecided = of.loc["keep", "undecided"]
    assert of.loc["keep", "kept_although_hidden"] + of.loc["hide", "hidden_although_visible"] == undecided
    # the likelier hidden, the more noise
    assert of.loc["deweight", "kept_hidden_sigma_m"] > 2.0 * of.loc["deweight", "kept_visible_sigma_m"] > 20.0


@pytest.mark.parametrize("sigma_deg", [1.0, 3.0])
def test_false_lock_costs_more_than_the_geometry_of_a_satellite_and_more_noise_least(
    sigma_deg: float,
) -> None:
    of = table(sigma_deg)

    assert of.loc["keep", "error_kept_m"] > 3.0 * of.loc["hide", "error_lost_m"]
    assert (
        of.loc["deweight", "error_rms_m"]
        < of.loc["hide", "error_rms_m"]
        < 0.5 * of.loc["keep", "error_rms_m"]
    )


def test_attitude_that_is_certain_leaves_nothing_undecided() -> None:
    of = table(1e-6)
    assert (of[["undecided", "kept_although_hidden", "hidden_although_visible"]] == 0).to_numpy().all()
    assert (of["error_rms_m"] == 0.0).all()


def test_position_sigma_is_the_dilution_and_a_bias_weighs_as_the_weights_have_it() -> None:
    # four at the corners of a square at the horizon and one overhead: HDOP 1, by hand VDOP sqrt(5 / 4)
    u_n = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, -1]])
    used = np.ones((2, 5), np.bool_)
    used[1, 3:] = False
    ones = np.ones((2, 5))
    sigma = position_sigma(u_n, used, 4.0 * ones, 4.0 * ones)

    assert sigma[0] == pytest.approx(2.0 * np.sqrt(1.0 + 1.25))
    assert np.isnan(sigma[1])
    assumed, true = ones.copy(), ones.copy()
    true[0, 0] = 1600.0
    heavy = position_sigma(u_n, used, assumed, true)[0]
    assumed[0, 0] = 1600.0
    assert heavy == pytest.approx(np.sqrt(2.25 + 1599.0 * (0.25 + 1.0 / 16.0)))
    assert position_sigma(u_n, used, assumed, true)[0] < 0.1 * heavy
