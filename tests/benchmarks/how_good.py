"""How good the filter is on the real logs: GPS L1 alone against everything the log holds.

    python -m tests.benchmarks.how_good [flight.toml ...]

prints a table in Markdown. Errors are horizontal, against the reference where there is one; a constant offset of the
reference (a base station known to metres) is taken off, and the first 20 s, while the heading is found, are left out.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd

import insgnss
from insgnss.config.filter import FilterConfig
from insgnss.config.library import filter_config
from insgnss.runs.result import Run

FLIGHTS = Path(__file__).resolve().parent.parent / "flights"
SETTLED_S = 20.0
COLUMNS = (
    "log",
    "signals",
    "rows used",
    "horizontal 50 / 95 / max, m",
    "vertical 95, m",
    "velocity rms N / E / D, m/s",
    "mean NIS range / rate / carrier",
)


def gps_l1() -> FilterConfig:
    """Return the filter with pseudoranges and Doppler of GPS L1 C/A alone."""
    config = filter_config("tight17")
    use = config.measurements.model_copy(
        update={"constellations": ("G",), "signals": {"G": ("C1C",)}, "every_band": False, "carrier": False}
    )
    return config.model_copy(update={"measurements": use})


def measured(run: Run) -> tuple[str, str, str]:
    """Return horizontal, vertical and velocity errors in words; "-" without a reference."""
    if run.errors is None:
        return "-", "-", "-"
    table = run.errors[run.errors["time_s"] > run.errors["time_s"].iloc[0] + SETTLED_S]
    north, east, down = (table[name] - table[name].median() for name in ("d_n_m", "d_e_m", "d_d_m"))
    level = pd.Series(np.hypot(north, east))
    quantiles = " / ".join(f"{level.quantile(q):.2f}" for q in (0.5, 0.95, 1.0))
    velocity = " / ".join(
        f"{float(np.sqrt((table[name] ** 2).mean())):.3f}" for name in ("d_vn_mps", "d_ve_mps", "d_vd_mps")
    )
    return quantiles, f"{down.abs().quantile(0.95):.2f}", velocity


def lines(flights: list[Path]) -> Iterator[str]:
    """Yield the table's lines."""
    yield f"| {' | '.join(COLUMNS)} |"
    yield f"|{'---|' * len(COLUMNS)}"
    for path in flights:
        for name, config in (("GPS L1", gps_l1()), ("everything", filter_config("tight17"))):
            run = insgnss.replay(path, config)
            nis = run.nis_summary()
            used = int(nis["used"].sum())
            shown = " / ".join(f"{value:.2f}" for value in nis["mean_nis"])
            yield f"| {path.stem} | {name} | {used} | {' | '.join(measured(run))} | {shown} |"


def main() -> None:
    """Print the table of the flights named on the command line, of all those of the tests when none is."""
    flights = [Path(name) for name in sys.argv[1:]] or sorted(FLIGHTS.glob("*.toml"))
    for line in lines(flights):
        print(line, flush=True)


if __name__ == "__main__":
    main()
