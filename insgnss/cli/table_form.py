"""The option ``--format`` of the commands that write tables."""

from __future__ import annotations

from typing import Literal

from insgnss.errors import ConfigError


def table_form(text: str) -> Literal["parquet", "csv"]:
    """Return the format of tables that an option names.

    Raises
    ------
    ConfigError : it is neither
    """
    if text == "parquet":
        return "parquet"
    if text == "csv":
        return "csv"
    raise ConfigError(f"unknown format '{text}'", key="--format", advice="write 'parquet' or 'csv'")
