"""A run in plain sentences: how long, how good, what went wrong, when the heading became known."""

from __future__ import annotations

from typing import Final

import numpy as np
import pandas as pd

from insgnss.errors import ResultError
from insgnss.report.epochs import used_at
from insgnss.report.labels import duration, number
from insgnss.report.run_time import gps_week, utc
from insgnss.run import Run
from insgnss.tables import Float64

# kinds of events that tell how the run went, and are no trouble; of the readers' notices only these are let pass
QUIET: Final = frozenset(
    "start heading_single heading_known measurements_back masking_on csv_delimiter csv_header_in_comment "
    "leap_seconds_by_date navigation_not_used navigation_repeated signal_assumed time_mark week_crossover "
    "ubx_foreign_bytes ubx_not_used android_lines_not_read rinex_event".split()
)
FEW: Final = 4  # satellites, below which a receiver alone has no position
_KINDS_TOLD: Final = 8


def way_m(nav: pd.DataFrame) -> float:
    """Return the way over ground [m]: the speed over the time."""
    speed = np.hypot(nav["vn_mps"].to_numpy(), nav["ve_mps"].to_numpy())
    return float(np.sum(0.5 * (speed[1:] + speed[:-1]) * np.diff(nav["time_s"].to_numpy())))


def name_of(run: Run) -> str:
    """Return the flight's name, and the filter's."""
    flight, filter_ = (dict(run.settings.get(key) or {}).get("name") for key in ("flight", "filter"))
    return f"{flight or 'run'}" + (f" ({filter_})" if filter_ else "")


def sentences(run: Run) -> list[str]:
    """Return the run in sentences, the most important first."""
    told = [
        _how_long(run),
        *_how_good(run),
        _heading(run),
        _satellites(run),
        _measurements(run),
        *_consistency(run),
    ]
    return [sentence for sentence in [*told, _trouble(run)] if sentence]


def _how_long(run: Run) -> str:
    nav = run.nav
    first, last = float(nav["time_s"].iloc[0]), float(nav["time_s"].iloc[-1])
    speed = float(np.hypot(nav["vn_mps"], nav["ve_mps"]).max())
    when = ""
    try:
        week = gps_week(run)
    except ResultError:
        pass
    else:
        when = f", {utc(first, week):%Y-%m-%d %H:%M:%S} to {utc(last, week):%H:%M:%S} UTC (GPS week {week})"
    return (
        f"{duration(last - first)} of navigation in {len(nav)} rows{when}; {number(way_m(nav) / 1000.0)} km over"
        f" ground, at most {number(speed)} m/s."
    )


def _how_good(run: Run) -> list[str]:
    known_s = run.heading_known_s()
    if run.errors is None or run.errors.empty:
        nav = run.nav if known_s is None else run.nav[run.nav["time_s"] >= known_s]
        horizontal = float(np.nanmedian(np.hypot(nav["sd_n_m"].to_numpy(), nav["sd_e_m"].to_numpy())))
        return [
            f"There is no reference: by its own account the position is good to {number(horizontal)} m"
            f" horizontally and {number(float(nav['sd_d_m'].median()))} m vertically (median sigma),"
            f" the heading to {number(float(nav['sd_yaw_deg'].median()))}°."
        ]
    errors = run.errors if known_s is None else run.errors[run.errors["time_s"] >= known_s]
    errors = run.errors if errors.empty else errors
    since = "" if known_s is None or errors is run.errors else ", from the heading known on"
    horizontal = np.hypot(errors["d_n_m"].to_numpy(), errors["d_e_m"].to_numpy())
    horizontal = horizontal[np.isfinite(horizontal)]
    told = []
    if len(horizontal):
        half, most, worst = np.quantile(horizontal, (0.5, 0.95, 1.0))
        vertical = float(errors["d_d_m"].abs().quantile(0.95))
        told.append(
            f"Against the reference the horizontal position is within {number(half)} m half of the time,"
            f" {number(most)} m 95 % of it, {number(worst)} m at worst;"
            f" the height within {number(vertical)} m 95 % of the time{since}."
        )
        told.append(_honesty(errors))
    return told


def _honesty(errors: pd.DataFrame) -> str:
    """Return whether the sigma of the position cover its errors."""
    ratio: Float64 = (errors["d_n_m"] / errors["sd_n_m"]).to_numpy()
    ratio = np.concatenate([ratio, (errors["d_e_m"] / errors["sd_e_m"]).to_numpy()])
    rms = float(np.sqrt(np.nanmean(ratio**2)))
    word = (
        "as large as they should be"
        if 0.5 <= rms <= 1.5
        else "too small"
        if rms > 1.5
        else "larger than need be"
    )
    return f"The horizontal sigmas are {word}: the error is {number(rms)} sigma (rms, 1 is right)."


def _heading(run: Run) -> str:
    known_s, first = run.heading_known_s(), float(run.nav["time_s"].iloc[0])
    if known_s is not None:
        return f"The heading became known {duration(max(known_s - first, 0.0))} after the start, at {known_s:.1f} s."
    sigma = run.nav["sd_yaw_deg"]
    if float(sigma.iloc[0]) < 5.0:
        return f"The heading was given at the start; its sigma ended at {number(float(sigma.iloc[-1]))}°."
    best = number(float(sigma.min()))
    return f"The heading never became known: its sigma was {best}° at best. Turns or accelerations show it."


def _satellites(run: Run) -> str:
    time_s = run.nav["time_s"].to_numpy()
    used = used_at(run, time_s)
    few = used < FEW
    seconds = float(np.diff(time_s)[few[:-1]].sum())
    lack = "never fewer than four" if not few.any() else f"fewer than four for {duration(seconds)}"
    span = f"{used.min():.0f} to {used.max():.0f}"
    return f"{span} satellites were used at an epoch, {used.mean():.1f} in the mean, {lack}."


def _measurements(run: Run) -> str:
    status = run.measurements["status"].value_counts()
    total, used = int(status.sum()), int(status.get("used", 0))
    if total == 0:
        return "The log holds no measurement."
    rest = [f"{word} {n}" for word, n in status.items() if n and word != "used"]
    why = f"; the others: {', '.join(rest[:_KINDS_TOLD])}" if rest else ""
    return f"Of {total} measurements {used} ({100.0 * used / total:.1f} %) were used{why}."


def _consistency(run: Run) -> list[str]:
    told = []
    for kind, row in run.nis_summary().iterrows():
        mean = float(row["mean_nis"])
        word = "agree with" if 0.5 <= mean <= 1.5 else "are larger than" if mean > 1.5 else "are smaller than"
        told.append(f"{str(kind).replace('_', ' ')} innovations {word} their sigma (mean NIS {mean:.2f})")
    return [f"The {'; '.join(told)}."] if told else []


def _trouble(run: Run) -> str:
    """Return what the events tell of trouble, the most frequent kind first."""
    counts = run.events["kind"].value_counts()
    found = {str(kind): int(n) for kind, n in counts.items() if kind not in QUIET}
    if not found:
        return "Nothing went wrong that the events tell of: no gaps, no resets, no jumps."
    kinds = [f"{kind.replace('_', ' ')} ({n})" for kind, n in list(found.items())[:_KINDS_TOLD]]
    more = f" and {len(found) - _KINDS_TOLD} further kinds" if len(found) > _KINDS_TOLD else ""
    return f"Worth a look in the events: {', '.join(kinds)}{more}."
