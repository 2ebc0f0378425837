"""The variance of one row: from the log's own sigma where it states one, from the model elsewhere, compiled."""

from __future__ import annotations

from insgnss.filter.parameters import KindNumbers
from insgnss.gnss.noise_model import measurement_variance, stated_variance
from insgnss.kernels.jit import kernel

_STATED_FLOOR2 = 0.09  # a log's own sigma is believed down to 0.3 of the model's floor


@kernel(inline=True)
def row_variance(stated: float, sine: float, thermal: float, of: KindNumbers) -> float:
    """Return the variance of a row of the kind ``of`` from the sigma that the log states, or from the model."""
    if stated > 0.0:
        return float(stated_variance(stated, _STATED_FLOOR2 * of.floor2))
    return model_variance(sine, thermal, of)


@kernel(inline=True)
def model_variance(sine: float, thermal: float, of: KindNumbers) -> float:
    """Return the variance of a row of the kind ``of`` by the model, see ``gnss.noise_model``."""
    return float(measurement_variance(sine, thermal, of.floor2, of.elevation2, of.cn02, of.missing_thermal))
