"""GNSS logs of both forms: each row reaches the table or is accounted for by an event."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insgnss.config.flight import GnssColumns
from insgnss.errors import ColumnError, MissingFileError, UnitsError
from insgnss.log.gnss_csv import read_gnss
from insgnss.log.gnss_rows import epochs
from insgnss.log.satellites import normalised_name
from insgnss.tables import GnssTable
from tests.log.writing import GNSS_HEADER, WEEK, gnss_config, gnss_lines, write_gnss, write_lines

WEEK_NS = WEEK * 604_800 * 10**9
STATES = "sat_x_m,sat_y_m,sat_z_m,sat_vx_mps,sat_vy_mps,sat_vz_mps,sat_clock_m,sat_clock_drift_mps"


def read(folder: Path, lines: list[str], **settings: object) -> tuple[GnssTable, list[str]]:
    table, events = read_gnss(gnss_config(write_gnss(folder / "gnss.csv", lines), **settings), WEEK)
    return table, [event.kind for event in events]


def names(table: GnssTable) -> list[str]:
    return [table.sv_names[index] for index in table.sv]


def test_plain_log_is_read_row_by_row(tmp_path: Path) -> None:
    table, events = read(tmp_path, gnss_lines())
    assert events == []
    assert names(table)[:5] == ["G05", "G07", "G13", "G30", "G05"]
    assert table.signal_names == ("C1C",)
    assert table.t_ns[4] - table.t_ns[0] == 10**9 and table.t_ns[0] == WEEK_NS + 1000 * 10**9
    assert table.pseudorange_m[1] == 2.21e7
    assert table.doppler_hz[0] == pytest.approx(600.0 / 0.190293672798365, abs=1e-4)
    assert np.isnan(table.range_rate_mps).all() and (table.cn0_dbhz == 45.0).all()
    assert table.sat is None and not len(table.bad_cells)


@pytest.mark.parametrize(
    ("written", "name"),
    [
        ("G5", "G05"),
        ("g05", "G05"),
        ("G 5", "G05"),
        (" E11 ", "E11"),
        ("G-5", "G05"),
        ("S120", "S20"),
        ("R24", "R24"),
        ("GPS05", "G05"),
        ("GPS 5", "G05"),
        ("gps-05", "G05"),
        ("Galileo_11", "E11"),
        ("QZSS 193", "J01"),
        ("BDS21", "C21"),
    ],
)
def test_satellites_are_named_as_in_rinex_3(written: str, name: str) -> None:
    assert normalised_name(written) == name


@pytest.mark.parametrize(
    "written", ["", "5", "G", "G0", "G99", "X05", "G5a", "GP5", "GPS", "PRN5", "nan", "é5"]
)
def test_what_names_no_satellite_is_not_guessed(written: str) -> None:
    assert normalised_name(written) is None


def test_rows_of_unknown_satellites_are_refused_with_one_event_each_name(tmp_path: Path) -> None:
    lines = gnss_lines()
    lines[3] = lines[3].replace("G30", "Q30")
    lines[7] = lines[7].replace("G30", "Q30")
    lines[11] = lines[11].replace("G30", "??")
    table, events = read(tmp_path, lines)
    assert len(table.t_ns) == len(lines) - 3
    assert events == ["bad_row", "bad_row"]


def test_column_without_any_satellite_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ColumnError, match="G05, E11"):
        read(tmp_path, [line.replace(",G", ",") for line in gnss_lines()])


def test_empty_pseudorange_or_doppler_is_no_defect(tmp_path: Path) -> None:
    lines = gnss_lines()
    lines[0] = "1000.000,G05,C1C,,123.0,45.0"
    lines[1] = "1000.000,G07,C1C,2.2e7,,"
    table, events = read(tmp_path, lines)
    assert len(table.t_ns) == len(lines) and events == []
    assert np.isnan(table.pseudorange_m[0]) and table.doppler_hz[0] == 123.0
    assert np.isnan(table.doppler_hz[1]) and np.isnan(table.cn0_dbhz[1])
    assert not len(table.bad_cells)


def test_unreadable_range_keeps_its_row_and_is_listed(tmp_path: Path) -> None:
    lines = gnss_lines()
    lines[2] = "1000.000,G13,C1C,abc,123.0,45.0"
    lines[5] = "1001.000,G07,C1C,2.2e7,inf,45.0"
    lines[6] = "1001.000,G13,C1C,2.2e7,1.0,loud"
    table, events = read(tmp_path, lines)
    assert len(table.t_ns) == len(lines)
    assert table.bad_cells.tolist() == [2, 5]
    assert np.isnan(table.pseudorange_m[2]) and np.isnan(table.doppler_hz[5]) and np.isnan(table.cn0_dbhz[6])
    assert events == ["bad_cell"] * 3


def test_rows_out_of_order_are_sorted_and_bad_cells_follow(tmp_path: Path) -> None:
    lines = gnss_lines(6)
    lines[8] = "1002.000,G05,C1C,bad,0.0,45.0"
    shuffled = lines[12:] + lines[:12]
    table, events = read(tmp_path, shuffled)
    assert (np.diff(table.t_ns) >= 0).all()
    assert sorted(events) == ["bad_cell", "gnss_time_order"]
    assert table.bad_cells.tolist() == [8] and names(table)[8] == "G05"
    assert names(table)[:4] == ["G05", "G07", "G13", "G30"]


def test_satellite_twice_in_an_epoch_stays_for_the_ledger(tmp_path: Path) -> None:
    lines = gnss_lines()
    table, _ = read(tmp_path, [lines[0], *lines])
    assert len(table.t_ns) == len(lines) + 1


def test_missing_signal_column_is_assumed_and_told(tmp_path: Path) -> None:
    rows = ["1000.0,G05,2.2e7", "1000.0,E11,2.3e7", "1000.0,C21,2.4e7"]
    path = write_lines(tmp_path / "gnss.csv", ["time_s,sv,pseudorange_m", *rows])
    table, events = read_gnss(gnss_config(path), WEEK)
    assert [table.signal_names[index] for index in table.signal] == ["C1C", "C1C", "C2I"]
    assert sorted(event.kind for event in events) == ["no_range_rate", "signal_assumed"]


@pytest.mark.parametrize(("written", "code"), [("C1C", "C1C"), ("L1C", "C1C"), ("1c", "C1C"), ("C1M", "C1M")])
def test_signals_are_named_by_their_pseudorange_code(tmp_path: Path, written: str, code: str) -> None:
    table, _ = read(tmp_path, [line.replace("C1C", written) for line in gnss_lines()])
    assert table.signal_names[table.signal[0]] == code


@pytest.mark.parametrize("written", ["L1 C/A", "GPS_L1", "C2I"])
def test_log_whose_signals_all_have_unknown_names_is_an_error(tmp_path: Path, written: str) -> None:
    with pytest.raises(
        ColumnError, match=f"gnss.csv:2, column 'signal': unknown signal '{written}'"
    ) as caught:
        read(tmp_path, [line.replace("C1C", written) for line in gnss_lines()])
    told = "system G has C2L or C2X" if written == "C2I" else "write RINEX codes such as C1C"
    assert told in caught.value.advice
    assert "gnss.signal_codes = { " in caught.value.advice


def test_signals_with_names_of_their_own_are_what_the_flight_file_says(tmp_path: Path) -> None:
    lines = gnss_lines()
    lines = [line.replace("C1C", "L1 C/A" if k % 2 else "B1") for k, line in enumerate(lines)]
    path = write_lines(tmp_path / "gnss.csv", [GNSS_HEADER, *lines])
    declared = {"L1 C/A": "C1C", "B1": "C1W"}
    table, events = read_gnss(gnss_config(path, signal_codes=declared), WEEK)
    assert [table.signal_names[index] for index in table.signal[:4]] == ["C1W", "C1C"] * 2 and events == []

    table, events = read_gnss(gnss_config(path, signal_codes={"L1 C/A": "C1C"}), WEEK)
    assert [event.kind for event in events] == ["unknown_signal"]
    assert (
        "unknown signal 'B1'" in events[0].detail and "gnss.signal_codes = { B1 = '...' }" in events[0].detail
    )


@pytest.mark.parametrize(
    ("settings", "why"),
    [
        ({"signal_codes": {"L1": "L1C"}}, "signal_codes"),
        ({"signal_codes": {"L1": "C1C"}, "columns": {"signal": "none"}}, "columns.signal"),
    ],
)
def test_codes_of_signals_that_say_nothing_are_refused(settings: dict[str, object], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        gnss_config(Path("gnss.csv"), **settings)


def test_unknown_signal_of_some_rows_is_an_event_and_stays_for_the_ledger(tmp_path: Path) -> None:
    lines = gnss_lines()
    lines[0], lines[4] = (line.replace("C1C", "L1 C/A") for line in (lines[0], lines[4]))
    path = write_lines(tmp_path / "gnss.csv", [GNSS_HEADER, *lines])
    table, events = read_gnss(gnss_config(path), WEEK)
    assert len(table.t_ns) == len(lines) and table.signal_names[table.signal[0]] == "L1 C/A"
    assert [event.kind for event in events] == ["unknown_signal"]
    assert "unknown signal 'L1 C/A' in 2 row(s)" in events[0].detail


def test_code_that_another_system_alone_has_is_told_with_the_codes_of_the_band(tmp_path: Path) -> None:
    lines = gnss_lines()
    sv = lines[0].split(",")[1]
    lines = [line.replace(sv, f"C{sv[1:]}").replace("C1C", "C5Q") if sv in line else line for line in lines]
    path = write_lines(tmp_path / "gnss.csv", [GNSS_HEADER, *lines])
    _, events = read_gnss(gnss_config(path), WEEK)
    (event,) = (event for event in events if event.kind == "unknown_signal")
    count = sum(sv in line for line in gnss_lines())
    assert (
        f"'C5Q' in {count} row(s) of system C, not used: system C has C5P or C5X or C5D in this"
        in event.detail
    )


def test_empty_signal_cells_are_assumed(tmp_path: Path) -> None:
    lines = gnss_lines()
    lines[0] = lines[0].replace("C1C", "")
    table, events = read(tmp_path, lines)
    assert table.signal_names[table.signal[0]] == "C1C" and events == ["signal_assumed"]


def with_states(lines: list[str], columns: str = STATES) -> list[str]:
    values = ",".join(str(1e6 + i) for i in range(len(columns.split(","))))
    return [f"{GNSS_HEADER},{columns}", *(f"{line},{values}" for line in lines)]


def test_satellite_states_in_the_row_are_read(tmp_path: Path) -> None:
    path = write_lines(tmp_path / "gnss.csv", with_states(gnss_lines()))
    table, _ = read_gnss(gnss_config(path), WEEK)
    assert table.sat is not None and table.sat.shape == (80, 8)
    assert table.sat[3].tolist() == [1e6 + i for i in range(8)]


def test_a_part_of_the_satellite_states_is_an_error_without_navigation(tmp_path: Path) -> None:
    path = write_lines(tmp_path / "gnss.csv", with_states(gnss_lines(), STATES.rsplit(",", 1)[0]))
    with pytest.raises(ColumnError) as caught:
        read_gnss(gnss_config(path), WEEK)
    assert caught.value.column == "sat_clock_drift_mps"
    table, events = read_gnss(gnss_config(path, navigation=["nav.rnx"]), WEEK)
    assert table.sat is None
    assert [event.kind for event in events] == ["satellite_states_not_used"]
    assert "'sat_clock_drift_mps'" in events[0].detail


@pytest.mark.parametrize("orbits", [{"navigation": ["nav.rnx"]}, {"precise": ["a.sp3"]}])
def test_states_of_one_file_of_two_give_way_to_the_navigation_files(
    tmp_path: Path, orbits: dict[str, object]
) -> None:
    a = write_lines(tmp_path / "a.csv", with_states(gnss_lines()[:40]))
    b = write_gnss(tmp_path / "b.csv", gnss_lines()[40:])
    table, events = read_gnss(gnss_config(a, b, **orbits), WEEK)
    assert table.sat is None and len(table.t_ns) == 80
    assert [event.kind for event in events] == ["satellite_states_not_used"]
    assert "b.csv" in events[0].detail
    alone, events = read_gnss(gnss_config(a, b), WEEK)
    assert alone.sat is not None and np.isnan(alone.sat[40:]).all() and np.isfinite(alone.sat[:40]).all()
    assert [event.kind for event in events] == ["satellite_states_missing"]


@pytest.mark.parametrize(
    ("columns", "missing", "nearest"),
    [
        ({"doppler": "dopler_hz"}, "dopler_hz", "nearest: 'doppler_hz'"),
        ({"cn0": "snr_dbhz"}, "snr_dbhz", "nearest: 'cn0_dbhz'"),
        ({"sigma_pseudorange": "sig"}, "sig", "nearest: 'signal'"),
        ({"sat_position": ["X", "Y", "Z"]}, "X", "the file has"),
        ({"signal": "code"}, "code", "the file has"),
    ],
)
def test_optional_column_that_the_flight_file_names_must_be_there(
    tmp_path: Path, columns: dict[str, object], missing: str, nearest: str
) -> None:
    with pytest.raises(ColumnError) as caught:
        read(tmp_path, gnss_lines(), columns=columns)
    assert caught.value.column == missing and nearest in caught.value.advice


def test_usual_columns_that_are_absent_stay_silent_even_when_written_out(tmp_path: Path) -> None:
    usual = GnssColumns().model_dump()
    assert read(tmp_path, gnss_lines(), columns=usual)[1] == []


def test_sigmas_and_range_rates_are_read_where_logged(tmp_path: Path) -> None:
    header = "time_s,sv,pseudorange_m,range_rate_mps,sigma_pseudorange_m,sigma_range_rate_mps"
    path = write_lines(tmp_path / "gnss.csv", [header, "1000,G05,2.2e7,-5.5,0,-1", "1001,G05,2.2e7,-5.5,1,1"])
    table, events = read_gnss(gnss_config(path), WEEK)
    assert table.range_rate_mps[0] == -5.5 and np.isnan(table.doppler_hz[0])
    assert table.sigma_pseudorange_m is not None and table.sigma_pseudorange_m[0] == 0.0
    assert table.sigma_range_rate_mps is not None and table.sigma_range_rate_mps[0] == -1.0
    assert [event.kind for event in events] == ["signal_assumed", "gnss_bad_sigma", "gnss_bad_sigma"]


def test_several_files_share_one_list_of_satellites(tmp_path: Path) -> None:
    lines = gnss_lines()
    a = write_gnss(tmp_path / "a.csv", lines[40:])
    b = write_gnss(tmp_path / "b.csv", [line.replace("G05", "E05") for line in lines[:40]])
    table, events = read_gnss(gnss_config(a, b), WEEK)
    assert [event.kind for event in events] == ["gnss_time_order"]
    assert names(table)[:2] == ["E05", "G07"] and names(table)[40] == "G05"
    t_ns, starts = epochs(table)
    assert len(t_ns) == 20 and np.array_equal(starts, np.arange(0, 81, 4))


@pytest.mark.parametrize("factor", [1e-3, 1.0 / 299_792_458.0, 1e3 / 299_792_458.0])
def test_pseudoranges_in_another_unit_are_an_error(tmp_path: Path, factor: float) -> None:
    lines = []
    for line in gnss_lines():
        cells = line.split(",")
        cells[3] = repr(float(cells[3]) * factor)
        lines.append(",".join(cells))
    with pytest.raises(UnitsError, match="look like"):
        read(tmp_path, lines)


def test_pseudorange_column_of_words_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ColumnError, match="holds no numbers"):
        read(
            tmp_path,
            gnss_lines(),
            columns={"pseudorange": "signal", "signal": "cn0_dbhz", "cn0": "pseudorange_m"},
        )


def test_missing_pseudorange_column_is_named(tmp_path: Path) -> None:
    with pytest.raises(ColumnError) as caught:
        read(tmp_path, gnss_lines(), columns={"pseudorange": "psr"})
    assert caught.value.column == "psr" and "pseudorange_m" in caught.value.advice


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError):
        read_gnss(gnss_config(tmp_path / "gnss.csv"), WEEK)


@pytest.mark.parametrize("written", ["0", "-3"])
def test_sigmas_of_zero_or_below_are_told_and_a_column_of_them_is_refused(
    tmp_path: Path, written: str
) -> None:
    header, rows = f"{GNSS_HEADER},sigma_pseudorange_m", gnss_lines()
    path = write_lines(tmp_path / "gnss.csv", [header, *(f"{row},{written}" for row in rows)])
    with pytest.raises(ColumnError, match="column 'sigma_pseudorange_m': holds no sigma above zero"):
        read_gnss(gnss_config(path), WEEK)
    some = [f"{row},{written if k < 3 else '0.8'}" for k, row in enumerate(rows)]
    _, events = read_gnss(gnss_config(write_lines(path, [header, *some])), WEEK)
    (event,) = events
    assert event.kind == "gnss_bad_sigma" and f"3 of {len(rows)} sigmas are not above zero" in event.detail
