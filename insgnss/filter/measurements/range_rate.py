"""Range rate (Doppler): how fast the range grows, and the growth of the air's delays.

    z = rho_dot + drift - satellite drift + T' - f I'
    H = [-(w_rel - u (u . w_rel)) / rho in position, -u in velocity, u x a_e + l_e x (u x w_ie) in attitude,
         l x C^T u in the gyro bias, 1 in the drift]

at the antenna's velocity v_e + C_eb (w_ib x l) - w_ie x C_eb l; a_e = C_eb (w_ib x l) of a rotation that was shown
(``motion.place_turning``). The air's delays are the carrier's: a phase is advanced as a code is delayed.
Neglects: further errors of the gyros (scale factors) in the antenna's motion about the IMU: 1000 ppm at 30 deg/s and
2 m are 1 mm/s.
"""

from __future__ import annotations

from typing import Final

from insgnss.constants import WGS84_OMEGA_RADPS
from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.delays import zenith_columns
from insgnss.filter.rows.late_rates import late_rate, rate_lag_column
from insgnss.filter.rows.lever_columns import lever_rate_columns
from insgnss.filter.rows.lines import AntennaState, EpochWorkspace, Line
from insgnss.filter.rows.row_noise import row_variance
from insgnss.filter.rows.time_columns import gnss_time_column, imu_time_rate_column
from insgnss.filter.state import BG, DR, DRIFT, DV, PSI, StateRecord
from insgnss.geodesy.vectors import cross, place, place_negative, plus, rotate_back
from insgnss.gnss.observation_rows import RANGE_RATE, GnssRows
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

COLUMNS: Final = (
    *(DR, DR + 1, DR + 2, DV, DV + 1, DV + 2),
    *(PSI, PSI + 1, PSI + 2, BG, BG + 1, BG + 2, DRIFT),
)
_POSITION, _VELOCITY, _ATTITUDE, _GYRO_BIAS, _DRIFT = (
    COLUMNS.index(state) for state in (DR, DV, PSI, BG, DRIFT)
)


@kernel(inline=True)
def range_rate(
    m: StateRecord, par: Parameters, rows: GnssRows, i: int, s: EpochWorkspace, line: Line
) -> tuple[float, float]:
    """Write the row of H; return innovation [m/s] and variance [m^2/s^2]."""
    a, row, of = s.antenna[0], rows.observation[i], par.kind[RANGE_RATE]
    rate_row(m, a, line.h[RANGE_RATE])
    per_s = 1.0 / a.look_back
    wet = (s.air[0].wet_factor - s.air[1].wet_factor) * per_s
    shell = -row.phase_factor * a.shell_grown * per_s
    left, count = zenith_columns(m, par, line, RANGE_RATE, len(COLUMNS), wet, shell)
    count = lever_rate_columns(m, par, a, line, RANGE_RATE, count)
    count = imu_time_rate_column(par, a, line, RANGE_RATE, count)
    lag, line.count[RANGE_RATE] = rate_lag_column(m, par, rows, i, a, line, count)
    left += gnss_time_column(m, par, rows, i, a, line, RANGE_RATE)
    predicted = a.range_rate + m.clock[1] - rows.sat[i, 7] + left
    late, unsure = late_rate(m, a, rows, i)
    predicted += late + lag
    predicted += (a.troposphere_grown - row.phase_factor * a.ionosphere_grown) * per_s
    variance = row_variance(row.sigma[RANGE_RATE], -line.u_n[2], row.thermal, of)
    return row.value[RANGE_RATE] - predicted, m.noise_factor[RANGE_RATE] * variance + unsure


@kernel(inline=True)
def rate_row(m: StateRecord, a: AntennaState, h: Float64) -> None:
    """Write the row of H of a range rate."""
    u_w = cross(a.u, (0.0, 0.0, WGS84_OMEGA_RADPS))
    place(h, _POSITION, a.dr)
    place_negative(h, _VELOCITY, a.u)
    place(h, _ATTITUDE, plus(cross(a.u, a.turning_e), cross(a.l_e, u_w)))
    place(h, _GYRO_BIAS, cross(a.l_b, rotate_back(m.C_eb, a.u)))
    h[_DRIFT] = 1.0
