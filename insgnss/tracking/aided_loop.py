"""The loop aided by an inertial system (Shatilov 2009): optimum gains, bandwidth and threshold by aiding quality.

The aiding takes the motion out of the loop, which has to follow only the drift of its oscillator and of the aiding's
error, dw_S = dw_osc - dw_INS, whose derivative has the one-sided density S_S = S_osc + S_INS. Everything here is the
digital loop, from its Riccati equation; for small B T it becomes the paper's continuous one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import linalg, optimize

from insgnss.errors import ConfigError
from insgnss.tables import Float64
from insgnss.tracking.admissible import require_positive, signal_ratio
from insgnss.tracking.aiding_source import AidingSource
from insgnss.tracking.channel_kernel import Aid
from insgnss.tracking.discriminators import equivalent_variance
from insgnss.tracking.loop_filters import ORDERS, LoopFilter, transition
from insgnss.tracking.phase_discriminators import PhaseDiscriminator
from insgnss.tracking.phase_motion import wander_covariance

# rms error over aperture at which the loop is said to lose lock; table 1 and its discussion in Shatilov 2009
THRESHOLD_RATIO: Final = 0.076
_CN0_SPAN_DBHZ: Final = (-20.0, 90.0)


class OptimumLoop(NamedTuple):
    """The optimum loop for a dynamics density and an observation noise."""

    filter: LoopFilter
    predicted: Float64  # (order, order) covariance of the prediction, which the replica follows
    bandwidth_hz: float  # true one-sided noise bandwidth


class AidingCurve(NamedTuple):
    """Performance of loops as a function of their aiding quality, (n,)."""

    density: Float64  # S_S, one-sided [rad^2/s^3]
    rms_rad: Float64  # at the C/N0 asked for
    bandwidth_hz: Float64  # at the C/N0 asked for
    threshold_dbhz: Float64
    threshold_bandwidth_hz: Float64


def optimum_loop(density: float, variance: float, step_s: float, order: int = 2) -> OptimumLoop:
    """Return the loop of least error for a dynamics density and a variance of the equivalent observation.

    Equation: P = F P F^T - F P h (h^T P h + D)^-1 h^T P F^T + Q, L = P h / (h^T P h + D); for small B T the continuous
              K2 = sqrt(S_S / S_n), K1 = sqrt(2 K2), S_n = 2 T D                  [(10) of Shatilov 2009]

    Parameters
    ----------
    density : S_S, one-sided, of the derivative of the last state: [rad^2/s^3] for order 2
    variance : D of one observation [rad^2]
    step_s : integration time
    order : number of states

    Raises
    ------
    ConfigError : a density or variance that is not positive, or no such order
    """
    require_positive(density=density, variance=variance, step_s=step_s)
    if order not in ORDERS:
        raise ConfigError(f"no loop of order {order}", key="order", advice="take 1, 2 or 3")
    # states over powers of the loop's own time constant, in units of the noise: all elements of one size
    w = min((density * step_s / variance) ** (0.5 / order), 1.0 / step_s)
    scale = w ** np.arange(order) * np.sqrt(variance)
    F = transition(order, step_s) * scale[None, :] / scale[:, None]
    Q = wander_covariance(order, density, step_s) / np.outer(scale, scale)
    h = np.zeros((order, 1))
    h[0] = 1.0
    P = linalg.solve_discrete_are(F.T, h, Q, np.eye(1))
    gains = P[:, 0] / (P[0, 0] + 1.0) * scale / scale[0]
    loop = LoopFilter(np.asarray(gains), np.zeros(order), step_s)
    return OptimumLoop(loop, np.asarray(P * np.outer(scale, scale)), loop.noise_bandwidth_hz())


def aided_loop(
    density: float, cn0_dbhz: float, step_s: float, phase_kind: str = "iq", order: int = 2
) -> OptimumLoop:
    """Return the optimum loop for a C/N0 and a discriminator: ``optimum_loop`` with its equivalent noise.

    Equation: D = var u / S^2 at no offset; of iq S_n = 2 T D = (1 + 1 / (2 q T)) / q      [(20) of Shatilov 2009]
    """
    variance = equivalent_variance(PhaseDiscriminator(phase_kind), signal_ratio(cn0_dbhz, step_s))
    return optimum_loop(density, variance, step_s, order)


def threshold_cn0_dbhz(
    density: float,
    step_s: float,
    phase_kind: str = "iq",
    ratio: float = THRESHOLD_RATIO,
    order: int = 2,
) -> float:
    """Return the C/N0 at which the optimum loop's rms error reaches a share of the aperture [dBHz].

    Equation: P11 = (ratio aperture)^2; small B T: S_n = (ratio aperture)^(8/3) (4 / S_S)^(1/3)  [(18) of Shatilov 2009]

    Raises
    ------
    ConfigError : no C/N0 reaches that, because the integration is too long for the dynamics
    """
    require_positive("0.076 is the engineering figure", ratio=ratio)
    limit = ratio * PhaseDiscriminator(phase_kind).aperture_rad

    def excess(cn0_dbhz: float) -> float:
        return (
            float(aided_loop(density, cn0_dbhz, step_s, phase_kind, order).predicted[0, 0]) / limit**2 - 1.0
        )

    low, high = _CN0_SPAN_DBHZ
    if excess(high) > 0.0:
        raise ConfigError(
            f"a loop of {step_s:g} s cannot follow a dynamics density of {density:g}: its error stays above the limit",
            key="density",
            advice="integrate shorter, or aid the loop better",
        )
    return float(optimize.brentq(excess, low, high, xtol=1e-9))


def aiding_curve(
    densities: npt.ArrayLike,
    cn0_dbhz: float,
    step_s: float,
    phase_kind: str = "iq",
    ratio: float = THRESHOLD_RATIO,
    order: int = 2,
) -> AidingCurve:
    """Return error and bandwidth at a C/N0, threshold and bandwidth there, for each quality of aiding.

    Parameters
    ----------
    densities : S_S = S_osc + S_INS, one-sided [rad^2/s^3], (n,)
    cn0_dbhz, step_s, phase_kind, ratio, order : as above
    """
    rows = []
    for density in np.atleast_1d(np.asarray(densities, float)):
        here = aided_loop(float(density), cn0_dbhz, step_s, phase_kind, order)
        threshold = threshold_cn0_dbhz(float(density), step_s, phase_kind, ratio, order)
        there = aided_loop(float(density), threshold, step_s, phase_kind, order)
        rows.append(
            (density, np.sqrt(here.predicted[0, 0]), here.bandwidth_hz, threshold, there.bandwidth_hz)
        )
    return AidingCurve(*np.array(rows).T)


def inertial_sources(
    t_s: Float64,
    rate_radps: Float64,
    acceleration_radps2: Float64 | None,
    error_density: float,
    latency_s: float,
    rng: np.random.Generator,
) -> Sequence[Sequence[AidingSource]]:
    """Return, for each channel, an inertial system's aiding with a random walk of its own in it.

    Parameters
    ----------
    t_s : times of the inertial system's output, (k,)
    rate_radps : true rates of the carrier phase then, (k, m)
    acceleration_radps2 : true derivatives, (k, m), where the system gives them; else the rate is held
    error_density : S_INS of (5), one-sided [rad^2/s^3]
    latency_s : from validity to use
    """
    found = []
    for c in range(rate_radps.shape[1]):
        acceleration = None if acceleration_radps2 is None else acceleration_radps2[:, c]
        source = AidingSource(t_s, rate_radps[:, c], acceleration, latency_s, error_density)
        found.append([source.with_errors(rng)])
    return found


def held_error_radps(acceleration_radps2: float, update_s: float, latency_s: float) -> tuple[float, float]:
    """Return mean and largest rate error of aiding that is held between updates, under a steady acceleration.

    Equation: mean a (latency + update / 2), largest a (latency + update)
    """
    size = abs(acceleration_radps2)
    return size * (latency_s + 0.5 * update_s), size * (latency_s + update_s)


def perfect_aid(phase_rad: Float64, step_s: float) -> Aid:
    """Return error-free aiding from known phases (n + 1, m).

    Equation: central differences at the borders of the integrations
    """
    rate = np.gradient(phase_rad, step_s, axis=0)
    return Aid(np.asarray(rate), np.zeros_like(rate))
