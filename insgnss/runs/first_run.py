"""Compilation by the first command of an installation, for itself and for later ones.

``check``, ``point``, ``replay`` and ``simulate`` need what ``insgnss.runs.kernel_list`` names; what only some of their
options need (masking, the trace, the smoother), and what only some logs do (ranges of one epoch that contradict each
other, a start far off), is compiled where it is first called.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final

from insgnss.kernels.compiled_ahead import compiled_ahead, is_complete

# run in processes of its own: one that finds everything compiled does not load it
_LIST: Final = "insgnss.runs.kernel_list"
_ABOUT: Final = "compiling once per installation (half a minute to a minute)"


@dataclass
class Compilation:
    """What compiling has cost a command."""

    waited_s: float = 0.0  # after its own work was done

    @property
    def took(self) -> dict[str, float]:
        """The entry for the times of a run; none where nothing was waited for."""
        return {"compile_s": self.waited_s} if self.waited_s else {}


@contextmanager
def compiled(tell: Callable[[str], None] = lambda words: None) -> Iterator[Compilation]:
    """Compile the kernels in parallel with the block, and finish them at its end.

    Parameters
    ----------
    tell : called with a message when the command has to wait
    """
    with compiled_ahead(_LIST) as beside:
        compilation = Compilation()
        yield compilation
        if not is_complete():
            tell(_ABOUT)
            began = time.perf_counter()
            beside.wait()
            compilation.waited_s = time.perf_counter() - began


def main() -> None:
    """Compile them without a command."""
    with compiled(print):
        pass
