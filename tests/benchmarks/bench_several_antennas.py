"""What several antennas cost the replay: ``python -m tests.benchmarks.bench_several_antennas``.

Three antennas and some eleven satellites at 10 Hz for two minutes, with the [attitude] block and without it.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import insgnss
from tests.attitude.several_flights import AT_REST, scenario_text, write_flight


def main() -> None:
    """Print the filter's time per epoch with and without the differences between antennas."""
    with tempfile.TemporaryDirectory() as folder:
        text = scenario_text(rate_hz=10.0, manoeuvres=AT_REST.format(duration=120.0))
        path = write_flight(Path(folder), text)
        whole = path.read_text(encoding="utf-8")
        bare = path.with_name("bare.toml")
        bare.write_text(
            whole[: whole.index("[attitude]")] + whole[whole.index("[reference]") :], encoding="utf-8"
        )
        for name, flight in (("one antenna", bare), ("three antennas", path)):
            runs = [insgnss.replay(flight) for _ in range(4)]
            took_s = min(run.settings["took"]["filter_s"] for run in runs[1:])
            print(f"{name}: {1e3 * took_s / len(runs[0].nav):.2f} ms an epoch")


if __name__ == "__main__":
    main()
