"""Rows of a vehicle at standstill, zero velocity and zero rate, and the test of the inertial samples for them.

**The test.** A window of the samples that end with the tick is cut into k parts of n samples each. Of each of the six
axes the variance between the means m_j of the parts is held against the variance inside them:

    F = n sum_j (m_j - m)^2 / (k - 1)  :  (W + n rho^2),  W = sum_ij (x_ij - m_j)^2 / (k (n - 1))

For white noise of **any** level and rho = 0, F has the F distribution of k - 1 and k (n - 1) degrees of freedom: the
sensor's noise and an engine that idles need not be known, the window shows them. The vehicle is at rest where all six
are below the quantile 1 - p/6, so of the windows at rest at most the share p (``missed_share``) is taken for motion.
Vibration faster than a part averages out in m_j and makes F smaller still. A good gyro sees wind and passengers rock
the vehicle more slowly than that: rho is the rocking that a part's mean may have (``rocking_deg_per_s``,
``rocking_mps2``). With more of it the test does not fire, and nothing is claimed.

**False alarms.** Motion whose part means have r^2 times the variance of noise and rocking passes one axis with the
probability F_(k-1, k(n-1))(F_p / (1 + r^2)): 100 Hz, 1 s, p = 1 %: 0.08 at r = 3, 6e-5 at r = 10, of a single axis,
all axes multiplied. A turn is refused by its mean rate, strong vibration that hides motion by its size. A steady smooth
drive shows nothing to any inertial sensor. What remains of it is refused by the filter's own velocity: no row above
``below_mps``, and the gate of g sigma lets a vehicle of speed v pass with the probability Phi((g sqrt(S) - v) / s),
s the sigma of the predicted velocity, S = s^2 + r: at v = (g + 3) sqrt(S) it is 0.1 %.
A log that repeats one sample shows no noise: it counts as a faulty sensor, not as standstill.

**The rows.** 0 = v_e + rocking, with the variance of a correlated rocking (``correlated``), and
mean(w_ib_b) = e + C_be w_ie + noise, of the window, with e the gyros' whole error: its variance is that of the rocking
plus W / N.
Neglects: that the gyros' noise in the window has turned the attitude as well: it costs part of the gain.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from insgnss.config.vehicle_kind import Standstill, ZeroRateRows, ZeroVelocityRows
from insgnss.filter.layout_names import StateLayout
from insgnss.filter.own_rows.rows import Row
from insgnss.filter.own_rows.state_estimate import InertialWindow, StateEstimate
from insgnss.geodesy.rotations import EARTH_RATE_E
from insgnss.geodesy.vectors import cross_product
from insgnss.sensors.ticking import PeriodicMeasurement, correlated
from insgnss.tables import Float64

_PARTS: Final = 8
_LEAST_SAMPLES: Final = 3  # of a part
_LEAST_PARTS: Final = 3


@dataclass(frozen=True)
class WindowStatistics:
    """The statistics of a window of inertial samples: rates first, specific forces behind them, body axes."""

    f_ratio: Float64  # (6,) F of the module's text
    inside: Float64  # (6,) variance inside the parts [rad^2/s^2], [m^2/s^4]
    mean: Float64  # (6,)
    parts: int
    samples: int  # of a part


def window_statistics(
    window: InertialWindow, rocking: tuple[float, float] = (0.0, 0.0)
) -> WindowStatistics | None:
    """Return a window's statistics, None if it has too few samples, unknown samples, or a repeated sample.

    ``rocking``: sigma of the parts' means of a vehicle at rest [rad/s], [m/s^2].
    """
    count = len(window.t_ns)
    n = max(_LEAST_SAMPLES, count // _PARTS)
    k = count // n
    if k < _LEAST_PARTS or window.unknown:
        return None
    x = np.concatenate([window.w_ib_b, window.f_b], axis=1)[count - k * n :].reshape(k, n, 6)
    if not np.ptp(x, axis=(0, 1)).any():
        return None
    means = x.mean(axis=1)
    mean = means.mean(axis=0)
    inside = ((x - means[:, None]) ** 2).sum(axis=(0, 1)) / (k * (n - 1))
    between = n * ((means - mean) ** 2).sum(axis=0) / (k - 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        f_ratio = np.where(between == 0.0, 0.0, between / (inside + n * np.repeat(rocking, 3) ** 2))
    return WindowStatistics(f_ratio, inside, mean, k, n)


@functools.lru_cache(maxsize=64)
def critical_ratio(missed_share: float, parts: int, samples: int) -> float:
    """Return the F above which an axis shows motion; at rest all six are below in ``1 - missed_share`` of windows."""
    from scipy.special import fdtri  # here: every replay would pay for it

    return float(fdtri(parts - 1, parts * (samples - 1), 1.0 - missed_share / 6.0))


def stands(state: StateEstimate, limits: Standstill) -> WindowStatistics | None:
    """Return the statistics of a window at rest, None where the samples or the corrected rate show motion."""
    rocking = math.radians(limits.rocking_deg_per_s), limits.rocking_mps2
    found = window_statistics(state.recent(limits.window_s), rocking)
    if found is None or found.f_ratio.max() > critical_ratio(limits.missed_share, found.parts, found.samples):
        return None
    turn = np.linalg.norm(found.mean[:3] - state.gyro_error(found.mean[:3], found.mean[3:])[0])
    vibration = math.sqrt(float(found.inside[3:].max()) / found.samples)
    hidden = math.sqrt(float(found.inside[:3].max()) / found.samples)
    most = math.radians(limits.most_rate_deg_per_s)
    if turn > most or hidden > most or vibration > limits.most_vibration_mps2:
        return None
    return found


@dataclass(frozen=True)
class ZeroVelocity(PeriodicMeasurement):
    """Three rows, along the axes of ECEF, where the vehicle stands."""

    settings: ZeroVelocityRows
    limits: Standstill
    name: str = "zero_velocity"
    unit: str = "m/s"

    def rows(self, state: StateEstimate, layout: StateLayout) -> list[Row]:
        """Return 0 = v_e, or nothing where the vehicle moves."""
        if np.linalg.norm(state.v_e) > self.settings.below_mps or stands(state, self.limits) is None:
            return []
        variance = correlated(self.settings.sigma_mps**2, self.settings.correlation_s, self.period_s)
        return [Row(-float(v), {"velocity": e}, variance) for v, e in zip(state.v_e, np.eye(3), strict=True)]


@dataclass(frozen=True)
class ZeroRate(PeriodicMeasurement):
    """Three rows, along the body's axes, where the vehicle stands."""

    settings: ZeroRateRows
    limits: Standstill
    below_mps: float
    name: str = "zero_rate"
    unit: str = "rad/s"

    def rows(self, state: StateEstimate, layout: StateLayout) -> list[Row]:
        """Return mean(w_ib_b) = e + C_be w_ie, e the gyros' whole error, or nothing where the vehicle moves."""
        found = None
        if np.linalg.norm(state.v_e) <= self.below_mps:
            found = stands(state, self.limits)
        if found is None:
            return []
        error, grows = state.gyro_error(found.mean[:3], found.mean[3:])
        innovation = found.mean[:3] - error - state.C_eb.T @ EARTH_RATE_E
        own = math.radians(self.settings.sigma_deg_per_s) ** 2
        noise = found.inside[:3] / (found.parts * found.samples)
        return [
            Row(
                float(innovation[i]),
                {
                    **{name: by[i] for name, by in grows.items()},
                    "attitude": cross_product(state.C_eb[:, i], EARTH_RATE_E),
                },
                own + float(noise[i]),
            )
            for i in range(3)
        ]
