"""Vectors of three components in kernels: tuples, which the compiler keeps in registers; arrays are read as well.

``cross_product`` is for arrays outside kernels.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

Vector: TypeAlias = tuple[float, float, float]


@kernel(inline=True)
def cross(a: Vector | Float64, b: Vector | Float64) -> Vector:
    """Return a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel(inline=True)
def dot(a: Vector | Float64, b: Vector | Float64) -> float:
    """Return a . b."""
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@kernel(inline=True)
def plus(a: Vector | Float64, b: Vector | Float64) -> Vector:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@kernel(inline=True)
def times(a: Vector | Float64, factor: float) -> Vector:
    """Return a times a number."""
    return a[0] * factor, a[1] * factor, a[2] * factor


@kernel(inline=True)
def rotate(C: Float64, a: Vector | Float64) -> Vector:
    """Return C a of a rotation matrix (3, 3)."""
    return (
        C[0, 0] * a[0] + C[0, 1] * a[1] + C[0, 2] * a[2],
        C[1, 0] * a[0] + C[1, 1] * a[1] + C[1, 2] * a[2],
        C[2, 0] * a[0] + C[2, 1] * a[1] + C[2, 2] * a[2],
    )


@kernel(inline=True)
def rotate_back(C: Float64, a: Vector | Float64) -> Vector:
    """Return C^T a of a rotation matrix (3, 3)."""
    return (
        C[0, 0] * a[0] + C[1, 0] * a[1] + C[2, 0] * a[2],
        C[0, 1] * a[0] + C[1, 1] * a[1] + C[2, 1] * a[2],
        C[0, 2] * a[0] + C[1, 2] * a[1] + C[2, 2] * a[2],
    )


@kernel(inline=True)
def place(target: Float64, at: int, a: Vector | Float64) -> None:
    """Write a vector into ``target`` from ``at`` on."""
    target[at], target[at + 1], target[at + 2] = a[0], a[1], a[2]


@kernel(inline=True)
def place_negative(target: Float64, at: int, a: Vector | Float64) -> None:
    """Write a vector, turned round, into ``target`` from ``at`` on."""
    target[at], target[at + 1], target[at + 2] = -a[0], -a[1], -a[2]


def cross_product(a: Float64, b: Float64) -> Float64:
    """Return a x b of arrays along the last axis, without the copies that NumPy's own makes."""
    if a.ndim == b.ndim == 1:
        (x, y, z), (u, v, w) = a.tolist(), b.tolist()
        return np.array([y * w - z * v, z * u - x * w, x * v - y * u])
    product = np.empty(np.broadcast_shapes(a.shape, b.shape))
    product[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    product[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    product[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product
