"""A flight file and its logs: paths, names, hashes, and what the logs must agree on."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

import numpy as np
import pytest

from insgnss.config.flight import FlightConfig
from insgnss.errors import ConfigError, MissingFileError, ModelError, NavigationDataError, TimeError
from insgnss.log.checks.each_log import read_and_check
from insgnss.log.flight import Flight, FlightLogs
from insgnss.runs.point import read_logs
from tests.log.test_rinex_navigation import HEADER as NAV_HEADER
from tests.log.test_rinex_navigation import message
from tests.log.writing import WEEK, gnss_lines, rest, write_gnss, write_imu

FLIGHTS = Path(__file__).parents[1] / "flights"
FLIGHT = f"""\
gps_week = {WEEK}

[imu]
files = ["imu.csv"]
grade = "tactical"

[gnss]
files = ["gnss.csv"]
navigation = ["nav.rnx"]
lever_arm_m = [0.0, 0.0, 0.0]
"""


@pytest.fixture
def folder(tmp_path: Path, rng: np.random.Generator) -> Path:
    write_imu(tmp_path / "imu.csv", rest(rng, n=2000))
    write_gnss(tmp_path / "gnss.csv", gnss_lines())
    (tmp_path / "nav.rnx").write_text(NAV_HEADER + message(toc="2023 06 25 00 00 00", toe=0.0))
    (tmp_path / "flight.toml").write_text(FLIGHT)
    return tmp_path


def read(folder: Path, old: str = "", new: str = "") -> FlightLogs:
    (folder / "flight.toml").write_text(FLIGHT.replace(old, new) if old else FLIGHT)
    return Flight.load(folder / "flight.toml").read()


def test_logs_are_read_from_paths_beside_the_flight_file(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir("/")
    flight = Flight.load(folder / "flight.toml")
    logs = flight.read()
    assert flight.name == "flight"
    assert len(logs.imu.t_ns) == 2000 and len(logs.gnss.t_ns) == 80
    assert logs.navigation is not None and logs.reference is None
    assert logs.events == []


def test_inertial_log_reference_and_sensor_may_share_a_file(folder: Path) -> None:
    header, *rows = (folder / "imu.csv").read_text().splitlines()
    more = ["1000.0" if k % 4 == 0 else "" for k in range(len(rows))]
    lines = [f"{header},lat_deg,lon_deg,h_m,pressure_hpa,temperature"]
    lines += [f"{row},45,7,300,{pressure},20" for row, pressure in zip(rows, more, strict=True)]
    (folder / "imu.csv").write_text("\n".join(lines) + "\n")
    sharing = '[reference]\nfile = "imu.csv"\n[[sensor]]\nkind = "barometer"\nfiles = ["imu.csv"]\n'

    logs = read(folder, "[gnss]", sharing + "[gnss]")

    assert len(logs.imu.t_ns) == 2000 and len(logs.sensors[0].t_ns) == 500
    assert logs.reference is not None and len(logs.reference.t_ns) == 2000
    told = {event.kind: event.detail for event in logs.events}
    assert sorted(event.kind for event in logs.events) == ["columns_not_read", "sensor_rows_without_reading"]
    assert told["columns_not_read"].endswith("further columns: temperature")


@pytest.mark.parametrize("empty", ["", "nan"])
def test_rows_of_several_logs_may_alternate_in_a_file(folder: Path, empty: str) -> None:
    """As a recorder writes them that has a column for each value of each sensor."""
    apart = read(folder)
    (header, *inertial), (names, *observed) = (
        (folder / name).read_text().splitlines() for name in ("imu.csv", "gnss.csv")
    )
    imu_cells, gnss_cells = (text.count(",") for text in (header, names))
    rows = [f"{row},{','.join([empty] * gnss_cells)},,," for row in inertial]
    for k, row in enumerate(observed):
        time, cells = row.split(",", 1)
        rows.insert(20 * k, f"{time},{','.join([empty] * imu_cells)},{cells},,,")
    rows[1::50] = [f"{row[:-3]},45,7,300" for row in rows[1::50]]
    columns = f"{header},{names.split(',', 1)[1]},lat_deg,lon_deg,h_m"
    (folder / "both.csv").write_text("\n".join([columns, *rows]) + "\n")
    (folder / "flight.toml").write_text(
        FLIGHT.replace("imu.csv", "both.csv").replace("gnss.csv", "both.csv")
        + '[reference]\nfile = "both.csv"\n'
    )

    logs = Flight.load(folder / "flight.toml").read()

    np.testing.assert_array_equal(logs.imu.t_ns, apart.imu.t_ns)
    np.testing.assert_array_equal(logs.imu.f_b, apart.imu.f_b)
    np.testing.assert_array_equal(logs.gnss.t_ns, apart.gnss.t_ns)
    np.testing.assert_array_equal(logs.gnss.pseudorange_m, apart.gnss.pseudorange_m)
    assert logs.reference is not None and len(logs.reference.t_ns) == 42
    told = [event.detail for event in logs.events if event.kind == "rows_of_other_logs"]
    assert {event.kind for event in logs.events} == {"rows_of_other_logs"}
    assert any("80 of 2080 rows left out: nothing in 'gyro_x'" in detail for detail in told)


def test_columns_that_another_log_of_the_flight_reads_are_not_told_as_unread(folder: Path) -> None:
    """The inertial log, that of GNSS and the base's in one file, each with a row for each sample."""
    imu, gnss = ((folder / name).read_text().splitlines() for name in ("imu.csv", "gnss.csv"))
    rows = [f"{a},{b.split(',', 1)[1]},{b.split(',')[3]},7" for a, b in zip(imu[1:81], gnss[1:], strict=True)]
    header = f"{imu[0]},{gnss[0].split(',', 1)[1]},base_range,note"
    (folder / "both.csv").write_text("\n".join([header, *rows]) + "\n")
    base = '[gnss.base]\nfiles = ["both.csv"]\nformat = "csv"\nlat_deg = 45.0\nlon_deg = 7.0\nh_m = 300.0\n'
    text = FLIGHT.replace("imu.csv", "both.csv").replace("gnss.csv", "both.csv")
    path = folder / "flight.toml"
    path.write_text(f'{text}{base}columns = {{ pseudorange = "base_range" }}\n')
    flight = Flight.load(path)

    events = [*read_logs(flight).events, *Flight.load(path).read().events]
    told = [event.detail for event in events if event.kind == "columns_not_read"]
    told += [found.text for found in read_and_check(flight)[0].findings if found.kind == "columns_not_read"]
    columns = [re.search("further columns: ([^;]*)", text) for text in told]
    assert len(told) == 7 and {found and found[1] for found in columns} == {"note"}


def test_files_of_further_antennas_share_the_columns_of_the_main_one() -> None:
    antenna = {"name": "left", "files": ["imu.csv"]}
    gnss = {"files": ["gnss.csv"], "columns": {"sv": "satellite"}}
    config = FlightConfig.model_validate(
        {"gnss": gnss, "attitude": {"clocks": "common", "antenna": [antenna]}}
    )
    assert "satellite" in config.columns_by_file()[Path("imu.csv")]


def test_rows_without_a_value_in_a_file_of_one_log_are_bad_rows(folder: Path) -> None:
    header, *rows = (folder / "imu.csv").read_text().splitlines()
    rows[100] = rows[100].split(",")[0] + "," * 6
    (folder / "imu.csv").write_text("\n".join([header, *rows]) + "\n")

    assert [event.kind for event in read(folder).events] == ["bad_row"]


def test_flight_file_may_be_named_relative_to_the_working_folder(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    assert len(Flight.load("flight.toml").read().gnss.t_ns) == 80


def test_hash_of_every_input_is_kept(folder: Path) -> None:
    hashes = read(folder).input_hashes
    names = {Path(name).name: digest for name, digest in hashes.items()}
    assert set(names) == {"flight.toml", "imu.csv", "gnss.csv", "nav.rnx"}
    assert names["imu.csv"] == hashlib.sha256((folder / "imu.csv").read_bytes()).hexdigest()


def test_patterns_and_obstructions_of_the_antennas_are_hashed_once_each(folder: Path) -> None:
    (folder / "wing.toml").write_text('frame = "body_forward_right_down"\nsource = "drawing"\n')
    antenna = '\n[[gnss.antenna]]\npattern = "cardioid"\n'
    text = FLIGHT + antenna + antenna + 'obstruction = "wing.toml"\n'
    (folder / "flight.toml").write_text(text)
    hashes = Flight.load(folder / "flight.toml").read().input_hashes
    names = [Path(name).name for name in hashes]
    assert sorted(names) == ["cardioid.csv", "flight.toml", "gnss.csv", "imu.csv", "nav.rnx", "wing.toml"]


def test_same_files_give_the_same_tables(folder: Path) -> None:
    a, b = read(folder), read(folder)
    assert a.imu.f_b.tobytes() == b.imu.f_b.tobytes() and a.gnss.t_ns.tobytes() == b.gnss.t_ns.tobytes()


def test_lever_arm_left_out_is_told_and_zero_is_not(folder: Path) -> None:
    assert [event.kind for event in read(folder).events] == []
    events = read(folder, "lever_arm_m = [0.0, 0.0, 0.0]", "").events
    assert [event.kind for event in events] == ["lever_arm_not_given"]


def test_no_satellite_positions_at_all_is_an_error(folder: Path) -> None:
    with pytest.raises(NavigationDataError, match=r"sat_x_m"):
        read(folder, 'navigation = ["nav.rnx"]', "")


@pytest.mark.parametrize(
    ("start_s", "fits"),
    [
        (1030.0, ["18 leap seconds", "time.scale"]),
        (985.0, ["18 leap seconds", "time.scale"]),
        (605_800.0, ["1 week(s) apart", "gps_week"]),
        (-1_208_600.0, ["2 week(s) apart", "gps_week"]),
        (8200.0, ["2 hour(s) apart", "time.offset_s"]),
        (5000.0, ["3981.0 s apart, which no whole weeks, hours or leap seconds explain"]),
        (900_000.0, ["898981.0 s apart, which no whole weeks, hours or leap seconds explain"]),
        (300_000.0, ["298981.0 s apart, which no whole weeks, hours or leap seconds explain"]),
    ],
)
def test_logs_without_overlap_print_both_spans_and_what_fits_the_numbers(
    folder: Path, rng: np.random.Generator, start_s: float, fits: list[str]
) -> None:
    write_imu(folder / "imu.csv", rest(rng, start_s=start_s))
    with pytest.raises(TimeError) as caught:
        read(folder)
    assert "1000.000 to 1019.000 s of week 2268" in caught.value.message
    assert f"{start_s:.3f} to" in caught.value.message
    assert all(words in caught.value.advice for words in fits)
    told = [w for w in ("leap seconds apart", "week(s)", "hour(s)") if w in caught.value.advice]
    assert told == [
        w for w in ("leap seconds apart", "week(s)", "hour(s)") if w in " apart ".join(fits) + " apart"
    ]


def test_inertial_log_that_counts_from_zero_is_told_as_such(folder: Path, rng: np.random.Generator) -> None:
    """Eleven hours and some: no calendar is at fault."""
    write_imu(folder / "imu.csv", rest(rng, start_s=0.01))
    lines = [f"{float(line.split(',', 1)[0]) + 40_000:.3f},{line.split(',', 1)[1]}" for line in gnss_lines()]
    write_gnss(folder / "gnss.csv", lines)
    with pytest.raises(TimeError) as caught:
        read(folder)
    assert "the IMU log seems to count from its own start" in caught.value.advice
    assert "imu.time.offset_s, about 41000" in caught.value.advice
    assert "week(s)" not in caught.value.advice


@pytest.mark.parametrize(
    ("kept", "told"),
    [
        (slice(500), ["15 GNSS epoch(s) after the inertial log ends"]),  # to 1004.99 s
        (slice(1050, None), ["11 GNSS epoch(s) before the inertial log begins"]),  # from 1010.5 s
        (slice(310, 490), ["4 GNSS epoch(s) before", "15 GNSS epoch(s) after"]),
        (slice(50, 1890), []),  # one epoch at either end is usual
    ],
)
def test_epochs_outside_the_inertial_log_are_an_event(
    folder: Path, rng: np.random.Generator, kept: slice, told: list[str]
) -> None:
    write_imu(folder / "imu.csv", rest(rng, n=2000)[kept])
    logs = read(folder)
    assert [event.kind for event in logs.events] == ["epochs_without_imu"] * len(told)
    assert all(words in event.detail for event, words in zip(logs.events, told, strict=True))


@pytest.mark.parametrize("name", ["imu.csv", "gnss.csv", "nav.rnx"])
def test_missing_log_is_named_with_the_nearest(folder: Path, name: str) -> None:
    (folder / name).rename(folder / ("old_" + name))
    with pytest.raises(MissingFileError) as caught:
        read(folder)
    assert caught.value.file is not None and caught.value.file.endswith(name)
    assert "old_" + name in caught.value.advice


def test_unknown_grade_is_an_error_when_loaded(folder: Path) -> None:
    with pytest.raises(ModelError, match="tactical"):
        read(folder, '"tactical"', '"tactcal"')


def test_grade_beside_the_flight_file_is_found(folder: Path) -> None:
    own = 'h0_s = 1e-20\nh_minus2_per_s = 1e-24\nsource = "here"\n'
    (folder / "house_clock.toml").write_text(own)
    (folder / "flight.toml").write_text(FLIGHT + 'oscillator = "house_clock"\n')
    assert Flight.load(folder / "flight.toml").oscillator.source == "here"


def test_unknown_key_is_an_error_with_its_line(folder: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        read(folder, "lever_arm_m", "lever_arm")
    assert caught.value.line == 10 and "'gnss.lever_arm_m'" in caught.value.advice


@pytest.mark.real_data
@pytest.mark.parametrize(
    ("name", "imu_rows", "gnss_rows", "epochs", "messages"),
    [
        ("xian", 27_280, 2_895, 427, 10),
        ("walk", 20_455, 36_271, 536, 11),
        ("instinct", 1_638, 5_857, 166, 34),
    ],
)
def test_real_flights_are_read_completely(
    name: str, imu_rows: int, gnss_rows: int, epochs: int, messages: int, data_root: Path
) -> None:
    logs = Flight.load(_placed(name, data_root)).read()
    assert len(logs.imu.t_ns) == imu_rows and len(logs.gnss.t_ns) == gnss_rows
    assert len(np.unique(logs.gnss.t_ns)) == epochs
    assert logs.navigation is not None and len(logs.navigation.ephemerides.sv_names) == messages
    assert (np.diff(logs.imu.t_ns) > 0).all() and np.isfinite(logs.imu.f_b).all()
    assert logs.imu.f_b[:, 2].mean() == pytest.approx(-9.8, abs=0.2)
    assert not {event.kind for event in logs.events} - {
        "imu_gap",
        "navigation_not_used",
        "epochs_without_imu",
    }


def _placed(name: str, data_root: Path) -> Path:
    """Return the flight file; skip where its relative paths do not lead to the real logs."""
    path = FLIGHTS / f"{name}.toml"
    if not Flight.load(path).config.imu.files[0].is_file():
        pytest.skip(
            f"{path.name} looks for its logs in shared/data beside the checkout, they lie in {data_root}"
        )
    return path
