"""RINEX observation files, read through the compiled reader ``sidereon``.

What it returns becomes the package's own table, times as integer nanoseconds of GPS time.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from insgnss.constants import NS_PER_S
from insgnss.errors import InputError
from insgnss.gnss import sidereon_on_demand as sidereon
from insgnss.gnss.table_joining import joined
from insgnss.gpstime import BDT_MINUS_GPST_S, datetime_to_ns, leap_seconds
from insgnss.log.events import counted, first_events
from insgnss.log.gnss_rows import in_time_order
from insgnss.log.rinex.damage import (
    DamagedCell,
    ParsedStretch,
    ParsedText,
    observations_without_tabs,
    parse_around_damage,
)
from insgnss.log.rinex.header import (
    mended_header,
    phone_codes,
    slot_channels,
    with_first_label,
    without_skipped_lines,
)
from insgnss.log.rinex.rows import UNREADABLE, ObservationValues, observation_rows
from insgnss.log.rinex.states import IMPOSSIBLE_DATE, NO_DATE, is_date
from insgnss.log.rinex.text import FIRST_LABEL, JoinedFile, rinex_files, sound_start, split_epochs
from insgnss.tables import Event, Float64, GnssTable

# 1: after a power failure, the values are good; 2 to 6 carry no measurements
OBSERVATION_FLAGS: Final = (0, 1)


def read_rinex_obs(paths: Sequence[Path], offset_s: float = 0.0) -> tuple[GnssTable, list[Event]]:
    """Read RINEX observation files (2.11, 3, 4; plain, gzipped or Hatanaka-compressed), merged and in time order.

    One row for each satellite, epoch and pseudorange code that has a pseudorange or a Doppler, with the carrier phase
    and the loss-of-lock indicator of the same signal. The optional receiver clock offset of an epoch is not applied:
    tag, pseudorange and phase of an epoch agree with each other either way, and the filter estimates the clock. Cycle
    slip records (epoch flag 6) mark slips that the writer has repaired in the phases, so they mark no row. An epoch
    that appears twice in the file is kept twice; the choice between them is made, and reported, with the measurements.

    Parameters
    ----------
    paths : the files
    offset_s : added to each time tag [s]

    Raises
    ------
    InputError : a file is not a RINEX observation file, or has no readable epoch
    """
    parts = []
    events: list[Event] = []
    for path in paths:
        tables, more_events = _read_path(path, offset_s)
        parts += tables
        events += more_events
    table, reordered = in_time_order(joined(parts), str(paths[0]))
    return table, events + reordered


def _read_path(path: Path, offset_s: float) -> tuple[list[GnssTable], list[Event]]:
    """Return the tables of a file, several where files were joined to one; an unreadable one of these is an event."""
    files, events = rinex_files(path)
    tables: list[GnssTable] = []
    for file in files:
        try:
            table, more_events = _read_observation_file(file, offset_s)
        except InputError as error:
            if file is files[-1] and not tables:
                raise
            events.append(Event(None, "rinex_part_not_read", error.message))
            continue
        tables.append(table)
        events += more_events
    return tables, events


def _read_observation_file(file: JoinedFile, offset_s: float) -> tuple[GnssTable, list[Event]]:
    path = file.name
    text, events = _observation_text(file)
    channels: dict[str, int] = {}
    for mended in (
        observations_without_tabs,
        with_first_label,
        lambda text, path: slot_channels(text, path, channels),
        phone_codes,
        without_skipped_lines,
    ):
        text, more_events = mended(text, path)
        events += more_events
    try:
        parsed = ParsedText([ParsedStretch(sidereon.parse_rinex_obs(text))])
    except sidereon.SidereonError as error:
        text, more_events = mended_header(text, path)
        events += more_events
        blocks = split_epochs(text)
        if not blocks.epochs:
            raise InputError(f"not a RINEX observation file: {error}", file=path) from error
        parsed = parse_around_damage(blocks)
    events += _damage_events(parsed, path)
    values = ObservationValues()
    for product, damaged_cells in parsed.stretches:
        events += _collect(product, damaged_cells, values, round(offset_s * NS_PER_S), path)
    if len(parsed.stretches) == 1 and not parsed.refused:
        events += _lost_lines(text, values, path)
    table = observation_rows(values, channels)
    if not len(table.t_ns):
        why = f": {parsed.refused[0][1]}" if parsed.refused else ""
        raise InputError(f"the RINEX file holds no observation that can be read{why}", file=path)
    what = "carrier phase(s) without pseudorange and Doppler left out"
    return table, events + counted("rinex_phase_alone", values.phases_alone, what, path)


def _lost_lines(text: str, values: ObservationValues, path: str) -> list[Event]:
    """Return an event of lines that the reader passes over without a word (RINEX 3 and 4: a line a satellite)."""
    if values.version < 3.0:
        return []
    written = text.count("\n", text.find("END OF HEADER"), len(text.rstrip("\n \x1a")))
    outside = "line(s) belong to no epoch: the line of an epoch states too few satellites; left out"
    repeated = "line(s) name a satellite a second time in their epoch; left out"
    return [
        *counted("rinex_lines_not_read", max(written - values.lines, 0), outside, path),
        *counted("rinex_lines_not_read", max(values.repeated, 0), repeated, path),
    ]


def _damage_events(parsed: ParsedText, path: str) -> list[Event]:
    """Return an event for each refused epoch and each lost value up to a number, then one with the total."""
    epochs = (f"{path}:{line}: {why}; epoch refused" for line, why in parsed.refused)
    values = (
        f"{path}:{cell.line}: {cell.sv}: observation {cell.place + 1}, '{cell.text}', is not a number; value refused"
        for _, damaged in parsed.stretches
        for cell in damaged
    )
    refused = first_events("rinex_epoch_damaged", epochs, path, "epochs refused")
    return refused + first_events("rinex_value_damaged", values, path, "values refused")


def _observation_text(file: JoinedFile) -> tuple[str, list[Event]]:
    """Return the file's text, Hatanaka compression undone as far as it goes."""
    text, path = file.text, file.name
    events: list[Event] = []
    if "CRINEX VERS" in text[:200]:
        text, events = _unpacked(text, path)
    if FIRST_LABEL not in text[:400]:
        raise InputError(
            "not a RINEX file: the first line lacks 'RINEX VERSION / TYPE'",
            file=path,
            advice="for CSV set gnss.format = 'csv'",
        )
    return text, events


def _unpacked(text: str, path: str) -> tuple[str, list[Event]]:
    """Return the text without the Hatanaka compression: all of it, or the part before the first damage."""
    try:
        return sidereon.decode_crinex(text), []
    except sidereon.SidereonError as error:
        before = sound_start(text)
        if before is None:
            message = f"the Hatanaka compression cannot be undone: {error}"
            raise InputError(message, file=path, advice="pack the file again, or give it unpacked") from error
        unpacked, line = before
        detail = (
            f"{path}:{line}: {error}; Hatanaka lines depend on those before, the rest of the file is refused"
        )
        return unpacked, [Event(None, "rinex_hatanaka_damaged", detail)]


def _collect(
    product: Any, damaged_cells: Sequence[DamagedCell], values: ObservationValues, offset_ns: int, path: str
) -> list[Event]:
    """Append the product's observations to ``values``; epochs that report an event are passed over with one of ours."""
    values.version = product.header.version
    shift_ns = offset_ns + _scale_shift_ns(product)
    # an epoch's values have a place for every code of its satellites' systems, those of later headers included
    layouts: dict[tuple[str, ...], int] = {}
    events = []
    for index in range(product.epoch_count):
        epoch = product.epoch(index)
        values.lines += 1 + epoch.declared_record_count
        civil_ns = None if epoch.epoch is None else _civil_ns(epoch.epoch, epoch.epoch_picoseconds)
        t_ns = None if civil_ns is None else civil_ns + shift_ns
        if t_ns is not None and (civil_ns == NO_DATE or not is_date(t_ns)):
            detail = (
                f"{path}: epoch of {epoch.epoch.year:04d}-{epoch.epoch.month:02d} skipped: {IMPOSSIBLE_DATE}"
            )
            events.append(Event(None, "rinex_event", detail))
            continue
        if epoch.flag not in OBSERVATION_FLAGS or t_ns is None:
            detail = (
                f"{path}: epoch with flag {epoch.flag} and {epoch.declared_record_count} record(s) skipped"
            )
            events.append(Event(t_ns, "rinex_event", detail))
            continue
        if epoch.flag == 1:
            events.append(Event(t_ns, "rinex_event", f"{path}: power failure before this epoch"))
        series = product.observation_values(index)
        satellites = tuple(epoch.satellites)
        values.repeated += epoch.declared_record_count - len(satellites)
        if satellites not in layouts:
            layouts[satellites] = values.new_layout(series.satellites, series.codes)
        values.append(t_ns, layouts[satellites], _marked(series, damaged_cells), series.lli)
    what = "observation record(s) could not be read"
    return events + counted("rinex_record_skipped", product.skipped_records, what, path)


def _marked(series: Any, damaged_cells: Sequence[DamagedCell]) -> Float64:
    """Return an epoch's values, with a mark where a cell was damaged; one of a line too many has no place there."""
    values: Float64 = series.values
    for cell in damaged_cells:
        places = [k for k, sv in enumerate(series.satellites) if sv == cell.sv]
        values[places[cell.place : cell.place + 1]] = UNREADABLE
    return values


def _civil_ns(civil: Any, picoseconds: int | None = None) -> int:
    """Return a civil date of any time scale as nanoseconds since 1980-01-06 of that scale; -1 for no date."""
    try:
        minute = dt.datetime(civil.year, civil.month, civil.day, civil.hour, civil.minute)
    except ValueError:  # the year 0
        return NO_DATE
    fraction = float(civil.second) * NS_PER_S + (picoseconds or 0) / 1000.0
    return datetime_to_ns(minute) + round(fraction)


def _scale_shift_ns(product: Any) -> int:
    """Return the correction of the file's time tags to GPS time [ns]."""
    first = product.header.time_of_first_obs
    if first is None:
        return 0
    civil, scale = first
    if scale == sidereon.TimeScale.BDT:
        return -BDT_MINUS_GPST_S * NS_PER_S
    if scale in (sidereon.TimeScale.UTC, sidereon.TimeScale.GLONASST):
        try:
            return leap_seconds(dt.datetime(civil.year, civil.month, civil.day)) * NS_PER_S
        except ValueError:
            return 0
    return 0
