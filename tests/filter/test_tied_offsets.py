"""The clock offset of QZSS at a start and at a reset: that of GPS on the same band, but for metres."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.filter.rows.tied_offsets import tie_offsets
from insgnss.filter.state import CLOCK, OFFSETS, new_bank

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
