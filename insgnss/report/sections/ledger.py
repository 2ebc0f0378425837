"""The ledger's totals: the status of every measurement in the log, by kind and by satellite."""

from __future__ import annotations

import numpy as np
import pandas as pd

from insgnss.report.epochs import of_satellites, satellites_of
from insgnss.report.html import Section, table
from insgnss.runs.columns.statuses import STATUS_MEANINGS
from insgnss.runs.result import Run


def section(run: Run) -> Section:
    """Return both tables; the sums are the input's."""
    counts = run.status_counts()
    kinds = [str(kind) for kind in counts.columns]
    rows: list[list[object]] = [
        [str(status), *(int(row[kind]) for kind in kinds), STATUS_MEANINGS.get(str(status), "")]
        for status, row in counts.iterrows()
    ]
    rows.append(["in the log", *(int(counts[kind].sum()) for kind in kinds), ""])
    head = ("status", *(kind.replace("_", " ") for kind in kinds), "meaning")
    title = f"<p>{len(run.measurements)} measurements, each with its status.</p>"
    return Section(
        "ledger", "Ledger", before=title + table(head, rows, name="ledger-totals") + _by_satellite(run)
    )


def _by_satellite(run: Run) -> str:
    ledger = of_satellites(run.measurements)
    if ledger.empty:
        return ""
    place, names = satellites_of(ledger)
    status = pd.Categorical(ledger["status"])
    cell = place * len(status.categories) + status.codes
    counts = np.bincount(cell, minlength=len(names) * len(status.categories)).reshape(len(names), -1)
    rows = []
    for name, of_satellite in zip(names, counts, strict=True):
        by_status = pd.Series(of_satellite, index=[str(word) for word in status.categories])
        n, n_used = int(by_status.sum()), int(by_status.get("used", 0))
        others = by_status[(by_status > 0) & (by_status.index != "used")].sort_values(
            ascending=False, kind="stable"
        )
        listed = ", ".join(f"{reason} {count}" for reason, count in others.items())
        rows.append([name, n, n_used, f"{100.0 * n_used / n:.1f}", listed or "-"])
    head = ("satellite", "in the log", "used", "used, %", "why not")
    return "<h3>By satellite</h3>" + table(head, rows, name="ledger-satellites")
