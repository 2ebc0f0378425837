"""The outage study: drift in windows without measurements, percentiles by time since the loss, and the recovery.

| table       | one row for each | columns |
|-------------|------------------|---------|
| windows     | window           | window from_s until_s n_taken n_rows peak_m end_m sd_end_m peak_mps sd_back_s drift_back_s events |
| drift       | window and output time | window time_s since_s horizontal_m vertical_m position_m velocity_mps attitude_deg, sd_* of each, sd_undisturbed_m |
| errors      | the same, against the reference; empty without one | the same without sd_undisturbed_m |
| percentiles | time since the loss, measure, and what it is against | against measure since_s n p50 p68 p95 max rms sd sd_ratio |

``drift`` is the difference from the undisturbed solution, ``errors`` that from the reference. An optimal filter's
difference from one that has more measurements has the covariance P - P_undisturbed: so ``sd_*`` of ``drift`` is
sqrt(sd^2 - sd_undisturbed^2), of ``errors`` the filter's own; ``sd_ratio`` is rms over sd, 1 is right.
``n_taken`` counts the rows taken away, those of several antennas too.
``end_m`` is the last before the window's end. ``sd_back_s`` is how long after the window the filter's position sigma is within 10 % of the undisturbed one's,
``drift_back_s`` how long until the drift stays within one undisturbed sigma; NaN: not within the time looked at.
"""  # noqa: E501 - the table is the documentation

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final

import numpy as np
import pandas as pd

from insgnss.config.filter import FilterConfig
from insgnss.config.library import filter_config
from insgnss.errors import ConfigError
from insgnss.kernels.compiled_ahead import usable_cores
from insgnss.log.flight import Flight
from insgnss.results.matplotlib_figure import with_caption
from insgnss.runs.datum import FLIGHT, GPS_WEEK, what_and_when
from insgnss.studies.figures import drift_figure
from insgnss.studies.outage.drift import back_after, differences, percentile_table, to_reference
from insgnss.studies.outage.replays import Branch, OutageLog, branches, undisturbed
from insgnss.studies.outage.windows import (
    ALL_MEASUREMENTS,
    OutageWindow,
    Removal,
    banked_windows,
    checked,
    periodic_windows,
    random_windows,
    require_count,
    require_seconds,
)
from insgnss.studies.saved_study import SavedStudy

if TYPE_CHECKING:
    from insgnss.studies.figures import Figure

_SETTLED_S: Final = 120.0  # after the start, before the first window of those that are not given


@dataclass(frozen=True)
class Periodic:
    """A window each period, from two minutes after the filter's start on."""

    length_s: float
    every_s: float


@dataclass(frozen=True)
class Random:
    """Windows at random that do not overlap."""

    length_s: float
    count: int
    seed: int = 1


@dataclass(frozen=True)
class Banked:
    """Windows in which the roll exceeds an angle."""

    bank_deg: float


Windows = Sequence[tuple[float, float]] | Periodic | Random | Banked


@dataclass(frozen=True, repr=False)
class OutageStudy(SavedStudy):
    """The result of ``outage_study``. Tables are DataFrames, the module's text has their columns."""

    PREFIX: ClassVar = "outage_"
    TABLES: ClassVar = ("windows", "drift", "errors", "percentiles")
    PICTURES: ClassVar = {"outage": "figure"}

    windows: pd.DataFrame
    drift: pd.DataFrame
    errors: pd.DataFrame
    percentiles: pd.DataFrame
    undisturbed: pd.DataFrame  # its navigation table, at the output times
    skipped: tuple[OutageWindow, ...]  # windows at whose beginning the filter was not running
    asked: Mapping[str, Any]
    took: Mapping[str, float]  # read_s pass_s branches_s

    def at(self, since_s: float, against: str = "undisturbed") -> pd.DataFrame:
        """Return the percentiles at a time since the loss."""
        table = self.percentiles
        chosen: pd.DataFrame = table[(table["against"] == against) & np.isclose(table["since_s"], since_s)]
        return chosen

    def figure(self) -> Figure:
        """Return the picture: drift and sigma by time since the loss."""
        title = f"without {self.asked['removal']}"
        figure = drift_figure(self.drift, self.errors, self.percentiles, title)
        return with_caption(figure, what_and_when(self.undisturbed))

    def _settings(self) -> Mapping[str, Any]:
        return {**self.asked, "skipped": self.skipped, "took": dict(self.took)}


def outage_study(
    flight: Flight | str | Path,
    windows: Windows,
    removal: Removal = ALL_MEASUREMENTS,
    *,
    filter: str | Path | FilterConfig = "tight",
    settings: Mapping[str, Any] | None = None,
    after_s: float = 60.0,
    rate_hz: float = 1.0,
    threads: int | None = None,
    progress: Callable[[str], None] | None = None,
) -> OutageStudy:
    """Remove measurements in windows of a log; return the drift of the solution and its recovery.

    Each window is by itself: before it the filter has had all measurements. All windows together cost one pass over the
    log and one over each window with the time looked at after it.

    Parameters
    ----------
    flight : the flight or its file
    windows : (from, until) each [s of the week], or how they are to be placed
    removal : which measurements are taken away
    filter : a name in the library, a file, or the settings themselves
    settings : of the filter, to be otherwise, as in ``insgnss.replay``
    after_s : looked at after each window
    rate_hz : of the solution that is compared
    threads : that work on windows at once; as many as there are cores when None
    progress : is called with a description of the current step

    Raises
    ------
    InsGnssError : a log or a setting cannot be used; ConfigError when no window lies within the filter's run
    """
    tell = progress or (lambda _: None)
    if not (np.isfinite(after_s) and after_s >= 0.0):
        raise ConfigError(f"{after_s} s after a window: invalid", key="after_s", advice="give 0 or more")
    _require_way(windows)
    flight = flight if isinstance(flight, Flight) else Flight.load(flight)
    began = time.perf_counter()
    tell("reading the logs")
    log = OutageLog.of(flight, filter_config(filter, settings), rate_hz)
    removal.rows_of(log.logs.gnss)  # raises before the work if a satellite is unknown
    read = time.perf_counter()
    tell("running the filter undisturbed")
    placed = _placed(log, windows)
    nav, checkpoints, skipped = undisturbed(log, placed)
    if not checkpoints:
        raise ConfigError("the filter runs in none of the windows", key="windows", advice=_span(nav))
    nav.attrs |= {GPS_WEEK: flight.config.gps_week, FLIGHT: flight.name}
    passed = time.perf_counter()
    tell(f"running {len(checkpoints)} windows")
    results = branches(log, checkpoints, removal, after_s, threads or usable_cores())
    done = time.perf_counter()
    took = {"read_s": read - began, "pass_s": passed - read, "branches_s": done - passed}
    asked = {
        "windows": str(windows) if isinstance(windows, Periodic | Random | Banked) else "given",
        "removal": removal.in_words(),
        "removed": asdict(removal),
        "after_s": after_s,
        "rate_hz": rate_hz,
    }
    return _study(log, nav, results, skipped, asked, took)


def _require_way(windows: Windows) -> None:
    """Refuse windows that no log can hold, before one is read.

    Raises
    ------
    ConfigError : a length, period, number or angle is impossible, or a window ends before it begins
    """
    if isinstance(windows, Periodic):
        require_seconds(length_s=windows.length_s, every_s=windows.every_s)
    elif isinstance(windows, Random):
        require_seconds(length_s=windows.length_s)
        require_count(windows.count)
    elif isinstance(windows, Banked):
        if not 0.0 <= windows.bank_deg <= 180.0:
            raise ConfigError(
                f"invalid bank {windows.bank_deg} deg", key="bank_deg", advice="give 0 to 180 deg"
            )
    else:
        checked(windows)


def _placed(log: OutageLog, windows: Windows) -> list[OutageWindow]:
    """Return the windows; to place them by bank or after the start takes a pass of its own."""
    if not isinstance(windows, Periodic | Random | Banked):
        return checked(windows)
    nav, _, _ = undisturbed(log, ())
    if isinstance(windows, Banked):
        return banked_windows(nav, windows.bank_deg)
    first_s, last_s = float(nav["time_s"].iloc[0]) + _SETTLED_S, float(nav["time_s"].iloc[-1])
    length_s = windows.length_s
    if isinstance(windows, Periodic):
        return periodic_windows(first_s, last_s, length_s=length_s, every_s=windows.every_s)
    rng = np.random.default_rng(windows.seed)
    return random_windows(first_s, last_s, length_s=length_s, count=windows.count, rng=rng)


def _span(nav: pd.DataFrame) -> str:
    if nav.empty:
        return "the filter never started: see 'insgnss check'"
    return f"it runs from {nav['time_s'].iloc[0]:.1f} to {nav['time_s'].iloc[-1]:.1f} s"


def _study(
    log: OutageLog,
    nav: pd.DataFrame,
    results: list[Branch],
    skipped: list[OutageWindow],
    asked: dict[str, Any],
    took: dict[str, float],
) -> OutageStudy:
    """Return the tables of all branches."""
    drifts, errors, rows = [], [], []
    for number, branch in enumerate(results):
        drift = differences(branch.nav, nav, branch.window.from_s)
        drifts.append(drift.assign(window=number))
        rows.append({"window": number, **_window_row(branch, drift)})
        if log.logs.reference is not None:
            against = to_reference(branch.nav, log, branch.window.from_s)
            errors.append(against.assign(window=number))
    drift_table = _stacked(drifts)
    error_table = _stacked(errors)
    return OutageStudy(
        pd.DataFrame(rows),
        drift_table,
        error_table,
        percentile_table({"undisturbed": drift_table, "reference": error_table}),
        nav,
        tuple(skipped),
        asked,
        took,
    )


def _stacked(tables: list[pd.DataFrame]) -> pd.DataFrame:
    if not tables:
        return pd.DataFrame(columns=["window", "time_s", "since_s"])
    whole = pd.concat(tables, ignore_index=True)
    return whole[["window", *(c for c in whole.columns if c != "window")]]


def _window_row(branch: Branch, drift: pd.DataFrame) -> dict[str, Any]:
    """Return a window's row: drift at its worst and at the end, and when the filter was back."""
    window = branch.window
    within = drift[drift["time_s"] < window.until_s]  # at its end the first measurements are back
    last = within.iloc[-1] if len(within) else None
    after = drift[drift["time_s"] >= window.until_s]
    sd_back, drift_back = back_after(after, window.until_s)
    kinds = [event.kind for event in branch.events]
    return {
        **window._asdict(),
        "n_taken": branch.n_taken,
        "n_rows": len(drift),
        "peak_m": float(drift["position_m"].max()) if len(drift) else np.nan,
        "end_m": np.nan if last is None else float(last["position_m"]),
        "sd_end_m": np.nan if last is None else float(last["sd_position_m"]),
        "peak_mps": float(drift["velocity_mps"].max()) if len(drift) else np.nan,
        "sd_back_s": sd_back,
        "drift_back_s": drift_back,
        "events": ", ".join(dict.fromkeys(kinds)),
    }
