"""An epoch after a long outage: the prior is too far from the truth to take a range's sphere for a plane.

A range curves by d^2 / (2 rho) over a position error d: 36 m over 40 km. With the rows of the prior's own place sound
ranges would contradict each other. So the rows are those of a nearer place, found by an update made for that alone:

    y = z - h(x1) + H1 (x1 - x0),   H1 at x1

This is one step of an iterated Kalman filter [Bell & Cathey 1993]; x0, P and all gates stay those of the prior. Then x1
is off by some 100 m, over which a range curves by less than a millimetre.
"""

from __future__ import annotations

import math
from typing import Final

from insgnss.filter.parameters import Parameters
from insgnss.filter.prediction import ImuSamples
from insgnss.filter.rows.lines import Line
from insgnss.filter.soundness import is_sound
from insgnss.filter.state import CLOCK, DR, DRIFT, N_CLONE, Bank, copy_matrix, copy_state
from insgnss.filter.update.closed_loop import close_loop
from insgnss.filter.update.epoch_space import FilterWorkspace
from insgnss.filter.update.prior_rows import predict_measurements
from insgnss.filter.update.scalar_update import scalar_update
from insgnss.gnss.observation_rows import N_KINDS, PSEUDORANGE, RANGE_RATE, GnssRows
from insgnss.kernels.jit import kernel
from insgnss.status import USED
from insgnss.tables import Float64

# 1 km in each axis, over which a range curves by 5 cm: a tenth of a code's noise at best
_FAR_M2: Final = 3e6
# The nearer place must not depend on the receiver's clock, which may have stepped in the outage: it counts as unknown
_CLOCK_M2: Final = 1e12
_DRIFT_M2PS2: Final = 1e6


@kernel(inline=True)
def is_far(P: Float64) -> bool:
    """Return whether ranges curve over the prior's uncertainty by more than their noise allows."""
    return bool(P[DR, DR] + P[DR + 1, DR + 1] + P[DR + 2, DR + 2] > _FAR_M2)


@kernel(apart=True)
def predict_nearer(
    bank: Bank,
    member: int,
    par: Parameters,
    rows: GnssRows,
    epoch: int,
    imu: ImuSamples,
    sample: int,
    work: FilterWorkspace,
) -> None:
    """Fill the lines of ``epoch`` again, by the rows of a nearer place; the innovations are those of the prior."""
    m, P, s = bank.state[member], bank.P[member], work.epoch
    nearer, correction = work.spare.state[0], s.vectors[0]
    first, last = rows.first[epoch], rows.first[epoch + 1]
    lines, n = s.lines[: last - first], P.shape[0]
    trial = work.scratch.A
    copy_matrix(P, trial)
    for i in range(n):
        correction[i] = 0.0
    trial[CLOCK, CLOCK] += _CLOCK_M2
    trial[DRIFT, DRIFT] += _DRIFT_M2PS2
    for kind in (PSEUDORANGE, RANGE_RATE):
        for j in range(lines.shape[0]):
            line: Line = lines[j]
            if line.status[kind] == USED:
                columns = line.columns[kind][: line.count[kind]]
                scalar_update(
                    trial, line.h[kind], columns, line.innovation[kind], line.variance[kind], s.vectors
                )
    copy_state(m, nearer)
    close_loop(nearer, correction, n - (N_CLONE if par.at_clone >= 0 else 0))
    if not is_sound(nearer, P):
        return
    predict_measurements(nearer, P, par, rows, epoch, imu.w_ib_b[sample], imu.f_b[sample], s)
    for j in range(lines.shape[0]):
        line = lines[j]
        for kind in range(N_KINDS):
            if line.status[kind] == USED and math.isfinite(line.innovation[kind]):
                for a in range(line.count[kind]):
                    line.innovation[kind] += line.h[kind, a] * correction[line.columns[kind, a]]
