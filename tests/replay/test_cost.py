"""What a replay costs: memory in proportion to its files, and a loop that is compiled once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numba
import pytest

from insgnss.filter import compile_loop
from insgnss.filter.update.clone import clone_epoch
from insgnss.gnss.least_squares import fit
from insgnss.library import filter_config
from insgnss.log_replay import replay
from tests.benchmarks.bench_replay import SAMPLE, command, process
from tests.benchmarks.long_log import LongLog, write_log
from tests.test_jit import PACKAGE, python

MIB = 2**20
# An array of final size is filled in one place while another is read: what lives at once is about what is on the disk
MOST_PER_BYTE = 1.5
MOST_OF_OURS_MIB = (
    100.0  # modules, machine code, tables in the making; beside what the libraries take by themselves
)
NEEDED = """
import gc, sys
from insgnss.apart import Apart
from insgnss.filter import compile_loop
from insgnss.log_replay import replay
compile_loop.fetch_loop = lambda: None
replay(sys.argv[1])
print(*(k.__qualname__ for k in gc.get_objects() if type(k) is Apart and k.signatures), sep="\\n")
"""
LIBRARIES = """
import numba, numpy, pandas, pyarrow.csv, pyarrow.parquet, pydantic, rich.console, typer
numba.njit(lambda x: x + 1.0)(1.0)
"""


compiled = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="the compiler is switched off")


@compiled
def test_kernels_compiled_ahead_have_the_types_that_a_replay_needs() -> None:
    config = filter_config("tight17")
    suspicious = config.faults.model_copy(
        update={"residual_sigma": 0.01}
    )  # so that it looks for what to leave out
    replay(SAMPLE, config.model_copy(update={"faults": suspicious}))
    kernels: tuple[Any, ...] = compile_loop.kernels()
    known = {kernel: list(kernel.signatures) for kernel in kernels if kernel is not clone_epoch}

    compile_loop.fetch_loop()

    assert {kernel: list(kernel.signatures) for kernel in known} == known


@compiled
def test_rivals_of_a_given_start_are_compiled_ahead_for_the_types_of_a_fix() -> None:
    replay(SAMPLE)
    kernel: Any = fit
    known = list(kernel.signatures)

    compile_loop.compile_rivals()

    assert known and list(kernel.signatures) == known


@compiled
def test_every_kernel_apart_that_a_replay_needs_is_compiled_ahead() -> None:
    seen = python("-c", NEEDED, str(SAMPLE), folder=PACKAGE.parent).splitlines()

    ahead = {kernel.__qualname__ for kernel in compile_loop.kernels()}
    assert len(seen) > 10
    assert set(seen) <= ahead


def peak_and_files_mib(folder: Path, hours: float) -> tuple[float, float]:
    """Return the peak of the command on a log of that length, and the size of what it reads and writes."""
    flight = write_log(LongLog(hours=hours), folder / f"log_{hours}")
    output = folder / f"out_{hours}"
    command(flight, output)
    peak = command(flight, output).peak_mib
    return peak, sum(path.stat().st_size for path in (*flight.parent.iterdir(), *output.iterdir())) / MIB


@pytest.mark.slow
def test_memory_grows_no_faster_than_the_files(tmp_path: Path) -> None:
    short_peak, short_files = peak_and_files_mib(tmp_path, 0.05)
    long_peak, long_files = peak_and_files_mib(tmp_path, 0.25)

    assert long_peak - short_peak < MOST_PER_BYTE * (long_files - short_files)
    libraries = process("-c", LIBRARIES).peak_mib
    assert short_peak < libraries + MOST_OF_OURS_MIB + MOST_PER_BYTE * short_files
