"""Errors of a whole table that one of its keys makes: they name that key."""

from __future__ import annotations

from collections.abc import Sequence


class KeyValueError(ValueError):
    """What is wrong with a table, the keys and indices in it that lead to what to change, and what to do."""

    def __init__(self, message: str, *place: str | int, advice: str = "") -> None:
        super().__init__(message)
        self.place = place
        self.advice = advice


def require_own_names(names: Sequence[str], what: str, table: str) -> None:
    """Refuse an array of tables of which two have one name; ``what`` they are, in the plural.

    Raises
    ------
    KeyValueError : they do
    """
    for k, name in enumerate(names):
        if name in names[:k]:
            message = f"two {what} are called '{name}': give each a name of its own"
            raise KeyValueError(message, table, k, "name")
