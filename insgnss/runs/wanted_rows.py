"""The requested rows of a run: times, point of the body, and columns besides the sigmas."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, Literal, TypeAlias

import numpy as np
import numpy.typing as npt
import pandas as pd

from insgnss.errors import ConfigError
from insgnss.filter.smoothing.body_points import PointColumns, PointColumnValues
from insgnss.filter.whole_log import OutputRate
from insgnss.gpstime import ns_to_week_seconds, week_seconds_to_ns
from insgnss.log.flight import Flight
from insgnss.runs.wanted_times import WANTED, about, week_seconds
from insgnss.tables import Event, Float64, Int64

AtTimes: TypeAlias = Literal["gnss", "imu"] | float | Sequence[Any] | Float64 | pd.Series | pd.Index
Point: TypeAlias = str | Sequence[float] | Float64
_FARTHEST_M: Final = 1e3  # from the IMU
_ANTENNA: Final = "antenna"  # that of the GNSS log


def further_of(
    flight: Flight, point: Point | None, *, quaternion: bool, covariance: bool
) -> PointColumnValues | None:
    """Return space for the columns wanted besides those of every row, None for nothing.

    Raises
    ------
    ConfigError : no such point
    """
    lever_b = None if point is None else point_of(flight, point)
    wanted = PointColumns(lever_b, quaternion=quaternion, covariance=covariance)
    return PointColumnValues(wanted) if wanted.columns else None


def point_of(flight: Flight, point: Point) -> tuple[float, float, float]:
    """Return a point of the body, IMU to the point [m], given as such or by its name in the flight file.

    Raises
    ------
    ConfigError : the flight file has no such name, or the coordinates are invalid
    """
    if isinstance(point, str):
        known = named_points(flight)
        if point not in known:
            names = ", ".join(f"'{name}'" for name in known) or "none"
            raise ConfigError(
                f"no point '{point}' in the flight file; it names {names}",
                file=flight.path,
                key="point",
                advice="add it under [points] as name = [forward, right, down] in metres from the IMU, or give"
                " its coordinates",
            )
        return known[point]
    try:
        x, y, z = (float(value) for value in point)
    except (TypeError, ValueError):
        x = y = z = math.nan
    if not max(abs(x), abs(y), abs(z)) <= _FARTHEST_M or math.isnan(x + y + z):
        raise ConfigError(
            f"invalid point of the body {point!r}",
            key="point",
            advice=f"give three numbers, forward, right, down in metres from the IMU, up to {_FARTHEST_M:g}",
        )
    return x, y, z


def named_points(flight: Flight) -> dict[str, tuple[float, float, float]]:
    """Return the points that a flight file names: its own, its antennas, and 'antenna', that of the GNSS log."""
    gnss, attitude = flight.config.gnss, flight.config.attitude
    points = {_ANTENNA: gnss.lever_b}
    points |= {antenna.name: antenna.lever_arm_m or gnss.lever_b for antenna in gnss.antenna if antenna.name}
    points |= {one.name: one.lever_arm_m for one in (() if attitude is None else attitude.antenna)}
    points |= flight.config.points
    return {name: lever for name, lever in points.items() if lever is not None}


def refuse_smoothing(*, smooth: bool, beside: bool) -> None:
    """Refuse a smoothed replay where smoothing is not available.

    Raises
    ------
    ConfigError : it is to be smoothed, and has aiding or supervision ``beside``
    """
    if smooth and beside:
        advice = "leave aiding and supervise out, or replay without smoothing"
        raise ConfigError("a smoothed run has no aiding and no supervision", key="smooth", advice=advice)


def refuse_integrity(flight: Flight, *, integrity: bool) -> None:
    """Refuse protection levels for a flight without satellites.

    Raises
    ------
    ConfigError : they are asked for, and the flight has no raw GNSS data
    """
    if integrity and not flight.config.gnss.files:
        message = "a flight without raw GNSS data has no protection levels: they are for faults of satellites"
        raise ConfigError(message, key="integrity", advice="replay without integrity, or give [gnss]")


def output_of(output: AtTimes, week: int, *, has_epochs: bool = True) -> OutputRate:
    """Return the output as the filter takes it: seconds of the GPS week, and dates with a zone, become nanoseconds.

    Without epochs a row at each epoch becomes one a second.

    Raises
    ------
    ConfigError : it is True or False, a value is not a time, a date has no zone, the list is empty, or the times do not
        increase
    """
    if isinstance(output, bool | np.bool_):  # which would count as a rate of 1 or 0 Hz
        raise ConfigError(
            f"{output} is neither an output rate nor a time",
            key="output",
            advice="give 'gnss', 'imu', a rate [Hz] or times",
        )
    try:
        if np.ndim(output) == 0:
            if not has_epochs and str(output) == "gnss":
                return 1.0
            return output  # type: ignore[return-value]  # it is checked later against the samples' rate
    except (TypeError, ValueError):  # a list of lists
        raise _no_times("are not one list") from None
    times_s = week_seconds(output, week, _no_times)
    if times_s.ndim != 1 or not len(times_s):
        raise _no_times("are not one list")
    if float(np.abs(times_s).max()) > np.iinfo(np.int64).max / 4e9:
        raise _no_times("are not seconds of the GPS week")
    t_ns = week_seconds_to_ns(week, times_s)
    late = np.flatnonzero(np.diff(t_ns) <= 0)
    if len(late):
        i = int(late[0])
        raise _no_times(f"do not increase: {times_s[i]:.9g} s is followed by {times_s[i + 1]:.9g} s")
    return t_ns


def _no_times(what: str) -> ConfigError:
    return ConfigError(
        about("the output times", what),
        key="output",
        advice=f"{WANTED}, in increasing order",
    )


def times_without_row(output: OutputRate, nav_ns: Int64, week: int) -> list[Event]:
    """Return the event of output times at which there was no filter.

    Raises
    ------
    ConfigError : there was none at any of them
    """
    if isinstance(output, int | float) and not len(nav_ns):
        raise ConfigError(
            f"no output row: no time at {output:g} Hz lies between the filter's start and the last inertial sample",
            key="output",
            advice="give a higher rate (--rate 10), or 'imu'; or log for longer",
        )
    if not isinstance(output, np.ndarray):
        return []
    without = output[~np.isin(output, nav_ns)]
    if not len(without):
        return []
    if len(without) == len(output):
        raise _no_times("are all before the filter's start or after the last inertial sample")
    first_s, last_s = ns_to_week_seconds(without[[0, -1]], week).tolist()
    detail = (
        f"{len(without)} of {len(output)} output times have no row, {first_s:.3f} to {last_s:.3f} s: there were no"
        " inertial samples, or the filter had not started"
    )
    return [Event(None, "output_times", detail)]


def described(output: AtTimes) -> Any:
    """Return the output from a run's settings: times are those of its rows."""
    if isinstance(output, str):
        return output
    return float(output) if np.ndim(output) == 0 else "times"  # type: ignore[arg-type]


def with_further(nav: pd.DataFrame, further: PointColumnValues | None) -> pd.DataFrame:
    """Return the navigation table with the columns that were wanted."""
    if further is None:
        return nav
    values: npt.NDArray[Any] = further.values[: len(nav)]
    names = list(further.wanted.columns)
    return pd.concat([nav, pd.DataFrame(values, columns=names, index=nav.index)], axis=1)
