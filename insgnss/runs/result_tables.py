"""From the compiled loop's arrays to the tables of a run."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
import pandas as pd

from insgnss.aiding.table import AidingTable
from insgnss.filter.output.total_sigmas import nav_columns
from insgnss.filter.output.writing import Output, Table
from insgnss.filter.own_rows.ledger import OwnEntry
from insgnss.filter.own_rows.rows import OwnMeasurements
from insgnss.filter.setup import FilterSetup
from insgnss.filter.whole_log import LedgerPart
from insgnss.geodesy.directions import angle_columns
from insgnss.gnss.observation_rows import ABSENT, PSEUDORANGE, GnssRows
from insgnss.gpstime import ns_to_week_seconds
from insgnss.results.table_files import words
from insgnss.status import NAMES, USED
from insgnss.tables import Bool, Event, Float64, GnssTable, Int16, Int64

KINDS = ("pseudorange", "range_rate", "carrier_difference")
# words of a column, and the place among them of each number of a status
_LARGEST_CN0_DBHZ: Final = 1000.0  # no receiver gives more
_CODES: Final = sorted(NAMES)
_PLACE: Final = np.searchsorted(_CODES, np.arange(max(_CODES) + 1)).astype(np.int8)
_STATUS: Final = tuple(NAMES[code] for code in _CODES)
_STATES: Final = ("tracked", *_STATUS[1:], "absent")  # in the place of USED, the first


Columns: TypeAlias = dict[str, npt.NDArray[Any]]


class LogNames(NamedTuple):
    """The meaning of the numbers of a log's satellites and signals."""

    sv: tuple[str, ...]
    signal: tuple[str, ...]


class RowKeys(NamedTuple):
    """The keys of a block's rows: everything that the tables need of a log once the filter is done."""

    epoch_ns: Int64  # (m,)
    first: Int64  # (m + 1,) first row of each epoch
    sv: Int16  # (n,)
    signal: Int16  # (n,)
    cn0_dbhz: npt.NDArray[np.float32]  # (n,) NaN where the log has none

    @property
    def epoch(self) -> Int64:
        """Number of each row's epoch in the block (n,)."""
        return np.repeat(np.arange(len(self.epoch_ns)), np.diff(self.first))


def _possible_cn0(cn0_dbhz: Float64) -> npt.NDArray[np.float32]:
    """Return C/N0 as the table has it: empty where no receiver gives such a number."""
    return np.where(np.abs(cn0_dbhz) < _LARGEST_CN0_DBHZ, cn0_dbhz, np.nan).astype(np.float32)


def row_keys(gnss: GnssTable, blocks: list[GnssRows]) -> list[RowKeys]:
    """Return the keys of the blocks that were made of a log."""
    end = np.cumsum([0, *(len(rows.observation) for rows in blocks)])
    return [
        RowKeys(rows.epoch_ns, rows.first, gnss.sv[a:b], gnss.signal[a:b], _possible_cn0(gnss.cn0_dbhz[a:b]))
        for rows, (a, b) in zip(blocks, itertools.pairwise(end), strict=True)
    ]


def nav_table(out: Output, week: int, setup: FilterSetup) -> pd.DataFrame:
    """Return the navigation table, one row per output time."""
    rows = out.nav[: out.counts[0].nav]
    columns: dict[str, Any] = {"time_s": ns_to_week_seconds(rows["t_ns"], week)}
    # as states the slow errors have no share of their own
    columns |= nav_columns(rows, with_shares=not setup.config.process.range_bias_states)
    columns |= setup.layout.in_columns(out.optional[: len(rows)])
    table = pd.DataFrame(columns)
    return table.astype({"n_used": np.int64, "n_hypotheses": np.int64})


def filtered_table(parts: list[Table], week: int) -> pd.DataFrame:
    """Return the filter's solution before smoothing: position, velocity and attitude with their sigmas."""
    rows = np.concatenate(parts)
    columns = nav_columns(rows, with_shares=False)
    shown = {name: values for name, values in columns.items() if not re.search("bias|drift|^n_", name)}
    return pd.DataFrame({"time_s": ns_to_week_seconds(rows["t_ns"], week), **shown})


def ledger_tables(
    ledger: list[LedgerPart], keys: list[RowKeys], names: LogNames, week: int
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the tables of the measurements and of the satellites; ``ledger`` is emptied on the way.

    A big log's ledger takes as much room as a table: each part of it goes once its rows are in them.
    """
    n = sum(len(key.sv) for key in keys)
    measurements, satellites = _GrowingColumns(len(KINDS) * n), _GrowingColumns(n)
    with ThreadPoolExecutor(1) as beside:  # NumPy leaves Python's lock free
        for key in keys:
            part = ledger.pop(0)
            seen = beside.submit(satellite_columns, part, key, len(names.sv), week)
            measurements.append(measurement_columns(part, key, week))
            satellites.append(seen.result())
    words_of = {"sv": names.sv, "signal": names.signal, "kind": KINDS, "status": _STATUS, "state": _STATES}
    return measurements.table(words_of), satellites.table(words_of)


def with_own_rows(
    measurements: pd.DataFrame, entries: list[OwnEntry], own: OwnMeasurements | None, week: int
) -> pd.DataFrame:
    """Return the ledger with a user's own rows in it, in the order of time, before those of an epoch at the same time.

    They have no satellite and no signal: both are empty words.
    """
    if own is None:
        return measurements
    kinds = tuple(kind.name for kind in own.kinds)
    column = {
        name: np.array([getattr(each, name) for each in entries]) for name in ("innovation", "variance")
    }
    status = np.array([each.status for each in entries], np.int64)
    further = pd.DataFrame(
        {
            "time_s": ns_to_week_seconds(np.array([each.t_ns for each in entries], np.int64), week),
            "kind": words(np.array([kinds.index(each.kind) for each in entries], np.int64), kinds),
            "innovation": column["innovation"].astype(np.float64),
            "sd_innovation": np.sqrt(column["variance"].astype(np.float64)),
            "nis": (column["innovation"] ** 2 / column["variance"]).astype(np.float64),
            "status": words(_PLACE[status], _STATUS),
        }
    )
    known = np.isfinite(further["nis"]) & np.isfinite(further["sd_innovation"])
    further.loc[~known, ["innovation", "sd_innovation", "nis"]] = np.nan
    of_words = [name for name, dtype in measurements.dtypes.items() if isinstance(dtype, pd.CategoricalDtype)]
    for name in of_words:
        known = measurements[name].cat.categories
        own_words = further[name].cat.categories if name in further else [""]
        further[name] = pd.Categorical(
            further.get(name, [""] * len(entries)),
            [*known, *(word for word in own_words if word not in known)],
        )
        measurements[name] = measurements[name].cat.set_categories(further[name].cat.categories)
    both = pd.concat([further[list(measurements.columns)], measurements], ignore_index=True)
    return both.sort_values("time_s", kind="stable", ignore_index=True)


class _GrowingColumns:
    """Columns that grow by blocks of rows."""

    def __init__(self, most: int) -> None:
        self.most = most  # room that is never written takes no memory
        self.n = 0
        self.columns: Columns = {}

    def append(self, rows: Columns) -> None:
        """Add the rows of a block; those of the only block are not copied."""
        n = len(rows["time_s"])
        if not self.columns and n == self.most:
            self.columns, self.n = rows, n
            return
        for name, values in rows.items():
            column = self.columns.setdefault(name, np.empty(self.most, values.dtype))
            column[self.n : self.n + n] = values
        self.n += n

    def table(self, words_of: Mapping[str, tuple[str, ...]]) -> pd.DataFrame:
        """Return the rows as a table; ``words_of`` has the words behind a column's numbers."""
        columns = {name: column[: self.n] for name, column in self.columns.items()}
        named = {
            name: words(column, words_of[name]) if name in words_of else column
            for name, column in columns.items()
        }
        return pd.DataFrame(named, copy=False)


def measurement_columns(part: LedgerPart, keys: RowKeys, week: int) -> Columns:
    """Return the ledger: one row for each value in the log, in the log's order, kinds of a row in that of ``KINDS``.

    Words are numbers into the log's names, ``KINDS`` and ``_STATUS``.
    """
    status = _of_all_kinds(part, "status")
    present = status != ABSENT
    values = np.count_nonzero(present, axis=1)  # of each row; repeating is cheaper than looking up
    kind = np.broadcast_to(np.arange(present.shape[1], dtype=np.int8), present.shape)
    innovation = _of_all_kinds(part, "innovation")[present]
    variance = _of_all_kinds(part, "variance")[present].astype(np.float64)
    return {
        "time_s": np.repeat(_row_times(keys, week), values),
        "sv": np.repeat(keys.sv, values),
        "signal": np.repeat(keys.signal, values),
        "kind": kind[present],
        "innovation": innovation,
        "sd_innovation": np.sqrt(variance),
        "nis": innovation**2 / variance,
        "status": _PLACE[status[present]],
    }


def _of_all_kinds(part: LedgerPart, name: str) -> npt.NDArray[Any]:
    """Return a column of the ledger, one entry for each kind (n, k); three where the log's carrier is used."""
    pairs: npt.NDArray[Any] = part.entries[name]
    return pairs if len(part.carriers) == 0 else np.column_stack([pairs, part.carriers[name]])


def _row_times(keys: RowKeys, week: int) -> Float64:
    return np.repeat(ns_to_week_seconds(keys.epoch_ns, week), np.diff(keys.first))


def satellite_columns(part: LedgerPart, keys: RowKeys, n_sv: int, week: int) -> Columns:
    """Return one row per satellite and epoch: its direction, and the sigmas of the predicted range and range rate.

    Of several signals of a satellite the one that was used stands, else the first. ``sd_range_m`` and
    ``sd_range_rate_mps`` are sqrt(h P h^T) before the update. Words are numbers into the log's names and ``_STATES``.
    """
    ledger = part.entries
    seen = np.isfinite(ledger["u_n"][:, 0])
    tracked = (ledger["status"][:, 0] == USED) | (ledger["status"][:, 1] == USED)
    chosen = _one_per_satellite(keys.epoch, keys.sv, seen, tracked, n_sv)
    # every row, as a rule: then nothing is copied
    rows_of_table = slice(None) if len(chosen) == len(ledger) else chosen
    status = ledger["status"][rows_of_table, PSEUDORANGE]
    state = _PLACE[np.maximum(status, 0)]
    state[status == ABSENT] = len(_STATES) - 1
    state[tracked[rows_of_table]] = 0
    return {
        "time_s": _row_times(keys, week)[rows_of_table],
        "sv": keys.sv[rows_of_table],
        **angle_columns(ledger["u_n"][rows_of_table]),
        **angle_columns(ledger["u_b"][rows_of_table], "body_"),
        "gain_dbi": ledger["gain"][rows_of_table].astype(np.float64),
        "cn0_dbhz": keys.cn0_dbhz[rows_of_table],
        "state": state,
        "sd_range_m": np.sqrt(ledger["predicted"][rows_of_table, 0], dtype=np.float64),
        "sd_range_rate_mps": np.sqrt(ledger["predicted"][rows_of_table, 1], dtype=np.float64),
    }


def _one_per_satellite(
    epoch: Int64,
    sv: Int16,
    seen: Bool,
    tracked: Bool,
    n_sv: int,
) -> Int64:
    """Return one row of each satellite and epoch among ``seen``: a tracked one before the others, else the first."""
    index = np.flatnonzero(seen)
    key = epoch[index] * max(n_sv, 1) + sv[index]
    # stable, so that rows in nearly the right order are sorted fast
    order = np.argsort(2 * key + ~tracked[index], kind="stable")
    first = np.ones(len(order), np.bool_)
    first[1:] = np.diff(key[order]) != 0
    return np.sort(index[order[first]])


def aiding_table(table: AidingTable, week: int) -> pd.DataFrame:
    """Return the aiding, one row per output time and satellite above the horizon; ``aiding.table`` has the columns."""
    columns: dict[str, Any] = dict(table.columns(week))
    columns["sv"] = words(columns["sv"], table.sv_names)
    return pd.DataFrame(columns, copy=False)


def aiding_budget(table: AidingTable, week: int) -> pd.DataFrame:
    """Return the parts of the aiding's sigmas, one row per satellite whenever they are recomputed."""
    columns: dict[str, Any] = dict(table.budget(week))
    columns["sv"] = words(columns["sv"], table.sv_names)
    return pd.DataFrame(columns)


def event_table(events: list[Event], week: int) -> pd.DataFrame:
    """Return the events in the order of their time; those of whole files (no time) first."""
    ordered = sorted(events, key=lambda e: -1 if e.t_ns is None else e.t_ns)
    times = [np.nan if e.t_ns is None else float(ns_to_week_seconds(e.t_ns, week)) for e in ordered]
    return pd.DataFrame(
        {
            "time_s": np.array(times, np.float64),
            "kind": pd.Series([e.kind for e in ordered], dtype="str"),
            "detail": pd.Series([_as_text(e.detail) for e in ordered], dtype="str"),
        }
    )


def _as_text(detail: str) -> str:
    """Return words that may name a file, of which a name need not be UTF-8, as a text that a table can hold."""
    return detail.encode("utf-8", "backslashreplace").decode("utf-8")


def status_words(codes: npt.NDArray[Any], names: Mapping[int, str] = NAMES) -> pd.Categorical:
    """Return a column of the words that ``insgnss.status`` has for its codes."""
    known = sorted(names)
    return words(np.searchsorted(known, codes), [names[code] for code in known])


def interpolated(t_ns: Int64, at_ns: Int64, values: Float64) -> Float64:
    """Return the columns of ``values`` (n, k) at the times ``at_ns`` by linear interpolation."""
    t, at = (t_ns - t_ns[0]) * 1e-9, (at_ns - t_ns[0]) * 1e-9
    return np.column_stack([np.interp(at, t, values[:, i]) for i in range(values.shape[1])])
