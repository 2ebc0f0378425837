"""The one Numba decorator and the cache policy.

Compiled code is cached in a folder whose name holds a hash of all of the package's own sources and of the versions of
Python, NumPy and Numba: Numba itself only notices an edit of the file a function stands in, not of the functions it
calls. ``NUMBA_DISABLE_JIT=1`` runs every kernel as plain Python (slow, for tests and debuggers).
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import numpy as np

_F = TypeVar("_F", bound=Callable[..., Any])


def source_hash() -> str:
    """Return 16 hexadecimal digits that change when any source file of the package or a compiler version does."""
    digest = hashlib.sha256()
    for text in (sys.version, np.__version__, numba.__version__):
        digest.update(text.encode())
    package = Path(__file__).parent
    for path in sorted(package.rglob("*.py")):
        digest.update(str(path.relative_to(package)).encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def cache_root() -> Path:
    """Return the folder that holds the compiled code: ``INSGNSS_CACHE``, else the user's cache folder."""
    named = os.environ.get("INSGNSS_CACHE")
    if named:
        return Path(named)
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "insgnss"


_CACHE_DIR = str(cache_root() / source_hash())


def _compiled(function: _F, **options: Any) -> _F:
    previous = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = _CACHE_DIR
    try:
        return cast(_F, numba.njit(cache=True, error_model="numpy", **options)(function))
    finally:
        numba.config.CACHE_DIR = previous


def kernel(function: _F) -> _F:
    """Compile ``function`` with Numba on its first call and keep the machine code for the next process.

    No fast mathematics: the same input must give the same bits. ``error_model="numpy"`` lets a division by zero give
    inf, which the gates refuse, instead of a branch at every division.
    """
    return _compiled(function)


def inlined(function: _F) -> _F:
    """Compile a kernel that has one or two callers, woven into them.

    A kernel of its own costs a fifth of a second to compile, because each becomes a module that every caller links and
    optimises again; woven in, it costs nothing of that and runs a little faster. Called from Python it is an ordinary
    kernel.
    """
    return _compiled(function, inline="always")
