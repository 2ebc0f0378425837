"""The filter finds its own noise levels: three factors, on pseudoranges, range rates and the receiver clock, compiled.

No fixed sigma suits a survey receiver under open sky and a telephone in a street. From what is left after each update
the filter corrects its assumed variances within bounds, so that normalised innovations are near one and sigma means
something. Slow errors that are alike for many epochs (atmosphere, orbits, multipath at rest) do not show in what is
left: they are in no sigma.
"""

from __future__ import annotations

from typing import Final

from insgnss.fusion.measurements import RANGE_COLUMNS, RATE_COLUMNS, Epoch, predicted_range_variance
from insgnss.fusion.parameters import Parameters
from insgnss.fusion.scalar_update import predicted_variance
from insgnss.fusion.state import DRIFT, OFFSETS, StateRecord
from insgnss.jit import inlined
from insgnss.status import USED
from insgnss.tables import Float64

_INTERVAL_NS: Final = 900_000_000  # once a second is often enough: the levels move over minutes
_LARGEST_RATIO: Final = 9.0  # one row counts as at most three sigmas
_REST_SPEED_MPS: Final = 0.7  # slower than a walk
_LEAST_ROWS: Final = 5  # of a kind in an epoch: fewer leave no residual to speak of


@inlined
def residual_ratio(P: Float64, s: Epoch, kind: int, n_rows: int, correction: Float64, factor: float) -> float:
    """Return the mean of (residual^2 + h P+ h^T) / r over the used rows of one kind; ``factor`` when they are too few.

    Equation: E[e e^T] = R - H P+ H^T for the residual e after the update      [Mehra 1970; Mohamed & Schwarz 1999]
    r is the variance before the factor, so the return value is what the factor should be.
    """
    total = 0.0
    used = 0
    for j in range(n_rows):
        line = s.lines[j]
        if line.status[kind] != USED:
            continue
        residual = line.innovation[kind]
        if kind == 0:
            for a in range(RANGE_COLUMNS.shape[0]):
                residual -= line.h_range[a] * correction[RANGE_COLUMNS[a]]
            if line.group > 0:
                residual -= correction[OFFSETS + line.group - 1]
            left = predicted_range_variance(P, line)
        else:
            for a in range(RATE_COLUMNS.shape[0]):
                residual -= line.h_rate[a] * correction[RATE_COLUMNS[a]]
            left = predicted_variance(P, line.h_rate, RATE_COLUMNS)
        ratio = (residual * residual + left) / line.variance[kind]
        total += min(ratio, _LARGEST_RATIO)
        used += 1
    return factor * total / used if used >= _LEAST_ROWS else factor


@inlined
def adapt_noise(
    m: StateRecord, P: Float64, par: Parameters, s: Epoch, n_rows: int, t_ns: int, drift_variance: float
) -> None:
    """Move the three factors of a hypothesis towards what an epoch's update shows.

    At rest the pseudoranges' factor does not fall far: multipath stands still then and does not show in what is left.
    The clock's: the drift's correction has the variance P- minus P+, in the steady state the noise of one interval.

    Parameters
    ----------
    P : covariance after the update
    s : the epoch's work space, its correction not yet fed back
    drift_variance : of the clock drift before the update [m^2/s^2]
    """
    if par.adapt_gain <= 0.0 or t_ns - m.adapted_ns < _INTERVAL_NS:
        return
    m.adapted_ns = t_ns
    m.adapted_count += 1
    gain = max(par.adapt_gain, 1.0 / (m.adapted_count + 5.0))
    correction = s.vectors[0]
    v2 = m.v_e[0] * m.v_e[0] + m.v_e[1] * m.v_e[1] + m.v_e[2] * m.v_e[2]
    at_rest = v2 < _REST_SPEED_MPS**2
    for kind in range(2):
        factor = m.noise_factor[kind]
        wanted = residual_ratio(P, s, kind, n_rows, correction, factor)
        if kind == 0 and at_rest:
            wanted = max(wanted, min(factor, par.adapt_least_at_rest))
        m.noise_factor[kind] = bounded(factor + gain * (wanted - factor), par)
    expected = drift_variance - P[DRIFT, DRIFT]
    if expected > 0.0 and m.adapted_count > 5:
        ratio = min(correction[DRIFT] * correction[DRIFT] / expected, _LARGEST_RATIO)
        m.noise_factor[2] = bounded(m.noise_factor[2] * (1.0 + gain * (ratio - 1.0)), par)


@inlined
def bounded(factor: float, par: Parameters) -> float:
    """Return the factor within the bounds of the settings."""
    return float(min(max(factor, par.adapt_least), par.adapt_most))
