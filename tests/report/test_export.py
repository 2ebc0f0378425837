"""Files for other programs: read back by their own rules, places and times where they belong."""

from __future__ import annotations

import datetime as dt
import io
import json
import xml.etree.ElementTree as ET
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.csv
import pytest

from insgnss.errors import ConfigError, ResultError
from insgnss.gpstime import utc_to_ns, week_seconds_to_ns
from insgnss.report.export import FORMATS, export_run
from insgnss.report.geojson import as_geojson
from insgnss.report.gpx import as_gpx
from insgnss.report.kml import as_kml, as_kmz
from insgnss.report.run_time import utc, utc_texts
from insgnss.runs.result import Run
from tests.report.runs import START_S, WEEK, made_run

KML = "{http://www.opengis.net/kml/2.2}"
GPX = "{http://www.topografix.com/GPX/1/1}"


def at_week(run: Run, week: int) -> Run:
    run.settings = {**run.settings, "flight": {"name": "made", "gps_week": week}}
    return run


def test_kml_has_every_row_in_longitude_latitude_height() -> None:
    run = made_run()

    root = ET.fromstring(as_kml(run))

    line = root.findtext(f".//{KML}LineString/{KML}coordinates")
    assert line is not None
    places = np.array([[float(v) for v in place.split(",")] for place in line.split()])
    nav = run.nav_with(sea_level=True)
    assert np.allclose(places, nav[["lon_deg", "lat_deg", "h_msl_m"]], atol=6e-4)  # mm of height
    assert np.allclose(places[:, :2], run.nav[["lon_deg", "lat_deg"]], atol=6e-10)


def test_kml_marks_start_end_and_the_events_that_have_a_time() -> None:
    run = made_run()

    root = ET.fromstring(as_kml(run))

    marks = {p.findtext(f"{KML}name"): p for p in root.iter(f"{KML}Placemark")}
    lines = {"track", "track on the ground", "track over time"}
    assert set(marks) == lines | {"start", "end", "heading_known", "imu_gap"}
    assert marks["imu_gap"].findtext(f"{KML}description", "").endswith("</script>")
    place = marks["imu_gap"].findtext(f"{KML}Point/{KML}coordinates", "")
    assert float(place.split(",")[0]) == pytest.approx(run.nav["lon_deg"][50], abs=1e-9)


def test_kmz_is_an_archive_of_the_same_kml_and_the_same_every_time() -> None:
    run = made_run()

    content = as_kmz(run)

    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        assert archive.namelist() == ["doc.kml"]
        assert archive.read("doc.kml") == as_kml(run)
    assert content == as_kmz(run)


def test_gpx_times_are_utc() -> None:
    root = ET.fromstring(as_gpx(made_run()))

    times = [dt.datetime.fromisoformat(e.text or "") for e in root.iter(f"{GPX}time")]
    assert len(times) == 300
    # the way back through the leap seconds: a UTC date becomes the GPS time it was made of
    assert utc_to_ns(times[0].replace(tzinfo=None)) == int(week_seconds_to_ns(WEEK, START_S))
    assert times[0].isoformat() == "2025-09-24T09:34:42+00:00"


def test_gpx_begins_a_new_segment_after_a_gap() -> None:
    run = made_run()
    run.nav = pd.concat([run.nav[:100], run.nav[200:]], ignore_index=True)

    segments = ET.fromstring(as_gpx(run)).findall(f".//{GPX}trkseg")

    assert [len(s) for s in segments] == [100, 100]


def test_leap_second_within_a_run_is_counted() -> None:
    # 2016-12-31 23:59:59 UTC; GPS - UTC became 18 s at the end of that day
    before = utc_to_ns(dt.datetime(2016, 12, 31, 23, 59, 58))
    week, seconds = divmod(before, 604_800 * 10**9)
    times = seconds / 1e9 + np.array([0.0, 1.0, 3.0, 20.0, 40.0])

    texts = utc_texts(times, int(week))

    assert texts[0] == "2016-12-31T23:59:58.000Z"
    assert texts[1] == "2016-12-31T23:59:59.000Z"
    assert texts[2] == "2017-01-01T00:00:00.000Z"
    assert texts[4] == "2017-01-01T00:00:37.000Z"


def test_times_of_fractions_are_rounded_to_the_millisecond() -> None:
    assert utc_texts(np.array([START_S + 0.9999]), WEEK) == ["2025-09-24T09:34:43.000Z"]
    assert utc(START_S + 604_800.0, WEEK - 1) == utc(START_S, WEEK)


def test_geojson_is_one_line_with_times_and_points_for_the_events() -> None:
    run = made_run()

    read = json.loads(as_geojson(run))

    line, *points = read["features"]
    assert line["geometry"]["type"] == "LineString"
    assert len(line["geometry"]["coordinates"]) == len(line["properties"]["time_utc"]) == 300
    assert line["geometry"]["coordinates"][7] == pytest.approx(
        run.nav.loc[7, ["lon_deg", "lat_deg", "h_m"]].tolist(), abs=1e-3
    )
    assert [p["properties"]["kind"] for p in points] == ["start", "heading_known", "imu_gap"]


def test_geojson_over_the_antimeridian_is_in_parts_that_end_at_it() -> None:
    run = made_run()
    nav = run.nav.iloc[:6].copy()
    nav["lon_deg"] = [179.8, 179.9, -179.9, 180.0, -179.7, -179.6]
    nav["lat_deg"] = [-17.0, -17.1, -17.3, -17.4, -17.5, -17.6]
    run.nav = nav

    line = json.loads(as_geojson(run))["features"][0]

    assert line["geometry"]["type"] == "MultiLineString"
    parts = line["geometry"]["coordinates"]
    assert [[point[:2] for point in part] for part in parts] == [
        [[179.8, -17.0], [179.9, -17.1], [180.0, -17.2]],
        [[-180.0, -17.2], [-179.9, -17.3], [-180.0, pytest.approx(-17.4)]],
        [[180.0, pytest.approx(-17.4)], [180.0, -17.4], [180.0, -17.4]],
        [[-180.0, -17.4], [-179.7, -17.5], [-179.6, -17.6]],
    ]
    for name in ("time_utc", "sd_horizontal_m"):
        assert [len(part) for part in line["properties"][name]] == [len(part) for part in parts]
    whole = utc_texts(nav["time_s"].to_numpy(), WEEK)
    assert whole[1] < line["properties"]["time_utc"][0][2] < whole[2]
    assert [name in line["properties"] for name in ("name", "time_utc")] == [True, True]


def test_csv_is_the_navigation_table_to_the_last_bit(tmp_path: Path) -> None:
    run = made_run()

    # pandas before 3 rounds the last bit when it reads
    read = pyarrow.csv.read_csv(export_run(run, tmp_path / "nav.csv")).to_pandas()

    pd.testing.assert_frame_equal(read[run.nav.columns], run.nav, check_exact=True, check_dtype=False)


@pytest.mark.parametrize("format", sorted(FORMATS))
def test_every_format_is_written_by_the_ending_of_the_file(format: str, tmp_path: Path) -> None:
    by_ending = export_run(made_run(), tmp_path / "new" / f"run.{format}")
    by_name = export_run(made_run(), tmp_path / "run.bin", format)

    assert by_ending.read_bytes() == by_name.read_bytes()


def test_unknown_format_is_refused_with_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="kml, kmz, gpx"):
        export_run(made_run(), tmp_path / "run.shp")


def test_run_without_a_week_has_no_times_for_a_map(tmp_path: Path) -> None:
    run = made_run()
    run.settings = {}

    with pytest.raises(ResultError, match="which GPS week"):
        export_run(run, tmp_path / "run.gpx")
