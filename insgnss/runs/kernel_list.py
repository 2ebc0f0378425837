"""The kernels that the main commands need, and the process that compiles those that no other has taken."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from insgnss.filter import loop_calls
from insgnss.gnss.point import calls as point_calls
from insgnss.kernels.compiled_ahead import compile_list
from insgnss.simulation import truth_calls


def calls() -> dict[Callable[..., Any], tuple[Any, ...]]:
    """Return the kernels, each with arguments of the types it is called with, the longest to compile about first."""
    return {**loop_calls.calls(), **point_calls.calls(), **truth_calls.calls()}


if __name__ == "__main__":
    compile_list(calls())
