"""Where receivers lose lock: the C/N0 at which half of the runs do, beside that of the linear theory."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np
import pandas as pd
from scipy import stats

from insgnss.studies.receiver.scene import StudyScene
from insgnss.tables import Float64

_CONFIDENCE: Final = 0.95
_HALF: Final = 0.5


def threshold_table(
    summary: pd.DataFrame, linear_dbhz: Mapping[str, float], scene: StudyScene
) -> pd.DataFrame:
    """Return where half of the runs lose lock, a row a receiver; NaN where no share passes one half."""
    rows = []
    for name, table in summary.groupby("variant", sort=False):
        ordered = table.sort_values("cn0_dbhz")
        cn0, runs = ordered["cn0_dbhz"].to_numpy(), ordered["runs"].to_numpy()
        lost = np.rint(ordered["lost"].to_numpy() * runs)
        tail = 0.5 * (1.0 - _CONFIDENCE)
        # the shares that runs as these leave open, by the beta distribution         [Clopper & Pearson 1934]
        least = stats.beta.ppf(tail, np.maximum(lost, 1e-9), runs - lost + 1.0)
        most = stats.beta.ppf(1.0 - tail, lost + 1.0, np.maximum(runs - lost, 1e-9))
        threshold, low, high = (crossing(cn0, share) for share in (lost / runs, least, most))
        linear = linear_dbhz[str(name)]
        rows.append((name, threshold, low, high, scene.js_db(threshold), linear, scene.js_db(linear)))
    columns = ["variant", "cn0_dbhz", "low_dbhz", "high_dbhz", "js_db", "linear_cn0_dbhz", "linear_js_db"]
    return pd.DataFrame(rows, columns=columns)


def crossing(cn0_dbhz: Float64, share: Float64) -> float:
    """Return the C/N0 at which a share that falls with it passes one half; NaN where it does not.

    Parameters
    ----------
    cn0_dbhz : (n,) growing
    """
    falling = np.minimum.accumulate(share)  # more signal does not lose more
    if not (falling[0] >= _HALF > falling[-1]):
        return math.nan
    k = int(np.flatnonzero(falling >= _HALF)[-1])
    part = (falling[k] - _HALF) / (falling[k] - falling[k + 1])
    return float(cn0_dbhz[k] + part * (cn0_dbhz[k + 1] - cn0_dbhz[k]))
