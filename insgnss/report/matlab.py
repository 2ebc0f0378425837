"""A run as a MAT file: the structures nav, events, errors and units of MATLAB and Octave."""

from __future__ import annotations

import io
from typing import Any, Final

import numpy as np
import pandas as pd

from insgnss.report.run_time import gps_week, utc_dates
from insgnss.report.sentences import name_of
from insgnss.runs.result import Run
from insgnss.version import __version__

_HEAD_BYTES: Final = 116  # of descriptive text, into which SciPy writes the time of day


def as_mat(run: Run) -> bytes:
    """Return the run as a MAT file (version 5): each column of a table is a field of its structure.

    nav has besides its columns ``posix_s`` (UTC: ``datetime(nav.posix_s, 'ConvertFrom', 'posixtime')``), ``h_msl_m``,
    ``geoid_m``, ``heading_deg``; the unit of a field is the field of the same name in ``units``.
    """
    from scipy.io import savemat

    week, nav = gps_week(run), run.nav_with(sea_level=True, heading=True)
    since_1970 = utc_dates(nav["time_s"].to_numpy(), week) - np.datetime64("1970-01-01", "ns")
    tables = {"nav": nav.assign(posix_s=since_1970 / np.timedelta64(1, "s"))}
    tables |= {"events": run.events} | ({} if run.errors is None else {"errors": run.errors})
    content: dict[str, Any] = {name: _structure(table) for name, table in tables.items()}
    units = nav.attrs["units"] | {"posix_s": "s"}
    content |= {"units": units, "gps_week": float(week), "name": name_of(run)}
    file = io.BytesIO()
    savemat(file, content, do_compression=True, long_field_names=True, oned_as="column")
    head = f"MATLAB 5.0 MAT-file, written by insgnss {__version__}".encode().ljust(_HEAD_BYTES)
    return head + file.getvalue()[_HEAD_BYTES:]  # the same run gives the same bytes


def _structure(table: pd.DataFrame) -> dict[str, Any]:
    """Return columns by their names: numbers as they are, words as cells."""
    return {
        str(name): column.to_numpy()
        if pd.api.types.is_numeric_dtype(column.dtype)
        else np.array([str(word) for word in column], dtype=object)
        for name, column in table.items()
    }
