"""The one helper against which every Jacobian is tested."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

Float64 = npt.NDArray[np.float64]
Function = Callable[[Float64], npt.ArrayLike]


def finite_difference_jacobian(function: Function, x: npt.ArrayLike, step: npt.ArrayLike) -> Float64:
    """Return d function / d x at ``x`` by central differences, extrapolated once (Richardson).

    Equation: D(h) = (f(x + h) - f(x - h)) / 2h,  J = (4 D(h/2) - D(h)) / 3, error of fourth order in h

    Parameters
    ----------
    function : maps (n,) to a scalar or an array; it gets a fresh array at each call and may keep or change it
    x : (n,) the point, each component in its own unit
    step : (n,) or one for all, in the units of ``x``: large enough that rounding of ``function`` does not matter
        (its error is about 2 eps |f| / step), small against the scale on which ``function`` bends

    Returns
    -------
    (m, n) with m the number of values of ``function``, flattened
    """
    x = np.asarray(x, dtype=np.float64)
    steps = np.broadcast_to(np.asarray(step, dtype=np.float64), x.shape)
    if x.ndim != 1 or not np.all(steps > 0.0):
        raise ValueError("x must be one-dimensional and every step positive")
    columns = [
        (4.0 * _central(function, x, k, 0.5 * steps[k]) - _central(function, x, k, steps[k])) / 3.0
        for k in range(x.size)
    ]
    return np.stack(columns, axis=-1)


def _central(function: Function, x: Float64, k: int, step: float) -> Float64:
    ahead, behind = x.copy(), x.copy()
    ahead[k] += step
    behind[k] -= step
    # what the steps really are after rounding
    width = ahead[k] - behind[k]
    values = [np.array(function(point), dtype=np.float64).ravel() for point in (ahead, behind)]
    return np.asarray((values[0] - values[1]) / width)
