"""The decorator of the kernels and the cache policy.

Compiled code is cached in a folder whose name holds hashes of all of the package's own sources, of the versions of
Python, NumPy and Numba, and of where the package lies: Numba itself only notices an edit of the file of a function, not
of the functions it calls. When a new folder is made, folders of earlier versions unused for 30 days are removed.
Each file ends in its SHA-256: a damaged one is compiled again. The files are pickles and machine code, so files of
another user are never loaded, nor is a folder of another user used.
``NUMBA_DISABLE_JIT=1`` runs every kernel as plain Python (slow, for tests and debuggers).

With an empty cache the compiler takes most of the time of a first run: ``insgnss.kernels.compiled_ahead`` shares it.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import re
import shutil
import stat
import sys
import tempfile
import time
import typing
from collections.abc import Callable
from contextlib import suppress
from datetime import timedelta
from pathlib import Path
from typing import Any, Final, TypeVar, cast, overload

import numba
import numpy as np

from insgnss.kernels.numba_parts import Apart, compiled, is_trusted, warn_at_first_call

UNUSED_DAYS: Final = 30  # compiled code of other versions is removed after so long without use
_DAY_S: Final = timedelta(days=1).total_seconds()
_WITH_BOUNDS: Final = ("checks bounds",) if numba.config.BOUNDSCHECK else ()
_OTHERS_MAY_WRITE: Final = stat.S_IWGRP | stat.S_IWOTH
# what makes an array of its own, of NumPy or as an array's method
_ALLOCATES: Final = frozenset(
    (
        "arange",
        "array",
        "asarray",
        "ascontiguousarray",
        "copy",
        "empty",
        "empty_like",
        "eye",
        "full",
        "ones",
        "zeros",
    )
)
_F = TypeVar("_F", bound=Callable[..., Any])


def source_hash() -> str:
    """Return 16 hexadecimal digits that change when any source file of the package or a compiler version does.

    So they do with ``NUMBA_BOUNDSCHECK``: code that checks every index is other code, which Numba's own cache does not
    tell apart.
    """
    digest = hashlib.sha256()
    for text in (sys.version, np.__version__, numba.__version__, *_WITH_BOUNDS):
        digest.update(text.encode())
    package = Path(__file__).parents[1]
    for path in sorted(package.rglob("*.py")):
        digest.update(str(path.relative_to(package)).encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def cache_name() -> str:
    """Return the name of the folder of this installation's code.

    Numba keeps the code of each place of a file apart: of two installations of the same sources, one that finds the
    other's list complete would compile during its run, in one process and without a message.
    """
    place = hashlib.sha256(os.fsencode(Path(__file__).absolute().parents[1])).hexdigest()
    return f"{source_hash()}-{place[:8]}"


def cache_root() -> Path:
    """Return the folder that holds the compiled code: ``INSGNSS_CACHE``, else the user's cache folder."""
    named = os.environ.get("INSGNSS_CACHE")
    if named:
        return Path(named)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "insgnss"


def trusted_cache(root: Path) -> Path:
    """Return ``root``, made if needed, or a folder of this process alone where ``root`` cannot be used.

    It cannot where it belongs to another user, is a file, or is not writable; a ``CacheWarning`` says so when the first
    kernel is called. Processes that this one starts use the same folder. A folder of this user that others may write
    is closed to them.
    """
    try:
        root.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = root.stat()
    except FileExistsError:
        return _private_cache(root, f"compiled code cannot be kept in {root}: it is a file")
    except OSError as error:
        return _private_cache(root, f"compiled code cannot be kept in {root}: {error.strerror}")
    if not is_trusted(status):
        return _private_cache(
            root,
            f"compiled code in {root} is not used, as the folder belongs to another user, whose code would run",
        )
    if not os.access(root, os.W_OK | os.X_OK):
        return _private_cache(root, f"compiled code cannot be kept in {root}: the folder is not writable")
    with suppress(OSError):
        ours = hasattr(os, "geteuid") and status.st_uid == os.geteuid()
        everybodys = status.st_mode & stat.S_ISVTX  # a folder as /tmp, which has to stay as it is
        if status.st_mode & _OTHERS_MAY_WRITE and ours and not everybodys:
            root.chmod(stat.S_IMODE(status.st_mode) & ~_OTHERS_MAY_WRITE)
    return root


def _private_cache(root: Path, why: str) -> Path:
    """Return a folder that is removed when this process ends, ``root`` where none can be made; a warning says why."""
    warn_at_first_call(f"{why}; each command compiles for a minute. INSGNSS_CACHE names another folder")
    try:
        private = tempfile.mkdtemp(prefix="insgnss-")
    except OSError:  # Numba compiles without a folder, too
        return root
    atexit.register(shutil.rmtree, private, ignore_errors=True)
    os.environ["INSGNSS_CACHE"] = private
    return Path(private)


def tend_caches(folder: Path) -> None:
    """Mark a folder of compiled code as used today; where it is new, remove unused ones of other versions.

    Only folders that carry a hash as their name and hold compiled code are touched, and nothing is said when the disk
    does not let us.
    """
    now = time.time()
    with suppress(OSError):
        if folder.is_dir():
            if now - folder.stat().st_mtime > _DAY_S:
                os.utime(folder)
            return
        for other in folder.parent.iterdir():
            unused_s = now - other.stat().st_mtime
            if unused_s < UNUSED_DAYS * _DAY_S or not re.fullmatch("[0-9a-f]{16}", other.name):
                continue
            if any(other.glob("*/*.nbi")):
                shutil.rmtree(other, ignore_errors=True)


CACHE_DIR: Final = trusted_cache(cache_root()) / cache_name()
tend_caches(CACHE_DIR)


@overload
def kernel(function: _F, /) -> _F: ...


@overload
def kernel(*, inline: bool = False, apart: bool = False) -> Callable[[_F], _F]: ...


def kernel(function: _F | None = None, /, *, inline: bool = False, apart: bool = False) -> Any:
    """Compile a function with Numba on its first call and keep the machine code for the next process.

    No fast mathematics: the same input must give the same bits. ``error_model="numpy"`` lets a division by zero give
    inf, which the gates refuse, instead of a branch at every division. Python's lock is left free meanwhile. A kernel
    that makes no array and returns none borrows those it is handed: no references are counted.

    Parameters
    ----------
    inline : weave it into its callers; for a short kernel of one or two. A kernel of its own costs a fifth of a second
        to compile, because each becomes a module that every caller links and optimises again; woven in, a short one
        costs nothing of that and runs a little faster. To weave and to find the types takes a time that grows with the
        square of the length: the prediction of an epoch's rows took 11 s as one piece, and takes 6 s as two. Called
        from Python it is an ordinary kernel
    apart : let its callers reach it by its address (``numba_parts.Apart``); for a kernel of some length: a call costs
        a few nanoseconds. What it returns must be annotated with numbers or tuples of numbers

    Raises
    ------
    TypeError : a kernel apart is not at the top level of a module
    """
    if function is None:
        return lambda decorated: _compiled(decorated, inline=inline, apart=apart)
    return _compiled(function, inline=inline, apart=apart)


def _compiled(function: _F, *, inline: bool, apart: bool) -> _F:
    if inline:
        return cast(_F, compiled(function, CACHE_DIR, inline="always"))
    if apart and "<locals>" in function.__qualname__:
        raise TypeError(f"{function.__qualname__}: a kernel apart is found by its name in its module")
    # said, as it would be taken over from a caller
    made = compiled(function, CACHE_DIR, _nrt=not _borrows(function))
    return cast(_F, Apart(made) if apart and not numba.config.DISABLE_JIT else made)


def _borrows(function: Callable[..., Any]) -> bool:
    """Return whether a function, and what it calls, hands it no array that it would have to give back.

    The count of references costs the loop over a log a tenth of its time. A kernel that allocates unseen, by the
    arithmetic of whole arrays, is refused: "NRT required". It is written as a loop. An attribute with the name of a
    kernel counts as that kernel: at worst references are counted in vain.
    """
    named = function.__code__.co_names
    if not _ALLOCATES.isdisjoint(named):
        return False
    for called in map(function.__globals__.get, named):
        inner: Any = getattr(called, "py_func", function)
        if inner is not function:
            woven = cast(Any, called).targetoptions.get("inline") == "always"
            if not (_borrows(inner) if woven else _returns_numbers(inner)):
                return False
    return _returns_numbers(function)


def _returns_numbers(function: Callable[..., Any]) -> bool:
    stated = function.__annotations__.get("return", Any)
    try:
        return _is_number(eval(stated, function.__globals__) if isinstance(stated, str) else stated)
    except NameError:
        return False


def _is_number(kind: Any) -> bool:
    """Return whether an annotation says a number, nothing, or a tuple of them."""
    if kind in (bool, float, int, None, type(None)):
        return True
    if hasattr(kind, "_fields"):
        return all(map(_is_number, typing.get_type_hints(kind).values()))
    return typing.get_origin(kind) is tuple and all(map(_is_number, typing.get_args(kind)))
