"""Everything that the package uses of Numba's internals; everything else goes through ``insgnss.kernels.jit``.

``compiled`` seals the files of machine code. ``Apart`` is a kernel that is called by its address: compiled once, apart
from its callers, and only when it is needed. Numba links every kernel that another one calls into it, then optimises
and translates all of it again: down the calls of the filter's loop most code would be translated four times. A kernel
apart is reached through a pointer instead. Its callers need only the types it takes and returns, so they
can be compiled before it, in parallel in another process, or without it if it is never called.

A call holds a cell in the caller's machine code, zero at first. Where it finds a zero it asks ``_find``, back in
Python, which compiles the kernel for the types of the call or fetches it from the cache; the cell keeps the answer. The
types travel inside the machine code, so that a caller from the cache asks for the same.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import importlib
import os
import pickle
import sys
import typing
import uuid
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, cast

import numba
from llvmlite import binding, ir
from numba.core import cgutils, errors, types
from numba.core.caching import IndexDataCacheFile
from numba.core.typing import signature
from numba.extending import lower_builtin, models, register_model, typeof_impl

_SEAL_BYTES: Final = hashlib.sha256().digest_size
_PROCESS: Final = uuid.uuid4().hex[:12]
_kinds: Any = types  # whose members have no annotations


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


def compiled(function: Callable[..., Any], folder: Path, **options: Any) -> Any:
    """Return a function's kernel, its machine code kept in a folder."""
    previous = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(folder)
    try:
        kernel = numba.njit(cache=True, nogil=True, error_model="numpy", no_cfunc_wrapper=True, **options)(
            function
        )
    finally:
        numba.config.CACHE_DIR = previous
    _seal_files(kernel)
    return kernel


def is_trusted(status: os.stat_result) -> bool:
    """Return whether a file belongs to this user or to the administrator; unknown on Windows."""
    return not hasattr(os, "geteuid") or status.st_uid in (0, os.geteuid())


class CacheWarning(UserWarning):
    """Compiled code is not kept: each session compiles again."""


_warnings_to_give: Final[list[str]] = []


def warn_at_first_call(text: str) -> None:
    """Give a ``CacheWarning`` when a kernel is called first.

    The package is imported before a command can say how it shows warnings, and many commands call no kernel.
    """
    _warnings_to_give.append(text)


class _SealedFile(IndexDataCacheFile):  # type: ignore[misc]
    """A kernel's files in the cache, each with its hash at the end; damaged or foreign ones count as absent."""

    def save(self, key: Any, data: Any) -> None:
        with suppress(OSError):  # a full disk: the code is compiled again next time
            super().save(key, data)

    def _save_index(self, overloads: dict[Any, str]) -> None:
        self._write(self._index_path, (self._version, self._source_stamp, overloads))

    def _load_index(self) -> dict[Any, str]:
        while _warnings_to_give:
            warnings.warn(_warnings_to_give.pop(), CacheWarning, stacklevel=2)
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


def _unsealed(path: str) -> memoryview | None:
    """Return the content of a cache file before its hash; None where it is absent, damaged or another user's."""
    try:
        with open(path, "rb") as file:
            sealed = memoryview(file.read() if is_trusted(os.fstat(file.fileno())) else b"")
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


_SYMBOL: Final = "insgnss_find_kernel"
_NOT_COMPILED: Final = 0  # return values that are not addresses
_INTERRUPTED: Final = -1
_NUMBERS: Final[dict[Any, Any]] = {
    bool: types.boolean,
    float: types.float64,
    int: types.int64,
    type(None): types.none,
}


class Apart:
    """A kernel whose callers do not link it.

    ``kernel`` is the same as its callers would link it; Python calls that.
    """

    def __init__(self, kernel: Any) -> None:
        self.kernel = kernel
        functools.update_wrapper(self, kernel.py_func)
        lower_builtin(self, _kinds.VarArg(types.Any))(self._lower)

    def __call__(self, *arguments: Any) -> Any:  # noqa: D102
        return self.kernel(*arguments)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.kernel, name)

    def __reduce__(self) -> str:
        return str(self.__qualname__)  # pickled by name, as functions are

    @property
    def return_type(self) -> Any:
        """The compiler's type of the kernel's declared return value."""
        return _type_of(typing.get_type_hints(self.kernel.py_func)["return"])

    def address(self, argument_types: tuple[Any, ...]) -> int:
        """Return where the machine code for some types begins, compiled or from the cache.

        Raises
        ------
        TypeError : the kernel returns something else than its annotation says, on which its callers rely
        """
        self.kernel.compile(argument_types)
        compiled = self.kernel.overloads[argument_types]
        if compiled.signature.return_type != self.return_type:
            raise TypeError(
                f"{self.__qualname__} returns {compiled.signature.return_type}, not {self.return_type}"
            )
        return int(compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name))

    def _lower(self, context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        """Write the call of a kernel into the caller's code."""
        convention = context.call_conv
        asked = pickle.dumps((self.__module__, self.__qualname__, sig.args))
        word, text = ir.IntType(64), ir.IntType(8).as_pointer()
        cell = cgutils.add_global_variable(builder.module, word, f"{self.__name__}.address")
        cell.linkage, cell.initializer = "internal", word(0)
        with cgutils.if_unlikely(builder, cgutils.is_null(builder, builder.load(cell))):
            data = cgutils.global_constant(builder, f"{self.__name__}.types", cgutils.make_bytearray(asked))
            kind = ir.FunctionType(ir.VoidType(), [text, word, word.as_pointer()])
            ask = cgutils.get_or_insert_function(builder.module, kind, _SYMBOL)
            answer = cgutils.alloca_once_value(builder, word(_INTERRUPTED))
            builder.call(ask, [builder.bitcast(data, text), word(len(asked)), answer])
            found = builder.load(answer)
            with cgutils.if_unlikely(builder, builder.icmp_signed("==", found, word(_INTERRUPTED))):
                convention.return_user_exc(builder, KeyboardInterrupt, ())
            with cgutils.if_unlikely(builder, builder.icmp_signed("==", found, word(_NOT_COMPILED))):
                why = f"{self.__qualname__} cannot be compiled"
                convention.return_user_exc(builder, RuntimeError, (why,))
            builder.store(found, cell)
        kind = convention.get_function_type(sig.return_type, sig.args).as_pointer()
        code = builder.inttoptr(builder.load(cell), kind)
        status, returned = convention.call_function(builder, code, sig.return_type, sig.args, arguments)
        with cgutils.if_unlikely(builder, status.is_error):
            convention.return_status_propagate(builder, status)
        return returned


class _ApartType(types.Callable, types.Opaque):
    """The compiler's type of one such kernel."""

    def __init__(self, apart: Apart) -> None:
        self.apart = apart
        super().__init__(f"Apart({apart.__module__}.{apart.__qualname__})")

    def get_call_type(self, context: Any, arguments: Any, named: Any) -> Any:
        if named:
            raise errors.TypingError(f"{self.name} takes its arguments by place only")
        return signature(self.apart.return_type, *(_kinds.unliteral(one) for one in arguments))

    def get_call_signatures(self) -> tuple[list[Any], bool]:
        return [], True

    def get_impl_key(self, sig: Any) -> Apart:
        return self.apart


register_model(_ApartType)(models.OpaqueModel)
typeof_impl.register(Apart)(lambda apart, context: _ApartType(apart))


def _type_of(annotation: Any) -> Any:
    """Return the compiler's type of numbers, a tuple of them, or a named tuple of them."""
    if annotation in _NUMBERS:
        return _NUMBERS[annotation]
    fields = getattr(annotation, "_fields", None)
    if fields is None:
        return _kinds.Tuple([_type_of(part) for part in typing.get_args(annotation)])
    hints = typing.get_type_hints(annotation)
    parts = [_type_of(hints[field]) for field in fields]
    if len(set(parts)) == 1:
        return _kinds.NamedUniTuple(parts[0], len(parts), annotation)
    return _kinds.NamedTuple(parts, annotation)


def _find(data: int, length: int, answer: int) -> None:
    """Write the address of the kernel that the bytes at ``data`` name, with its argument types, to ``answer``.

    No exception finds its way up through machine code: one that is not caught here, which only an interrupt can be,
    leaves the answer as it is.
    """
    found = ctypes.c_int64.from_address(answer)
    try:
        module, name, argument_types = pickle.loads(ctypes.string_at(data, length))
        found.value = cast(Apart, getattr(importlib.import_module(module), name)).address(argument_types)
    except Exception:
        sys.excepthook(*sys.exc_info())
        found.value = _NOT_COMPILED
    except KeyboardInterrupt:
        found.value = _INTERRUPTED  # as it was: said for the reader, and so that ctypes prints nothing


_find_for_machine_code: Final = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64, ctypes.c_void_p)(
    _find
)
binding.add_symbol(_SYMBOL, cast(int, ctypes.cast(_find_for_machine_code, ctypes.c_void_p).value))
