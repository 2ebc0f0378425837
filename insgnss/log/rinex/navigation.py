"""RINEX navigation files, read through the compiled reader ``sidereon``.

What it returns becomes the package's own tables, times as integer nanoseconds of GPS time. Nothing is filtered: the
message of an unhealthy satellite is data that the selection of ephemerides judges.

Ionosphere coefficients are in header lines of RINEX 3 and in messages of RINEX 4. Of several sets of one system the
first counts. A set of zeros is one that was never filled in, and counts as none.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.errors import NavigationDataError
from insgnss.gnss import sidereon_on_demand as sidereon
from insgnss.gnss.signals import UNKNOWN_CHANNEL
from insgnss.gpstime import BDT_MINUS_GPST_S, BDT_WEEK_OFFSET
from insgnss.log.events import counted, first_events, listed
from insgnss.log.messages.broadcast import ELEMENTS, Ephemeris, StateVector, ephemeris_table
from insgnss.log.rinex.states import (
    IMPOSSIBLE_DATE,
    NUMBER_WIDTH,
    is_date,
    read_state_vectors,
    state_vector_table,
)
from insgnss.log.rinex.text import FIRST_LABEL, JoinedFile, numbers_in, rinex_files, version_of, without_tabs
from insgnss.tables import EphemerisTable, Event, Float64, NavigationData

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
_NO_SATELLITE: Final = re.compile(r"^(> (?:STO|EOP|ION) [A-Z])  (?= )", re.MULTILINE)
_READ_ELSEWHERE: Final = ("glonass", "sbas", "ionosphere")


class _MessageForm(NamedTuple):
    """The columns of a message's lines, RINEX 2.11 table A4, 3.05 table A6, 4.01 chapter 8."""

    clock: re.Pattern[str]  # what stands before the numbers of a line with a time
    name_width: int  # columns of a satellite's name, blank in the lines after the first
    indent: int  # columns before the numbers of the other lines

    def is_in_columns(self, line: str) -> bool:
        """Return whether the numbers of a line fill their columns of 19 characters."""
        if line.startswith(">"):
            return _RECORD.match(line) is not None
        timed = self.clock.match(line)
        first = timed.end() if timed else self.indent
        numbers = [line[k : k + NUMBER_WIDTH] for k in range(first, len(line.rstrip()), NUMBER_WIDTH)]
        blank = timed is not None or not line[:first].strip()
        return blank and all(not cell.strip() or _NUMBER.fullmatch(cell) for cell in numbers)


_NUMBER: Final = re.compile(rf"(?=.{{{NUMBER_WIDTH}}}$) *[-+]?\d*\.?\d*(?:[DEde][-+]?\d+)?")
_RECORD: Final = re.compile(r"> [A-Z]{3} [A-Z][ \d]{2} ")  # RINEX 4
_FORM_2: Final = _MessageForm(re.compile(r"[ \d]\d(?: [ \d]\d){5}[ \d]{2}\d\.\d"), 2, 3)
_FORM_3: Final = _MessageForm(re.compile(r"(?:[A-Z][ \d]\d| {3}) \d{4}(?: [ \d]\d){5}"), 3, 4)


@dataclass
class _NavigationContents:
    """The content of the files so far."""

    keplerian: list[Any] = field(default_factory=list)
    states: list[StateVector] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    klobuchar: Float64 | None = None
    leap_seconds: int | None = None
    ionosphere: dict[str, Float64] = field(default_factory=dict)
    inter_signal_s: dict[str, Float64] = field(default_factory=dict)


def read_navigation(
    paths: Sequence[Path], *, coefficients_suffice: bool = False
) -> tuple[NavigationData, list[Event]]:
    """Read RINEX navigation files and merge them: repeated messages once, sorted by satellite and reference time.

    The week of the reference time follows from the calendar date of the clock's epoch, so a week field of ten bits or
    counted from another start does no harm. Ionosphere coefficients and leap seconds are those of the first file
    that has them, inter-signal corrections those of a satellite's last CNAV message.

    Parameters
    ----------
    coefficients_suffice : ionosphere coefficients without an ephemeris are of use, as the log says where its satellites
        were

    Raises
    ------
    NavigationDataError : a file is not a RINEX navigation file, or there is no ephemeris in any
    """
    contents = _NavigationContents()
    files = []
    for path in paths:
        parts, joining = rinex_files(path)
        files += parts
        contents.events += joining
    for file in files:
        text, tabs = _navigation_text(file)
        contents.events += tabs
        _read_records(text, file.name, contents)
        ionosphere = read_ionosphere(text)
        of_gps = ionosphere.pop("gps", None)
        if contents.klobuchar is None:
            contents.klobuchar = _klobuchar(text, of_gps)
        contents.leap_seconds = (
            _leap_seconds(text) if contents.leap_seconds is None else contents.leap_seconds
        )
        contents.ionosphere = ionosphere | contents.ionosphere
    suffices = coefficients_suffice and (contents.klobuchar is not None or bool(contents.ionosphere))
    if not (contents.keplerian or contents.states or suffices):
        names = ", ".join(str(path) for path in paths)
        raise NavigationDataError(
            "no usable ephemeris",
            file=names,
            advice="give the broadcast navigation file of the flight's day",
        )
    table, repeated = _ephemerides(contents.keplerian)
    states, repeated_states = state_vector_table(contents.states)
    contents.events += counted(
        "navigation_repeated", repeated + repeated_states, "repeated message(s) left out"
    )
    navigation = NavigationData(
        ephemerides=table,
        klobuchar=contents.klobuchar,
        leap_seconds=contents.leap_seconds,
        state_vectors=states,
        ionosphere=contents.ionosphere,
        inter_signal_s=contents.inter_signal_s,
    )
    return navigation, contents.events


def _navigation_text(file: JoinedFile) -> tuple[str, list[Event]]:
    """Return a file's text as ``sidereon`` reads it, and an event of its tabs."""
    is_old = version_of(file.text) < 3.0
    form = _FORM_2 if is_old else _FORM_3
    text, events = without_tabs(file.text, file.name, form.is_in_columns, form.name_width, "messages")
    head = text[:400]
    if FIRST_LABEL not in head or head[20:21] not in "NGELJCRIHS":
        raise NavigationDataError(
            "not a RINEX navigation file",
            file=file.name,
            advice="the first line must say so: 'N: GNSS NAV DATA'",
        )
    version = text[:9].strip()
    if version.isascii() and version.isdigit():
        # the archives' merged files state "2" where the format asks for F9.2, and sidereon insists on the format
        text = f"{int(version):9.2f}{text[9:]}"
    # what holds for a whole system may leave out the satellite that sent it, and sidereon insists on one
    return _NO_SATELLITE.sub(r"\g<1>01", text), events


def _read_records(text: str, path: str, contents: _NavigationContents) -> None:
    """Add the messages of a file, and an event for damaged ones or those of another kind."""
    try:
        parsed = sidereon.parse_rinex_nav_lenient(text)
    except sidereon.SidereonError as error:
        raise NavigationDataError(f"the navigation file cannot be read: {error}", file=path) from error
    states = read_state_vectors(
        text,
        glonass=[b.line for b in parsed.other if b.kind == "glonass"]
        + [b.line for b in parsed.skipped if b.satellite[:1] == "R"],
        sbas=[b.line for b in parsed.other if b.kind == "sbas"],
    )
    contents.states += states.found
    told_twice = {line for line, _, _ in states.refused} | states.mended
    damaged = [(b.line, b.satellite, b.message) for b in parsed.skipped if b.line not in told_twice]
    damaged += states.refused
    kinds: Counter[str] = Counter()
    for record in parsed.records:
        label = record.message.label
        if label in MESSAGES and not all(map(is_date, _reference_times_ns(record))):
            damaged.append((1, record.satellite, IMPOSSIBLE_DATE))
        elif label in MESSAGES:
            contents.keplerian.append(record)
        elif record.is_cnav_family:
            kinds[f"{label} (orbit)"] += 1
            names = (f"cnav_isc_{name}_s" for name in ("l1ca", "l2c", "l5i5", "l5q5", "l1cd", "l1cp"))
            corrections = [_or_nan(getattr(record.group_delays, name)) for name in names]
            contents.inter_signal_s[record.satellite] = np.array(corrections)
        else:
            kinds[label] += 1
    details = (
        f"{path}:{line}: {f'{sv}: ' if sv else ''}{why}; message refused" for line, sv, why in sorted(damaged)
    )
    contents.events += first_events("navigation_damaged", details, path, "messages refused")
    _tell_channels(states.found, path, contents.events)
    kinds += Counter(block.kind for block in parsed.other if block.kind not in _READ_ELSEWHERE)
    unused = dict(sorted(kinds.items()))
    contents.events += listed("navigation_not_used", "messages of a kind not used", unused, path)


def _tell_channels(states: list[StateVector], path: str, events: list[Event]) -> None:
    """Add an event that names the GLONASS satellites whose channel the file does not state."""
    without = sorted(
        {state.sv for state in states if state.sv[0] == "R" and state.channel == UNKNOWN_CHANNEL}
    )
    if without:
        detail = f"{path}: no frequency channel for {', '.join(without)}: taken from the observations, if they have it"
        events.append(Event(None, "glonass_channel_missing", detail))


def _klobuchar(text: str, read_alone: Float64 | None) -> Float64 | None:
    """Return GPS's coefficients, those that were ``read_alone`` where a damaged set of any system stops the reader."""
    try:
        gps = sidereon.parse_rinex_iono_corrections(text).gps
    except sidereon.SidereonError:
        return read_alone
    return None if gps is None else np.concatenate([gps.alpha, gps.beta])


def _leap_seconds(text: str) -> int | None:
    try:
        seconds = sidereon.parse_rinex_leap_seconds(text)
    except sidereon.SidereonError:
        return None
    return None if seconds is None else round(seconds)


def _ephemerides(records: list[Any]) -> tuple[EphemerisTable, int]:
    """Return the distinct messages, sorted by satellite and reference time, and how many were repeated."""
    distinct: dict[tuple[Any, ...], Ephemeris] = {}
    for record in records:
        toc_ns, toe_ns = _reference_times_ns(record)
        message, clock = MESSAGES[record.message.label], record.clock
        key = (record.satellite, toe_ns, toc_ns, message, -1 if record.issue is None else record.issue)
        if key in distinct:
            continue
        elements = (getattr(record.elements, name) for name in ELEMENTS[4:])
        distinct[key] = Ephemeris(
            *(record.satellite, message, toe_ns, toc_ns, _group_delays(record), record.sv_health),
            *(_or_nan(record.sv_accuracy_m), _or_nan(record.issue), _or_nan(record.fit_interval_s)),
            (record.elements.toe_sow, clock.af0, clock.af1, clock.af2, *elements),
        )
    return ephemeris_table(distinct[key] for key in sorted(distinct)), len(records) - len(distinct)


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
    elif system == "I":
        pair = (delays.gps_tgd_s, None)  # as broadcast; the record's own delay is scaled to L5 already
    else:
        pair = (record.group_delay_s, None)
    return pair[0] or 0.0, pair[1] or 0.0


def _or_nan(value: float | None) -> float:
    return float("nan") if value is None else float(value)


# Names of the header lines (RINEX 3.05, table A5): the two of Klobuchar's form, or the one of Galileo
_PAIRS: Final = {"GPSA": "GPSB", "BDSA": "BDSB", "QZSA": "QZSB", "IRNA": "IRNB"}
_SYSTEMS: Final = {"GPSA": "gps", "BDSA": "beidou", "QZSA": "qzss", "IRNA": "navic", "GAL": "galileo"}
# Messages of RINEX 4 with the same coefficients, and how many (RINEX 4.01, tables A33 to A37)
_MESSAGES: Final = {
    ("G", "LNAV"): ("gps", 8),
    ("C", "D1D2"): ("beidou", 8),
    ("J", "LNAV"): ("qzss", 8),
    ("J", "CNVX"): ("qzss", 8),
    ("I", "LNAV"): ("navic", 8),
    ("E", "IFNV"): ("galileo", 3),
}


def read_ionosphere(text: str) -> dict[str, Float64]:
    """Return the coefficients of ``NavigationData.ionosphere``, SI units, and GPS's; a damaged set is left out."""
    by_system: dict[str, Float64] = {}
    for system, values in (*_from_header(text), *_from_messages(text)):
        coefficients = np.array(values, dtype=np.float64)
        if np.isfinite(coefficients).all() and coefficients.any():
            by_system.setdefault(system, coefficients)
    return by_system


def _from_header(text: str) -> Iterator[tuple[str, list[float]]]:
    sets: dict[str, list[float]] = {}
    for line in text.split("END OF HEADER", 1)[0].splitlines():
        if line[60:].startswith("IONOSPHERIC CORR"):
            values = _numbers(line, 5, 12, 4)
            if values is not None:
                sets.setdefault(line[:4].strip(), values)
    for name, values in sets.items():
        if name == "GAL":
            yield "galileo", values[:3]
        elif name in _PAIRS and _PAIRS[name] in sets:
            yield _SYSTEMS[name], values + sets[_PAIRS[name]]


def _from_messages(text: str) -> Iterator[tuple[str, list[float]]]:
    if "> ION" not in text:
        return
    lines = text.splitlines()
    for k, line in enumerate(lines):
        if not line.startswith("> ION"):
            continue
        system, n = _MESSAGES.get((line[6:7], line[10:14].strip()), ("", 0))
        values = _numbers(lines[k + 1], 23, 19, min(n, 3)) if n and k + 1 < len(lines) else None
        for further in lines[k + 2 : k + 4]:
            if values is not None and len(values) < n:
                more = _numbers(further, 4, 19, min(n - len(values), 4))
                values = None if more is None else values + more
        if values is not None and len(values) == n:
            yield system, values


def _numbers(line: str, start: int, width: int, n: int) -> list[float] | None:
    """Return the numbers of ``numbers_in``, None when one cannot be read."""
    try:
        return numbers_in(line, start, width, n)
    except ValueError:
        return None
