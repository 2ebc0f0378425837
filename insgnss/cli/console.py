"""Where a command prints its result: names of flights and satellites unchanged, with any brackets."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console


def result_console(width: int = 120, *, quiet: bool = False) -> Console:
    """Return a console on standard output in which no text is markup."""
    from rich.console import Console  # late: a command that fails on its options does without the library

    return Console(file=sys.stdout, width=width, quiet=quiet, markup=False, emoji=False)
