"""Errors for invalid numbers, with their key and the valid range."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from insgnss.errors import ConfigError, ModelError
from insgnss.tables import Float64

Entry = TypeVar("Entry")


def positive(key: str, value: npt.ArrayLike, advice: str) -> Float64:
    """Return the numbers as an array.

    Raises
    ------
    ConfigError : one of them is not finite or not above zero
    """
    numbers = np.asarray(value, np.float64)
    wrong = ~(np.isfinite(numbers) & (numbers > 0.0))
    if wrong.any():
        first = numbers[wrong].flat[0]
        raise ConfigError(f"{key} is {first:g}: it has to be above zero", key=key, advice=advice)
    return numbers


def not_negative(key: str, value: npt.ArrayLike, advice: str) -> Float64:
    """Return the numbers as an array.

    Raises
    ------
    ConfigError : one of them is not finite or below zero
    """
    numbers = np.asarray(value, np.float64)
    wrong = ~(np.isfinite(numbers) & (numbers >= 0.0))
    if wrong.any():
        first = numbers[wrong].flat[0]
        raise ConfigError(f"{key} is {first:g}: it cannot be below zero", key=key, advice=advice)
    return numbers


def finite(key: str, value: npt.ArrayLike, advice: str) -> Float64:
    """Return the numbers as an array.

    Raises
    ------
    ConfigError : one of them is not a finite number
    """
    numbers = np.asarray(value, np.float64)
    if not np.isfinite(numbers).all():
        raise ConfigError(f"{key} has a value that is not finite", key=key, advice=advice)
    return numbers


def named(kind: str, name: str, entries: Iterable[tuple[str, Entry]]) -> Entry:
    """Return the entry called ``name``; capitals, spaces and signs do not count.

    Raises
    ------
    ModelError : the name is unknown; the advice names the nearest
    """
    known = list(entries)
    wanted = _plain(name)
    for known_name, entry in known:
        if _plain(known_name) == wanted:
            return entry
    plain = {_plain(known_name): known_name for known_name, _ in reversed(known)}
    near = [plain[key] for key in difflib.get_close_matches(wanted, plain, n=3, cutoff=0.4)]
    all_names = ", ".join(dict.fromkeys(known_name for known_name, _ in known))
    advice = f"nearest: {', '.join(near)}" if near else f"known: {all_names}"
    raise ModelError(f"there is no {kind} named '{name}'", advice=advice)


def _plain(name: str) -> str:
    return "".join(character for character in name.casefold() if character.isalnum() or character == "+")
