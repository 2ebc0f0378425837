"""RINEX navigation files, field by field against the text, and damaged ones."""

from __future__ import annotations

import datetime as dt
import gzip
from dataclasses import fields
from pathlib import Path

import ncompress
import numpy as np
import pytest

from insgnss.errors import NavigationDataError
from insgnss.gpstime import datetime_to_ns
from insgnss.log.detect import detect_format
from insgnss.log.rinex.navigation import read_navigation
from insgnss.tables import EphemerisTable
from tests.log.rinex_oracle import Message, navigation_messages
from tests.log.writing import tabbed

SETS = {
    "instinct_static_20230629": "nav_reach_m2.rnx",
    "walk_boulder_20250828": "nav_decoded_from_ubx.rnx",
    "xian_psins_20211108": "nav_from_mat.rnx",
}
# Place of each field among the numbers of a message, RINEX 3.05 tables A6, A8, A14
PLACES = {
    **{"af0": 0, "af1": 1, "af2": 2, "issue": 3, "crs": 4, "delta_n": 5, "m0": 6, "cuc": 7, "e": 8, "cus": 9},
    **{"sqrt_a": 10, "toe_sow_s": 11, "cic": 12, "omega0": 13, "cis": 14, "i0": 15, "crc": 16, "omega": 17},
    **{"omega_dot": 18, "idot": 19},
}
ACCURACY, HEALTH, DELAY_1, DELAY_2, FIT = 23, 24, 25, 26, 28
HEADER = """\
     3.04           N: GNSS NAV DATA    M: MIXED            RINEX VERSION / TYPE
GPSA   1.0000E-08  2.0000E-08 -3.0000E-08 -4.0000E-08       IONOSPHERIC CORR
GPSB   1.0000E+05  2.0000E+05 -3.0000E+05 -4.0000E+05       IONOSPHERIC CORR
    18                                                      LEAP SECONDS
                                                            END OF HEADER
"""
BODY = """\
     8.100000000000E+01-8.412500000000E+01 4.000000000000E-09 1.500000000000E+00
    -4.000000000000E-06 1.000000000000E-02 9.000000000000E-06 5.153700000000E+03
    {toe:19.12E} 1.000000000000E-07 1.200000000000E+00-5.000000000000E-08
     9.600000000000E-01 2.200000000000E+02-2.300000000000E+00-7.500000000000E-09
     5.000000000000E-10 1.000000000000E+00{week:19.12E} 0.000000000000E+00
     2.000000000000E+00{health:19.12E}-1.100000000000E-08 8.100000000000E+01
     3.800000000000E+05 4.000000000000E+00
"""


def message(
    sv: str = "G05",
    toc: str = "2023 06 29 12 00 00",
    toe: float = 388_800.0,
    week: float = 2268.0,
    health: float = 0.0,
) -> str:
    head = f"{sv} {toc}-5.000000000000E-04-8.000000000000E-12 0.000000000000E+00\n"
    return head + BODY.format(toe=toe, week=week, health=health)


def write(folder: Path, text: str, name: str = "nav.rnx") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def read(folder: Path, *messages: str) -> EphemerisTable:
    return read_navigation([write(folder, HEADER + "".join(messages))])[0].ephemerides


def system_times_ns(entry: Message) -> tuple[int, int]:
    """Return toc and toe in GPS time, from the calendar date and the seconds of the week nearest to it."""
    shift = dt.timedelta(seconds=14) if entry.sv[0] == "C" else dt.timedelta()
    sunday = entry.toc.replace(hour=0, minute=0, second=0) - dt.timedelta(days=(entry.toc.weekday() + 1) % 7)
    candidates = [sunday + dt.timedelta(weeks=k, seconds=entry.numbers[11] or 0.0) for k in (-1, 0, 1)]
    toe = min(candidates, key=lambda when: abs(when - entry.toc))
    return datetime_to_ns(entry.toc + shift), datetime_to_ns(toe + shift)


@pytest.mark.real_data
@pytest.mark.parametrize("name", SETS)
def test_every_field_of_real_files_is_that_of_the_text(name: str, data_root: Path) -> None:
    path = data_root / name / SETS[name]
    navigation, _ = read_navigation([path])
    table = navigation.ephemerides
    entries = navigation_messages(path.read_text())
    assert len(table.sv_names) == len(entries)
    for entry in entries:
        toc_ns, toe_ns = system_times_ns(entry)
        rows = [i for i, sv in enumerate(table.sv_names) if sv == entry.sv and table.toe_ns[i] == toe_ns]
        row = next(i for i in rows if table.issue[i] == entry.numbers[3])
        for field, place in PLACES.items():
            assert getattr(table, field)[row] == entry.numbers[place], (entry.sv, field)
        assert table.toc_ns[row] == toc_ns
        assert table.health[row] == entry.numbers[HEALTH]
        assert table.accuracy_m[row] == entry.numbers[ACCURACY]
        second = (entry.numbers[DELAY_2] or 0.0) if entry.sv[0] in "EC" else 0.0
        assert table.group_delay_s[row].tolist() == [entry.numbers[DELAY_1], second]
        if entry.sv[0] == "G":
            assert table.message[row] == "LNAV"
            assert table.fit_interval_s[row] == 3600.0 * (entry.numbers[FIT] or np.nan)
        else:
            assert table.message[row] == {"E": "INAV", "C": "D1"}[entry.sv[0]]
            assert np.isnan(table.fit_interval_s[row])


@pytest.mark.real_data
def test_header_of_a_real_file_gives_ionosphere_and_leap_seconds(data_root: Path) -> None:
    navigation, events = read_navigation([data_root / "instinct_static_20230629" / "nav_reach_m2.rnx"])
    assert navigation.klobuchar is not None
    expected = [
        1.4901e-08,
        2.2352e-08,
        -1.1921e-07,
        -1.1921e-07,
        1.1469e05,
        1.6384e05,
        -6.5536e04,
        -4.5875e05,
    ]
    assert navigation.klobuchar.tolist() == expected
    assert navigation.leap_seconds == 18
    # the file's line of Galileo coefficients is all zeros: none
    assert navigation.ionosphere == {}
    assert events == []


def test_file_without_ionosphere_gives_none(tmp_path: Path) -> None:
    text = "\n".join(line for line in HEADER.splitlines() if "IONO" not in line) + "\n" + message()
    assert read_navigation([write(tmp_path, text)])[0].klobuchar is None


@pytest.mark.parametrize("week", [2268.0, 2268.0 - 2048.0, 2268.0 - 1024.0, 0.0, 2269.0])
def test_week_field_does_not_matter(tmp_path: Path, week: float) -> None:
    table = read(tmp_path, message(week=week))
    assert table.toe_ns[0] == table.toc_ns[0] == datetime_to_ns(dt.datetime(2023, 6, 29, 12))


def test_reference_time_may_lie_in_the_next_week_of_the_clock(tmp_path: Path) -> None:
    table = read(tmp_path, message(toc="2023 07 01 23 59 44", toe=0.0, week=2269.0))
    assert table.toe_ns[0] == datetime_to_ns(dt.datetime(2023, 7, 2))
    assert table.toe_ns[0] - table.toc_ns[0] == 16 * 10**9


def test_unhealthy_messages_are_kept(tmp_path: Path) -> None:
    assert read(tmp_path, message(health=63.0)).health.tolist() == [63.0]


@pytest.mark.parametrize(
    ("sv", "kind"), [("G05", "LNAV"), ("J02", "LNAV"), ("C21", "D1"), ("C03", "D2"), ("I02", "LNAV")]
)
def test_kind_of_message_follows_the_satellite(tmp_path: Path, sv: str, kind: str) -> None:
    assert read(tmp_path, message(sv)).message == (kind,)


@pytest.mark.parametrize(("source", "kind"), [(517.0, "INAV"), (513.0, "INAV"), (258.0, "FNAV")])
def test_galileo_message_follows_its_data_source(tmp_path: Path, source: float, kind: str) -> None:
    text = message("E11").replace(
        "5.000000000000E-10 1.000000000000E+00", f"5.000000000000E-10 {source:18.12E}"
    )
    assert read(tmp_path, text).message == (kind,)


def test_several_files_are_merged_sorted_and_without_repetitions(tmp_path: Path) -> None:
    later = message(toc="2023 06 29 14 00 00", toe=396_000.0)
    a = write(tmp_path, HEADER + later + message("G07"), "a.rnx")
    b = tmp_path / "b.rnx.gz"
    b.write_bytes(gzip.compress((HEADER + message() + later).encode()))
    navigation, events = read_navigation([a, b])
    assert navigation.ephemerides.sv_names == ("G05", "G05", "G07")
    assert np.diff(navigation.ephemerides.toe_ns[:2]).tolist() == [7200 * 10**9]
    assert [event.kind for event in events] == ["navigation_repeated"]


def test_navigation_file_that_compress_packed_is_read_as_the_plain_one(tmp_path: Path) -> None:
    text = HEADER + message() + message("G07")
    packed = tmp_path / "brdc1800.23n.Z"
    packed.write_bytes(ncompress.compress(text.encode()))
    (tables, events), (plain, _) = (read_navigation([path]) for path in (packed, write(tmp_path, text)))
    assert tables.ephemerides.sv_names == plain.ephemerides.sv_names == ("G05", "G07") and not events


def test_all_columns_have_one_entry_a_message(tmp_path: Path) -> None:
    table = read(tmp_path, message(), message("G07"), message("E11"))
    assert {len(getattr(table, field.name)) for field in fields(table)} == {3}


def test_damaged_message_is_told_and_the_others_stay(tmp_path: Path) -> None:
    damaged = message("G07").replace("5.153700000000E+03", "garbage here     ")
    navigation, events = read_navigation([write(tmp_path, HEADER + message() + damaged + message("G09"))])
    assert navigation.ephemerides.sv_names == ("G05", "G09")
    assert [event.kind for event in events] == ["navigation_damaged"]
    assert "G07" in events[0].detail and ":14" in events[0].detail


def test_truncated_last_message_is_told_and_the_others_stay(tmp_path: Path) -> None:
    navigation, events = read_navigation([write(tmp_path, HEADER + message() + message("G07")[:300])])
    assert navigation.ephemerides.sv_names == ("G05",)
    assert [event.kind for event in events] == ["navigation_damaged"]


RINEX_2 = """\
     2.11           N: GPS NAV DATA                         RINEX VERSION / TYPE
    1.0000D-08  2.0000D-08 -3.0000D-08 -4.0000D-08          ION ALPHA
    1.0000D+05  2.0000D+05 -3.0000D+05 -4.0000D+05          ION BETA
    18                                                      LEAP SECONDS
                                                            END OF HEADER
 5 23  6 29 12  0  0.0-5.000000000000D-04-8.000000000000D-12 0.000000000000D+00
"""


def test_rinex_2_gives_the_same_message(tmp_path: Path) -> None:
    body = BODY.format(toe=388_800.0, week=2268.0, health=0.0).replace("E", "D")
    old = "\n".join(line[1:] for line in body.splitlines())
    navigation, _ = read_navigation([write(tmp_path, RINEX_2 + old + "\n", "auto1800.23n")])
    expected, _ = read_navigation([write(tmp_path, HEADER + message())])
    for field in fields(EphemerisTable):
        assert np.array_equal(
            getattr(navigation.ephemerides, field.name),
            getattr(expected.ephemerides, field.name),
            equal_nan=field.name not in ("sv_names", "message"),
        )
    assert navigation.klobuchar is not None and expected.klobuchar is not None
    assert navigation.klobuchar.tolist() == expected.klobuchar.tolist()
    assert navigation.leap_seconds == 18


def test_rinex_4_message_is_read(tmp_path: Path) -> None:
    text = HEADER.replace("3.04", "4.00").replace("GPSA", "GPSA") + "> EPH G05 LNAV\n" + message()
    navigation, _ = read_navigation([write(tmp_path, text)])
    assert navigation.ephemerides.sv_names == ("G05",)
    assert navigation.ephemerides.sqrt_a.tolist() == [5153.7]


@pytest.mark.parametrize(
    "text", [HEADER, "time_s,sv\n1,G05\n", "x", HEADER[:200], "     3.04           OBSERVATION DATA\n"]
)
def test_file_without_ephemerides_is_an_error(tmp_path: Path, text: str) -> None:
    with pytest.raises(NavigationDataError):
        read_navigation([write(tmp_path, text)])


def rinex_2(version: str = "     2.11") -> str:
    """Return a file of one message in RINEX 2."""
    head = f"{version}           N: GPS NAV DATA                         RINEX VERSION / TYPE\n"
    old = message(toc=" 5 23  6 29 12  0  0.0").replace("G05 ", "", 1)
    return head + " " * 60 + "END OF HEADER\n" + old.replace("\n    ", "\n   ")


@pytest.mark.parametrize("version", ["     2   ", "2        ", "     2.11", "     2.1 "])
def test_version_of_the_archives_merged_files_is_read(tmp_path: Path, version: str) -> None:
    table = read_navigation([write(tmp_path, rinex_2(version))])[0].ephemerides
    assert table.sv_names == ("G05",) and table.toe_sow_s.tolist() == [388_800.0]


@pytest.mark.real_data
@pytest.mark.parametrize(("name", "messages"), [("hour1820.16n", 418), ("hour2350.16n", 419)])
def test_real_file_of_an_archive_is_read_whole(data_root: Path, name: str, messages: int) -> None:
    path = data_root / "phone_static_2016" / name
    navigation, events = read_navigation([path])
    begins = [
        line for line in path.read_text().splitlines() if line[:2].strip().isdigit() and line[3:5] == "16"
    ]
    repeated = sum(int(e.detail.split()[0]) for e in events if e.kind == "navigation_repeated")
    assert len(navigation.ephemerides.sv_names) == messages == len(begins) - repeated
    assert navigation.klobuchar is not None and navigation.leap_seconds == 17


def record_4(tag: str) -> str:
    """Return a RINEX 4 record with eight ionosphere coefficients, unless the caller gives other values."""
    numbers = [f"{n:19.12E}" for n in (1e-8, 2e-8, -3e-8, -4e-8, 1e5, 2e5, -3e5, -4e5, 0.0)]
    lines = [
        "    2023 06 29 00 00 00" + "".join(numbers[:3]),
        *("    " + "".join(numbers[k : k + 4]) for k in (3, 7)),
    ]
    return f"> {tag}\n" + "\n".join(lines) + "\n"


HEADER_4 = "\n".join(line for line in HEADER.replace("3.04", "4.01").split("\n") if "GPS" not in line)


def test_records_of_a_whole_system_without_a_satellite_are_read_or_told_as_their_kind(tmp_path: Path) -> None:
    numbers = "".join(f"{n:19.12E}" for n in (259_200.0, 1e-9, 0.0, 0.0))
    offset = (
        f"> STO G   LNAV\n    2023 06 29 00 00 00 {'GPUT':<18} {'':<18} {'UTC(USNO)':<18}\n    {numbers}\n"
    )
    text = HEADER_4 + "> EPH G05 LNAV\n" + message() + offset + record_4("ION G   LNAV")
    navigation, events = read_navigation([write(tmp_path, text)])

    assert navigation.klobuchar is not None and navigation.klobuchar[0] == 1e-8
    assert [event.detail.rpartition(": ")[2] for event in events] == ["1 system_time_offset"]


def test_damaged_coefficients_of_one_system_leave_those_of_gps(tmp_path: Path) -> None:
    damaged = record_4("ION C05 D1D2").replace("2023", "20x3")
    text = HEADER_4 + record_4("ION G05 LNAV") + damaged + "> EPH G05 LNAV\n" + message()
    navigation, events = read_navigation([write(tmp_path, text)])

    assert navigation.klobuchar is not None and navigation.klobuchar[4] == 1e5
    assert [event.kind for event in events] == ["navigation_damaged"]


@pytest.mark.parametrize("version", [2, 3, 4])
@pytest.mark.parametrize("way", ["editor", "one blank"])
def test_tabs_are_read_as_the_blanks_that_they_stand_for(tmp_path: Path, version: int, way: str) -> None:
    text = {
        2: rinex_2("     2   "),
        3: HEADER + message() + message("E11"),
        4: HEADER_4 + record_4("ION G05 LNAV") + "> EPH G05 LNAV\n" + message(),
    }[version]
    head, end, body = text.partition("END OF HEADER\n")
    with_tabs = tabbed(text) if way == "editor" else head + end + body.replace(" ", "\t")
    plain, _ = read_navigation([write(tmp_path, text)])

    path = write(tmp_path, with_tabs, "tabs.rnx")
    navigation, events = read_navigation([path])

    assert detect_format(path) == "rinex_navigation"
    assert [event.kind for event in events] == ["rinex_tabs"] and "tabs.rnx:" in events[0].detail
    for field in fields(EphemerisTable):
        np.testing.assert_array_equal(
            getattr(navigation.ephemerides, field.name), getattr(plain.ephemerides, field.name)
        )
    np.testing.assert_array_equal(navigation.klobuchar, plain.klobuchar)


@pytest.mark.parametrize(
    ("before", "line"), [("G05 2023 06 29", 6), ("1.000000000000E-07 1.2000", 9)], ids=["clock", "orbit"]
)
def test_tab_that_hides_the_columns_of_a_message_costs_it_and_says_so(
    tmp_path: Path, before: str, line: int
) -> None:
    text = HEADER + message().replace(before, before.replace(" ", " \t", 1)) + message("G07")
    navigation, events = read_navigation([write(tmp_path, text)])

    assert navigation.ephemerides.sv_names == ("G07",)
    assert [event.kind for event in events] == ["rinex_tabs", "navigation_damaged"]
    assert f"their messages are refused: line(s) {line}" in events[0].detail
    assert "G05" in events[1].detail


def test_joined_files_with_tabs_are_each_read_by_their_own_header(tmp_path: Path) -> None:
    text = tabbed(HEADER + message() + HEADER + message("G07"))
    navigation, events = read_navigation([write(tmp_path, text)])

    assert navigation.ephemerides.sv_names == ("G05", "G07")
    assert [event.kind for event in events] == ["rinex_joined", "rinex_tabs", "rinex_tabs"]
