"""The Numba decorators and the cache policy.

Compiled code is cached in a folder whose name holds a hash of all of the package's own sources and of the versions of
Python, NumPy and Numba: Numba itself only notices an edit of the file a function stands in, not of the functions it
calls. A new folder is the moment at which those of earlier versions that nobody has used for 30 days are removed.
Each file ends in its SHA-256: a damaged one is compiled again. The files are pickles and machine code, so files of
another user are never loaded, nor is a folder of another user used.
``NUMBA_DISABLE_JIT=1`` runs every kernel as plain Python (slow, for tests and debuggers).

With an empty cache the compiler takes most of the time of a first run: ``insgnss.compiled_ahead`` shares it.
"""

from __future__ import annotations

import atexit
import hashlib
import importlib
import os
import pickle
import re
import shutil
import stat
import sys
import tempfile
import time
import uuid
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, TypeVar, cast

import numba
import numpy as np
from numba.core.caching import IndexDataCacheFile

UNUSED_DAYS: Final = 30  # compiled code of other versions goes when nobody has loaded it for so long
_S_PER_DAY: Final = 86_400.0
_WITH_BOUNDS: Final = ("checks bounds",) if numba.config.BOUNDSCHECK else ()
_SEAL_BYTES: Final = hashlib.sha256().digest_size
_OTHERS_MAY_WRITE: Final = stat.S_IWGRP | stat.S_IWOTH
_F = TypeVar("_F", bound=Callable[..., Any])


def source_hash() -> str:
    """Return 16 hexadecimal digits that change when any source file of the package or a compiler version does.

    So they do with ``NUMBA_BOUNDSCHECK``: code that checks every index is other code, which Numba's own cache does not
    tell apart.
    """
    digest = hashlib.sha256()
    for text in (sys.version, np.__version__, numba.__version__, *_WITH_BOUNDS):
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
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "insgnss"


def trusted_cache(root: Path) -> Path:
    """Return ``root``, made if needed, or a folder of this process alone where ``root`` belongs to another user.

    Processes that this one starts use the same folder. A folder of this user that others may write is closed to them.
    """
    with suppress(OSError):  # Numba compiles without a folder that cannot be made
        root.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = root.stat()
        if not _is_trusted(status):
            warnings.warn(
                f"compiled code in {root} is not used: the folder belongs to another user, and loading it would run"
                " that user's code. Kernels are compiled again in each session; INSGNSS_CACHE names another folder",
                stacklevel=2,
            )
            private = tempfile.mkdtemp(prefix="insgnss-")
            atexit.register(shutil.rmtree, private, ignore_errors=True)
            os.environ["INSGNSS_CACHE"] = private
            return Path(private)
        ours = hasattr(os, "geteuid") and status.st_uid == os.geteuid()
        everybodys = status.st_mode & stat.S_ISVTX  # a folder as /tmp, which has to stay as it is
        if status.st_mode & _OTHERS_MAY_WRITE and ours and not everybodys:
            root.chmod(stat.S_IMODE(status.st_mode) & ~_OTHERS_MAY_WRITE)
    return root


def _is_trusted(status: os.stat_result) -> bool:
    """Return whether a file belongs to this user or to the administrator; Windows does not tell."""
    return not hasattr(os, "geteuid") or status.st_uid in (0, os.geteuid())


def tend_caches(folder: Path) -> None:
    """Mark a folder of compiled code as used today; where it is new, remove those beside it that nobody uses.

    Only folders that carry a hash as their name and hold compiled code are touched, and nothing is said when the disk
    does not let us.
    """
    now = time.time()
    with suppress(OSError):
        if folder.is_dir():
            if now - folder.stat().st_mtime > _S_PER_DAY:
                os.utime(folder)
            return
        for other in folder.parent.iterdir():
            unused_s = now - other.stat().st_mtime
            if unused_s < UNUSED_DAYS * _S_PER_DAY or not re.fullmatch("[0-9a-f]{16}", other.name):
                continue
            if any(other.glob("*/*.nbi")):
                shutil.rmtree(other, ignore_errors=True)


CACHE_DIR: Final = trusted_cache(cache_root()) / source_hash()
tend_caches(CACHE_DIR)


def _import_without_blas() -> None:
    """Import the part of Numba that looks for SciPy's linear algebra while that cannot be found.

    Numba would use it for products of matrices, of which the kernels have none; importing it costs every process that
    calls a kernel 0.15 s and 35 MB.
    """
    blas = "scipy.linalg.cython_blas"
    if blas in sys.modules:
        return
    sys.modules[blas] = cast(Any, None)
    try:
        importlib.import_module("numba.np.arraymath")
    finally:
        del sys.modules[blas]


_import_without_blas()
_PROCESS = uuid.uuid4().hex[:12]


def _compiled(function: _F, folder: str = "", **options: Any) -> _F:
    previous = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(CACHE_DIR / folder)
    try:
        dispatcher = numba.njit(
            cache=True, nogil=True, error_model="numpy", no_cfunc_wrapper=True, **options
        )(function)
    finally:
        numba.config.CACHE_DIR = previous
    _seal_files(dispatcher)
    return cast(_F, dispatcher)


class _SealedFile(IndexDataCacheFile):  # type: ignore[misc]
    """A kernel's files in the cache, each with its hash at the end; what is damaged or not ours counts as not there."""

    def save(self, key: Any, data: Any) -> None:
        with suppress(OSError):  # a full disk: the code is compiled again next time
            super().save(key, data)

    def _save_index(self, overloads: dict[Any, str]) -> None:
        self._write(self._index_path, (self._version, self._source_stamp, overloads))

    def _load_index(self) -> dict[Any, str]:
        found = _unsealed(self._index_path)
        version, stamp, overloads = (None, None, {}) if found is None else pickle.loads(found)
        fresh = (version, stamp) == (self._version, self._source_stamp)
        return cast(dict[Any, str], overloads) if fresh else {}

    def _save_data(self, name: str, data: Any) -> None:
        self._write(self._data_path(name), data)

    def _load_data(self, name: str) -> Any:
        found = _unsealed(self._data_path(name))
        if found is None:
            raise FileNotFoundError(name)  # upon which Numba compiles
        return pickle.loads(found)

    def _write(self, path: str, data: Any) -> None:
        content = self._dump(data)
        with self._open_for_write(path) as file:
            file.write(content + hashlib.sha256(content).digest())


def _unsealed(path: str) -> bytes | None:
    """Return what a file of the cache holds before its hash; None where it is absent, damaged or another user's."""
    try:
        with open(path, "rb") as file:
            sealed = file.read() if _is_trusted(os.fstat(file.fileno())) else b""
    except OSError:
        return None
    content = sealed[:-_SEAL_BYTES]
    return content if content and hashlib.sha256(content).digest() == sealed[-_SEAL_BYTES:] else None


def _seal_files(dispatcher: Any) -> None:
    """Seal the files of machine code that this process writes, and give them names of their own.

    Numba numbers the files of a kernel's signatures. Two processes that compile two signatures of one kernel at the
    same moment would take the same number, and one would later load the other's code. With names of their own the
    worst is that one of the two is compiled again.
    """
    file: Any = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
    pattern = getattr(file, "_data_name_pattern", None)
    if isinstance(file, IndexDataCacheFile):
        file.__class__ = _SealedFile
    if isinstance(pattern, str):
        file._data_name_pattern = pattern.replace("{number:d}", _PROCESS + "-{number:d}")


def kernel(function: _F) -> _F:
    """Compile ``function`` with Numba on its first call and keep the machine code for the next process.

    No fast mathematics: the same input must give the same bits. ``error_model="numpy"`` lets a division by zero give
    inf, which the gates refuse, instead of a branch at every division. Python's lock is left free meanwhile.
    """
    return _compiled(function, _nrt=True)  # said, as it would be taken over from a borrowing caller


def borrowing(function: _F) -> _F:
    """Compile a kernel that only borrows its arrays: it allocates none and returns none, so no references are counted.

    The count costs the loop over a log a sixth of its time and of its compilation: a work space handed over is dozens
    of arrays. Numba refuses to compile a kernel that allocates all the same; one that returns an array is refused here.

    Raises
    ------
    TypeError : the function's return annotation is not made of numbers
    """
    _check_returned(function)
    return _compiled(function, _nrt=False)


def without_door(function: _F) -> _F:
    """Compile a borrowing kernel that only kernels call.

    What takes a call of Python's apart is up to a third of the machine code of a kernel that is handed a work space.
    It has a folder of its own in the cache, as the same function may have been compiled with it.
    """
    _check_returned(function)
    return _compiled(function, folder="inner", _nrt=False, no_cpython_wrapper=True)


def _check_returned(function: Callable[..., Any]) -> None:
    returned = str(function.__annotations__.get("return"))
    if re.search(r"Float|Int\d|NDArray|Array|Table|Record|Bank", returned):
        raise TypeError(f"{function.__qualname__} returns {returned}: a kernel that borrows returns numbers")


def inlined(function: _F) -> _F:
    """Compile a kernel that has one or two callers, woven into them.

    A kernel of its own costs a fifth of a second to compile, because each becomes a module that every caller links and
    optimises again; woven in, a short one costs nothing of that and runs a little faster. A long one belongs in a
    kernel of its own: the time to find the types grows with the square of what is woven together. Called from Python it
    is an ordinary kernel.
    """
    return _compiled(function, inline="always")
