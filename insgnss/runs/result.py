"""A run: the result tables of a replay, and how they are saved and loaded.

| table          | one row per | columns |
|----------------|-------------|---------|
| nav            | output time | time_s lat_deg lon_deg h_m vn_mps ve_mps vd_mps roll_deg pitch_deg yaw_deg, sd_* of each, biases, clock_bias_m clock_drift_mps, offset_*_m, n_used n_hypotheses, sd_slow_* of the position; where asked for q_nb_*, cov_*, point_* |
| measurements   | satellite, signal, epoch and kind; row of a user's own measurement | time_s sv signal kind innovation sd_innovation nis status |
| satellites     | satellite and epoch | time_s sv az_deg el_deg body_az_deg body_el_deg gain_dbi cn0_dbhz state sd_range_m sd_range_rate_mps |
| events         | event       | time_s kind detail |
| errors         | nav row inside the reference | time_s and estimate minus reference with its sigma |
| filtered       | row of nav, of a smoothed run, where the filter had one | time_s, position, velocity and attitude with sd_* as the filter had them |
| imu            | stretch of the inertial log | time_s, smallest and largest rate and specific force of each axis |
| imu_spectrum   | frequency   | frequency_hz, amplitude spectral density of each axis |
| aiding         | output time of the aiding and satellite above the horizon | time_s sv range_rate_mps range_acceleration_mps2 range_jerk_mps3 doppler_hz doppler_rate_hz_per_s pseudorange_m code_delay_rate_s_per_s, sd_* of each, age_s |
| aiding_budget  | satellite, whenever its sigmas are recomputed | time_s sv, parts of the sigmas of rate and
acceleration |
| supervision    | satellite above the horizon and epoch | time_s sv state decision receiver el_deg gain_dbi cn0_dbhz pseudorange_m doppler_hz sd_range_m sd_range_rate_mps within_aperture, search window and times |
| transitions    | change of a channel's state | time_s sv from_state to_state reason, prediction and search window |
| search_times   | satellite   | sv, seconds held, in search, and in search without the supervisor |
| integrity      | fault of a satellite or constellation | its largest separation from the solution over the limit, rows with an alert |
| receiver_events | event in the log of the receiver's own | time_s sv event supervisor verdict lag_s |

From aiding on where they were asked for; ``insgnss.aiding.table`` and ``insgnss.receiver.supervised_run`` say more.
"""  # noqa: E501 - the table is the documentation

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import pandas as pd
from pandas.api.types import is_float_dtype

from insgnss.errors import ResultError
from insgnss.results.saving import RUN_KIND, saving, writing
from insgnss.results.shown import ResultDisplay
from insgnss.results.table_files import column_types, pieces, table_files, write_table
from insgnss.runs.between_rows import InterpolationLimits, rows_at
from insgnss.runs.datum import annotate_all, with_heading, with_sea_level, with_utc
from insgnss.runs.reference_errors import noise_variance
from insgnss.runs.result_folder import COLUMN_TYPES, SETTINGS, read_run

_OPTIONAL = (
    "errors",
    "filtered",
    "imu",
    "imu_spectrum",
    "aiding",
    "aiding_budget",
    "supervision",
    "transitions",
    "search_times",
    "receiver_events",
    "integrity",
)
TABLES = ("nav", "measurements", "satellites", "events", *_OPTIONAL)
_NO_FILTER = ("imu_gap", "restart")  # events at which the filter has no rows for a while
FILES = (*table_files(TABLES), SETTINGS, COLUMN_TYPES)


@dataclass(repr=False)
class Run(ResultDisplay):
    """The result of a replay. Tables are DataFrames; ``settings`` has everything needed to repeat the run."""

    nav: pd.DataFrame
    measurements: pd.DataFrame
    satellites: pd.DataFrame
    events: pd.DataFrame
    errors: pd.DataFrame | None = None
    aiding: pd.DataFrame | None = None
    aiding_budget: pd.DataFrame | None = None
    supervision: pd.DataFrame | None = None
    transitions: pd.DataFrame | None = None
    search_times: pd.DataFrame | None = None
    receiver_events: pd.DataFrame | None = None
    integrity: pd.DataFrame | None = None
    filtered: pd.DataFrame | None = None
    imu: pd.DataFrame | None = None
    imu_spectrum: pd.DataFrame | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    # writes a run's page; pages are drawn from runs and import them, so the package sets it
    page_writer: ClassVar[Callable[[Run, str | Path], Path]]

    def __post_init__(self) -> None:
        self.annotate()

    def annotate(self) -> None:
        """Write the GPS week and the units into the ``attrs`` of every table, where the settings say the week."""
        annotate_all((table for _, table in self._tables()), self.settings)

    def nav_with(self, *, utc: bool = False, sea_level: bool = False, heading: bool = False) -> pd.DataFrame:
        """Return the navigation table with the requested columns; ``insgnss.runs.datum`` does it for other tables.

        Parameters
        ----------
        utc : UTC as index
        sea_level : columns ``h_msl_m`` and ``geoid_m``: height above mean sea level, and the geoid's (EGM96)
        heading : column ``heading_deg``: from true north, 0 to below 360

        Raises
        ------
        ResultError : UTC is asked for and the settings do not say the GPS week
        """
        nav = self.nav
        nav = with_sea_level(nav) if sea_level else nav
        nav = with_heading(nav) if heading else nav
        return with_utc(nav) if utc else nav

    def _about(self) -> Iterator[str]:
        flight, filter_ = (dict(self.settings.get(key) or {}).get("name") for key in ("flight", "filter"))
        smoothed = ", smoothed" if self.settings.get("smooth") else ""
        yield f"'{flight or 'run'}', filter '{filter_ or ''}'{smoothed}"
        if len(self.nav):
            yield f"{self.nav['time_s'].iloc[0]:.1f} to {self.nav['time_s'].iloc[-1]:.1f} s of the week"
        known_s = self.heading_known_s()
        yield "no event 'heading_known'" if known_s is None else f"heading known at {known_s:.1f} s"
        used = int((self.measurements["status"] == "used").sum())
        yield f"{used} of {len(self.measurements)} measurements used"

    def save(self, folder: str | Path, format: Literal["parquet", "csv"] = "parquet") -> Path:
        """Write every table and ``settings.json`` into ``folder`` (made if needed); return the folder.

        As CSV with ``columns.json``: the width of each number and the order of the words, which CSV does not store.
        The folder holds the old run or the new one, never parts of both (``insgnss.results.saving``).

        Raises
        ------
        ResultError : the folder cannot be written, or another program's file has one of the names
        """
        folder = Path(folder)
        with (
            writing("the run", folder, "give another --output folder"),
            saving(folder, FILES, RUN_KIND) as new,
        ):
            for name, table in self._tables():  # one by one: two threads would save 0.1 s and take 30 MB
                _save_table(new, name, table, format)
            if format == "csv":
                types = {name: column_types(table) for name, table in self._tables() if table is not None}
                (new / COLUMN_TYPES).write_text(json.dumps(types, indent=1), encoding="utf-8")
            settings = json.dumps(self.settings, indent=1, default=str)
            (new / SETTINGS).write_text(settings, encoding="utf-8")
        return folder

    def _tables(self) -> Iterator[tuple[str, pd.DataFrame | None]]:
        return ((name, getattr(self, name)) for name in TABLES)

    @classmethod
    def load(cls, folder: str | Path) -> Run:
        """Read a saved run.

        Raises
        ------
        ResultError : there is no such folder, it holds no complete run, or a file of it is damaged
        """
        tables, settings = read_run(Path(folder), TABLES, _OPTIONAL)
        return cls(**tables, settings=settings)  # type: ignore[arg-type]

    def report(self, path: str | Path) -> Path:
        """Write the run's page, one HTML file that opens without a network; return its path.

        Raises
        ------
        ResultError : the run has no navigation row, or the file cannot be written
        """
        return Run.page_writer(self, path)

    def at(
        self,
        times_s: Any,
        *,
        most_deg: float = 0.2,
        most_m: float = 0.2,
        most_mps: float = 0.5,
        refuse: bool = True,
    ) -> pd.DataFrame:
        """Return rows of ``nav`` at any times of the run, in their order: interpolated between its rows.

        Position is interpolated by a cubic with the velocities at both rows, attitude by the shortest rotation, the
        rest linearly. Motion between rows is lost: the loss is estimated from the changes of rate and acceleration
        between steps, and added to the sigmas (``between_rows``). For a camera on a vehicle that turns, rows at GNSS
        epochs are too few: ``replay(..., output=times)`` gives the filter's own rows at these times, ``output="imu"``
        rows that can be interpolated.

        Parameters
        ----------
        times_s : in any order: seconds of the GPS week, as in ``nav["time_s"]``; or dates with a zone, which become
            GPS time with the leap seconds in force: a DatetimeIndex as that of ``nav_with(utc=True)``, ``datetime``
            objects, text in ISO 8601 ("2025-09-24T09:36:22.25Z"). A date without a zone is an error
        most_deg, most_m, most_mps : largest permitted loss of attitude, position and velocity, one sigma
        refuse : whether a time outside the run, in a gap of its rows, or at which more than that may be lost is an
            error; if not, its row holds NaN except ``time_s``

        Raises
        ------
        ResultError : a value is not a time, or a date has no zone; with ``refuse`` one of the times is refused: the
            error states how many are, the first of them, and why
        """
        limits = InterpolationLimits(most_deg, most_m, most_mps)
        stopped = self.events["kind"].isin(_NO_FILTER)
        no_filter_s = self.events.loc[stopped, "time_s"].to_numpy(np.float64)
        rows = rows_at(self.nav, times_s, limits, no_filter_s=no_filter_s, refuse=refuse)
        rows.attrs = dict(self.nav.attrs)  # the GPS week and the units
        return rows

    def status_counts(self) -> pd.DataFrame:
        """Return how many measurements of each kind had each status; the sums are the input's."""
        status, kind = self.measurements["status"].cat, self.measurements["kind"].cat
        shape = (len(status.categories), len(kind.categories))
        table = np.zeros(shape, np.int64)
        for piece in pieces(self.measurements):
            codes = piece["status"].cat.codes.to_numpy(np.int16)  # of so many kinds the cells are beyond 127
            cell = codes * np.int16(shape[1]) + piece["kind"].cat.codes.to_numpy()
            table += np.bincount(cell, minlength=table.size).reshape(shape)
        counts = pd.DataFrame(
            table,
            index=pd.CategoricalIndex(status.categories, name="status"),
            columns=pd.CategoricalIndex(kind.categories, name="kind"),
        )
        counts = counts.iloc[np.flatnonzero(table.any(axis=1)), np.flatnonzero(table.any(axis=0))]
        return counts.loc[counts.sum(axis=1).sort_values(ascending=False).index]

    def nis_summary(self, from_s: float | None = None) -> pd.DataFrame:
        """Return, per kind, how many were used, the mean NIS (1 is right) and the share below the 95 % bound (0.95).

        The summary begins at ``from_s``; if None, when the heading became known, if it did.
        """
        begin_s = self._settled_s(from_s)
        chi_square_95 = 3.841458820694124  # one degree of freedom
        kinds = self.measurements["kind"].cat.categories
        sums = np.zeros((len(kinds), 3))  # of one, NIS, and whether it is below the bound
        for piece in pieces(self.measurements):
            used = ((piece["status"] == "used") & (piece["time_s"] >= begin_s)).to_numpy()
            kind, nis = piece["kind"].cat.codes.to_numpy()[used], piece["nis"].to_numpy()[used]
            for column, values in enumerate((np.ones(len(nis)), nis, nis <= chi_square_95)):
                sums[:, column] += np.bincount(kind, values, minlength=len(kinds))
        names = ["used", "mean_nis", "share_95"]
        rows = {
            name: (int(n), nis / n, below / n) for name, (n, nis, below) in zip(kinds, sums, strict=True) if n
        }
        return pd.DataFrame.from_dict(rows, orient="index", columns=names).rename_axis("kind")

    def heading_known_s(self) -> float | None:
        """Return the time from which the heading has been known, None when it never was."""
        known = self.events[self.events["kind"] == "heading_known"]
        times = known["time_s"].dropna()
        return None if times.empty else float(times.iloc[0])

    def _settled_s(self, from_s: float | None) -> float:
        """Return the time from which a summary is made: the requested one, else the heading known, else the start."""
        known_s = self.heading_known_s() if from_s is None else from_s
        return -np.inf if known_s is None else known_s

    def error_summary(
        self, quality: float | None = None, from_s: float | None = None, to_s: float = np.inf
    ) -> pd.DataFrame:
        """Return, per component, mean, rms, 50 %, 95 % and largest error, the mean sigma and the rms of error / sigma.

        ``rms_over_noise`` is the last with the sigma without slow errors, sqrt(sd^2 - sd_slow^2).

        Parameters
        ----------
        quality : keeps only the reference rows of at most that quality number
        from_s : keeps only the rows from that time on [s of the week]; if None, from the time at which the heading
            became known, if that is within the reference. ``-math.inf`` keeps all.
        to_s : keeps only the rows up to that time
        """
        if self.errors is None:
            raise ResultError("the run has no reference", advice="name a [reference] in the flight file")
        table = self.errors
        if quality is not None:
            table = table[table["quality"] <= quality]
        settled = table[table["time_s"] >= self._settled_s(from_s)]
        table = table if settled.empty and from_s is None else settled
        table = table[table["time_s"] <= to_s]
        rows = {}
        for name in [c for c in table.columns if c.startswith("d_")]:
            values = table[name].dropna()
            if values.empty:
                continue
            size, sigma = values.abs(), table.loc[values.index, f"sd_{name[2:]}"]
            rows[name[2:]] = {
                "mean": values.mean(),
                "rms": float(np.sqrt((values**2).mean())),
                "p50": size.quantile(0.5),
                "p95": size.quantile(0.95),
                "max": size.max(),
                "mean_sigma": sigma.mean(),
                "rms_over_sigma": float(np.sqrt(((values / sigma) ** 2).mean())),
                "rms_over_noise": float(np.sqrt((values**2 / noise_variance(table, name[2:])).mean())),
            }
        return pd.DataFrame.from_dict(rows, orient="index")


def _save_table(
    folder: Path, name: str, table: pd.DataFrame | None, format: Literal["parquet", "csv"]
) -> None:
    columns = () if table is None else table.dtypes.items()
    # a dictionary of numbers that hardly repeat costs a third of the time and makes the file larger
    repeated = [name for name, dtype in columns if name == "time_s" or not is_float_dtype(dtype)]
    write_table(folder, name, table, format, use_dictionary=repeated, write_page_checksum=True)
