"""Vibration as a sensor feels it: a spectrum of broad noise and lines, as means over sampling intervals.

What lies above half the sampling rate is not left out but folded down, as in a sensor that integrates over its
interval without a filter before. The vehicle's own place and attitude do not follow: 1 g at 50 Hz moves 0.1 mm.
Of a body that spins the folded part does not average out: what lies a rate of spin beside a multiple of the sampling
rate turns back into a steady force, which walks. 8e-4 g^2/Hz at 200 Hz and 720 deg/s leave 1.0e-5 m^2/s^3 across the
axis of spin.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from insgnss.errors import ConfigError
from insgnss.simulation.course import smoothstep
from insgnss.tables import Float64

_FINER: Final = 4  # samples of a period at least, and of an interval: their mean represents the interval's
RISE_S: Final = 0.5  # of its begin and end: cut off at once it would leave a step of the velocity
_MOST_VALUES: Final = 60_000_000  # of the finer series that the interval means are taken from


@dataclass(frozen=True)
class VibrationSpectrum:
    """One-sided power density between corners (straight lines in log-log), and sines; the same for each axis."""

    frequency_hz: tuple[float, ...] = ()  # of the corners, increasing
    density: tuple[float, ...] = ()  # [unit^2/Hz] at the corners; nothing outside of them
    lines: tuple[tuple[float, float], ...] = ()  # (frequency [Hz], amplitude [unit])
    from_s: float = 0.0  # it comes up within ``RISE_S`` from here on ...
    end_s: float | None = None  # ... and has faded here; None: it stays

    def at(self, frequency_hz: Float64) -> Float64:
        """Return the density at the given frequencies."""
        inside = (frequency_hz >= self.frequency_hz[0]) & (frequency_hz <= self.frequency_hz[-1])
        log_f = np.log(np.maximum(frequency_hz, 1e-12))
        return np.where(
            inside, np.exp(np.interp(log_f, np.log(self.frequency_hz), np.log(self.density))), 0.0
        )

    def rms(self) -> float:
        """Return the root mean square of the broad part, by the trapezoid on a fine logarithmic grid."""
        f: Float64 = np.asarray(np.geomspace(self.frequency_hz[0], self.frequency_hz[-1], 10_001), np.float64)
        return float(np.sqrt(np.trapezoid(self.at(f), f)))


def vibration(count: int, step_s: float, spectrum: VibrationSpectrum, rng: np.random.Generator) -> Float64:
    """Return (count, 3) means of the vibration over sampling intervals, three independent axes.

    Equation: noise ``x = sum_k sqrt(S(f_k) df) (a_k cos + b_k sin)`` with normal a, b; the mean of a sine over an
    interval is ``sin(pi f step) / (pi f step)`` times its value in the middle.
    """
    total = np.zeros((count, 3))
    if spectrum.frequency_hz:
        fold = max(_FINER, math.ceil(_FINER * spectrum.frequency_hz[-1] * step_s))
        if 3 * count * fold > _MOST_VALUES:
            raise ConfigError(
                f"a vibration up to {spectrum.frequency_hz[-1]:g} Hz over {count * step_s:g} s is too long a series",
                advice="end the spectrum nearer to the sampling rate, or simulate less",
            )
        fine = _noise(count * fold, step_s / fold, spectrum, rng)
        total += fine.reshape(count, fold, 3).mean(axis=1)
    middle: Float64 = np.asarray((np.arange(count) + 0.5) * step_s, np.float64)
    for frequency_hz, amplitude in spectrum.lines:
        phase = rng.uniform(0.0, 2.0 * np.pi, 3)
        seen = amplitude * np.sinc(frequency_hz * step_s)
        total += seen * np.sin(2.0 * np.pi * frequency_hz * middle[:, None] + phase)
    if spectrum.from_s > 0.0:
        total *= smoothstep((middle - spectrum.from_s) / RISE_S)[:, None]
    if spectrum.end_s is not None:
        total *= smoothstep((spectrum.end_s - middle) / RISE_S)[:, None]
    return total


def _noise(count: int, step_s: float, spectrum: VibrationSpectrum, rng: np.random.Generator) -> Float64:
    frequency: Float64 = np.asarray(np.fft.rfftfreq(count, step_s), np.float64)
    # a real series of n values with one-sided density S has |X_k|^2 = S n / (2 step)
    size = np.sqrt(spectrum.at(frequency) * count / (2.0 * step_s))
    axes = []
    for _ in range(3):
        parts = rng.standard_normal((2, len(frequency))) / np.sqrt(2.0)
        axes.append(np.fft.irfft(size * (parts[0] + 1j * parts[1]), count))
    return np.column_stack(axes)
