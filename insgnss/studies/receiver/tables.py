"""The tables of a receiver study, out of its runs; ``insgnss.studies.receiver.comparison`` describes their columns."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import pandas as pd
from scipy import stats

from insgnss.studies.receiver.runs import ReceiverRun, Setting
from insgnss.studies.receiver.scene import StudyScene
from insgnss.studies.receiver.search import SearchRow
from insgnss.studies.receiver.variants import Variant
from insgnss.studies.receiver.workspace import ONE_STAGE
from insgnss.tables import Bool, Float64

# kinds of events: the filter goes on by itself from the one to the other
ALL_LOST, TRACKED_AGAIN = "all_channels_lost", "channel_tracked_again"
_SHARE: Final = 0.999  # of a consistent filter's NEES inside its bounds


def _after(setting: Setting) -> Bool:
    """Return which records count."""
    steps = setting.record_every * np.arange((len(setting.truth.t_s) - 1) // setting.record_every + 1)
    return np.asarray(steps >= setting.settle)


def _rms(values: list[Float64]) -> float:
    """Return the root mean square of vectors (k, 3), all runs together; NaN without a run."""
    return math.sqrt(float(np.mean([np.sum(v**2, axis=1).mean() for v in values]))) if values else math.nan


def _held(runs: list[ReceiverRun]) -> list[ReceiverRun]:
    return [run for run in runs if not run.lost]


def summary_row(
    scene: StudyScene, name: str, variant: Variant, level: float, runs: list[ReceiverRun]
) -> dict[str, Any]:
    """Return one row of ``summary``."""
    setting, held = scene.setting, _held(runs)
    after = _after(setting)
    error = [run.error[after] for run in held]
    replicas = np.sqrt(np.mean([run.rms**2 for run in held], axis=(0, 1))) if held else np.full(2, np.nan)
    states = int(np.isfinite(runs[0].sd[0]).sum())
    freedom = states * len(held)
    low, high = stats.chi2.interval(_SHARE, freedom) if freedom else (math.nan, math.nan)
    estimates = [run.cn0_dbhz for run in held if run.cn0_dbhz.size]
    return {
        "variant": name,
        "cn0_dbhz": level,
        "js_db": scene.js_db(level),
        "runs": len(runs),
        "lost": 1.0 - len(held) / len(runs),
        "position_m": _rms([e[:, 0:3] for e in error]),
        "velocity_mps": _rms([e[:, 3:6] for e in error]),
        "attitude_deg": math.degrees(_rms([e[:, 6:9] for e in error])),
        "channels_mps": _rms([run.least_squares[after, 3:6] for run in held]),
        "range_m": float(replicas[0]),
        "rate_mps": float(replicas[1]),
        "phase_rad": float(replicas[0]) * setting.channels.radians_per_m
        if setting.channels.coherent
        else math.nan,
        "nees": float(np.mean([run.nees[after].mean() for run in held])) if held and states else math.nan,
        "nees_low": low / max(freedom, 1),
        "nees_high": high / max(freedom, 1),
        "innovation_correlation": innovation_correlation(setting, variant, held),
        "cn0_estimated_dbhz": float(np.nanmean([x[len(x) // 2 :] for x in estimates]))
        if estimates
        else math.nan,
    }


def innovation_correlation(setting: Setting, variant: Variant, runs: list[ReceiverRun]) -> float:
    """Return the correlation of the innovations of successive updates of the filter, all channels and runs together.

    Equation: sum z_k z_(k+1) / sqrt(sum z_k^2 sum z_(k+1)^2); near 0 of a filter that is right, NaN without one.
    Updates that are closer than the records are looked at in the records.
    """
    if not variant.has_filter or not runs:
        return math.nan
    updates = 1 if variant.kind == ONE_STAGE else setting.interval
    lag = math.ceil(updates / setting.record_every)
    z = np.concatenate([run.innovation[_after(setting)] for run in runs], axis=1)
    before, after = z[:-lag], z[lag:]
    known = np.isfinite(before) & np.isfinite(after)
    size = math.sqrt(float(np.sum(before[known] ** 2) * np.sum(after[known] ** 2)))
    return float(np.sum(before[known] * after[known])) / size if size > 0.0 else math.nan


def channel_rows(scene: StudyScene, name: str, level: float, runs: list[ReceiverRun]) -> pd.DataFrame:
    """Return one row for each channel."""
    held = _held(runs)
    rms = (
        np.sqrt(np.mean([run.rms**2 for run in held], axis=0))
        if held
        else np.full((scene.channels, 2), np.nan)
    )
    predicted = (
        np.sqrt(np.mean([run.predicted**2 for run in held], axis=0)) if held else np.full_like(rms, np.nan)
    )
    lost = np.mean([np.isfinite(run.lost_s) for run in runs], axis=0)
    return pd.DataFrame(
        {
            "variant": name,
            "cn0_dbhz": level,
            "channel": np.arange(scene.channels),
            "az_deg": scene.azimuth_deg,
            "el_deg": scene.elevation_deg,
            "lost": lost,
            "range_m": rms[:, 0],
            "rate_mps": rms[:, 1],
            "range_predicted_m": predicted[:, 0],
            "rate_predicted_mps": predicted[:, 1],
        }
    )


def search_rows(receiver_runs: Mapping[tuple[str, float], list[ReceiverRun]]) -> pd.DataFrame:
    """Return the searches of all runs."""
    rows = [
        {"variant": name, "cn0_dbhz": level, "run": k, **row._asdict()}
        for (name, level), runs in receiver_runs.items()
        for k, run in enumerate(runs)
        for row in run.searches
    ]
    return pd.DataFrame(rows, columns=["variant", "cn0_dbhz", "run", *SearchRow._fields])


def event_rows(receiver_runs: Mapping[tuple[str, float], list[ReceiverRun]]) -> pd.DataFrame:
    """Return the times at which a run lost its last channel, and at which a channel was tracked again."""
    rows = [
        {"variant": name, "cn0_dbhz": level, "run": k, "time_s": time_s, "kind": kind}
        for (name, level), runs in receiver_runs.items()
        for k, run in enumerate(runs)
        for from_s, to_s in spans_without_a_channel(run)
        for time_s, kind in ((from_s, ALL_LOST), (to_s, TRACKED_AGAIN))
        if math.isfinite(time_s)
    ]
    return pd.DataFrame(rows, columns=["variant", "cn0_dbhz", "run", "time_s", "kind"])


def spans_without_a_channel(run: ReceiverRun) -> list[tuple[float, float]]:
    """Return the spans of time [s] in which no channel of a run was tracked; inf: up to its end.

    A channel that has lost lock stays lost. One whose signal was gone is tracked again when it has been found.
    """
    out = [[(float(t_s), math.inf)] if math.isfinite(t_s) else [] for t_s in run.lost_s]
    for search in run.searches:
        out[search.channel].append((search.lost_s, search.tracked_s))
    spans: list[tuple[float, float]] = []
    for begins_s in sorted({from_s for channel in out for from_s, _ in channel}):
        ends = [[to_s for from_s, to_s in channel if from_s <= begins_s < to_s] for channel in out]
        if all(ends) and not (spans and begins_s < spans[-1][1]):
            spans.append((begins_s, min(max(of_channel) for of_channel in ends)))
    return spans


def tracked(run: ReceiverRun, time_s: Float64) -> Float64:
    """Return the share of a run's channels that are tracked over time (k,): neither lost nor looked for."""
    held = run.lost_s > time_s[:, None]
    for search in run.searches:
        held[(search.lost_s <= time_s) & (time_s < search.tracked_s), search.channel] = False
    return np.asarray(held.mean(axis=1))


def epoch_rows(
    setting: Setting, name: str, level: float, runs: list[ReceiverRun], cn0_dbhz: Float64
) -> pd.DataFrame:
    """Return errors over time: of all runs, those that lost lock as well."""
    time_s = setting.record_every * setting.truth.step_s * np.arange(len(runs[0].error), dtype=np.float64)
    squares = np.mean([run.error**2 for run in runs], axis=0)
    variances = np.mean([run.sd**2 for run in runs], axis=0)
    first = np.array([run.lost_s.min() for run in runs])
    return pd.DataFrame(
        {
            "variant": name,
            "cn0_dbhz": level,
            "time_s": time_s,
            "position_m": np.sqrt(squares[:, 0:3].sum(axis=1)),
            "velocity_mps": np.sqrt(squares[:, 3:6].sum(axis=1)),
            "attitude_deg": np.degrees(np.sqrt(squares[:, 6:9].sum(axis=1))),
            "position_sd_m": np.sqrt(variances[:, 0:3].sum(axis=1)),
            "velocity_sd_mps": np.sqrt(variances[:, 3:6].sum(axis=1)),
            "attitude_sd_deg": np.degrees(np.sqrt(variances[:, 6:9].sum(axis=1))),
            "nees": np.mean([run.nees for run in runs], axis=0),
            "lost": (first[:, None] <= time_s).mean(axis=0),
            "tracked": np.mean([tracked(run, time_s) for run in runs], axis=0),
            "channel_m": runs[0].offset[:, 0],
            "channel_mps": runs[0].offset[:, 1],
            "received_dbhz": cn0_dbhz[:: setting.record_every].mean(axis=1),
        }
    )
