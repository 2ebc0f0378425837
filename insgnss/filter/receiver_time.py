"""Rows of measurements at GPS time, where the IMU's tags are off by a time s that is estimated (``states.imu_time``).

The state is at the IMU's tag t, so it is the vehicle's at GPS time t + s. A measurement at GPS time t is predicted from
the state carried back by s. With its partials there by position, velocity and attitude, h_r, h_v and h_psi,

    dh/ds = -(h_r . v + h_v . a + h_psi . w),    v, a, w of the IMU that count as motion, ECEF

| measurement | dh/ds |
|---|---|
| position of a point l of the body along n | -n . (v + w x l) |
| its velocity along n | -n . (a + w x (w x l)) |
| roll, pitch, yaw | minus their rates |
| phase difference over a baseline b, line of sight u | u . (w x b) |

Neglects: the change of w on the lever arm of a velocity; the Earth's rate in w, 1.5e-6 rad for 20 ms.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from insgnss.filter.headings.motion import angular_acceleration, place_turning
from insgnss.filter.layout_names import StateLayout
from insgnss.filter.output.gps_time import place_at_gps_time
from insgnss.filter.own_rows.checked_rows import CheckedRow, checked_rows
from insgnss.filter.own_rows.rows import Kind
from insgnss.filter.own_rows.state_estimate import StateEstimate, read_only
from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import ANTENNA_DTYPE, AntennaState
from insgnss.filter.state import DR, DV, OFFSETS, PSI, StateRecord
from insgnss.filter.update.shown_motion import place_motion
from insgnss.geodesy.vectors import cross_product
from insgnss.tables import Float64


def rows_at_their_time(
    kinds: Iterable[Kind],
    estimate: StateEstimate,
    layout: StateLayout,
    m: StateRecord,
    P: Float64,
    par: Parameters,
    antenna: AntennaState,
) -> list[list[CheckedRow]]:
    """Return the rows of each kind: at the IMU's tag, or at GPS time with a column of the IMU's time.

    Parameters
    ----------
    estimate : of the state ``m`` at the IMU's tag
    antenna : as ``place_antenna`` and ``place_turning`` have filled it
    """
    if par.at_imu_time < 0:
        return [checked_rows(kind, estimate, layout) for kind in kinds]
    at_gps, grows = estimate_at_gps_time(estimate, m, par), motion_by_imu_time(m, P, par, antenna)
    return [
        [_with_imu_time(row, grows, par) for row in checked_rows(kind, at_gps, layout)]
        if kind.at_gps_time
        else checked_rows(kind, estimate, layout)
        for kind in kinds
    ]


def estimate_at_gps_time(estimate: StateEstimate, m: StateRecord, par: Parameters) -> StateEstimate:
    """Return an estimate of the state ``m`` carried back from the IMU's tag to GPS time."""
    r_e, v_e, C_eb = np.empty(3), np.empty(3), np.empty((3, 3))
    place_at_gps_time(m, par, r_e, v_e, np.empty(4), C_eb)
    turned = float(m.optional[par.at_imu_time - OFFSETS]) * np.array(angular_acceleration(m))
    r_e, v_e, C_eb, w_ib_b = map(read_only, (r_e, v_e, C_eb, estimate.w_ib_b - turned))
    return replace(estimate, r_e=r_e, v_e=v_e, C_eb=C_eb, w_ib_b=w_ib_b)


def motion_by_imu_time(m: StateRecord, P: Float64, par: Parameters, antenna: AntennaState) -> Float64:
    """Return how the state at GPS time grows with the IMU's time, (n,): -v, -a and -w, zero elsewhere.

    Parameters
    ----------
    antenna : as ``place_antenna`` and ``place_turning`` have filled it
    """
    place_motion(m, P, par, antenna)
    w, grows = antenna.w_b, np.zeros(len(P))
    centripetal = m.C_eb @ cross_product(w, cross_product(w, antenna.l_b))
    grows[DR : DR + 3] = antenna.turning_e - antenna.shown_v_e
    grows[DV : DV + 3] = centripetal - antenna.shown_a_e
    grows[PSI : PSI + 3] = -m.C_eb @ w
    return grows


def _with_imu_time(row: CheckedRow, grows: Float64, par: Parameters) -> CheckedRow:
    """Return a row at GPS time with its column of the IMU's time; one without partials as it is."""
    if not len(row.h):
        return row
    h = np.append(row.h, row.h @ grows[row.columns])
    return row._replace(h=h, columns=np.append(row.columns, par.at_imu_time))


def turn_to_gps_time(m: StateRecord, par: Parameters) -> Float64:
    """Return the rotation C_eb^T(tag) C_eb(GPS time), (3, 3)."""
    C_eb = np.empty((3, 3))
    place_at_gps_time(m, par, np.empty(3), np.empty(3), np.empty(4), C_eb)
    return np.asarray(m.C_eb.T @ C_eb)


def turn_by_imu_time(m: StateRecord, P: Float64, par: Parameters) -> Float64:
    """Return how the attitude at GPS time grows with the IMU's time, (3,): -C_eb w, w that counts as motion."""
    a: AntennaState = np.zeros(1, ANTENNA_DTYPE)[0]
    a.w_b[:] = m.w_last
    place_turning(m, P, par, a)
    return np.asarray(-m.C_eb @ a.w_b)
