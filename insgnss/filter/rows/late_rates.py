"""Range rates that lag behind the motion: a receiver's loops smooth them, or they are of an earlier time.

The measured rate is that of the antenna's velocity v smoothed twice: w1' = (v - w1) / t, w2' = (w1 - w2) / t, t = T/2.
For an acceleration a that changes by j a second, w2 = v - T a + 3/4 T^2 j. One smoothing of the time T gives T^2 j in
place of 3/4 T^2 j, the velocity T earlier T^2 j / 2. With e = v - w2 the prediction grows by u . e. It shrinks by T
times the satellite's part of the range's acceleration, (|v_rel|^2 - rho_dot^2) / rho + u . a_sat, which is up to
0.18 m/s^2 and differs from satellite to satellite.
Neglects: the lag of the clock's drift, and the errors of e, which are those of T a.
"""

from __future__ import annotations

import math
from typing import Final

from insgnss.constants import WGS84_GM_M3PS2, WGS84_OMEGA_RADPS
from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import AntennaState, Line
from insgnss.filter.state import OFFSETS, Bank, StateRecord
from insgnss.geodesy.vectors import Vector, cross, dot, rotate
from insgnss.gnss.observation_rows import RANGE_RATE, GnssRows
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

# Share of u . e that the law may be wrong by, for a T of a second. Where forces change within a second, the laws above
# differ by T^2 j / 4, a quarter of T a. Rates that are linear between epochs 1 s apart and 0.2 s late differ by more:
# with 0.3 the inertial sensors were blamed in 4 of 6 flights, with 0.9 in none of the same
LATE_RATE_DOUBT: Final = 0.9


@kernel(inline=True)
def carry_late_velocity(m: StateRecord, par: Parameters, w: Float64, before_e: Vector, dt: float) -> None:
    """Carry what the two smoothings lag by over ``dt`` [s].

    In this time the velocity changed from ``before_e`` to that of ``m`` at a constant rate, and the body turned by the
    rate ``w``. Equation: e <- k e + (1 - k) (t / dt) dv, k = exp(-dt / t); what goes into the second smoothing has
    changed by dv - (e - e before).
    """
    t = 0.5 * m.rates_late_s
    kept = math.exp(-dt / t)
    gain = (1.0 - kept) * t / dt
    swing = rotate(m.C_eb, cross(w, par.lever_b))
    first = math.isnan(m.swing_late[0])
    for i in range(3):
        if first:
            m.swing_late[i] = swing[i]
        dv = m.v_e[i] - before_e[i] + swing[i] - m.swing_late[i]
        m.swing_late[i] = swing[i]
        for k in range(2):
            before = m.dv_late[k, i]
            m.dv_late[k, i] = kept * before + gain * dv
            dv -= m.dv_late[k, i] - before


def set_lag(bank: Bank, late_s: float) -> None:
    """Let range rates lag by a time from now on."""
    bank.state["rates_late_s"], bank.state["dv_late"], bank.state["swing_late"] = late_s, 0.0, math.nan


@kernel(inline=True)
def late_rate(m: StateRecord, a: AntennaState, rows: GnssRows, i: int) -> tuple[float, float]:
    """Return what the lag adds to the predicted range rate of row ``i`` [m/s], and the variance of that."""
    if m.rates_late_s == 0.0:
        return 0.0, 0.0
    late = dot(a.u, m.dv_late[0]) + dot(a.u, m.dv_late[1])
    own = satellites_part(a, rows, i)
    return late - m.rates_late_s * own, (LATE_RATE_DOUBT * m.rates_late_s * late) ** 2


@kernel(inline=True)
def rate_lag_column(
    m: StateRecord, par: Parameters, rows: GnssRows, i: int, a: AntennaState, line: Line, count: int
) -> tuple[float, int]:
    """Write the derivative of a range rate by a lag that is a state at ``count``; return the lag's effect and the end.

    The derivative has the acceleration that counts as motion, as that by the offset of the inertial tags.
    """
    if par.at_rate_lag < 0:
        return 0.0, count
    own = satellites_part(a, rows, i)
    line.h[RANGE_RATE][count] = dot(a.u, a.shown_a_e) - own
    line.columns[RANGE_RATE][count] = par.at_rate_lag
    return m.optional[par.at_rate_lag - OFFSETS] * (dot(a.u, a.whole_a_e) - own), count + 1


@kernel(inline=True)
def satellites_part(a: AntennaState, rows: GnssRows, i: int) -> float:
    """Return the part of the acceleration of the range of row ``i`` that is not the antenna's [m/s^2]."""
    s = rows.sat[i]
    w = WGS84_OMEGA_RADPS
    relative2 = (s[3] - a.v_a[0]) ** 2 + (s[4] - a.v_a[1]) ** 2 + (s[5] - a.v_a[2]) ** 2
    r2 = s[0] * s[0] + s[1] * s[1] + s[2] * s[2]
    pull = WGS84_GM_M3PS2 / (r2 * math.sqrt(r2))
    along = a.u[0] * ((w * w - pull) * s[0] + 2.0 * w * s[4])
    along += a.u[1] * ((w * w - pull) * s[1] - 2.0 * w * s[3]) - a.u[2] * pull * s[2]
    return float((relative2 - a.range_rate**2) / a.distance + along)
