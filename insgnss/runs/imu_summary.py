"""Summary of an inertial log for the report page: its extremes over time, and its spectrum."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pandas as pd

from insgnss.constants import NS_PER_S
from insgnss.gpstime import ns_to_week_seconds
from insgnss.tables import Float64, ImuTable

BINS: Final = 1500  # of the time: more than a picture has pixels
SEGMENT: Final = 4096  # samples, of one spectrum
SEGMENTS: Final = 64  # spread over the log: the spectrum's sigma is then an eighth of it
_LEAST: Final = 64  # samples, below which a spectrum says nothing
_IMPOSSIBLE: Final = 1e6  # rad/s, m/s^2
_EVEN: Final = 0.5  # of the typical step: a segment whose steps differ by more has lost samples
_LARGEST: Final = 1e30  # what a float32 holds, in degrees too
_AXES: Final = [f"{sensor}_{axis}" for sensor in ("gyro", "accel") for axis in "xyz"]
_UNITS: Final = ["degps"] * 3 + ["mps2"] * 3


def imu_table(imu: ImuTable, week: int) -> pd.DataFrame:
    """Return smallest and largest rate and specific force in body axes, a row for each of at most 1500 parts.

    Numbers that no sensor gives end at 1e30.
    """
    n = len(imu.t_ns)
    starts = np.unique(np.linspace(0, n, min(BINS, n), endpoint=False).astype(np.int64))
    columns: dict[str, npt.NDArray[Any]] = {"time_s": ns_to_week_seconds(imu.t_ns[starts], week)}
    for k, (axis, unit) in enumerate(zip(_AXES, _UNITS, strict=True)):
        values = np.clip(imu.w_ib_b[:, k] if k < 3 else imu.f_b[:, k - 3], -_LARGEST, _LARGEST)
        values = np.degrees(values) if k < 3 else values
        columns[f"{axis}_min_{unit}"] = np.fmin.reduceat(values, starts).astype(np.float32)
        columns[f"{axis}_max_{unit}"] = np.fmax.reduceat(values, starts).astype(np.float32)
    return pd.DataFrame(columns)


def imu_spectrum(imu: ImuTable) -> pd.DataFrame:
    """Return the amplitude spectral density of each axis, a row for each frequency; none of a log without even steps.

    Equation: sqrt of the mean of 2 |X_k|^2 / (f_s sum w^2) over segments, each less its mean, w of Hann  [Welch 1967]
    """
    names = [f"{axis}_{unit}_per_sqrt_hz" for axis, unit in zip(_AXES, _UNITS, strict=True)]
    segments, rate_hz = _segments(imu)
    if not segments:
        return pd.DataFrame(columns=["frequency_hz", *names], dtype=np.float64)
    n = segments[0].stop - segments[0].start
    window = np.hanning(n)[:, None]
    power = np.zeros((n // 2 + 1, 6))
    for segment in segments:
        values = np.column_stack([np.degrees(imu.w_ib_b[segment]), imu.f_b[segment]])
        power += np.abs(np.fft.rfft((values - values.mean(axis=0)) * window, axis=0)) ** 2
    density = np.sqrt(2.0 * power / (len(segments) * rate_hz * np.sum(window**2)))
    # a mean taken off leaves nothing at zero
    frequency = np.fft.rfftfreq(n, 1.0 / rate_hz)[1:]
    columns = dict(zip(names, density[1:].T.astype(np.float32), strict=True))
    return pd.DataFrame({"frequency_hz": frequency, **columns})


def _segments(imu: ImuTable) -> tuple[list[slice], float]:
    """Return stretches of one length without lost samples, spread over the log, and their rate [Hz]."""
    step_s = np.diff(imu.t_ns) / NS_PER_S
    if len(step_s) < _LEAST:
        return [], 0.0
    typical = float(np.median(step_s))
    if typical <= 0.0:  # most tags repeat the one before
        return [], 0.0
    length = min(SEGMENT, 1 << ((len(step_s) // 8).bit_length() - 1))
    uneven = np.concatenate([[0], np.cumsum(np.abs(step_s - typical) > _EVEN * typical)])
    starts = np.unique(np.linspace(0, len(step_s) - length, SEGMENTS).astype(np.int64)).tolist()
    even = [slice(start, start + length) for start in starts if uneven[start + length - 1] == uneven[start]]
    return [
        one for one in even if _is_possible(imu.w_ib_b[one]) and _is_possible(imu.f_b[one])
    ], 1.0 / typical


def _is_possible(values: Float64) -> bool:
    """Return whether a spectrum can be made of samples: all finite, none that no sensor gives."""
    return bool(np.all(np.abs(values) < _IMPOSSIBLE))
