"""Rows at regular ticks, weighted down where their errors are correlated from one to the next."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.tables import Int64


@dataclass(frozen=True)
class PeriodicMeasurement:
    """The common part of measurements at whole multiples of a period (``own_rows.rows.Measurement``)."""

    period_s: float
    gate_sigma: float

    @property
    def period_ns(self) -> int:
        """Of the ticks."""
        return round(self.period_s * NS_PER_S)

    @property
    def times_ns(self) -> Int64:
        """None besides the ticks (0,)."""
        return np.zeros(0, np.int64)

    @property
    def watched(self) -> bool:
        """They are not used while they contradict the other measurements."""
        return True


def correlated(variance: float, time_s: float, period_s: float) -> float:
    """Return the variance with which a row counts whose error is correlated over ``time_s``, at every ``period_s``.

    A Gauss-Markov error of variance s^2 and time t, seen every d, has the correlation a = exp(-d / t) from row to row.
    The mean of many rows has the variance s^2 (1 + a) / (1 - a) / n: white rows of the variance

        r = s^2 (1 + a) / (1 - a) = s^2 coth(d / 2 t)   (2 t / d s^2 for d << t, s^2 for d >> t)

    carry as much. Neglects: rows closer than t observe the error itself; a single row gets less weight than it
    deserves.
    """
    return variance / math.tanh(0.5 * period_s / time_s)
