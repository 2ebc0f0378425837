"""Closed loops of coherent receivers in error states: linear motion, real discriminators, Monte Carlo of slips.

The simulation assumes what the linear theory does (``insgnss.interference.linear_threshold``) except for the linear
discriminator: the errors of a receiver's states obey its model, the discriminators see ``cos e`` and ``sin e`` in
noise, and the steady gains of the model correct. So it tests the theory's rule for loss of lock; no satellite moves,
no inertial sensor is mechanised and no filter estimates its covariance here.

    x = F (x - K D(H x)) + L w,    D = I Q or another discriminator over its slope, K of the discrete Riccati equation

- A two-stage receiver has one ``channel_model`` for each satellite. Motion and oscillator are common to all of them,
  noise is not.
- A one-stage receiver has one ``one_stage_model``: the discriminators of all channels are rows of one filter.

    runs = slip_runs(models["one_stage"], PhaseLoop(discriminator("IQ", 0.076), 1.022e6, 5e-3), 26.1, sky)
    runs.lost_runs, runs.lost_channels
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from scipy import linalg

from insgnss.errors import ConfigError
from insgnss.interference.discriminators import DISCRIMINATORS, true_noise, true_slope
from insgnss.interference.linear_threshold import require_cn0
from insgnss.interference.lock_thresholds import SLIP, phase_output
from insgnss.interference.margin import PhaseLoop, ratio
from insgnss.interference.phase_models import PhaseModel, checked_directions
from insgnss.interference.riccati import discretised, predicted_covariance
from insgnss.kernels.jit import kernel
from insgnss.results.shown import ResultDisplay
from insgnss.tables import Float64, Int64
from insgnss.tracking.admissible import seeded

_BLOCK: Final = 500  # integrations whose noise is drawn at once
NEVER: Final = -1


class ErrorLoop(NamedTuple):
    """A receiver of n states and m channels over one integration, p sources of motion and oscillator."""

    F: Float64  # (n, n)
    K: Float64  # (n, m) gains on the phases
    H: Float64  # (m, n) phases of the states [rad]
    L: Float64  # (n, p) what independent normal numbers add in a step
    kind: int  # of the discriminator, in the order of ``DISCRIMINATORS``
    per_output: float  # 1 / slope
    noise: float  # one sigma of I and of Q, the carrier's amplitude is one
    limit: float  # |e| beyond it is a slip [rad]


@dataclass(frozen=True, repr=False)
class SlipRuns(ResultDisplay):
    """Runs of one receiver at one C/N0."""

    first_slip_s: Float64  # (runs, channels) inf without a slip
    rms_rad: float  # of the phases of runs without a slip; nan where there is none

    @property
    def lost_runs(self) -> float:
        """Return the share of runs with a slip in any channel."""
        return float(np.isfinite(self.first_slip_s).any(axis=1).mean())

    @property
    def lost_channels(self) -> float:
        """Return the share of channels with a slip; of a two-stage receiver it does not depend on their number."""
        return float(np.isfinite(self.first_slip_s).mean())

    def _about(self) -> Iterator[str]:
        runs, channels = self.first_slip_s.shape
        yield f"{runs} runs of {channels} channels"
        yield f"{self.lost_runs:.1%} of the runs slip"
        yield f"phase error {self.rms_rad:.3g} rad rms in the others"


@kernel
def run_errors(
    loop: ErrorLoop, draws: Float64, first: int, x: Float64, u: Float64, slips: Int64, squares: Float64
) -> None:
    """Run one receiver over a block of integrations.

    Parameters
    ----------
    draws : (k, 2 m + p) independent normal numbers: I and Q of the channels, then the sources
    first : number of the block's first integration
    x : (2, n) errors of the predicted states, in and out in the first row
    u : (m,) room for the discriminators' outputs
    slips : (m,) number of the integration at which a channel slips first, else ``NEVER``
    squares : (m,) to which the squares of the phases are added [rad^2]
    """
    n, m, p = len(loop.F), len(loop.H), loop.L.shape[1]
    for k in range(len(draws)):
        for c in range(m):
            e = 0.0
            for i in range(n):
                e += loop.H[c, i] * x[0, i]
            squares[c] += e * e
            if abs(e) > loop.limit and slips[c] < 0:
                slips[c] = first + k
            i_sum = math.cos(e) + loop.noise * draws[k, 2 * c]
            q_sum = math.sin(e) + loop.noise * draws[k, 2 * c + 1]
            u[c] = phase_output(loop.kind, i_sum, q_sum) * loop.per_output
        for i in range(n):
            corrected = x[0, i]
            for c in range(m):
                corrected -= loop.K[i, c] * u[c]
            x[1, i] = corrected
        for i in range(n):
            led = 0.0
            for j in range(n):
                led += loop.F[i, j] * x[1, j]
            for j in range(p):
                led += loop.L[i, j] * draws[k, 2 * m + j]
            x[0, i] = led


def error_loop(model: PhaseModel, loop: PhaseLoop, cn0_dbhz: float, directions: Float64) -> ErrorLoop:
    """Return the receiver of a model that integrates for ``loop.accumulation_s`` at a time.

    A model with one phase is a channel of a two-stage receiver: there is one for each direction.

    Raises
    ------
    ConfigError : C/N0 out of range, directions that do not fit the model, or no steady state
    """
    u = checked_directions(directions)
    require_cn0(cn0_dbhz)
    alone = len(model.H) == 1
    if not alone and len(model.H) != len(u):
        advice = "give the directions of the model"
        raise ConfigError(f"{len(u)} directions for {len(model.H)} phases", key="directions", advice=advice)
    kind, T, inverse = loop.discriminator, loop.accumulation_s, ratio(-cn0_dbhz)
    step = discretised(model.A, model.Q, T)
    variance = float(true_noise(kind, inverse, T)) / (2.0 * T)
    P = predicted_covariance(step, model.H, variance)
    K = P @ model.H.T @ np.linalg.inv(model.H @ P @ model.H.T + variance * np.eye(len(model.H)))
    motion, oscillator = (_factor(discretised(model.A, Q, T).Q) for Q in (model.motion, model.oscillator))
    F, H, L = step.F, model.H, np.hstack([motion, oscillator])
    if alone:
        m = len(u)
        F, K, H = (linalg.block_diag(*[X] * m) for X in (F, K, H))
        # three equal axes act along each line of sight; the oscillator acts on all channels
        L = np.hstack([*(np.kron(-u[:, [axis]], motion) for axis in range(3)), np.tile(oscillator, (m, 1))])
    return ErrorLoop(
        np.ascontiguousarray(F),
        np.ascontiguousarray(K),
        np.ascontiguousarray(H),
        np.ascontiguousarray(L),
        [d.name for d in DISCRIMINATORS].index(kind.name),
        1.0 / float(true_slope(kind, T / inverse)),
        math.sqrt(0.5 * float(inverse) / T),
        SLIP * kind.aperture_rad,
    )


def slip_runs(
    model: PhaseModel,
    loop: PhaseLoop,
    cn0_dbhz: float,
    directions: Float64,
    *,
    runs: int = 100,
    seconds: float = 20.0,
    seed: int = 1,
    threads: int = 1,
) -> SlipRuns:
    """Return when the channels of a receiver slip: |e| beyond 0.75 of the aperture. Runs begin without errors.

    Parameters
    ----------
    model : ``channel_model`` for a two-stage receiver, ``one_stage_model`` for a one-stage receiver
    directions : (m, 3) unit vectors from user to satellites; those of the model where it has them
    seed : of all noise; the result does not depend on ``threads``

    Raises
    ------
    ConfigError : what ``error_loop`` refuses, no runs, no threads, or less than one integration
    """
    steps = round(seconds / loop.accumulation_s) if math.isfinite(seconds) else 0
    if runs < 1 or threads < 1 or steps < 1 or seed < 0:
        raise ConfigError(
            "runs, threads and integrations are whole numbers from 1 on, a seed is one from 0 on",
            key="runs" if runs < 1 else "threads" if threads < 1 else "seed" if seed < 0 else "seconds",
            advice="100 runs of 20 s give a share to 5 %",
        )
    receiver = error_loop(model, loop, cn0_dbhz, directions)

    def one(run: int) -> tuple[Int64, Float64]:
        """Return slips and squares of one run."""
        return _run(receiver, steps, seeded(seed, run))

    with ThreadPoolExecutor(threads) as pool:
        slips, squares = (np.array(column) for column in zip(*pool.map(one, range(runs)), strict=True))
    held = (slips == NEVER).all(axis=1)
    rms = math.sqrt(float(squares[held].mean()) / steps) if held.any() else math.nan
    return SlipRuns(np.where(slips == NEVER, np.inf, slips * loop.accumulation_s), rms)


def _run(receiver: ErrorLoop, steps: int, rng: np.random.Generator) -> tuple[Int64, Float64]:
    m, sources = len(receiver.H), receiver.L.shape[1]
    x, u = np.zeros((2, len(receiver.F))), np.zeros(m)
    slips, squares = np.full(m, NEVER, np.int64), np.zeros(m)
    for first in range(0, steps, _BLOCK):
        draws = rng.standard_normal((min(_BLOCK, steps - first), 2 * m + sources))
        run_errors(receiver, draws, first, x, u, slips, squares)
    return slips, squares


def _factor(covariance: Float64) -> Float64:
    """Return L, (n, r), with L L^T a covariance of rank r."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale[scale == 0.0] = 1.0
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    kept = values > 1e-12
    return np.asarray(scale[:, None] * vectors[:, kept] * np.sqrt(values[kept]))
