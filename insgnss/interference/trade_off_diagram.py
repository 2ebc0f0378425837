"""Which oscillator and which INS together allow a wanted margin: the lines of the paper's figures 4, 5 and 6.

Two characteristics describe the two drifts [Shatilov 2009, (28)]:

    c_osc = df_max^2 / T_osc [Hz^2/s],  c_INS = dV_max^2 / T_INS [m^2/s^3],
    2 (2 pi / 3)^2 c_osc + 2 (2 pi f0 / (3 c))^2 c_INS <= S_max

so that each wanted margin is a straight line; on one of the axes the *other* sensor's characteristic is zero (the
paper's text at figure 4 has it the other way round). S_max is one-sided [rad^2/s^3].
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.interference.checks import not_negative
from insgnss.interference.drift import per_mps
from insgnss.interference.margin import PhaseLoop, greatest_drift
from insgnss.tables import Float64

PER_OSCILLATOR: Final = 2.0 * (2.0 * math.pi / 3.0) ** 2  # 8.77298 rad^2/s^3 for 1 Hz^2/s
_ADVICE: Final = "the square of the greatest increment over the time it took"


class TradeOff(NamedTuple):
    """One line: all pairs below it allow the margin."""

    margin_db: float
    greatest_density: float  # S_max, one-sided [rad^2/s^3]
    c_ins: float  # m^2/s^3, with a perfect oscillator
    c_osc: float  # Hz^2/s, with a perfect INS

    def osc_left(self, c_ins: npt.ArrayLike) -> Float64:
        """Return the greatest c_osc beside a c_INS, zero where nothing is left."""
        share = 1.0 - not_negative("c_ins", c_ins, _ADVICE) / self.c_ins
        return np.asarray(self.c_osc * np.maximum(share, 0.0))


class Diagram(NamedTuple):
    """The lines of figure 4: the margin with one characteristic alone, the other zero."""

    margin_db: Float64
    c_ins: Float64  # left axis: c_osc = 0
    c_osc: Float64  # right axis: c_INS = 0


def per_ins(carrier_hz: float) -> float:
    """Return the contribution of a c_INS of 1 m^2/s^3 to S: 2 (2 pi f0 / (3 c))^2, 249.888 rad^2/s^3 at 1600 MHz."""
    return 2.0 * (per_mps(carrier_hz) / 3.0) ** 2


def density(c_osc: npt.ArrayLike, c_ins: npt.ArrayLike, carrier_hz: float) -> Float64:
    """Return the one-sided density S of two characteristics       [Shatilov 2009, (28)]."""
    return np.asarray(
        PER_OSCILLATOR * not_negative("c_osc", c_osc, _ADVICE)
        + per_ins(carrier_hz) * not_negative("c_ins", c_ins, _ADVICE)
    )


def trade_off(margin: float, loop: PhaseLoop, carrier_hz: float, cn0_dbhz: float | None = None) -> TradeOff:
    """Return the line of a wanted J/S [dB]; thermal noise counts where ``cn0_dbhz`` is given."""
    S = float(greatest_drift(margin, loop, cn0_dbhz))
    return TradeOff(margin, S, S / per_ins(carrier_hz), S / PER_OSCILLATOR)


def diagram(margins: npt.ArrayLike, loop: PhaseLoop, carrier_hz: float) -> Diagram:
    """Return figure 4's curve for one discriminator, both axes."""
    S = greatest_drift(margins, loop)
    return Diagram(np.asarray(margins, np.float64), S / per_ins(carrier_hz), S / PER_OSCILLATOR)
