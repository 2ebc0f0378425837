"""Options that hold several values with commas between them."""

from __future__ import annotations

from insgnss.errors import ConfigError


def names_in(text: str) -> tuple[str, ...]:
    """Return the names, without blanks and without empty ones."""
    return tuple(name.strip() for name in text.split(",") if name.strip())


def numbers_in(text: str, key: str) -> list[float]:
    """Return the numbers.

    Raises
    ------
    ConfigError : one of them is not a number; ``key`` is the option
    """
    try:
        return [float(name) for name in names_in(text)]
    except ValueError:
        raise ConfigError(
            f"'{text}' is not a list of numbers", key=key, advice="write them as in 45,40,35"
        ) from None
