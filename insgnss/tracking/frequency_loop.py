"""The frequency loop on its own (FLL) of order 1 or 2: it follows the frequency and does not track the phase.

A frequency discriminator sees by how much the phase turns between the middles of two integrations; the loop's states
are the frequency at the middle between them and, in order 2, its derivative. That is the chain of integrators of a
phase loop one derivative higher, with the same gains and the same limit of B T: 0.5 of order 1, 2.5 of order 2
(``loop_filters``).

Its bandwidth is the one from the observed frequency to the replica's. The noise of the observation is the difference of
two phase noises, ``(n_k - n_(k-1)) / T``, most of which a slow loop takes back in the next step: the variance of the
frequency is far below that of white noise of the same size in the same band (``rate_covariance``).

    loop = frequency_filter(1, bandwidth_hz=2.5, step_s=5e-3)
    ChannelDesign(loop, digital_filter(1, 1.0, 5e-3), 40.0, frequency_kind="atan")
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.errors import ConfigError
from insgnss.tables import Complex, Float64
from insgnss.tracking.admissible import require_not_negative
from insgnss.tracking.loop_filters import (
    LoopFilter,
    digital_filter,
    steady_covariance,
    transition,
)

FREQUENCY_ORDERS: Final = (1, 2)


@dataclass(frozen=True)
class FrequencyLoop:
    """A stand-alone frequency loop: ``chain`` is a loop filter over [frequency, its derivative] in rad/s.

    A ``ChannelDesign`` takes it in the place of the carrier's phase loop, with a frequency discriminator.

    Raises
    ------
    ConfigError : an invalid order, or unstable gains
    """

    chain: LoopFilter

    def __post_init__(self) -> None:
        _require_order(self.chain.order)
        if np.any(self.chain.rate_gains):
            advice = "give gains of the frequency alone, as frequency_filter does"
            raise ConfigError("a frequency loop is not assisted", key="chain", advice=advice)
        if not self.chain.is_stable():
            advice = "take smaller gains: frequency_filter gives those of a bandwidth"
            raise ConfigError("the frequency loop is unstable", key="chain", advice=advice)

    @property
    def order(self) -> int:
        """Return the number of states."""
        return self.chain.order

    @property
    def step_s(self) -> float:
        """Return the integration time [s]."""
        return self.chain.step_s

    @property
    def gains(self) -> Float64:
        """Return the gains on the phase observation, none, (order + 1,)."""
        return np.zeros(self.order + 1)

    @property
    def rate_gains(self) -> Float64:
        """Return the gains on the frequency observation for [phase, frequency, its derivative], (order + 1,).

        Equation: the channel leads the frequency on to the middle of the integration, half a step beyond the middle of
                  the observed turn: L1 + T/2 L2, L2
        """
        L = self.chain.gains
        ahead = 0.5 * self.step_s * L[1] if self.order > 1 else 0.0
        return np.array([0.0, L[0] + ahead, *L[1:]])

    def noise_bandwidth_hz(self) -> float:
        """Return the true one-sided noise bandwidth, from observed to replica's frequency [Hz]."""
        return self.chain.noise_bandwidth_hz()

    def response(self, frequency_hz: npt.ArrayLike) -> Complex:
        """Return H(f) from the observed frequency to the predicted one."""
        return self.chain.response(frequency_hz)

    def rate_covariance(self, phase_variance: float) -> Float64:
        """Return the steady covariance of the predicted states from the phase noise of the integrations.

        Equation: A = F (I - L H), b = F L / T, x~_next = A x~ + b (n_k - n_(k-1)): the state is lengthened by n_(k-1)
                                                                                                            [Lyapunov]

        Parameters
        ----------
        phase_variance : of one integration's phase, 1 / (2 q T) for a coherent angle [rad^2]; squaring loss raises it
        """
        require_not_negative(phase_variance=phase_variance)
        size = self.order
        A = np.zeros((size + 1, size + 1))
        b = transition(size, self.step_s) @ self.chain.gains / self.step_s
        A[:size, :size] = self.chain.closed_loop()
        A[:size, size] = -b
        driven = np.append(b, 1.0)
        return np.asarray(steady_covariance(A, phase_variance * np.outer(driven, driven))[:size, :size])


def frequency_filter(order: int, bandwidth_hz: float, step_s: float) -> FrequencyLoop:
    """Return the optimum frequency loop with the requested true noise bandwidth.

    Raises
    ------
    ConfigError : no such order, or B T beyond 0.5 (order 1) or 2.5 (order 2)
    """
    _require_order(order)
    return FrequencyLoop(digital_filter(order, bandwidth_hz, step_s))


def _require_order(order: int) -> None:
    if order not in FREQUENCY_ORDERS:
        raise ConfigError(f"invalid order {order} of a frequency loop", key="order", advice="take 1 or 2")
