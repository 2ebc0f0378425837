"""Range rates that are all wrong: those that a receiver repeats, and those that hindsight has found wrong. Compiled.

The same number, epoch after epoch, is not a measurement. A satellite's own motion changes its range rate, by 0.01 to
0.2 m/s in a second. Where the number in the log stays the same to the last digit although that motion has changed it by
more than its noise, it was not measured. No state is asked: a filter that follows such rates would take them for its
own motion before long.
"""

from __future__ import annotations

from typing import Final

from insgnss.filter.rows.lines import Line, Lines
from insgnss.filter.state import StateRecord
from insgnss.filter.update.integrity import direction
from insgnss.filter.update.satellite_memory import REPEATED, REPEATED_MOTION, REPEATED_VARIANCE
from insgnss.gnss.observation_rows import RANGE_RATE, GnssRows
from insgnss.kernels.jit import kernel
from insgnss.status import DRIFTING, STUCK, USED
from insgnss.tables import Float64

# squared sigmas of the row, averaged over all that repeat. What a resolution q rounds has a sigma of q / sqrt(12): a
# number that is right repeats until the motion is q, three and a half sigmas
_FAR2: Final = 16.0
RATES_OUT_NS: Final = 30_000_000_000  # for which a kind stays out once its rows fit again
_UNFIT2: Final = 9.0  # squared sigmas of a row that does not
_KIND: Final = 5  # rows that repeat together are reported as a fault of the kind
_AGAIN_NS: Final = 60_000_000_000


@kernel(inline=True)
def satellite_rate(rows: GnssRows, i: int, line: Line) -> float:
    """Return the part of a row's range rate that is the satellite's own motion [m/s]."""
    a, b, c = direction(line, RANGE_RATE)
    v = rows.sat[i, 3:6]
    return float(-(a * v[0] + b * v[1] + c * v[2]))


@kernel(inline=True)
def refuse_wrong_rates(m: StateRecord, memory: Float64, rows: GnssRows, epoch: int, lines: Lines) -> None:
    """Refuse an epoch's range rates that are known to be wrong; ``memory`` is (slots, N_MEMORY)."""
    refuse_repeated(m, memory, rows, epoch, lines)
    leave_out_rates(m, lines, rows.epoch_ns[epoch])


@kernel(apart=True)
def refuse_repeated(m: StateRecord, memory: Float64, rows: GnssRows, epoch: int, lines: Lines) -> None:
    """Refuse the range rates that stay the same while their satellites move; ``memory`` is (slots, N_MEMORY)."""
    first, t_ns = rows.first[epoch], rows.epoch_ns[epoch]
    repeated, far2 = 0, 0.0
    for j in range(lines.shape[0]):
        if lines[j].status[RANGE_RATE] != USED:
            continue
        one = rows.observation[first + j]
        value, seen = one.value[RANGE_RATE], memory[one.slot]
        motion = satellite_rate(rows, first + j, lines[j])
        if value == seen[REPEATED]:
            repeated += 1
            far2 += (motion - seen[REPEATED_MOTION]) ** 2 / seen[REPEATED_VARIANCE]
        else:
            seen[REPEATED], seen[REPEATED_MOTION] = value, motion
            seen[REPEATED_VARIANCE] = lines[j].variance[RANGE_RATE]  # later ones take the fault for noise
    if repeated == 0 or far2 <= _FAR2 * repeated:
        return
    for j in range(lines.shape[0]):
        if lines[j].status[RANGE_RATE] != USED:
            continue
        one = rows.observation[first + j]
        motion, seen = satellite_rate(rows, first + j, lines[j]), memory[one.slot]
        if one.value[RANGE_RATE] == seen[REPEATED] and motion != seen[REPEATED_MOTION]:
            lines[j].status[RANGE_RATE] = STUCK
    if repeated >= _KIND:
        if t_ns - m.stuck_ns > _AGAIN_NS:
            m.stuck_since_ns = t_ns
        m.stuck_ns = t_ns


@kernel(inline=True)
def leave_out_rates(m: StateRecord, lines: Lines, t_ns: int) -> None:
    """Refuse an epoch's range rates if all have been found wrong; they stay out while many do not fit."""
    if m.rates_out_ns <= t_ns:
        return
    n_known, far = 0, 0
    for j in range(lines.shape[0]):
        line = lines[j]
        if line.status[RANGE_RATE] == USED:
            variance = line.predicted[RANGE_RATE] + line.variance[RANGE_RATE]
            n_known += 1
            far += 0 if line.innovation[RANGE_RATE] ** 2 <= _UNFIT2 * variance else 1
            line.status[RANGE_RATE] = DRIFTING
    if 3 * far > n_known:
        m.rates_out_ns = max(m.rates_out_ns, t_ns + RATES_OUT_NS)
