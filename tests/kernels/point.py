"""Sample calls of the kernels of the point solution over a whole log."""

from __future__ import annotations

from typing import Any

import numpy as np

from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.gnss.least_squares import Ties
from insgnss.gnss.line_of_sight import line_of_sight
from insgnss.gnss.point.log import solve_epochs
from insgnss.gnss.point.rows import PointRows, PointSettings, at_time_tags, new_point_log
from insgnss.gnss.troposphere import STANDARD_WEATHER
from insgnss.runs.point import chi_square_limits
from insgnss.status import USED
from tests.kernels import KernelCase

_R_E = np.array([4157199.0, 671198.0, 4774777.0])
_V_E = np.array([3.0, -11.0, 2.0])
_NOISE = (0.25, 0.36, 0.49, 1.0)
# faults [m] by row of each epoch: none, one, two, three, five; then an epoch of four rows and one of three
_FAULTS: tuple[dict[int, float], ...] = (
    *({}, {3: 80.0}, {1: 900.0, 6: -70.0}),
    *({1: 900.0, 4: -5e3, 8: 90.0}, dict.fromkeys(range(5), 4e3)),
)


def log_of_epochs() -> list[Any]:
    """Return the solution of seven epochs of two constellations: clean, faulty, short; a row masked and one weak."""
    n = 14
    angle = np.arange(n) * 2.399963  # the golden angle spreads them over the sky
    height = np.concatenate([[0.02], 0.15 + 0.8 * np.arange(1, n) / n])
    up = _R_E / np.linalg.norm(_R_E)
    east = np.cross([0.0, 0.0, 1.0], up) / np.hypot(*_R_E[:2]) * np.linalg.norm(_R_E)
    level = np.outer(np.cos(angle), east) + np.outer(np.sin(angle), np.cross(up, east))
    u = np.sqrt(1.0 - height**2)[:, None] * level + height[:, None] * up
    sat = np.hstack([_R_E + 2.2e7 * u, 3e3 * np.cross(u, up), np.zeros((n, 2))])
    scratch = np.zeros((2, 3))
    both = np.array([line_of_sight(sat, k, _R_E, _V_E, scratch[0], scratch[1]) for k in range(n)])
    noise = 0.4 * np.cos(7.0 * np.arange(n))
    value = both + np.column_stack([300.0 + noise, 5.0 + 0.02 * noise])
    epochs = [value.copy() for _ in range(7)]
    for epoch, faults in zip(epochs, _FAULTS, strict=False):
        for k, size in faults.items():
            epoch[k + 2] += [size, 0.1 * size]
    counts = (n, n, n, n, n, 4, 3)
    take = np.concatenate([np.arange(n - count, n) for count in counts])
    rows = PointRows(
        epoch_ns=2268 * NS_PER_WEEK + (200_000 + np.arange(7)) * NS_PER_S,
        first=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        sat=sat[take],
        value=np.concatenate([epoch[n - count :] for epoch, count in zip(epochs, counts, strict=True)]),
        sigma=np.full((len(take), 2), np.nan, np.float32),
        status=np.full((len(take), 2), USED, np.int8),
        group=(take % 3 == 1).astype(np.int64) * (take < 10),
        cn0=np.where(take == 1, np.float32(20.0), np.float32(45.0)),
        thermal=np.ones(len(take), np.float32),
        weakness=np.where(take % 4 == 2, np.float32(6.0), np.float32(0.0)),
        variance_scale=np.ones(len(take), np.float32),
        ionosphere_factor=np.ones(len(take)),
        ionosphere_m=np.full(len(take), 3.0, np.float32),
        klobuchar=np.zeros(8),
    )
    settings = PointSettings(
        0.09,
        25.0,
        0.0,
        STANDARD_WEATHER,
        _NOISE,
        (9e-4, 4e-4, 9e-4, 1.0),
        (0.04, 4e-4),
        100.0,
        3.0,
        Ties(np.array([-1, 0]), 4e-4),
        0.5,
    )
    out = new_point_log(rows, 2)
    solve_epochs(rows, settings, chi_square_limits(n + 1, 1e-3), out)
    return list(at_time_tags(out))


# Gauss-Newton ends when its step is below 1e-5 m, which is 1e-12 of the position; a residual is its difference from
# a range of 2e7 m
CASES = [KernelCase("tests.kernels.point:log_of_epochs", rtol=1e-8)]
