"""Files for other programs, opened by their own readers: RTKLIB, pynmea2, SciPy, xarray, gpxpy; SBET by its record."""

from __future__ import annotations

import datetime as dt
import shutil
import subprocess
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import gpxpy
import numpy as np
import pandas as pd
import pynmea2
import pytest
import xarray as xr
from scipy.io import loadmat

from insgnss.report.export import export_run
from insgnss.report.gpx import as_gpx
from insgnss.report.kml import as_kml
from insgnss.report.matlab import as_mat
from insgnss.report.nmea import as_nmea
from insgnss.report.sbet import ACCURACY_FIELDS, FIELDS
from insgnss.report.solution import solution
from insgnss.runs.columns.page import SHEETS
from insgnss.runs.result import Run
from tests.described_columns import undescribed
from tests.report.runs import START_S, made_run, words

KML = "{http://www.opengis.net/kml/2.2}"
GX = "{http://www.google.com/kml/ext/2.2}"
POS2KML = shutil.which("pos2kml")
FIRST_UTC = dt.datetime(2025, 9, 24, 9, 34, 42, tzinfo=dt.UTC)  # START_S of the week is 09:35:00 GPS
OUTAGE = slice(100, 160)  # rows of the run without satellites


def run_with_outage() -> Run:
    """Return a run whose GNSS is silent for 60 s."""
    run = made_run()
    silent = run.nav["time_s"].to_numpy()[OUTAGE]
    run.measurements = run.measurements[~run.measurements["time_s"].isin(silent)]
    run.satellites = run.satellites[~run.satellites["time_s"].isin(silent)]
    return run


# ---------------------------------------------------------------------------------------------------- RTKLIB


def read_pos(path: Path) -> pd.DataFrame:
    """Return a .pos file as its users read it: white space between columns, the last comment names them."""
    head = [line for line in path.read_text().splitlines() if line.startswith("%")][-1]
    names = ["date", *head.lstrip("% ").split()]
    return pd.read_csv(path, comment="%", sep=r"\s+", names=names)


def test_pos_has_every_row_in_gps_time_with_quality_and_velocity(tmp_path: Path) -> None:
    run = run_with_outage()

    read = read_pos(export_run(run, tmp_path / "run.pos"))

    assert (read["date"][0], read["GPST"][0]) == ("2025/09/24", "09:35:00.000")
    assert np.allclose(read["latitude(deg)"], run.nav["lat_deg"], atol=6e-10)
    assert np.allclose(read["height(m)"], run.nav["h_m"], atol=6e-5)
    assert np.allclose(read["vu(m/s)"], -run.nav["vd_mps"], atol=6e-6)
    assert np.allclose(read["sde(m)"], run.nav["sd_e_m"], atol=6e-5)
    assert (read["Q"][OUTAGE][2:] == 7).all() and (read["ns"][OUTAGE][2:] == 0).all()
    assert (read["Q"].drop(range(*OUTAGE.indices(300))) == 5).all()


def test_pos_has_the_covariances_that_the_table_has(tmp_path: Path) -> None:
    run = made_run(seconds=3.0)
    run.nav["cov_n_e_m2"], run.nav["cov_e_d_m2"], run.nav["cov_n_d_m2"] = 0.25, 0.04, -0.09

    read = read_pos(export_run(run, tmp_path / "run.pos"))

    # signed roots; up is against down
    assert read.loc[0, ["sdne(m)", "sdeu(m)", "sdun(m)"]].tolist() == [0.5, -0.2, 0.3]
    assert read.loc[0, ["sdvne", "sdveu", "sdvun"]].tolist() == [0.0, 0.0, 0.0]


def test_pos_of_times_between_milliseconds_keeps_the_microseconds(tmp_path: Path) -> None:
    run = made_run(seconds=3.0)
    run.nav["time_s"] += 0.000123

    assert read_pos(export_run(run, tmp_path / "run.pos"))["GPST"][0] == "09:35:00.000123"


def test_base_station_makes_the_solution_differential(tmp_path: Path) -> None:
    run = made_run(seconds=3.0)
    run.settings = {**run.settings, "flight": {**run.settings["flight"], "gnss": {"base": {"lat_deg": 45.0}}}}

    assert (read_pos(export_run(run, tmp_path / "run.pos"))["Q"] == 4).all()
    assert pynmea2.parse(as_nmea(run).decode().splitlines()[1]).gps_qual == 2


@pytest.mark.skipif(
    POS2KML is None, reason="RTKLIB's program pos2kml is not installed (Debian, Ubuntu: apt install rtklib)"
)
@pytest.mark.parametrize(("ending", "height_atol_m"), [("pos", 6e-4), ("nmea", 0.011)])
def test_rtklib_reads_the_file(ending: str, height_atol_m: float, tmp_path: Path) -> None:
    run = run_with_outage()
    path = export_run(run, tmp_path / f"run.{ending}")

    subprocess.run([str(POS2KML), "-a", "-o", tmp_path / "read.kml", path], check=True, capture_output=True)

    line = ET.parse(tmp_path / "read.kml").find(".//{*}LineString/{*}coordinates")
    assert line is not None and line.text is not None
    places = np.array([[float(v) for v in place.split(",")] for place in line.text.split()])
    # NMEA has minutes to six decimals, heights and geoid to the centimetre; RTKLIB adds both up
    assert np.allclose(places[:, :2], run.nav[["lon_deg", "lat_deg"]], atol=1.1e-8)
    assert np.allclose(places[:, 2], run.nav["h_m"], atol=height_atol_m)


# ------------------------------------------------------------------------------------------------------ NMEA


def sentences(run: Run) -> dict[str, list[Any]]:
    """Return the sentences that pynmea2 reads, by their kind; a wrong checksum raises."""
    read: dict[str, list[Any]] = {}
    for line in as_nmea(run).decode("ascii").split("\r\n")[:-1]:
        assert len(line) <= 80, line  # NMEA 0183: 82 with carriage return and line feed
        sentence = pynmea2.parse(line, check=True)
        read.setdefault(sentence.sentence_type, []).append(sentence)
    return read


def test_nmea_has_place_time_height_and_course_of_every_row() -> None:
    run = made_run()
    nav = run.nav_with(sea_level=True, heading=True)

    read = sentences(run)

    kinds = ("RMC", "GGA", "VTG", "HDT", "GST")
    assert {kind: len(rows) for kind, rows in read.items()} == dict.fromkeys(kinds, 300)
    assert np.allclose([s.latitude for s in read["GGA"]], nav["lat_deg"], atol=1e-8)
    assert np.allclose([s.longitude for s in read["RMC"]], nav["lon_deg"], atol=1e-8)
    assert np.allclose([s.altitude for s in read["GGA"]], nav["h_msl_m"], atol=0.0051)
    assert np.allclose([float(s.geo_sep) for s in read["GGA"]], nav["geoid_m"], atol=0.0051)
    assert read["RMC"][0].datetime == FIRST_UTC
    assert read["RMC"][-1].datetime == FIRST_UTC + dt.timedelta(seconds=299)
    assert read["GGA"][0].timestamp == FIRST_UTC.timetz()
    assert np.allclose([float(s.heading) for s in read["HDT"]], nav["heading_deg"], atol=0.0051)
    speed = np.hypot(nav["vn_mps"], nav["ve_mps"])
    assert np.allclose([float(s.spd_over_grnd_kmph) / 3.6 for s in read["VTG"]], speed, atol=2e-4)
    assert np.allclose([float(s.spd_over_grnd) * 1852.0 / 3600.0 for s in read["RMC"]], speed, atol=3e-4)
    course = np.degrees(np.arctan2(nav["ve_mps"], nav["vn_mps"]))
    difference = np.array([float(s.true_course) for s in read["RMC"]]) - course
    assert np.allclose((difference + 180.0) % 360.0 - 180.0, 0.0, atol=0.0051)
    assert np.allclose([float(s.std_dev_altitude) for s in read["GST"]], nav["sd_d_m"], atol=6e-4)


def test_nmea_says_dead_reckoning_while_no_satellite_is_used() -> None:
    read = sentences(run_with_outage())

    quality = np.array([s.gps_qual for s in read["GGA"]])
    assert (quality[OUTAGE][2:] == 6).all()  # a GNSS epoch is not missing before 2.5 intervals
    assert (np.delete(quality, range(*OUTAGE.indices(300))) == 1).all()
    assert {s.mode_indicator for s in read["RMC"][OUTAGE][2:]} == {"E"}
    assert read["GGA"][130].horizontal_dil == ""
    assert int(read["GGA"][130].num_sats) == 0


def test_nmea_leaves_heading_and_course_empty_while_they_are_not_known() -> None:
    run = made_run(seconds=4.0)
    run.nav.loc[0, "n_hypotheses"] = 6
    run.nav.loc[1, "sd_yaw_deg"] = 80.0
    run.nav.loc[2, ["vn_mps", "ve_mps"]] = 0.01

    read = sentences(run)

    assert [s.heading is None for s in read["HDT"]] == [True, True, False, False]
    assert [s.true_course is None for s in read["RMC"]] == [False, False, True, False]


def test_nmea_of_the_other_hemispheres_and_of_full_minutes() -> None:
    run = made_run(seconds=3.0)
    run.nav["lat_deg"] = [-0.5, 59.99999999999, -89.9999999999]
    run.nav["lon_deg"] = [-179.99999999999, -0.1, 9.99999999999]

    read = sentences(run)["GGA"]

    assert np.allclose([s.latitude for s in read], run.nav["lat_deg"], atol=1e-8)
    assert np.allclose([s.longitude for s in read], run.nav["lon_deg"], atol=1e-8)
    assert (read[1].lat, read[1].lat_dir, read[0].lon) == ("6000.000000", "N", "18000.000000")


def test_dilution_is_that_of_least_squares_with_a_clock_for_each_system() -> None:
    run = made_run(seconds=3.0)
    run.satellites["state"] = words(np.arange(24) // 8 % 2, ["used_for_start", "tracked"])
    names = ["G01", "G02", "G03", "G04", "E05", "E06", "E07", "E08"]
    run.satellites["sv"] = words(np.tile(np.arange(8), 3), names)

    found = solution(run).hdop

    first = run.satellites[:8]
    az, el = np.radians(first["az_deg"]), np.radians(first["el_deg"])
    galileo = first["sv"].astype(str).str.startswith("E").to_numpy(float)
    H = np.column_stack(
        [-np.cos(el) * np.cos(az), -np.cos(el) * np.sin(az), np.sin(el), 1 - galileo, galileo]
    )
    Q = np.linalg.inv(H.T @ H)
    assert found == pytest.approx(np.sqrt(Q[0, 0] + Q[1, 1]), rel=1e-9)


# ------------------------------------------------------------------------------------------------------ SBET

SBET = np.dtype([(name, "<f8") for name in FIELDS])
# PDAL, test/unit/io/SbetReaderTest.cpp: the two records of its sample, 5 ms apart
PUBLISHED_TEXT = (
    """1.516310028360710e+05 5.680211852972264e-01 -2.041654392303940e+00 1.077152953296560e+02
    -2.332420866600025e+00 -3.335067504871401e-01 -3.093961631767838e-02 -2.813407149321339e-02
    -2.429905393889139e-02 3.046773230278662e+00 -2.198414736922658e-02 7.859639737752390e-01
    7.849084719295495e-01 -2.978807916450262e-01 6.226807982589819e-05 9.312162756440178e-03
    7.217812320996525e-02""",
    """1.516310078318641e+05 5.680211834722869e-01 -2.041654392034053e+00 1.077151424357507e+02
    -2.336228229691271e+00 -3.324663118952635e-01 -3.022948961008987e-02 -2.813856631423094e-02
    -2.425215669392169e-02 3.047131105236811e+00 -2.198416007932108e-02 8.397590491636475e-01
    3.252165276637165e-01 -1.558883225990844e-01 8.379685112283802e-04 7.372886784718076e-03
    7.179027672314571e-02""",
)
PUBLISHED = np.array([tuple(map(float, text.split())) for text in PUBLISHED_TEXT], SBET)


def displacement_mps(records: np.ndarray) -> tuple[float, float, float]:
    """Return north, east, up velocity from the places of two records (radii of WGS-84 at 32.5 degrees north)."""
    dt_s, lat = np.diff(records["time_s"])[0], records["lat_rad"][0]
    north = np.diff(records["lat_rad"])[0] * 6.3539e6
    east = np.diff(records["lon_rad"])[0] * 6.3845e6 * np.cos(lat)
    return north / dt_s, east / dt_s, np.diff(records["h_m"])[0] / dt_s


def test_axes_of_sbet_are_those_by_which_a_published_sample_moves() -> None:
    x, y, up = (PUBLISHED[name].mean() for name in ("v_north_mps", "v_west_mps", "v_up_mps"))
    wander = PUBLISHED["wander_angle_rad"].mean()

    # turned by the wander angle, its first two axes point north and west
    north = x * np.cos(wander) - y * np.sin(wander)
    west = x * np.sin(wander) + y * np.cos(wander)

    moved = displacement_mps(PUBLISHED)
    assert (north, -west, up) == pytest.approx(moved, abs=0.025)  # of single steps of 5 ms
    rates = np.diff(PUBLISHED["heading_rad"])[0] / np.diff(PUBLISHED["time_s"])[0]
    assert PUBLISHED["rate_z_radps"].mean() == pytest.approx(
        rates, abs=1e-3
    )  # down: to the right is positive


def test_sbet_has_every_row_in_its_published_record(tmp_path: Path) -> None:
    run = made_run()

    read = np.fromfile(export_run(run, tmp_path / "run.sbet"), SBET)

    nav = run.nav
    assert read.itemsize == 136 and len(read) == 300
    assert np.array_equal(read["time_s"], nav["time_s"])
    assert np.allclose(np.degrees(read["lat_rad"]), nav["lat_deg"], rtol=0.0, atol=1e-13)
    assert np.allclose(np.degrees(read["lon_rad"]), nav["lon_deg"], rtol=0.0, atol=1e-13)
    assert np.array_equal(read["h_m"], nav["h_m"])
    assert np.array_equal(read["v_north_mps"], nav["vn_mps"])
    assert np.array_equal(read["v_west_mps"], -nav["ve_mps"])
    assert np.array_equal(read["v_up_mps"], -nav["vd_mps"])
    assert np.allclose(np.degrees(read["heading_rad"]), nav["yaw_deg"] % 360.0)
    assert not read["wander_angle_rad"].any()


def test_sbet_of_a_flat_turn_has_its_rate_and_centripetal_acceleration(tmp_path: Path) -> None:
    run = made_run(seconds=60.0, rate_hz=20.0)
    nav, angle = run.nav, 0.1 * (run.nav["time_s"] - START_S)
    nav[["roll_deg", "pitch_deg", "vd_mps"]] = 0.0
    nav["vn_mps"], nav["ve_mps"] = 20.0 * np.cos(angle), 20.0 * np.sin(angle)
    nav["yaw_deg"] = (np.degrees(angle) + 180.0) % 360.0 - 180.0

    read = np.fromfile(export_run(run, tmp_path / "run.sbet"), SBET)[1:-1]  # ends have one side only

    assert read["rate_z_radps"] == pytest.approx(0.1, abs=1e-9)
    assert read["accel_y_mps2"] == pytest.approx(2.0, abs=1e-4)  # v w, to the right
    assert np.abs([read[n] for n in ("rate_x_radps", "rate_y_radps", "accel_z_mps2")]).max() < 1e-9


def test_accuracy_file_of_sbet_has_the_sigmas(tmp_path: Path) -> None:
    run = made_run()

    read = np.fromfile(export_run(run, tmp_path / "run.smrmsg"), [(name, "<f8") for name in ACCURACY_FIELDS])

    assert read.itemsize == 80 and len(read) == 300
    assert np.array_equal(read["sd_d_m"], run.nav["sd_d_m"])
    assert np.allclose(read["sd_heading_arcmin"] / 60.0, run.nav["sd_yaw_deg"])


# ---------------------------------------------------------------------------------------------- MATLAB, NetCDF


def test_mat_has_tables_units_and_times_for_matlab(tmp_path: Path) -> None:
    run = made_run()

    read = loadmat(export_run(run, tmp_path / "run.mat"), simplify_cells=True)

    for name, column in run.nav.items():
        assert np.array_equal(read["nav"][name], column), name
    assert read["nav"]["posix_s"][0] == FIRST_UTC.timestamp()
    assert read["units"]["vn_mps"] == "m/s" and read["gps_week"] == 2385
    assert list(read["events"]["kind"]) == run.events["kind"].tolist()
    assert run.errors is not None
    assert np.array_equal(read["errors"]["d_n_m"], run.errors["d_n_m"])
    assert as_mat(run) == as_mat(run)


def test_netcdf_has_utc_units_and_the_conventions_attributes(tmp_path: Path) -> None:
    run = made_run(rate_hz=20.0, seconds=20.0)

    with xr.open_dataset(export_run(run, tmp_path / "run.nc"), engine="scipy") as read:
        nav = run.nav_with(utc=True, sea_level=True, heading=True)
        for name, column in nav.items():
            assert np.array_equal(read[name], column), name
        assert np.abs(
            read["time"].to_numpy() - nav.index.tz_localize(None).to_numpy()
        ).max() <= np.timedelta64(15, "ns")
        assert read["lat_deg"].attrs["standard_name"] == "latitude"
        assert read["vn_mps"].attrs["units"] == "m s-1" and read["n_used"].attrs["units"] == "1"
        assert read["h_msl_m"].attrs["standard_name"] == "altitude"
        assert {"lat_deg", "lon_deg", "h_m", "time"} <= set(read.coords)
        assert read.attrs["Conventions"].startswith("CF-") and read.attrs["gps_week"] == 2385
        assert read["trajectory"].item().startswith("made")


# --------------------------------------------------------------------------------------------- CSV, GPX, KML


def test_csv_begins_with_utc_and_every_column_has_a_meaning(tmp_path: Path) -> None:
    read = pd.read_csv(export_run(made_run(), tmp_path / "nav.csv"), parse_dates=["utc"])

    assert read["utc"][1] == FIRST_UTC + dt.timedelta(seconds=1)
    assert (read["gps_week"] == 2385).all()
    assert np.allclose(read["h_msl_m"] + read["geoid_m"], read["h_m"])
    assert {"heading_deg", "h_msl_m", "time_s"} <= set(read.columns)
    assert undescribed(SHEETS["export"], undescribed(SHEETS["nav"], read.columns)) == []


def test_gpx_has_heights_above_the_sea() -> None:
    run = made_run()

    points = gpxpy.parse(as_gpx(run).decode()).tracks[0].segments[0].points

    nav = run.nav_with(sea_level=True)
    assert np.allclose([p.elevation for p in points], nav["h_msl_m"], atol=6e-4)
    assert np.allclose([p.geoid_height for p in points], nav["geoid_m"], atol=6e-4)
    assert np.allclose([p.latitude for p in points], nav["lat_deg"], atol=6e-10)
    assert points[0].time == FIRST_UTC


def test_kml_has_the_track_at_its_height_over_time_and_on_the_ground() -> None:
    run = made_run()
    run.nav["h_m"] += 1500.0

    root = ET.fromstring(as_kml(run))

    marks = {p.findtext(f"{KML}name"): p for p in root.iter(f"{KML}Placemark")}
    assert marks["track"].findtext(f".//{KML}altitudeMode") == "absolute"
    assert marks["track on the ground"].findtext(f".//{KML}altitudeMode") == "clampToGround"
    track = marks["track over time"].find(f"{GX}Track")
    assert track is not None and track.findtext(f"{KML}altitudeMode") == "absolute"
    places = [[float(v) for v in (e.text or "").split()] for e in track.findall(f"{GX}coord")]
    nav = run.nav_with(sea_level=True)
    assert np.allclose(places, nav[["lon_deg", "lat_deg", "h_msl_m"]], atol=6e-4)
    times = [dt.datetime.fromisoformat(e.text or "") for e in track.findall(f"{KML}when")]
    assert times == [FIRST_UTC + dt.timedelta(seconds=k) for k in range(300)]
