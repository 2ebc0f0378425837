"""What the first command of an installation compiles, for itself and for those that come after it.

``check``, ``point``, ``replay`` and ``simulate`` need it; what only some of their options need (masking, the trace, the
smoother) is compiled where it is first called. ``python -c "from insgnss.first_run import main; main()"`` compiles it
without a command.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

from insgnss.compiled_ahead import SHARED, compile_list, compiled_ahead, is_complete

_MODULE: Final = "insgnss.first_run"
_ABOUT: Final = "compiling, once per installation (about half a minute)"


def calls() -> dict[Callable[..., Any], tuple[Any, ...]]:
    """Return the kernels, each with arguments of the types it is called with, the longest to compile about first."""
    # a process that compiles loads them; one that finds everything compiled need not
    from insgnss.filter import loop_calls
    from insgnss.gnss import point_calls
    from insgnss.simulation import truth_calls

    return {**loop_calls.calls(), **point_calls.calls(), **truth_calls.calls()}


@contextmanager
def compiled(tell: Callable[[str], None] = lambda words: None) -> Iterator[None]:
    """Let the kernels be compiled beside what is done inside, and have them all at its end.

    Parameters
    ----------
    tell : is told that one has to wait, where the cache lacks them
    """
    with compiled_ahead(_MODULE) as beside:
        yield
        if not is_complete():
            tell(_ABOUT)
            beside.wait()


def main() -> None:
    """Compile them all: as one of several processes where it was started so, else by starting them."""
    if sys.argv[1:] == [SHARED]:
        compile_list(calls())
        return
    with compiled(print):
        pass


if __name__ == "__main__":
    main()
