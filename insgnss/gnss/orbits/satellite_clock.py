"""The satellite's clock: broadcast polynomial, periodic relativity, group delay of the signal; in metres.

Positive when the satellite's clock is ahead of system time: corrected pseudorange = measured + clock.
"""

from __future__ import annotations

from insgnss.constants import C_MPS
from insgnss.gnss.orbits.ephemeris_rows import (
    AF0,
    AF1,
    AF2,
    DELAY_1,
    DELAY_2,
    RELATIVITY,
    TOC_MINUS_TOE,
    E,
    N,
)
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64


@kernel
def satellite_clock(rows: Float64, k: int, t: float, sin_E: float, cos_E: float) -> tuple[float, float]:
    """Return the clock of message ``k`` [m] and its rate [m/s], for the message's own reference signals.

    Equation: dt = af0 + af1 dt_c + af2 dt_c^2 - 2 sqrt(mu) / c^2 e sqrt(a) sin E    [IS-GPS-200N, 20.3.3.3.3.1]
    Neglects: relativity of the Earth's oblateness, below 0.03 m and 2e-5 m/s.

    Parameters
    ----------
    rows : (m, N_COLUMNS) messages, see ``ephemeris_rows``
    k : the message's row
    t : time since toe (not toc) [s]
    sin_E, cos_E : of the eccentric anomaly at ``t``
    """
    dt = t - rows[k, TOC_MINUS_TOE]
    offset = rows[k, AF0] + dt * (rows[k, AF1] + dt * rows[k, AF2]) + rows[k, RELATIVITY] * sin_E
    # E' = n / (1 - e cos E)
    E1 = rows[k, N] / (1.0 - rows[k, E] * cos_E)
    drift = rows[k, AF1] + 2.0 * dt * rows[k, AF2] + rows[k, RELATIVITY] * cos_E * E1
    return C_MPS * offset, C_MPS * drift


@kernel
def group_delay(rows: Float64, k: int, factor_1: float, factor_2: float) -> float:
    """Return the delay [m] to subtract from the clock of message ``k`` for a signal with these two factors.

    Equation: c (factor_1 d_1 + factor_2 d_2), factors as in ``signals.Signal.group_delay``.
    """
    delay_s: float = factor_1 * rows[k, DELAY_1] + factor_2 * rows[k, DELAY_2]
    return C_MPS * delay_s
