"""UBX-ESF-RAW and UBX-ESF-MEAS, the inertial samples of u-blox receivers with sensors, in the sensor's own axes.

Their time tags count from the receiver's start, in ticks (ESF-RAW) or milliseconds (ESF-MEAS), and no message says how
they relate to GPS time. The relation is taken from the order of the messages: a sample that stands before an epoch's
measurements in the file was measured before them, within the time that the receiver needs to send both. A straight
line t = t0 + tick * tag is laid between the last tag before and the first tag after each epoch (least squares over
the whole file, so that the rate of the sensor's clock, some 50 ppm off, comes out too).

Accuracy: the noise of the line is below a sample's interval, but its level is wrong by the difference of two delays.
Measurements leave a receiver some 30 to 150 ms after their epoch, samples within some 10 ms (or 100 ms, in
batches). The times given here are therefore too early by up to 0.15 s, nearly constant over a log; an event says so,
and a time offset among the settings takes it away once it is known.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S
from insgnss.log.events import counted
from insgnss.log.ubx.frames import UbxFrames
from insgnss.tables import Event, Float64, ImuTable, Int64
from insgnss.units import RAD_PER_DEG

MEAS: Final = 0x1002
RAW: Final = 0x1003
# Data types of the three rates and the three forces, x y z (interface description, "ESF Measurement Data")
_TYPES: Final = (14, 13, 5, 16, 17, 18)
_RATE_SCALE: Final = RAD_PER_DEG * 2.0**-12  # deg/s 2^-12 -> rad/s
_FORCE_SCALE: Final = 2.0**-10  # m/s^2
_TAG_CYCLE: Final = 1 << 32
MIN_EPOCHS: Final = 3  # for the line between tags and time
BEYOND_NS: Final = 3600 * NS_PER_S  # a sample further from all epochs has a damaged tag
MAX_TICK_CHANGE: Final = 1e-3  # a slope further from a nominal one is not a clock
_NOMINAL_TICK_S: Final = {RAW: 39.0625e-6, MEAS: 1e-3}


@dataclass(frozen=True)
class SensorValues:
    """Single sensor values in the order of a file."""

    offset: Int64  # (n,) of the frame each came in
    tag: Int64  # (n,) sensor time, counted on over the wrap of 32 bits
    kind: Int64  # (n,) data type
    value: Int64  # (n,) signed, 24 bits


def imu_table(frames: UbxFrames, epoch_offset: Int64, epoch_ns: Int64) -> tuple[ImuTable | None, list[Event]]:
    """Return a file's inertial samples with GPS time tags, None when it has none that can be dated.

    ESF-RAW is preferred where both are present (higher rate, untouched by the receiver's own calibration).

    Parameters
    ----------
    frames : the file
    epoch_offset, epoch_ns : where in the file the receiver stated which GPS time, ascending offsets
    """
    message = RAW if frames.of(RAW) else MEAS
    if not frames.of(message):
        return None, []
    values = _raw_values(frames) if message == RAW else _meas_values(frames)
    samples = _samples(values)
    if not len(samples.tag):
        detail = f"{frames.path}: no sensor message holds all three rates and forces"
        return None, [Event(None, "imu_not_used", detail)]
    line = _time_line(values, message, epoch_offset, epoch_ns)
    if line is None:
        detail = (
            f"{frames.path}: the sensor's time tags cannot be related to GPS time: too few epochs among them"
            " (log UBX-NAV-PVT or NAV-TIMEGPS into the same file)"
        )
        return None, [Event(None, "imu_not_used", detail)]
    after_ns = np.rint(line.tick_s * (samples.tag - line.tag0) * NS_PER_S)
    near = (line.t0_ns + after_ns >= epoch_ns.min() - BEYOND_NS) & (
        line.t0_ns + after_ns <= epoch_ns.max() + BEYOND_NS
    )
    t_ns = line.t0_ns + after_ns[near].astype(np.int64)
    if not len(t_ns):
        return None, [Event(None, "imu_not_used", f"{frames.path}: no sensor time is near the epochs")]
    values_si = samples.values[near] * ([_RATE_SCALE] * 3 + [_FORCE_SCALE] * 3)
    table = ImuTable(t_ns, values_si[:, :3], values_si[:, 3:])
    left_out = samples.left_out + int((~near).sum())
    events = counted(
        "imu_repeated", left_out, "sensor values whose time does not advance left out", frames.path
    )
    if samples.interpolated:
        detail = (
            f"{frames.path}: rates and forces have different times; interpolated to those of the first rate"
        )
        events.append(Event(None, "imu_interpolated", detail))
    detail = (
        f"{frames.path}: sensor times aligned with GPS time by message order, scatter {line.scatter_s:.3f} s;"
        " they may be too early by the receiver's output delay, up to about 0.15 s"
    )
    return table, [*events, Event(int(t_ns[0]), "imu_time_estimated", detail)]


# -------------------------------------------------------------------------------------------------- values in a file


def _raw_values(frames: UbxFrames) -> SensorValues:
    """Return the values of ESF-RAW: four reserved bytes, then data and tag in turn."""
    places = [(o, (n - 4) // 8) for o, n in frames.of(RAW) if n >= 12]
    body = b"".join([frames.data[o + 4 : o + 4 + 8 * n] for o, n in places])
    pairs = np.frombuffer(body, "<u4").reshape(-1, 2)
    offsets = np.repeat([o for o, _ in places], [n for _, n in places]).astype(np.int64)
    return _values(offsets, pairs[:, 1], pairs[:, 0])


def _meas_values(frames: UbxFrames) -> SensorValues:
    """Return the values of ESF-MEAS: tag, flags and source, then data."""
    offsets: list[int] = []
    tags: list[int] = []
    words: list[npt.NDArray[np.uint32]] = []
    for offset, length in frames.of(MEAS):
        if length < 12:
            continue
        tag, flags = np.frombuffer(frames.data, "<u4", 1, offset)[0], frames.data[offset + 5]
        count = min(flags >> 3 or (length - 8) // 4, (length - 8) // 4)  # old receivers state no count
        words.append(np.frombuffer(frames.data, "<u4", count, offset + 8))
        offsets += [offset] * count
        tags += [int(tag)] * count
    data = np.concatenate(words) if words else np.zeros(0, np.uint32)
    return _values(np.array(offsets, dtype=np.int64), np.array(tags, dtype=np.uint32), data)


def _values(offset: Int64, tag: npt.NDArray[np.uint32], data: npt.NDArray[np.uint32]) -> SensorValues:
    """Return the values split into type and number, the tags counted on where they wrap."""
    number = (data & 0xFFFFFF).astype(np.int64)
    number -= (number >= 1 << 23) * np.int64(1 << 24)
    counted: Int64 = tag.astype(np.int64)
    step: Int64 = np.diff(counted, prepend=counted[:1])
    step = np.mod(step + _TAG_CYCLE // 2, _TAG_CYCLE) - _TAG_CYCLE // 2
    return SensorValues(
        offset, counted[:1].sum() + np.cumsum(step), (data >> 24 & 63).astype(np.int64), number
    )


# ----------------------------------------------------------------------------------------------------------- samples


@dataclass(frozen=True)
class _ImuReadings:
    tag: Int64  # (n,) ascending
    values: Float64  # (n, 6)
    left_out: int  # tags that come again or fall back
    interpolated: bool


def _samples(values: SensorValues) -> _ImuReadings:
    """Return the six channels at the times of the first; others with other times are interpolated."""
    tags, series, left_out = [], [], 0
    for kind in _TYPES:
        rows = np.flatnonzero(values.kind == kind)
        tag = values.tag[rows]
        forward = np.ones(len(rows), np.bool_)
        forward[1:] = tag[1:] > np.maximum.accumulate(tag)[:-1] if len(rows) else True
        left_out += int((~forward).sum())
        tags.append(tag[forward])
        series.append(values.value[rows][forward].astype(np.float64))
    if not all(len(tag) for tag in tags):
        return _ImuReadings(np.zeros(0, np.int64), np.zeros((0, 6)), left_out, False)
    first, last = max(tag[0] for tag in tags), min(tag[-1] for tag in tags)
    common = tags[0][(tags[0] >= first) & (tags[0] <= last)]
    together = all(np.isin(common, tag).all() for tag in tags)
    columns = [np.interp(common, tag, channel) for tag, channel in zip(tags, series, strict=True)]
    return _ImuReadings(common, np.stack(columns, axis=1), left_out, not together)


# -------------------------------------------------------------------------------------------------------------- time


@dataclass(frozen=True)
class _TimeLine:
    tag0: int
    t0_ns: int  # GPS time at tag0
    tick_s: float
    scatter_s: float  # rms of the epochs about the line


def _time_line(values: SensorValues, message: int, epoch_offset: Int64, epoch_ns: Int64) -> _TimeLine | None:
    """Return the line of GPS time over the sensor's tags, None when the epochs do not determine one."""
    after = np.searchsorted(values.offset, epoch_offset)
    inside = (after > 0) & (after < len(values.offset))
    if inside.sum() < MIN_EPOCHS:
        return None
    after = after[inside]
    last_before = np.maximum.accumulate(values.tag)[after - 1]
    tag = 0.5 * (last_before + np.maximum(values.tag[after], last_before))
    t = (epoch_ns[inside] - epoch_ns[inside][0]) / NS_PER_S
    if np.ptp(tag) <= 0.0:
        return None
    nominal = _NOMINAL_TICK_S[message]
    kept = np.ones(len(t), np.bool_)
    tick, start, scatter = nominal, 0.0, 0.0
    for _ in range(3):  # epochs that waited long in the receiver's queue drop out
        tick, start = _fitted(tag[kept] - tag[0], t[kept], nominal)
        residual = t - start - tick * (tag - tag[0])
        scatter = float(np.sqrt(np.mean(residual[kept] ** 2)))
        kept = np.abs(residual) <= max(3.0 * float(np.median(np.abs(residual))), 1e-3)
    tag0 = int(values.tag[0])
    t0_ns = int(epoch_ns[inside][0]) + round((start + tick * (tag0 - tag[0])) * NS_PER_S)
    return _TimeLine(tag0, t0_ns, tick, scatter)


def _fitted(tag: Float64, t: Float64, nominal: float) -> tuple[float, float]:
    """Return slope and level of t over tag; the slope stays the nominal one where the data contradict it."""
    centred = tag - tag.mean()
    power = float(centred @ centred)
    slope = float(centred @ t) / power if power > 0.0 else nominal
    if abs(slope / nominal - 1.0) > MAX_TICK_CHANGE:
        slope = nominal
    return slope, float(t.mean() - slope * tag.mean())
