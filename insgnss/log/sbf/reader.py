"""Septentrio SBF files become tables: measurements, broadcast messages, inertial samples, the receiver's solution.

The blocks are decoded here, all of a kind at once: the parser of blocks one by one reads a quarter of a megabyte per
second (``pysbf2``, which the tests hold this against).
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

import numpy as np

from insgnss.errors import InputError
from insgnss.log.events import counted, in_file, listed
from insgnss.log.files import file_buffer, records
from insgnss.log.gnss_rows import in_time_order
from insgnss.log.own_solution import not_independent
from insgnss.log.receiver import ReceiverLog
from insgnss.log.sbf.blocks import (
    EXT_SENSOR,
    HEADER_LENGTH,
    LAYOUTS,
    MEAS_EPOCH,
    SENSOR,
    Blocks,
    block_length,
    block_records,
    block_times_ns,
    find_blocks,
    missed_measurements,
    other_blocks,
    time_known,
)
from insgnss.log.sbf.measurements import measurements
from insgnss.log.sbf.navigation import broadcast
from insgnss.log.sbf.solution import fixes, headings, name_of_fixes, solution
from insgnss.log.sensor_pairs import paired
from insgnss.tables import Event, ImuTable

MEASUREMENTS_NOT_READ: Final = "sbf_measurements_not_read"  # the kind of an event
_ACCELERATION, _ANGULAR_RATE = 0, 1  # types of ExtSensorMeas: m/s^2, deg/s


def read_sbf(path: Path, *further: Path) -> ReceiverLog:
    """Read a Septentrio receiver's SBF file, or several as one (plain or gzipped).

    Measurements are those of MeasEpoch (main antenna). The compressed Meas3 blocks have no public definition:
    if a log has no other measurements, an event says so. Messages are those that the receiver has decoded
    (GPSNav, GALNav, GLONav, BDSNav, QZSNav and ionosphere). Inertial samples (ExtSensorMeas) stay in the
    sensor's own axes. A file may hold them or the receiver's own solution (INSNavGeod; PVTGeodetic or
    PVTCartesian of satellites alone) alone; the table of measurements is empty then. The heading of several
    antennas (AttEuler) becomes a further sensor's samples. Pitch and roll are not taken: how the antennas'
    baseline is tilted in the vehicle is unknown, and the rows of an attitude have no state for it.

    Raises
    ------
    InputError : the file holds no SBF block, or none of what is read
    """
    data = b"".join(file_buffer(part).to_pybytes() for part in (path, *further))
    blocks = find_blocks(data)
    if not blocks.starts and not blocks.others:
        raise InputError(
            "no SBF block in the file", file=path, advice="is it a Septentrio receiver's binary log?"
        )
    gnss, events = measurements(data, blocks)
    imu, more_events = _inertial(data, blocks)
    own, without = solution(data, blocks)
    fixed, told_of_fixes = fixes(data, blocks)
    samples, told_of_headings = headings(data, blocks)
    events += told_of_fixes + told_of_headings
    missed = "" if len(gnss.t_ns) else missed_measurements(blocks)
    if not len(gnss.t_ns) and imu is None and own is None and fixed is None:
        raise InputError(
            "the SBF file holds no measurement, no inertial sample and no solution",
            file=path,
            advice=missed or f"log MeasEpoch (block {MEAS_EPOCH}) or ExtSensorMeas ({EXT_SENSOR})",
        )
    gnss, reordered = in_time_order(gnss, str(path))
    messages = broadcast(data, blocks)
    events += reordered
    events += [
        Event(None, "navigation_damaged", f"{count} {reason}; refused")
        for reason, count in messages.refused.items()
    ]
    if missed:
        events.append(Event(None, MEASUREMENTS_NOT_READ, missed))
    events += listed("sbf_not_used", "blocks not read, by number", other_blocks(blocks))
    events += counted("sbf_damaged", blocks.damaged, "damaged or cut block(s) left out")
    named = in_file(path, events + more_events + without)
    navigation = messages.navigation()
    if own is None and fixed is not None:
        named.append(not_independent(f"{name_of_fixes(blocks)}, the receiver's fixes"))
        return ReceiverLog(gnss, navigation, imu, named, fixed, further=tuple(samples))
    return ReceiverLog(
        gnss, navigation, imu, named, own, solution_from="filter", fixes=fixed, further=tuple(samples)
    )


def _inertial(data: bytes, blocks: Blocks) -> tuple[ImuTable | None, list[Event]]:
    """Return the samples of the first sensor that gave both kinds."""
    heads = block_records(data, blocks, EXT_SENSOR)
    starts: list[int] = []
    times: list[int] = []
    timed = time_known(heads)
    heads = heads[timed]
    block_starts = np.array(blocks.starts.get(EXT_SENSOR, []), dtype=np.int64)[timed].tolist()
    for start, head, t in zip(block_starts, heads, block_times_ns(heads).tolist(), strict=True):
        end = start + block_length(data, start)
        at, length = start + HEADER_LENGTH + LAYOUTS[EXT_SENSOR].itemsize, int(head["length"])
        if length < SENSOR.itemsize:
            continue
        inside = [at + k * length for k in range(int(head["n"])) if at + (k + 1) * length <= end]
        starts += inside
        times += [t] * len(inside)
    if not starts:
        return None, []
    rows, t_ns = records(data, starts, SENSOR), np.array(times, dtype=np.int64)
    gyro, accel = rows["type"] == _ANGULAR_RATE, rows["type"] == _ACCELERATION
    rates, forces = rows["xyz"][gyro] * (math.pi / 180.0), rows["xyz"][accel]
    return paired(t_ns[gyro], rates, t_ns[accel], forces, "ExtSensorMeas")
