"""How long RINEX observations take to tables: ``python -m tests.benchmarks.bench_rinex``.

One hour at 1 Hz, 30 satellites, 3 signals each, all four kinds of value: 1.3 million values.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from insgnss.log.rinex.observations import read_rinex_obs

LIMIT_S = 1.5
REPETITIONS = 5
HEADER = """\
     3.04           OBSERVATION DATA    M: MIXED            RINEX VERSION / TYPE
G   12 C1C L1C D1C S1C C2L L2L D2L S2L C5Q L5Q D5Q S5Q      SYS / # / OBS TYPES
E   12 C1C L1C D1C S1C C5Q L5Q D5Q S5Q C7Q L7Q D7Q S7Q      SYS / # / OBS TYPES
  2023     6    29    11     0    0.0000000     GPS         TIME OF FIRST OBS
                                                            END OF HEADER
"""


def write_hour(path: Path, epochs: int = 3600) -> None:
    """Write the file, random values."""
    rng = np.random.default_rng(1)
    satellites = [f"{system}{number:02d}" for system in "GE" for number in range(1, 16)]
    parts = [HEADER]
    for k in range(epochs):
        parts.append(f"> 2023 06 29 {11 + k // 3600:02d} {k // 60 % 60:02d} {k % 60:2d}.0000000  0 30\n")
        for sv, values in zip(satellites, rng.random((30, 3)).tolist(), strict=True):
            cells = (
                f"{2.2e7 + 1e5 * v:14.3f}  {1.1e8 + 1e6 * v:14.3f} 7{1e3 * v:14.3f}  {40 + v:14.3f}  "
                for v in values
            )
            parts.append(sv + "".join(cells) + "\n")
    path.write_text("".join(parts))


def main() -> int:
    """Return 0 when the median time is within the limit."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "hour.rnx"
        write_hour(path)
        taken = []
        for _ in range(REPETITIONS):
            began = time.perf_counter()
            table, _ = read_rinex_obs([path])
            taken.append(time.perf_counter() - began)
        size = path.stat().st_size / 2**20
    print(
        f"RINEX observations, {size:.0f} MiB, {len(table.t_ns)} rows: {np.median(taken):.2f} s"
        f" (first {taken[0]:.2f} s, limit {LIMIT_S} s)"
    )
    return 0 if np.median(taken) <= LIMIT_S else 1


if __name__ == "__main__":
    sys.exit(main())
