"""A run of a few rows with every table, marked by a number in each: for what becomes of its files."""

from __future__ import annotations

import pandas as pd

from insgnss.runs.result import Run
from tests.report.runs import made_run


def small_run(mark: float = 1.0, seconds: float = 10.0) -> Run:
    """Return a run of which every table has a column ``mark``, and the settings an entry."""
    run = made_run(seconds, satellites=3, aiding=True, gain=True)
    n, sv = 5, pd.Categorical(["G01", "G02", "G03", "G01", "G02"])
    word = pd.Categorical(["on"] * n)
    time = {"time_s": run.nav["time_s"].to_numpy()[:n], "sv": sv}
    run.aiding_budget = pd.DataFrame({**time, "sd_clock_mps": 0.1})
    run.supervision = pd.DataFrame({**time, "state": word, "decision": word, "receiver": word})
    run.transitions = pd.DataFrame({**time, "from_state": word, "to_state": word, "reason": word})
    run.search_times = pd.DataFrame({"sv": sv, "hold_s": 1.0})
    run.receiver_events = pd.DataFrame({**time, "event": word, "verdict": word})
    settings = {"gates": {"pseudorange_sigma": 5.0}, "heading": {"known_below_deg": 5.0}, "name": "tight17"}
    run.settings = {**run.settings, "filter": settings, "mark": mark}
    for table in vars(run).values():
        if isinstance(table, pd.DataFrame):
            table["mark"] = mark
    return run
