"""RAWIMU and its variants (RAWIMUS, RAWIMUX, RAWIMUSX): counts of a NovAtel system's inertial sensor become rates.

Each message holds the increments of angle and velocity since the one before, Z, -Y, X, in counts of the sensor, in its
own axes; a rate is the increment times the sensor's output rate. What a count is depends on the sensor's type (OEM7
commands and logs reference manual, "Raw IMU Scale Factors"): the extended messages and INSCONFIG state it. CORRIMUDATA
and IMURATECORRIMUS are not inertial samples: gravity and the Earth's rate are already removed.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from insgnss.constants import NS_PER_S, NS_PER_WEEK, S_PER_WEEK
from insgnss.gpstime import LATEST_WEEK
from insgnss.log.events import counted
from insgnss.log.files import records
from insgnss.log.novatel.frames import NovatelFrames
from insgnss.tables import Event, Float64, ImuTable
from insgnss.units import RAD_PER_DEG

PLAIN: Final = (268, 325)  # RAWIMU, RAWIMUS
EXTENDED: Final = (1461, 1462)  # RAWIMUX, RAWIMUSX
INSCONFIG: Final = 1945
_COUNTS: Final = (("status", "<u4"), ("accel_zyx", "<i4", (3,)), ("gyro_zyx", "<i4", (3,)))
_PLAIN: Final = np.dtype([("week", "<u4"), ("sow", "<f8"), *_COUNTS])
_EXTENDED: Final = np.dtype([("info", "u1"), ("type", "u1"), ("week", "<u2"), ("sow", "<f8"), *_COUNTS])
_ERROR: Final = 1  # bit of the extended messages' information
_TO_XYZ: Final = np.array([1.0, -1.0, 1.0])  # the Y axis is sent with its sign turned
_FOOT_M: Final = 0.3048
_MILLI_G: Final = 9.80665e-3
_RAD_PER_ARCSEC: Final = RAD_PER_DEG / 3600.0
_KVH: Final = (0.1 / (3600.0 * 256.0), 0.05 * 2.0**-15)
# Angle [rad] and velocity [m/s] of one count, by the type of the sensor
SCALES: Final[dict[int, tuple[float, float]]] = {
    **dict.fromkeys(
        (1, 5, 11, 20, 27, 28), (2.0**-33, _FOOT_M * 2.0**-27)
    ),  # HG1700 AG11, AG58; HG1900, HG1930
    **dict.fromkeys((4, 12), (2.0**-33, _FOOT_M * 2.0**-26)),  # HG1700 AG17, AG62
    8: (2.0**-19, 2.0**-14),  # LN-200
    13: (0.1 * 2.0**-8 * _RAD_PER_ARCSEC, 0.05 * 2.0**-15),  # iIMU-FSAS
    **dict.fromkeys((16, 33), _KVH),  # KVH COTS, 1750
    **dict.fromkeys((26, 52), (1.0e-9, 2.0e-8)),  # ISA-100C, uIMU
    31: (720.0 * 2.0**-31 * RAD_PER_DEG, 200.0 * 2.0**-31),  # ADIS16488
    **dict.fromkeys((32, 56), (2.0**-21 * RAD_PER_DEG, 2.0**-22)),  # STIM300
    **dict.fromkeys((58, 68, 69), (2.0**-33, 2.0**-29)),  # HG4930
    41: (0.008 * 2.0**-16 / 125.0 * RAD_PER_DEG, 0.2 * 2.0**-16 / 125.0 * _MILLI_G),  # Epson G320
    62: (0.008 * 2.0**-16 / 200.0 * RAD_PER_DEG, 0.2 * 2.0**-16 / 200.0 * _MILLI_G),  # Epson G320 at 200 Hz
    61: (0.0151515 * 2.0**-16 / 200.0 * RAD_PER_DEG, 0.4 * 2.0**-16 / 200.0 * _MILLI_G),  # Epson G370
}
DECLARE: Final = (
    "declare what one count is: --imu-scale RAD,MPS (the sensor's manual, 'Raw IMU Scale Factors')"
)


def imu_table(
    files: list[NovatelFrames], declared: tuple[float, float] | None
) -> tuple[ImuTable | None, list[Event]]:
    """Return the samples of all files, None when there are none or their scales are not known.

    Parameters
    ----------
    declared : (2,) angle [rad] and velocity [m/s] of one count; counts before the type that the log states
    """
    chosen = EXTENDED if any(frames.of(*EXTENDED) for frames in files) else PLAIN
    layout = _EXTENDED if chosen is EXTENDED else _PLAIN
    parts = [
        records(frames.data, [f.offset for f in frames.of(*chosen) if f.length >= layout.itemsize], layout)
        for frames in files
    ]
    rows = np.concatenate(parts)
    file = str(files[0].path)
    if not len(rows):
        return None, []
    rows, events = _sound(rows, file)
    scales, more_events = _scales(files, rows, declared, file)
    if scales is None or len(rows) < 2:
        return None, events + more_events
    tags = rows["week"].astype(np.int64) * NS_PER_WEEK + np.rint(rows["sow"] * NS_PER_S).astype(np.int64)
    t_ns, first = np.unique(tags, return_index=True)
    what = "samples with a repeated time left out"
    events += counted("imu_repeated", len(rows) - len(t_ns), what, file)
    rows = rows[first]
    if len(t_ns) < 2:
        return None, events + more_events
    hz = NS_PER_S / float(np.median(np.diff(t_ns)))  # the sensor's own rate, which gaps must not change
    rates, forces = _xyz(rows["gyro_zyx"]) * (scales[0] * hz), _xyz(rows["accel_zyx"]) * (scales[1] * hz)
    return ImuTable(t_ns, rates, forces), events + more_events


def _xyz(counts: np.ndarray[tuple[int, int], np.dtype[np.int32]]) -> Float64:
    return np.asarray(counts[:, ::-1] * _TO_XYZ)


def _sound(
    rows: np.ndarray[tuple[int], np.dtype[np.void]], file: str
) -> tuple[np.ndarray[tuple[int], np.dtype[np.void]], list[Event]]:
    """Return the samples with a time, in which the sensor reports no error."""
    timed = (rows["week"] > 0) & (rows["week"] <= LATEST_WEEK) & np.isfinite(rows["sow"])
    timed &= (rows["sow"] >= 0.0) & (rows["sow"] <= S_PER_WEEK)
    faulty = (
        timed & (rows["info"] & _ERROR != 0)
        if "info" in (rows.dtype.names or ())
        else np.zeros(len(rows), bool)
    )
    wrong = "inertial sample(s) with an error status of the sensor left out"
    return rows[timed & ~faulty], [
        *counted("imu_time_unknown", ~timed, "inertial sample(s) without a time left out", file),
        *counted("imu_faulty", faulty, wrong, file),
    ]


def _scales(
    files: list[NovatelFrames],
    rows: np.ndarray[tuple[int], np.dtype[np.void]],
    declared: tuple[float, float] | None,
    file: str,
) -> tuple[tuple[float, float] | None, list[Event]]:
    """Return the size of one count, None if neither the log nor the user states it."""
    if declared is not None:
        return declared, []
    is_extended = "type" in (rows.dtype.names or ())
    types = set(np.unique(rows["type"]).tolist()) if is_extended else _configured(files)
    if len(types) == 1 and (kind := next(iter(types))) in SCALES:
        return SCALES[kind], []
    why = f"of type {', '.join(map(str, sorted(types)))}" if types else "of unknown type"
    detail = f"{file}: {len(rows)} inertial samples of a sensor {why} not read: {DECLARE}"
    return None, [Event(None, "imu_not_used", detail)]


def _configured(files: list[NovatelFrames]) -> set[int]:
    """Return the types that INSCONFIG states."""
    return {
        int.from_bytes(frames.data[f.offset : f.offset + 4], "little")
        for frames in files
        for f in frames.of(INSCONFIG)
        if f.length >= 4
    }
