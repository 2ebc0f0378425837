"""The filter finds its own noise levels: a factor for each kind of measurement and one for its clock, compiled.

No fixed sigma suits a survey receiver under open sky and a telephone in a street. From the satellites' residuals
against each other (``integrity``) the filter corrects its assumed variances within bounds, so that normalised
innovations are near one and sigma means something. Slow errors that persist for many epochs (atmosphere, orbits,
multipath at rest) do not show in what is left: ``slow_errors`` has what they do to the position.
"""

from __future__ import annotations

from typing import Final

from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import EpochWorkspace, Line, Lines
from insgnss.filter.rows.usual_variance import usual_variance
from insgnss.filter.state import BIAS_FACTOR, DRIFT, DRIFT_FACTOR, LEVEL_EPOCHS, StateRecord
from insgnss.filter.update.consistency import few_are_wrong, residual_variance
from insgnss.filter.update.gating import slow_variance, whole_variance
from insgnss.filter.update.integrity import (
    INTERVAL_NS,
    explain,
    explained_by,
    explained_variance,
    fit_all,
    fit_freely,
)
from insgnss.filter.update.weak_signals import follow_weak_signals
from insgnss.gnss.median import median_of
from insgnss.gnss.observation_rows import CARRIER, N_KINDS, PSEUDORANGE, RANGE_RATE
from insgnss.kernels.jit import kernel
from insgnss.status import USED
from insgnss.tables import Float64

_LARGEST_RATIO: Final = 9.0  # one row counts as at most three sigmas ...
_CUT: Final = 0.9950  # ... which leaves so much of the mean square of a normal error
_LEVELLED: Final = 0.91  # the same with levels L: mean of z^2 / L^2 over that of 1 / L, normal z (simulated)
_LARGEST_STEP: Final = 9.0
_STORM: Final = 9.0  # ratio of the median square beyond which most rows are worse than three sigmas ...
_FEW: Final = 72.0  # ... and 1 + this / n of n rows, which chance exceeds once in 10^6 epochs
_MEDIAN_SQUARE: Final = 0.4549  # of a normal error of variance one
_REST_SPEED_MPS: Final = 0.7  # slower than a walk
_MEMORIES: Final = 4.0  # of the filter in the drift: over so many their end effects are small
_BEYOND_CHANCE2: Final = 25.0  # squared sigmas of a sum
_LOUDEST_CLOCK: Final = (
    35.0  # density of its drift [m^2/s^3]: ten times that of a crystal without compensation
)
_LEAST_DENSITY: Final = 1e-15  # far below that of any clock, and a divisor
_BIAS_GAIN: Final = 0.1  # per second: a crystal does not change, and one value says little
_LEAST_BIAS_FACTOR: Final = 1e-3  # real crystals are up to that much quieter over a second than their grade
_LEAST_RESIDUALS: Final = 5  # of a kind in an epoch: fewer leave no residual to speak of


@kernel(inline=True)
def parity_ratio(lines: Lines, kind: int, fit: Float64, factor: float, levelled: bool) -> float:
    """Return the mean of e^2 / (r - g D g^T) over the used rows of one kind, e what ``fit`` does not explain.

    Equation: E[e e^T] = R - G D G^T, see ``integrity.explain``               [Mehra 1970; Mohamed & Schwarz 1999]
    Each row has the weight of its own part, 1 - g D g^T / r, and counts at most three sigmas; the part it cannot show
    counts as expected. r is the variance before the factor, so the return value is what the factor should be. What all
    satellites have in common is left out: it is the clock's or the inertial sensors', and no noise of the ranges.

    Rows that are ``levelled`` (``satellite_noise``) count by their weight, against the mean of normal errors.
    """
    total, weights = 0.0, 0.0
    used = 0
    expected = _LEVELLED if levelled else _CUT
    for j in range(lines.shape[0]):
        line: Line = lines[j]
        # a row with more noise than its own says nothing about the noise
        if line.status[kind] != USED or line.doubt > 0.0:
            continue
        rest = line.innovation[kind] - explained_by(line, kind, fit)
        left = explained_variance(line, kind, fit)
        square = rest * rest / residual_variance(line.variance[kind], left)
        own = max(1.0 - left / line.variance[kind], 0.0)
        weight = usual_variance(line, kind) / line.variance[kind]
        total += weight * (own * min(square, _LARGEST_RATIO) / expected + 1.0 - own)
        weights += weight
        used += 1
    return factor * total / weights if used >= _LEAST_RESIDUALS else factor


@kernel(apart=True)
def raise_level(
    m: StateRecord,
    P: Float64,
    lines: Lines,
    kind: int,
    fit: Float64,
    values: Float64,
    par: Parameters,
) -> None:
    """Raise the level of a kind where an epoch that is not judged yet shows that it is far too low.

    A gate at the old level would refuse the loudest rows, and what is left would count as quiet as before. What was
    learnt until now says nothing about the new level: learning starts again with this epoch.

    Where the epoch agrees with the old level but for a third of its rows at most, those are wrong: no noise has risen.
    """
    m.level_risen[kind] = 0.0
    if par.adapt_gain <= 0.0:
        return
    ratio = storm_ratio(lines, kind, fit, values)
    if not ratio > 1.0 or (par.residual_gate2 > 0.0 and few_are_wrong(P, lines, kind, par.residual_gate2)):
        return
    before = m.noise_factor[kind]
    m.noise_factor[kind] = bounded(before * ratio, par)
    risen = m.noise_factor[kind] / before
    for j in range(lines.shape[0]):
        if lines[j].status[kind] == USED:
            lines[j].variance[kind] += (risen - 1.0) * usual_variance(lines[j], kind)
    if m.level_epochs[kind] > LEVEL_EPOCHS:
        m.level_risen[kind] = risen
    m.level_epochs[kind] = 0


@kernel(inline=True)
def storm_ratio(lines: Lines, kind: int, fit: Float64, values: Float64) -> float:
    """Return by how much most rows of a kind are worse than assumed; 1 where they are not, or too few.

    The median of squares, against the prediction and against the rows' common part. Both must be beyond chance: a few
    satellites that are wrong do not move the first, a wrong prediction does not move the second. Then the larger
    counts, as the median of a few rows often is far too small.
    """
    largest = 1.0
    for turn in range(2):
        if turn == 1 and fit_freely(lines, kind, fit) == 0 and not fit_all(lines, kind, fit):
            return 1.0
        n = 0
        for j in range(lines.shape[0]):
            line: Line = lines[j]
            if line.status[kind] != USED:
                continue
            rest, own = line.innovation[kind], whole_variance(line, kind)
            if turn == 1:
                rest -= explained_by(line, kind, fit)
                left = explained_variance(line, kind, fit)
                own = residual_variance(line.variance[kind], left)
                own += slow_variance(line, kind)
            values[n] = rest * rest / own
            n += 1
        if n <= _LEAST_RESIDUALS:
            return 1.0
        ratio = median_of(values, n) / _MEDIAN_SQUARE
        if not ratio > max(_STORM, 1.0 + _FEW / n):
            return 1.0
        largest = max(largest, ratio)
    return largest


@kernel(apart=True)
def adapt_noise(
    m: StateRecord,
    prior: Float64,
    P: Float64,
    par: Parameters,
    s: EpochWorkspace,
    n: int,
    t_ns: int,
) -> None:
    """Move the factors of a hypothesis towards what an epoch's update shows.

    At rest the pseudoranges' factor does not fall far: multipath stands still then and does not show in what is left.
    The clock's drift: ``follow_drift``. The factor of its bias shows in what the carrier differences have in common;
    without them it is held in step with the drift's.

    Parameters
    ----------
    prior, P : covariance before and after the update
    s, n : the epoch's work space, with the correction that is not fed back yet, and how many lines it has
    """
    if par.adapt_gain <= 0.0:
        return
    m.drift_moved[0] += s.vectors[0, DRIFT]
    m.drift_moved[1] += prior[DRIFT, DRIFT] - P[DRIFT, DRIFT]
    if t_ns - m.adapted_ns < INTERVAL_NS:
        return
    lines, fit = s.lines[:n], s.fit
    since_s = (t_ns - m.adapted_ns) * 1e-9
    m.adapted_ns = t_ns
    m.adapted_count += 1
    gain = max(par.adapt_gain, 1.0 / (m.adapted_count + 5.0))
    v2 = m.v_e[0] * m.v_e[0] + m.v_e[1] * m.v_e[1] + m.v_e[2] * m.v_e[2]
    at_rest = v2 < _REST_SPEED_MPS**2
    for kind in range(N_KINDS if par.at_clone >= 0 else CARRIER):
        factor = m.noise_factor[kind]
        m.level_epochs[kind] += 1
        if not explain(prior, lines, kind, fit):
            continue
        if kind == PSEUDORANGE and par.weak_signal2 > 0.0:
            follow_weak_signals(m, par, lines, fit, since_s)
        levelled = kind == RANGE_RATE and par.rate_memory_s > 0.0
        wanted = parity_ratio(lines, kind, fit, factor, levelled)
        if kind == PSEUDORANGE and at_rest:
            wanted = max(wanted, min(factor, par.adapt_least_at_rest))
        share = max(par.adapt_gain, 1.0 / m.level_epochs[kind])
        m.noise_factor[kind] = bounded(factor + share * (wanted - factor), par)
    if m.adapted_count > 5:
        follow_drift(m, par, P[DRIFT, DRIFT], gain)
    common = common_ratio(lines)
    if common < 0.0:
        m.noise_factor[BIAS_FACTOR] = min(m.noise_factor[DRIFT_FACTOR], par.adapt_most)
    elif m.adapted_count > 5:
        factor = m.noise_factor[BIAS_FACTOR] * (1.0 + max(gain, _BIAS_GAIN) * (common - 1.0))
        m.noise_factor[BIAS_FACTOR] = max(min(factor, par.adapt_most), _LEAST_BIAS_FACTOR)


@kernel(inline=True)
def follow_drift(m: StateRecord, par: Parameters, variance: float, gain: float) -> None:
    """Move the factor of the clock drift's noise by what the drift's corrections since the last time sum up to.

    Equation: E[(sum K nu)^2] = sum (P- - P+), as innovations are white while the assumed noise is right.

    A correction alone does not show the drift's noise: where that of the measurements is far larger, K nu has the
    variance K^2 r = P- - P+ whatever the drift does, and a factor too small is never found out. Over several times the
    filter's memory, P / q, the sum is what the drift itself has moved. A sum far beyond chance is not waited for: the
    clock is another one than declared, and until the factor has risen the filter takes its drift for motion.

    Parameters
    ----------
    variance : P+, of the drift [m^2/s^2]
    gain : weight of one sum
    """
    square, expected = m.drift_moved[0] * m.drift_moved[0], m.drift_moved[1]
    surprise = square > _BEYOND_CHANCE2 * expected
    if not expected > 0.0 or not (surprise or expected > _MEMORIES * variance):
        return
    m.drift_moved[0] = m.drift_moved[1] = 0.0
    ratio = square / expected
    moved = ratio if surprise else 1.0 + gain * (min(ratio, _LARGEST_STEP) - 1.0)
    density = max(par.clock_drift_density, _LEAST_DENSITY)
    most = max(par.adapt_most, _LOUDEST_CLOCK / density)
    m.noise_factor[DRIFT_FACTOR] = min(max(m.noise_factor[DRIFT_FACTOR] * moved, par.adapt_least), most)


@kernel(inline=True)
def common_ratio(lines: Lines) -> float:
    """Return the square of what the carrier differences of an epoch have in common over its expectation, or -1.

    Over one interval the common part is the clock's wander and little else; -1 means too few rows.
    """
    total = 0.0
    predicted = 0.0
    used = 0
    for j in range(lines.shape[0]):
        if lines[j].status[CARRIER] == USED and not lines[j].doubt > 0.0:
            total += lines[j].innovation[CARRIER]
            predicted += lines[j].predicted[CARRIER]
            used += 1
    if used < _LEAST_RESIDUALS or not predicted > 0.0:
        return -1.0
    return min(total * total / (used * predicted), _LARGEST_STEP)


@kernel(inline=True)
def bounded(factor: float, par: Parameters) -> float:
    """Return the factor within the bounds of the settings."""
    return float(min(max(factor, par.adapt_least), par.adapt_most))
