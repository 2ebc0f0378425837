"""Whether a hypothesis is still a state of a vehicle, or numbers that nothing can be computed with, compiled.

A wild sample or a covariance that lost its sign shows sooner or later in a number that is not finite. From then on
every comparison is false and every product is lost, so the filter looks before each update, after it, and before it
writes.
"""

from __future__ import annotations

import math
from typing import Final

from insgnss.filter.state import MAX_OPTIONAL, N_FACTORS, StateRecord
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

# (1e15)^2 in each state's own unit: no knowledge at all. A float32 of the ledger holds it
_WIDEST_VARIANCE: Final = 1e30
_FARTHEST_POSITION_M: Final = 1e9  # from the Earth's centre: beyond the Moon
_FASTEST_MPS: Final = 1e6  # fifty times a spacecraft's
_FARTHEST_CLOCK_M: Final = 1e15  # a month of bias; the square of an innovation is then a number still


@kernel
def is_finite(m: StateRecord, P: Float64) -> bool:
    """Return whether every number of a hypothesis and of a covariance ``P`` is finite."""
    total = m.weak_shown + m.weak_rows
    total += m.cn0_level + m.clock_clone + m.sum_dt + m.sum_gyro_q + m.sum_accel_q + m.v_mean_variance
    for i in range(3):
        total += m.r_e[i] + m.v_e[i] + m.b_a[i] + m.b_g[i]
        total += m.r_clone[i] + m.dv_late[0, i] + m.dv_late[1, i]
        total += m.f_smooth[i] + m.w_smooth[i] + m.f_mean[i] + m.v_mean[i] + m.sum_dv[i]
        total += m.f_near[i] + m.w_near[i] + m.sum_f[i] + m.sum_w[i]
        for j in range(3):
            total += m.C_eb[i, j] + m.sum_C[i, j] + m.C_swung[i, j]
    for i in range(4):
        total += m.q_eb[i]
    for i in range(2):
        total += m.clock[i] + m.previous_zenith_delays[i] + m.drift_moved[i]
    for i in range(MAX_OPTIONAL):
        total += m.optional[i]
    for i in range(N_FACTORS):
        total += m.noise_factor[i]
    n = P.shape[0]
    a, b, c, d = 0.0, 0.0, 0.0, 0.0  # four sums side by side: one would wait for itself at every element
    for i in range(n):
        total += m.motion_response[i]
        j = 0
        while j + 4 <= n:
            a += P[i, j]
            b += P[i, j + 1]
            c += P[i, j + 2]
            d += P[i, j + 3]
            j += 4
        while j < n:
            a += P[i, j]
            j += 1
    return math.isfinite(total + (a + b) + (c + d))


@kernel
def is_sound(m: StateRecord, P: Float64) -> bool:
    """Return whether a hypothesis is one of a vehicle near the Earth: finite, and no variance negative or endless.

    A variance of zero is a state known exactly.
    """
    for i in range(P.shape[0]):
        if not (P[i, i] >= 0.0 and P[i, i] < _WIDEST_VARIANCE):
            return False
    for i in range(3):
        if not (abs(m.r_e[i]) < _FARTHEST_POSITION_M and abs(m.v_e[i]) < _FASTEST_MPS):
            return False
    return abs(m.clock[0]) < _FARTHEST_CLOCK_M and abs(m.clock[1]) < _FARTHEST_CLOCK_M and is_finite(m, P)
