"""The spin angle as a state of a phase loop: a side antenna finds its angle and spin rate from the signal itself.

An antenna of circular polarisation looks outwards at a radius from the spin axis; psi is its angle from the direction
in which it is nearest to the satellite, theta the angle between axis and line of sight. Its crossed dipoles (along
the axis, and along the turn) receive the signal with the gain                           [Wu et al. 1993, (25)-(30)]

    h(psi) = (sin theta + cos psi + j cos theta sin psi) / (1 + sin theta)

whose modulus is the modulation of the gain and whose angle the wind-up: a cardioid without wind-up across the axis
(theta = 90 deg), one turn of phase in a turn of the body along it. A correlator of the prompt replica is then

    Z = a h(psi) exp(j (phi + beta cos psi)) + noise,    phi' = w,    psi' = Omega,    w' and Omega' white noise

with phi the phase at the axis less the replica's. Both quadratures are observations of an extended Kalman filter over
[phi, w, psi, Omega]. Nothing is known of psi and phi at first, and little of Omega: a bank of filters starts at
angles and rates all around, and the likelihood decides. No resolver and no gyro is used.
Neglects: the swing within an integration (take 1/50 of a turn at most), and data bits: they must be taken off.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.errors import ConfigError
from insgnss.tables import Complex, Float64
from insgnss.tracking.admissible import require_not_negative, require_positive, signal_ratio
from insgnss.tracking.spin import Spin

PHI, DOPPLER, ANGLE, SPIN_RATE = range(4)
_ANGLES: Final = 16  # from which the bank begins
_RATIO: Final = 1.08  # of neighbouring spin rates: half of it are 0.25 rad in a turn
_SD_PHI_RAD: Final = 0.5  # of the phase that the first correlator gives
_LOST: Final = 30.0  # by which a log likelihood is below the best one's when its filter is given up
_STEPS_OF_A_TURN: Final = 50.0


def dipole_gain(angle_rad: npt.ArrayLike, theta_rad: float) -> Complex:
    """Return h(psi), the gain of a side antenna with its wind-up, 1 where it is nearest, as ``angle_rad``.

    Equation: (sin theta + cos psi + j cos theta sin psi) / (1 + sin theta)
    """
    psi = np.asarray(angle_rad, np.float64)
    s, c = math.sin(theta_rad), math.cos(theta_rad)
    return np.asarray((s + np.cos(psi) + 1j * c * np.sin(psi)) / (1.0 + s))


@dataclass(frozen=True)
class SpinBank:
    """The b remaining filters; the first is the best."""

    state: Float64  # (b, 4) phase [rad], its rate [rad/s], spin angle [rad], spin rate [rad/s]
    covariance: Float64  # (b, 4, 4)
    log_likelihood: Float64  # (b,)

    @property
    def angle_rad(self) -> float:
        """Return the spin angle, -pi to pi."""
        return math.remainder(float(self.state[0, ANGLE]), 2.0 * math.pi)

    @property
    def rate_hz(self) -> float:
        """Return the spin rate."""
        return float(self.state[0, SPIN_RATE]) / (2.0 * math.pi)

    @property
    def sd(self) -> Float64:
        """Return the sigmas of the best filter's states, (4,)."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance[0])))


@dataclass(frozen=True)
class SpinLoop:
    """The filter's model; of ``spin`` its radius, carrier and theta are used.

    Densities are one-sided, of the carrier's drift and of the spin's acceleration [rad^2/s^3].
    """

    spin: Spin
    cn0_dbhz: float  # where the antenna is nearest
    step_s: float
    drift_density: float
    spin_density: float = 0.01

    def __post_init__(self) -> None:
        require_positive(step_s=self.step_s)
        require_not_negative(drift_density=self.drift_density, spin_density=self.spin_density)
        signal_ratio(self.cn0_dbhz, self.step_s)

    def start(self, Z: complex, rates_hz: tuple[float, float], sd_doppler_hz: float) -> SpinBank:
        """Return the bank after its first correlator.

        Parameters
        ----------
        Z : prompt correlator of the first integration
        rates_hz : the lowest and the highest spin rate
        sd_doppler_hz : one sigma of the replica's frequency error

        Raises
        ------
        ConfigError : rates that are none, or too fast for the integration; a correlator that is not a number
        """
        _require_finite(Z)
        low, high = rates_hz
        require_positive(low_hz=low, high_hz=high, sd_doppler_hz=sd_doppler_hz)
        if not low <= high or high * self.step_s * _STEPS_OF_A_TURN > 1.0 + 1e-9:
            raise ConfigError(
                f"spin rates from {low:g} to {high:g} Hz with integrations of {self.step_s:g} s",
                key="rates_hz",
                advice=f"give two rates in order, up to {1.0 / (_STEPS_OF_A_TURN * self.step_s):g} Hz",
            )
        count = math.ceil(math.log(high / low) / math.log(_RATIO)) + 1
        rates = 2.0 * math.pi * np.geomspace(low, high, count)
        psi, rate = (
            x.ravel() for x in np.meshgrid(2.0 * math.pi * np.arange(_ANGLES) / _ANGLES, rates, indexing="ij")
        )
        phi = np.angle(Z) - self._phase_of(psi)
        sd_rate = 0.5 * (_RATIO - 1.0) * rate
        P = np.zeros((len(psi), 4, 4))
        P[:, PHI, PHI], P[:, DOPPLER, DOPPLER] = _SD_PHI_RAD**2, (2.0 * math.pi * sd_doppler_hz) ** 2
        P[:, ANGLE, ANGLE], P[:, SPIN_RATE, SPIN_RATE] = (math.pi / _ANGLES) ** 2, sd_rate**2
        return SpinBank(np.column_stack([phi, np.zeros_like(phi), psi, rate]), P, np.zeros(len(psi)))

    def step(self, bank: SpinBank, Z: complex) -> SpinBank:
        """Return the bank one integration later, with its correlator; improbable filters are dropped.

        Raises
        ------
        ConfigError : a correlator that is not a number
        """
        _require_finite(Z)
        x, P = self._predicted(bank)
        a = signal_ratio(self.cn0_dbhz, self.step_s)
        expected, by_angle = self._expected(x)
        slope = np.zeros((len(x), 4), np.complex128)
        slope[:, PHI], slope[:, ANGLE] = 1j * a * expected, a * by_angle
        H = np.stack([slope.real, slope.imag], axis=1)
        left = Z - a * expected
        z = np.stack([left.real, left.imag], axis=1)
        P_H = P @ H.transpose(0, 2, 1)
        S = H @ P_H + a * np.eye(2)
        K = P_H @ np.linalg.inv(S)
        x = x + (K @ z[:, :, None])[..., 0]
        P = P - K @ P_H.transpose(0, 2, 1)
        nis = np.einsum("bi,bij,bj->b", z, np.linalg.inv(S), z)
        score = bank.log_likelihood - 0.5 * (nis + np.log(np.linalg.det(S)))
        order = np.argsort(-score)
        order = order[score[order] > score[order[0]] - _LOST]
        P = 0.5 * (P + P.transpose(0, 2, 1))
        return SpinBank(x[order], P[order], score[order] - score[order[0]])

    def _phase_of(self, psi: Float64) -> Float64:
        """Return the phase of the swing and of the wind-up."""
        return np.asarray(
            self.spin.amplitude_rad * np.cos(psi) + np.angle(dipole_gain(psi, self.spin.theta_rad))
        )

    def _expected(self, x: Float64) -> tuple[Complex, Complex]:
        """Return the expected correlators over a, and their derivatives by the angle, (b,)."""
        psi, theta, beta = x[:, ANGLE], self.spin.theta_rad, self.spin.amplitude_rad
        turned = np.exp(1j * (x[:, PHI] + beta * np.cos(psi)))
        h = dipole_gain(psi, theta)
        by_angle = (-np.sin(psi) + 1j * math.cos(theta) * np.cos(psi)) / (1.0 + math.sin(theta))
        return h * turned, (by_angle - 1j * beta * np.sin(psi) * h) * turned

    def _predicted(self, bank: SpinBank) -> tuple[Float64, Float64]:
        T, F, Q = self.step_s, np.eye(4), np.zeros((4, 4))
        for i, density in ((PHI, self.drift_density), (ANGLE, self.spin_density)):
            F[i, i + 1] = T
            block = slice(i, i + 2)
            Q[block, block] = 0.5 * density * np.array([[T**3 / 3.0, T**2 / 2.0], [T**2 / 2.0, T]])
        return bank.state @ F.T, F @ bank.covariance @ F.T + Q


def _require_finite(Z: complex) -> None:
    if not np.isfinite(Z):
        advice = "start again behind a gap"
        raise ConfigError(f"the correlator {Z} is not a number", key="Z", advice=advice)
