"""RTCM 3 streams (RTCM 10403.3) become tables: observations, broadcast messages; the frames are read by ``sidereon``.

Read are MSM4 to MSM7 of all constellations, the older 1002, 1004, 1010 and 1012, and the ephemerides 1019, 1020,
1042, 1044, 1045 and 1046. MSM1 to MSM3, 1001, 1003, 1009 and 1011 hold ranges modulo a millisecond or two: they and all
other messages are counted.
"""

from __future__ import annotations

import datetime as dt
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from insgnss.errors import InputError, TimeError
from insgnss.gnss import sidereon_on_demand as sidereon
from insgnss.log.events import counted, first_events, listed, listing
from insgnss.log.files import file_buffer
from insgnss.log.gnss_rows import in_time_order
from insgnss.log.receiver import ReceiverLog
from insgnss.log.rtcm.navigation import EPHEMERIDES, broadcast, stated_channels
from insgnss.log.rtcm.observations import OBSERVATIONS, RtcmObservations, observation_table
from insgnss.log.rtcm.time import EpochTimes, StreamDate, stream_date
from insgnss.tables import Event

PREAMBLE = b"\xd3"
_STATION = ("station_coordinates", "physical_reference_station")


def read_rtcm(paths: Sequence[Path], date: dt.date | None = None) -> ReceiverLog:
    """Read RTCM 3 files (plain or gzipped), parts of one stream in their order.

    A stream states seconds of the week or of the day. The week comes from ``date`` (of the first epoch), else from the
    stream's own ephemerides; an event says when GPS's week alone, sent modulo 1024, was used for it.

    Raises
    ------
    InputError : a file cannot be read, or the stream holds no frame or no observation
    TimeError : the date is unknown
    """
    return read_rtcm_bytes(b"".join(file_buffer(path).to_pybytes() for path in paths), str(paths[0]), date)


def read_rtcm_bytes(data: bytes, file: str, date: dt.date | None = None) -> ReceiverLog:
    """Read an RTCM 3 stream that came from ``file`` (see ``read_rtcm``).

    Raises
    ------
    InputError, TimeError : as ``read_rtcm``
    """
    stream = sidereon.decode_rtcm_stream(data, sidereon.RtcmPolicy.LENIENT)
    messages = list(stream.messages)
    if not messages:
        raise InputError(
            "no RTCM 3 message in the file",
            file=file,
            advice="record the stream as it comes, without an ASCII wrapper",
        )
    observed = [m for m in messages if m.message_number in OBSERVATIONS]
    if not observed:
        others = listing(_not_used(messages)) or "ephemerides alone"
        raise InputError(
            f"the RTCM stream holds no observations with whole pseudoranges: {others}",
            file=file,
            advice="let the source send MSM4 to MSM7 (1074 to 1137) and the ephemerides (1019, 1020, 1042, 1046)",
        )
    known = stream_date(messages, date)
    if known is None:
        raise TimeError(
            "the RTCM stream does not say its date: it holds neither an ephemeris nor system parameters",
            file=file,
            advice="declare the date of its first epoch: insgnss convert --date 2024-05-17",
        )
    log = _tables(messages, known, file)
    known.agree(int(log.gnss.t_ns[0]), file)
    events = [*_damage(stream.diagnostics, len(data), file), *known.events(file), *log.events]
    return replace(log, events=events)


def _tables(messages: list[Any], known: StreamDate, file: str) -> ReceiverLog:
    """Return the stream's tables and events."""
    times, cells, ephemerides = EpochTimes(known.near_ns), RtcmObservations(), []
    for message in messages:
        number = message.message_number
        if number in OBSERVATIONS:
            cells.add(message, times)
        elif number in EPHEMERIDES:
            ephemerides.append((message, times.last_ns))
    navigation_messages = broadcast([(m, cells.first_ns if t is None else t) for m, t in ephemerides])
    gnss, events = observation_table(cells, stated_channels(messages), file)
    if not len(gnss.t_ns):
        raise InputError(
            "the RTCM stream holds no usable observation",
            file=file,
            advice="; ".join(event.detail for event in events),
        )
    gnss, reordered = in_time_order(gnss, file)
    stations = _stations(messages)
    events += reordered
    events += [  # what a base's flight entry needs
        Event(
            None,
            "rtcm_station",
            f"{file}: station {number} is at ECEF {x:.4f} {y:.4f} {z:.4f} m, antenna {h:.4f} m above",
        )
        for number, (x, y, z, h) in stations.items()
    ]
    events += navigation_messages.refused_events(file)
    events += listed("rtcm_not_used", "messages not read", _not_used(messages), file)
    place = next(iter(stations.values()))[:3] if len(stations) == 1 else None
    return ReceiverLog(gnss, navigation_messages.navigation(), None, events, station_m=place)


def _not_used(messages: list[Any]) -> dict[str, int]:
    """Return how many messages there are of each number that is not read."""
    read = {*OBSERVATIONS, *EPHEMERIDES}
    others = Counter(
        m.message_number for m in messages if m.message_number not in read and m.kind not in _STATION
    )
    return {f"of {number}": count for number, count in sorted(others.items())}


def _damage(parsed: Any, size: int, file: str) -> list[Event]:
    """Return the events of the frames' checksums and layouts."""
    refused = (
        f"{file}: byte {skip.offset}: message {skip.message_number} refused: {skip.detail}"
        for skip in parsed.skipped_frames
    )
    events = first_events("rtcm_damaged", refused, file, "messages refused")
    wrong = counted("rtcm_damaged", parsed.crc_failures, "frame(s) with a wrong checksum left out", file)
    what = f"of {size} bytes are not in a whole frame (other data, damage, a cut)"
    return events + wrong + counted("rtcm_foreign_bytes", parsed.resync_bytes, what, file)


def _stations(messages: list[Any]) -> dict[int, tuple[float, float, float, float]]:
    """Return the places that the stream states of its antennas, ECEF and height above the marker, by station."""
    places = {}
    for message in messages:
        if (place := message.station_coordinates) is not None:
            height_m = (place.antenna_height_m() or 0.0) if callable(place.antenna_height_m) else 0.0
            x, y, z = (float(getattr(place, f"ecef_{axis}")) * 1e-4 for axis in "xyz")
            places[place.reference_station_id] = (x, y, z, height_m)
    return places
