"""The update of the filter with a receiver channel's replica offsets; compiled."""

from __future__ import annotations

from insgnss.filter.rows.replica_offset import (
    PHASE_COLUMNS,
    RANGE_COLUMNS,
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
    columns : (8,) ``COLUMNS``
    u, g : (3,) direction, and derivative of the range rate by the position [1/s]
    z : observed minus predicted [m], [m/s]
    C : their variances and covariance: of the range, of both, of the rate
    h : (8,) scratch
    v : (3, n) correction, gain and scratch of ``scalar_update``
    """
    of_range = 0.0
    if C[0] > 0.0:
        offset_range_row(u, h)
        scalar_update(P, h, columns[:RANGE_COLUMNS], z[0], C[0], v)
        of_range = C[1] / C[0]
    variance = C[2] - of_range * C[1]
    if variance > 0.0:
        offset_rate_row(u, g, of_range, h)
        scalar_update(P, h, columns, z[1] - of_range * z[0], variance, v)


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
    h : (2, 8) scratch
    v : (>= 2, n) scratch
    """
    of_range, of_rate = h[0], h[1]
    offset_range_row(u, of_range)
    offset_rate_row(u, g, 0.0, of_rate)
    range_columns = columns[:RANGE_COLUMNS]
    covariance_with(P, of_range, range_columns, v[1])
    both = 0.0
    for i in range(of_rate.shape[0]):
        both += of_rate[i] * v[1, columns[i]]
    return (
        predicted_variance(P, of_range, range_columns),
        both,
        predicted_variance(P, of_rate, columns),
    )
