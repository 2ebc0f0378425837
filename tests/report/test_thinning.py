"""Thinned lines keep every peak, break at gaps, and never grow beyond their limit."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.report.thinning import breaks, columns_of_time, envelope, line


def test_envelope_keeps_a_peak_of_one_row() -> None:
    values = np.random.default_rng(3).standard_normal(100_000)
    values[70_001], values[30_003] = 50.0, -40.0

    kept = envelope(values, 500)

    assert len(kept) <= 500
    assert {0, 30_003, 70_001, 99_999} <= set(kept.tolist())
    assert (np.diff(kept) > 0).all()


@pytest.mark.parametrize("at_most", [10, 333, 2000])
def test_envelope_of_every_piece_is_that_of_all_its_rows(at_most: int) -> None:
    values = np.cumsum(np.random.default_rng(4).standard_normal(12_345))

    kept = envelope(values, at_most)

    assert len(kept) <= at_most
    thinned = np.full(len(values), np.nan)
    thinned[kept] = values[kept]
    pieces = (at_most - 2) // 2
    for piece in np.split(np.arange(len(values)), np.arange(1, pieces) * len(values) // pieces):
        assert np.nanmin(thinned[piece]) == values[piece].min()
        assert np.nanmax(thinned[piece]) == values[piece].max()


def test_envelope_does_not_choose_what_is_no_number() -> None:
    values = np.arange(1000.0)
    values[500:600] = np.nan

    kept = envelope(values, 50)

    assert np.isfinite(values[kept]).mean() > 0.9


def test_envelope_of_few_rows_is_all_of_them() -> None:
    assert envelope([3.0, 1.0, 2.0], 10).tolist() == [0, 1, 2]


def test_line_is_broken_at_a_gap_and_keeps_both_shores() -> None:
    time_s = np.concatenate([np.arange(0.0, 1000.0), np.arange(1200.0, 2200.0)])

    x, y = line(time_s, np.sin(time_s), 100)

    at = int(np.flatnonzero(np.isnan(y))[0])
    assert np.isnan(y).sum() == 1
    assert (x[at - 1], x[at + 1]) == (999.0, 1200.0)


def test_line_of_an_angle_is_broken_where_it_jumps() -> None:
    angle = (np.arange(0.0, 720.0, 10.0) + 180.0) % 360.0 - 180.0

    assert len(breaks(np.arange(72.0), angle, 360.0)) == 2
    assert len(breaks(np.arange(72.0), angle)) == 0


def test_line_with_a_gap_at_every_other_row_stays_bounded() -> None:
    time_s = np.cumsum(np.where(np.arange(100_000) % 7 == 0, 100.0, 1.0))

    x, _ = line(time_s, np.ones(100_000), 1000)

    assert len(x) < 2000


def test_columns_of_time_are_as_wide_as_the_usual_interval_or_wider() -> None:
    few, first, width = columns_of_time(np.arange(10.0, 20.0), 1500)
    many, _, wide = columns_of_time(np.arange(0.0, 10_000.0), 100)

    assert (first, width) == (10.0, 1.0)
    assert few.tolist() == list(range(10))
    assert wide == pytest.approx(99.99)
    assert many.max() <= 100
