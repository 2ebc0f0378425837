"""Axes and numbers of the charts: ticks that can be read, digits that count."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.report.charts import log_ticks, packed, unpacked
from insgnss.report.labels import distance, row_of_numbers


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ([0.2, 3.0], ["0.1", "0.2", "0.5", "1", "2", "5", "10", "20", "50"]),
        ([1e-4, 50.0], ["0.0001", "0.001", "0.01", "0.1", "1", "10", "100"]),
        ([1e-8, 0.1], ["1e-8", "1e-6", "0.0001", "0.01"]),
    ],
)
def test_logarithmic_axis_has_a_few_ticks_in_full(values: list[float], words: list[str]) -> None:
    told = log_ticks(np.array([*values, np.nan, 0.0]))["ticktext"]

    assert told == words


def test_narrow_or_empty_logarithmic_axis_keeps_the_usual_ticks() -> None:
    assert log_ticks(np.array([1.0, 1.1])) == {}
    assert log_ticks(np.array([np.nan])) == {}


def test_packed_numbers_come_back() -> None:
    assert unpacked(packed([1.0, 2.5])).tolist() == [1.0, 2.5]
    assert unpacked(packed([1e-12], double=True)).tolist() == [1e-12]


def test_numbers_of_a_row_share_their_decimals() -> None:
    assert row_of_numbers([0.000558, 0.0192, -0.5, np.nan], 0.0192) == ["0.0006", "0.0192", "-0.5000", "-"]
    assert row_of_numbers([5.82, 39.1], 0.0) == ["5.820", "39.100"]


def test_way_is_told_in_metres_or_kilometres() -> None:
    assert (distance(129.4), distance(90_912.0)) == ("129 m", "90.9 km")
