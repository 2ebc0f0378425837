"""C/N0 as a receiver of the laboratory estimates it: of every channel, twice a second, over the last second.

Below 20 dBHz the moment estimator scatters: to 200 integrations of 5 ms noise alone looks like a signal of 19 dBHz (one
sigma), and every fifth window with such a signal shows none. A window without a signal therefore counts as half a
sigma, or as the estimate before if that was less; four windows in a row without one are a signal that is gone. Where
the mean power of the newest half second differs from that of the half before by more than 4 sigma, C/N0 has changed,
and the newest half counts alone.

With phases (5 ms, 5 g, C/N0 that falls by 2 dB/s) half of the runs lose lock at a C/N0 that is higher than with known
C/N0 by 0.1 dB (scalar, two_stage), 0.8 dB (one_stage) and 1.2 dB (optimal). Until a fall of C/N0 is seen, for half a
second, the receiver takes noise for signal: ``scalar`` does not survive a fall from 45 to 33 dBHz at once.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from insgnss.studies.receiver.workspace import NO_SIGNAL
from insgnss.tables import Bool, Float64, Int64
from insgnss.tracking.lock_and_cn0 import moment_cn0_dbhz
from insgnss.tracking.vector_loop import RATIO, ChannelConstants, levels_of

_GONE: Final = 4  # windows in a row without a signal
_CHANGED_SIGMAS: Final = 4.0


class EstimatedCn0:
    """What a receiver takes for the C/N0 of its m channels."""

    def __init__(self, channels: ChannelConstants, begin_dbhz: Float64, least_dbhz: float) -> None:
        self._channels, self._least = channels, least_dbhz
        self._before: Float64 | None = None  # power of the newest block
        self._empty = np.zeros(len(begin_dbhz), np.int64)  # windows in a row without a signal
        self.believed = np.array(begin_dbhz)  # [dBHz]; NaN: the signal is gone
        self.level = np.where(np.isnan(begin_dbhz), NO_SIGNAL, levels_of(begin_dbhz))

    def take(self, power: Float64, levels: Int64) -> Float64:
        """Take a block of integrations; return the estimates of C/N0 (m,) [dBHz], NaN of windows without a signal.

        Parameters
        ----------
        power : (block, m) of the prompt replicas, whose scale goes with the C/N0 that the receiver assumes
        levels : (block, m) of that
        """
        newest, step_s = power / self._channels.table[np.maximum(levels, 0), RATIO], self._channels.step_s
        estimates = _estimates(newest, step_s)
        weakest = np.full(len(estimates), least_seen_dbhz(len(newest), step_s))
        if self._before is not None and len(self._before) == len(newest):
            together, steady = np.concatenate([self._before, newest]), ~_changed(self._before, newest)
            estimates = np.where(steady, _estimates(together, step_s), estimates)
            weakest[steady] = least_seen_dbhz(len(together), step_s)
        self._before = newest
        empty = np.isnan(estimates)
        self._empty = np.where(empty, self._empty + 1, 0)
        self.believed = np.where(empty, np.fmin(self.believed, weakest), estimates)
        gone = (self._empty >= _GONE) | ~(self.believed >= self._least)
        self.believed = np.where(gone & empty, np.nan, self.believed)
        self.level = np.where(gone, NO_SIGNAL, levels_of(self.believed))
        return estimates


def least_seen_dbhz(count: int, step_s: float) -> float:
    """Return the C/N0 that ``count`` integrations of ``step_s`` just do not show: half a sigma of their noise [dBHz].

    Equation: of noise of unit power 2 M2^2 - M4 = P_s^2 has the variance 4 / count, half a sigma is 1 / sqrt(count)
    """
    return 10.0 * math.log10(count**-0.25 / step_s)


def _estimates(power: Float64, step_s: float) -> Float64:
    return np.asarray(moment_cn0_dbhz(np.sqrt(power).astype(complex), step_s, len(power))[0])


def _changed(before: Float64, newest: Float64) -> Bool:
    """Return whether the mean powers of two blocks differ by more than their scatter allows, (m,)."""
    variance = before.var(axis=0) / len(before) + newest.var(axis=0) / len(newest)
    return np.asarray(np.abs(newest.mean(axis=0) - before.mean(axis=0)) > _CHANGED_SIGMAS * np.sqrt(variance))
