"""The list of what a first command compiles: nothing is left for the next one, and every entry has the right types."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import numba
import pytest

from insgnss.cli.progress import compiling
from insgnss.config.library import filter_config
from insgnss.filter.update.clone import clone_epoch
from insgnss.kernels.compiled_ahead import compile_for
from insgnss.log.flight import Flight
from insgnss.runs import first_run, kernel_list
from insgnss.runs.check import examine
from insgnss.runs.point import point
from insgnss.runs.replay import replay
from insgnss.runs.simulate import simulate
from tests.benchmarks.bench_replay import SAMPLE
from tests.test_jit import PACKAGE, python

pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="the compiler is switched off")
# what a process of its own loads from a full cache: those that Python calls, and those apart that they reach
LOADED = """
import gc, sys
from numba.core.registry import CPUDispatcher
from insgnss.kernels.numba_parts import Apart
from insgnss.runs.check import examine
from insgnss.log.flight import Flight
from insgnss.runs.replay import replay
from insgnss.runs.point import point
from insgnss.runs.simulate import simulate
examine(Flight.load(sys.argv[1]))
point(sys.argv[1])
replay(sys.argv[1])
simulate("turning_flight", duration_s=20.0)
found = [k for k in gc.get_objects() if isinstance(k, (Apart, CPUDispatcher)) and k.signatures]
print(*{f"{k.__module__}.{k.__name__}" for k in found if k.__module__.startswith("insgnss")}, sep="\\n")
"""


def name_of(kernel: Any) -> str:
    return f"{kernel.__module__}.{kernel.__name__}"


def compiled_with(kernels: Iterable[Any]) -> set[str]:
    """Return the names of kernels and of all that they call and do not weave into themselves."""
    names, seen, waiting = set(), set(), list(kernels)
    while waiting:
        kernel = waiting.pop()
        if name_of(kernel) in seen:
            continue
        seen.add(name_of(kernel))
        if kernel.targetoptions.get("inline") != "always" or kernel in kernels:
            names.add(name_of(kernel))
        called = (kernel.py_func.__globals__.get(name) for name in kernel.py_func.__code__.co_names)
        waiting += [one for one in called if hasattr(one, "py_func")]
    return names


def test_commands_load_what_the_list_has_compiled_and_nothing_else() -> None:
    known = compiled_with(kernel_list.calls())
    for _ in range(2):  # the first one fills the cache where it is empty, and knows more than what it loads
        loaded = set(python("-c", LOADED, str(SAMPLE), folder=PACKAGE.parent).splitlines())
        if loaded <= known:
            break

    assert len(loaded) > 20
    assert sorted(loaded - known) == []


def test_listed_kernels_have_the_types_that_the_commands_need() -> None:
    config = filter_config("tight17")
    suspicious = config.faults.model_copy(update={"residual_sigma": 0.01})  # it looks for what to leave out
    examine(Flight.load(SAMPLE))
    replay(SAMPLE, config.model_copy(update={"faults": suspicious}))
    point(SAMPLE, false_alarm=0.4)
    simulate("turning_flight", duration_s=20.0)
    kernels: list[Any] = [kernel for kernel in kernel_list.calls() if kernel is not clone_epoch]
    known = {kernel: list(kernel.signatures) for kernel in kernels if kernel.signatures}

    for kernel, arguments in kernel_list.calls().items():
        compile_for(kernel, arguments)

    assert len(known) > 20
    assert {kernel: list(kernel.signatures) for kernel in known} == known


@pytest.mark.parametrize("complete", [False, True])
def test_wait_for_the_compiler_is_a_time_of_its_own(monkeypatch: pytest.MonkeyPatch, complete: bool) -> None:
    class Beside:
        def wait(self) -> None:
            time.sleep(0.05)

    @contextmanager
    def ahead(module: str) -> Iterator[Beside]:
        yield Beside()

    monkeypatch.setattr(first_run, "compiled_ahead", ahead)
    monkeypatch.setattr(first_run, "is_complete", lambda: complete)
    told: list[str] = []
    with first_run.compiled(told.append) as compilation:
        pass
    assert bool(told) != complete and (compilation.waited_s >= 0.05) != complete
    assert compiling({**compilation.took, "read_s": 0.5}).startswith("compiling 0.0") != complete
