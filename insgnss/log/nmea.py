"""A receiver's own solution from NMEA 0183: positions of GGA, dates and velocities of RMC, sigmas of GST.

NMEA holds no measurements. Its fixes are a reference, quality 2 (no truth), or take the place of measurements.
Sentences in a row with the same time of day are an epoch. Its date is that of its RMC or ZDA, else it follows from the
last epoch that had one. RMC states speed and direction over ground; NMEA has no vertical velocity. Times are UTC.

Early versions of the standard leave the checksum to the talker. A sentence of an address that never has one is read
if its line is whole, with an event; where others of its address have one, a sentence without it was cut.
"""

from __future__ import annotations

import datetime as dt
import functools
import math
import operator
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from insgnss.constants import NS_PER_DAY, NS_PER_S
from insgnss.errors import InputError, TimeError
from insgnss.geodesy.sea_level import geoid_height
from insgnss.gpstime import utc_to_ns
from insgnss.log.events import counted, in_file, listed, listing
from insgnss.log.files import file_buffer
from insgnss.log.own_solution import distinct_rows, not_independent, on_earth, own_reference, stated_sigmas
from insgnss.log.receiver import ReceiverLog, no_measurements
from insgnss.tables import Event, Int64
from insgnss.units import SI_PER_UNIT

_SENTENCE: Final = re.compile(rb"\$([^$*\r\n]{5,200})(?:\*([0-9A-Fa-f]{2})|(?=[\r\n]))")
_BEGUN: Final = re.compile(rb"\$[A-OQ-Z][A-Z](?:GGA|RMC|GST|ZDA),")
_OTHER_ADDRESS: Final = re.compile(rb"(?:[A-Z]{2}[A-Z]{3}|P[A-Z0-9]{3,9}),")
_CLOCK: Final = re.compile(r"([0-9]{2})([0-9]{2})([0-9]{2})(?:\.([0-9]{0,9}))?")
_ADDRESS: Final = 5  # letters: two of the talker, three of the sentence
# qualities of GGA that satellites gave: others are dead reckoning, typed in, a simulator's, or nothing
_FIXES: Final = frozenset("123459")
_NO_FIXES: Final = {"6": "dead reckoning", "7": "typed in", "8": "simulated"}
_SLOW_MPS: Final = 0.1  # a receiver that states no direction below it stands
_MOST_MPS: Final = 1e4  # faster than an orbit


@dataclass
class _NmeaEpoch:
    """The sentences of one time of day; missing numbers are NaN."""

    time_ns: int  # of the UTC day
    date: dt.date | None = None
    place: tuple[float, float, float] | None = None  # deg, deg, m above the sea
    geoid_m: float = math.nan  # above the ellipsoid
    sigma: tuple[float, float, float] = (math.nan,) * 3
    velocity: tuple[float, float] = (math.nan,) * 2  # north, east


@dataclass
class _Sentences:
    """What the files hold: epochs in their order, and what was not read."""

    epochs: list[_NmeaEpoch] = field(default_factory=list)
    others: Counter[str] = field(default_factory=Counter)
    damaged: int = 0
    unchecked: int = 0  # read without a checksum
    without_fix: int = 0
    no_fixes: Counter[str] = field(default_factory=Counter)  # by the quality that GGA states, of those above


def read_nmea(paths: Sequence[Path], date: dt.date | None = None) -> ReceiverLog:
    """Read NMEA files (plain or gzipped) of one receiver, one after the other.

    Heights are above the ellipsoid: the sum of the two that GGA states, or with EGM96 where it states one.

    Parameters
    ----------
    date : UTC, of the first epoch, where no sentence states one

    Raises
    ------
    InputError : a file cannot be read, or holds no two fixes
    TimeError : no sentence states a date, and none is given
    """
    sentences = _Sentences()
    for path in paths:
        _add_file(file_buffer(path).to_pybytes(), sentences)
    fixes = [epoch for epoch in sentences.epochs if epoch.place is not None]
    if len(fixes) < 2:
        others = listing(
            {f"GGA state a position that is {what}": n for what, n in sentences.no_fixes.items()}
        )
        advice = "log GGA and RMC, and GST for the sigmas; NMEA holds no raw measurements"
        if others:
            advice = "if these are GNSS positions, such as the output of a program, write quality 1 into GGA"
        raise InputError(
            f"the NMEA file holds fewer than two GNSS fixes{': ' if others else ''}{others}",
            file=paths[0],
            advice=advice,
        )
    t_ns = _gps_times(sentences.epochs, date, paths[0])[
        [epoch.place is not None for epoch in sentences.epochs]
    ]
    place = np.array([epoch.place for epoch in fixes])
    geoid_m = np.array([epoch.geoid_m for epoch in fixes])
    unstated = np.isnan(geoid_m)
    if unstated.any():
        geoid_m[unstated] = geoid_height(place[unstated, 0], place[unstated, 1])
    place[:, 2] += geoid_m
    sigma = np.full((len(fixes), 9), np.nan)
    sigma[:, :3] = stated_sigmas(np.array([epoch.sigma for epoch in fixes]))
    v_n = np.array([(*epoch.velocity, math.nan) for epoch in fixes])
    rows = distinct_rows(t_ns, on_earth(place))
    table = own_reference(t_ns[rows], place[rows], sigma[rows], velocity=v_n[rows])
    events = _events(sentences, int(unstated.sum()), ", ".join(map(str, paths)))
    return ReceiverLog(no_measurements(), events=events, solution=table)


def nmea_bytes(data: bytes) -> int:
    """Return how many bytes lie behind the $ of sentences with a valid checksum, or of whole ones without any."""
    return sum(
        len(body)
        for sound, body in _sentences(data)
        if sound or (sound is None and _is_whole(*_kind_and_cells(body)))
    )


def _sentences(data: bytes) -> Iterator[tuple[bool | None, bytes]]:
    """Yield of each sentence whether its checksum holds, None where it has none, and the text that it is of."""
    for match in _SENTENCE.finditer(data):
        stated = match[2]
        sound = None if stated is None else functools.reduce(operator.xor, match[1]) == int(stated, 16)
        yield sound, match[1]


def _kind_and_cells(body: bytes) -> tuple[str, list[str]]:
    """Return the kind of a sentence, without its talker, and its cells."""
    address, *cells = body.decode("latin-1").split(",")
    return address[2:] if len(address) == _ADDRESS and address[0] != "P" else address, cells


def _is_whole(kind: str, cells: list[str]) -> bool:
    """Return whether a sentence is one of those that are read, and has all cells that it must have."""
    return kind in _READERS and len(cells) >= _LEAST_CELLS[kind]


def _add_file(data: bytes, sentences: _Sentences) -> None:
    """Add the epochs of a file."""
    epoch: _NmeaEpoch | None = None
    whole = 0
    checked = {body.partition(b",")[0] for sound, body in _sentences(data) if sound is not None}
    for sound, body in _sentences(data):
        kind, cells = _kind_and_cells(body)
        whole += kind in _READERS
        if sound is None and kind not in _READERS and not _OTHER_ADDRESS.match(body):
            continue  # a line of something else
        cut = sound is None and kind in _READERS
        cut = cut and (body.partition(b",")[0] in checked or not _is_whole(kind, cells))
        if sound is False or cut:
            sentences.damaged += 1
            continue
        if kind not in _READERS:
            sentences.others[kind] += 1
            continue
        sentences.unchecked += sound is None
        try:
            time_ns = _time_of_day_ns(cells[0])
            if epoch is None or time_ns != epoch.time_ns:
                epoch = _NmeaEpoch(time_ns)
                sentences.epochs.append(epoch)
            _READERS[kind](epoch, cells)
        except _NoFixError as error:
            sentences.without_fix += 1
            sentences.no_fixes.update(error.args)
        except (ValueError, IndexError):
            sentences.damaged += 1
    sentences.damaged += max(len(_BEGUN.findall(data)) - whole, 0)


class _NoFixError(Exception):
    """The sentence says that the receiver has no fix, or has no time."""


def _gga(epoch: _NmeaEpoch, cells: list[str]) -> None:
    if cells[5] not in _FIXES:
        raise _NoFixError(*filter(None, [_NO_FIXES.get(cells[5])]))
    lat, lon = _angle(cells[1], cells[2], "NS", 90.0), _angle(cells[3], cells[4], "EW", 180.0)
    height, geoid = float(cells[8]), float(cells[10]) if cells[10] else math.nan
    if not abs(height) < 1e7 or abs(geoid) > 1e3:
        raise ValueError
    epoch.place, epoch.geoid_m = (lat, lon, height), geoid


def _rmc(epoch: _NmeaEpoch, cells: list[str]) -> None:
    day = cells[8]
    if len(day) == 6:
        year = int(day[4:])
        epoch.date = dt.date(year + (1900 if year >= 80 else 2000), int(day[2:4]), int(day[:2]))
    if cells[1] != "A":
        return
    speed = float(cells[6]) * SI_PER_UNIT["kn"]
    if not 0.0 <= speed < _MOST_MPS:
        raise ValueError
    if cells[7]:
        course = math.radians(float(cells[7]))
        epoch.velocity = speed * math.cos(course), speed * math.sin(course)
    elif speed < _SLOW_MPS:
        epoch.velocity = 0.0, 0.0


def _gst(epoch: _NmeaEpoch, cells: list[str]) -> None:
    north, east, up = (float(cell) if cell else math.nan for cell in cells[5:8])
    epoch.sigma = north, east, up


def _zda(epoch: _NmeaEpoch, cells: list[str]) -> None:
    if cells[3]:
        epoch.date = dt.date(int(cells[3]), int(cells[2]), int(cells[1]))


_READERS: Final = {"GGA": _gga, "RMC": _rmc, "GST": _gst, "ZDA": _zda}
_LEAST_CELLS: Final = {"GGA": 14, "RMC": 11, "GST": 8, "ZDA": 6}  # of any version of the standard


def _time_of_day_ns(text: str) -> int:
    """Return hhmmss.ss since midnight."""
    if not text:
        raise _NoFixError  # the receiver does not know the time yet
    match = _CLOCK.fullmatch(text)
    if match is None:
        raise ValueError
    hours, minutes, seconds = (int(each) for each in match.group(1, 2, 3))
    if hours > 23 or minutes > 59 or seconds > 60:
        raise ValueError
    return (hours * 3600 + minutes * 60 + seconds) * NS_PER_S + int((match[4] or "").ljust(9, "0"))


def _angle(text: str, side: str, sides: str, most: float) -> float:
    """Return degrees of dddmm.mmmm with its side."""
    value = float(text)
    degrees, minutes = divmod(value, 100.0)
    angle = degrees + minutes / 60.0
    if side not in sides or not side or not 0.0 <= angle <= most or minutes >= 60.0:
        raise ValueError
    return -angle if side == sides[1] else angle


def _gps_times(epochs: list[_NmeaEpoch], date: dt.date | None, file: Path) -> Int64:
    """Return the GPS times (n,); a time of day that falls by more than half a day begins the next day."""
    clock_ns = np.array([epoch.time_ns for epoch in epochs], np.int64)
    day = np.concatenate([[0], np.cumsum(np.diff(clock_ns) < -NS_PER_DAY // 2)]).tolist()
    first = next((k for k, epoch in enumerate(epochs) if epoch.date is not None), 0)
    stated = epochs[first].date or date
    if stated is None:
        raise TimeError(
            "no NMEA sentence states the date",
            file=file,
            advice="log RMC or ZDA, or declare the date of the first epoch: insgnss convert --date 2024-05-17",
        )
    begin = stated - dt.timedelta(days=day[first])
    midnights = []
    for epoch, passed in zip(epochs, day, strict=True):
        if epoch.date is not None:
            begin = epoch.date - dt.timedelta(days=passed)
        midnights.append(utc_to_ns(dt.datetime.combine(begin + dt.timedelta(days=passed), dt.time())))
    # leap seconds come in at the end of a day: those of its beginning hold
    return np.array(midnights, np.int64) + clock_ns


def _events(sentences: _Sentences, by_model: int, file: str) -> list[Event]:
    unchecked = (
        "sentences without a checksum read: damage that leaves them whole stays unnoticed; have the receiver or"
        " logger write checksums"
    )
    without = "sentences without a time or a fix of satellites left out"
    damaged = "sentences with a wrong checksum, cut or unreadable left out"
    events = [
        not_independent("GGA and RMC, the receiver's fixes"),
        *counted("nmea_geoid", by_model, "fixes state no height of the geoid: that of EGM96 is taken"),
        *counted("nmea_unchecked", sentences.unchecked, unchecked),
        *counted("nmea_no_fix", sentences.without_fix, without),
        *counted("nmea_damaged", sentences.damaged, damaged),
        *listed("nmea_not_used", "sentences not read", dict(sorted(sentences.others.items()))),
    ]
    return in_file(file, events)
