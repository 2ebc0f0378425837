"""The receiver clock as two states, bias [m] and drift [m/s], driven by an oscillator's h-parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass

from insgnss.config.flight import Oscillator
from insgnss.constants import C_MPS


@dataclass(frozen=True)
class ClockModel:
    """Two-sided driving densities: of the bias [m^2/s] and of the drift [m^2/s^3]."""

    bias_density: float
    drift_density: float


def clock_model(oscillator: Oscillator) -> ClockModel:
    """Return the driving densities of an oscillator.

    Equation: S_bias = c^2 h0 / 2, S_drift = c^2 2 pi^2 h_-2          [Brown & Hwang 2012, 9.3]
    Neglects: flicker frequency noise (h_-1), which no finite number of states carries.
    """
    return ClockModel(
        bias_density=C_MPS**2 * oscillator.h0_s / 2.0,
        drift_density=C_MPS**2 * 2.0 * math.pi**2 * oscillator.h_minus2_per_s,
    )
