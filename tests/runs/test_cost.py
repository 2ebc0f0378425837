"""What a replay costs: memory in proportion to its files."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.benchmarks.bench_replay import process
from tests.benchmarks.long_log import LongLog, write_log

MIB = 2**20
# An array of final size is filled in one place while another is read: what lives at once is about what is on the disk
MOST_PER_BYTE = 1.5
# modules, machine code, tables in the making; beside what the libraries take by themselves
MOST_OF_OURS_MIB = 100.0
# chance calls for a look back now and then, which runs the last minute again: 110 MiB, however long the log
NO_LOOKS = "health.suspicion_sigma=0"
# the rates of these logs are noisier than the filter's default: a start that is tried beside the given one would wait
AS_NOISY = "range_rate_noise_mps.floor=0.1"
LIBRARIES = """
import numba, numpy, pandas, pyarrow.csv, pyarrow.parquet, pydantic, rich.console, typer
numba.njit(lambda x: x + 1.0)(1.0)
"""


def peak_and_files_mib(flight: Path) -> tuple[float, float]:
    """Return the peak of the command on a log, and the size of what it reads and writes."""
    output = flight.parent.with_name(f"{flight.parent.name}_out")
    settings = ("--set", NO_LOOKS, "--set", AS_NOISY)
    peak = process("-m", "insgnss.cli", "replay", str(flight), "-o", str(output), *settings).peak_mib
    return peak, sum(path.stat().st_size for path in (*flight.parent.iterdir(), *output.iterdir())) / MIB


@pytest.mark.slow
def test_memory_grows_no_faster_than_the_files(tmp_path: Path) -> None:
    short, long = (write_log(LongLog(hours=hours), tmp_path / str(hours)) for hours in (0.05, 0.25))
    peak_and_files_mib(short)  # what is not compiled yet is compiled here
    short_peak, short_files = peak_and_files_mib(short)
    long_peak, long_files = peak_and_files_mib(long)

    assert long_peak - short_peak < MOST_PER_BYTE * (long_files - short_files)
    libraries = process("-c", LIBRARIES).peak_mib
    assert short_peak < libraries + MOST_OF_OURS_MIB + MOST_PER_BYTE * short_files
