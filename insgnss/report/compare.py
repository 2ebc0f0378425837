"""Comparison of runs: the effect of a setting, a mask or a smoother, over time and in numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import pandas as pd

from insgnss.errors import ResultError
from insgnss.gpstime import week_seconds_to_ns
from insgnss.report.charts import ChartRows, colour_of, line_trace
from insgnss.report.digest import digest, without_nan
from insgnss.report.html import Section, page, paragraphs, table, text, write
from insgnss.report.labels import label, row_of_numbers
from insgnss.report.run_time import gps_week, utc_origin_ms
from insgnss.report.sections.motion import SIGMA_GROUPS
from insgnss.report.sentences import name_of, utc_span
from insgnss.report.settings_compared import settings_that_differ
from insgnss.results.shown import ResultDisplay
from insgnss.runs.reference_errors import errors_against, trajectory_of
from insgnss.runs.result import Run
from insgnss.version import __version__

_SAME_TIME_S: Final = 5e-4
_NAMED: Final = 5  # settings, of those that differ, in the line that stands for a comparison
COMPONENTS: Final = tuple(name for _, _, names in SIGMA_GROUPS for name in names)


class ComparedSpan(NamedTuple):
    """The time that the statistics of all runs cover, in seconds of the first run's GPS week."""

    begin_s: float
    end_s: float
    is_settled: bool  # all runs know the heading from its beginning on

    def __str__(self) -> str:
        known = ", once all of them knew the heading" if self.is_settled else ""
        return f"{self.begin_s:.1f} to {self.end_s:.1f} s, the time that all runs have in common{known}"


@dataclass(frozen=True, repr=False)
class Comparison(ResultDisplay):
    """Runs, and the difference of each from the first."""

    runs: Mapping[str, Run]  # the first is what the others are compared with
    differences: Mapping[str, pd.DataFrame]  # of each other: time_s and d_n_m ... d_yaw_deg, run minus first
    statistics: pd.DataFrame  # a row for each run and component
    span: ComparedSpan  # what the statistics cover

    def _about(self) -> Iterator[str]:
        yield f"{', '.join(list(self.runs)[1:])} against {self.first}"
        differing = [row[0] for row in settings_that_differ(self.runs)]
        more = f" and {len(differing) - _NAMED} more" if len(differing) > _NAMED else ""
        yield f"settings that differ: {', '.join(differing[:_NAMED]) or 'none'}{more}"

    @property
    def first(self) -> str:
        """The name of the run that the others are compared with."""
        return next(iter(self.runs))

    def write(self, path: str | Path) -> Path:
        """Write the comparison's page, one HTML file; return its path.

        Raises
        ------
        ResultError : the file cannot be written
        """
        return write_comparison(self, path)

    def as_json(self) -> dict[str, Any]:
        """Return names, statistics and each run's own summary as plain data."""
        return {
            "first": self.first,
            "span": self.span._asdict(),
            "settings_that_differ": [list(row) for row in settings_that_differ(self.runs)],
            "statistics": without_nan(self.statistics.to_dict(orient="records")),
            "runs": {name: digest(run) for name, run in self.runs.items()},
        }


def compare(*runs: Run | str | Path, **named: Run | str | Path) -> Comparison:
    """Return the difference of each run from the first: ``compare(first, second)``, or ``compare(gps=a, all=b)``.

    Parameters
    ----------
    runs : runs or their folders; each is called by its folder, or by its filter
    named : runs or their folders, by the names to use

    Raises
    ------
    ResultError : fewer than two runs, no run in a folder, or two of them have no time in common
    """
    called = [_called(run) for run in runs]
    names = [name if called.count(name) == 1 else f"{name} ({i})" for i, name in enumerate(called, 1)]
    given = [*zip(names, runs, strict=True), *named.items()]
    if len(dict(given)) < len(given):
        raise ResultError("two runs have the same name", advice="name them apart, as compare(gps=a, all=b)")
    return compare_runs({name: run if isinstance(run, Run) else Run.load(run) for name, run in given})


def _called(run: Run | str | Path) -> str:
    """Return the default name of a run: its folder, or its filter."""
    if not isinstance(run, Run):
        return Path(run).resolve().name
    filter_ = dict(run.settings.get("filter") or {}).get("name") or "run"
    return f"{filter_}, smoothed" if run.settings.get("smooth") else str(filter_)


def compare_runs(runs: Mapping[str, Run]) -> Comparison:
    """Return the difference of each run from the first, at its own navigation rows inside the first's time.

    The statistics of all runs cover the same time: from when every run knew the heading, as far as all of them reach.

    Parameters
    ----------
    runs : by the name that the tables and charts call them

    Raises
    ------
    ResultError : fewer than two runs, or two of them have no time in common
    """
    if len(runs) < 2:
        raise ResultError("a comparison needs two runs or more", advice="insgnss compare RUN RUN")
    first, *others = runs
    base = runs[first]
    week = gps_week(base)
    reference = trajectory_of(base.nav, week)
    differences = {}
    # what added to a run's times gives seconds of the GPS week that the comparison counts from
    begin_ns = week_seconds_to_ns(week, 0.0)
    shifts = {
        name: float(week_seconds_to_ns(gps_week(run), 0.0) - begin_ns) * 1e-9 for name, run in runs.items()
    }
    for name in others:
        nav = runs[name].nav
        errors = errors_against(nav.assign(time_s=nav["time_s"] + shifts[name]), reference, week, None)
        if errors.empty:
            raise ResultError(
                f"'{name}' and '{first}' have no time in common", advice="compare runs of the same flight"
            )
        differences[name] = errors.drop(columns="quality")
    span = _common_span(runs, shifts)
    return Comparison(runs, differences, _statistics(runs, shifts, differences, span), span)


def _common_span(runs: Mapping[str, Run], shifts: Mapping[str, float]) -> ComparedSpan:
    """Return the time that all runs have in common, from when each that ever knew the heading knew it.

    If one knew it only after that time, the whole of it.
    """
    begin_s = max(float(run.nav["time_s"].iloc[0]) + shifts[name] for name, run in runs.items())
    end_s = min(float(run.nav["time_s"].iloc[-1]) + shifts[name] for name, run in runs.items())
    known = [(run.heading_known_s(), shifts[name]) for name, run in runs.items()]
    known_s = max((time_s + shift_s for time_s, shift_s in known if time_s is not None), default=np.inf)
    if known_s > end_s:
        return ComparedSpan(begin_s, end_s, False)
    is_settled = all(time_s is not None for time_s, _ in known)
    return ComparedSpan(max(known_s, begin_s), end_s, is_settled)


def write_comparison(comparison: Comparison, path: str | Path) -> Path:
    """Write the comparison's page; return its path.

    Raises
    ------
    ResultError : the file cannot be written
    """
    names = list(comparison.differences)
    navs = {name: run.nav for name, run in comparison.runs.items()}
    charts, sigmas = [], []
    for group, _, columns in SIGMA_GROUPS:
        drawn = _rows(comparison.differences, "d_", columns)
        charts.append(drawn.chart(f"chart-difference-{group}", f"Difference in {group}", row_px=150))
        drawn = _rows(navs, "sd_", columns)
        drawn.kinds |= dict.fromkeys(range(len(columns)), "log")
        sigmas.append(drawn.chart(f"chart-sigma-{group}", f"One sigma of {group}", row_px=130))
    sentences = [f"'{name}' is compared with '{comparison.first}'." for name in names]
    sentences += [f"'{name}': {name_of(run)}, {len(run.nav)} rows." for name, run in comparison.runs.items()]
    sections = [
        Section("summary", "What is compared", before=paragraphs(sentences) + _settings_table(comparison)),
        Section("statistics", "Statistics", before=_statistics_table(comparison)),
        Section("differences", "Differences over time", charts=charts),
        Section("sigma", "Sigma over time", charts=sigmas),
    ]
    foot = f"insgnss {__version__}; a difference is the run minus '{comparison.first}'."
    title = f"Comparison: {', '.join(comparison.runs)}"
    first = comparison.runs[comparison.first]
    return write(path, page(title, sections, foot, utc_origin_ms(first), about=f"{title}, {utc_span(first)}"))


def _statistics(
    runs: Mapping[str, Run],
    shifts: Mapping[str, float],
    differences: Mapping[str, pd.DataFrame],
    span: ComparedSpan,
) -> pd.DataFrame:
    """Return a row for each run and component; the first run has no difference."""
    rows = []
    for name, run in runs.items():
        own = span._replace(begin_s=span.begin_s - shifts[name], end_s=span.end_s - shifts[name])
        nav, errors = _within(run.nav, own), None
        if run.errors is not None:
            errors = run.error_summary(from_s=own.begin_s - _SAME_TIME_S, to_s=own.end_s + _SAME_TIME_S)
        difference = _within(differences[name], span) if name in differences else None
        for component in COMPONENTS:
            row: dict[str, Any] = {"run": name, "component": component}
            if difference is not None:
                values = difference[f"d_{component}"].dropna()
                row |= {"mean": values.mean(), "rms": float(np.sqrt((values**2).mean()))}
                row |= {"p95": values.abs().quantile(0.95), "max": values.abs().max()}
            row["median_sigma"] = nav[f"sd_{component}"].dropna().median()
            if errors is not None and component in errors.index:
                row["rms_error"] = errors.loc[component, "rms"]
            rows.append(row)
    columns = ["run", "component", "mean", "rms", "p95", "max", "median_sigma", "rms_error"]
    return pd.DataFrame(rows).reindex(columns=columns)


def _within(table_: pd.DataFrame, span: ComparedSpan) -> pd.DataFrame:
    """Return the rows of a time, to half a millisecond."""
    return table_[table_["time_s"].between(span.begin_s - _SAME_TIME_S, span.end_s + _SAME_TIME_S)]


def _settings_table(comparison: Comparison) -> str:
    rows = settings_that_differ(comparison.runs)
    if not rows:
        return "<p>Every setting is the same in all runs.</p>"
    return "<h3>Settings that differ</h3>" + table(("setting", *comparison.runs), rows)


def _statistics_table(comparison: Comparison) -> str:
    head = ("run", "component", "mean", "rms", "95 %", "largest", "median sigma", "rms error")
    rows = [
        [row[0], label(row[1]).axis(), *row_of_numbers([float(value) for value in row[2:]], float(row[6]))]
        for row in comparison.statistics.itertuples(index=False, name=None)
    ]
    about = (
        f"<p>All statistics cover {comparison.span}. Mean, rms, 95 % and largest are of the difference from"
        f" '{text(comparison.first)}'; the error is against the flight's own reference, where there is one.</p>"
    )
    return about + table(head, rows)


def _rows(tables: Mapping[str, pd.DataFrame], prefix: str, columns: tuple[str, ...]) -> ChartRows:
    """Return a row for each column, with a line for each table."""
    rows = ChartRows([label(column).axis() for column in columns])
    for place, (name, table_) in enumerate(tables.items()):
        time_s = table_["time_s"].to_numpy()
        for row, column in enumerate(columns):
            more: dict[str, Any] = {"legendgroup": name, "showlegend": row == 0}
            values = table_[f"{prefix}{column}"].to_numpy()
            rows.add(row, line_trace(time_s, values, name, colour_of(place), **more))
    return rows
