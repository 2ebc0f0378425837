"""The state's record: a copy of it is a copy of all of it."""

from __future__ import annotations

import numpy as np

from insgnss.filter.state import STATE_DTYPE, copy_state


def test_copy_of_a_state_holds_every_byte() -> None:
    rng = np.random.default_rng(3)
    source = rng.integers(1, 255, STATE_DTYPE.itemsize, np.uint8).view(STATE_DTYPE).view(np.recarray)
    target = np.zeros(1, STATE_DTYPE).view(np.recarray)

    copy_state(source[0], target[0])

    assert target.tobytes() == source.tobytes()
