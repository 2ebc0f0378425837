"""Clocks at a start and at a reset: what a fix tells of them, and QZSS's offset, that of GPS but for metres."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.filter.rows.clock_offsets import place_clocks, tie_offsets
from insgnss.filter.rows.lines import LINE_DTYPE
from insgnss.filter.state import CLOCK, OFFSETS, new_bank
from insgnss.filter.update.gating import absorb_clock_step, shown_clock, shown_clock_variance
from insgnss.status import GATED, USED

HOME = (-1, -1, 0, 1, -1)  # groups G, G:L5, J, J:L5, E


def test_tied_offsets_are_those_of_their_homes_and_share_their_doubt() -> None:
    bank = new_bank(1, 4)
    m, P = bank.state[0], bank.P[0]
    m.optional[:4] = 7.0, 5.0, 5.0, -30.0
    P[CLOCK, CLOCK] = 100.0
    P[np.arange(OFFSETS, OFFSETS + 4), np.arange(OFFSETS, OFFSETS + 4)] = 400.0, 50.0, 50.0, 60.0

    tie_offsets(m, P, HOME, 3.0)

    # J against the reference, J:L5 against G:L5; G:L5 and E stay
    assert m.optional[:4].tolist() == [7.0, 0.0, 7.0, -30.0]
    L5, J, J_L5, E = range(OFFSETS, OFFSETS + 4)
    assert [P[i, i] for i in (L5, J, J_L5, E)] == [400.0, 9.0, 409.0, 60.0]
    apart = P[L5, L5] + P[J_L5, J_L5] - 2.0 * P[L5, J_L5]
    assert apart == pytest.approx(9.0) and P[J, J_L5] == 0.0
    assert np.all(np.linalg.eigvalsh(P) >= 0.0) and np.array_equal(P, P.T)


@pytest.mark.parametrize("shown", [(0, 1, 3), (0,), (1, 3), (3,), ()])
def test_clocks_are_known_as_the_fix_shows_them_and_not_each_by_itself(shown: tuple[int, ...]) -> None:
    """The clock of a group that has satellites is c + o_i: known to metres. Of the others, and of c without the
    reference, the prior says 3 km."""
    clocks, g = np.full(4, np.nan), 4
    clocks[list(shown)] = 100.0 + 10.0 * np.array(shown)
    bank = new_bank(1, g - 1)
    m, P = bank.state[0], bank.P[0]
    P[:] = 1.0

    place_clocks(m, P, clocks, 4.0, np.full(g, 9.0), 3000.0)

    at = [CLOCK, *range(OFFSETS, OFFSETS + g - 1)]
    assert np.all(P[at][:, [i for i in range(len(P)) if i not in at]] == 0.0)
    assert np.array_equal(P, P.T) and np.all(np.linalg.eigvalsh(P[np.ix_(at, at)]) >= -1e-6)
    J = np.eye(g)
    J[1:, 0] = 1.0  # clock of each group: c + o_i
    found = J @ np.append(m.clock[0], m.optional[: g - 1])
    variances = (J @ P[np.ix_(at, at)] @ J.T).diagonal()
    known = [4.0 if i == min(shown) else 13.0 for i in shown]
    np.testing.assert_allclose(found[list(shown)], clocks[list(shown)])
    np.testing.assert_allclose(variances[list(shown)], known, rtol=1e-6)
    unknown = [i for i in range(g) if i not in shown and (i > 0 or shown)]
    assert np.all(variances[unknown] >= 3000.0**2)


def test_step_of_a_clock_without_its_reference_leaves_the_offset_as_unknown_as_it_was() -> None:
    bank = new_bank(1, 3)
    m, P = bank.state[0], bank.P[0]
    clocks = np.array([np.nan, 50.0, 60.0, np.nan])
    place_clocks(m, P, clocks, 4.0, np.full(4, 9.0), 3000.0)
    lines = np.zeros(4, LINE_DTYPE)
    lines["group"], lines["status"] = (0, 1, 1, 2), USED
    assert shown_clock(lines, 0) == 0 and shown_clock(lines, 1) == 0
    lines["status"][0, 0] = GATED
    assert shown_clock(lines, 0) == 1
    assert shown_clock_variance(P, 0, 1) == pytest.approx(4.0, rel=1e-6)

    absorb_clock_step(m.clock, P, lines, 0, 1, 300.0, 2.0)

    assert m.clock[0] == 350.0 and m.optional[:2].tolist() == [0.0, 10.0]
    assert shown_clock_variance(P, 0, 1) == pytest.approx(2.0, rel=1e-6)
    assert shown_clock_variance(P, 0, 2) == pytest.approx(11.0, rel=1e-6)
    assert P[CLOCK, CLOCK] > 3000.0**2
    assert np.array_equal(P, P.T)
