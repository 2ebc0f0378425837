"""Where a phase loop loses lock, by Monte Carlo: mean time to slip of the optimal loop, and C_A as a function of it.

The loop is simulated at its correlators' sums: ``I = cos(e) + n``, ``Q = sin(e) + n`` with noise of variance 1/(2 q T),
the discriminator, and the discrete loop that is optimal for drift and noise. At every level the loop is rematched: a
level is C_A, rms of the *linear theory* over the aperture, and the loop's bandwidth B is kept. A slip is an error
beyond 0.75 of the aperture, from where the next stable point draws; then the loop restarts without error.

Time is counted in periods T, so that a level, B T and the discriminator fix everything. Densities are one-sided.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from scipy import optimize, stats

from insgnss.errors import ConfigError
from insgnss.interference.checks import positive
from insgnss.interference.discriminators import (
    DISCRIMINATORS,
    Discriminator,
    inverse_cn0,
    true_noise,
    true_slope,
)
from insgnss.interference.optimal_loop import check_bandwidth_time, discrete_gains
from insgnss.kernels.compiled_ahead import usable_cores
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64, Int64

# From a lifetime of 2000 / B down to one of 70 / B: the lines through them reach what table 1 asks for
LEVELS: Final = (0.066, 0.070, 0.074, 0.079, 0.085, 0.091)
# mean time to slip times B at which table 1 was found      [by simulation, see the tests]
LIFETIME: Final = 300.0
SLIP: Final = 0.75  # of the aperture
_LOOPS: Final = 64  # that one generator drives side by side
_GENERATORS: Final = 8  # fixed: the result does not depend on the number of workers
_STEPS: Final = 256  # of noise drawn at a time, 0.5 MiB: it stays in the cache
_MOST_STEPS: Final = 4_000_000_000  # in all, for one level: then it counts with the slips it has


class SlipLoop(NamedTuple):
    """A loop in units of its period and of radians."""

    kind: int  # which discriminator, in the order of ``DISCRIMINATORS``
    alpha: float
    beta: float
    noise: float  # one sigma of I and of Q, the carrier's amplitude is one
    per_output: float  # what makes a phase of the discriminator's output: 1 / slope
    walk: float  # one sigma of the frequency's increment in a period [rad]
    limit: float  # |e| beyond it is a slip [rad]


@kernel(inline=True)
def phase_output(kind: int, i: float, q: float) -> float:
    """Return a discriminator's output for one pair of sums."""
    if kind == 0:
        return q
    if kind == 1:
        return math.atan(q / i) if i != 0.0 else 0.0
    if kind == 2:
        return q if i >= 0.0 else -q
    return i * q


@kernel
def count_slips(loop: SlipLoop, draws: Float64, state: Float64, slips: Int64, squares: Float64) -> None:
    """Run m loops side by side through n periods; those that slip restart without error.

    Equation: u = D(I, Q) / slope, e -= alpha u, w -= beta u; then e += w + walk (g2 / 2 + g3 / sqrt 12), w += walk g2

    Parameters
    ----------
    draws : (m, n, 4) standard normal numbers: of I, of Q, of frequency, of the remaining phase
    state : (m, 2) phase and frequency error, predicted, in and out
    slips : (m,) to which the slips are added
    squares : (m,) to which the squares of the predicted errors are added [rad^2]
    """
    of_phase = math.sqrt(1.0 / 12.0)
    for k in range(draws.shape[0]):
        e, w, total, count = state[k, 0], state[k, 1], 0.0, 0
        for t in range(draws.shape[1]):
            i = math.cos(e) + loop.noise * draws[k, t, 0]
            q = math.sin(e) + loop.noise * draws[k, t, 1]
            u = phase_output(loop.kind, i, q) * loop.per_output
            e -= loop.alpha * u
            w -= loop.beta * u
            total += e * e
            pushed = loop.walk * draws[k, t, 2]
            e += w + 0.5 * pushed + loop.walk * of_phase * draws[k, t, 3]
            w += pushed
            if abs(e) > loop.limit:
                count += 1
                e, w = 0.0, 0.0
        state[k, 0], state[k, 1] = e, w
        slips[k] += count
        squares[k] += total


def slip_loop(kind: Discriminator, level: float, bandwidth_time: float, normalised: bool = True) -> SlipLoop:
    """Return the loop that is optimal where the linear theory's rms is ``level`` of the aperture.

    Equation: S_n = 3 (A C)^2 / (4 B), K2 = (4 sqrt 2 B / 3)^2, S = K2^2 S_n, T = 1, and q from S_n

    Parameters
    ----------
    normalised : the output is divided by its true slope, below one in noise, and S_n is its noise then
        (``true_noise``); else the slope counts as one and S_n is that of (19), (20)
    """
    S_n = 0.75 * (kind.aperture_rad * level) ** 2 / bandwidth_time
    K2 = (4.0 * math.sqrt(2.0) / 3.0 * bandwidth_time) ** 2
    S = K2**2 * S_n
    x = _inverse_noise(kind, S_n) if normalised else float(inverse_cn0(kind, S_n, 1.0))
    alpha, beta = discrete_gains(S, S_n, 1.0)
    slope = float(true_slope(kind, 1.0 / x)) if normalised else 1.0
    return SlipLoop(
        [d.name for d in DISCRIMINATORS].index(kind.name),
        float(alpha),
        float(beta),
        math.sqrt(0.5 * x),
        1.0 / slope,
        math.sqrt(0.5 * S),
        SLIP * kind.aperture_rad,
    )


def _inverse_noise(kind: Discriminator, S_n: float) -> float:
    """Return 1 / q at which ``true_noise`` is S_n, for T = 1."""
    high = float(inverse_cn0(kind, S_n, 1.0))
    while float(true_noise(kind, high, 1.0)) < S_n:
        high *= 2.0

    def excess(x: float) -> float:
        return float(true_noise(kind, x, 1.0)) - S_n

    return float(optimize.brentq(excess, 1e-3 * high, high, rtol=1e-12))


@dataclass(frozen=True)
class LockThreshold:
    """Lifetimes of one discriminator's loop at several levels, and the level of a wanted lifetime.

    Lifetimes are mean times to slip times B, the one-sided noise bandwidth of the optimal loop.
    """

    discriminator: Discriminator
    bandwidth_time: float  # B T
    level: Float64  # (n,) C_A: rms of the linear theory over the aperture
    lifetime: Float64  # (n,)
    low: Float64  # (n,) bounds of 95 %
    high: Float64  # (n,)
    # (n,) rms of the simulated error over the aperture: larger, the loop is not linear any more
    measured: Float64
    slips: Int64  # (n,)

    def ratio(self, lifetime: float = LIFETIME) -> float:
        """Return C_A of a mean time to slip of ``lifetime`` / B, by a parabola through the logarithms.

        Raises
        ------
        ConfigError : the levels do not reach that lifetime
        """
        least, most = self.lifetime.min(), self.lifetime.max()
        if not least <= lifetime <= most:
            raise ConfigError(
                f"the levels reach from {least:.0f} / B to {most:.0f} / B, not to {lifetime:g} / B",
                key="lifetime",
                advice="simulate more levels: lower ones live longer",
            )
        x, y = np.log(self.lifetime / LIFETIME), np.log(self.level)
        line = np.polynomial.Polynomial.fit(x, y, min(2, len(x) - 1), w=np.sqrt(self.slips))
        return float(np.exp(line(math.log(lifetime / LIFETIME))))


def lock_threshold(
    kind: Discriminator,
    rng: np.random.Generator,
    *,
    levels: Sequence[float] = LEVELS,
    bandwidth_time: float = 0.05,
    slips: int = 800,
    normalised: bool = True,
    workers: int | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> LockThreshold:
    """Return lifetimes of the optimal loop of a discriminator, by simulation.

    Parameters
    ----------
    rng : drives everything; the same generator gives the same numbers with any number of workers
    levels : C_A, at least two
    bandwidth_time : B T of the loop; small ones are nearer to continuous time and take longer
    slips : to be waited for at each level: their number's root gives the precision, 3.5 % of the lifetime, 0.3 % of C_A
    normalised : see ``slip_loop``
    workers : threads; as many as there are cores when None
    progress : called with the discriminator's name and the share that is done

    Raises
    ------
    ConfigError : levels, bandwidth or number of slips make no sense
    """
    wanted = positive("levels", levels, "rms over aperture, such as 0.076")
    check_bandwidth_time(positive("bandwidth_time", bandwidth_time, "0.05, say"), 1.0)
    if len(wanted) < 2 or wanted.max() >= 0.25 or slips < 10:
        raise ConfigError(
            "two levels below 0.25 and ten slips are the least that say something",
            key="levels" if slips >= 10 else "slips",
            advice="levels from 0.066 to 0.091 and 800 slips give C_A to 0.3 %",
        )
    rows = []
    with ThreadPoolExecutor(workers or usable_cores()) as pool:
        for done, level in enumerate(wanted):
            if progress is not None:
                progress(kind.name, done / len(wanted))
            loop = slip_loop(kind, float(level), bandwidth_time, normalised)
            rows.append(_lifetime(loop, rng.spawn(_GENERATORS), slips, pool))
    if progress is not None:
        progress(kind.name, 1.0)
    count, steps, squares = (np.array(column) for column in zip(*rows, strict=True))
    time = steps * bandwidth_time
    return LockThreshold(
        kind,
        bandwidth_time,
        wanted,
        time / count,
        2.0 * time / stats.chi2.ppf(0.975, 2 * count + 2),
        2.0 * time / stats.chi2.ppf(0.025, 2 * count),
        np.sqrt(squares / steps) / kind.aperture_rad,
        count.astype(np.int64),
    )


def _lifetime(
    loop: SlipLoop, generators: Sequence[np.random.Generator], slips: int, pool: ThreadPoolExecutor
) -> tuple[int, int, float]:
    """Return slips, periods and the sum of squared errors of loops that ran until enough of them had slipped."""
    groups = [_Group(loop, generator) for generator in generators]
    rounds = 1
    while True:
        # every group runs as far as the others, however many threads there are
        list(pool.map(_Group.run, groups, [rounds] * len(groups)))
        count = sum(int(group.slips.sum()) for group in groups)
        steps = sum(group.steps for group in groups) * _LOOPS
        if count >= slips or steps >= _MOST_STEPS:
            return max(count, 1), steps, float(sum(group.squares.sum() for group in groups))
        # half of what seems to be missing: the last rounds are short
        rounds = max(1, int(0.5 * (slips / max(count, 1) - 1.0) * groups[0].steps / _STEPS))
        rounds = min(rounds, 2 * groups[0].steps // _STEPS)


class _Group:
    """Loops that one generator drives."""

    def __init__(self, loop: SlipLoop, generator: np.random.Generator) -> None:
        self.loop = loop
        self.generator = generator
        self.draws = np.empty((_LOOPS, _STEPS, 4))
        self.state = np.zeros((_LOOPS, 2))
        self.slips = np.zeros(_LOOPS, np.int64)
        self.squares = np.zeros(_LOOPS)
        self.steps = 0

    def run(self, rounds: int) -> None:
        for _ in range(rounds):
            self.generator.standard_normal(out=self.draws)
            count_slips(self.loop, self.draws, self.state, self.slips, self.squares)
            self.steps += _STEPS
