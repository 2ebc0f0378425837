"""From two successive inertial samples to the effective rates of the last interval: coning and sculling, compiled."""

from __future__ import annotations

from insgnss.kernels.jit import kernel
from insgnss.tables import Float64


@kernel(inline=True)
def effective_rates(
    w: Float64,
    f: Float64,
    w_before: Float64,
    f_before: Float64,
    dt: float,
    dt_before: float,
    w_c: Float64,
    f_c: Float64,
) -> None:
    """Write the constant rates that give the interval's true rotation vector and velocity increment.

    Equation: phi = T2 (w2 + k w1 x w2),  dv = T2 (f2 + k (w1 x f2 + f1 x w2)),  k = T2^2 / (6 (T1 + T2)); for equal
              steps phi = a2 + (a1 x a2)/12,  dv = d2 + (a1 x d2 + d1 x a2)/12  [Savage 1998, two-sample, eq. 47, 58]
    The rates are taken linear in time over both intervals, which may differ in length. The rotation of the interval
    itself (a2 x d2 / 2) is not in ``f_c``: the mechanization applies it to whatever part of the interval it steps over.
    Neglects: curvature of the rates, third order in the step.

    Parameters
    ----------
    w, f : (3,) mean rate [rad/s] and specific force [m/s^2] over the last interval of ``dt`` [s]
    w_before, f_before : (3,) the same over the interval before it, of ``dt_before`` [s]
    w_c, f_c : (3,) outputs, effective rate [rad/s] and specific force [m/s^2] of the last interval
    """
    k = dt * dt / (6.0 * (dt_before + dt))
    w_c[0] = w[0] + k * (w_before[1] * w[2] - w_before[2] * w[1])
    w_c[1] = w[1] + k * (w_before[2] * w[0] - w_before[0] * w[2])
    w_c[2] = w[2] + k * (w_before[0] * w[1] - w_before[1] * w[0])
    f_c[0] = f[0] + k * (w_before[1] * f[2] - w_before[2] * f[1] + f_before[1] * w[2] - f_before[2] * w[1])
    f_c[1] = f[1] + k * (w_before[2] * f[0] - w_before[0] * f[2] + f_before[2] * w[0] - f_before[0] * w[2])
    f_c[2] = f[2] + k * (w_before[0] * f[1] - w_before[1] * f[0] + f_before[0] * w[1] - f_before[1] * w[0])
