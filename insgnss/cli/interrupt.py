"""Ctrl-C while the command line is loaded: one line and the exit code of an interrupt, no traceback.

Loading takes a second or more, before there is a command that could answer an interrupt. Until then the process just
ends, as nothing is written yet. A program that imports the package keeps its own answer.
"""

from __future__ import annotations

import os
import signal
import sys
from itertools import pairwise
from pathlib import PurePath
from types import FrameType
from typing import Final

INTERRUPTED: Final = 130
_COMMANDS: Final = {"insgnss", "insgnss-script"}
_MODULES: Final = {"insgnss", "insgnss.cli"}


def end_at_interrupt() -> None:
    """Let an interrupt end this process at once, if it runs the command line and nothing else answers interrupts."""
    if _is_command_line() and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)


def raise_at_interrupt() -> None:
    """Let an interrupt raise KeyboardInterrupt again, from when the command line catches it."""
    if signal.getsignal(signal.SIGINT) is _end:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _is_command_line() -> bool:
    """Return whether this process runs ``insgnss`` or ``python -m insgnss`` itself, not as its worker process."""
    name = PurePath(next(iter(getattr(sys, "argv", [])), "")).stem
    words = getattr(sys, "orig_argv", [])
    if name == "-m":
        return any(option.endswith("m") and module in _MODULES for option, module in pairwise(words))
    return name in _COMMANDS and "--multiprocessing-fork" not in words


def _end(_number: int, _frame: FrameType | None) -> None:
    os.write(2, b"insgnss: interrupted\n")
    os._exit(INTERRUPTED)


end_at_interrupt()
