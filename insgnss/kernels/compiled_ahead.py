"""Filling an empty cache: the main commands' kernels are compiled once, by a process for each of up to four cores.

The compiler runs on one core and takes most of the time of a first run. So the command that finds the cache empty
starts processes that go through one list of kernels (``runs.kernel_list``), each taking what no other has taken, and
waits for them; the next command compiles nothing. Kernels that do not link each other (``numba_parts.Apart``) can be
compiled in any order. A second command that starts meanwhile has processes and a list of its own.
"""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numba

from insgnss.kernels.jit import CACHE_DIR

# In a call that has a kernel compiled, for any whole number and for any other
ANY_N: Final = 0
ANY_X: Final = 0.0
LONGEST_S: Final = 300.0  # after that the waiting process compiles the rest itself
_MOST_PROCESSES: Final = 4  # the list's longest kernels take a quarter of its time
_RARE_COLLECTIONS: Final = (50_000, 20, 20)  # objects, then rounds of the generation before
_COMPLETE: Final = CACHE_DIR / "complete"  # there once all of the list has machine code
_NOT_ALL: Final = 3  # exit code of a process that has not seen the whole list compiled: another one has
# A module run without the package's face, whose imports (tables, files, settings) a compiler can do without
_RUN_MODULE: Final = """
import runpy, sys, types
face = types.ModuleType("insgnss")
face.__path__ = [sys.argv.pop(1)]
sys.modules["insgnss"] = face
runpy.run_module(sys.argv.pop(1), run_name="__main__", alter_sys=True)
"""


def is_complete() -> bool:
    """Return whether the cache holds every kernel of the main commands; True if the compiler is off."""
    return bool(numba.config.DISABLE_JIT) or _COMPLETE.exists()


@dataclass(frozen=True)
class Companions:
    """The processes that this one has started to compile; none where the cache is complete or cannot be written."""

    processes: tuple[subprocess.Popen[bytes], ...]

    def wait(self) -> None:
        """Wait for their end. The cache is complete once one of them has seen the whole list compiled."""
        until = time.monotonic() + LONGEST_S
        for process in self.processes:
            with suppress(subprocess.TimeoutExpired):
                process.wait(max(until - time.monotonic(), 0.0))
        if any(process.returncode == 0 for process in self.processes):
            with suppress(OSError):
                _COMPLETE.touch()


@contextmanager
def compiled_ahead(module: str) -> Iterator[Companions]:
    """Run a module of the package in processes beside this one; yield them.

    The module compiles kernels for the right types, so that their machine code is in the cache when it is needed here.
    Nothing is started where the cache is complete or cannot be written. If a process fails, the rest
    is compiled here, as all would be without them. No process outlives the block.
    """
    if is_complete() or not _can_start():
        yield Companions(())
        return
    with tempfile.TemporaryDirectory(prefix="taken-", dir=CACHE_DIR, ignore_cleanup_errors=True) as taken:
        processes = _started(module, taken)
        try:
            yield Companions(processes)
        finally:
            for process in processes:
                process.kill()
                process.communicate()


def compile_list(calls: Mapping[Callable[..., Any], tuple[Any, ...]]) -> None:
    """Compile the kernels that no other process has taken, and exit; run by the processes started here."""
    end_with_parent()
    taken = Path(sys.argv[1])
    gc.freeze()  # the modules stay
    with collecting_rarely():
        for kernel, arguments in calls.items():
            if not is_compiled(kernel) and _take(kernel, taken):
                compile_for(kernel, arguments)
    raise SystemExit(0 if all(map(is_compiled, calls)) else _NOT_ALL)


@contextmanager
def collecting_rarely() -> Iterator[None]:
    """Let Python look for cycles of objects less often than it does by itself.

    The compiler makes millions of objects that last; to look through them again and again is a tenth of its time.
    """
    thresholds = gc.get_threshold()
    gc.set_threshold(*_RARE_COLLECTIONS)
    try:
        yield
    finally:
        gc.set_threshold(*thresholds)


def is_compiled(function: Callable[..., Any]) -> bool:
    """Return whether a kernel has machine code, in this process or in the cache; True if the compiler is off."""
    if getattr(function, "stats", None) is None:  # the compiler is switched off
        return True
    dispatcher: Any = function
    folder = Path(dispatcher.stats.cache_path or os.devnull)  # not below ours where that cannot be written
    return bool(dispatcher.signatures) or any(folder.glob(f"*.{function.__name__}-*.nbi"))


def compile_for(function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    """Compile a kernel for the types of some arguments, or load it from the cache, without calling it."""
    dispatcher: Any = function
    if getattr(function, "stats", None) is not None:
        dispatcher.compile(tuple(map(numba.typeof, arguments)))


def end_with_parent() -> None:
    """End this process, started by ``compiled_ahead``, as soon as the one that started it is gone."""

    def listen() -> None:
        os.read(0, 1)  # returns when the other end of the pipe is closed
        signal.raise_signal(signal.SIGTERM)

    threading.Thread(target=listen, daemon=True).start()


def _take(kernel: Callable[..., Any], taken: Path) -> bool:
    """Return whether no process beside this one has begun a kernel, and note in ``taken`` that this one does."""
    try:
        (taken / f"{kernel.__module__}.{kernel.__name__}").touch(exist_ok=False)
    except FileExistsError:
        return False
    return True


def _can_start() -> bool:
    """Return whether the cache can be written."""
    with suppress(OSError):
        CACHE_DIR.mkdir(parents=True, exist_ok=True)
    return bool(sys.executable) and os.access(CACHE_DIR, os.W_OK)


def usable_cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _started(module: str, taken: str) -> tuple[subprocess.Popen[bytes], ...]:
    """Start a module of the package on up to four cores, silent, listening for our end, as far as we may."""
    path = os.pathsep.join(os.path.abspath(entry) for entry in sys.path)
    processes: list[subprocess.Popen[bytes]] = []
    with suppress(OSError):
        for _ in range(min(usable_cores(), _MOST_PROCESSES)):
            processes.append(
                subprocess.Popen(
                    [sys.executable, "-P", "-c", _RUN_MODULE, str(Path(__file__).parents[1]), module, taken],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    env={**os.environ, "PYTHONPATH": path},
                )
            )
    return tuple(processes)
