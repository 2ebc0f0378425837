"""The columns of the offsets of the IMU's and of the GNSS time tags in the rows of an antenna's measurements."""

from __future__ import annotations

from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.late_rates import satellites_part
from insgnss.filter.rows.lines import AntennaState, Line
from insgnss.filter.state import OFFSETS, StateRecord
from insgnss.geodesy.vectors import dot
from insgnss.gnss.observation_rows import CARRIER, PSEUDORANGE, RANGE_RATE, GnssRows
from insgnss.kernels.jit import kernel


@kernel(inline=True)
def imu_time_range_column(par: Parameters, a: AntennaState, line: Line, kind: int, count: int) -> int:
    """Write what a range grows by with the IMU's time, u . v, at ``count``; return the end."""
    if par.at_imu_time < 0:
        return count
    line.h[kind][count] = dot(a.u, a.shown_v_e)
    line.columns[kind][count] = par.at_imu_time
    return count + 1


@kernel(inline=True)
def imu_time_rate_column(par: Parameters, a: AntennaState, line: Line, kind: int, count: int) -> int:
    """Write what a range rate grows by with it, u . a, and -v . of what it grows by with the antenna's position."""
    if par.at_imu_time < 0:
        return count
    line.h[kind][count] = dot(a.u, a.shown_a_e) - dot(a.dr, a.shown_v_e)
    line.columns[kind][count] = par.at_imu_time
    return count + 1


@kernel(inline=True)
def gnss_time_column(
    m: StateRecord, par: Parameters, rows: GnssRows, i: int, a: AntennaState, line: Line, kind: int
) -> float:
    """Write the derivative of row ``i`` by the GNSS tags' offset s behind its others; return what s adds to it.

    Equations: d rho = u . v_s + drift - u . v of a pseudorange; d rho_dot = A - dr . v - (u . a - dr . v) of its rate,
    A the satellites' part of the acceleration, dr the derivative of the rate by position; (A - dr . v) dt - u . v of a
    carrier difference, whose clone has its own share. The terms of v and a, the antenna's, are in its place already.
    """
    if par.at_gnss_time < 0:
        return 0.0
    antenna, swept = dot(a.u, a.v_a), dot(a.dr, a.v_a)
    if kind == PSEUDORANGE:
        own = a.range_rate + antenna + m.clock[1]
    else:
        own = (satellites_part(a, rows, i) - swept) * (a.look_back if kind == CARRIER else 1.0)
    if kind == RANGE_RATE:
        antenna = dot(a.u, a.whole_a_e) - swept
    count = line.count[kind]
    line.h[kind][count] = own - antenna
    line.columns[kind][count] = par.at_gnss_time
    line.count[kind] = count + 1
    return float(own * m.optional[par.at_gnss_time - OFFSETS])
