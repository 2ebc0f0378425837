"""A run's summary as plain numbers and words, for scripts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from insgnss.report.epochs import used_at
from insgnss.report.sentences import way_m
from insgnss.runs.result import Run


def digest(run: Run) -> dict[str, Any]:
    """Return the run's summary as plain numbers and words, as ``--json`` prints it; None where unknown."""
    nav, used = run.nav, used_at(run, run.nav["time_s"].to_numpy())
    counts = run.status_counts()
    reference = run.errors is not None and not run.errors.empty
    table = run.error_summary() if reference else pd.DataFrame()
    # pandas before 2.2.1 warns of a column without a number
    middle = {c[3:]: float(nav[c].dropna().median()) for c in nav.columns if c.startswith("sd_")}
    summary = {
        "flight": dict(run.settings.get("flight") or {}).get("name"),
        "filter": dict(run.settings.get("filter") or {}).get("name"),
        "rows": len(nav),
        "from_s": float(nav["time_s"].iloc[0]),
        "to_s": float(nav["time_s"].iloc[-1]),
        "way_m": way_m(nav),
        "heading_known_s": run.heading_known_s(),
        "errors": {str(name): {k: float(v) for k, v in row.items()} for name, row in table.iterrows()},
        "median_sigma": middle,
        "measurements": {str(k): {str(s): int(n) for s, n in counts[k].items() if n} for k in counts.columns},
        "nis": {
            str(k): {str(c): float(v) for c, v in row.items()} for k, row in run.nis_summary().iterrows()
        },
        "satellites_used": {"least": int(used.min()), "most": int(used.max()), "mean": float(used.mean())},
        "events": {str(kind): int(n) for kind, n in run.events["kind"].value_counts().items()},
        "took": dict(run.settings.get("took") or {}),
    }
    return dict(without_nan(summary))


def without_nan(value: Any) -> Any:
    """Return plain data with None in place of the numbers that JSON cannot write: NaN and the infinities."""
    if isinstance(value, dict):
        return {key: without_nan(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [without_nan(inner) for inner in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
