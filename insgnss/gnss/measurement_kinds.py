"""The kinds of GNSS measurements, as columns of the rows: pseudorange, range rate, carrier phase difference."""

from __future__ import annotations

from typing import Final

PSEUDORANGE, RANGE_RATE, CARRIER = 0, 1, 2
N_KINDS: Final = 3
