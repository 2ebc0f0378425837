"""Thermal noise of a receiver's loops from C/N0: delay lock, phase lock and frequency lock."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insgnss.constants import C_MPS
from insgnss.tables import Float64


def _ratio(cn0_dbhz: Float64) -> Float64:
    """Return carrier over noise density as a ratio [Hz]; below 10 dBHz, where nothing is tracked, as there."""
    return np.asarray(10.0 ** (0.1 * np.maximum(cn0_dbhz, 10.0)))


@dataclass(frozen=True)
class CodeLoopNoise:
    """A delay lock loop, early minus late power.

    Equation: ``s^2 = B d / (2 C/N0) (1 + 2 / ((2 - d) T C/N0))`` [chips^2]    [Kaplan and Hegarty (2017), 8.4.2]
    """

    bandwidth_hz: float
    spacing_chips: float  # early to late
    integration_s: float
    chip_m: float | Float64  # of all columns, or of each

    def sigma(self, elevation: Float64, cn0_dbhz: Float64) -> Float64:
        """Return sigma [m]."""
        c, d = _ratio(cn0_dbhz), self.spacing_chips
        squaring = 1.0 + 2.0 / ((2.0 - d) * self.integration_s * c)
        return np.asarray(self.chip_m * np.sqrt(self.bandwidth_hz * d / (2.0 * c) * squaring))


@dataclass(frozen=True)
class CarrierLoopNoise:
    """A Costas loop.

    Equation: ``s^2 = (wavelength / 2 pi)^2 B / C/N0 (1 + 1 / (2 T C/N0))``       [Kaplan and Hegarty (2017), 8.3]
    """

    bandwidth_hz: float
    integration_s: float
    wavelength_m: float | Float64  # of all columns, or of each

    def sigma(self, elevation: Float64, cn0_dbhz: Float64) -> Float64:
        """Return sigma [m]."""
        c = _ratio(cn0_dbhz)
        squaring = 1.0 + 1.0 / (2.0 * self.integration_s * c)
        return np.asarray(self.wavelength_m / (2.0 * np.pi) * np.sqrt(self.bandwidth_hz / c * squaring))


@dataclass(frozen=True)
class FrequencyLoopNoise:
    """A frequency lock loop, which gives the Doppler.

    Equation: ``s = wavelength / (2 pi T) sqrt(4 B / C/N0 (1 + 1 / (T C/N0)))``   [Kaplan and Hegarty (2017), 8.3]
    """

    bandwidth_hz: float
    integration_s: float
    wavelength_m: float | Float64  # of all columns, or of each

    def sigma(self, elevation: Float64, cn0_dbhz: Float64) -> Float64:
        """Return sigma [m/s]."""
        c = _ratio(cn0_dbhz)
        jitter = np.sqrt(4.0 * self.bandwidth_hz / c * (1.0 + 1.0 / (self.integration_s * c)))
        return np.asarray(self.wavelength_m / (2.0 * np.pi * self.integration_s) * jitter)


CA_CHIP_M = C_MPS / 1.023e6  # IS-GPS-200N, 3.2.1.3
