"""C/N0 as a receiver of the laboratory estimates it: of every channel, every 20 ms, over up to a second.

The window grows to a second while the signal stays as it is. Where the mean power of its newest part, of 20, 40, 80 ...
ms, differs from that of the rest by more than 5 sigma, C/N0 has changed, and the window restarts with the newest part.
A fall from 45 to 30 dBHz is seen after 20 ms, before a loop that follows 5 g on its own loses its phase; one from 25 to
22 dBHz as the window slides. The ratio of two mean powers is compared as that of two gamma distributions [Paulson 1942,
Annals of Mathematical Statistics 13, 233]: with n integrations of a signal of ``a`` times the noise, their shape is
n (1 + a)^2 / (1 + 2 a). By chance the window of a channel restarts once an hour.

Two estimators (``ReceiverOptions.cn0_estimator``):

- "power": the mean power less that of the noise, which the front end keeps (``vector_loop``): a = M2 - 1, with a
  variance of (1 + 2 a) / n
- "moments": of the second and fourth moment (``moment_cn0_dbhz``), which needs no noise level. Windows shorter than
  0.2 s, just after a change, use the power too. To 200 integrations of 5 ms noise alone looks like a signal of 19
  dBHz (one sigma), and every fifth window with such a signal shows none.

A window without a signal counts as half a sigma of the noise, or as the estimate before if that was less; two seconds
without one are a signal that is gone.

With phases (5 ms, 5 g, 80 deg/h, a fall from 45 dBHz at once) half of the runs lose lock at a C/N0 that is higher than
with known C/N0 by -0.1 to 0.2 dB (optimal, one_stage; "power") and 0.9 to 1.0 dB ("moments").
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from insgnss.kernels.jit import kernel
from insgnss.studies.receiver.workspace import NO_SIGNAL
from insgnss.tables import Float64, Int64
from insgnss.tracking.lock_and_cn0 import signal_of_moments
from insgnss.tracking.vector_loop import RATIO, ChannelConstants, levels_of

ESTIMATORS: Final = ("power", "moments")
ESTIMATE_S: Final = 0.02  # between two estimates
_LONGEST_S: Final = 1.0  # the longest, ...
_LEAST_OF_MOMENTS_S: Final = 0.2  # ... and the shortest whose fourth moment counts
_GONE_S: Final = 2.0  # of windows without a signal
_CHANGED_SIGMAS: Final = 5.0
_NOISE_POWER: Final = 2.0  # power of two components of unit variance


class EstimatedCn0:
    """What a receiver takes for the C/N0 of its m channels."""

    def __init__(
        self, channels: ChannelConstants, begin_dbhz: Float64, least_dbhz: float, estimator: str
    ) -> None:
        m = len(begin_dbhz)
        self._channels, self._least = channels, least_dbhz
        whole = max(round(_LONGEST_S / channels.step_s), 2)
        self._least_of_moments = whole + 1  # none
        if estimator == "moments":
            self._least_of_moments = min(max(round(_LEAST_OF_MOMENTS_S / channels.step_s), 2), whole)
        self._power = np.zeros((0, m))  # of the window, over that of the noise
        self._whole, self._count = whole, np.zeros(m, np.int64)  # integrations in the window
        self._empty_s = np.zeros(m)  # since the last window with a signal
        self.believed = np.array(begin_dbhz)  # [dBHz]; NaN: the signal is gone
        self.level = np.where(np.isnan(begin_dbhz), NO_SIGNAL, levels_of(begin_dbhz))

    def take(self, power: Float64, levels: Int64) -> Float64:
        """Take a block of integrations; return the estimates of C/N0 (m,) [dBHz], NaN of windows without a signal.

        Parameters
        ----------
        power : (block, m) of the prompt replicas, whose scale goes with the C/N0 that the receiver assumes
        levels : (block, m) of that
        """
        step_s, block = self._channels.step_s, len(power)
        newest = power / (_NOISE_POWER * self._channels.table[np.maximum(levels, 0), RATIO])
        self._power = np.concatenate([self._power, newest])[-self._whole :]
        self._count = np.minimum(self._count + block, self._whole)
        moments = np.empty((2, len(self._count)))
        newest_moments(self._power, block, self._count, moments)
        signal, least = self._signal(moments)
        empty = ~(signal > least)
        with np.errstate(invalid="ignore", divide="ignore"):
            estimates = np.where(empty, np.nan, 10.0 * np.log10(signal / step_s))
        self._empty_s = np.where(empty, self._empty_s + block * step_s, 0.0)
        weakest = 10.0 * np.log10(least / step_s)
        self.believed = np.where(empty, np.fmin(self.believed, weakest), estimates)
        gone = (self._empty_s >= _GONE_S - 0.5 * step_s) | ~(self.believed >= self._least)
        self.believed = np.where(gone & empty, np.nan, self.believed)
        self.level = np.where(gone, NO_SIGNAL, levels_of(self.believed))
        return estimates

    def _signal(self, moments: Float64) -> tuple[Float64, Float64]:
        """Return signal over noise of each channel, an integration's, and the least that its window shows, (m,).

        Equation: half a sigma of noise of unit power is 1 / (2 sqrt n) of the mean power; of moments 2 M2^2 - M4 =
                  P_s^2 has the variance 4 / n, half a sigma of it is 1 / sqrt n
        """
        second, n = moments[0], self._count
        by_moments = n >= self._least_of_moments
        strength = np.nan_to_num(signal_of_moments(*moments), nan=0.0)
        noise = np.maximum(second - strength, np.finfo(float).tiny)
        signal = np.where(by_moments, strength / noise, second - 1.0)
        return signal, np.where(by_moments, np.power(n, -0.25), 0.5 / np.sqrt(n))


@kernel
def newest_moments(power: Float64, block: int, count: Int64, moments: Float64) -> None:
    """Write the second and fourth moment of the windows, (2, m).

    Parameters
    ----------
    power : (n, m) over that of the noise, the newest last
    block : integrations since the last call
    count : (m,) integrations of each channel's window; less after a change, which is looked for first
    """
    for c in range(power.shape[1]):
        count[c] = unchanged(power[:, c], block, count[c])
        second, fourth = 0.0, 0.0
        for i in range(len(power) - count[c], len(power)):
            second += power[i, c]
            fourth += power[i, c] * power[i, c]
        moments[0, c], moments[1, c] = second / count[c], fourth / count[c]


@kernel
def unchanged(power: Float64, block: int, count: int) -> int:
    """Return how many of the newest ``count`` powers (n,) belong to one C/N0: all, or those after the clearest change.

    Equation: z = [(1 - 1/(9 k2)) F^(1/3) - (1 - 1/(9 k1))] / sqrt(F^(2/3) / (9 k2) + 1/(9 k1)), F the mean of the
              newest over that of the others, k their shapes
    """
    n, total = len(power), 0.0
    for i in range(n - count, n):
        total += power[i]
    newest, at, best, kept = 0.0, n, _CHANGED_SIGMAS, count
    part = block
    while part < count:
        while at > n - part:
            at -= 1
            newest += power[at]
        before = (total - newest) / (count - part)
        a = max(before - 1.0, 0.0)
        nine_shapes = 9.0 * (1.0 + a) ** 2 / (1.0 + 2.0 * a)
        of_newest, of_before = 1.0 / (nine_shapes * part), 1.0 / (nine_shapes * (count - part))
        root = (newest / (part * max(before, 1e-9))) ** (1.0 / 3.0)
        z = abs((1.0 - of_before) * root - (1.0 - of_newest)) / math.sqrt(root**2 * of_before + of_newest)
        if z > best:
            best, kept = z, part
        part *= 2
    return kept
