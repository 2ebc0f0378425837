"""RINEX observation and navigation files, read through the compiled reader ``sidereon``; the only file that knows it.

What it returns becomes the package's own tables, times as integer nanoseconds of GPS time. Nothing is filtered: the
message of an unhealthy satellite is data that the selection of ephemerides judges.
"""

from __future__ import annotations

import datetime as dt
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import sidereon

from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.errors import InputError, NavigationDataError
from insgnss.gpstime import BDT_MINUS_GPST_S, BDT_WEEK_OFFSET, datetime_to_ns, leap_seconds
from insgnss.log.files import file_text
from insgnss.log.gnss_rows import in_time_order, joined
from insgnss.log.rinex_rows import ObservationValues, observation_rows
from insgnss.log.rinex_text import parse_around_damage, split_epochs
from insgnss.tables import EphemerisTable, Event, Float64, GnssTable, NavigationData

MESSAGES: Final = {
    "gps_lnav": "LNAV",
    "qzss_lnav": "LNAV",
    "navic_lnav": "LNAV",
    "galileo_inav": "INAV",
    "galileo_fnav": "FNAV",
    "galileo_unclassified": "INAV",  # the data source is not stated; most receivers log I/NAV
    "beidou_d1": "D1",
    "beidou_d2": "D2",
}
OBSERVATION_FLAGS: Final = (
    0,
    1,
)  # 1: after a power failure, the values are good; 2 to 6 carry no measurements
_ELEMENTS: Final = (
    *("sqrt_a", "e", "i0", "omega0", "omega", "m0", "delta_n", "omega_dot", "idot"),
    *("cuc", "cus", "crc", "crs", "cic", "cis"),
)


# ---------------------------------------------------------------------------------------------------- observations


def read_rinex_obs(paths: Sequence[Path], offset_s: float = 0.0) -> tuple[GnssTable, list[Event]]:
    """Read RINEX observation files (2.11, 3, 4; plain, gzipped or Hatanaka-compressed), merged and in time order.

    One row for each satellite, epoch and pseudorange code that has a pseudorange or a Doppler.

    Parameters
    ----------
    paths : the files
    offset_s : added to each time tag [s]

    Raises
    ------
    InputError : a file is no RINEX observation file, or holds no epoch that can be read
    """
    parts = []
    events: list[Event] = []
    for path in paths:
        part, found = _read_observation_file(path, offset_s)
        parts.append(part)
        events += found
    table, reordered = in_time_order(joined(parts), str(paths[0]))
    return table, events + reordered


def _read_observation_file(path: Path, offset_s: float) -> tuple[GnssTable, list[Event]]:
    text = _observation_text(path)
    try:
        parsed = [sidereon.parse_rinex_obs(text)]
        damaged: list[tuple[int, str]] = []
    except sidereon.SidereonError as error:
        blocks = split_epochs(text)
        if not blocks.epochs:
            raise InputError(f"no RINEX observation file: {error}", file=path) from error
        parsed, damaged = parse_around_damage(blocks, sidereon.parse_rinex_obs, sidereon.SidereonError)
    events = [
        Event(None, "rinex_epoch_damaged", f"{path}:{line}: {why}; epoch refused")
        for line, why in damaged[:20]
    ]
    if len(damaged) > 20:
        events.append(Event(None, "rinex_epoch_damaged", f"{path}: {len(damaged)} damaged epochs in all"))
    values = ObservationValues()
    for product in parsed:
        events += _collect(product, values, round(offset_s * NS_PER_S), path)
    table = observation_rows(values)
    if not len(table.t_ns):
        why = f": {damaged[0][1]}" if damaged else ""
        raise InputError(f"the RINEX file holds no observation that can be read{why}", file=path)
    return table, events


def _observation_text(path: Path) -> str:
    """Return the file's text, Hatanaka compression undone."""
    text = file_text(path)
    try:
        if "CRINEX VERS" in text[:200]:
            text = sidereon.decode_crinex(text)
    except sidereon.SidereonError as error:
        raise InputError(f"the Hatanaka compression cannot be undone: {error}", file=path) from error
    if "RINEX VERSION / TYPE" not in text[:400]:
        raise InputError(
            "this is no RINEX file: the first line lacks 'RINEX VERSION / TYPE'",
            file=path,
            advice="for CSV set gnss.format = 'csv'",
        )
    return text


def _collect(product: Any, values: ObservationValues, offset_ns: int, path: Path) -> list[Event]:
    """Append the product's observations to ``values``; epochs that report an event are passed over with one of ours."""
    values.version = product.header.version
    shift_ns = offset_ns + _scale_shift_ns(product)
    events = []
    for index in range(product.epoch_count):
        epoch = product.epoch(index)
        t_ns = None if epoch.epoch is None else _civil_ns(epoch.epoch, epoch.epoch_picoseconds) + shift_ns
        if epoch.flag not in OBSERVATION_FLAGS or t_ns is None:
            detail = f"{path}: epoch with flag {epoch.flag} and {epoch.declared_record_count} record(s) passed over"
            events.append(Event(t_ns, "rinex_event", detail))
            continue
        if epoch.flag == 1:
            events.append(Event(t_ns, "rinex_event", f"{path}: power failure before this epoch"))
        series = product.observation_values(index)
        values.append(t_ns, series.satellites, series.codes, series.values)
    if product.skipped_records:
        detail = f"{path}: {product.skipped_records} observation record(s) could not be read"
        events.append(Event(None, "rinex_record_skipped", detail))
    return events


def _civil_ns(civil: Any, picoseconds: int | None = None) -> int:
    """Return a civil date of any time scale as nanoseconds since 1980-01-06 of that scale."""
    minute = dt.datetime(civil.year, civil.month, civil.day, civil.hour, civil.minute)
    fraction = float(civil.second) * NS_PER_S + (picoseconds or 0) / 1000.0
    return datetime_to_ns(minute) + round(fraction)


def _scale_shift_ns(product: Any) -> int:
    """Return what is added to the file's time tags to make them GPS time [ns]."""
    first = product.header.time_of_first_obs
    if first is None:
        return 0
    civil, scale = first
    if scale == sidereon.TimeScale.BDT:
        return -BDT_MINUS_GPST_S * NS_PER_S
    if scale in (sidereon.TimeScale.UTC, sidereon.TimeScale.GLONASST):
        return leap_seconds(dt.datetime(civil.year, civil.month, civil.day)) * NS_PER_S
    return 0


# ------------------------------------------------------------------------------------------------------ navigation


def read_navigation(paths: Sequence[Path]) -> tuple[NavigationData, list[Event]]:
    """Read RINEX navigation files and merge them: repeated messages once, sorted by satellite and reference time.

    The week of the reference time follows from the calendar date of the clock's epoch, so a week field of ten bits or
    counted from another start does no harm. The Klobuchar coefficients and leap seconds are those of the first file
    that has them.

    Raises
    ------
    NavigationDataError : a file is no RINEX navigation file, or there is no ephemeris in any
    """
    records: list[Any] = []
    events: list[Event] = []
    klobuchar: Float64 | None = None
    leap: int | None = None
    for path in paths:
        text = _navigation_text(path)
        found, told = _read_records(text, path)
        records += found
        events += told
        klobuchar = _klobuchar(text) if klobuchar is None else klobuchar
        leap = _leap_seconds(text) if leap is None else leap
    if not records:
        names = ", ".join(str(path) for path in paths)
        raise NavigationDataError(
            "no ephemeris that can be used",
            file=names,
            advice="give the broadcast navigation file of the flight's day",
        )
    table, repeated = _ephemerides(records)
    if repeated:
        events.append(Event(None, "navigation_repeated", f"{repeated} repeated message(s) left out"))
    return NavigationData(table, klobuchar, leap), events


def _navigation_text(path: Path) -> str:
    text = file_text(path)
    head = text[:400]
    if "RINEX VERSION / TYPE" not in head or head[20:21] not in "NGELJCRIHS":
        raise NavigationDataError(
            "this is no RINEX navigation file",
            file=path,
            advice="the first line must say so: 'N: GNSS NAV DATA'",
        )
    return text


def _read_records(text: str, path: Path) -> tuple[list[Any], list[Event]]:
    """Return the Keplerian records of a file, and an event for what is damaged or of another kind."""
    try:
        parsed = sidereon.parse_rinex_nav_lenient(text)
    except sidereon.SidereonError as error:
        raise NavigationDataError(f"the navigation file cannot be read: {error}", file=path) from error
    events = []
    for block in parsed.skipped[:20]:
        detail = f"{path}:{block.line}: {block.satellite}: {block.message}; message refused"
        events.append(Event(None, "navigation_damaged", detail))
    if parsed.skipped_count > 20:
        events.append(
            Event(None, "navigation_damaged", f"{path}: {parsed.skipped_count} damaged messages in all")
        )
    used = [record for record in parsed.records if record.message.label in MESSAGES]
    kinds = Counter(record.message.label for record in parsed.records if record.message.label not in MESSAGES)
    kinds += Counter(block.kind for block in parsed.other)
    if kinds:
        listed = ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items()))
        events.append(Event(None, "navigation_not_used", f"{path}: messages of a kind not used: {listed}"))
    return used, events


def _klobuchar(text: str) -> Float64 | None:
    try:
        gps = sidereon.parse_rinex_iono_corrections(text).gps
    except sidereon.SidereonError:
        return None
    return None if gps is None else np.concatenate([gps.alpha, gps.beta])


def _leap_seconds(text: str) -> int | None:
    try:
        seconds = sidereon.parse_rinex_leap_seconds(text)
    except sidereon.SidereonError:
        return None
    return None if seconds is None else round(seconds)


def _ephemerides(records: list[Any]) -> tuple[EphemerisTable, int]:
    """Return the distinct messages, sorted by satellite and reference time, and how many were repeated."""
    distinct: dict[tuple[Any, ...], Any] = {}
    for record in records:
        toc_ns, toe_ns = _reference_times_ns(record)
        key = (record.satellite, toe_ns, toc_ns, MESSAGES[record.message.label], record.issue)
        distinct.setdefault(key, record)
    keys = sorted(
        distinct, key=lambda key: (key[0], key[1], key[2], key[3], -1 if key[4] is None else key[4])
    )
    rows = [distinct[key] for key in keys]
    elements = {
        name: np.array([getattr(row.elements, name) for row in rows], dtype=np.float64) for name in _ELEMENTS
    }
    table = EphemerisTable(
        sv_names=tuple(key[0] for key in keys),
        message=tuple(key[3] for key in keys),
        toe_ns=np.array([key[1] for key in keys], dtype=np.int64),
        toc_ns=np.array([key[2] for key in keys], dtype=np.int64),
        toe_sow_s=np.array([row.elements.toe_sow for row in rows], dtype=np.float64),
        af0=np.array([row.clock.af0 for row in rows], dtype=np.float64),
        af1=np.array([row.clock.af1 for row in rows], dtype=np.float64),
        af2=np.array([row.clock.af2 for row in rows], dtype=np.float64),
        group_delay_s=np.array([_group_delays(row) for row in rows], dtype=np.float64),
        health=np.array([row.sv_health for row in rows], dtype=np.float64),
        accuracy_m=np.array([_or_nan(row.sv_accuracy_m) for row in rows], dtype=np.float64),
        issue=np.array([_or_nan(row.issue) for row in rows], dtype=np.float64),
        fit_interval_s=np.array([_or_nan(row.fit_interval_s) for row in rows], dtype=np.float64),
        **elements,
    )
    return table, len(records) - len(rows)


def _reference_times_ns(record: Any) -> tuple[int, int]:
    """Return toc and toe in GPS time [ns]; toe is the one nearest to toc, whatever the week field says."""
    toc_ns = round(record.toc_tow_s * NS_PER_S) + record.toc_week * NS_PER_WEEK
    if record.time_scale == sidereon.TimeScale.BDT:
        toc_ns += BDT_WEEK_OFFSET * NS_PER_WEEK
    after_toc = round((record.elements.toe_sow - record.toc_tow_s) * NS_PER_S)
    half = NS_PER_WEEK // 2
    toe_ns = toc_ns + (after_toc + half) % NS_PER_WEEK - half
    to_gps = -BDT_MINUS_GPST_S * NS_PER_S if record.time_scale == sidereon.TimeScale.BDT else 0
    return toc_ns + to_gps, toe_ns + to_gps


def _group_delays(record: Any) -> tuple[float, float]:
    """Return the two delays [s] of ``EphemerisTable.group_delay_s``; one that was not broadcast is zero."""
    delays = record.group_delays
    system = record.satellite[0]
    if system == "E":
        pair = (delays.galileo_bgd_e5a_e1_s, delays.galileo_bgd_e5b_e1_s)
    elif system == "C":
        pair = (delays.beidou_tgd1_s, delays.beidou_tgd2_s)
    else:
        pair = (record.group_delay_s, None)
    return pair[0] or 0.0, pair[1] or 0.0


def _or_nan(value: float | None) -> float:
    return float("nan") if value is None else float(value)
