"""Settings that change a few keys of others: by dotted key, as ``--set`` gives them, or table within table."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

from insgnss.errors import ConfigError


def merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tables of ``base`` with the keys of ``changes`` in place of theirs; arrays are replaced whole."""
    both = dict(base)
    for key, value in changes.items():
        below = both.get(key)
        is_table = isinstance(value, Mapping) and isinstance(below, Mapping)
        both[key] = merged(below or {}, value) if is_table else value
    return both


def assignments(texts: Sequence[str]) -> dict[str, Any]:
    """Return what options like ``gates.pseudorange_sigma=4`` set, by dotted key.

    A value is written as in TOML: ``4``, ``true``, ``["C1C", "C5Q"]``, ``{ R = 2.0 }``; a text needs no quotes.

    Raises
    ------
    ConfigError : no key or no value; a key twice
    """
    found: dict[str, Any] = {}
    for text in texts:
        key, equals, value = (part.strip() for part in text.partition("="))
        if not (key and equals and value):
            raise ConfigError(
                f"'{text}' is not a KEY=VALUE setting",
                key="--set",
                advice="write KEY=VALUE, as in gates.pseudorange_sigma=4",
            )
        if key in found:
            raise ConfigError(f"'{key}' is set twice", key="--set", advice="keep one of them")
        found[key] = _value(value)
    return found


def entry(settings: Mapping[str, Any], keys: Sequence[str]) -> Any:
    """Return an entry of nested tables by its keys, the outermost first; None if a table or the entry is missing."""
    value: Any = settings
    for key in keys:
        value = value.get(key) if isinstance(value, Mapping) else None
    return value


def as_tables(changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return changes whose keys may be dotted as tables within tables."""
    tables: dict[str, Any] = {}
    for key, value in changes.items():
        inner = as_tables(value) if isinstance(value, Mapping) else value
        for part in reversed(str(key).split(".")):
            inner = {part: inner}
        tables = merged(tables, inner)
    return tables


def _value(text: str) -> Any:
    """Return a value as TOML reads it, the text itself where TOML does not."""
    try:
        table = tomllib.loads(f"value = {text}")
    except tomllib.TOMLDecodeError:
        return text
    return table["value"] if len(table) == 1 else text
