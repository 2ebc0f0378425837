"""The single-point solution of a flight: every GNSS epoch solved and tested independently, without the inertial log.

| table     | one row per | columns |
|-----------|-------------|---------|
| point     | epoch       | time_s x_m y_m z_m lat_deg lon_deg h_m vn_mps ve_mps vd_mps, sd_* and cov_* of them, clock_*_m clock_drift_mps, gdop pdop hdop vdop tdop, hpl_m vpl_m, n_used n_redundant test_statistic test_limit verdict, the same of the velocity |
| residuals | satellite, signal, epoch and kind | time_s sv signal kind residual sd normalised az_deg el_deg status |
| events    | event       | time_s kind detail |
| errors    | epoch inside the reference | time_s quality and estimate minus reference with its sigma |
"""  # noqa: E501 - the table is the documentation

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import NormalDist
from typing import Any, Final, Literal

import numpy as np
import pandas as pd

from insgnss.config.filter import FilterConfig
from insgnss.config.library import filter_config
from insgnss.errors import ConfigError, ResultError
from insgnss.filter.setup import FilterSetup
from insgnss.filter.start.fix import point_rows, point_settings
from insgnss.gnss.observation_rows import GnssRows
from insgnss.gnss.orbits.plausible_messages import refused_messages
from insgnss.gnss.point.log import solve_epochs
from insgnss.gnss.point.rows import PointLog, PointRows, at_time_tags, new_point_log
from insgnss.log.files import sha256
from insgnss.log.flight import Flight, FlightLogs
from insgnss.log.gnss_log import read_gnss_logs
from insgnss.log.reference import read_reference
from insgnss.results.nav_columns import ATTITUDE
from insgnss.results.saving import saving, writing
from insgnss.results.shown import ResultDisplay
from insgnss.results.table_files import table_files, write_table
from insgnss.runs.datum import annotate_all
from insgnss.runs.first_run import compiled
from insgnss.runs.gnss_rows import MAX_GDOP, corrected_rows
from insgnss.runs.point_tables import point_table, residual_table
from insgnss.runs.reference_errors import errors_against
from insgnss.runs.result_tables import event_table
from insgnss.runs.setup import setup_filter
from insgnss.tables import Bool, Float64, ImuTable
from insgnss.version import __version__

TABLES: Final = ("point", "residuals", "events", "errors")
_SETTINGS: Final = "point_settings.json"
FILES: Final = (*table_files(TABLES), _SETTINGS)
STUDY_NAME: Final = "point solution"  # in the record of a folder
TRUSTED: Final = ("ok", "fault excluded", "not tested")


@dataclass(frozen=True, repr=False)
class PointRun(ResultDisplay):
    """The result of ``point``. Tables are DataFrames; ``settings`` has everything needed to repeat it."""

    point: pd.DataFrame
    residuals: pd.DataFrame
    events: pd.DataFrame
    errors: pd.DataFrame | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        annotate_all((getattr(self, name) for name in TABLES), self.settings)

    def _about(self) -> Iterator[str]:
        yield f"{int(self.trusted().sum())} of {len(self.point)} epochs with a position that passed all tests"

    def save(self, folder: str | Path, format: Literal["parquet", "csv"] = "parquet") -> Path:
        """Write every table and ``point_settings.json`` into ``folder`` (made if needed); return the folder.

        Raises
        ------
        ResultError : the folder cannot be written, or another program's file has one of the names
        """
        folder = Path(folder)
        writing_files = writing("the solution", folder, "give another --output folder")
        with writing_files, saving(folder, FILES, STUDY_NAME) as new:
            for name in TABLES:
                write_table(new, name, getattr(self, name), format)
            text = json.dumps(self.settings, indent=1, default=str)
            (new / _SETTINGS).write_text(text, encoding="utf-8")
        return folder

    def trusted(self) -> Bool:
        """Return which epochs have a position that passed all tests."""
        return np.asarray(self.point["verdict"].str.startswith(TRUSTED) & self.point["lat_deg"].notna())

    def verdict_counts(self) -> pd.DataFrame:
        """Return how many epochs had each verdict, of position and velocity, the excluded satellites left out."""
        names = {"position": "verdict", "velocity": "velocity_verdict"}
        counts = {
            label: self.point[name].str.partition(":")[0].value_counts() for label, name in names.items()
        }
        return pd.DataFrame(counts).fillna(0).astype(np.int64).sort_values("position", ascending=False)

    def status_counts(self) -> pd.DataFrame:
        """Return how many measurements of each kind had each status; the sums are the log's."""
        counts = pd.crosstab(self.residuals["status"].astype("str"), self.residuals["kind"].astype("str"))
        return counts.loc[counts.sum(axis=1).sort_values(ascending=False, kind="stable").index]

    def error_summary(self, quality: float | None = None) -> pd.DataFrame:
        """Return 50 %, 95 % and largest error of the trusted epochs: horizontal, vertical, velocity.

        ``quality`` keeps only the reference rows of at most that quality number.

        Raises
        ------
        ResultError : the flight has no reference
        """
        if self.errors is None:
            raise ResultError("the flight has no reference", advice="name a [reference] in the flight file")
        table = self.errors
        if quality is not None:
            table = table[table["quality"] <= quality]
        sizes = {
            "horizontal_m": np.hypot(table["d_n_m"], table["d_e_m"]),
            "vertical_m": table["d_d_m"].abs(),
            "horizontal_mps": np.hypot(table["d_vn_mps"], table["d_ve_mps"]),
            "vertical_mps": table["d_vd_mps"].abs(),
        }
        rows = {
            name: {"n": len(v), "p50": v.quantile(0.5), "p95": v.quantile(0.95), "max": v.max()}
            for name, v in ((name, pd.Series(size).dropna()) for name, size in sizes.items())
        }
        return pd.DataFrame.from_dict(rows, orient="index").astype({"n": np.int64})


def point(
    flight: Flight | str | Path,
    filter: str | Path | FilterConfig = "tight",
    *,
    settings: Mapping[str, Any] | None = None,
    false_alarm: float = 1e-3,
    missed_detection: float = 1e-3,
    progress: Callable[[str], None] | None = None,
) -> PointRun:
    """Solve every GNSS epoch of a flight independently, with the filter's signals, masks, corrections and noise.

    Positions are at the receiver's time tags. The inertial log is not opened.

    Parameters
    ----------
    flight : the flight or its file
    filter : a name in the library (``models/filters``), a file, or the settings themselves
    settings : changed settings of the filter, as in ``replay``
    false_alarm : probability that the chi-square test refuses an epoch without a fault
    missed_detection : probability of a fault beyond the protection level that passes the test
    progress : is called with a description of the current step

    Raises
    ------
    InsGnssError : a log or a setting cannot be used
    """
    tell = progress or (lambda _: None)
    began = time.perf_counter()
    for name, value in (("false_alarm", false_alarm), ("missed_detection", missed_detection)):
        if not 0.0 < value < 0.5:
            raise ConfigError(f"{value} is not a probability", key=name, advice="give one between 0 and 0.5")
    if not isinstance(flight, Flight):
        flight = Flight.load(flight)
    config = filter_config(filter, settings)
    tell("reading the logs")
    with compiled(tell) as compilation:
        logs = read_logs(flight)
    tell("computing the satellites")
    # the carrier has no part in it
    setup = replace(setup_filter(flight, logs, config, several=False), with_carrier=False)
    rows, row_events = corrected_rows(setup, logs, flight)
    read = time.perf_counter()
    tell("solving the epochs")
    prepared, limits, out = solve_rows(setup, rows, false_alarm, missed_detection)
    solved = time.perf_counter()
    tell("writing the tables")
    week = flight.config.gps_week
    table = point_table(out, prepared, limits, logs.gnss, week, setup.clock_groups)
    return PointRun(
        point=table,
        residuals=residual_table(out, logs.gnss, week),
        events=event_table(logs.events + row_events, week),
        errors=_errors(table, logs, week),
        settings={
            "flight": flight.config.model_dump(mode="json"),
            "filter": config.model_dump(mode="json"),
            "clock_groups": list(setup.clock_groups),
            "false_alarm": false_alarm,
            "missed_detection": missed_detection,
            "input_sha256": logs.input_hashes,
            "version": __version__,
            "took": {
                **compilation.took,
                "read_s": read - began - compilation.waited_s,
                "solve_s": solved - read,
            },
        },
    )


def solve_rows(
    setup: FilterSetup, rows: GnssRows, false_alarm: float = 1e-3, missed_detection: float = 1e-3
) -> tuple[PointRows, Float64, PointLog]:
    """Return the rows as the solution takes them, the test's limits by redundant rows, and the solution.

    Parameters
    ----------
    setup, rows : ``setup_filter`` and ``corrected_rows`` of a flight
    false_alarm, missed_detection : as in ``point``
    """
    par = setup.parameters()[0]
    prepared = point_rows(rows, par, 0, len(rows.epoch_ns))
    limits = chi_square_limits(int(np.diff(rows.first).max(initial=0)) + 1, false_alarm)
    out = new_point_log(prepared, len(setup.clock_groups))
    missed_sigmas = NormalDist().inv_cdf(1.0 - missed_detection)
    settings = point_settings(par, setup.ties, MAX_GDOP, missed_sigmas, setup.unmodelled_zenith_m)
    solve_epochs(prepared, settings, limits, out)
    return prepared, limits, at_time_tags(out)


def chi_square_limits(most: int, false_alarm: float) -> Float64:
    """Return the value that chi-square exceeds with probability ``false_alarm``, by its degrees of freedom 0..most.

    Zero degrees: zero.
    """
    from scipy.special import chdtri  # late: a replay does not wait for it

    return np.append(0.0, chdtri(np.arange(1.0, most + 1.0), false_alarm))


def read_logs(flight: Flight) -> FlightLogs:
    """Return the flight's logs with an empty inertial one, whose file is not opened.

    Raises
    ------
    InputError or a subclass : a log is missing or unreadable
    """
    config = flight.config
    shared = config.columns_by_file()
    logs = read_gnss_logs(config.gnss, config.gps_week, flight.path, shared)
    events, reference = logs.events + refused_messages(logs.navigation), None
    if config.reference is not None:
        reference, more_events = read_reference(config.reference, config.gps_week, shared)
        events += more_events
    imu = ImuTable(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3)))
    hashes = {str(path): sha256(path) for path in flight.files() if path not in flight.inertial_files()}
    return FlightLogs(
        imu, logs.gnss, logs.navigation, reference, events, hashes, logs.products, logs.antennas, logs.base
    )


def _errors(table: pd.DataFrame, logs: FlightLogs, week: int) -> pd.DataFrame | None:
    """Return the trusted epochs' solution minus the reference; the antenna is assumed to be the reference's point."""
    if logs.reference is None:
        return None
    trusted = table["verdict"].str.startswith(TRUSTED) & table["lat_deg"].notna()
    nav = table[trusted].copy()
    for name in ATTITUDE:
        nav[name] = nav[f"sd_{name}"] = np.nan
    errors = errors_against(nav, logs.reference, week, None)
    return errors.drop(columns=[name for name in errors.columns if name.endswith("_deg")])
