"""A receiver clock of two states, bias and drift, simulated from the h-parameters of its oscillator.

Fractional frequency has the one-sided density ``S_y(f) = h0 + h_-2 / f^2``. The clock is a function of its own reading
(the receiver's time tag T): the true time of a tag is ``t = T - bias / c``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from insgnss.config.flight import Oscillator
from insgnss.constants import C_MPS
from insgnss.tables import Float64

MILLISECOND_M = C_MPS * 1e-3  # one light-millisecond: the step by which receivers re-align their clock


@dataclass(frozen=True)
class ClockTruth:
    """Receiver clock at its tags: ``bias_m`` is ahead-of-GPS times c, ``drift_mps`` its rate without the jumps."""

    tag_s: Float64  # (m,) receiver time since the start of the trajectory
    bias_m: Float64  # (m,)
    drift_mps: Float64  # (m,)

    @property
    def true_s(self) -> Float64:
        """True time of each tag, ``t = T - bias / c``, since the start of the trajectory [s]."""
        return self.tag_s - self.bias_m / C_MPS


def clock_densities(oscillator: Oscillator) -> tuple[float, float]:
    """Return the two-sided densities that drive bias [m^2/s] and drift [m^2/s^3].

    Equation: ``S_bias = c^2 h0 / 2``, ``S_drift = c^2 2 pi^2 h_-2``    [Brown & Hwang (2012), 9.3]
    """
    return C_MPS**2 * oscillator.h0_s / 2.0, C_MPS**2 * 2.0 * np.pi**2 * oscillator.h_minus2_per_s


def simulate_clock(
    oscillator: Oscillator,
    tag_s: Float64,
    rng: np.random.Generator,
    *,
    bias_m: float = 0.0,
    drift_mps: float = 0.0,
    jump_beyond_m: float | None = None,
) -> ClockTruth:
    """Return one realisation of the clock at the given tags; exact in distribution for any spacing of the tags.

    Equation: ``b' = d + w_b``, ``d' = w_d``; over a step T the driven part has the covariance
    ``[[S_b T + S_d T^3 / 3, S_d T^2 / 2], [S_d T^2 / 2, S_d T]]``.

    Parameters
    ----------
    tag_s : (m,) increasing receiver time tags [s]
    bias_m, drift_mps : the clock at the first tag [m], [m/s]
    jump_beyond_m : the receiver steps its clock by a light-millisecond whenever the bias leaves this bound [m]
    """
    s_bias, s_drift = clock_densities(oscillator)
    step = np.diff(tag_s)
    white = rng.standard_normal((len(step), 2))
    # Cholesky factor of the covariance, from the drift to the bias
    drift_noise = np.sqrt(s_drift * step) * white[:, 0]
    bias_noise = step / 2.0 * drift_noise + np.sqrt(s_bias * step + s_drift * step**3 / 12.0) * white[:, 1]
    drift = drift_mps + np.concatenate([[0.0], np.cumsum(drift_noise)])
    bias = bias_m + np.concatenate([[0.0], np.cumsum(drift[:-1] * step + bias_noise)])
    clock = ClockTruth(tag_s, bias, drift)
    return clock if jump_beyond_m is None else with_millisecond_jumps(clock, jump_beyond_m)


def with_clock_jump(clock: ClockTruth, at_s: float, size_m: float) -> ClockTruth:
    """Return the clock with its bias stepped by ``size_m`` from the first tag at or after ``at_s``."""
    return replace(clock, bias_m=clock.bias_m + np.where(clock.tag_s >= at_s, size_m, 0.0))


def with_millisecond_jumps(clock: ClockTruth, bound_m: float) -> ClockTruth:
    """Return the clock re-aligned by whole milliseconds whenever the bias leaves ``[-bound_m, bound_m]``."""
    stepped = np.empty_like(clock.bias_m)
    offset = 0.0
    for k, free in enumerate(clock.bias_m):
        if abs(free + offset) > bound_m:
            offset -= np.rint((free + offset) / MILLISECOND_M) * MILLISECOND_M
        stepped[k] = free + offset
    return replace(clock, bias_m=stepped)
