"""A run as NetCDF: the navigation table as an xarray data set with units and attributes of the CF conventions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from insgnss.report.labels import label
from insgnss.report.run_time import gps_week, utc_dates
from insgnss.report.sentences import name_of
from insgnss.results.nav_columns import PLACE
from insgnss.runs.columns.sheet import unit_of
from insgnss.runs.result import Run
from insgnss.version import __version__

if TYPE_CHECKING:
    import xarray as xr

WHOSE_PLACE: Final = "whose_place"  # attribute of a table of another point than the IMU
# what UDUNITS calls the units of the columns
_UNITS: Final = {
    "°": "degree",
    "m/s": "m s-1",
    "m/s²": "m s-2",
    "rad/s": "rad s-1",
    "m/channel": "m",
    "m²": "m2",
    "m²/s²": "m2 s-2",
    "°²": "degree2",
    "°/h/g": "degree h-1 gravity-1",
    "ppm": "1e-6",
}
_CF: Final[dict[str, dict[str, str]]] = {
    "lat_deg": {"standard_name": "latitude", "units": "degrees_north"},
    "lon_deg": {"standard_name": "longitude", "units": "degrees_east"},
    "h_m": {"standard_name": "height_above_reference_ellipsoid", "positive": "up", "axis": "Z"},
    "h_msl_m": {"standard_name": "altitude", "positive": "up", "comment": "above the geoid of EGM96"},
    "geoid_m": {"standard_name": "geoid_height_above_reference_ellipsoid"},
    "heading_deg": {"standard_name": "platform_orientation"},
    "roll_deg": {"standard_name": "platform_roll_starboard_down"},
    "pitch_deg": {"standard_name": "platform_pitch_fore_up"},
    "yaw_deg": {"standard_name": "platform_yaw_fore_starboard"},
}


def as_netcdf(run: Run) -> bytes:
    """Return the run as NetCDF (classic, 64-bit offset), which every NetCDF library reads.

    Raises
    ------
    ResultError : the run does not say its GPS week
    """
    dataset = as_dataset(run)
    day = np.datetime_as_string(dataset["time"].to_numpy()[0], unit="D")
    time = {"units": f"seconds since {day} 00:00:00", "dtype": "float64", "calendar": "standard"}
    return bytes(dataset.to_netcdf(engine="scipy", encoding={"time": time}))


def as_dataset(run: Run) -> xr.Dataset:
    """Return the navigation table as an xarray data set over UTC, with heights above the sea and heading.

    Raises
    ------
    ResultError : the run does not say its GPS week
    """
    import xarray

    week, nav = gps_week(run), run.nav_with(sea_level=True, heading=True)
    variables = {str(name): ("time", column.to_numpy(), _about(str(name))) for name, column in nav.items()}
    times = utc_dates(nav["time_s"].to_numpy(), week)
    coordinates: dict[str, Any] = {name: variables.pop(name) for name in PLACE}
    coordinates["time"] = ("time", times, {"standard_name": "time", "long_name": "UTC", "axis": "T"})
    trajectory = ((), name_of(run), {"cf_role": "trajectory_id", "long_name": "name of the flight"})
    about = {
        "Conventions": "CF-1.8",
        "featureType": "trajectory",
        "title": name_of(run),
        "source": f"insgnss {__version__}",
        "gps_week": week,
        "comment": f"position of {run.nav.attrs.get(WHOSE_PLACE, 'the IMU')};"
        " time_s counts from the start of gps_week in GPS time",
    }
    return xarray.Dataset({**variables, "trajectory": trajectory}, coordinates, about)


def _about(name: str) -> dict[str, str]:
    """Return a variable's attributes: its long name, its unit, the standard name where it has one."""
    unit = unit_of(name)
    return {"long_name": label(name).words, "units": _UNITS.get(unit, unit or "1"), **_CF.get(name, {})}
