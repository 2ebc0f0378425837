"""A filter and its samples if the inertial tags were off: their new values, and the offset that explains most."""

from __future__ import annotations

import numpy as np

from insgnss.constants import NS_PER_S, WGS84_OMEGA_RADPS
from insgnss.filter.prediction import ImuSamples
from insgnss.filter.state import Bank
from insgnss.geodesy.gravity import normal_gravity_ecef


def at_other_tags(bank: Bank, late_ns: int) -> Bank:
    """Change and return a filter whose inertial tags turn out to be late: it is at an earlier GNSS time.

    Equation: r <- r - v dt, v <- v - (f + g - 2 w x v) dt, clock <- clock - drift dt; the attitude is the sensors' own
    """
    late_s = late_ns / NS_PER_S
    for m in bank.state:
        g_e = np.zeros(3)
        normal_gravity_ecef(m.r_e, g_e)
        x, y, _ = m.v_e
        g_e += 2.0 * WGS84_OMEGA_RADPS * np.array([y, -x, 0.0])
        m.r_e -= late_s * m.v_e
        m.v_e -= late_s * (m.f_smooth + g_e)
        m.clock[0] -= late_s * m.clock[1]
    bank.head["now_ns"] -= late_ns
    return bank


def earlier(imu: ImuSamples, late_ns: int) -> ImuSamples:
    """Return samples with the tags that they should have had."""
    return imu._replace(t_ns=imu.t_ns - late_ns)


def summit(values: dict[float, float]) -> float:
    """Return where the parabola through the largest of some values and its neighbours is largest; 0 at the ends."""
    at = sorted(values)
    best = max(range(len(at)), key=lambda i: values[at[i]])
    if not 0 < best < len(at) - 1:
        return 0.0
    x = np.array(at[best - 1 : best + 2])
    second, first, _ = np.polyfit(x, [values[k] for k in x], 2)
    return float(-0.5 * first / second) if second < 0.0 else 0.0
