"""The prediction of each row of an epoch: innovation, row of H and variances at the prior, compiled.

The equations of each kind are in ``measurements``, the atmosphere of all of them in ``delays``. All are of the
antenna, at r_e + C_eb l with v_e + C_eb (w_ib x l) - w_ie x C_eb l.
"""

from __future__ import annotations

import math

from insgnss.constants import C_MPS, NS_PER_S, NS_PER_WEEK, WGS84_OMEGA_RADPS
from insgnss.filter.headings.motion import angular_acceleration, place_turning
from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.delays import evaluate_atmospheres, row_delays
from insgnss.filter.rows.lever_columns import place_lever
from insgnss.filter.rows.lines import AntennaState, EpochWorkspace, Line
from insgnss.filter.sensor_errors import whole_errors
from insgnss.filter.state import OFFSETS, StateRecord
from insgnss.filter.update.predictions import predict
from insgnss.filter.update.scalar_update import predicted_variance
from insgnss.filter.update.shown_motion import place_motion
from insgnss.geodesy.gravity import normal_gravity_ecef
from insgnss.geodesy.vectors import cross, plus, rotate_back
from insgnss.gnss.line_of_sight import line_of_sight
from insgnss.gnss.observation_rows import ABSENT, CARRIER, N_KINDS, GnssRows, Observation
from insgnss.kernels.jit import kernel
from insgnss.status import MASKED_CN0, MASKED_ELEVATION, NO_EPOCH_BEFORE, USED
from insgnss.tables import Float64


@kernel(apart=True)
def place_antenna(m: StateRecord, par: Parameters, w_ib_b: Float64, f_b: Float64, a: AntennaState) -> None:
    """Write antenna position and velocity at the instant of reception, and where that is.

    The state is at the receiver's time tag, reception was late = clock / c earlier: r_a goes back by
    v late - a late^2 / 2 and v_a by a late, a = C_eb (f_b + w x (w x l)) + g - 2 w_ie x v_e. Where the IMU's time is
    estimated, late is more by that, f_b is the mean of as long, and a holds C_eb (w' x l), w' the angular acceleration;
    where that of the GNSS tags is, late is less by that.
    Neglects: w' otherwise, 3e-4 m/s for 1 m, 1 ms and 20 deg/s in a second.
    """
    place_lever(m, par, a)
    l0, l1, l2 = a.l_b[0], a.l_b[1], a.l_b[2]
    whole_errors(m, par, a.dr, a.u)
    w0, w1, w2 = w_ib_b[0] - a.u[0], w_ib_b[1] - a.u[1], w_ib_b[2] - a.u[2]
    a.w_b[0], a.w_b[1], a.w_b[2] = w0, w1, w2
    x, y, z = w1 * l2 - w2 * l1, w2 * l0 - w0 * l2, w0 * l1 - w1 * l0
    C = m.C_eb
    for i in range(3):
        a.l_e[i] = C[i, 0] * l0 + C[i, 1] * l1 + C[i, 2] * l2
        a.a_e[i] = C[i, 0] * x + C[i, 1] * y + C[i, 2] * z
    a.v_a[0] = m.v_e[0] + a.a_e[0] + WGS84_OMEGA_RADPS * a.l_e[1]
    a.v_a[1] = m.v_e[1] + a.a_e[1] - WGS84_OMEGA_RADPS * a.l_e[0]
    a.v_a[2] = m.v_e[2] + a.a_e[2]
    late = m.clock[0] / C_MPS
    if par.at_imu_time >= 0:
        late += m.optional[par.at_imu_time - OFFSETS]
    if par.at_gnss_time >= 0:
        late -= m.optional[par.at_gnss_time - OFFSETS]
    normal_gravity_ecef(m.r_e, a.u)
    a.u[0] += 2.0 * WGS84_OMEGA_RADPS * m.v_e[1]
    a.u[1] -= 2.0 * WGS84_OMEGA_RADPS * m.v_e[0]
    p, q, r = w1 * z - w2 * y, w2 * x - w0 * z, w0 * y - w1 * x  # w x (w x l)
    f = (f_b[0] - a.dr[0], f_b[1] - a.dr[1], f_b[2] - a.dr[2])
    if par.at_imu_time >= 0:
        p, q, r = plus((p, q, r), cross(angular_acceleration(m), a.l_b))
        f = rotate_back(C, m.f_near)
    x, y, z = f[0] + p, f[1] + q, f[2] + r
    for i in range(3):
        acceleration = C[i, 0] * x + C[i, 1] * y + C[i, 2] * z + a.u[i]
        a.r_a[i] = m.r_e[i] + a.l_e[i] - late * (a.v_a[i] - 0.5 * late * acceleration)
        a.v_a[i] -= late * acceleration
        a.whole_a_e[i] = acceleration


@kernel(apart=True)
def predict_measurements(
    m: StateRecord,
    P: Float64,
    par: Parameters,
    rows: GnssRows,
    epoch: int,
    w_ib_b: Float64,
    f_b: Float64,
    s: EpochWorkspace,
) -> None:
    """Fill the work space for the rows of ``epoch``: geometry, masks, innovations and variances at the prior."""
    a: AntennaState = s.antenna[0]
    place_antenna(m, par, w_ib_b, f_b, a)
    first = rows.first[epoch]
    with_carrier = rows.carrier.shape[0] > 0
    follows = with_carrier and epoch_follows(m, rows, epoch)
    interval = (rows.epoch_ns[epoch] - m.clone_ns) / NS_PER_S if follows else 0.0
    place_turning(m, P, par, a)
    place_motion(m, P, par, a)
    evaluate_atmospheres(s, par, (rows.epoch_ns[epoch] % NS_PER_WEEK) / NS_PER_S, interval)
    for j in range(rows.first[epoch + 1] - first):
        i = first + j
        row: Observation = rows.observation[i]
        line: Line = s.lines[j]
        line.group = row.group
        for kind in range(2):
            line.status[kind] = row.status[kind]
        line.status[CARRIER] = carrier_status(rows, i, follows) if with_carrier else ABSENT
        for kind in range(N_KINDS):
            line.innovation[kind] = math.nan
        line.u_n[0] = math.nan
        if row.no_satellite == 0:
            predict_row(m, par, rows, i, row, s, line)
            for kind in range(N_KINDS):
                if line.status[kind] == USED:
                    columns = line.columns[kind][: line.count[kind]]
                    line.predicted[kind] = predicted_variance(P, line.h[kind], columns)


@kernel(apart=True)
def predict_row(
    m: StateRecord, par: Parameters, rows: GnssRows, i: int, row: Observation, s: EpochWorkspace, line: Line
) -> None:
    """Write direction, masks, innovations, rows of H and measurement variances of one row."""
    a: AntennaState = s.antenna[0]
    a.distance, a.range_rate = line_of_sight(rows.sat, i, a.r_a, a.v_a, a.u, a.dr)
    u, C_ne, C = a.u, a.C_ne, m.C_eb
    for k in range(3):
        line.u_n[k] = C_ne[k, 0] * u[0] + C_ne[k, 1] * u[1] + C_ne[k, 2] * u[2]
        line.u_b[k] = C[0, k] * u[0] + C[1, k] * u[1] + C[2, k] * u[2]
    sine = -line.u_n[2]
    mask_row(par, sine, row.cn0, line)
    if line.status[0] == USED or line.status[1] == USED or line.status[CARRIER] == USED:
        row_delays(rows, par, row, s, line)
    line.extra, line.foreseen = 0.0, 0.0
    for kind in range(N_KINDS):
        if line.status[kind] == USED:
            line.innovation[kind], line.variance[kind] = predict(kind, m, par, rows, i, s, line)


@kernel(inline=True)
def epoch_follows(m: StateRecord, rows: GnssRows, epoch: int) -> bool:
    """Return whether the clone is of the very epoch that the carrier's differences count from."""
    return bool(m.clone_ns != 0 and m.clone_ns == rows.before_ns[epoch])


@kernel(inline=True)
def carrier_status(rows: GnssRows, i: int, follows: bool) -> int:
    """Return the status a carrier difference starts with."""
    status = rows.carrier[i].status
    if status == USED and not follows:
        return NO_EPOCH_BEFORE
    return int(status)


@kernel(inline=True)
def mask_row(par: Parameters, sine: float, cn0: float, line: Line) -> None:
    """Refuse all kinds of a row that stands too low or is too weak."""
    refused = USED
    if not sine >= par.sine_mask:
        refused = MASKED_ELEVATION
    elif cn0 < par.cn0_mask:
        refused = MASKED_CN0
    if refused != USED:
        for kind in range(N_KINDS):
            if line.status[kind] == USED:
                line.status[kind] = refused
