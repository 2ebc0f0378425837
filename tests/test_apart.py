"""Kernels that are called by their address: what their callers see of them, and what the cache keeps."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numba
import numpy as np
import pytest

from insgnss.kernels.jit import kernel
from insgnss.kernels.numba_parts import Apart
from insgnss.tables import Float64
from tests.test_jit import package_with_jit_alone, python

compiled = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="the compiler is switched off")


class Summary(NamedTuple):
    """What ``summary`` returns."""

    n: int
    total: float


class Ends(NamedTuple):
    """What ``ends`` returns."""

    first: float
    last: float


@kernel(apart=True)
def summary(x: Float64, scale: float) -> Summary:
    """Return how many numbers there are and their scaled sum."""
    total = 0.0
    for i in range(x.shape[0]):
        total += scale * x[i]
    if total < 0.0:
        raise ValueError("a negative sum")
    return Summary(x.shape[0], total)


@kernel(apart=True)
def ends(x: Float64) -> Ends:
    """Return the first number and the last."""
    return Ends(x[0], x[x.shape[0] - 1])


@kernel(apart=True)
def limits(x: Float64, strict: bool) -> tuple[float, bool]:
    """Return the first number, and what was asked."""
    return x[0], strict


@kernel(apart=True)
def clear(x: Float64) -> None:
    """Set the first number to zero."""
    x[0] = 0.0


@kernel(apart=True)
def doubled(x: float) -> float:
    """Return twice the number."""
    return 2.0 * x


@kernel(apart=True)
def wrongly_annotated(x: float) -> int:
    """Return something else than it says."""
    return x  # type: ignore[return-value]


@kernel
def of_all(x: Float64, clears: bool) -> float:
    """Call all of them."""
    found = summary(x, 2)
    of_ends = ends(x[1:])
    first, strict = limits(x, True)
    if clears:
        clear(x)
    return found.n + found.total + of_ends.first - of_ends.last + first + strict + doubled(x[1])


@kernel
def of_wrong(x: float) -> float:
    """Call the one that returns what it does not say."""
    return float(wrongly_annotated(x))


@kernel(apart=True)
def seldom(x: float) -> float:
    """Return twice the number."""
    return 2.0 * x


@kernel(apart=True)
def never(x: float) -> float:
    """Return twice the number."""
    return 2.0 * x


@kernel(apart=True)
def late(x: float) -> float:
    """Return twice the number."""
    return 2.0 * x


@kernel
def of_interrupted(x: float) -> float:
    """Call one whose compilation is interrupted at first."""
    return late(x)


@kernel
def of_halted(x: float) -> float:
    """Call one whose compilation is halted at first."""
    return late(x)


@kernel
def of_large(x: float) -> float:
    """Call one for large numbers."""
    return seldom(x) if x > 10.0 else x


@kernel
def of_never(x: float) -> float:
    """Call one, if it is called."""
    return never(x)


def by_hand(x: Float64) -> float:
    return float(len(x) + 2.0 * x.sum() + x[1] - x[-1] + x[0] + 1.0 + 2.0 * x[1])


def test_kernels_give_their_callers_what_they_return() -> None:
    x = np.array([1.0, 2.0, 4.0])

    assert of_all(x, False) == by_hand(x)
    assert of_all(x, True) == by_hand(np.array([1.0, 2.0, 4.0]))
    assert x[0] == 0.0


def test_exception_reaches_the_caller_s_caller() -> None:
    with pytest.raises(ValueError, match="a negative sum"):
        of_all(np.array([-1.0, -2.0]), False)


def test_python_calls_them_as_well() -> None:
    assert summary(np.ones(3), 2.0) == Summary(3, 6.0)
    assert doubled(1.5) == 3.0


@compiled
def test_kernel_that_is_never_called_is_never_compiled() -> None:
    assert of_large(1.0) == 1.0
    assert isinstance(seldom, Apart)
    assert not seldom.signatures

    assert of_large(20.0) == 40.0
    assert len(seldom.signatures) == 1


@compiled
def test_caller_needs_no_machine_code_of_the_kernel_to_be_compiled() -> None:
    of_never.compile((numba.float64,))  # type: ignore[attr-defined]

    assert isinstance(never, Apart)
    assert not never.signatures


def test_kernel_inside_a_function_is_refused() -> None:
    def local(x: float) -> float:
        return x

    with pytest.raises(TypeError, match="found by its name"):
        kernel(apart=True)(local)


@compiled
def test_kernel_that_returns_something_else_than_it_says_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(RuntimeError, match="wrongly_annotated cannot be compiled"):
        of_wrong(1.0)

    assert "wrongly_annotated returns float64, not int64" in capsys.readouterr().err


@compiled
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize(
    ("halt", "caller"),
    [(KeyboardInterrupt, of_interrupted), (SystemExit, of_halted)],
    ids=["where_it_is_caught", "where_it_is_not_as_at_the_first_line_of_the_search"],
)
def test_interrupted_compilation_is_an_interrupt_and_can_be_done_later(
    monkeypatch: pytest.MonkeyPatch, halt: type[BaseException], caller: Callable[[float], float]
) -> None:
    def interrupted(one: Apart, argument_types: object) -> int:
        raise halt

    with monkeypatch.context() as patched:
        patched.setattr(Apart, "address", interrupted)
        with pytest.raises(KeyboardInterrupt):
            caller(1.0)

    assert caller(1.0) == 2.0


@compiled
def test_arguments_by_name_are_refused() -> None:
    @kernel
    def caller(x: float) -> float:
        return doubled(x=x)

    with pytest.raises(numba.core.errors.TypingError, match="by place only"):
        caller(1.0)


def test_kernel_is_pickled_by_its_name() -> None:
    assert pickle.loads(pickle.dumps(summary)) is summary


CALLEE = """
from insgnss.kernels.jit import kernel
@kernel(apart=True)
def term(x: float) -> float:
    return 2.0 * x
"""
CALLER = """
from insgnss.callee import term
from insgnss.kernels.jit import kernel
@kernel
def sum_of_terms(x: float) -> float:
    return term(x) + term(x + 1.0)
"""
SHOW = """
from insgnss.callee import term
from insgnss.caller import sum_of_terms
print(sum_of_terms(1.0), sum(sum_of_terms.stats.cache_hits.values()), sum(term.stats.cache_hits.values()))
"""


@compiled
def test_caller_from_the_cache_finds_the_kernel_there(tmp_path: Path) -> None:
    package = package_with_jit_alone(tmp_path)
    for name, text in {"callee": CALLEE, "caller": CALLER}.items():
        (package / f"{name}.py").write_text(text, encoding="utf-8")

    cache = {"INSGNSS_CACHE": str(tmp_path / "cache")}

    assert python("-c", SHOW, folder=tmp_path, **cache) == "6.0 0 0"
    assert python("-c", SHOW, folder=tmp_path, **cache) == "6.0 1 1"
