"""What a flight file names of the satellites, read: every format, messages of receiver and files, base, products."""

from __future__ import annotations

import hashlib
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from insgnss.config.flight import Base, Gnss
from insgnss.config.log_table import TimeScale
from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.errors import ConfigError, InputError, MissingFileError, NavigationDataError
from insgnss.gnss.table_joining import joined
from insgnss.log.checks.each_log import read_and_check
from insgnss.log.flight import Flight
from insgnss.log.gnss_log import GnssLogs, merged, read_gnss_logs, read_receiver
from insgnss.tables import GnssTable, NavigationData
from tests.gnss.broadcast_sample import TOE_NS as SAMPLE_TOE_NS
from tests.gnss.broadcast_sample import navigation_table, navigation_text
from tests.gnss.glonass_sample import GLONASS_TEXT, glonass_navigation
from tests.gnss.precise_sample import antex_text, clock_text, sp3_text
from tests.log import android_generator, sbf_encoder, ubx_writing
from tests.log.test_flight import FLIGHT
from tests.log.test_rinex_navigation import HEADER as NAV_HEADER
from tests.log.test_rinex_navigation import message
from tests.log.test_sbf import gps_nav, signal
from tests.log.writing import WEEK, gnss_lines, rest, write_gnss, write_imu

DATA = Path(os.environ.get("INSGNSS_REAL_DATA", Path(__file__).parents[3] / "shared" / "data"))
WALK = DATA / "walk_boulder_20250828"
STATIC = DATA / "instinct_static_20230629"
FLIGHTS = Path(__file__).parents[1] / "flights"


def needs(folder: Path) -> None:
    if not folder.exists():
        pytest.skip(f"{folder.name} is not there")


def read(week: int = WEEK, **settings: object) -> GnssLogs:
    return read_gnss_logs(Gnss.model_validate(settings), week, Path("flight.toml"))


def names_of(gnss: GnssTable) -> set[str]:
    return {gnss.sv_names[s] for s in np.unique(gnss.sv)}


@pytest.fixture
def nav(tmp_path: Path) -> Path:
    path = tmp_path / "nav.rnx"
    path.write_text(NAV_HEADER + message(toc="2023 06 25 00 00 00", toe=0.0))
    return path


@pytest.fixture
def csv(tmp_path: Path) -> Path:
    return write_gnss(tmp_path / "gnss.csv", gnss_lines())


# ------------------------------------------------------------------------------------------------ formats


def test_ubx_file_brings_observations_and_messages() -> None:
    needs(WALK)
    logs = read(2381, files=[WALK / "raw" / "gnss_1730.ubx"], format="ubx")
    assert logs.navigation is not None and len(logs.navigation.ephemerides.sv_names) > 10
    assert {"G", "E"} <= {name[0] for name in names_of(logs.gnss)}
    assert np.all(np.diff(logs.gnss.t_ns) >= 0) and logs.gnss.carrier_cycles is not None
    # the messages are of the walk itself
    gap_s = np.abs(logs.navigation.ephemerides.toe_ns - logs.gnss.t_ns[0]) / NS_PER_S
    assert gap_s.min() < 7200.0


def test_navigation_files_are_used_beside_the_receivers_own_messages() -> None:
    needs(WALK)
    ubx, rinex = [WALK / "raw" / "gnss_1730.ubx"], [WALK / "nav_decoded_from_ubx.rnx"]
    own = read(2381, files=ubx, format="ubx").navigation
    both = read(2381, files=ubx, format="ubx", navigation=rinex).navigation
    files = read(2381, files=[WALK / "gnss_obs.csv"], navigation=rinex).navigation
    assert own is not None and both is not None and files is not None
    counts = [len(n.ephemerides.sv_names) for n in (own, files, both)]
    assert counts[2] == counts[0] + counts[1]


def test_rinex_file_needs_its_navigation_file() -> None:
    needs(STATIC)
    rinex = STATIC / "reach_m2_static_10min.23O.gz"
    logs = read(2268, files=[rinex], format="rinex", navigation=[STATIC / "nav_reach_m2.rnx"])
    assert {"G", "R", "E", "C"} <= {name[0] for name in names_of(logs.gnss)}
    with pytest.raises(NavigationDataError, match="no satellite positions"):
        read(2268, files=[rinex], format="rinex")


def sbf_file(folder: Path, name: str = "log.sbf", tow_s: float = 345_700.0, svid: int = 5) -> Path:
    channel = signal(0, 1575.42e6)
    blocks = [sbf_encoder.epoch(tow_s + k, [sbf_encoder.satellite(svid, [channel])]) for k in range(3)]
    path = folder / name
    path.write_bytes(gps_nav() + b"".join(blocks))
    return path


def test_sbf_file_brings_observations_and_messages(tmp_path: Path) -> None:
    logs = read(sbf_encoder.WEEK, files=[sbf_file(tmp_path)], format="sbf")
    assert names_of(logs.gnss) == {"G05"} and len(logs.gnss.t_ns) == 3
    assert logs.navigation is not None and logs.navigation.ephemerides.sv_names == ("G05",)


def test_android_log_takes_its_satellites_from_a_navigation_file(tmp_path: Path) -> None:
    path, rinex = tmp_path / "gnss_log.txt", tmp_path / "nav.rnx"
    # the phone's clock such that the log begins at the messages' own time
    start_ns = SAMPLE_TOE_NS + android_generator.BOOT_FULL_BIAS_NS
    sats = [android_generator.Sat(1, k, 70_000_000 + k, 1575.42e6, "C") for k in (5, 7, 8)]
    lines = "".join(android_generator.epoch(start_ns + k * NS_PER_S, sats) for k in range(3))
    path.write_text(android_generator.HEADER + lines)
    rinex.write_text(navigation_text())
    logs = read(files=[path], format="android", navigation=[rinex])
    assert names_of(logs.gnss) == {"G05", "G07", "G08"} and len(logs.gnss.t_ns) == 9
    with pytest.raises(NavigationDataError, match="no satellite positions"):
        read(files=[path], format="android")


def test_receivers_files_follow_each_other_in_time_whatever_their_order(tmp_path: Path) -> None:
    later, sooner = sbf_file(tmp_path, "b.sbf", 345_710.0, svid=7), sbf_file(tmp_path, "a.sbf")
    logs = read(sbf_encoder.WEEK, files=[later, sooner], format="sbf")
    t = logs.gnss.t_ns
    assert len(t) == 6 and np.all(np.diff(t) > 0)
    assert [logs.gnss.sv_names[s] for s in logs.gnss.sv] == ["G05"] * 3 + ["G07"] * 3
    assert logs.navigation is not None and len(logs.navigation.ephemerides.sv_names) == 2


def test_time_offset_moves_a_receivers_log_and_other_time_settings_are_told(tmp_path: Path) -> None:
    path = sbf_file(tmp_path)
    plain, moved = (
        read_receiver(Gnss(files=(path,), format="sbf", time=time), sbf_encoder.WEEK)
        for time in (TimeScale(), TimeScale(offset_s=-0.25))
    )
    assert np.all(moved.gnss.t_ns - plain.gnss.t_ns == -NS_PER_S // 4)
    assert [e.kind for e in moved.events] == [e.kind for e in plain.events]
    utc = read_receiver(Gnss(files=(path,), format="sbf", time=TimeScale(scale="utc")), sbf_encoder.WEEK)
    assert "time_settings_not_used" in {e.kind for e in utc.events}
    assert np.array_equal(utc.gnss.t_ns, plain.gnss.t_ns)


@pytest.mark.parametrize("name", ["ubx", "sbf", "android", "rinex"])
def test_file_of_another_kind_or_none_is_a_typed_error(tmp_path: Path, csv: Path, name: str) -> None:
    with pytest.raises(InputError):
        read(files=[csv], format=name)
    with pytest.raises(MissingFileError):
        read(files=[tmp_path / "none"], format=name)


def test_ubx_observations_without_messages_need_a_navigation_file(tmp_path: Path) -> None:
    path = tmp_path / "log.ubx"
    path.write_bytes(ubx_writing.rawx())
    with pytest.raises(NavigationDataError, match="no satellite positions"):
        read(ubx_writing.WEEK, files=[path], format="ubx")


# ------------------------------------------------------------------------------------------------ messages


def test_of_a_message_that_both_have_the_navigation_files_counts(tmp_path: Path) -> None:
    table = navigation_table(tmp_path)
    first = NavigationData(table, np.ones(8), 18, ionosphere={"galileo": np.ones(3)})
    second = NavigationData(
        replace(table, af0=table.af0 + 1e-6),
        np.zeros(8),
        17,
        ionosphere={"galileo": np.zeros(3), "beidou": np.ones(8)},
    )
    both = merged(first, second)
    n = len(table.sv_names)
    # the last of two with one reference time is taken, see ``ephemeris_choice``
    assert np.array_equal(both.ephemerides.af0[n:], table.af0)
    assert both.klobuchar is first.klobuchar and both.leap_seconds == 18
    assert (
        both.ionosphere["galileo"].tolist() == [1.0] * 3 and both.ionosphere["beidou"].tolist() == [1.0] * 8
    )


def test_coefficients_that_one_side_lacks_come_from_the_other(tmp_path: Path) -> None:
    table = navigation_table(tmp_path)
    bare, full = (
        NavigationData(table, None, None),
        replace(glonass_navigation(tmp_path), klobuchar=np.ones(8)),
    )
    for both in (merged(bare, full), merged(full, bare)):
        assert both.klobuchar is full.klobuchar and both.leap_seconds == full.leap_seconds
        assert both.state_vectors is not None and full.state_vectors is not None
        assert len(both.state_vectors.sv_names) == len(full.state_vectors.sv_names)


@pytest.mark.parametrize("weeks", [-1, 1, -1024])
def test_messages_of_another_week_are_a_typed_error(csv: Path, nav: Path, weeks: int) -> None:
    with pytest.raises(NavigationDataError, match="gps_week"):
        read(WEEK + weeks, files=[csv], navigation=[nav])


def test_empty_navigation_data_are_a_typed_error(csv: Path, nav: Path) -> None:
    nav.write_text(NAV_HEADER)
    with pytest.raises(NavigationDataError, match="no usable ephemeris"):
        read(files=[csv], navigation=[nav])


# ------------------------------------------------------------------------------------------------ flight file


def test_channels_of_the_flight_file_fill_what_the_log_does_not_tell(csv: Path, nav: Path) -> None:
    base = {"files": [csv], "format": "csv", "lat_deg": 48.0, "lon_deg": 9.0, "h_m": 300.0}
    logs = read(files=[csv], navigation=[nav], glonass_channels={"R07": -3, "R22": 6}, base=base)
    assert logs.gnss.glonass_channels == {"R07": -3, "R22": 6}
    assert logs.base is not None and logs.base.glonass_channels == {"R07": -3, "R22": 6}


@pytest.mark.parametrize("line", ["R7 = 1", "G07 = 1", "R07 = 9", "R07 = -8", "R07 = 1.5"])
def test_channel_of_no_satellite_or_out_of_range_is_named(tmp_path: Path, line: str) -> None:
    path = tmp_path / "flight.toml"
    path.write_text(FLIGHT + f"\n[gnss.glonass_channels]\n{line}\n")
    with pytest.raises(ConfigError) as caught:
        Flight.load(path)
    assert "glonass_channels" in str(caught.value)


BASE = """
[gnss.base]
files = ["../base/base.csv"]
format = "csv"
lat_deg = 48.0
lon_deg = 9.0
h_m = 300.0
"""


def test_every_file_is_found_beside_the_flight_file_and_hashed(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    folder, base = tmp_path / "flight", tmp_path / "base"
    folder.mkdir(), base.mkdir()
    write_imu(folder / "imu.csv", rest(rng, n=2000))
    write_gnss(folder / "gnss.csv", gnss_lines())
    write_gnss(base / "base.csv", gnss_lines())
    (folder / "nav.rnx").write_text(NAV_HEADER + message(toc="2023 06 25 00 00 00", toe=0.0))
    (folder / "orbit.sp3").write_text(sp3_text())
    (folder / "clock.clk").write_text(clock_text())
    (folder / "antennas.atx").write_text(antex_text())
    keys = 'precise = ["orbit.sp3", "clock.clk"]\nantennas = "antennas.atx"\n'
    (folder / "flight.toml").write_text(FLIGHT + keys + BASE)

    flight = Flight.load(folder / "flight.toml")
    gnss = flight.config.gnss
    assert gnss.precise == (folder / "orbit.sp3", folder / "clock.clk")
    assert gnss.antennas == folder / "antennas.atx"
    assert gnss.base is not None and gnss.base.files == (base / "base.csv",)
    logs = flight.read()
    hashes = {Path(name).name: digest for name, digest in logs.input_hashes.items()}
    assert set(hashes) == {
        *("flight.toml", "imu.csv", "gnss.csv", "nav.rnx"),
        *("orbit.sp3", "clock.clk", "antennas.atx", "base.csv"),
    }
    assert hashes["base.csv"] == hashlib.sha256((base / "base.csv").read_bytes()).hexdigest()
    assert logs.products is not None and logs.antennas is not None
    assert logs.base is not None and len(logs.base.t_ns) == len(logs.gnss.t_ns)


def test_base_station_needs_its_place() -> None:
    with pytest.raises(ValueError, match="lat_deg"):
        Base.model_validate({"files": ["base.rnx"]})


# ------------------------------------------------------------------------------------------------ joining


def test_tables_with_different_columns_and_names_become_one(csv: Path) -> None:
    one = read_receiver(Gnss(files=(csv,)), WEEK).gnss
    n = len(one.t_ns)
    two = replace(
        one,
        sv_names=("E01", *one.sv_names[1:]),
        signal_names=("C5Q",),
        sat=np.ones((n, 8)),
        lli=np.ones(n, np.int8),
        bad_cells=np.array([2]),
        glonass_channels={"R01": 1},
    )
    both = joined([one, two])
    assert [both.sv_names[s] for s in both.sv[n:]] == [two.sv_names[s] for s in two.sv]
    assert {both.signal_names[k] for k in both.signal[n:]} == {"C5Q"}
    assert both.sat is not None and np.isnan(both.sat[:n]).all() and np.all(both.sat[n:] == 1.0)
    assert both.lli is not None and both.lli.sum() == n
    assert both.bad_cells.tolist() == [*one.bad_cells, n + 2] and both.glonass_channels == {"R01": 1}
    assert both.sigma_pseudorange_m is None


# ------------------------------------------------------------------------------------------------ check


def test_check_of_a_receivers_own_file_finds_messages_and_rates_in_order() -> None:
    needs(WALK)
    report = read_and_check(Flight.load(FLIGHTS / "walk_ubx.toml"))[0]
    text = "\n".join(report.lines())
    assert report.severity != "error", text
    assert "range rates agree with the pseudoranges" in text
    assert "satellites with a current ephemeris per epoch" in text


def test_check_counts_state_vectors_as_messages_and_needs_channels(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    """Half an hour between messages, each good for a quarter: all rows of the four satellites are covered."""
    states = glonass_navigation(tmp_path).state_vectors
    assert states is not None
    start_s = (int(states.t_ns[0]) % NS_PER_WEEK) / NS_PER_S + 60.0
    week = int(states.t_ns[0]) // NS_PER_WEEK
    write_imu(tmp_path / "imu.csv", rest(rng, n=2000, start_s=start_s))
    lines = gnss_lines(satellites=("R03", "R08", "R14", "R24"))
    shift = start_s - float(lines[0].split(",")[0])
    moved = [[f"{float(c[0]) + shift:.3f}", *c[1:]] for c in (line.split(",") for line in lines)]
    write_gnss(tmp_path / "gnss.csv", [",".join(cells) for cells in moved])
    (tmp_path / "nav.rnx").write_text(GLONASS_TEXT)
    flight = FLIGHT.replace(f"gps_week = {WEEK}", f"gps_week = {week}")
    (tmp_path / "flight.toml").write_text(flight)

    text = "\n".join(read_and_check(Flight.load(tmp_path / "flight.toml"))[0].lines())
    assert "messages: 8 R" in text
    assert "current ephemeris per epoch: 4 to 4" in text
    assert "no current ephemeris for" not in text and "no frequency channel" not in text

    (tmp_path / "flight.toml").write_text(flight.replace('navigation = ["nav.rnx"]\n', ""))
    text = "\n".join(read_and_check(Flight.load(tmp_path / "flight.toml"))[0].lines())
    assert "no frequency channel of R03, R08, R14, R24" in text
