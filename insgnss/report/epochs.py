"""The satellites of a table, and how many of them each GNSS epoch used, where one satellite has several rows."""

from __future__ import annotations

from typing import Final

import numpy as np
import pandas as pd

from insgnss.runs.result import Run
from insgnss.tables import Float64, Int64

_USED: Final = ("used", "used_for_start")
# a row of the navigation table is at its epoch to the nanosecond, but seconds of the week round
_ROUNDING_S: Final = 1e-6


def of_satellites(ledger: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of a ledger that are about a satellite: a user's own measurements have none."""
    return ledger[ledger["sv"] != ""] if "" in ledger["sv"].cat.categories else ledger


def satellites_of(table: pd.DataFrame) -> tuple[Int64, list[str]]:
    """Return, of each row, its satellite's place in the list of names, and the names that occur, sorted."""
    # no copy of the words: a ledger has millions
    words = pd.Categorical(table["sv"]).remove_unused_categories()
    names = [str(name) for name in words.categories]
    order = sorted(range(len(names)), key=names.__getitem__)
    place = np.empty(len(names), np.int64)
    place[order] = np.arange(len(names))
    return place[words.codes] if len(names) else np.empty(0, np.int64), [names[i] for i in order]


def satellites_used(run: Run) -> tuple[Float64, Int64]:
    """Return the times of the log's epochs [s], and how many satellites corrected or started the state at each."""
    ledger = of_satellites(run.measurements)
    epochs, epoch = _epochs_of(ledger)
    place, names = satellites_of(ledger)
    used = ledger["status"].isin(_USED).to_numpy()
    seen = np.zeros((len(epochs), len(names)), np.bool_)
    seen[epoch[used], place[used]] = True
    return epochs, seen.sum(axis=1)


def _epochs_of(ledger: pd.DataFrame) -> tuple[Float64, Int64]:
    """Return the times of the epochs [s], and the number of each row's epoch; a ledger is in their order."""
    time_s = ledger["time_s"].to_numpy()
    new = np.diff(time_s, prepend=-np.inf) != 0.0
    return time_s[new], np.cumsum(new) - 1


def pseudoranges_used(run: Run) -> Int64:
    """Return how many pseudoranges corrected or started the state at each of the log's epochs, from the start on."""
    ledger = of_satellites(run.measurements)
    ledger = ledger[
        (ledger["kind"] == "pseudorange") & (ledger["time_s"] >= run.nav["time_s"].iloc[0] - _ROUNDING_S)
    ]
    return np.bincount(_epochs_of(ledger)[1], ledger["status"].isin(_USED).to_numpy()).astype(np.int64)


def used_at(run: Run, time_s: Float64) -> Float64:
    """Return the satellites used in the latest epoch at each of these times; 0 before the first."""
    epochs, count = satellites_used(run)
    if len(epochs) == 0:
        return np.zeros(len(time_s))
    latest = np.searchsorted(epochs, time_s + _ROUNDING_S, side="right") - 1
    return np.where(latest >= 0, count[np.maximum(latest, 0)], 0).astype(np.float64)
