"""The linear theory of coherent receivers: phase errors, velocity errors and the C/N0 at which lock is lost.

The covariance P of a ``PhaseModel`` is that of its optimal filter in the steady state; its rows have the
discriminator's noise. Lock is lost at the C/N0 at which the largest phase rms, of the diagonal of ``H P H^T``, reaches
A_d C_A                                                             [Shatilov 2009, (14); 2007, chapter 2]

    sky = directions(azimuth_deg, elevation_deg)
    models = receiver_models(UnknownAcceleration(49.03, 1 / 0.3), UnknownAcceleration(0.06, 100.0, 0.1, 1e-3),
                             drift=100.0, carrier_hz=1.6e9, directions=sky)
    loop = PhaseLoop(discriminator("IQ", ENGINEERING_RATIO), bandwidth_hz=1.022e6, accumulation_s=1e-3)
    phase_threshold(models["one_stage_ins"], loop).js_db                    # 38.37
    two_stage_velocity_mps(models["two_stage"], loop, 40.0, sky, 1.6e9)     # 0.264

Densities are one-sided. Neglects: the loop's period, so B T has to be small against one (``check_bandwidth_time``); the
non-linearity of the discriminator: near the threshold true errors are larger. Without white parts the loop of
``channel_model`` is the one of ``third_order``, in closed form; that one is used where a threshold is wanted at every
sample of a path.

Receivers look at their phases once in an integration of length T, which errors of a ``sampled_filter`` do not neglect.
With 5 ms and 40 dBHz a channel that follows 5 g on its own has B T = 0.1. Nothing corrects its replica meanwhile, which
is off by 0.088 in place of 0.076 rad. Its velocity after an update is off by 0.24 in place of 0.26 m/s. Thresholds stay
those of the continuous theory: the ratios rms to aperture belong to it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from scipy import linalg, optimize

from insgnss.errors import ConfigError
from insgnss.interference.discriminators import equivalent_noise
from insgnss.interference.drift import per_mps
from insgnss.interference.margin import PhaseLoop, db, ratio
from insgnss.interference.optimal_loop import two_sided
from insgnss.interference.phase_models import (
    CHANNEL_STATES,
    FREQUENCY,
    ONE_STAGE_STATES,
    POSITION,
    VELOCITY,
    PhaseModel,
    checked_directions,
)
from insgnss.interference.riccati import (
    ErrorSources,
    discretised,
    error_sources,
    predicted_covariance,
    steady_covariance,
)
from insgnss.tables import Float64

LOWEST_CN0_DBHZ: Final = -10.0  # below it no receiver tracks, whatever aids it
HIGHEST_CN0_DBHZ: Final = 90.0


class PhaseThreshold(NamedTuple):
    """Where a receiver loses lock by the linear theory."""

    cn0_dbhz: float
    js_db: float  # J/S against the signal's band, thermal noise left out
    bandwidth_hz: float  # one-sided noise bandwidth there: noise variance over S_n, of the worst phase


def phase_covariance(model: PhaseModel, loop: PhaseLoop, cn0_dbhz: float) -> Float64:
    """Return the steady covariance of the states at a C/N0, (n, n).

    Raises
    ------
    ConfigError : C/N0 out of range, or a state that the phases do not bound
    """
    return steady_covariance(model.A, model.Q, model.H, float(two_sided(_noise(loop, cn0_dbhz))))


def phase_rms_rad(model: PhaseModel, loop: PhaseLoop, cn0_dbhz: float) -> Float64:
    """Return the rms of every tracked phase, (m,), before the update: square roots of the diagonal of H P H^T."""
    P = phase_covariance(model, loop, cn0_dbhz)
    return np.asarray(np.sqrt(np.einsum("ij,jk,ik->i", model.H, P, model.H)))


def phase_threshold(model: PhaseModel, loop: PhaseLoop) -> PhaseThreshold:
    """Return the C/N0 at which the largest phase rms reaches A_d C_A, and J/S = 10 lg DF_c - C/N0.

    Raises
    ------
    ConfigError : lock holds at -10 dBHz, or goes at 90 dBHz
    """
    cn0 = threshold_cn0_dbhz(lambda cn0_dbhz: phase_rms_rad(model, loop, cn0_dbhz), loop)
    return PhaseThreshold(cn0, float(db(loop.bandwidth_hz)) - cn0, noise_bandwidth_at(model, loop, cn0))


def threshold_cn0_dbhz(
    rms_rad: Callable[[float], Float64],
    loop: PhaseLoop,
    highest_dbhz: float = HIGHEST_CN0_DBHZ,
    precision_db: float = 1e-9,
) -> float:
    """Return the C/N0 at which the largest of the phases' rms reaches A_d C_A.

    Parameters
    ----------
    rms_rad : gives the rms of the phases at a C/N0 [dBHz]

    Raises
    ------
    ConfigError : lock holds at -10 dBHz, or goes at ``highest_dbhz``
    """

    def excess(cn0_dbhz: float) -> float:
        return math.log(float(np.max(rms_rad(cn0_dbhz))) / loop.discriminator.threshold_rms_rad)

    if excess(LOWEST_CN0_DBHZ) < 0.0 or excess(highest_dbhz) > 0.0:
        raise ConfigError(
            f"there is no threshold between {LOWEST_CN0_DBHZ:g} and {highest_dbhz:g} dBHz",
            key="cn0_dbhz",
            advice="check motion, drift and discriminator",
        )
    return float(optimize.brentq(excess, LOWEST_CN0_DBHZ, highest_dbhz, xtol=precision_db))


def noise_bandwidth_at(model: PhaseModel, loop: PhaseLoop, cn0_dbhz: float) -> float:
    """Return the one-sided noise bandwidth of the optimal receiver, of its worst phase [Hz].

    Equation: variance that the noise alone makes, over S_n; of one channel B = int |H(f)|^2 df
    """
    noise = _sources(model, loop, cn0_dbhz).noise
    variance = np.max(np.einsum("ij,jk,ik->i", model.H, noise, model.H))
    return float(variance) / _noise(loop, cn0_dbhz)


def one_stage_velocity_mps(model: PhaseModel, loop: PhaseLoop, cn0_dbhz: float) -> float:
    """Return the 3-D rms of the velocity of a ``one_stage_model`` [m/s]: root of the trace of its block of P.

    Raises
    ------
    ConfigError : another model, or what ``phase_covariance`` refuses
    """
    _require_states(model, ONE_STAGE_STATES, "one_stage_model")
    return math.sqrt(float(np.trace(phase_covariance(model, loop, cn0_dbhz)[VELOCITY, VELOCITY])))


def two_stage_velocity_mps(
    model: PhaseModel, loop: PhaseLoop, cn0_dbhz: float, directions: Float64, carrier_hz: float
) -> float:
    """Return the 3-D rms of the velocity by least squares over the frequencies of channels of a ``channel_model``.

    Equation: the errors of the channels' frequencies come from noise (independent), from the acceleration (common: u_i
    times that of three alike axes) and from the oscillator (equal: the clock takes it), with variances s_n, s_a, s_o of
    one channel by Lyapunov's equation; least squares of all directions and the clock leaves
    ``(s_n tr C + 3 s_a) / k^2``, C the block of velocity of ``(U^T U)^-1``, U = [-u, 1].

    Parameters
    ----------
    directions : (m, 3) unit vectors from user to satellites
    carrier_hz : that of the model

    Raises
    ------
    ConfigError : another model, directions that do not separate position from clock, C/N0 out of range
    """
    _require_states(model, CHANNEL_STATES, "channel_model")
    noise, motion, _ = (part[FREQUENCY, FREQUENCY] for part in _sources(model, loop, cn0_dbhz))
    return least_squares_velocity_mps(float(noise), float(motion), directions, carrier_hz)


def least_squares_velocity_mps(noise: float, motion: float, directions: Float64, carrier_hz: float) -> float:
    """Return the 3-D rms of the velocity by least squares over channels whose frequencies have these variances [m/s].

    Equation: (s_n tr C + 3 s_a) / k^2, C the block of velocity of ``(U^T U)^-1``, U = [-u, 1]

    Parameters
    ----------
    noise, motion : s_n, of each channel by itself, and s_a, by an acceleration common to all [rad^2/s^2]
    directions : (m, 3) unit vectors from user to satellites

    Raises
    ------
    ConfigError : directions that do not separate position from clock
    """
    u = checked_directions(directions)
    U = np.column_stack([-u, np.ones(len(u))])
    dilution = float(np.trace(np.linalg.inv(U.T @ U)[POSITION, POSITION]))
    return math.sqrt(noise * dilution + 3.0 * motion) / per_mps(carrier_hz)


def _require_states(model: PhaseModel, count: int, maker: str) -> None:
    if len(model.A) != count:
        raise ConfigError(
            f"expected a model of {maker}, got {len(model.A)} states",
            key="model",
            advice=f"make the model with {maker}",
        )


def require_cn0(cn0_dbhz: float, highest_dbhz: float = HIGHEST_CN0_DBHZ) -> None:
    """Refuse a C/N0 at which no receiver works.

    Raises
    ------
    ConfigError : it is below -10 dBHz or above ``highest_dbhz``
    """
    if not LOWEST_CN0_DBHZ <= cn0_dbhz <= highest_dbhz:
        raise ConfigError(
            f"C/N0 of {cn0_dbhz:g} dBHz is outside of {LOWEST_CN0_DBHZ:g} ... {highest_dbhz:g} dBHz",
            key="cn0_dbhz",
            advice="give C/N0 in dBHz; receivers see 10 to 60",
        )


def _noise(loop: PhaseLoop, cn0_dbhz: float) -> float:
    """Return S_n of the discriminator's phase at a C/N0, one-sided [rad^2/Hz]."""
    require_cn0(cn0_dbhz)
    return float(equivalent_noise(loop.discriminator, ratio(-cn0_dbhz), loop.accumulation_s))


def _sources(model: PhaseModel, loop: PhaseLoop, cn0_dbhz: float) -> ErrorSources:
    noise = float(two_sided(_noise(loop, cn0_dbhz)))
    return error_sources(model.A, model.motion, model.oscillator, model.H, noise)


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
