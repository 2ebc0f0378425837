"""A run as CSV: the navigation table with its UTC dates, heights above mean sea level and headings."""

from __future__ import annotations

import io

import pyarrow as pa
import pyarrow.csv

from insgnss.report.run_time import gps_week, utc_texts
from insgnss.runs.result import Run


def as_csv(run: Run) -> bytes:
    """Return the navigation table as CSV, numbers to the last bit: UTC and GPS week first, heights and heading last.

    ``h_msl_m`` is above mean sea level, ``geoid_m`` the geoid's height (EGM96), ``heading_deg`` 0 to below 360.
    """
    week = gps_week(run)
    nav = run.nav_with(sea_level=True, heading=True)
    nav.insert(0, "utc", utc_texts(nav["time_s"].to_numpy(), week, decimals=6))
    nav.insert(1, "gps_week", week)
    rows = io.BytesIO()
    plain = pyarrow.csv.WriteOptions(include_header=False, quoting_style="none")
    pyarrow.csv.write_csv(pa.Table.from_pandas(nav, preserve_index=False), rows, plain)
    return ",".join(nav.columns).encode() + b"\n" + rows.getvalue()
