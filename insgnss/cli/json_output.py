"""What ``--json`` prints: one JSON object on standard output, and nothing else there."""

from __future__ import annotations

import json
from typing import Any

import typer

from insgnss.report.digest import without_nan


def print_json(summary: dict[str, Any]) -> None:
    """Print a summary of plain data; numbers that JSON cannot write become null."""
    typer.echo(json.dumps(without_nan(summary), allow_nan=False, default=str))
