"""Sample calls of the kernels: compiled code and plain Python must give the same numbers (tests/test_jit.py).

One module for each room of the package, holding ``CASES: list[KernelCase]``. Every kernel, private ones too, must run
in at least one case, by itself or because a case's function calls it; the sweep test names those that never ran.
``python -m tests.kernels FILE`` runs all cases and writes a ``Recording``.
"""

from __future__ import annotations

import copy
import importlib
import inspect
import pkgutil
import sys
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from types import CodeType, FrameType
from typing import Any

import numpy as np

import insgnss


@dataclass(frozen=True)
class KernelCase:
    """One call: ``function`` as "module:name", small arguments, and the relative tolerance.

    The function is a kernel, or a plain function that calls kernels and returns numbers. Compiled and interpreted
    code differ in the last digit of sin, cos and the like (another library) and nowhere else, so the tolerance is a
    few units of rounding, relative to the largest element of each array.
    """

    function: str
    args: tuple[Any, ...] = ()
    rtol: float = 1e-13
    label: str = ""

    @property
    def name(self) -> str:
        """Return the function's name and the label, unique among the cases."""
        return f"{self.function}[{self.label}]" if self.label else self.function

    def run(self) -> list[np.ndarray]:
        """Return the numbers of the returned value and of all arguments as the call left them."""
        module, name = self.function.split(":")
        args = copy.deepcopy(self.args)
        returned = getattr(importlib.import_module(module), name)(*args)
        return list(_leaves((returned, *args)))


@dataclass
class Recording:
    """The numbers (or the error) of every case, and "module:name" of each function of the package that was entered."""

    numbers: dict[str, list[np.ndarray]] = field(default_factory=dict)
    errors: dict[str, str] = field(default_factory=dict)
    entered: set[str] = field(default_factory=set)


def _leaves(value: Any) -> Iterator[np.ndarray]:
    if isinstance(value, tuple | list):
        for item in value:
            yield from _leaves(item)
    elif getattr(value, "dtype", None) is not None and value.dtype.names:
        for name in value.dtype.names:
            yield np.asarray(value[name])
    elif value is not None:
        yield np.asarray(value)


def record() -> Recording:
    """Run all cases; functions are noted as entered only where they run as plain Python."""
    recording = Recording()
    met: dict[int, CodeType] = {}  # kept, so that no other code takes the number

    def note(frame: FrameType, event: str, _: Any) -> None:
        if event == "call" and id(frame.f_code) not in met:
            met[id(frame.f_code)] = frame.f_code
            module = frame.f_globals.get("__name__", "")
            if module.startswith("insgnss"):
                recording.entered.add(f"{module}:{frame.f_code.co_name}")

    for case in all_cases():
        sys.setprofile(note)
        try:
            recording.numbers[case.name] = case.run()
        except Exception:  # the other cases still count
            recording.errors[case.name] = traceback.format_exc()
        finally:
            sys.setprofile(None)
    return recording


def all_cases() -> list[KernelCase]:
    """Return the cases of all rooms, in the order of their files."""
    cases: list[KernelCase] = []
    for info in pkgutil.iter_modules(__path__):
        if info.name != "__main__":
            cases += importlib.import_module(f"{__name__}.{info.name}").CASES
    return cases


def all_kernels() -> set[str]:
    """Return "module:name" of every function of the package that Numba compiles."""
    modules = [importlib.import_module(i.name) for i in pkgutil.walk_packages(insgnss.__path__, "insgnss.")]
    functions: list[tuple[str, Callable[..., Any]]] = [
        (module.__name__, function)
        for module in modules
        for function in (getattr(thing, "py_func", None) for thing in vars(module).values())
        if inspect.isfunction(function)
    ]
    return {f"{module}:{f.__name__}" for module, f in functions if f.__module__ == module}
