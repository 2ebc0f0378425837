"""What numbers and names this room accepts: typed errors that say the limit and what to do."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable
from typing import Final

import numpy as np

from insgnss.errors import ConfigError

CN0_SPAN_DBHZ: Final = (-30.0, 100.0)  # beyond it the unit must be wrong: receivers see 10 to 60


def require_positive(advice: str = "", **named: float) -> None:
    """Refuse numbers that are not finite and above zero.

    Raises
    ------
    ConfigError : names the first one
    """
    for key, value in named.items():
        if not (math.isfinite(value) and value > 0.0):
            raise ConfigError(
                f"{value:g} must be finite and above 0", key=key, advice=advice or f"give a positive {key}"
            )


def require_not_negative(advice: str = "", **named: float) -> None:
    """Refuse numbers that are not finite or below zero.

    Raises
    ------
    ConfigError : names the first one
    """
    for key, value in named.items():
        if not (math.isfinite(value) and value >= 0.0):
            raise ConfigError(
                f"{value:g} must be finite and not below 0", key=key, advice=advice or f"give 0 or more {key}"
            )


def require_within(low: float, high: float, advice: str, **named: float) -> None:
    """Refuse numbers outside of [low, high], or no numbers.

    Raises
    ------
    ConfigError : names the first one and the limits
    """
    for key, value in named.items():
        if not low <= value <= high:
            raise ConfigError(f"{value:g} is outside of {low:g} ... {high:g}", key=key, advice=advice)


def require_known(name: str, known: Iterable[str], key: str, what: str) -> str:
    """Return the name if it is known.

    Raises
    ------
    ConfigError : with the nearest known name
    """
    names = list(known)
    if name in names:
        return name
    near = difflib.get_close_matches(name.lower(), names, n=1, cutoff=0.4)
    advice = f"nearest: '{near[0]}'" if near else f"known: {', '.join(names[:12])}"
    raise ConfigError(f"unknown {what} '{name}'", key=key, advice=advice)


def seeded(seed: int, key: int) -> np.random.Generator:
    """Return the generator of one seed and one key: independent of all others of the same seed.

    Raises
    ------
    ConfigError : a negative seed
    """
    if seed < 0:
        raise ConfigError(f"invalid seed {seed}", key="seed", advice="give a whole number of 0 or more")
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(key,)))


def linear_cn0_hz(cn0_dbhz: float) -> float:
    """Return C/N0 in Hz.

    Raises
    ------
    ConfigError : the ratio is not a number, or so far from any receiver's that its unit must be wrong
    """
    require_within(
        *CN0_SPAN_DBHZ, "give C/N0 in dBHz (receivers see 10 to 60), not as a ratio", cn0_dbhz=cn0_dbhz
    )
    return float(10.0 ** (cn0_dbhz / 10.0))


def signal_ratio(cn0_dbhz: float, integration_s: float) -> float:
    """Return a = 2 q T, the mean and variance of a matched correlator [-].

    Raises
    ------
    ConfigError : C/N0 or the integration time make no sense
    """
    require_positive("integration times lie between 0.1 ms and some seconds", integration_s=integration_s)
    return 2.0 * linear_cn0_hz(cn0_dbhz) * integration_s
