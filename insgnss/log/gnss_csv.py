"""GNSS logs: CSV files with one row per satellite, signal and epoch become a ``GnssTable``.

Both forms are read: with satellite states in the row, or with a navigation file.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from insgnss.config.flight import Gnss, GnssColumns
from insgnss.config.log_table import TimeScale
from insgnss.constants import C_MPS
from insgnss.errors import ColumnError, UnitsError
from insgnss.gnss.signals import codes_in_band, is_rinex_code
from insgnss.gnss.table_joining import joined
from insgnss.log.csv.columns import NOTHING_SHARED, ColumnSelection, FileColumns, TextColumn, missing_column
from insgnss.log.csv.satellite_column import read_satellites, toml_key
from insgnss.log.csv.table import CsvTable
from insgnss.log.csv.time_tags import continued_times, read_timed_table
from insgnss.log.detect import naming_format
from insgnss.log.events import counted
from insgnss.log.gnss_rows import in_time_order
from insgnss.log.rinex.observations import read_rinex_obs
from insgnss.tables import Event, Float64, GnssTable, Int8, Int16

# What a log without a signal column is taken to hold: the first civil signal of each system in the L1 band
ASSUMED_SIGNAL: Final = {"G": "C1C", "R": "C1C", "E": "C1C", "C": "C2I", "J": "C1C", "I": "C5A", "S": "C1C"}
OTHER_UNITS_M: Final = {"kilometres": 1e3, "seconds": C_MPS, "milliseconds": 1e-3 * C_MPS}
NEAREST_M: Final = 1.5e7  # between the nearest GNSS satellite seen from 2000 km height ...
# ... and the farthest in geosynchronous orbit, with a clock off by tens of milliseconds
FARTHEST_M: Final = 6e7
_WRITE_CODES: Final = "write RINEX codes such as C1C (GPS L1 C/A, Galileo E1), C2I (BeiDou B1I), C5Q (L5)"
_CODE: Final = re.compile(r"[CLDS]?(\d[A-Z])")


def read_gnss(config: Gnss, week: int, shared: FileColumns = NOTHING_SHARED) -> tuple[GnssTable, list[Event]]:
    """Read a GNSS log of one or several files, CSV or RINEX observation.

    Parameters
    ----------
    config : the flight file's entry, paths resolved
    week : GPS week that the seconds of the week count from
    shared : columns that all logs of the flight read, by file

    Raises
    ------
    InputError or a subclass : a file or column is missing, or too many rows cannot be read
    """
    if config.format == "rinex":
        return _read_rinex(config)
    parts: list[GnssTable] = []
    events: list[Event] = []
    for path in config.files:
        previous = int(parts[-1].t_ns[-1]) if parts and len(parts[-1].t_ns) else None
        part, more_events = _read_file(config, path, week, previous, shared.get(path, ()))
        parts.append(part)
        events += more_events
    parts, unused = _states_of_one_source(parts, config)
    events += unused
    table, reordered = in_time_order(joined(parts), str(config.files[0]))
    return table, events + reordered


def _read_rinex(config: Gnss) -> tuple[GnssTable, list[Event]]:
    table, events = read_rinex_obs(config.files, config.time.offset_s)
    if config.time != TimeScale(offset_s=config.time.offset_s):
        detail = "RINEX states its own time scale: of gnss.time only offset_s is used"
        events.append(Event(None, "time_settings_not_used", detail))
    return table, events


def _read_file(
    config: Gnss, path: Path, week: int, previous_ns: int | None, elsewhere: Sequence[str]
) -> tuple[GnssTable, list[Event]]:
    names = config.columns
    with naming_format(path, of_gnss=True):
        t_ns, table = read_timed_table(path, config, _wanted(names, elsewhere), week)
    t_ns, continued = continued_times(t_ns, previous_ns, config, str(path))
    sv, sv_names, bad_names = read_satellites(table, config, path)
    signal, signal_names, assumed = _signals(table.text.get(names.signal), sv, sv_names, config, path)
    if names.pseudorange not in table.columns:
        raise missing_column(names.pseudorange, table.dialect, path)
    pseudorange_m = table.columns[names.pseudorange]
    _check_pseudoranges(pseudorange_m, names.pseudorange, path)
    events = _table_events(table, names) + continued + bad_names + assumed
    events += _sigma_events(table, (names.sigma_pseudorange, names.sigma_range_rate), path)
    events += _unknown_signals(table, config, sv, sv_names, path)
    states, unused = _satellite_states(table, config, path)
    events += unused
    # rows whose range, Doppler or range rate holds something that is neither empty nor a number
    measured = (names.pseudorange, names.doppler, names.range_rate, names.carrier)
    bad_rows = [table.bad_cells[name] for name in measured if name in table.bad_cells]
    whole = GnssTable(
        *(t_ns, sv, signal, pseudorange_m),
        doppler_hz=table.column_or_nan(names.doppler),
        range_rate_mps=table.column_or_nan(names.range_rate),
        cn0_dbhz=table.column_or_nan(names.cn0),
        sv_names=sv_names,
        signal_names=signal_names,
        sat=states,
        sigma_pseudorange_m=table.columns.get(names.sigma_pseudorange),
        sigma_range_rate_mps=table.columns.get(names.sigma_range_rate),
        bad_cells=np.unique(np.concatenate([np.zeros(0, np.int64), *bad_rows])),
        carrier_cycles=table.columns.get(names.carrier),
        lli=_flags(table.columns.get(names.lli)),
    )
    if names.doppler not in table.columns and names.range_rate not in table.columns:
        detail = f"{path}: neither '{names.doppler}' nor '{names.range_rate}': pseudoranges only"
        events.append(Event(None, "no_range_rate", detail))
    return (whole if (sv >= 0).all() else whole.take(np.flatnonzero(sv >= 0))), events


def _wanted(names: GnssColumns, elsewhere: Sequence[str]) -> ColumnSelection:
    return ColumnSelection(
        optional=(
            *(names.pseudorange, names.doppler, names.range_rate, names.carrier, names.lli, names.cn0),
            *(names.sigma_pseudorange, names.sigma_range_rate, *_state_columns(names)),
        ),
        text=(names.sv,),
        optional_text=(names.signal, names.system),
        chosen=names.chosen_names(),
        elsewhere=elsewhere,
    )


def _table_events(table: CsvTable, names: GnssColumns) -> list[Event]:
    """Return the table's events; that of the columns not read also names the missing keys of C/N0 and carrier."""
    keys = [f"gnss.columns.{key}" for key in ("cn0", "carrier") if getattr(names, key) not in table.columns]
    if not keys:
        return table.events
    more = f"; no column is read as {' or '.join(keys)}: name it there if it is one of these"
    return [
        replace(event, detail=event.detail + more) if event.kind == "columns_not_read" else event
        for event in table.events
    ]


def _state_columns(names: GnssColumns) -> tuple[str, ...]:
    return (*names.sat_position, *names.sat_velocity, names.sat_clock, names.sat_clock_drift)


def _check_pseudoranges(pseudorange_m: Float64, name: str, path: Path) -> None:
    """Raise when the column holds no number at all, or numbers that are distances to satellites in another unit."""
    present = pseudorange_m[np.isfinite(pseudorange_m)]
    if not len(present):
        raise ColumnError(
            "holds no numbers", file=path, column=name, advice="check that it is the column of pseudoranges"
        )
    middle = float(np.median(present))
    for unit, metres in OTHER_UNITS_M.items():
        if NEAREST_M < middle * metres < FARTHEST_M:
            raise UnitsError(
                f"pseudoranges near {middle:.4g} are not metres",
                file=path,
                column=name,
                advice=f"they look like {unit}",
            )


def _sigma_events(table: CsvTable, names: Iterable[str], path: Path) -> list[Event]:
    """Return an event for each column of sigmas of which some are not above zero."""
    events: list[Event] = []
    for name in names:
        sigma = table.columns.get(name, np.zeros(0))
        stated = int(np.isfinite(sigma).sum())
        wrong = int((sigma <= 0.0).sum())
        if wrong and wrong == stated:
            raise ColumnError(
                "holds no sigma above zero",
                file=path,
                column=name,
                advice="leave the column out: the filter then uses its own sigmas",
            )
        what = f"of {stated} sigmas are not above zero: not used ('bad_sigma')"
        events += counted("gnss_bad_sigma", wrong, what, f"{path}: column '{name}'")
    return events


def _satellite_states(table: CsvTable, config: Gnss, path: Path) -> tuple[Float64 | None, list[Event]]:
    """Return (n, 8) satellite states of the log, None when it has none or a part only."""
    columns = _state_columns(config.columns)
    missing = [name for name in columns if name not in table.columns]
    if not missing:
        return np.column_stack([table.columns[name] for name in columns]), []
    if len(missing) == len(columns):
        return None, []
    if not (config.navigation or config.precise):
        raise ColumnError(
            "the log has some columns of the satellite states, but not this one",
            file=path,
            line=table.dialect.header_line,
            column=missing[0],
            advice="give all eight (position, velocity, clock, clock drift) or a navigation file",
        )
    detail = (
        f"{path}: satellite states without '{missing[0]}' are not used: the navigation files replace them"
    )
    return None, [Event(None, "satellite_states_not_used", detail)]


def _states_of_one_source(parts: list[GnssTable], config: Gnss) -> tuple[list[GnssTable], list[Event]]:
    """Take the satellites of all files from the same source: from the navigation files where one log lacks states."""
    without = [path for path, part in zip(config.files, parts, strict=True) if part.sat is None]
    if not without or len(without) == len(parts):
        return parts, []
    others = f"the satellite states of the other {len(parts) - len(without)} file(s)"
    if not (config.navigation or config.precise):
        detail = (
            f"{without[0]}: no satellite states, as {others} have, and no navigation file: no row is used"
        )
        return parts, [Event(None, "satellite_states_missing", detail)]
    detail = (
        f"{without[0]}: no satellite states; {others} are not used: the navigation files replace all of them"
    )
    return [replace(part, sat=None) for part in parts], [Event(None, "satellite_states_not_used", detail)]


def _flags(column: Float64 | None) -> Int8 | None:
    """Return loss-of-lock indicators as small integers; an empty cell, or one that is none, says nothing is wrong."""
    if column is None:
        return None
    known = np.isfinite(column) & (column >= 0.0) & (column < 8.0)
    return np.where(known, np.nan_to_num(column), 0.0).astype(np.int8)


def _signals(
    column: TextColumn | None, sv: Int16, sv_names: tuple[str, ...], config: Gnss, path: Path
) -> tuple[Int16, tuple[str, ...], list[Event]]:
    """Return each row's index into the signals' RINEX codes; a row without one gets its system's first civil signal."""
    assumed = [ASSUMED_SIGNAL[name[0]] for name in sv_names]
    written = [] if column is None else [_code(word, config.signal_codes) for word in column.words]
    names = tuple(dict.fromkeys([code for code in written if code] + assumed))
    of_satellite = np.array([names.index(code) for code in assumed] + [0], dtype=np.int16)
    if column is None:
        detail = f"{path}: no column of signals: {_summary(assumed, sv_names)} assumed"
        return of_satellite[sv], names, [Event(None, "signal_assumed", detail)]
    table = np.array([names.index(code) if code else -1 for code in written], dtype=np.int16)
    signal = table[column.codes]
    empty = signal < 0
    if not empty.any():
        return signal, names, []
    signal[empty] = of_satellite[sv[empty]]
    what = f"row(s) without a signal: {_summary(assumed, sv_names)} assumed"
    return signal, names, counted("signal_assumed", empty, what, path)


def _unknown_signals(
    table: CsvTable, config: Gnss, sv: Int16, sv_names: tuple[str, ...], path: Path
) -> list[Event]:
    """Return an event of each signal that RINEX does not name so; its rows stand in the ledger as unknown."""
    column = config.columns.signal
    text = table.text.get(column)
    if text is None:
        return []
    rows = np.flatnonzero(sv >= 0)
    pairs, first, count = np.unique(
        sv[rows].astype(np.int64) * len(text.words) + text.codes[rows], return_index=True, return_counts=True
    )
    unknown: dict[
        tuple[str, str], tuple[int, int]
    ] = {}  # by word as written and system: rows, the first of them
    for pair, row, n in zip(pairs.tolist(), rows[first].tolist(), count.tolist(), strict=True):
        satellite, word = divmod(pair, len(text.words))
        written = text.words[word]
        system = sv_names[satellite][0]
        if written and not is_rinex_code(system, _code(written, config.signal_codes)):
            before, earliest = unknown.get((written, system), (0, row))
            unknown[written, system] = before + n, min(earliest, row)
    if not unknown:
        return []
    if sum(n for n, _ in unknown.values()) == len(rows):
        (word, system), (_, row) = min(unknown.items(), key=lambda item: item[1][1])
        line = int(table.line[row])
        advice = _signal_advice(word, system)
        raise ColumnError(f"unknown signal '{word}'", file=path, line=line, column=column, advice=advice)
    return [
        Event(
            None,
            "unknown_signal",
            f"{path}: unknown signal '{word}' in {n} row(s) of system {system}, not used:"
            f" {_signal_advice(word, system)}",
        )
        for (word, system), (n, _) in unknown.items()
    ]


def _signal_advice(word: str, system: str) -> str:
    key = f"gnss.signal_codes = {{ {toml_key(word)} = '...' }}"
    in_band = " or ".join(codes_in_band(system, word))
    codes = f"system {system} has {in_band} in this band" if in_band else _WRITE_CODES
    return f"{codes}; correct the rows, or give this name's code in the flight file: {key}"


def _code(word: str, declared: Mapping[str, str]) -> str:
    """Return a signal as RINEX names its pseudorange ("1C", "L1C" -> "C1C"), anything else unchanged in capitals."""
    if word in declared:
        return declared[word]
    match = _CODE.fullmatch(word.upper())
    return f"C{match[1]}" if match else word.upper()


def _summary(assumed: list[str], sv_names: tuple[str, ...]) -> str:
    pairs = dict.fromkeys(f"{name[0]} {code}" for name, code in zip(sv_names, assumed, strict=True))
    return ", ".join(pairs)
