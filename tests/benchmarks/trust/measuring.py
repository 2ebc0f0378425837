"""What is kept of a run: errors over sigma at the looks and in the windows, headings, events, all as numbers by name.

| name | what |
|------|------|
| LOOK.COMPONENT.error, .sigma | at the navigation row nearest to a look, in the component's unit |
| WINDOW.BLOCK.square | mean of the squared error over sigma, over the rows of a window and the axes |
| WINDOW.BLOCK.worst | largest error over sigma |
| WINDOW.yaw.least_sigma, .most_sigma, .error_square | of the heading [deg], [deg^2] |
| known_s, single_s | when the heading was called known, and when one heading was left [s]; infinite: never |
| false_heading | 1 where an error was beyond five sigma once the heading was called known or the only one |
| events.KIND | how many of a kind |
| reported, reported_s | 1 where an event after the fault names it, and when [s] |
| found | share of the lying satellites' pseudoranges that was not used, from 60 s after the fault on |
| bad_numbers | cells of the tables that are no number |
"""

from __future__ import annotations

import re
from typing import Final

import numpy as np
import pandas as pd

from insgnss.constants import NS_PER_S
from insgnss.tables import Float64
from tests.benchmarks.trust.flying import Flown
from tests.benchmarks.trust.rows import BLOCKS, MOTION, SIGMAS, VICTIM, Measure

KNOWN_BELOW_DEG: Final = 5.0
_FOUND_AFTER_S: Final = 60.0
_WHOLE: Final = (0.0, np.inf)
_NEXT_ROW_S: Final = 1.5  # a look must be that near to a row

Record = dict[str, float | str]


def record_of(flown: Flown) -> Record:
    """Return what is kept of a run."""
    errors = flown.run.errors
    assert errors is not None
    time_s = flown.since(errors["time_s"].to_numpy())
    z = {
        name: np.abs((errors[f"d_{name}"] / errors[f"sd_{name}"]).to_numpy())
        for block in MOTION
        for name in BLOCKS[block]
    }
    kept: Record = {}
    ends_s = flown.ready.simulator.scenario.duration_s - flown.origin_s
    for look, at_s in flown.row.looks.items():
        kept |= _looked(flown, errors, time_s, look, at_s if at_s >= 0.0 else ends_s + at_s)
    for window, (from_s, to_s) in {"all": _WHOLE, **flown.row.windows}.items():
        inside = (time_s >= from_s - 1e-6) & (time_s <= to_s + 1e-6)
        kept |= _in_window(errors, z, inside, window)
    kept |= _headings(flown, errors, time_s, z["yaw_deg"])
    kept |= _events(flown)
    kept["bad_numbers"] = _bad_numbers(flown)
    if flown.case.victims:
        kept["found"] = _found(flown)
    for name, measure in flown.row.measures.items():
        kept[name] = float(measure(flown))
    return kept


def _looked(flown: Flown, errors: pd.DataFrame, time_s: Float64, look: str, at_s: float) -> Record:
    """Return errors and sigmas at the row nearest to a time; nothing where there is none near."""
    if not len(time_s):
        return {}
    k = int(np.argmin(np.abs(time_s - at_s)))
    if abs(time_s[k] - at_s) > _NEXT_ROW_S:
        return {}
    found: Record = {}
    for block in MOTION:
        for name in BLOCKS[block]:
            found[f"{look}.{name}.error"] = float(errors[f"d_{name}"].iloc[k])
            found[f"{look}.{name}.sigma"] = float(errors[f"sd_{name}"].iloc[k])
    nav = flown.run.nav
    row = nav.iloc[int(np.argmin(np.abs(nav["time_s"].to_numpy() - errors["time_s"].iloc[k])))]
    truth = _true_biases(flown, float(time_s[k]) + flown.origin_s)
    for block, true in truth.items():
        for name, value in zip(BLOCKS[block], true, strict=True):
            found[f"{look}.{name}.error"] = float(row[name]) - float(value)
            found[f"{look}.{name}.sigma"] = float(row[f"sd_{name}"])
    return found


def _true_biases(flown: Flown, at_s: float) -> dict[str, Float64]:
    """Return the biases of the sensors at the epoch nearest to a time; their other errors are states of their own."""
    truth = flown.log.at_gnss
    k = int(np.argmin(np.abs((truth.t_ns - flown.case.start_ns) / NS_PER_S - at_s)))
    return {"accel_bias": truth.accel_bias[k], "gyro_bias": truth.gyro_bias[k]}


def _in_window(errors: pd.DataFrame, z: dict[str, Float64], inside: np.ndarray, window: str) -> Record:
    if not inside.any():
        return {}
    found: Record = {}
    for block in MOTION:
        axes = np.array([z[name][inside] for name in BLOCKS[block]])
        found[f"{window}.{block}.square"] = float(np.mean(axes**2))
        found[f"{window}.{block}.worst"] = float(np.max(axes))
    sigma = errors["sd_yaw_deg"].to_numpy()[inside]
    found[f"{window}.yaw.least_sigma"] = float(sigma.min())
    found[f"{window}.yaw.most_sigma"] = float(sigma.max())
    found[f"{window}.yaw.error_square"] = float(np.mean(errors["d_yaw_deg"].to_numpy()[inside] ** 2))
    return found


def _headings(flown: Flown, errors: pd.DataFrame, time_s: Float64, z: Float64) -> Record:
    """Return when the heading was called known and single, and whether it was false then or later."""
    events = flown.run.events
    found: Record = {}
    false = False
    for name, kind in (("known_s", "heading_known"), ("single_s", "heading_single")):
        at = flown.since(events.loc[events["kind"] == kind, "time_s"].to_numpy())
        # counted from the beginning of the log, not from the fault
        began_s = 0.0 if flown.row.cut else flown.origin_s
        found[name] = float(at[0]) + began_s if len(at) else np.inf
        if len(at):
            false |= bool(np.any(z[time_s >= at[0] - 1e-6][:1] > SIGMAS))
    called = errors["sd_yaw_deg"].to_numpy() < KNOWN_BELOW_DEG
    false |= bool(np.any(z[called] > SIGMAS))
    found["false_heading"] = float(false)
    return found


def _events(flown: Flown) -> Record:
    events = flown.run.events
    found: Record = {f"events.{kind}": float(n) for kind, n in events["kind"].value_counts().items()}
    if flown.row.event:
        pattern = flown.row.event.replace(VICTIM, "|".join(flown.case.victims))
        since_s = flown.since(events["time_s"].fillna(np.inf).to_numpy())
        words = (events["kind"].astype(str) + ": " + events["detail"].astype(str)).to_numpy()
        matches = [
            bool(re.search(pattern, text)) and s >= -2.0 for s, text in zip(since_s, words, strict=True)
        ]
        found["reported"] = float(any(matches))
        found["reported_s"] = float(
            min((s for s, m in zip(since_s, matches, strict=True) if m), default=np.inf)
        )
    return found


def _found(flown: Flown) -> float:
    ledger = flown.run.measurements
    since_s = flown.since(ledger["time_s"].to_numpy())
    lies = ledger["sv"].isin(flown.case.victims).to_numpy() & (ledger["kind"] == "pseudorange").to_numpy()
    rows = lies & (since_s >= _FOUND_AFTER_S) & (since_s <= _FOUND_AFTER_S + 60.0)
    return float(np.mean((ledger["status"] != "used").to_numpy()[rows])) if rows.any() else np.nan


def _bad_numbers(flown: Flown) -> float:
    run = flown.run
    bad = int((~np.isfinite(run.nav.to_numpy(dtype=np.float64))).sum())
    judged = run.measurements[run.measurements["status"].isin(("used", "gated"))]
    numbers = judged[["innovation", "sd_innovation", "nis"]].to_numpy(dtype=np.float64)
    return float(bad + int((~np.isfinite(numbers)).sum()))


def nav_at(flown: Flown, column: str, at_s: float) -> float:
    """Return a navigation column at the last row up to a time after the origin; NaN where there is none."""
    time_s = flown.since(flown.run.nav["time_s"].to_numpy())
    before = np.flatnonzero(time_s <= at_s + 1e-6)
    return float(flown.run.nav[column].iloc[before[-1]]) if len(before) else np.nan


def position_m(from_s: float, to_s: float) -> Measure:
    """Return the measure of the largest error of position in a span after the origin [m]."""

    def measure(flown: Flown) -> float:
        errors = flown.run.errors
        assert errors is not None
        since_s = flown.since(errors["time_s"].to_numpy())
        rows = (since_s >= from_s) & (since_s <= to_s)
        size = np.linalg.norm(errors[["d_n_m", "d_e_m", "d_d_m"]].to_numpy()[rows], axis=1)
        return float(size.max()) if len(size) else np.nan

    return measure
