"""Scripted histories of a satellite's gain, and the supervisor's words on them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from insgnss.antenna.visibility import VISIBLE
from insgnss.constants import NS_PER_S
from insgnss.receiver.supervisor import Predictions, Supervision
from insgnss.receiver.tracking_state import REASON_NAMES, STATE_NAMES

STEP_S = 0.1
T0_NS = 1_300_000_000 * NS_PER_S


def predictions(
    decision: npt.ArrayLike | None = None,
    cn0_dbhz: npt.ArrayLike = 45.0,
    d_range_m2: npt.ArrayLike = 1.0,
    d_rate_m2ps2: npt.ArrayLike = 0.01,
    n: int | None = None,
    step_s: float = STEP_S,
) -> Predictions:
    """Return predictions of one satellite (n,) or several (n, m); what is a number holds throughout."""
    given = [decision if decision is not None else VISIBLE, cn0_dbhz, d_range_m2, d_rate_m2ps2]
    columns = [a[:, None] if (a := np.asarray(x)).ndim == 1 else a for x in given]
    shape = np.broadcast_shapes(*(c.shape for c in columns), (n or 1, 1))
    full = [np.broadcast_to(c, shape) for c in columns]
    t_ns = T0_NS + np.rint(np.arange(shape[0]) * step_s * NS_PER_S).astype(np.int64)
    return Predictions(
        t_ns,
        full[0].astype(np.int8),
        full[1].astype(float),
        full[2].astype(float),
        full[3].astype(float),
        np.full(shape, 2.2e7),
        np.full(shape, 100.0),
    )


def spans(*parts: tuple[float, float]) -> npt.NDArray[np.float64]:
    """Return a history of values, each held for some seconds: (value, seconds), ..."""
    return np.concatenate([np.full(round(seconds / STEP_S), value) for value, seconds in parts])


def story(result: Supervision, satellite: int = 0) -> list[tuple[float, str, str]]:
    """Return time [s], new state and reason of each transition of a satellite."""
    rows = zip(*result.transitions[:5], strict=True)
    return [
        (round((int(t) - T0_NS) / NS_PER_S, 3), STATE_NAMES[after], REASON_NAMES[reason])
        for t, sv, _, after, reason in rows
        if sv == satellite
    ]
