"""How often errors exceed their protection levels: simulated flights, faultless and with a faulty satellite.

    python -m tests.benchmarks.protection [--flights 10] [--seconds 300] [--first-seed 0]

prints a table in Markdown. Each flight turns at 10 Hz of GNSS and is replayed three times: as it is, with a satellite
whose ranges step by 5 to 300 m, and with one that runs away by 0.1 to 5 m/s, from a moment drawn in its second third.
No error lasts, neither in the simulation nor in the sigmas. An untold exceedance has the risk of ``[integrity]``
without a fault, and that over the fault's probability with one.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Final

import numpy as np

import insgnss
from insgnss.log.flight import FlightInMemory
from insgnss.runs.result import Run
from insgnss.simulation.simulated_log import Simulator
from tests.runs.scenes import flight, paper_sky, receiver, turns
from tests.runs.test_protection_levels import NONE_LAST

RATE_HZ: Final = 10.0
CASES: Final = ("no fault", "step of 5 to 300 m", "ramp of 0.1 to 5 m/s")


def with_fault(flown: FlightInMemory, case: str, rng: np.random.Generator) -> FlightInMemory:
    """Return a flight one of whose satellites is wrong from some moment on; a ramp moves its range rate too."""
    gnss = flown.logs.gnss
    t_s = (gnss.t_ns - gnss.t_ns[0]) * 1e-9
    since_s = t_s - rng.uniform(1.0, 2.0) * t_s[-1] / 3.0
    wrong = (gnss.sv == rng.choice(np.unique(gnss.sv))) & (since_s >= 0.0)
    sign = rng.choice([-1.0, 1.0])
    if case.startswith("step"):
        shift, rate = np.full(len(t_s), sign * rng.uniform(5.0, 300.0)), 0.0
    else:
        rate = sign * float(np.exp(rng.uniform(np.log(0.1), np.log(5.0))))
        shift = rate * since_s
    ranges = gnss.pseudorange_m + np.where(wrong, shift, 0.0)
    rates = gnss.range_rate_mps + np.where(wrong, rate, 0.0)
    spoilt = replace(gnss, pseudorange_m=ranges, range_rate_mps=rates)
    return replace(flown, logs=replace(flown.logs, gnss=spoilt))


def ratios(run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Return horizontal and vertical errors over their levels (n,)."""
    assert run.errors is not None
    both = run.errors.merge(run.nav[["time_s", "hpl_m", "vpl_m"]], on="time_s")
    horizontal = np.hypot(both["d_n_m"], both["d_e_m"]) / both["hpl_m"]
    return horizontal.to_numpy(), (both["d_d_m"].abs() / both["vpl_m"]).to_numpy()


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--flights", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=300.0)
    parser.add_argument("--first-seed", type=int, default=0)
    asked = parser.parse_args()
    found: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {case: [] for case in CASES}
    levels: dict[str, list[np.ndarray]] = {case: [] for case in CASES}
    slow = turns(asked.seconds).scenario
    base = Simulator(replace(slow, receiver=receiver(paper_sky(), rate_hz=RATE_HZ)))
    for seed in range(asked.first_seed, asked.first_seed + asked.flights):
        flown = flight(base, seed=seed)
        for case in CASES:
            rng = np.random.default_rng([seed, CASES.index(case)])
            spoilt = flown if case == CASES[0] else with_fault(flown, case, rng)
            run = insgnss.replay(spoilt, settings=NONE_LAST, integrity=True)
            found[case].append(ratios(run))
            levels[case].append(run.nav[["hpl_m", "vpl_m"]].to_numpy())
    print("| case | rows | beyond HPL / VPL | largest error over level, H / V | median HPL / VPL, m |")
    print("|---|---|---|---|---|")
    for case in CASES:
        h, v = (np.concatenate(part) for part in zip(*found[case], strict=True))
        hpl, vpl = np.median(np.concatenate(levels[case]), axis=0)
        print(
            f"| {case} | {len(h)} | {(h > 1.0).sum()} / {(v > 1.0).sum()} | {h.max():.2f} / {v.max():.2f} |"
            f" {hpl:.1f} / {vpl:.1f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
