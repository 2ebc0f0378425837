"""Pseudorange: distance to the satellite, clocks and atmosphere.

    z = |r_s - r_a| + clock + offset of the system + k channel bias - satellite clock + range bias + f I + T
    H = [-u in position, u x l_e in attitude, 1 in the clock]; 1, k, the sigma of the satellite's range bias and the
         mappings in the further states

at the antenna, r_e + C_eb l, u from it to the satellite.
"""

from __future__ import annotations

from typing import Final

from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.delays import zenith_columns
from insgnss.filter.rows.lever_columns import lever_range_columns
from insgnss.filter.rows.lines import EpochWorkspace, Line
from insgnss.filter.rows.row_noise import row_variance
from insgnss.filter.rows.time_columns import gnss_time_column, imu_time_range_column
from insgnss.filter.rows.weak_signals import weak_signal_level
from insgnss.filter.state import CLOCK, DR, OFFSETS, PSI, StateRecord
from insgnss.geodesy.vectors import cross, place, place_negative
from insgnss.gnss.observation_rows import PSEUDORANGE, GnssRows
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

COLUMNS: Final = (DR, DR + 1, DR + 2, PSI, PSI + 1, PSI + 2, CLOCK)
_POSITION, _ATTITUDE, _CLOCK = (COLUMNS.index(state) for state in (DR, PSI, CLOCK))


@kernel(inline=True)
def pseudorange(
    m: StateRecord, par: Parameters, rows: GnssRows, i: int, s: EpochWorkspace, line: Line
) -> tuple[float, float]:
    """Write the row of H; return innovation [m] and variance [m^2]."""
    a, row, of = s.antenna[0], rows.observation[i], par.kind[PSEUDORANGE]
    h, columns, count = line.h[PSEUDORANGE], line.columns[PSEUDORANGE], len(COLUMNS)
    range_row(a.u, a.l_e, h)
    predicted = a.distance + m.clock[0] - rows.sat[i, 6]
    if row.group > 0:
        h[count], columns[count] = 1.0, OFFSETS + row.group - 1
        predicted += m.optional[row.group - 1]
        count += 1
    if par.at_channel_bias >= 0 and row.channel != 0:
        h[count], columns[count] = row.channel, par.at_channel_bias
        predicted += row.channel * m.optional[par.at_channel_bias - OFFSETS]
        count += 1
    if par.at_range_biases >= 0 and line.bias > 0:
        at = par.at_range_biases + line.bias - 1
        h[count], columns[count] = row.bias_sigma, at
        predicted += row.bias_sigma * m.optional[at - OFFSETS]
        count += 1
    shell = row.ionosphere_factor * a.shell
    left, count = zenith_columns(m, par, line, PSEUDORANGE, count, s.air[0].wet_factor, shell)
    count = lever_range_columns(m, par, a, line, PSEUDORANGE, count)
    line.count[PSEUDORANGE] = imu_time_range_column(par, a, line, PSEUDORANGE, count)
    left += gnss_time_column(m, par, rows, i, a, line, PSEUDORANGE)
    predicted += left + (row.ionosphere_factor * a.ionosphere + a.troposphere)
    variance = float(row.variance_scale) * row_variance(row.sigma[PSEUDORANGE], -line.u_n[2], row.thermal, of)
    line.weakness = float(row.weakness)
    line.weak = weak_signal_level(m) * par.weak_signal2 * line.weakness * line.weakness
    return row.value[PSEUDORANGE] - predicted, m.noise_factor[PSEUDORANGE] * variance + line.weak


@kernel(inline=True)
def range_row(u: Float64, l_e: Float64, h: Float64) -> None:
    """Write the row of H of a range along ``u`` to an antenna on the lever arm ``l_e``: -u, (u x l_e), clock 1."""
    place_negative(h, _POSITION, u)
    place(h, _ATTITUDE, cross(u, l_e))
    h[_CLOCK] = 1.0
