"""What range errors that last do to a filter that takes them for noise (consider analysis), compiled.

Orbits and clocks of the messages, and what the models of ionosphere and troposphere leave, last for about an hour,
reflections (``reflections``) for seconds to minutes. No gain is made for them, so they pass into the state
e = estimate - truth by the gains of the ranges that have them. Each is a Gauss-Markov process b of unit variance. With
e = S b + c, c what earlier values of the errors have left, of covariance R, a step over the time t and a row h with the
load a of the errors on its measurement make

    R <- R + S (I - f^2) S^T,           S <- S f,                f = exp(-t / correlation time)
    R <- (I - K h) R (I - K h)^T,       S <- S + K (a - h S),    P_total = P + S S^T + R

which is exact for these very gains: whatever the geometry, however long an outage, and whichever satellites come and
go. a is zero but for pseudoranges: rates and carrier differences have these errors only as far as they change.
Neglects: what they do to velocity, attitude and sensors, which the rates hold. Only the leading heading is followed.
Of a satellite that has not been seen for longest, R alone is left when another one needs its place.

[Schmidt 1966, Application of state-space methods to navigation problems; Jazwinski 1970, 8.4. Mapping of a thin shell
as in RTCA DO-229, A.4.4.10]
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from insgnss.constants import WGS84_A_M
from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import GAIN_ROWS, EpochWorkspace, Line, Lines
from insgnss.filter.state import (
    CLOCK,
    CLONE_CLOCK,
    DR,
    N_CLONE,
    N_OF_SATELLITE,
    N_PATTERNS,
    OFFSETS,
    Bank,
    SlowErrors,
)
from insgnss.filter.update.range_biases import error_at
from insgnss.filter.update.reflections import write_reflections
from insgnss.filter.update.scalar_update import covariance_with, predicted_variance, scalar_update
from insgnss.gnss.ionosphere import AT_SHELL, shell_mapping
from insgnss.gnss.observation_rows import CARRIER, PSEUDORANGE, RANGE_RATE, GnssRows, Observation
from insgnss.kernels.jit import kernel
from insgnss.status import USED
from insgnss.tables import Float64, Int64

_GRADIENT_PER_M: Final = 1e-6  # gradients are per 1000 km
_LEAST_SINE: Final = 0.05  # of the troposphere's mapping, below 3 deg
_UNKNOWN_M2: Final = 1e8  # (10 km)^2
_LEAST_COSINE: Final = 1e-9  # of the elevation: at the zenith the azimuth is undefined


@kernel(inline=True)
def keep_gain(vectors: Float64, j: int, kind: int, n: int) -> None:
    """Keep the gain (n,) of a row used just now, where there is room for it: a range's or a carrier difference's."""
    at = gain_row(j, kind)
    if kind != RANGE_RATE and at < vectors.shape[0]:
        for c in range(n):
            vectors[at, c] = vectors[1, c]


@kernel(inline=True)
def gain_row(j: int, kind: int) -> int:
    """Return which of an epoch's vectors keeps the gain of line ``j``."""
    return GAIN_ROWS + 2 * j + (1 if kind == CARRIER else 0)


@kernel(apart=True)
def follow_slow_errors(
    bank: Bank, member: int, par: Parameters, rows: GnssRows, epoch: int, since_last: float, s: EpochWorkspace
) -> None:
    """Carry the slow errors to an epoch and over the rows that it has used, where a member leads.

    All rows of an epoch at once: S <- S U + A and R <- U^T R U, with U^T = (I - K_m h_m) ... (I - K_1 h_1) and A the
    sum over the rows of the load a_j times what the later rows leave of the gain K_j. Both are sums from the last row
    to the first.
    """
    if member != bank.head[0].leader or bank.head[0].n_slow == 0:
        return
    n, held, first = bank.head[0].n_slow, par.held[: par.n_held], rows.first[epoch]
    write_reflections(bank.memory[member], par, rows, epoch, s.lines)
    if bank.head[0].from_fix == 1:
        bank.head[0].from_fix, since_last = 0, 0.0  # the fix is the epoch's
        place_effects_of_fix(bank.slow, n, held, rows, epoch, s.lines)
    k = held.shape[0]
    S, R = np.empty((n, k)), np.empty((k, k))
    take_held(bank.slow, held, S, R)
    fade(S, R, par, since_last)
    U, A, place = np.eye(k), np.zeros((n, k)), np.full(bank.slow.R.shape[0], -1)
    for c in range(k):
        place[held[c]] = c
    left = np.empty(k)  # what the rows after one leave of its gain
    for kind in (CARRIER, PSEUDORANGE):
        for j in range(rows.first[epoch + 1] - first - 1, -1, -1):
            line, row = s.lines[j], rows.observation[first + j]
            if line.status[kind] != USED:
                continue
            gain_through(U, s.vectors[gain_row(j, kind)], held, left)
            if kind == PSEUDORANGE:
                for i in range(N_PATTERNS):
                    add_scaled(A[i], line.load[i], left)
                if line.bias > 0:
                    for i in range(error_at(line.bias - 1, 0), error_at(line.bias, 0)):
                        add_scaled(A[i], load_of(line, row, i), left)
            for a in range(line.count[kind]):
                if place[line.columns[kind, a]] >= 0:
                    add_scaled(U[place[line.columns[kind, a]]], -line.h[kind, a], left)
    add_product(S, U, A)
    put_held(bank.slow, held, A, sandwiched(R, U))
    if par.at_clone >= 0:
        clone_effects(bank.slow, n, held, par.at_clone)


@kernel(inline=True)
def take_held(slow: SlowErrors, held: Int64, S: Float64, R: Float64) -> None:
    """Copy the effects (n, k) and the remainder (k, k) of the states that hold slow errors, side by side."""
    for c in range(held.shape[0]):
        for i in range(S.shape[0]):
            S[i, c] = slow.S[i, held[c]]
        for b in range(held.shape[0]):
            R[b, c] = slow.R[held[b], held[c]]


@kernel(inline=True)
def put_held(slow: SlowErrors, held: Int64, S: Float64, R: Float64) -> None:
    """Copy them back."""
    for c in range(held.shape[0]):
        for i in range(S.shape[0]):
            slow.S[i, held[c]] = S[i, c]
        for b in range(held.shape[0]):
            slow.R[held[b], held[c]] = R[b, c]


@kernel(inline=True)
def gain_through(U: Float64, gain: Float64, held: Int64, left: Float64) -> None:
    """Write U^T K, K the held part of a gain."""
    for c in range(left.shape[0]):
        left[c] = 0.0
    for c in range(left.shape[0]):
        add_scaled(left, gain[held[c]], U[c])


@kernel(inline=True)
def add_scaled(to: Float64, factor: float, v: Float64) -> None:
    """Add a multiple of a vector to another."""
    for c in range(v.shape[0]):
        to[c] += factor * v[c]


@kernel(inline=True)
def add_product(X: Float64, U: Float64, to: Float64) -> None:
    """Add the product X U to a matrix."""
    for i in range(X.shape[0]):
        for c in range(U.shape[0]):
            add_scaled(to[i], X[i, c], U[c])


@kernel(inline=True)
def sandwiched(R: Float64, U: Float64) -> Float64:
    """Return U^T R U."""
    half, whole = np.zeros_like(R), np.zeros_like(R)
    add_product(R, U, half)
    for i in range(R.shape[0]):
        for c in range(R.shape[0]):
            add_scaled(whole[i], U[c, i], half[c])
    return whole


@kernel(apart=True)
def place_slow_variances(
    bank: Bank, member: int, par: Parameters, rows: GnssRows, epoch: int, lines: Lines
) -> None:
    """Write what the slow errors add to the variance of each pseudorange's innovation: |a - h S|^2 + h R h^T.

    What the state has taken of an error already is not in the innovation any more. A reflection of up to a sigma of the
    row is in its own variance already. While several headings are open, what the state has taken widens no gate.
    """
    first, n = rows.first[epoch], bank.head[0].n_slow
    one_heading = bank.state.shape[0] == 1
    write_reflections(bank.memory[member], par, rows, epoch, lines)
    S, left = by_state(bank.slow.S, n, par.held[: par.n_held]), np.empty(n)
    for j in range(rows.first[epoch + 1] - first):
        line, row = lines[j], rows.observation[first + j]
        line.slow, line.astray = 0.0, 0.0
        if n == 0 or line.status[PSEUDORANGE] != USED:
            continue
        place_loads(par, row, line)
        h, columns = line.h[PSEUDORANGE], line.columns[PSEUDORANGE][: line.count[PSEUDORANGE]]
        for i in range(n):
            left[i] = load_of(line, row, i)
        for a in range(columns.shape[0]):
            add_scaled(left, -h[a], S[columns[a]])
        slow, astray = 0.0, predicted_variance(bank.slow.R, h, columns)
        for i in range(n):
            if not is_reflection(i):
                slow += left[i] ** 2
            elif one_heading:
                load = load_of(line, row, i)
                astray += max(left[i] ** 2 - min(load * load, line.variance[PSEUDORANGE]), 0.0)
        line.slow = slow
        if one_heading:  # else what contradicts a wrong one would pass for its sake
            line.astray = astray


@kernel(inline=True)
def by_state(S: Float64, n: int, held: Int64) -> Float64:
    """Return the effects of the first ``n`` slow errors, those on one state side by side; zero on states not held."""
    turned = np.zeros((S.shape[1], n))
    for c in held:
        for i in range(n):
            turned[c, i] = S[i, c]
    return turned


@kernel(inline=True)
def load_of(line: Line, row: Observation, i: int) -> float:
    """Return the effect of one sigma of a slow error on a pseudorange [m]."""
    if i < N_PATTERNS:
        return float(line.load[i])
    if not error_at(line.bias - 1, 0) <= i < error_at(line.bias, 0):
        return 0.0
    return float(line.reflection if is_reflection(i) else row.bias_sigma)


@kernel(inline=True)
def is_reflection(i: int) -> bool:
    """Return whether a slow error is a satellite's reflection, which comes after its message's error."""
    return i >= N_PATTERNS and (i - N_PATTERNS) % N_OF_SATELLITE == N_OF_SATELLITE - 1


@kernel(inline=True)
def fade(S: Float64, R: Float64, par: Parameters, dt: float) -> None:
    """Let the errors forget themselves over ``dt`` [s]: what they have done to the state stays, on its own."""
    of_sky, of_satellite = math.exp(-dt * par.air_rate), math.exp(-dt * par.satellite_rate)
    of_reflection = math.exp(-dt * par.reflection_rate)
    for i in range(S.shape[0]):
        f = of_sky
        if i >= N_PATTERNS:
            f = of_reflection if is_reflection(i) else of_satellite
        for a in range(R.shape[0]):
            add_scaled(R[a], (1.0 - f * f) * S[i, a], S[i])
        for a in range(R.shape[0]):
            S[i, a] *= f


@kernel(apart=True)
def place_effects_of_fix(
    slow: SlowErrors, n: int, held: Int64, rows: GnssRows, epoch: int, lines: Lines
) -> None:
    """Write what the slow errors have done to a state that a fix has opened: they are in the fix as in its ranges.

    The epoch's ranges stand for those of the fix, which is of the epoch before. Their gains are those of a state of
    which nothing is known.
    """
    size = slow.R.shape[0]
    P, v = np.zeros((size, size)), np.zeros((3, size))
    first = rows.first[epoch]
    for c in (DR, DR + 1, DR + 2, CLOCK):
        P[c, c] = _UNKNOWN_M2
    for j in range(rows.first[epoch + 1] - first):
        if lines[j].group > 0:
            P[OFFSETS + lines[j].group - 1, OFFSETS + lines[j].group - 1] = _UNKNOWN_M2
    for j in range(rows.first[epoch + 1] - first):
        line = lines[j]
        if line.status[PSEUDORANGE] != USED:
            continue
        h, columns = line.h[PSEUDORANGE], line.columns[PSEUDORANGE][: line.count[PSEUDORANGE]]
        scalar_update(P, h, columns, 0.0, line.variance[PSEUDORANGE], v)
        for i in range(n):
            correct_effect(slow.S[i], h, columns, held, v[1], load_of(line, rows.observation[first + j], i))


@kernel(inline=True)
def not_taken(e: Float64, h: Float64, columns: Int64, load: float) -> float:
    """Return load - h e: the part of an error's effect on a row that the state has not taken."""
    left = load
    for a in range(columns.shape[0]):
        left -= h[a] * e[columns[a]]
    return left


@kernel(inline=True)
def correct_effect(e: Float64, h: Float64, columns: Int64, held: Int64, gain: Float64, load: float) -> None:
    """Correct the effect ``e`` (n,) of one error by a row of the gain K: e <- e + K (load - h e)."""
    left = not_taken(e, h, columns, load)
    for c in held:
        e[c] += gain[c] * left


@kernel(inline=True)
def correct_remainder(R: Float64, h: Float64, columns: Int64, held: Int64, gain: Float64, d: Float64) -> None:
    """Correct what earlier errors have left by a row: R <- (I - K h) R (I - K h)^T; ``d`` (n,) is scratch."""
    covariance_with(R, h, columns, d)
    total = predicted_variance(R, h, columns)
    for b in held:
        for c in held:
            R[b, c] += gain[b] * (total * gain[c] - d[c]) - d[b] * gain[c]


@kernel(inline=True)
def clone_effects(slow: SlowErrors, n: int, held: Int64, at_clone: int) -> None:
    """Make this epoch's position and clock those that the next epoch's carrier differences count from."""
    for k in range(N_CLONE):
        of, to = (CLOCK if k == CLONE_CLOCK else DR + k), at_clone + k
        for i in range(n):
            slow.S[i, to] = slow.S[i, of]
        for c in held:
            slow.R[to, c] = slow.R[of, c]
        for c in held:
            slow.R[c, to] = slow.R[c, of]


@kernel(inline=True)
def place_loads(par: Parameters, row: Observation, line: Line) -> None:
    """Write the effect of one sigma of each error of the whole sky on a line's pseudorange."""
    load, north, east, sine = line.load, line.u_n[0], line.u_n[1], -line.u_n[2]
    cosine = math.sqrt(north * north + east * east)
    mapping = row.ionosphere_factor * shell_mapping(sine)
    # from the receiver to where the line of sight pierces the shell, along the ground
    elevation = math.atan2(sine, cosine)
    away_m = WGS84_A_M * (0.5 * math.pi - elevation - math.asin(AT_SHELL * min(cosine, 1.0)))
    slope = par.slow_gradient * mapping * away_m * _GRADIENT_PER_M / max(cosine, _LEAST_COSINE)
    load[0] = par.slow_ionosphere * mapping
    load[1], load[2] = slope * north, slope * east
    load[3] = par.slow_troposphere / max(sine, _LEAST_SINE)


@kernel
def correct_by_row_without(
    slow: SlowErrors, n: int, h: Float64, columns: Int64, held: Int64, gain: Float64, d: Float64
) -> None:
    """Correct all effects by a row without slow errors: a carrier difference, or a further sensor's or a user's own."""
    for i in range(n):
        correct_effect(slow.S[i], h, columns, held, gain, 0.0)
    correct_remainder(slow.R, h, columns, held, gain, d)
