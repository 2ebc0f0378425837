"""Checks of numbers and names for the tracking package: typed errors that state the limit and the remedy."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable
from typing import Final, SupportsFloat

import numpy as np

from insgnss.errors import ConfigError

CN0_SPAN_DBHZ: Final = (-30.0, 100.0)  # beyond it the unit must be wrong: receivers see 10 to 60


def require_number(key: str, value: object) -> float:
    """Return a number; infinity and NaN are allowed.

    Raises
    ------
    ConfigError : it is text, a truth value or nothing
    """
    # a number by its type first: to ask an object for its methods takes ten times as long
    if isinstance(value, bool | np.bool_) or not isinstance(value, (float, int, SupportsFloat)):
        raise ConfigError(f"{value!r} is not a number", key=key, advice=f"give a number for {key}")
    return float(value)


def require_whole(least: int, advice: str, **named: object) -> None:
    """Refuse anything but a whole number of at least ``least``.

    Raises
    ------
    ConfigError : names the first one
    """
    for key, value in named.items():
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
            raise ConfigError(f"{value!r}: a whole number from {least} on is needed", key=key, advice=advice)


def require_truth_value(**named: object) -> None:
    """Refuse anything but true or false.

    Raises
    ------
    ConfigError : names the first one
    """
    for key, value in named.items():
        if not isinstance(value, bool | np.bool_):
            raise ConfigError(f"{value!r} is neither true nor false", key=key, advice="give True or False")


def require_seed(seed: object) -> None:
    """Refuse an invalid seed.

    Raises
    ------
    ConfigError : a negative one, or not a whole number
    """
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise ConfigError(f"invalid seed {seed!r}", key="seed", advice="give a whole number of 0 or more")


def require_positive(advice: str = "", **named: float) -> None:
    """Refuse numbers that are not finite and above zero.

    Raises
    ------
    ConfigError : names the first one
    """
    for key, value in named.items():
        if not (math.isfinite(require_number(key, value)) and value > 0.0):
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
        if not (math.isfinite(require_number(key, value)) and value >= 0.0):
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
        if not low <= require_number(key, value) <= high:
            raise ConfigError(f"{value:g} is outside of {low:g} ... {high:g}", key=key, advice=advice)


def require_known(name: str, known: Iterable[str], key: str, what: str) -> str:
    """Return the name if it is known.

    Raises
    ------
    ConfigError : with the nearest known name
    """
    names = list(known)
    if not isinstance(name, str):
        raise ConfigError(f"{name!r} is not a {what}", key=key, advice=f"known: {', '.join(names[:12])}")
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
    require_seed(seed)
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
