"""The whole error of an inertial sensor: its bias, and the effect of its further errors on force and rate.

    e_i = b_i + sum_k m_k x_k    over the couplings k of axis i, m_k a component of specific force or rate, or one

While a vehicle keeps attitude and rate, only e is observable; its parts predict the effect of a change.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from insgnss.filter.layout import SENSORS, Layout
from insgnss.filter.parameters import Parameters
from insgnss.filter.state import BA, BG, DV, OFFSETS, PSI, StateRecord
from insgnss.geodesy.vectors import Vector
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

BIAS_OF: Final = {DV: BA, PSI: BG}  # where the biases stand of the sensor that enters there


@kernel(inline=True)
def factor_of(which: int, f: Vector | Float64, w: Vector | Float64) -> float:
    """Return what an error of a sensor is proportional to: ``layout.FACTORS`` of specific force and rate."""
    if which == 0:
        return 1.0
    return float(f[which - 1] if which <= 3 else w[which - 4])


@kernel(inline=True)
def place_further_errors(m: StateRecord, par: Parameters, errors: Float64) -> None:
    """Write how the further errors of gyros and accelerometers grow with force and rate: ``errors`` (7, 6).

    It holds until a further state changes; each sample would sort the states again.
    """
    for i in range(errors.shape[0]):
        for j in range(errors.shape[1]):
            errors[i, j] = 0.0
    for k in range(par.n_couplings):
        column = par.coupling_axis[k] + (0 if par.coupling_into[k] == PSI else 3)
        errors[par.coupling_times[k], column] += m.optional[par.coupling_at[k] - OFFSETS]


@kernel(inline=True)
def correct_sensors(errors: Float64, w: Float64, f: Float64) -> None:
    """Take the further ``errors`` of the sensors off a rate ``w`` and a specific force ``f``, biases removed before.

    Equation: w_i <- w_i - sum x_k m_k, with m_k of the measured values: to first order in x_k
    """
    x, y, z, p, q, r = f[0], f[1], f[2], w[0], w[1], w[2]
    for i in range(3):
        w[i] -= further_error(errors, i, (x, y, z), (p, q, r))
        f[i] -= further_error(errors, i + 3, (x, y, z), (p, q, r))


@kernel(inline=True)
def further_error(errors: Float64, i: int, f: Vector, w: Vector) -> float:
    """Return the further error of axis ``i``, of the gyros and then of the accelerometers, in a force and a rate."""
    by_force = errors[1, i] * f[0] + errors[2, i] * f[1] + errors[3, i] * f[2]
    return float(errors[0, i] + by_force + errors[4, i] * w[0] + errors[5, i] * w[1] + errors[6, i] * w[2])


@kernel(inline=True)
def bias_row(par: Parameters, k: int) -> int:
    """Return the bias in whose sensor and axis the error of coupling ``k`` is."""
    return int(par.coupling_axis[k] + (BG if par.coupling_into[k] == PSI else BA))


@kernel(inline=True)
def whole_errors(m: StateRecord, par: Parameters, accel: Float64, gyro: Float64) -> None:
    """Write the whole errors of the accelerometers (3,) [m/s^2] and gyros (3,) [rad/s] in the last step."""
    for i in range(3):
        accel[i], gyro[i] = m.b_a[i], m.b_g[i]
    for k in range(par.n_couplings):
        error = m.optional[par.coupling_at[k] - OFFSETS] * factor_of(
            par.coupling_times[k], m.f_last, m.w_last
        )
        if par.coupling_into[k] == PSI:
            gyro[par.coupling_axis[k]] += error
        else:
            accel[par.coupling_axis[k]] += error


@kernel(inline=True)
def add_further_errors(m: StateRecord, par: Parameters, into: int, x: Float64, sign: float) -> None:
    """Add ``sign`` times a sensor's further errors in an error state ``x`` (n,) to its biases in it.

    ``into`` is where the sensor enters: DV or PSI.
    """
    for k in range(par.n_couplings):
        if par.coupling_into[k] == into:
            factor = sign * factor_of(par.coupling_times[k], m.f_last, m.w_last)
            x[bias_row(par, k)] += factor * x[par.coupling_at[k]]


@kernel(inline=True)
def biases_to_whole_errors(m: StateRecord, par: Parameters, P: Float64) -> None:
    """Turn the biases in ``P`` (n, n) into the whole errors: P <- T P T^T with de = db + sum m_k dx_k."""
    n = P.shape[0]
    for c in range(n):
        add_further_errors(m, par, DV, P[:, c], 1.0)
        add_further_errors(m, par, PSI, P[:, c], 1.0)
    for i in range(n):
        add_further_errors(m, par, DV, P[i], 1.0)
        add_further_errors(m, par, PSI, P[i], 1.0)


@kernel(inline=True)
def accel_error_covariance(m: StateRecord, par: Parameters, P: Float64, rows: Float64) -> None:
    """Write the covariance of the accelerometers' whole errors (rows) with attitude (PSI) and themselves (BA).

    Parameters
    ----------
    rows : (3, n) output; of its columns those of attitude and accelerometer bias are right
    """
    for i in range(3):
        for c in range(P.shape[0]):
            rows[i, c] = P[BA + i, c]
    for k in range(par.n_couplings):
        if par.coupling_into[k] == DV:
            at, axis = par.coupling_at[k], par.coupling_axis[k]
            factor = factor_of(par.coupling_times[k], m.f_last, m.w_last)
            for c in range(P.shape[0]):
                rows[axis, c] += factor * P[at, c]
    for k in range(par.n_couplings):
        if par.coupling_into[k] == DV:
            at, axis = par.coupling_at[k], par.coupling_axis[k]
            factor = factor_of(par.coupling_times[k], m.f_last, m.w_last)
            for i in range(3):
                rows[i, BA + axis] += factor * rows[i, at]


@kernel(inline=True)
def gyro_error_variance(m: StateRecord, par: Parameters, P: Float64) -> float:
    """Return the variance of the gyros' whole error, the mean of the three axes [rad^2/s^2]."""
    total = P[BG, BG] + P[BG + 1, BG + 1] + P[BG + 2, BG + 2]
    for k in range(par.n_couplings):
        if par.coupling_into[k] == PSI:
            at, axis = par.coupling_at[k], par.coupling_axis[k]
            factor = factor_of(par.coupling_times[k], m.f_last, m.w_last)
            with_others = 2.0 * P[BG + axis, at] + factor * P[at, at]
            j = k + 1
            while j < par.n_couplings and par.coupling_axis[j] == axis:  # those of an axis stand together
                of_j = factor_of(par.coupling_times[j], m.f_last, m.w_last)
                with_others += 2.0 * of_j * P[at, par.coupling_at[j]]
                j += 1
            total += factor * with_others
    return float(total / 3.0)


def whole_error_rows(m: StateRecord, layout: Layout, sensor: str, n: int) -> Float64:
    """Return how the whole errors of a sensor of ``SENSORS`` grow with the error state, (3, n), in the last step."""
    into = SENSORS[sensor]
    rows = np.zeros((3, n))
    rows[:, BIAS_OF[into] : BIAS_OF[into] + 3] = np.eye(3)
    factors = (1.0, *m.f_last, *m.w_last)
    for at, of_sensor, axis, times in layout.couplings:
        if of_sensor == into:
            rows[axis, at] += factors[times]
    return rows


def whole_errors_of(m: StateRecord, layout: Layout) -> tuple[Float64, Float64]:
    """Return the whole errors of accelerometers [m/s^2] and gyros [rad/s] in the last step, (3,) each.

    Interpreted, as ``whole_error_rows``: for callers outside the loop, which compile nothing.
    """
    errors = {DV: np.array(m.b_a), PSI: np.array(m.b_g)}
    factors = (1.0, *m.f_last.tolist(), *m.w_last.tolist())
    values = m.optional.tolist()
    for at, into, axis, times in layout.couplings:
        errors[into][axis] += values[at - OFFSETS] * factors[times]
    return errors[DV], errors[PSI]
