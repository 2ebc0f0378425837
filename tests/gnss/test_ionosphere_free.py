"""The ionosphere-free combination: what cancels, what the noise becomes, and what the ledger says of each row."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.gnss.ionosphere_free import combine_pseudoranges
from insgnss.gnss.observation_rows import OBSERVATION_DTYPE
from insgnss.gnss.signals import L1_HZ, L2_HZ, L5_HZ
from insgnss.status import BAD_VALUE, COMBINED, NO_SECOND_SIGNAL, SIGNAL_NOT_USED, USED
from insgnss.tables import Float64

RANGE_M = 2.2e7


def epochs(*bands: tuple[int, float, int]) -> tuple[np.ndarray, Float64, Float64]:
    """Return observation rows, satellite states and carriers of (satellite, carrier, clock group), without delays."""
    n = len(bands)
    row = np.zeros(n, OBSERVATION_DTYPE)
    row["sv"], row["group"] = [b[0] for b in bands], [b[2] for b in bands]
    carrier = np.array([b[1] for b in bands])
    row["ionosphere_factor"], row["variance_scale"] = (L1_HZ / carrier) ** 2, 1.0
    row["value"][:, 0] = RANGE_M + 1000.0 * row["sv"]
    return row, np.tile([0.0] * 6 + [100.0, 0.0], (n, 1)), carrier


def test_delay_that_falls_with_the_square_of_the_frequency_goes_out() -> None:
    row, sat, carrier = epochs((1, L1_HZ, 0), (1, L5_HZ, 1), (2, L2_HZ, 1), (2, L1_HZ, 0))
    row["value"][:, 0] += 40.0 * row["ionosphere_factor"]
    combine_pseudoranges(row, sat, carrier, np.array([0, 4]))
    used = row["status"][:, 0] == USED
    assert used.tolist() == [True, False, False, True]
    # a double holds 2.2e7 m to 4e-9 m, and the shares are 2.3 and 2.5
    assert np.max(np.abs(row["value"][used, 0] - RANGE_M - 1000.0 * row["sv"][used])) < 2e-8
    assert row["ionosphere_factor"].tolist() == [
        0.0,
        row["ionosphere_factor"][1],
        row["ionosphere_factor"][2],
        0.0,
    ]


@pytest.mark.parametrize(("carrier_hz", "factor"), [(L2_HZ, 8.87), (L5_HZ, 6.69)])
def test_variance_grows_as_the_shares_say(carrier_hz: float, factor: float, rng: np.random.Generator) -> None:
    """The factors for equal noise on both, and the same from drawn noise."""
    n = 20_000
    row, sat, carrier = epochs(*[(1, f, k) for _ in range(n) for k, f in enumerate((L1_HZ, carrier_hz))])
    row["value"][:, 0] = rng.normal(size=2 * n)
    combine_pseudoranges(row, sat, carrier, np.arange(0, 2 * n + 1, 2))
    assert row["variance_scale"][0] == pytest.approx(factor, abs=0.01)
    assert np.var(row["value"][::2, 0]) == pytest.approx(factor, rel=4.0 * np.sqrt(2.0 / n))


def test_clock_is_combined_as_the_ranges_are_so_that_group_delays_stay_right() -> None:
    row, sat, carrier = epochs((1, L1_HZ, 0), (1, L2_HZ, 1))
    sat[:, 6] = 100.0 - np.array([1.0, (L1_HZ / L2_HZ) ** 2]) * 3.0
    combined = combine_pseudoranges(row, sat, carrier, np.array([0, 2]))
    # the clock of the message holds for this very combination: TGD cancels     [IS-GPS-200N, 20.3.3.3.3.2]
    assert combined[0, 6] == pytest.approx(100.0, abs=1e-9)
    assert np.array_equal(combined[1], sat[1])


def test_scale_of_a_constellation_is_kept() -> None:
    row, sat, carrier = epochs((1, L1_HZ, 0), (1, L2_HZ, 1))
    row["variance_scale"] = 4.0
    combine_pseudoranges(row, sat, carrier, np.array([0, 2]))
    assert row["variance_scale"][0] == pytest.approx(4.0 * 8.87, abs=0.05)


def test_every_row_has_its_status_and_the_totals_add_up() -> None:
    """Satellite 1: three bands; 2: one; 3: two, of which one cannot be used; 4: two rows of one band."""
    row, sat, carrier = epochs(
        (1, L2_HZ, 2), (1, L1_HZ, 0), (1, L5_HZ, 1), (2, L1_HZ, 0), (3, L1_HZ, 0),
        (3, L5_HZ, 1), (4, L1_HZ, 0), (4, L1_HZ, 0),
    )  # fmt: skip
    row["status"][5, 0], row["status"][7, 0] = BAD_VALUE, SIGNAL_NOT_USED
    combine_pseudoranges(row, sat, carrier, np.array([0, 8]))
    expected = [
        *(COMBINED, USED, COMBINED, NO_SECOND_SIGNAL),
        *(NO_SECOND_SIGNAL, BAD_VALUE, NO_SECOND_SIGNAL, SIGNAL_NOT_USED),
    ]
    assert row["status"][:, 0].tolist() == expected
    assert not row["status"][:, 1].any()  # range rates know no ionosphere
    # L5 is farther from L1 than L2 is
    assert row["variance_scale"][1] == pytest.approx(6.69, abs=0.01)


def test_reference_band_holds_the_combination_whatever_the_order_in_the_log() -> None:
    for order in ((0, 1), (1, 0)):
        bands = [(1, L1_HZ, 0), (1, L5_HZ, 1)]
        row, sat, carrier = epochs(*[bands[k] for k in order])
        combine_pseudoranges(row, sat, carrier, np.array([0, 2]))
        assert row["group"][row["status"][:, 0] == USED].tolist() == [0]


def test_same_satellite_in_two_epochs_is_combined_in_each() -> None:
    row, sat, carrier = epochs((1, L1_HZ, 0), (1, L5_HZ, 1), (1, L1_HZ, 0), (1, L5_HZ, 1))
    row["value"][:, 0] = [10.0, 10.0, 20.0, 20.0]
    combine_pseudoranges(row, sat, carrier, np.array([0, 2, 4]))
    assert row["value"][[0, 2], 0] == pytest.approx([10.0, 20.0])


@pytest.mark.parametrize("n", [0, 3])
def test_log_without_anything_to_combine_is_left_alone(n: int) -> None:
    row, sat, _ = epochs(*[(k, L1_HZ, 0) for k in range(n)])
    row["status"] = BAD_VALUE
    combined = combine_pseudoranges(row, sat, np.full(n, np.nan), np.array([0, n]))
    assert np.array_equal(combined, sat) and np.all(row["status"] == BAD_VALUE)
