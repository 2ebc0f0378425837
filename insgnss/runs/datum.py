"""Times, heights and headings of a result table in common datums: UTC, mean sea level, clockwise from true north.

The GPS week and the units of a table are in its ``attrs``, also after it was saved as Parquet::

    nav = with_utc(with_sea_level(with_heading(run.nav)))       # run.nav_with(utc=True, ...) does the same
    events = with_utc(run.events)
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

import numpy as np
import pandas as pd

from insgnss.errors import ResultError
from insgnss.geodesy.sea_level import geoid_height
from insgnss.gpstime import ns_to_utc, week_seconds_to_ns
from insgnss.results.nav_columns import PLACE
from insgnss.runs.columns.sheet import unit_of

GPS_WEEK: Final = "gps_week"
FLIGHT: Final = "flight"  # its name


def annotate(table: pd.DataFrame, week: int) -> None:
    """Write into ``table.attrs`` the GPS week that its times count from, their scale, and the unit of each column."""
    units = {str(name): unit_of(str(name)) for name in table.columns}
    table.attrs |= {
        GPS_WEEK: week,
        "time_scale": "GPS",
        "units": {n: unit for n, unit in units.items() if unit},
    }


def annotate_all(tables: Iterable[pd.DataFrame | None], settings: Mapping[str, Any]) -> None:
    """Write week, scale, units and flight into the ``attrs`` of a result's tables, where its settings say the week."""
    flight = settings.get("flight")
    if not isinstance(flight, Mapping) or not isinstance(flight.get(GPS_WEEK), int):
        return
    for table in tables:
        if table is not None:
            annotate(table, flight[GPS_WEEK])
            table.attrs[FLIGHT] = str(flight.get("name") or "")


def label_as(table: pd.DataFrame, other: pd.DataFrame) -> None:
    """Write the flight and the GPS week of another table into the ``attrs``."""
    table.attrs |= {name: other.attrs[name] for name in (GPS_WEEK, FLIGHT) if name in other.attrs}


def what_and_when(table: pd.DataFrame) -> str:
    """Return the caption of a picture: the flight's name and the span of the table in UTC, empty where unknown."""
    week, name = table.attrs.get(GPS_WEEK), table.attrs.get(FLIGHT, "")
    time_s = table["time_s"].to_numpy(np.float64)
    time_s = time_s[np.isfinite(time_s)]
    if not isinstance(week, int) or not len(time_s):
        return str(name)
    ends = ns_to_utc(week_seconds_to_ns(week, np.array([time_s.min(), time_s.max()])))
    first, last = (text.replace("T", " ") for text in np.datetime_as_string(ends, unit="s").tolist())
    if first[:10] == last[:10]:
        last = last[11:]
    return f"{name}{', ' if name else ''}{first} to {last} UTC"


def with_utc(table: pd.DataFrame, week: int | None = None) -> pd.DataFrame:
    """Return the table with UTC as its index, leap seconds applied; ``time_s`` stays a column.

    Rows without a time (events of whole files) have NaT. An inserted leap second repeats the dates of the next second.

    Parameters
    ----------
    table : any table of a run that has a column ``time_s``
    week : GPS week of its times; by default that of ``table.attrs``

    Raises
    ------
    ResultError : the table has no ``time_s``, or neither says which GPS week it counts from
    """
    _check_columns(table, "time_s")
    week = table.attrs.get(GPS_WEEK) if week is None else week
    if not isinstance(week, int):
        raise ResultError(
            "the table does not say which GPS week its times count from",
            key='attrs["gps_week"]',
            advice="pass it: with_utc(table, week)",
        )
    time_s = table["time_s"].to_numpy(np.float64)
    known = np.isfinite(time_s)
    dates = np.full(len(time_s), "NaT", "datetime64[ns]")
    dates[known] = ns_to_utc(week_seconds_to_ns(week, time_s[known]))
    return table.set_axis(pd.DatetimeIndex(dates, tz="UTC", name="utc"), axis="index")


def with_sea_level(table: pd.DataFrame) -> pd.DataFrame:
    """Return the table with ``h_msl_m``, the height above mean sea level, and ``geoid_m``, the geoid's (EGM96).

    A table with a further point of the body (``point_h_m``) gets its height ``point_h_msl_m``, too.

    Raises
    ------
    ResultError : the table has no ``lat_deg``, ``lon_deg``, ``h_m``
    """
    _check_columns(table, *PLACE)
    geoid_m = geoid_height(table["lat_deg"], table["lon_deg"])
    added = table.assign(h_msl_m=table["h_m"] - geoid_m, geoid_m=geoid_m)
    if "point_h_m" not in table:
        return _with_units(added, "h_msl_m", "geoid_m")
    added["point_h_msl_m"] = table["point_h_m"] - geoid_m  # the geoid falls by less than 0.2 mm in each metre
    return _with_units(added, "h_msl_m", "geoid_m", "point_h_msl_m")


def with_heading(table: pd.DataFrame) -> pd.DataFrame:
    """Return the table with ``heading_deg``, the yaw counted clockwise from true north, 0 to below 360.

    Raises
    ------
    ResultError : the table has no ``yaw_deg``
    """
    _check_columns(table, "yaw_deg")
    heading = np.mod(table["yaw_deg"].to_numpy(np.float64), 360.0)
    heading[heading == 360.0] = 0.0  # a yaw of -1e-15
    return _with_units(table.assign(heading_deg=heading), "heading_deg")


def _check_columns(table: pd.DataFrame, *names: str) -> None:
    for name in names:
        if name not in table.columns:
            raise ResultError(
                "the table has no such column", column=name, advice="pass run.nav or a table with its columns"
            )


def _with_units(table: pd.DataFrame, *names: str) -> pd.DataFrame:
    """Return the table with the units of further columns in its ``attrs``."""
    units = dict(table.attrs.get("units", {})) | {name: unit_of(name) for name in names}
    table.attrs |= {"units": units}
    return table
