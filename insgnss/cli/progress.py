"""A command's progress display: on standard error, in a terminal only; silent in a pipe or a log file."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress


@contextmanager
def telling(first: str) -> Iterator[Callable[[str], None]]:
    """Show the current step and its duration; the yielded function takes the words of the next step."""
    # a command that fails on its options does without the library
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(f"{first} ...", total=None)
        yield lambda words: bar.update(task, description=f"{words} ...")


@contextmanager
def counting() -> Iterator[Progress]:
    """Show bars with the share that is done and the time that is left; tasks are added to what is yielded."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        yield bar


def compiling(took: Mapping[str, float]) -> str:
    """Return the beginning of a line of times: how long a first command waited for the compiler, else nothing."""
    return f"compiling {took['compile_s']:.2f} s, " if "compile_s" in took else ""
