"""A run in plain sentences: duration, accuracy, faults, when the heading became known."""

from __future__ import annotations

from typing import Final

import numpy as np
import pandas as pd

from insgnss.errors import ResultError
from insgnss.report.epochs import used_at
from insgnss.report.labels import distance, duration, number
from insgnss.report.run_time import gps_week, utc
from insgnss.results.nav_columns import POSITION
from insgnss.runs.agreement import heading_of, times_their_sigma
from insgnss.runs.reference_errors import noise_variance
from insgnss.runs.result import Run
from insgnss.tables import Float64

# kinds of events that report normal operation; of the readers' notices only these count as normal
QUIET: Final = frozenset(
    "start heading_single heading_known measurements_back masking_on masking_waits masking_uncertain csv_delimiter "
    "csv_encoding csv_header_in_comment csv_lines_skipped leap_seconds_by_date navigation_not_used navigation_repeated "
    "signal_assumed columns_not_read reference_rows_left_out time_mark week_crossover imu_increment_over_long_step "
    "midnight_crossover ubx_foreign_bytes ubx_not_used android_lines_not_read rinex_event "
    "rows_of_other_logs".split()
)
FEW: Final = 4  # satellites, below which a receiver alone has no position
_KINDS_TOLD: Final = 8
_HORIZONTAL: Final = POSITION[:2]
_CONSTANT: Final = 5.0  # times the scatter about it, above which an offset is reported separately
_ENOUGH: Final = 10  # rows, below which nothing can be called constant


def figures(run: Run) -> list[tuple[str, str, str]]:
    """Return the numbers that a reader looks for first: name, value, and a word about it."""
    nav = run.nav
    span = float(nav["time_s"].iloc[-1]) - float(nav["time_s"].iloc[0])
    cards = [("Navigation", duration(span), f"{distance(way_m(nav))} travelled"), _position_figure(run)]
    known_s = run.heading_known_s()
    yaw = float(nav["sd_yaw_deg"].iloc[-1])
    after = (
        ""
        if known_s is None
        else f", known after {duration(max(known_s - float(nav['time_s'].iloc[0]), 0.0))}"
    )
    cards.append(("Heading", f"{number(yaw)}°", f"sigma at the end{after}"))
    counts = run.measurements["status"].value_counts()
    total = int(counts.sum())
    if total:
        share = 100.0 * int(counts.get("used", 0)) / total
        cards.append(("Measurements used", f"{share:.1f} %", f"of {total} in the log"))
    nis = run.nis_summary()["mean_nis"]
    if len(nis):
        kinds = ", ".join(str(kind).replace("_", " ") for kind in nis.index)
        cards.append(("Mean NIS (1 is right)", " / ".join(f"{value:.2f}" for value in nis), kinds))
    return cards


def _position_figure(run: Run) -> tuple[str, str, str]:
    """Return the horizontal position's 95 % error, its median sigma without a reference."""
    known_s = run.heading_known_s()
    from_s = -np.inf if known_s is None else known_s
    table = run.nav if run.errors is None else run.errors
    late = table[table["time_s"] >= from_s]
    table = table if late.empty else late
    if run.errors is not None and table["d_n_m"].notna().any():
        offset = constant_offset(table) or {"n_m": 0.0, "e_m": 0.0}
        error = np.hypot(table["d_n_m"].to_numpy() - offset["n_m"], table["d_e_m"].to_numpy() - offset["e_m"])
        constant = float(np.hypot(offset["n_m"], offset["e_m"]))
        less = f", less a constant {number(constant)} m" if constant else ""
        return (
            "Horizontal error",
            f"{number(float(np.nanquantile(error, 0.95)))} m",
            f"95 % of the time{less}",
        )
    sigma = np.hypot(table["sd_n_m"].to_numpy(), table["sd_e_m"].to_numpy())
    return ("Horizontal sigma", f"{number(float(np.nanmedian(sigma)))} m", "median; no reference")


def way_m(nav: pd.DataFrame) -> float:
    """Return the distance travelled [m], horizontally: the speed over the time."""
    speed = np.hypot(nav["vn_mps"].to_numpy(), nav["ve_mps"].to_numpy())
    return float(np.sum(0.5 * (speed[1:] + speed[:-1]) * np.diff(nav["time_s"].to_numpy())))


def name_of(run: Run) -> str:
    """Return the flight's name, the filter's, and whether the run was smoothed."""
    flight, filter_ = (dict(run.settings.get(key) or {}).get("name") for key in ("flight", "filter"))
    about = ([str(filter_)] if filter_ else []) + (["smoothed"] if run.settings.get("smooth") else [])
    return f"{flight or 'run'}" + (f" ({', '.join(about)})" if about else "")


def name_and_utc(run: Run) -> str:
    """Return the run's name and its time in UTC, for a picture."""
    try:
        return f"{name_of(run)}, {utc_span(run)}"
    except ResultError:
        return name_of(run)


def utc_span(run: Run) -> str:
    """Return the run's first and last time in UTC.

    Raises
    ------
    ResultError : the run does not say its GPS week
    """
    week, first, last = gps_week(run), float(run.nav["time_s"].iloc[0]), float(run.nav["time_s"].iloc[-1])
    return f"{utc(first, week):%Y-%m-%d %H:%M:%S} to {utc(last, week):%H:%M:%S} UTC"


def sentences(run: Run) -> list[str]:
    """Return the run in sentences, the most important first."""
    lines = [
        _how_long(run),
        *_how_good(run),
        _heading(run),
        _satellites(run),
        _measurements(run),
        *_consistency(run),
    ]
    return [sentence for sentence in [*lines, _trouble(run)] if sentence]


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
        f"{duration(last - first)} of navigation in {len(nav)} rows{when}; {distance(way_m(nav))}"
        f" travelled, at most {number(speed)} m/s."
    )


def _how_good(run: Run) -> list[str]:
    known_s = run.heading_known_s()
    if run.errors is None or run.errors.empty:
        nav = run.nav if known_s is None else run.nav[run.nav["time_s"] >= known_s]
        horizontal = float(np.nanmedian(np.hypot(nav["sd_n_m"].to_numpy(), nav["sd_e_m"].to_numpy())))
        return [
            f"No reference. By the filter's own sigma the position is good to {number(horizontal)} m"
            f" horizontally and {number(float(nav['sd_d_m'].median()))} m vertically (median sigma),"
            f" the heading to {number(float(nav['sd_yaw_deg'].median()))}°.",
            *_slow(nav),
        ]
    errors = run.errors if known_s is None else run.errors[run.errors["time_s"] >= known_s]
    errors = run.errors if errors.empty else errors
    since = "" if known_s is None or errors is run.errors else ", from the time the heading was known"
    if errors["d_n_m"].notna().sum() == 0:
        return []
    offset = constant_offset(errors)
    lines = [f"Against the reference {_within(errors)}{since}."]
    if offset is None:
        return [*lines, _honesty(errors), *_slow(errors)]
    about = errors.assign(**{f"d_{name}": errors[f"d_{name}"] - value for name, value in offset.items()})
    sides = zip(offset.values(), (("north", "south"), ("east", "west"), ("down", "up")), strict=True)
    told_offset = ", ".join(f"{number(abs(value))} m {words[value < 0.0]}" for value, words in sides)
    lines.append(
        f"Nearly all of it is one constant offset, {told_offset}: the reference may refer to another point or datum, or"
        f" either has slowly varying errors. Without this offset {_within(about)}."
    )
    return [*lines, _honesty(errors), _honesty_without_offset(about), *_slow(errors)]


def _has_slow(table: pd.DataFrame) -> bool:
    return "sd_slow_n_m" in table and not bool(table["sd_slow_n_m"].isna().all())


def _slow(table: pd.DataFrame) -> list[str]:
    """Return the share of the errors that last in the sigma, nothing for a run without them."""
    if not _has_slow(table):
        return []
    horizontal = float(
        np.nanmedian(np.hypot(table["sd_slow_n_m"].to_numpy(), table["sd_slow_e_m"].to_numpy()))
    )
    if not horizontal > 0.0:
        return []
    return [
        "Slowly varying errors (orbits, clocks, residual atmosphere, multipath) contribute about"
        f" {number(horizontal)} m to the horizontal sigma and {number(float(table['sd_slow_d_m'].median()))} m to the"
        " vertical sigma."
    ]


def constant_offset(errors: pd.DataFrame) -> dict[str, float] | None:
    """Return the median error of the position where it is five times its variation, else None [m]."""
    position = errors[[f"d_{name}" for name in POSITION]].dropna()
    median = position.median()
    rest = float(np.sqrt(((position - median) ** 2).sum(axis=1).mean()))
    if len(position) < _ENOUGH or not float(np.sqrt((median**2).sum())) > _CONSTANT * rest:
        return None
    return {str(name)[2:]: float(value) for name, value in median.items()}


def _within(errors: pd.DataFrame) -> str:
    """Return how near the reference the position is, horizontally and vertically."""
    horizontal = np.hypot(errors["d_n_m"].to_numpy(), errors["d_e_m"].to_numpy())
    half, most, worst = np.quantile(horizontal[np.isfinite(horizontal)], (0.5, 0.95, 1.0))
    vertical = float(errors["d_d_m"].abs().quantile(0.95))
    return (
        f"the horizontal position is within {number(half)} m (50 %), {number(most)} m (95 %),"
        f" {number(worst)} m at most; the height is within {number(vertical)} m (95 %)"
    )


def _honesty(errors: pd.DataFrame) -> str:
    """Return how the errors of the horizontal position go with its sigma."""
    rms = _horizontal_ratio(errors, *(errors[f"sd_{name}"] ** 2 for name in _HORIZONTAL))
    return (
        f"The horizontal errors {times_their_sigma(rms)} (rms of error over sigma {number(rms)}, 1 is right)."
    )


def _honesty_without_offset(about: pd.DataFrame) -> str:
    """Return how the errors about a constant offset go with the sigma, less the errors that last, which are in it."""
    variances, of_noise = [about[f"sd_{name}"] ** 2 for name in _HORIZONTAL], ""
    if _has_slow(about):
        variances = [noise_variance(about, name) for name in _HORIZONTAL]
        of_noise = " without the part of slowly varying errors"
    rms = _horizontal_ratio(about, *variances)
    return f"Without the constant offset they {times_their_sigma(rms)}{of_noise} (rms {number(rms)})."


def _horizontal_ratio(errors: pd.DataFrame, variance_n: pd.Series, variance_e: pd.Series) -> float:
    """Return the rms of the horizontal position's errors, each over its sigma."""
    ratio2: Float64 = np.concatenate([errors["d_n_m"] ** 2 / variance_n, errors["d_e_m"] ** 2 / variance_e])
    return float(np.sqrt(np.nanmean(ratio2)))


def _heading(run: Run) -> str:
    heading, first = heading_of(run), float(run.nav["time_s"].iloc[0])
    if heading.known_s is None:
        best = number(heading.smallest_deg)
        return f"The heading never became known: its sigma was {best}° at best. Turns or accelerations reveal it."
    lost = f"; it was lost again: its sigma ended at {number(heading.last_deg)}°" if heading.is_lost else ""
    if heading.given:
        return f"The heading was given at the start{lost or f'; its sigma ended at {number(heading.last_deg)}°'}."
    after = duration(max(heading.known_s - first, 0.0))
    return f"The heading became known {after} after the start, at {heading.known_s:.1f} s{lost}."


def _satellites(run: Run) -> str:
    time_s = run.nav["time_s"].to_numpy()
    used = used_at(run, time_s)
    few = used < FEW
    seconds = float(np.diff(time_s)[few[:-1]].sum())
    lack = "never fewer than four" if not few.any() else f"fewer than four for {duration(seconds)}"
    span = f"{used.min():.0f} to {used.max():.0f}"
    return f"{span} satellites were used per epoch, {used.mean():.1f} on average, {lack}."


def _measurements(run: Run) -> str:
    status = run.measurements["status"].value_counts()
    total, used = int(status.sum()), int(status.get("used", 0))
    if total == 0:
        return "The log holds no measurement."
    rest = [f"{word} {n}" for word, n in status.items() if n and word != "used"]
    why = f"; the others: {', '.join(rest[:_KINDS_TOLD])}" if rest else ""
    return f"Of {total} measurements {used} ({100.0 * used / total:.1f} %) were used{why}."


def _consistency(run: Run) -> list[str]:
    lines = []
    for kind, row in run.nis_summary().iterrows():
        mean = float(row["mean_nis"])
        word = times_their_sigma(float(np.sqrt(mean)))
        lines.append(f"{str(kind).replace('_', ' ')} innovations {word} (mean NIS {mean:.2f})")
    return [f"The {'; '.join(lines)}."] if lines else []


def _trouble(run: Run) -> str:
    """Return the events that report trouble, the most frequent kind first."""
    counts = run.events["kind"].value_counts()
    troubles = {str(kind): int(n) for kind, n in counts.items() if kind not in QUIET}
    if not troubles:
        return "No gaps, resets or clock jumps."
    kinds = [f"{kind.replace('_', ' ')} ({n})" for kind, n in list(troubles.items())[:_KINDS_TOLD]]
    more = f" and {len(troubles) - _KINDS_TOLD} further kinds" if len(troubles) > _KINDS_TOLD else ""
    return f"Worth a look in the events: {', '.join(kinds)}{more}."
