"""Time-differenced carrier phase: how far the antenna has come since the epoch before, to millimetres.

The carrier's ambiguity is the same in both epochs and falls out of the difference
    z = phi_k - phi_k-1 = [rho + clock - satellite clock + troposphere - ionosphere]_k - [the same]_k-1 + noise,
    H = [-u in position, u x l in attitude, 1 in the clock, u' in the clone's position, -1 in its clock]
which depends on the antenna's position and clock now and then. Then is a part of the filter's state: after each epoch
antenna position and clock are cloned (``update.clone``) with their correlations to the states they derive from, and
the clone's error is constant until the next epoch (stochastic cloning) [Roumeliotis & Burdick 2002]. So the
difference is weighted exactly against the filter's covariance at both ends, and corrects both. Where the attitude has
turned within the gyros' errors, the antenna has stayed (``lever_swing``).

Neglects: two differences that follow each other share the phase noise of the epoch between them, correlation -1/2;
taken as independent, the sum over many epochs is believed less than it deserves.
"""

from __future__ import annotations

from typing import Final

from insgnss.filter.measurements.pseudorange import COLUMNS as RANGE_COLUMNS
from insgnss.filter.measurements.pseudorange import range_row
from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.delays import zenith_columns
from insgnss.filter.rows.lever_columns import lever_range_columns
from insgnss.filter.rows.lines import EpochWorkspace, Line
from insgnss.filter.rows.row_noise import model_variance
from insgnss.filter.rows.time_columns import gnss_time_column, imu_time_range_column
from insgnss.filter.state import N_CLONE, OFFSETS, StateRecord
from insgnss.geodesy.vectors import place
from insgnss.gnss.line_of_sight import line_of_sight_range
from insgnss.gnss.observation_rows import CARRIER, GnssRows
from insgnss.kernels.jit import kernel

# the clone's entries follow those of a range, its clock last
_THEN: Final = len(RANGE_COLUMNS)
N_COLUMNS: Final = _THEN + N_CLONE
_CLOCK_THEN: Final = N_COLUMNS - 1


@kernel(inline=True)
def carrier_difference(
    m: StateRecord, par: Parameters, rows: GnssRows, i: int, s: EpochWorkspace, line: Line
) -> tuple[float, float]:
    """Write the row of H; return innovation [m] and variance [m^2].

    The zenith delays of then are the clone's: a climb is in them as it was.
    """
    a, row = s.antenna[0], rows.observation[i]
    h, then = line.h[CARRIER], a.u_before
    before = line_of_sight_range(rows.before, i, m.r_clone, then)
    range_row(a.u, a.l_e, h)
    place(h, _THEN, then)
    h[_CLOCK_THEN] = -1.0
    air, earlier = s.air[0], s.air[1]
    troposphere = air.dry * air.dry_factor + air.wet * air.wet_factor
    troposphere -= (
        m.previous_zenith_delays[0] * earlier.dry_factor + m.previous_zenith_delays[1] * earlier.wet_factor
    )
    wet = air.wet_factor - earlier.wet_factor
    shell = -row.phase_factor * a.shell_grown
    left, count = zenith_columns(m, par, line, CARRIER, N_COLUMNS, wet, shell)
    count = lever_range_columns(m, par, a, line, CARRIER, count)
    line.count[CARRIER] = imu_time_range_column(par, a, line, CARRIER, count)
    left += gnss_time_column(m, par, rows, i, a, line, CARRIER)
    clocks = m.clock[0] - m.clock_clone - (rows.sat[i, 6] - rows.before[i, 6])
    predicted = a.distance - before + clocks + (left + troposphere - row.phase_factor * a.ionosphere_grown)
    variance = m.noise_factor[CARRIER] * model_variance(-line.u_n[2], row.thermal, par.kind[CARRIER])
    if par.at_range_biases >= 0:
        variance += wander(par, row.phase_factor * a.shell, air.wet_factor) * a.look_back
    return rows.carrier[i].value - predicted, variance


@kernel(inline=True)
def wander(par: Parameters, shell: float, wet: float) -> float:
    """Return the variance per second [m^2/s] by which the air's states may wander in a difference.

    A Gauss-Markov state of an hour wanders over a second as no ionosphere does: the settings say how fast that may be.
    """
    total = 0.0
    if par.at_ionosphere >= 0:
        total += shell * shell * min(par.optional_density[par.at_ionosphere - OFFSETS], par.ionosphere_wander)
    if par.at_zenith_delay >= 0:
        total += wet * wet * par.optional_density[par.at_zenith_delay - OFFSETS]
    return total
