"""The linear theory of coherent receivers that look at their phases once in an integration of length T.

``linear_threshold`` neglects that length. With 5 ms and 40 dBHz a channel that follows 5 g on its own has B T = 0.1.
Nothing corrects its replica meanwhile, which is off by 0.088 in place of 0.076 rad. Its velocity after an update is off
by 0.24 in place of 0.26 m/s. Thresholds stay those of the continuous theory: the ratios rms to aperture belong to it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy import linalg

from insgnss.interference.discriminators import equivalent_noise
from insgnss.interference.linear_threshold import least_squares_velocity_mps, require_cn0
from insgnss.interference.margin import PhaseLoop, ratio
from insgnss.interference.optimal_loop import two_sided
from insgnss.interference.phase_models import FREQUENCY, VELOCITY, PhaseModel
from insgnss.interference.riccati import discretised, predicted_covariance
from insgnss.tables import Float64


class SampledFilter(NamedTuple):
    """The optimal filter of a phase model whose phases are seen once in a step, in the steady state."""

    P: Float64  # (n, n) before an update
    K: Float64  # (n, m) gains
    variance: float  # of one phase [rad^2]


def sampled_filter(model: PhaseModel, loop: PhaseLoop, cn0_dbhz: float) -> SampledFilter:
    """Return the optimal filter at a C/N0, one update for each ``loop.accumulation_s``.

    Equation: r = S_n / (2 T), K = P H^T (H P H^T + r I)^-1

    Raises
    ------
    ConfigError : C/N0 out of range, or a state that the phases do not bound
    """
    require_cn0(cn0_dbhz)
    T = loop.accumulation_s
    noise = equivalent_noise(loop.discriminator, ratio(-cn0_dbhz), T)
    variance = float(two_sided(noise)) / T
    P, H = predicted_covariance(discretised(model.A, model.Q, T), model.H, variance), model.H
    K = np.linalg.solve(H @ P @ H.T + variance * np.eye(len(H)), H @ P).T
    return SampledFilter(P, np.asarray(K), variance)


def sampled_phase_rms_rad(model: PhaseModel, found: SampledFilter) -> Float64:
    """Return the rms of every phase that a correlator sees, (m,): before the update."""
    return np.asarray(np.sqrt(np.einsum("ij,jk,ik->i", model.H, found.P, model.H)))


def sampled_one_stage_velocity_mps(model: PhaseModel, found: SampledFilter) -> float:
    """Return the 3-D rms of the velocity of a ``one_stage_model`` after an update [m/s]."""
    left = found.P - found.K @ model.H @ found.P
    return math.sqrt(float(np.trace(left[VELOCITY, VELOCITY])))


def sampled_two_stage_velocity_mps(
    model: PhaseModel, found: SampledFilter, step_s: float, directions: Float64, carrier_hz: float
) -> float:
    """Return the 3-D rms of the velocity by least squares over channels of a ``channel_model`` after an update [m/s].

    Equation: X = L X L^T + W, L = (I - K H) F, for W = r K K^T of the noise and (I - K H) Q_d (I - K H)^T of the
    acceleration; then as ``two_stage_velocity_mps``

    Parameters
    ----------
    step_s : T of the filter
    directions : (m, 3) unit vectors from user to satellites
    """
    left = np.eye(len(found.P)) - found.K @ model.H
    F, moved = discretised(model.A, model.motion, step_s)
    driven = (found.variance * found.K @ found.K.T, left @ moved @ left.T)
    noise, motion = (linalg.solve_discrete_lyapunov(left @ F, W)[FREQUENCY, FREQUENCY] for W in driven)
    return least_squares_velocity_mps(float(noise), float(motion), directions, carrier_hz)
