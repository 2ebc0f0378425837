"""Times, heights and headings as others count them, and what a table says of its own columns."""

from __future__ import annotations

import datetime as dt
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from pyarrow.parquet import read_schema

from insgnss.errors import ResultError
from insgnss.gpstime import ns_to_utc, utc_to_ns
from insgnss.runs.datum import what_and_when, with_heading, with_sea_level, with_utc
from insgnss.runs.result import Run
from tests.report.runs import START_S, WEEK, made_run


def test_utc_of_gps_time_is_the_way_back_from_utc() -> None:
    dates = [dt.datetime(year, month, 1) for year in range(1980, 2027) for month in (2, 7)]

    back = ns_to_utc([utc_to_ns(date) for date in dates])

    assert back.astype("datetime64[us]").tolist() == dates


def test_leap_second_repeats_the_second_after_it() -> None:
    midnight = utc_to_ns(dt.datetime(2017, 1, 1))

    texts = np.datetime_as_string(ns_to_utc(midnight + 10**9 * np.arange(-2, 2)), unit="s").tolist()

    assert texts == [
        "2016-12-31T23:59:59",
        "2017-01-01T00:00:00",
        "2017-01-01T00:00:00",
        "2017-01-01T00:00:01",
    ]


def test_navigation_comes_with_utc_sea_level_and_heading_on_request() -> None:
    run = made_run()

    nav = run.nav_with(utc=True, sea_level=True, heading=True)

    assert nav.index[0] == pd.Timestamp("2025-09-24T09:34:42Z")
    assert (nav["h_m"] - nav["h_msl_m"]).between(38.9, 39.2).all()  # the geoid near 45 N, 10 E
    assert nav["heading_deg"].between(0.0, 360.0, inclusive="left").all()
    assert np.allclose(np.sin(np.radians(nav["heading_deg"] - nav["yaw_deg"])), 0.0, atol=1e-12)
    assert run.nav_with() is run.nav
    assert list(run.nav.columns) == list(made_run().nav.columns)


def test_further_point_has_a_height_above_sea_level_too() -> None:
    nav = made_run().nav
    nav = with_sea_level(nav.assign(point_h_m=nav["h_m"] + 2.5))

    np.testing.assert_allclose(nav["point_h_msl_m"] - nav["h_msl_m"], 2.5, rtol=0, atol=1e-9)
    assert nav.attrs["units"]["point_h_msl_m"] == "m"


def test_caption_names_flight_and_span_in_utc() -> None:
    nav = made_run().nav
    caption = what_and_when(nav)

    assert caption.startswith(f"{nav.attrs['flight']}, 2025-09-24 09:34:42 to ")
    assert caption.endswith(" UTC") and caption.count("2025") == 1
    assert what_and_when(pd.DataFrame({"time_s": [1.0, 2.0]})) == ""


def test_heading_just_west_of_north_is_below_360() -> None:
    headings = with_heading(pd.DataFrame({"yaw_deg": [-1e-15, -1.0, 180.0]}))["heading_deg"]

    assert headings.tolist() == [0.0, 359.0, 180.0]


def test_rows_without_a_time_have_no_date() -> None:
    events = with_utc(made_run().events)

    assert events.index[0] is pd.NaT
    assert events.index[1] == pd.Timestamp("2025-09-24T09:34:42Z")


def test_table_that_does_not_say_its_week_is_refused() -> None:
    table = pd.DataFrame({"time_s": [START_S]})

    with pytest.raises(ResultError, match="which GPS week"):
        with_utc(table)
    with pytest.raises(ResultError, match="'time_s': the table has no such column"):
        with_utc(pd.DataFrame({"sv": ["G01"]}), WEEK)
    assert with_utc(table, WEEK).index[0] == pd.Timestamp("2025-09-24T09:34:42Z")


def test_table_without_the_columns_is_refused() -> None:
    table = pd.DataFrame({"time_s": [START_S]})

    with pytest.raises(ResultError, match="'lat_deg'"):
        with_sea_level(table)
    with pytest.raises(ResultError, match="'yaw_deg'"):
        with_heading(table)


def test_tables_say_their_week_and_units() -> None:
    run = made_run(aiding=True)

    assert run.nav.attrs["gps_week"] == run.measurements.attrs["gps_week"] == WEEK
    assert run.nav.attrs["units"]["gyro_bias_x_radps"] == "rad/s"
    assert run.aiding is not None and run.aiding.attrs["units"]["doppler_hz"] == "Hz"
    assert with_sea_level(run.nav).attrs["units"]["h_msl_m"] == "m"
    assert "h_msl_m" not in run.nav.attrs["units"]


def test_week_and_units_are_kept_by_parquet_and_told_by_the_settings_of_a_run_in_csv(tmp_path: Path) -> None:
    run = made_run()

    for form in ("parquet", "csv"):
        run.save(tmp_path / form, form)
        assert Run.load(tmp_path / form).nav.attrs == run.nav.attrs
    path = tmp_path / "parquet" / "nav.parquet"
    assert pd.read_parquet(path).attrs == run.nav.attrs
    # the key of pandas, also where pyarrow writes none of its own
    assert json.loads(read_schema(path).metadata[b"PANDAS_ATTRS"]) == run.nav.attrs


def test_run_whose_settings_say_no_week_has_no_attrs() -> None:
    run = made_run()

    bare = Run(
        pd.DataFrame({"time_s": [1.0]}),
        run.measurements,
        run.satellites,
        run.events,
        settings={"flight": "?"},
    )

    assert bare.nav.attrs == {}
