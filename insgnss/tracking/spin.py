"""A spinning vehicle: an antenna off the spin axis of a sounding rocket, and loops with the axial gyro or without.

The phase centre at a radius turns with the body; along the line of sight, which makes an angle theta with the axis, the
carrier phase swings by beta sin theta, beta = 2 pi rho / lambda.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy import optimize

from insgnss.constants import C_MPS
from insgnss.errors import ConfigError
from insgnss.tables import Complex, Float64
from insgnss.tracking.admissible import require_not_negative, require_positive, require_within
from insgnss.tracking.aiding_source import AidingSource
from insgnss.tracking.loop_filters import LoopFilter

PHASE_LIMIT_RAD: Final = math.pi / 4.0  # half of the way to the unstable point of a loop with data
_SLOWEST_HZ: Final = 1e-3


@dataclass(frozen=True)
class Spin:
    """Geometry and rate of a spin about a fixed axis."""

    radius_m: float
    rate_hz: float
    carrier_hz: float
    start_rad: float = 0.0  # spin angle at time zero
    theta_rad: float = 0.5 * math.pi  # between line of sight and axis: across is the worst

    def __post_init__(self) -> None:
        require_positive(radius_m=self.radius_m, carrier_hz=self.carrier_hz)
        require_not_negative(rate_hz=self.rate_hz)
        require_within(0.0, math.pi, "angles are in radians", theta_rad=self.theta_rad)

    @property
    def amplitude_rad(self) -> float:
        """Return the swing of the carrier phase.

        Equation: beta sin theta, beta = 2 pi rho / lambda
        """
        return 2.0 * math.pi * self.radius_m * self.carrier_hz / C_MPS * math.sin(self.theta_rad)

    @property
    def doppler_hz(self) -> float:
        """Return the amplitude of the Doppler: beta f_s."""
        return self.amplitude_rad * self.rate_hz

    @property
    def speed_mps(self) -> float:
        """Return the speed of the phase centre along the line of sight, at most: 2 pi f_s rho sin theta."""
        return 2.0 * math.pi * self.rate_hz * self.radius_m * math.sin(self.theta_rad)

    @property
    def acceleration_radps2(self) -> float:
        """Return the amplitude of the phase's second derivative: beta (2 pi f_s)^2."""
        return self.amplitude_rad * (2.0 * math.pi * self.rate_hz) ** 2

    def phase_rad(self, t_s: npt.ArrayLike) -> Float64:
        """Return the phase of the swing.

        Equation: beta sin theta cos(2 pi f_s t + psi0)
        """
        angle = 2.0 * math.pi * self.rate_hz * np.asarray(t_s, float) + self.start_rad
        return np.asarray(self.amplitude_rad * np.cos(angle))

    def residual_rad(self, angle_error_rad: float) -> float:
        """Return the residual amplitude after compensation with an error of the spin angle, at any spin rate.

        Equation: 2 beta sin theta sin(dpsi / 2)
        """
        return 2.0 * self.amplitude_rad * abs(math.sin(0.5 * angle_error_rad))


def continuous_error_response(gains: npt.ArrayLike, frequency_hz: npt.ArrayLike) -> Complex:
    """Return 1 - H(j 2 pi f) of a continuous loop with the gains K1, K2, K3.

    Equation: s^n / (s^n + K1 s^(n-1) + ... + Kn)
    """
    K = np.asarray(gains, float)
    s = 2j * np.pi * np.asarray(frequency_hz, float)
    return np.asarray(s ** len(K) / np.polyval(np.concatenate([[1.0], K]), s))


def loop_error_rad(spin: Spin, loop: LoopFilter, amplitude_rad: float | None = None) -> float:
    """Return the amplitude of the phase error of a linear loop under the spin.

    Equation: beta |1 - H(f_s)|

    Parameters
    ----------
    amplitude_rad : the remaining swing, all of it unless compensated
    """
    size = spin.amplitude_rad if amplitude_rad is None else amplitude_rad
    return size * float(abs(1.0 - loop.response(spin.rate_hz)))


def spin_limit_hz(
    radius_m: float, carrier_hz: float, gains: npt.ArrayLike, limit_rad: float = PHASE_LIMIT_RAD
) -> float:
    """Return the spin rate up to which a continuous loop without compensation stays below a phase error.

    Equation: beta |1 - H(j 2 pi f)| = limit, the lowest f

    Raises
    ------
    ConfigError : the swing itself stays below the limit, at any rate
    """
    amplitude = Spin(radius_m, 1.0, carrier_hz).amplitude_rad

    def excess(log_hz: float) -> float:
        response = continuous_error_response(gains, math.exp(log_hz))
        return amplitude * float(abs(response)) - limit_rad

    grid = np.linspace(math.log(_SLOWEST_HZ), math.log(1e5), 400)
    above = np.flatnonzero([excess(x) >= 0.0 for x in grid])
    if above.size == 0 or above[0] == 0:
        raise ConfigError(
            f"at no spin rate does a swing of {amplitude:.3g} rad cause an error of {limit_rad:.3g} rad in this loop",
            key="limit_rad",
            advice="no limit is needed where the swing is smaller; otherwise check the gains",
        )
    return math.exp(float(optimize.brentq(excess, grid[above[0] - 1], grid[above[0]])))


def frequency_limit_hz(radius_m: float, carrier_hz: float, integration_s: float) -> float:
    """Return the spin rate at which the Doppler's amplitude reaches what a frequency loop with data can see.

    Equation: beta f_s = 1 / (4 T)
    """
    require_positive(integration_s=integration_s)
    return 0.25 / integration_s / Spin(radius_m, 1.0, carrier_hz).amplitude_rad


def spin_source(
    spin: Spin,
    t_s: Float64,
    spin_rate_radps: npt.ArrayLike,
    start_rad: float,
    latency_s: float = 0.0,
) -> AidingSource:
    """Return the aiding that an axial gyro gives for the swing: its rate at the integrated spin angle.

    Equation: rate = -beta sin theta w sin(psi), psi = psi0 + int w dt by the trapezoid,
              acceleration = -beta sin theta w^2 cos(psi)

    Parameters
    ----------
    spin : radius, carrier and line of sight as known to the receiver; its rate and start are not used
    t_s, spin_rate_radps : samples of the axial gyro, (n,)
    start_rad : spin angle at the first sample, as known

    Raises
    ------
    ConfigError : not one rate for each time
    """
    rate = np.asarray(spin_rate_radps, float)
    if rate.shape != np.shape(t_s):
        advice = "give the gyro's rate at each time"
        raise ConfigError(f"{rate.size} rates at {np.size(t_s)} times", key="spin_rate_radps", advice=advice)
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(t_s)
    angle = start_rad + np.concatenate([[0.0], np.cumsum(steps)])
    size = spin.amplitude_rad
    return AidingSource(
        t_s, -size * rate * np.sin(angle), -size * rate**2 * np.cos(angle), latency_s, known_ahead=False
    )
