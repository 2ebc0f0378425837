"""What the visibility stage adds to a replay: ``python -m tests.benchmarks.bench_masking``.

12 satellites at 10 Hz, an IMU of 200 Hz, a patch antenna: at most 10 % of the time of the replay without it.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from tests.benchmarks.bench_aiding import Spent, replayed
from tests.benchmarks.bench_replay import filter_seconds
from tests.benchmarks.long_log import LongLog, write_log

LIMIT = 0.10
ANTENNA = '\n[[gnss.antenna]]\npattern = "patch_l1"\n'


def with_antenna(flight: Path) -> Path:
    """Write the flight file once more, with an antenna, in a folder of its own that shares the logs."""
    folder = flight.parent / "antenna"
    folder.mkdir()
    for path in flight.parent.glob("*.csv"):
        (folder / path.name).symlink_to(path)
    changed = folder / flight.name
    changed.write_text(flight.read_text(encoding="utf-8") + ANTENNA, encoding="utf-8")
    return changed


def main() -> int:
    """Return 0 when the ratio is within the limit."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--repetitions", type=int, default=3)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        plain = write_log(LongLog(options.hours, satellites=12), Path(folder))
        flights = (plain, with_antenna(plain))
        loops = [filter_seconds(flight.parent, options.repetitions)[0] for flight in flights]
        spent: list[list[Spent]] = [[], []]
        for _ in range(options.repetitions):  # in turns: both see the same load of the machine
            for flight, costs in zip(flights, spent, strict=True):
                costs.append(replayed(flight, None)[1])
    without, with_it = (min(costs, key=lambda cost: cost.both).both for cost in spent)
    added = with_it / without - 1.0
    print(
        f"replay: CPU {without:.2f} s without the stage, {with_it:.2f} s with it: {100.0 * added:+.0f} %"
        f" (limit {100.0 * LIMIT:.0f} %); the loop alone {loops[0]:.3f} s and {loops[1]:.3f} s"
    )
    return 0 if added <= LIMIT else 1


if __name__ == "__main__":
    sys.exit(main())
