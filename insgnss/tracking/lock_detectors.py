"""Lock detectors: of the phase and of the frequency, with the bias that noise gives them, hysteresis, and slips."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.errors import ConfigError
from insgnss.tables import Bool, Complex, Float64
from insgnss.tracking.admissible import require_within

SLIP_SHARE: Final = 0.75  # of the aperture: halfway between the unstable point and the next stable one


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
        raise ConfigError("one integration has no noise of its own", key="block", advice="sum at least two")
    noise_free = (total - (np.abs(Z) ** 2).sum(axis=(1, 2))) * block / (block - 1.0)
    return np.asarray(difference / noise_free)


def expected_phase_lock(phase_rad: npt.ArrayLike, a: float, block: int) -> Float64:
    """Return what ``phase_lock`` gives on average with the noise left in.

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
    """Return what ``frequency_lock`` gives on average.

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
