"""The median of a few numbers, compiled: an epoch has tens of rows, so insertion sorts them fastest."""

from __future__ import annotations

from insgnss.kernels.jit import kernel
from insgnss.tables import Float64


@kernel(inline=True)
def median_of(values: Float64, n: int) -> float:
    """Return the median of the first ``n`` values, which are sorted in place."""
    for i in range(1, n):
        value = values[i]
        j = i
        while j > 0 and values[j - 1] > value:
            values[j] = values[j - 1]
            j -= 1
        values[j] = value
    median: float = 0.5 * (values[(n - 1) // 2] + values[n // 2])
    return median
