"""The whole uncertainty of a navigation row: the filter's own covariance, and what range errors that last add to it."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from insgnss.filter.output.writing import NAV_COLUMNS, Table
from insgnss.filter.state import CLOCK, DR, Bank
from insgnss.geodesy.local_level import ecef_to_ned_matrix
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

SLOW_COLUMNS: Final = ("sd_slow_n_m", "sd_slow_e_m", "sd_slow_d_m")
_CLOCK: Final = 6  # in the ``slow`` of a row
_VARIANCES: Final = (0, 3, 5, _CLOCK)  # there, north, east, down and clock
_SIGMAS: Final = [NAV_COLUMNS.index(name) for name in ("sd_n_m", "sd_e_m", "sd_d_m", "sd_clock_bias_m")]


@kernel(inline=True)
def write_slow(nav: Table, bank: Bank, at: int) -> None:
    """Write what the slow errors of a bank's leader add to the covariance of a navigation row."""
    row = nav[at]
    C = np.empty((3, 3))
    ecef_to_ned_matrix(math.radians(row.value[0]), math.radians(row.value[1]), C)
    for k in range(7):
        row.slow[k] = 0.0
    total = bank.slow.R[DR : DR + 3, DR : DR + 3].copy()
    clock = bank.slow.R[CLOCK, CLOCK]
    for k in range(bank.head[0].n_slow):
        e = bank.slow.S[k]
        clock += e[CLOCK] * e[CLOCK]
        for a in range(3):
            for b in range(3):
                total[a, b] += e[DR + a] * e[DR + b]
    k = 0
    for i in range(3):
        for j in range(i, 3):
            for a in range(3):
                for b in range(3):
                    row.slow[k] += C[i, a] * total[a, b] * C[j, b]
            k += 1
    row.slow[_CLOCK] = clock


def total_values(rows: Table) -> Float64:
    """Return ``NAV_COLUMNS`` of navigation rows (m, N_NAV), the sigmas of position and clock with the slow errors."""
    values: Float64 = rows["value"].copy()
    values[:, _SIGMAS] = np.sqrt(values[:, _SIGMAS] ** 2 + rows["slow"][:, _VARIANCES])
    return values


def nav_columns(rows: Table, *, with_shares: bool) -> dict[str, Float64]:
    """Return ``NAV_COLUMNS`` of navigation rows and, on request, the shares of the slow errors, each (m,)."""
    columns = dict(zip(NAV_COLUMNS, total_values(rows).T, strict=True))
    return columns | slow_sigmas(rows) if with_shares else columns


def slow_sigmas(rows: Table) -> dict[str, Float64]:
    """Return the columns of the share that the slow errors have in the sigmas of the position, each (m,)."""
    return {name: np.sqrt(rows["slow"][:, i]) for name, i in zip(SLOW_COLUMNS, _VARIANCES[:3], strict=True)}


def slow_covariances(rows: Table, C_ne: Float64) -> Float64:
    """Return what the slow errors add to the covariance of the position, ECEF (m, 3, 3); ``C_ne`` is (m, 3, 3)."""
    pairs = rows["slow"][:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
    return np.asarray(C_ne.transpose(0, 2, 1) @ pairs @ C_ne)
