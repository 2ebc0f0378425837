"""Drift of a solution that lost measurements: its differences, their sigma, percentiles, and when it is back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
import pandas as pd
import pymap3d

from insgnss.results.nav_columns import ATTITUDE, POSITION, VELOCITY
from insgnss.runs.reference_errors import errors_against
from insgnss.studies.outage.replays import OutageLog
from insgnss.studies.saved_study import MOMENT_DECIMALS
from insgnss.tables import Bool, Float64

# measure: what it is the length of
MEASURES: Final = {
    "horizontal_m": POSITION[:2],
    "vertical_m": POSITION[2:],
    "position_m": POSITION,
    "velocity_mps": VELOCITY,
    "attitude_deg": ATTITUDE,
}
_BACK: Final = 1.1  # sigma over the undisturbed one's that counts as back


def differences(nav: pd.DataFrame, undisturbed: pd.DataFrame, from_s: float) -> pd.DataFrame:
    """Return the difference of a solution from the undisturbed one at common times.

    ``sd_*`` is the expected difference by the two filters' sigmas; ``sd_undisturbed_m`` that of the position.
    """
    both = nav.merge(undisturbed, on="time_s", suffixes=("", "_u"))
    here = pymap3d.geodetic2ecef(both["lat_deg"], both["lon_deg"], both["h_m"])
    there = pymap3d.geodetic2ecef(both["lat_deg_u"], both["lon_deg_u"], both["h_m_u"])
    apart = [np.asarray(a) - np.asarray(b) for a, b in zip(here, there, strict=True)]
    ned = pymap3d.ecef2nedv(*apart, both["lat_deg"], both["lon_deg"])
    parts: dict[str, Float64] = dict(zip(POSITION, (np.asarray(c, np.float64) for c in ned), strict=True))
    for name in (*VELOCITY, *ATTITUDE):
        parts[name] = (both[name] - both[f"{name}_u"]).to_numpy()
    for name in ATTITUDE:
        parts[name] = (parts[name] + 180.0) % 360.0 - 180.0
    sd, sd_u = (both[[f"sd_{name}{end}" for name in parts]].to_numpy(np.float64) for end in ("", "_u"))
    variance = dict(zip(parts, np.maximum(sd**2 - sd_u**2, 0.0).T, strict=True))
    table = _lengths(both["time_s"].to_numpy(), from_s, parts, variance)
    own = np.sqrt(sum(both[f"sd_{name}_u"] ** 2 for name in POSITION))
    return table.assign(sd_undisturbed_m=np.asarray(own))


def to_reference(nav: pd.DataFrame, log: OutageLog, from_s: float) -> pd.DataFrame:
    """Return the error of a solution at the times that the reference covers, with the filter's own sigma."""
    config, reference = log.flight.config, log.logs.reference
    assert reference is not None
    of_antenna = config.reference is not None and config.reference.point == "antenna"
    lever = log.setup.lever_arm_m if of_antenna else None
    errors = errors_against(nav, reference, config.gps_week, lever)
    names = (*POSITION, *VELOCITY, *ATTITUDE)
    parts = {name: errors[f"d_{name}"].to_numpy() for name in names}
    variance = {name: (errors[f"sd_{name}"] ** 2).to_numpy() for name in names}
    return _lengths(errors["time_s"].to_numpy(), from_s, parts, variance)


def _lengths(
    time_s: Float64, from_s: float, parts: Mapping[str, Float64], variance: Mapping[str, Float64]
) -> pd.DataFrame:
    columns = {"time_s": time_s, "since_s": np.round(time_s - from_s, MOMENT_DECIMALS)}
    for measure, names in MEASURES.items():
        columns[measure] = np.sqrt(sum((parts[name] ** 2 for name in names), np.zeros(len(time_s))))
    for measure, names in MEASURES.items():
        columns[f"sd_{measure}"] = np.sqrt(sum((variance[name] for name in names), np.zeros(len(time_s))))
    return pd.DataFrame(columns)


def percentile_table(tables: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """Return percentiles over the windows by time since the loss, of each measure, against each table's own.

    ``sd`` is the root mean square of the predicted sigmas, ``sd_ratio`` the actual root mean square over it.
    """
    parts = [
        _of_measure(table, measure).assign(against=against, measure=measure)
        for against, table in tables.items()
        if len(table)
        for measure in MEASURES
    ]
    names = ["against", "measure", "since_s", "n", "p50", "p68", "p95", "max", "rms", "sd", "sd_ratio"]
    return pd.concat(parts, ignore_index=True)[names]


def _of_measure(table: pd.DataFrame, measure: str) -> pd.DataFrame:
    """Return a row for each time since the loss."""
    wide = table.pivot(index="since_s", columns="window", values=[measure, f"sd_{measure}"]).dropna(how="all")
    values, sigma = wide[measure].to_numpy(), wide[f"sd_{measure}"].to_numpy()
    p50, p68, p95 = np.nanquantile(values, [0.5, 0.68, 0.95], axis=1)
    rms, sd = (np.sqrt(np.nanmean(array**2, axis=1)) for array in (values, sigma))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(sd > 0.0, rms / sd, np.nan)
    return pd.DataFrame(
        {
            "since_s": wide.index.to_numpy(),
            "n": np.count_nonzero(np.isfinite(values), axis=1),
            "p50": p50,
            "p68": p68,
            "p95": p95,
            "max": np.nanmax(values, axis=1),
            "rms": rms,
            "sd": sd,
            "sd_ratio": ratio,
        }
    )


def back_after(after: pd.DataFrame, until_s: float) -> tuple[float, float]:
    """Return the time until the sigma is back at the undisturbed sigma and the drift within one such sigma [s]."""
    own = after["sd_undisturbed_m"].to_numpy()
    # the difference's variance is P - P_undisturbed
    whole = np.hypot(after["sd_position_m"].to_numpy(), own)
    time_s, drift = after["time_s"].to_numpy() - until_s, after["position_m"].to_numpy()
    return stays_from(time_s, whole <= _BACK * own), stays_from(time_s, drift <= own)


def stays_from(time_s: Float64, holds: Bool) -> float:
    """Return the first time from which a condition holds to the last, NaN where it does not hold there."""
    fails = np.flatnonzero(~holds)
    first = int(fails[-1]) + 1 if len(fails) else 0
    return round(float(time_s[first]), MOMENT_DECIMALS) if first < len(time_s) else float("nan")
