"""Loop filters of order 1 to 3: gains from a bandwidth, their true noise bandwidth, frequency-assisted phase loops.

The filter's state is [phase, rate, acceleration] up to its order, in the unit of what is tracked. Each epoch the
predicted state x~ is corrected by the equivalent observation and led on: x^ = x~ + L e, x~_next = F x^. The replica
follows x~, so the noise bandwidth is that from the observation to x~.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy import linalg, optimize

from insgnss.errors import ConfigError
from insgnss.tables import Complex, Float64
from insgnss.tracking.admissible import require_not_negative, require_positive

ORDERS: Final = (1, 2, 3)
# Continuous gains over powers of w: the optimum for white noise on the highest derivative [Jaffe & Rechtin 1955]
OPTIMUM: Final = {1: (1.0,), 2: (math.sqrt(2.0), 1.0), 3: (2.0, 2.0, 1.0)}
# B T of the loop that forgets everything but its last observations, one for each state: the filter's gains cannot
# be larger. Its prediction y_k, 2 y_k - y_(k-1), 3 y_k - 3 y_(k-1) + y_(k-2) has 1, 5, 19 times the variance of y
LARGEST_BT: Final = {1: 0.5, 2: 2.5, 3: 9.5}
# States that a step of the last difference of the phase excites: H F^k G = 1, n, n (n + 1) / 2, ... for order n
_LAST_DIFFERENCE: Final = {1: (1.0,), 2: (1.0, 1.0), 3: (1.0, 1.5, 1.0)}
_LEAST_BT: Final = 1e-7
_LOG_FREQUENCY: Final = (math.log(1e-7), math.log(1e2))  # w T: from B T below 4e-8 to 0.9998 of the limit


def transition(order: int, step_s: float) -> Float64:
    """Return F of a chain of integrators, (order, order)."""
    powers = np.arange(order)
    rise = powers[None, :] - powers[:, None]
    factor = np.array([1.0, 1.0, 0.5])
    return np.asarray(np.where(rise >= 0, factor[np.abs(rise)] * step_s ** np.maximum(rise, 0), 0.0))


def steady_covariance(A: Float64, Q: Float64) -> Float64:
    """Return P of a stable recursion.

    Equation: P = A P A^T + Q, solved for the elements of P
    """
    size = len(A)
    P = np.linalg.solve(np.eye(size**2) - np.kron(A, A), Q.ravel())
    return np.asarray(P.reshape(size, size))


@dataclass(frozen=True)
class LoopFilter:
    """Gains of a loop and its interval.

    ``gains`` act on the phase observation, ``rate_gains`` on that of the rate (0 without frequency assistance); both
    (order,), in units of the state per unit of the observation.
    """

    gains: Float64
    rate_gains: Float64
    step_s: float

    @property
    def order(self) -> int:
        """Return the number of states."""
        return len(self.gains)

    def closed_loop(self) -> Float64:
        """Return the closed loop's transition matrix of prediction errors, F (I - L H), (order, order)."""
        F = transition(self.order, self.step_s)
        LH = np.zeros((self.order, self.order))
        LH[:, 0] = self.gains
        if self.order > 1:
            LH[:, 1] = self.rate_gains
        return np.asarray(F @ (np.eye(self.order) - LH))

    def is_stable(self) -> bool:
        """Return whether all errors die out."""
        return bool(np.max(np.abs(np.linalg.eigvals(self.closed_loop()))) < 1.0)

    def prediction_covariance(self, variance: float, process: npt.ArrayLike | None = None) -> Float64:
        """Return the steady covariance of x~ from the phase observation's noise and, where given, from the process.

        Equation: P = A P A^T + b b^T var y + Q, A = F (I - L H), b = F L; a frequency discriminator sees the difference
                  of two observations over T, so that its noise is correlated and the state is extended by the last
                  observation                                                                       [Lyapunov]
        """
        A, b = self._driven()
        Q = variance * np.outer(b, b)
        if process is not None:
            Q[: self.order, : self.order] += np.asarray(process, float)
        return np.asarray(steady_covariance(A, Q)[: self.order, : self.order])

    def noise_bandwidth_hz(self) -> float:
        """Return the true one-sided noise bandwidth, frequency assistance included [Hz].

        Equation: B = var x~ / (2 T var y): white observations have the one-sided density 2 T var y
        """
        return float(self.prediction_covariance(1.0)[0, 0]) / (2.0 * self.step_s)

    def response(self, frequency_hz: npt.ArrayLike) -> Complex:
        """Return H(f) from the observed phase to the predicted one.

        Equation: H = h^T (z I - A)^-1 b, z = exp(j 2 pi f T)
        """
        A, b = self._driven()
        z = np.exp(2j * np.pi * np.asarray(frequency_hz, float) * self.step_s)
        matrix = z[..., None, None] * np.eye(len(A)) - A
        right = np.broadcast_to(b.astype(complex)[:, None], (*z.shape, len(A), 1))
        return np.asarray(np.linalg.solve(matrix, right)[..., 0, 0])

    def _driven(self) -> tuple[Float64, Float64]:
        """Return A and b of the state lengthened by the last phase observation."""
        F = transition(self.order, self.step_s)
        over_step = F @ self.rate_gains / self.step_s
        A = np.zeros((self.order + 1, self.order + 1))
        A[:-1, :-1] = self.closed_loop()
        A[:-1, -1] = -over_step
        return A, np.append(F @ self.gains + over_step, 1.0)


def continuous_gains(order: int, bandwidth_hz: float, damping: float | None = None) -> Float64:
    """Return K1, K2, K3 of a continuous loop with a one-sided noise bandwidth.

    Equation: order 1 B = K1 / 4; order 2 B = (K1^2 + K2) / (4 K1), (12) of Shatilov 2009; order 3 B =
              (K1^2 K2 + K2^2 - K1 K3) / (4 (K1 K2 - K3))

    Parameters
    ----------
    damping : of order 2 only, K1 = 2 zeta w, K2 = w^2; the optimum 0.707 if left out

    Raises
    ------
    ConfigError : no such order, bandwidth or damping
    """
    _check_order(order)
    require_positive("give the one-sided noise bandwidth in Hz", bandwidth_hz=bandwidth_hz)
    shape = np.array(OPTIMUM[order])
    if damping is not None:
        if order != 2:
            advice = "leave the damping out, or take order 2"
            raise ConfigError(f"order {order} has no damping", key="damping", advice=advice)
        require_positive("0.5 to 1 is usual", damping=damping)
        shape = np.array([2.0 * damping, 1.0])
    w = bandwidth_hz / continuous_bandwidth_hz(shape)
    return np.asarray(shape * w ** np.arange(1.0, order + 1.0))


def continuous_bandwidth_hz(gains: npt.ArrayLike) -> float:
    """Return the one-sided noise bandwidth of a continuous loop [Hz]; the equations of ``continuous_gains``.

    Raises
    ------
    ConfigError : the loop is unstable
    """
    K = np.asarray(gains, float)
    stable = bool(np.all(K > 0.0)) and (len(K) < 3 or K[0] * K[1] > K[2])
    if not stable:
        raise ConfigError(
            "the loop is unstable", key="gains", advice="all gains above 0, and K1 K2 > K3 for order 3"
        )
    if len(K) == 1:
        return float(K[0] / 4.0)
    if len(K) == 2:
        return float((K[0] ** 2 + K[1]) / (4.0 * K[0]))
    return float((K[0] ** 2 * K[1] + K[1] ** 2 - K[0] * K[2]) / (4.0 * (K[0] * K[1] - K[2])))


def filter_from_continuous(gains: npt.ArrayLike, step_s: float) -> LoopFilter:
    """Return the loop that has continuous gains held over a step; its true bandwidth is larger than the continuous one.

    Equation: L = K T                                                          (Euler)

    Raises
    ------
    ConfigError : unstable at this step; the error says up to which bandwidth it is not
    """
    K = np.asarray(gains, float)
    _check_order(len(K))
    require_positive(step_s=step_s)
    bandwidth = continuous_bandwidth_hz(K)
    loop = LoopFilter(K * step_s, np.zeros(len(K)), step_s)
    if not loop.is_stable():
        limit = _largest_stable_bt(K, bandwidth)
        raise ConfigError(
            f"B T = {bandwidth * step_s:.3g} is too large: a loop with these gains is unstable above {limit:.3g}",
            key="bandwidth_hz",
            advice=f"take a bandwidth below {limit / step_s:.3g} Hz, a shorter integration, or digital_filter, which "
            f"is stable up to B T = {LARGEST_BT[len(K)]:g}",
        )
    return loop


def digital_filter(order: int, bandwidth_hz: float, step_s: float) -> LoopFilter:
    """Return the optimum digital loop with the requested true noise bandwidth.

    Its gains are those of the steady Kalman filter for a chain of integrators driven at its end, the one parameter of
    which, the variance of the last difference, is solved for. For small B T they are those of ``continuous_gains``.

    Raises
    ------
    ConfigError : no such order, or B T beyond what any gains of this kind give; the error says the limit
    """
    _check_order(order)
    require_positive("give the one-sided noise bandwidth in Hz", bandwidth_hz=bandwidth_hz, step_s=step_s)
    wanted = bandwidth_hz * step_s
    if wanted > 0.999 * LARGEST_BT[order]:
        raise ConfigError(
            f"B T = {wanted:.3g} is too large: the limit for order {order} is {LARGEST_BT[order]:g}",
            key="bandwidth_hz",
            advice=f"take a bandwidth below {LARGEST_BT[order] / step_s:.4g} Hz or a shorter integration",
        )
    if wanted < _LEAST_BT:
        advice = f"take a bandwidth above {_LEAST_BT / step_s:.3g} Hz"
        raise ConfigError(f"B T = {wanted:.3g} is too small", key="bandwidth_hz", advice=advice)

    def excess(log_frequency: float) -> float:
        unit = _unit_filter(order, log_frequency)
        return math.log(unit.noise_bandwidth_hz() * unit.step_s / wanted)

    unit = _unit_filter(order, float(optimize.brentq(excess, *_LOG_FREQUENCY, xtol=1e-13)))
    gains = unit.gains * (unit.step_s / step_s) ** np.arange(order)
    return LoopFilter(np.asarray(gains), np.zeros(order), step_s)


def assisted_filter(
    order: int, bandwidth_hz: float, frequency_bandwidth_hz: float, step_s: float
) -> LoopFilter:
    """Return a phase loop of order 2 or 3 whose rate a frequency discriminator corrects as well.

    The frequency loop is of one order less, with its own bandwidth; both corrections are added   [Ward 1998; Kaplan &
    Hegarty 2017, 8.8]. While the phase loop has not locked the frequency loop pulls it in; 0 switches it off.

    Raises
    ------
    ConfigError : order 1 has no rate to assist, or a B T is too large, also of both together
    """
    loop = digital_filter(order, bandwidth_hz, step_s)
    require_not_negative(frequency_bandwidth_hz=frequency_bandwidth_hz)
    if frequency_bandwidth_hz == 0.0:
        return loop
    if order == 1:
        raise ConfigError(
            "order 1 has no rate that could be assisted", key="order", advice="take order 2 or 3"
        )
    try:
        assisting = digital_filter(order - 1, frequency_bandwidth_hz, step_s)
    except ConfigError as error:
        error.key = "frequency_bandwidth_hz"
        raise
    assisted = LoopFilter(loop.gains, np.array([0.0, *assisting.gains]), step_s)
    if not assisted.is_stable():
        advice = "take a smaller bandwidth of one of them, or a shorter integration"
        raise ConfigError("phase and frequency loop together are unstable", key="bandwidth_hz", advice=advice)
    return assisted


def _check_order(order: int) -> None:
    if order not in ORDERS:
        raise ConfigError(f"no loop of order {order}", key="order", advice="take 1, 2 or 3")


def _unit_filter(order: int, log_frequency: float) -> LoopFilter:
    """Return the steady Kalman filter for T = 1 and var y = 1 whose driving noise has the variance w^(2 order).

    The noise is the last difference of the phase, so that the filter for endless noise is the deadbeat loop. Solved in
    states over powers of w, in which all elements have one size.
    """
    w = math.exp(log_frequency)
    scale = min(w, 1.0) ** np.arange(order)
    F = transition(order, min(w, 1.0))
    G = w**order * np.array(_LAST_DIFFERENCE[order]) / scale
    H = np.zeros((1, order))
    H[0, 0] = 1.0
    P = linalg.solve_discrete_are(F.T, H.T, np.outer(G, G), np.eye(1))
    return LoopFilter(np.asarray(P[:, 0] / (P[0, 0] + 1.0)), np.zeros(order), min(w, 1.0))


def _largest_stable_bt(K: Float64, bandwidth_hz: float) -> float:
    """Return B T at which gains of this shape become unstable."""

    def radius(log_step: float) -> float:
        loop = LoopFilter(K * math.exp(log_step), np.zeros(len(K)), math.exp(log_step))
        return float(np.max(np.abs(np.linalg.eigvals(loop.closed_loop())))) - 1.0

    low = math.log(1e-2 / bandwidth_hz)
    return bandwidth_hz * math.exp(float(optimize.brentq(radius, low, low + 10.0)))
