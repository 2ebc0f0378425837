"""The update of the filter with a receiver channel's replica offsets; compiled."""

from __future__ import annotations

from insgnss.filter.rows.replica_offset import (
    COLUMNS,
    OWN_COLUMN,
    PHASE_COLUMNS,
    RANGE_COLUMNS,
    SHARED_COLUMN,
    offset_acceleration_row,
    offset_range_row,
    offset_rate_row,
)
from insgnss.filter.update.scalar_update import covariance_with, predicted_variance, scalar_update
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64, Int64


@kernel(inline=True)
def use_offsets(
    P: Float64,
    columns: Int64,
    u: Float64,
    g: Float64,
    z: tuple[float, float],
    C: tuple[float, float, float],
    h: Float64,
    v: Float64,
) -> None:
    """Update with a channel's range and range rate; one whose variance is not above zero is left out.

    Parameters
    ----------
    P : (n, n) covariance
    columns : (8,) ``COLUMNS``, or (9,) with that of the phase's own state, the range less the predicted one
    u, g : (3,) direction, and derivative of the range rate by the position [1/s]
    z : observed minus predicted [m], [m/s]
    C : their variances and covariance: of the range, of both, of the rate
    h : (8,) or (9,) scratch
    v : (3, n) correction, gain and scratch of ``scalar_update``
    """
    if C[0] > 0.0:
        offset_range_row(u, h)
        scalar_update(P, h, phase_columns(columns, h), z[0], C[0], v)
    use_rate_beside(P, columns, u, g, z, C, h, v)


@kernel(inline=True)
def phase_columns(columns: Int64, h: Float64) -> Int64:
    """Return the columns of a range's row ``h``; of a phase with a state of its own all nine, completed in ``h``."""
    if columns.shape[0] == len(COLUMNS):
        return columns[:RANGE_COLUMNS]
    for i in range(RANGE_COLUMNS, len(COLUMNS)):
        h[i] = 0.0
    h[len(COLUMNS)] = 1.0
    return columns[:]


@kernel(inline=True)
def use_rate_beside(
    P: Float64,
    columns: Int64,
    u: Float64,
    g: Float64,
    z: tuple[float, float],
    C: tuple[float, float, float],
    h: Float64,
    v: Float64,
) -> None:
    """Update with the range rate less what the range, which has been used, says of it; as ``use_offsets``."""
    of_range = C[1] / C[0] if C[0] > 0.0 else 0.0
    variance = C[2] - of_range * C[1]
    if variance > 0.0:
        offset_rate_row(u, g, of_range, h)
        if columns.shape[0] > len(COLUMNS):
            h[len(COLUMNS)] = -of_range
        scalar_update(P, h, columns, z[1] - of_range * z[0], variance, v)


@kernel(inline=True)
def use_acceleration_beside(
    P: Float64, columns: Int64, u: Float64, g: Float64, z: Float64, C: Float64, h: Float64, v: Float64
) -> None:
    """Update with the acceleration less what range and rate, which have been used, say of it.

    Equation: k = [C20, C21] [[C00, C01], [C01, C11]]^-1, z_a - k [z_r, z_v], variance C22 - k [C20, C21]

    Parameters
    ----------
    P, u, g, v : as in ``use_offsets``
    columns : (12,) ``ACCELERATION_COLUMNS`` and that of an acceleration that all channels share, or (13,) with that of
        the phase's own state
    z : (3,) observed minus predicted range, its rate, and the rate's rate [m], [m/s], [m/s^2]
    C : (3, 3) their covariance
    h : (>= 13,) scratch
    """
    determinant = C[0, 0] * C[1, 1] - C[0, 1] * C[0, 1]
    of_range = (C[0, 2] * C[1, 1] - C[1, 2] * C[0, 1]) / determinant
    of_rate = (C[1, 2] * C[0, 0] - C[0, 2] * C[0, 1]) / determinant
    variance = C[2, 2] - of_range * C[0, 2] - of_rate * C[1, 2]
    if variance > 0.0:
        offset_acceleration_row(u, g, of_range, of_rate, h)
        h[SHARED_COLUMN], h[OWN_COLUMN] = 1.0, -of_range
        scalar_update(P, h, columns, z[2] - of_range * z[0] - of_rate * z[1], variance, v)


@kernel(inline=True)
def begin_phase(
    P: Float64, columns: Int64, u: Float64, z: float, variance: float, h: Float64, v: Float64
) -> None:
    """Begin a phase's own state, of which nothing is known, by its first observation: no other state learns of it.

    Equation: N = phi - r,  e_N = n - h e,  so that P_N = -h P,  P_NN = h P h^T + variance; what ``scalar_update`` tends
    to where the variance of that state grows beyond all bounds

    Parameters
    ----------
    P, u, h, v : as in ``use_offsets``
    columns : (9,)
    z : observed minus predicted, the state's present value included [m]
    """
    own = columns[len(COLUMNS)]
    offset_range_row(u, h)
    covariance_with(P, h, columns[:RANGE_COLUMNS], v[1])
    D, moved = variance, 0.0
    for a in range(RANGE_COLUMNS):
        D += h[a] * v[1, columns[a]]
        moved += h[a] * v[0, columns[a]]
    for i in range(P.shape[0]):
        P[i, own], P[own, i] = -v[1, i], -v[1, i]
    P[own, own] = D
    v[0, own] = z - moved


@kernel(inline=True)
def phase_variance(P: Float64, columns: Int64, u: Float64, h: Float64) -> float:
    """Return the variance of a channel's predicted phase, its own state included [m^2]; ``columns``, h as above."""
    offset_range_row(u, h)
    return predicted_variance(P, h, phase_columns(columns, h))


@kernel(inline=True)
def use_phase_and_code(
    P: Float64,
    columns: Int64,
    own: int,
    u: Float64,
    z: tuple[float, float],
    variances: tuple[float, float],
    h: Float64,
    v: Float64,
) -> None:
    """Update with a channel's phase, which has a state of its own, and with its code.

    Parameters
    ----------
    P, u, h, v : as in ``use_offsets``
    columns : (5,) those of a range, and room for that state's
    own : where that state stands
    z : range by the phase and by the code, observed minus predicted [m]
    variances : theirs [m^2]
    """
    columns[RANGE_COLUMNS] = own
    offset_range_row(u, h)
    h[RANGE_COLUMNS] = 1.0
    scalar_update(P, h, columns[:PHASE_COLUMNS], z[0], variances[0], v)
    scalar_update(P, h, columns[:RANGE_COLUMNS], z[1], variances[1], v)


@kernel(inline=True)
def offset_covariance(
    P: Float64, columns: Int64, u: Float64, g: Float64, h: Float64, v: Float64
) -> tuple[float, float, float]:
    """Return how well a channel's range and range rate are predicted: h P h^T of the range, of both, of the rate.

    Parameters
    ----------
    P, columns, u, g : as in ``use_offsets``
    h : (2, 8) or (2, 9) scratch
    v : (>= 2, n) scratch
    """
    of_range, of_rate = h[0], h[1]
    offset_range_row(u, of_range)
    offset_rate_row(u, g, 0.0, of_rate)
    range_columns = phase_columns(columns, of_range)
    if columns.shape[0] > len(COLUMNS):
        of_rate[len(COLUMNS)] = 0.0
    covariance_with(P, of_range, range_columns, v[1])
    both = 0.0
    for i in range(columns.shape[0]):
        both += of_rate[i] * v[1, columns[i]]
    return (
        predicted_variance(P, of_range, range_columns),
        both,
        predicted_variance(P, of_rate, columns),
    )


@kernel(inline=True)
def acceleration_covariance(
    P: Float64, columns: Int64, u: Float64, g: Float64, h: Float64, v: Float64
) -> tuple[float, float, float]:
    """Return how well a channel's acceleration is predicted: h P h^T with the range, with its rate, with itself.

    Parameters
    ----------
    P, u, g, v : as in ``offset_covariance``
    columns : as in ``use_acceleration_beside``
    h : (3, 13) scratch
    """
    offset_range_row(u, h[0])
    offset_rate_row(u, g, 0.0, h[1])
    of_acceleration = columns[len(COLUMNS) : SHARED_COLUMN]
    covariance_with(P, u, of_acceleration, v[1])
    with_range, with_rate, itself = 0.0, 0.0, 0.0
    for i in range(RANGE_COLUMNS):
        with_range += h[0, i] * v[1, columns[i]]
    for i in range(len(COLUMNS)):
        with_rate += h[1, i] * v[1, columns[i]]
    for i in range(of_acceleration.shape[0]):
        itself += u[i] * v[1, of_acceleration[i]]
    if columns.shape[0] > OWN_COLUMN:
        with_range += v[1, columns[OWN_COLUMN]]
    return with_range, with_rate, itself
