"""Whether a receiver's carrier phases are locked at all, compiled.

A receiver that has lost a phase may go on writing numbers, and not every log keeps the flags that say so. Their
differences from epoch to epoch are off by metres a second, and most of them fail a test (``gnss.carrier_rows``). But
one in five passes by chance, and of these the filter's gate takes those that suit its error: worse than no carrier.

So each phase has a probability p that it is not locked. It follows from the tests alone, which ask no filter:

    p <- p + (1 - p) (1 - exp(-T / 50 s)) - p (1 - exp(-T / 5 s)),   T since the epoch before
    p <- p u / (p u + (1 - p) l),   u, l: how often an unlocked phase and a locked one do what this one did

A difference is used while p is below 5 %. A phase that never fails is used from its first difference on; one slip costs
at most the next two differences. A slip that the receiver reports says nothing of the other differences.
"""

from __future__ import annotations

import math
from typing import Final

from insgnss.filter.rows.lines import Lines
from insgnss.filter.state import StateRecord
from insgnss.filter.update.satellite_memory import FORGOTTEN_S, UNLOCKED, UNLOCKED_S
from insgnss.gnss.observation_rows import CARRIER, GnssRows
from insgnss.kernels.jit import kernel
from insgnss.status import PHASE_NOT_LOCKED, SLIP_DOPPLER, SLIP_GEOMETRY_FREE, USED
from insgnss.tables import Float64

AT_FIRST: Final = 0.1  # that a phase which appears is not locked
_LOST_AFTER_S: Final = 50.0
_FOUND_AFTER_S: Final = 5.0
PASSES_UNLOCKED: Final = 0.2  # how often the difference of an unlocked phase passes the tests
_PASSES_LOCKED: Final = 0.99
_SHARE_S: Final = 30.0  # over which the share of failed tests is a mean
_MOST: Final = 0.05  # probability with which a difference is still used


@kernel(inline=True)
def refuse_unlocked(
    m: StateRecord, memory: Float64, rows: GnssRows, epoch: int, lines: Lines, since_last: float
) -> None:
    """Refuse an epoch's carrier differences whose phases are not shown to be locked; ``memory``: (slots, N_MEMORY)."""
    first, now = rows.first[epoch], rows.epoch_ns[epoch] * 1e-9
    decay = math.exp(-since_last / _SHARE_S)
    m.carriers_tested, m.carriers_failed = decay * m.carriers_tested, decay * m.carriers_failed
    for j in range(lines.shape[0]):
        status = rows.carrier[first + j].status
        passes = status == USED
        if passes or status == SLIP_DOPPLER or status == SLIP_GEOMETRY_FREE:
            seen = memory[rows.observation[first + j].slot]
            follow_lock(seen, passes, now)
            m.carriers_tested += 1.0
            m.carriers_failed += 0.0 if passes else 1.0
            if lines[j].status[CARRIER] == USED and seen[UNLOCKED] > _MOST:
                lines[j].status[CARRIER] = PHASE_NOT_LOCKED


@kernel(inline=True)
def follow_lock(seen: Float64, passes: bool, now: float) -> None:
    """Update the probability that a phase is not locked by a difference that passes the tests or fails one."""
    since = now - seen[UNLOCKED_S]
    seen[UNLOCKED_S] = now
    p = AT_FIRST
    if 0.0 <= since <= FORGOTTEN_S:
        p = seen[UNLOCKED]
        lost, found = 1.0 - math.exp(-since / _LOST_AFTER_S), 1.0 - math.exp(-since / _FOUND_AFTER_S)
        p += (1.0 - p) * lost - p * found
    unlocked = p * (PASSES_UNLOCKED if passes else 1.0 - PASSES_UNLOCKED)
    locked = (1.0 - p) * (_PASSES_LOCKED if passes else 1.0 - _PASSES_LOCKED)
    seen[UNLOCKED] = unlocked / (unlocked + locked)
