"""Estimates from prompt correlators: C/N0 (by moments, by narrow- over wide-band power), lock, cycle slips.

Both estimates of C/N0 are consistent at any C/N0: the powers are averaged over a window before they are divided, so
that no bias remains but that of a finite window. Simulated, 1 ms and windows of a second: below 0.03 dB from 25 dBHz
on, with a scatter of 0.25 dB (30 dBHz, narrow-wide) and 0.7 dB (moments); at 20 dBHz narrow-wide still works (-0.05 dB,
scatter 0.7 dB), while the moments of noise swallow those of the signal in four of ten windows.

Lock detectors are of the phase and of the frequency, with the bias that noise gives them, and hysteresis.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.errors import ConfigError
from insgnss.tables import Bool, Complex, Float64
from insgnss.tracking.admissible import require_positive, require_within

SLIP_SHARE: Final = 0.75  # of the aperture: halfway between the unstable point and the next stable one
SYMBOL_BLOCK: Final = 20  # integrations of 1 ms in a bit of GPS


def phase_lock(prompt: Complex, block: int, blocks: int = 1, unbiased: bool = True) -> Float64:
    """Return cos 2 e_phi as seen by sums over blocks, (n // (block blocks), ...): near 1 in lock, near 0 without.

    Equation: sum (I_s^2 - Q_s^2) / sum (I_s^2 + Q_s^2)                               [Van Dierendonck 1996, 8.VI.E]
    Noise lies in the denominator and makes it a M / (a M + 2) times too small; ``unbiased`` takes it out with the
    powers of the single integrations: sum |Z_s|^2 - sum |Z|^2 = M (M - 1) a^2 on average.

    Parameters
    ----------
    prompt : (n, ...) of consecutive integrations
    block : M, number of integrations that are summed, within one sign of the data
    blocks : number of blocks for each value
    unbiased : with the noise taken out (needs blocks of at least 2); then single values may lie above 1
    """
    Z = _grouped(prompt, block, blocks)
    sums = Z.sum(axis=2)
    difference = (sums.real**2 - sums.imag**2).sum(axis=1)
    total = (np.abs(sums) ** 2).sum(axis=1)
    if not unbiased:
        return np.asarray(difference / total)
    if block < 2:
        raise ConfigError(
            "a single integration does not show its noise", key="block", advice="sum at least two"
        )
    noise_free = (total - (np.abs(Z) ** 2).sum(axis=(1, 2))) * block / (block - 1.0)
    return np.asarray(difference / noise_free)


def expected_phase_lock(phase_rad: npt.ArrayLike, a: float, block: int) -> Float64:
    """Return the expected value of ``phase_lock``, noise included.

    Equation: cos(2 e_phi) a M / (a M + 2)
    """
    return np.asarray(np.cos(2.0 * np.asarray(phase_rad, float)) * a * block / (a * block + 2.0))


def frequency_lock(prompt: Complex, window: int) -> Float64:
    """Return cos 2 w T as seen by pairs of integrations that follow each other, whatever the data, (n // window, ...).

    Equation: sum Re (Z1* Z2)^2 / sum |Z1 Z2|^2; on average cos(2 w T) (a / (a + 2))^2
    """
    pair = np.conj(prompt[:-1]) * prompt[1:]
    squares = _grouped(pair, window, 1)[:, 0] ** 2
    return np.asarray(squares.real.sum(axis=1) / np.abs(squares).sum(axis=1))


def expected_frequency_lock(frequency_radps: npt.ArrayLike, a: float, integration_s: float) -> Float64:
    """Return the expected value of ``frequency_lock``.

    Equation: cos(2 w T) (a p / (a p + 2))^2, p = sinc^2(w T / 2)
    """
    w = np.asarray(frequency_radps, float)
    kept = a * np.sinc(w * integration_s / (2.0 * math.pi)) ** 2
    return np.asarray(np.cos(2.0 * w * integration_s) * (kept / (kept + 2.0)) ** 2)


def locked(indicator: Float64, enter: float, leave: float, patience: int = 1) -> Bool:
    """Return whether a channel counts as locked at each value of an indicator, (n,): with hysteresis and patience.

    Parameters
    ----------
    indicator : (n,), NaN counts as low
    enter, leave : lock begins at ``enter`` and ends below ``leave``
    patience : that many values in a row decide
    """
    require_within(-1.0, 1.0, "an indicator lies between -1 and 1", enter=enter)
    if not leave <= enter or patience < 1:
        advice = "give leave below enter, and at least one value"
        raise ConfigError("a hysteresis needs two limits in order", key="leave", advice=advice)
    state, run = False, 0
    found = np.zeros(len(indicator), np.bool_)
    for k, value in enumerate(indicator):
        against = not value >= leave if state else bool(value >= enter)
        run = run + 1 if against else 0
        if run >= patience:
            state, run = not state, 0
        found[k] = state
    return found


def slip_time_s(phase_error_rad: Float64, step_s: float, aperture_rad: float) -> Float64:
    """Return when the phase error of each channel first leaves its stable point for another, (m,); inf if never.

    Equation: |error| > 0.75 aperture
    """
    beyond = np.abs(phase_error_rad) > SLIP_SHARE * aperture_rad
    first = np.argmax(beyond, axis=0)
    return np.asarray(np.where(beyond.any(axis=0), (first + 0.5) * step_s, np.inf))


def _grouped(values: Complex, block: int, blocks: int) -> Complex:
    """Return values as (groups, blocks, block, ...), without an incomplete last group."""
    size = block * blocks
    if block < 1 or blocks < 1 or len(values) < size:
        raise ConfigError(
            f"{len(values)} integrations hold no {blocks} blocks of {block}",
            key="block",
            advice="take smaller or fewer blocks",
        )
    count = len(values) // size
    return np.asarray(values[: count * size].reshape(count, blocks, block, *values.shape[1:]))


def signal_of_moments(second: Float64, fourth: Float64) -> Float64:
    """Return the signal's part P_s of the second moment of magnitudes; NaN where noise alone makes it imaginary."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(2.0 * second**2 - fourth))


def moment_cn0_dbhz(prompt: Complex, integration_s: float, window: int) -> Float64:
    """Return C/N0 of each window [dBHz], (n // window, ...): second and fourth moment of the magnitude.

    Equation: P_s = sqrt(2 M2^2 - M4), P_n = M2 - P_s, q = P_s / (P_n T)     [Pauluzzi & Beaulieu 2000, IEEE Trans.
              Comm. 48, 1681]: E|Z|^2 = a^2 + 2 a, E|Z|^4 = a^4 + 8 a^3 + 8 a^2
    Phase and data do not matter. NaN where noise alone makes the root imaginary.
    """
    power = np.abs(_windows(prompt, integration_s, window)) ** 2
    second, fourth = power.mean(axis=1), (power**2).mean(axis=1)
    signal = signal_of_moments(second, fourth)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(10.0 * np.log10(signal / (second - signal) / integration_s))


def narrow_wide_cn0_dbhz(
    prompt: Complex, integration_s: float, window: int, block: int = SYMBOL_BLOCK
) -> Float64:
    """Return C/N0 of each window [dBHz], (n // window, ...): power of sums over sums of powers.

    Equation: mu = sum_blocks |sum Z|^2 / sum |Z|^2, q = (mu - 1) / ((M - mu) T)      [Van Dierendonck 1996, 8.VI.D]
    The blocks must not reach across a change of sign of the data, and the phase must stand still within one. NaN where
    noise alone makes the ratio too small or too large.

    Parameters
    ----------
    prompt : (n, ...) of consecutive integrations, the first of which begins a symbol
    integration_s, window : length of an integration, and number of them for each estimate
    block : M, number of integrations that are summed, a whole number of which fills a window
    """
    if block < 2 or window % block:
        advice = f"take a window of {max(2, block) * max(1, window // max(2, block))} integrations"
        raise ConfigError(f"blocks of {block} do not fill a window of {window}", key="block", advice=advice)
    Z = _windows(prompt, integration_s, window)
    sums = Z.reshape(Z.shape[0], window // block, block, *Z.shape[2:]).sum(axis=2)
    mu = (np.abs(sums) ** 2).sum(axis=1) / (np.abs(Z) ** 2).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(10.0 * np.log10((mu - 1.0) / (block - mu) / integration_s))


def _windows(prompt: npt.ArrayLike, integration_s: float, window: int) -> Complex:
    """Return the correlators as (windows, window, ...), without an incomplete last one."""
    require_positive(integration_s=integration_s)
    Z = np.asarray(prompt, np.complex128)
    if window < 2 or len(Z) < window:
        advice = f"take a window of 2 to {len(Z)} integrations"
        raise ConfigError(f"no window of {window} in {len(Z)} integrations", key="window", advice=advice)
    count = len(Z) // window
    return Z[: count * window].reshape(count, window, *Z.shape[1:])
