"""Slow range errors in the position, against the same sums written out row by row."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.gnss.least_squares import Ties, free_clocks
from insgnss.gnss.slow_errors import SlowRows, SlowSigmas, slow_position_variances

SHELL = 6_378_137.0 / (6_378_137.0 + 350_000.0)


def sky(rng: np.random.Generator, epochs: int = 5, satellites: int = 9) -> SlowRows:
    """Return epochs of satellites all over the sky, two bands of each, in two clock groups, in any order."""
    n = epochs * satellites * 2
    az = rng.uniform(-np.pi, np.pi, (epochs, satellites)).repeat(2, axis=1).ravel()
    el = np.radians(rng.uniform(8.0, 88.0, (epochs, satellites))).repeat(2, axis=1).ravel()
    sv = np.tile(np.arange(satellites).repeat(2), epochs)
    order = np.concatenate([k * satellites * 2 + rng.permutation(satellites * 2) for k in range(epochs)])
    u_n = np.column_stack([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), -np.sin(el)])
    return SlowRows(
        np.arange(epochs).repeat(satellites * 2) + 3,
        u_n[order],
        rng.uniform(0.5, 4.0, n),
        sv[order],
        np.tile([0, 1], n // 2)[order],
        np.tile([1.0, 1.793], n // 2)[order],
    )


def written_out(rows: SlowRows, sigmas: SlowSigmas, epoch: int) -> np.ndarray:
    """Return G Sigma G^T of one epoch from the full covariance of its rows' errors."""
    here = np.flatnonzero(rows.epoch == epoch)
    n = len(here)
    H = np.hstack([-rows.u_n[here], np.eye(2)[rows.group[here]]])
    W = np.diag(1.0 / rows.r[here])
    G = np.linalg.solve(H.T @ W @ H, H.T @ W)
    errors = np.zeros((n, n))
    for i, a in enumerate(here):
        for j, b in enumerate(here):
            errors[i, j] += sigmas.satellite_m[rows.sv[a]] ** 2 if rows.sv[a] == rows.sv[b] else 0.0
            pair = [shared(rows, k, sigmas) for k in (a, b)]
            errors[i, j] += float(pair[0] @ pair[1])
    return np.diag(G @ errors @ G.T)[:3]


def shared(rows: SlowRows, k: int, sigmas: SlowSigmas) -> np.ndarray:
    """Return what one sigma of each shared error makes of a row."""
    el, az = np.arcsin(-rows.u_n[k, 2]), np.arctan2(rows.u_n[k, 1], rows.u_n[k, 0])
    slant = rows.ionosphere_factor[k] / np.cos(np.arcsin(SHELL * np.cos(el)))
    thousands_km = 6_378.137 * (np.pi / 2.0 - el - np.arcsin(SHELL * np.cos(el))) / 1000.0
    sloped = sigmas.gradient_m * slant * thousands_km
    vertical = sigmas.troposphere_m / np.sin(el)
    return np.array([sigmas.ionosphere_m * slant, sloped * np.cos(az), sloped * np.sin(az), vertical])


@pytest.mark.parametrize(
    "sizes",
    [
        (0.5, 0.0, 0.0, 0.0),
        (0.0, 2.0, 0.0, 0.0),
        (0.0, 0.0, 1.5, 0.0),
        (0.0, 0.0, 0.0, 0.2),
        (0.5, 2.0, 1.5, 0.2),
    ],
)
def test_variances_are_the_sums_written_out(
    sizes: tuple[float, float, float, float], rng: np.random.Generator
) -> None:
    rows = sky(rng)
    sigmas = SlowSigmas(sizes[0] * rng.uniform(0.5, 2.0, 9), *sizes[1:])
    epochs, found = slow_position_variances(rows, sigmas, free_clocks(2))
    assert epochs.tolist() == [3, 4, 5, 6, 7]
    wanted = np.array([written_out(rows, sigmas, int(epoch)) for epoch in epochs])
    assert np.allclose(found, wanted, rtol=1e-8)
    assert (found > 0.0).all()


def test_error_that_all_rows_share_alike_is_the_clocks(rng: np.random.Generator) -> None:
    """At one elevation, ionosphere and troposphere are one number for all rows."""
    az = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
    el = np.radians(40.0)
    u_n = np.column_stack([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.full(8, -np.sin(el))])
    # one satellite above all makes the height observable
    u_n = np.vstack([u_n, [0.0, 0.0, -1.0]])
    rows = SlowRows(np.zeros(9, np.int64), u_n, np.ones(9), np.arange(9), np.zeros(9, np.int64), np.ones(9))
    _, found = slow_position_variances(rows, SlowSigmas(np.zeros(9), 3.0, 0.0, 0.1), free_clocks(1))
    assert np.allclose(found[0, :2], 0.0, atol=1e-20)
    slant = 1.0 / np.cos(np.arcsin(SHELL * np.cos(el)))
    # the height moves by what the low satellites have more than the high one, over what tells height from clock
    wanted = np.hypot(3.0 * (slant - 1.0), 0.1 * (1.0 / np.sin(el) - 1.0)) / (1.0 - np.sin(el))
    assert np.sqrt(found[0, 2]) == pytest.approx(wanted, rel=1e-9)


def test_epoch_that_fixes_no_position_is_left_out(rng: np.random.Generator) -> None:
    rows = sky(rng, epochs=2)
    three = np.flatnonzero((rows.epoch == 4) | (rows.sv < 2))  # two satellites in the first epoch
    some = SlowRows(*(column[three] for column in rows))
    epochs, found = slow_position_variances(some, SlowSigmas(np.ones(9), 1.0, 1.0, 0.1), free_clocks(2))
    assert epochs.tolist() == [4] and np.isfinite(found).all()
    none = SlowRows(*(column[:0] for column in rows))
    assert len(slow_position_variances(none, SlowSigmas(np.ones(9), 1.0, 1.0, 0.1), free_clocks(2))[0]) == 0


def test_clocks_tied_without_doubt_are_one_clock(rng: np.random.Generator) -> None:
    rows, sigmas = sky(rng), SlowSigmas(np.ones(9), 1.0, 1.0, 0.1)
    _, tied = slow_position_variances(rows, sigmas, Ties(np.array([-1, 0]), 1e8))
    _, one = slow_position_variances(rows._replace(group=0 * rows.group), sigmas, free_clocks(1))
    _, free = slow_position_variances(rows, sigmas, free_clocks(2))
    assert np.allclose(tied, one, rtol=1e-5) and not np.allclose(free, one, rtol=1e-2)
