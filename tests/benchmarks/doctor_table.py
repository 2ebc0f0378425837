"""Which faults of a flight the input doctor finds, and whether its proposals mend them: on spoilt copies of sound logs.

    python -m tests.benchmarks.doctor_table [--only FAULT] [flight.toml ...]

prints a table in Markdown, one row per fault and one column per log: "mended" where the proposed keys give back the
unspoilt logs, "told" where the fault is named but nothing is proposed, "part" where some of several keys are,
"missed", or "WRONG" for a wrong proposal.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from insgnss.runs.simulate import simulate
from tests.log.checks.spoilt import FAULTS, Fault, Verdict, judged, log_of

ROOT = Path(__file__).resolve().parents[2]
FLIGHTS = [
    ROOT / "tests/flights/xian.toml",
    ROOT / "tests/flights/walk.toml",
    ROOT / "tests/flights/instinct.toml",
    ROOT / "data/sample_flight/flight.toml",
]
SIMULATED = ("turning_flight", "city_car", "small_drone")


def word(fault: Fault, verdict: Verdict) -> str:
    """Return a cell of the table."""
    if not fault.keys and not fault.words:  # the unspoilt log
        return "WRONG" if verdict.keys else "no alarm"
    if not fault.keys:
        return "told" if verdict.right else "missed" if not verdict.found else "WRONG"
    if verdict.right:
        return "mended"
    if not verdict.keys:
        return "told" if verdict.found else "missed"
    return "part" if verdict.keys < set(fault.keys) else "WRONG"


def main(arguments: list[str]) -> None:
    """Print the table."""
    only = arguments[1] if arguments[:1] == ["--only"] else ""
    given = [Path(a) for a in arguments[2 if only else 0 :]]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        paths = given or [*FLIGHTS, *(simulated(scenario, folder) for scenario in SIMULATED)]
        logs = {path.stem if path.stem != "flight" else path.parent.name: log_of(path) for path in paths}
        print("| fault | " + " | ".join(logs) + " |\n|---" * 1 + "|---" * len(logs) + "|")
        for title, fault in FAULTS.items():
            if only not in title:
                continue
            cells = [word(fault, judged(log, fault, folder / "spoilt")) for log in logs.values()]
            print(f"| {title} | " + " | ".join(cells) + " |", flush=True)


def simulated(scenario: str, folder: Path) -> Path:
    """Return the flight file of a simulated scenario."""
    simulate(scenario, seed=1).save(folder / scenario)
    return folder / scenario / "flight.toml"


if __name__ == "__main__":
    main(sys.argv[1:])
