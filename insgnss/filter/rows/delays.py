"""The atmosphere in the rows of an epoch: delays, their rates, and the columns of the models' residuals, compiled.

With I the ionosphere's delay of a code on L1, f the carrier's (f_L1 / f)^2, T the troposphere's delay:

    pseudorange        + f I + T
    range rate         - f I' + T'        (Doppler is the carrier's: a phase is advanced as a code is delayed)
    carrier difference - f [I] + [T]      ([ ] now less at the epoch before)

I' and T' are the models' differences to a little earlier, antenna and satellite carried back by their velocities: the
satellite's way through the sky, the antenna's climb, the turn of its horizon and the Sun's are in them. Earlier is the
epoch that the carrier's difference counts from, else ``LOOK_BACK_S`` ago. T' of a satellite at 6 deg is 19 mm/s.
Neglects: in a rate the models' bend over half of that time (at 6 deg 1e-5 m/s^2 at rest, 6e-4 at 250 m/s); what the
antenna accelerates over it (1 g for a second: below 1 mm but for the troposphere's zenith delay, which is the clone's);
d T' / d v of a climb, 3e-4 of the zenith's mapping, compared with the row's own sine of the elevation.

The models' residuals at the zenith enter as states where the filter has them: w Z of the wet troposphere, q J of the
ionosphere with the mapping q of a thin shell. In rates and differences they enter by the growth of the mappings. Their
own wander in a difference is left out: 1 mm/s of the ionosphere on a bad day, compared with 3 mm of a difference's
noise; over minutes it is what J, seen by the codes with the other sign, takes up.
"""

from __future__ import annotations

from typing import Final

from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import AntennaState, EpochWorkspace, Line
from insgnss.filter.state import OFFSETS, StateRecord
from insgnss.geodesy.ellipsoid import ecef_to_geodetic
from insgnss.geodesy.local_level import ecef_to_ned_matrix
from insgnss.gnss.ionosphere import shell_mapping
from insgnss.gnss.observation_rows import GnssRows, Observation
from insgnss.gnss.range_model import evaluate_atmosphere, slant_changes
from insgnss.gnss.troposphere import Weather
from insgnss.kernels.jit import kernel

LOOK_BACK_S: Final = 0.1  # short against the models' bend, long against the rounding of a delay


@kernel(inline=True)
def evaluate_atmospheres(s: EpochWorkspace, par: Parameters, week_s: float, interval: float) -> None:
    """Write the air of the epoch, and that of a little earlier, where the antenna came from.

    ``interval`` is what the carrier's differences span [s], zero where there are none.
    """
    a: AntennaState = s.antenna[0]
    a.look_back = interval if interval > 0.0 else LOOK_BACK_S
    lat, lon, h = ecef_to_geodetic(a.r_a)
    ecef_to_ned_matrix(lat, lon, a.C_ne)
    for i in range(3):
        a.r_earlier[i] = a.r_a[i] - a.v_a[i] * a.look_back
    lat_0, lon_0, h_0 = ecef_to_geodetic(a.r_earlier)
    ecef_to_ned_matrix(lat_0, lon_0, a.C_earlier)
    weather = Weather(par.pressure_0, par.temperature_0, par.humidity)
    evaluate_atmosphere(s.air[0], lat, lon, h, week_s, par.use_troposphere, weather)
    evaluate_atmosphere(s.air[1], lat_0, lon_0, h_0, week_s - a.look_back, par.use_troposphere, weather)


@kernel(inline=True)
def row_delays(rows: GnssRows, par: Parameters, row: Observation, s: EpochWorkspace, line: Line) -> None:
    """Write ionosphere on L1 and troposphere of a row, their growth, and the shell's mapping.

    ``a.dr`` is minus the turn of the line of sight per second, ``a.u_earlier`` takes the line of sight of then.
    """
    a: AntennaState = s.antenna[0]
    C, earlier = a.C_earlier, a.u_earlier
    x = a.u[0] + a.dr[0] * a.look_back
    y = a.u[1] + a.dr[1] * a.look_back
    z = a.u[2] + a.dr[2] * a.look_back
    for k in range(3):
        earlier[k] = C[k, 0] * x + C[k, 1] * y + C[k, 2] * z
    with_ionosphere = par.use_ionosphere > 0.0
    a.ionosphere, a.ionosphere_grown, a.troposphere, a.troposphere_grown = slant_changes(
        s.air[0], s.air[1], rows.klobuchar, line.u_n, earlier, with_ionosphere, row.ionosphere_m
    )
    if with_ionosphere:
        a.ionosphere_grown += row.ionosphere_rate * a.look_back
    if par.at_ionosphere >= 0:
        a.shell = shell_mapping(-line.u_n[2])
        a.shell_grown = a.shell - shell_mapping(-earlier[2])


@kernel(inline=True)
def zenith_columns(
    m: StateRecord, par: Parameters, line: Line, kind: int, count: int, wet: float, shell: float
) -> tuple[float, int]:
    """Write the columns of the zenith residuals from ``count`` on; return their contribution, and the end."""
    total = 0.0
    h, columns = line.h[kind], line.columns[kind]
    if par.at_zenith_delay >= 0:
        h[count], columns[count] = wet, par.at_zenith_delay
        total += wet * m.optional[par.at_zenith_delay - OFFSETS]
        count += 1
    if par.at_ionosphere >= 0:
        h[count], columns[count] = shell, par.at_ionosphere
        total += shell * m.optional[par.at_ionosphere - OFFSETS]
        count += 1
    return total, count
