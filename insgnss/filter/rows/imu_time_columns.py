"""The column of the IMU's time in the rows of an antenna's measurements."""

from __future__ import annotations

from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import AntennaState, Line
from insgnss.geodesy.vectors import dot
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
