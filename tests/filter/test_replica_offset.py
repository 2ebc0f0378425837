"""What a channel says of its replica enters the filter with the rows of pseudoranges and range rates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from insgnss.filter.measurements import pseudorange as of_pseudorange
from insgnss.filter.measurements import range_rate as of_range_rate
from insgnss.filter.measurements.pseudorange import range_row
from insgnss.filter.measurements.range_rate import rate_row
from insgnss.filter.rows.lines import ANTENNA_DTYPE
from insgnss.filter.rows.replica_offset import COLUMNS, offset_range_row, offset_rate_row
from insgnss.filter.state import CLOCK, DR, OFFSETS, new_bank
from insgnss.filter.update.replica_offsets import (
    begin_phase,
    offset_covariance,
    phase_variance,
    use_offsets,
    use_phase_and_code,
    use_rate_beside,
)
from insgnss.tracking.combined_filter import CombinedModel
from insgnss.tracking.vector_loop import CODE_VARIANCE, RANGE_VARIANCE, channels_of, levels_of
from tests.tracking.test_combined_filter import difference_variance

U, G = np.array([0.36, -0.48, 0.8]), np.array([1e-4, -2e-4, 3e-5])
NOTHING = np.zeros(3)


def dense(columns: tuple[int, ...], h: Sequence[float] | np.ndarray) -> np.ndarray:
    """Return a row over all states."""
    row = np.zeros(OFFSETS)
    np.add.at(row, np.array(columns), np.asarray(h)[: len(columns)])
    return row


def test_rows_are_those_of_a_log_without_a_lever_arm() -> None:
    h, mine = np.zeros(15), np.zeros(len(COLUMNS))
    range_row(U, NOTHING, h)
    offset_range_row(U, mine)
    assert np.array_equal(dense(COLUMNS, mine), dense(of_pseudorange.COLUMNS, h))

    h, mine = np.zeros(15), np.zeros(len(COLUMNS))
    antenna, m = np.zeros(1, ANTENNA_DTYPE)[0], new_bank(1, 0).state[0]
    antenna.u[:], antenna.dr[:], m.C_eb[:] = U, G, np.eye(3)
    rate_row(m, antenna, h)
    offset_rate_row(U, G, 0.0, mine)
    assert np.array_equal(dense(COLUMNS, mine), dense(of_range_rate.COLUMNS, h))


def test_two_observations_that_share_their_errors_count_as_the_pair_they_are() -> None:
    rng = np.random.default_rng(8)
    root = rng.standard_normal((OFFSETS, OFFSETS))
    P = root @ root.T
    C, z = np.array([[4.0, 1.1], [1.1, 0.5]]), np.array([3.0, -0.7])
    range_h, rate_h = np.zeros(len(COLUMNS)), np.zeros(len(COLUMNS))
    offset_range_row(U, range_h)
    offset_rate_row(U, G, 0.0, rate_h)
    H = np.array([dense(COLUMNS, range_h), dense(COLUMNS, rate_h)])
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + C)
    found, v = P.copy(), np.zeros((4, OFFSETS))
    columns = np.array(COLUMNS, np.int64)
    use_offsets(found, columns, U, G, (3.0, -0.7), (4.0, 1.1, 0.5), np.zeros(len(COLUMNS)), v)

    assert v[0] == pytest.approx(K @ z, rel=1e-9)
    assert found == pytest.approx(P - K @ H @ P, rel=1e-9, abs=1e-9)


def test_phase_whose_cycle_is_unknown_begins_as_a_state_of_infinite_variance_does() -> None:
    rng = np.random.default_rng(9)
    root = rng.standard_normal((OFFSETS + 2, OFFSETS + 2))
    begun, own = root @ root.T, OFFSETS + 1
    unknown = begun.copy()
    unknown[own], unknown[:, own] = 0.0, 0.0
    unknown[own, own] = 1e9
    columns, h = np.array((*COLUMNS, own)), np.zeros(len(COLUMNS) + 1)
    v = np.zeros((2, 4, OFFSETS + 2))
    v[:, 0] = rng.standard_normal(OFFSETS + 2)  # what the channels before have told
    v[1, 0, own] = 0.0
    begin_phase(begun, columns, U, 3.0, 0.25, h, v[0])
    use_rate_beside(begun, columns, U, G, (3.0, -0.7), (0.25, 0.1, 0.5), h, v[0])
    use_offsets(unknown, columns, U, G, (3.0, -0.7), (0.25, 0.1, 0.5), h, v[1])

    # a prior of 1e9 leaves the share 1e-8 of what the row could have told; rounding of 1e9 is 1e-7
    assert begun == pytest.approx(unknown, rel=1e-6, abs=1e-5)
    assert v[0, 0] == pytest.approx(v[1, 0], abs=1e-5)


def test_range_and_rate_of_a_phase_with_a_state_of_its_own_are_the_pair_they_are() -> None:
    rng = np.random.default_rng(10)
    root = rng.standard_normal((OFFSETS + 2, OFFSETS + 2))
    P, own = root @ root.T, OFFSETS + 1
    h, v = np.zeros((2, len(COLUMNS) + 1)), np.zeros((4, OFFSETS + 2))
    columns = np.array((*COLUMNS, own))
    H = np.zeros((2, OFFSETS + 2))
    H[0, :OFFSETS], H[1, :OFFSETS] = dense(COLUMNS[:4], [*-U, 1.0]), dense(COLUMNS, [*G, 0.0, *-U, 1.0])
    H[0, own] = 1.0
    C, z = np.array([[4.0, 1.1], [1.1, 0.5]]), np.array([3.0, -0.7])
    D = offset_covariance(P, columns, U, G, h, v)
    expected = H @ P @ H.T
    assert D == pytest.approx([expected[0, 0], expected[0, 1], expected[1, 1]])
    assert phase_variance(P, columns, U, h[0]) == pytest.approx(expected[0, 0])

    found = P.copy()
    use_offsets(found, columns, U, G, (3.0, -0.7), (4.0, 1.1, 0.5), h[0], v)
    K = P @ H.T @ np.linalg.inv(expected + C)

    assert v[0] == pytest.approx(K @ z, rel=1e-9)
    assert found == pytest.approx(P - K @ H @ P, rel=1e-9, abs=1e-9)


def test_observation_without_a_variance_is_left_out() -> None:
    P, v = np.eye(OFFSETS), np.zeros((4, OFFSETS))
    use_offsets(P, np.array(COLUMNS, np.int64), U, G, (1.0, 1.0), (0.0, 0.0, 0.0), np.zeros(len(COLUMNS)), v)

    assert np.array_equal(P, np.eye(OFFSETS)) and not v[0].any()


def user_that_stands(directions: np.ndarray, epochs: int, cn0_dbhz: float, chip_hz: float) -> np.ndarray:
    """Return the variances of each phase's own state after some milliseconds; place and clock unknown at first."""
    m = len(directions)
    channels = channels_of("coherent", 1e-3, 1.6e9, chip_hz)
    row = channels.table[levels_of(cn0_dbhz)]
    P = np.diag(np.concatenate([np.full(OFFSETS, 1e-12), np.full(m, 1e10)]))
    for state in (DR, DR + 1, DR + 2, CLOCK):
        P[state, state] = 1e10
    columns, h, v = np.array((*COLUMNS[:4], 0)), np.zeros(8), np.zeros((4, len(P)))
    for _ in range(epochs):
        for c in range(m):
            variances = (row[RANGE_VARIANCE], row[CODE_VARIANCE])
            use_phase_and_code(P, columns, OFFSETS + c, directions[c], (0.0, 0.0), variances, h, v)
    return np.diag(P)[OFFSETS:]


# a wall, a floor and two others: no position explains an error of four ranges
FOUR = np.array([[0.6, 0.0, 0.8], [-0.6, 0.64, 0.48], [0.0, -0.8, 0.6], [-0.36, -0.48, 0.8]])
EIGHT = np.vstack([FOUR, [[0.8, 0.36, 0.48], [0.0, 0.28, 0.96], [-0.96, 0.0, 0.28], [0.48, -0.8, 0.36]]])


@pytest.mark.parametrize(("epochs", "sigma_m"), [(1000, 4.34), (5000, 1.94)])
def test_phase_less_code_of_four_satellites_is_as_well_known_as_by_each_channels_own_filter(
    epochs: int, sigma_m: float
) -> None:
    found = user_that_stands(FOUR, epochs, 37.0, 0.511e6)
    alone = difference_variance(CombinedModel(37.0, 1.6e9, 0.511e6, 1.0), 1e10, epochs)

    assert found == pytest.approx(alone, rel=1e-3)
    assert np.sqrt(found) == pytest.approx(sigma_m, rel=2e-3)


def test_phases_of_more_satellites_know_what_no_position_explains() -> None:
    found = user_that_stands(EIGHT, 300, 37.0, 0.511e6)
    H = np.hstack([-EIGHT, np.ones((8, 1))])
    share = np.diag(H @ np.linalg.inv(H.T @ H) @ H.T)
    alone = difference_variance(CombinedModel(37.0, 1.6e9, 0.511e6, 1.0), 1e10, 300)

    assert share.sum() == pytest.approx(4.0)
    assert found == pytest.approx(share * alone, rel=1e-3)
