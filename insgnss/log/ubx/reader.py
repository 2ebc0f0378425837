"""u-blox receivers' own files (UBX): raw measurements, broadcast messages, inertial samples and time marks.

Read are RXM-RAWX, RXM-SFRBX (RXM-RAW and RXM-SFRB of older receivers), ESF-RAW or ESF-MEAS, TIM-TM2 and NAV-PVAT or
NAV-PVT with NAV-HPPOSLLH (else NAV-SOL), the receiver's own solution. In files without raw measurements it or
NAV-TIMEGPS gives the time. Everything else is counted.
Read by ``insgnss.log.ubx.frames`` rather than by ``pyubx2``: see there.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.errors import InputError
from insgnss.gpstime import LATEST_WEEK, leap_seconds
from insgnss.log.events import counted
from insgnss.log.files import file_buffer
from insgnss.log.receiver import ReceiverLog
from insgnss.log.ubx.frames import UbxFrames, frames_in
from insgnss.log.ubx.imu import MEAS, RAW, imu_table
from insgnss.log.ubx.messages import SFRBX, UbxMessages
from insgnss.log.ubx.observations import (
    RAW_LEGACY,
    RAWX,
    SFRB,
    RawEpochs,
    legacy_epochs,
    observation_table,
    raw_epochs,
)
from insgnss.log.ubx.solution import (
    DATE_AND_TIME_VALID,
    HPPOSLLH,
    PVAT,
    PVT,
    SOL,
    SolvedEpochs,
    solution,
    solved_epochs,
)
from insgnss.tables import Event, ImuTable, Int64

TIMEGPS: Final = 0x0120
TM2: Final = 0x0D03
KNOWN: Final = {RAWX, RAW_LEGACY, SFRBX, SFRB, MEAS, RAW, PVAT, PVT, SOL, HPPOSLLH, TIMEGPS, TM2}
_TM2_LAYOUT: Final = np.dtype(
    [("channel", "u1"), ("flags", "u1"), ("count", "<u2"), ("week_rise", "<u2"), ("week_fall", "<u2")]
    + [(name, "<u4") for name in ("rise_ms", "rise_ns", "fall_ms", "fall_ns", "accuracy_ns")]
)
_TIME_VALID, _NEW_RISE, _NEW_FALL, _UTC_BASE = 64, 128, 4, 16  # bits of the time mark's flags
_TIMEGPS_LAYOUT: Final = np.dtype(
    [("tow_ms", "<u4"), ("tow_ns", "<i4"), ("week", "<i2"), ("leap_s", "i1"), ("valid", "u1"), ("", "<u4")]
)


def read_ubx(paths: Sequence[Path]) -> ReceiverLog:
    """Read UBX files (plain or gzipped) of one receiver, merged and in time order.

    A file may hold inertial samples or the receiver's own solution alone; the table of measurements is empty then.

    Raises
    ------
    InputError : a file cannot be read or holds no UBX frame, or there is neither measurement nor sample nor solution
    """
    return read_ubx_bytes([(path, file_buffer(path).to_pybytes()) for path in paths])


def read_ubx_bytes(streams: Sequence[tuple[Path, bytes]]) -> ReceiverLog:
    """Read the UBX that another format's files hold, each as the receiver sent it (see ``read_ubx``).

    Raises
    ------
    InputError : as ``read_ubx``
    """
    files = [frames_in(path, data) for path, data in streams]
    paths = [frames.path for frames in files]
    epochs: list[RawEpochs] = []
    imu: list[ImuTable] = []
    events: list[Event] = []
    messages = UbxMessages()
    solved: list[SolvedEpochs] = []
    for frames in files:
        if not frames.count:
            raise InputError(
                "the file holds no UBX frame",
                file=frames.path,
                advice="give the receiver's own log; NMEA holds no measurements",
            )
        solved.append(solved_epochs(frames))
        part, raw_events = raw_epochs(frames) if frames.of(RAWX) else legacy_epochs(frames)
        # without measurements the receiver's solutions, else NAV-TIMEGPS, say where in the file which time is
        own = (solved[-1].offsets, solved[-1].t_ns) if len(solved[-1].t_ns) else _gps_times(frames)
        offset, t_ns = (part.offset, part.t_ns) if len(part.t_ns) else own
        messages.add_file(frames, offset, t_ns)
        table, more_events = imu_table(frames, offset, t_ns)
        events += [*frames.events(KNOWN), *raw_events, *more_events, *_time_marks(frames)]
        epochs.append(part)
        imu += [] if table is None else [table]
    gnss, more_events = observation_table(epochs, paths[0])
    joined_imu, joining = _joined_imu(imu, str(paths[0]))
    fixes, source, whose = solution(solved, str(paths[0]))
    if not len(gnss.t_ns) and joined_imu is None and fixes is None:
        why = "; ".join(event.detail for event in events if event.kind == "imu_not_used")
        raise InputError(
            f"the UBX file holds no raw measurement, no inertial sample and no solution{': ' + why if why else ''}",
            file=paths[0],
            advice="configure the receiver to log UBX-RXM-RAWX (and UBX-RXM-SFRBX for the ephemerides);"
            " receivers of the generations 4 to 6: UBX-RXM-RAW (and UBX-RXM-SFRB)",
        )
    leaps = np.concatenate([part.leap_s for part in epochs])
    if (leaps != -128).any():
        messages.broadcast.leap_seconds = int(leaps[leaps != -128][-1])
    events += [*more_events, *messages.events(str(paths[0])), *whose]
    navigation = messages.broadcast.navigation()
    return ReceiverLog(gnss, navigation, joined_imu, events + joining, fixes, solution_from=source)


def _joined_imu(parts: list[ImuTable], file: str) -> tuple[ImuTable | None, list[Event]]:
    """Return the samples of all files, those left out whose time does not advance."""
    if not parts:
        return None, []
    t_ns = np.concatenate([part.t_ns for part in parts])
    order = np.argsort(t_ns, kind="stable")
    rows = order[np.concatenate(([True], np.diff(t_ns[order]) > 0))]
    events = counted("imu_repeated", len(t_ns) - len(rows), "samples with a repeated time left out", file)
    rates, forces = (
        np.concatenate([getattr(part, name) for part in parts])[rows] for name in ("w_ib_b", "f_b")
    )
    return ImuTable(t_ns[rows], rates, forces), events


def _time_marks(frames: UbxFrames) -> list[Event]:
    """Return an event for each edge that the receiver timed (TIM-TM2), UTC turned into GPS time."""
    body = b"".join([frames.data[o : o + n] for o, n in frames.of(TM2) if n == _TM2_LAYOUT.itemsize])
    events = []
    for mark in np.frombuffer(body, _TM2_LAYOUT):
        flags = int(mark["flags"])
        for edge, new in (("rise", _NEW_RISE), ("fall", _NEW_FALL)):
            if not flags & new or not flags & _TIME_VALID or mark[f"week_{edge}"] > LATEST_WEEK:
                continue
            ms, ns = int(mark[f"{edge}_ms"]), int(mark[f"{edge}_ns"])
            t_ns = int(mark[f"week_{edge}"]) * NS_PER_WEEK + ms * 1_000_000 + ns
            if flags & _UTC_BASE:
                t_ns += (
                    leap_seconds(dt.datetime(1980, 1, 6) + dt.timedelta(microseconds=t_ns // 1000)) * NS_PER_S
                )
            detail = f"{frames.path}: {edge} on input {mark['channel']}, to {mark['accuracy_ns']} ns"
            events.append(Event(t_ns, "time_mark", detail))
    return events


def _gps_times(frames: UbxFrames) -> tuple[Int64, Int64]:
    """Return the positions of NAV-TIMEGPS in a file and the GPS times it states."""
    records = [
        (o, np.frombuffer(frames.data, _TIMEGPS_LAYOUT, 1, o)[0])
        for o, n in frames.of(TIMEGPS)
        if n >= _TIMEGPS_LAYOUT.itemsize
    ]
    valid = [
        (o, r)
        for o, r in records
        if r["valid"] & DATE_AND_TIME_VALID == DATE_AND_TIME_VALID and 0 < r["week"] <= LATEST_WEEK
    ]
    times = [int(r["week"]) * NS_PER_WEEK + int(r["tow_ms"]) * 1_000_000 + int(r["tow_ns"]) for _, r in valid]
    return np.array([o for o, _ in valid], np.int64), np.array(times, np.int64)
