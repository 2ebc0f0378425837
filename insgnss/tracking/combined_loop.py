"""The combined code and phase loop closed: linear, or with its discriminators, with noise or without."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.constants import C_MPS
from insgnss.errors import ConfigError
from insgnss.tables import Float64
from insgnss.tracking.admissible import signal_ratio
from insgnss.tracking.combined_filter import CODE, PHASE, CombinedModel
from insgnss.tracking.correlators import PROMPT, Correlators
from insgnss.tracking.delay_discriminators import DelayDiscriminator
from insgnss.tracking.phase_discriminators import PhaseDiscriminator


class Transient(NamedTuple):
    """Offsets of a loop from its own prediction, truth minus replica, epoch by epoch."""

    time_s: Float64  # (n,)
    code_m: Float64  # (n, ...)
    phase_rad: Float64  # (n, ...)


class Response(NamedTuple):
    """The characteristics of a transient."""

    zero_crossing_s: float  # NaN if there is none
    overshoot: float  # largest swing to the other side, share of the first offset
    settling_s: float  # first time after which the offset stays within the share; inf if never


def linear_transient(
    model: CombinedModel, gains: Float64, phase_rad: float, count: int, code_m: float = 0.0
) -> Transient:
    """Return how offsets at the start die out in the linear loop without noise.

    Equation: x^ = x~ + K (y - H x~), x~_next = F x^                                                   [(2.18), (2.24)]

    Parameters
    ----------
    model, gains : of the loop; (3, 2), or (count, 3, 2) that change
    phase_rad, code_m : true offsets at the start
    """
    error = np.array([code_m, 0.0, phase_rad * model.wavelength_m / (2.0 * math.pi)])
    F, found = model.transition(), np.empty((count, 3))
    for k in range(count):
        found[k] = error
        K = gains if gains.ndim == 2 else gains[k]
        error = F @ (error - K @ error[[CODE, PHASE]])
    return _transient(model, found)


def nonlinear_transient(
    model: CombinedModel,
    gains: Float64,
    phase_rad: npt.ArrayLike,
    count: int,
    rng: np.random.Generator | None = None,
    code_m: npt.ArrayLike = 0.0,
) -> Transient:
    """Return the same with correlators and discriminators I (L - E) and I Q over their slopes, with noise if asked.

    Equation: (2.23), u / S in place of the equivalent observations, S (2.5) and (2.11) at the model's C/N0; the
              replica's frequency is the filter's rate, so that the state's phase is that of an integration's middle

    Parameters
    ----------
    model, gains : as in ``linear_transient``
    phase_rad, code_m : true offsets at the start, one for each trial (broadcast)
    rng : of the correlators' noise; None for their means alone
    """
    phase, code = np.broadcast_arrays(np.asarray(phase_rad, float), np.asarray(code_m, float))
    a, T = signal_ratio(model.cn0_dbhz, model.integration_s), model.integration_s
    correlators, chip_m, radian_m = Correlators(), C_MPS / model.chip_hz, model.wavelength_m / (2.0 * math.pi)
    delay, carrier = DelayDiscriminator("product", correlators), PhaseDiscriminator("iq")
    error = np.stack([code, np.zeros(code.shape), phase * radian_m], axis=-1)
    F, found = model.transition(), np.empty((count, *error.shape))
    for k in range(count):
        found[k] = error
        rate = error[..., 1] / radian_m
        # the state is at the middle of the integration, the correlators count phase from its beginning
        begin = error[..., PHASE] / radian_m - 0.5 * rate * T
        Z = correlators.mean(a, error[..., CODE] / chip_m, begin, rate, T)
        Z = Z if rng is None else correlators.draw(Z, a, rng)
        seen = np.stack(
            [
                delay.output(Z) / delay.slope(a) * chip_m,
                carrier.output(Z[..., PROMPT]) / carrier.slope(a) * radian_m,
            ],
            axis=-1,
        )
        K = gains if gains.ndim == 2 else gains[k]
        error = (error - seen @ K.T) @ F.T
    return _transient(model, found)


def read_response(time_s: Float64, offset: Float64, share: float = 0.05) -> Response:
    """Return zero crossing, overshoot and settling time of one transient that begins at its largest offset.

    Raises
    ------
    ConfigError : there is no offset at the start
    """
    if not abs(offset[0]) > 0.0:
        raise ConfigError("the transient begins at zero", key="offset", advice="start it with an offset")
    relative = offset / offset[0]
    crossed = np.flatnonzero(relative < 0.0)
    outside = np.flatnonzero(np.abs(relative) > share)
    settled = outside[-1] + 1 < len(time_s)
    return Response(
        float(time_s[crossed[0]]) if crossed.size else math.nan,
        float(max(0.0, -relative.min())),
        float(time_s[outside[-1] + 1]) if settled else math.inf,
    )


def _transient(model: CombinedModel, found: Float64) -> Transient:
    time_s = model.integration_s * np.arange(len(found))
    phase = found[..., PHASE] / (model.wavelength_m / (2.0 * math.pi))
    return Transient(np.asarray(time_s), found[..., CODE], phase)
