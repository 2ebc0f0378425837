"""GLONASS and SBAS messages in RINEX navigation files of every version, whole and damaged."""

from __future__ import annotations

import datetime as dt
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insgnss.errors import InsGnssError, NavigationDataError
from insgnss.gnss.orbits.ephemeris_choice import broadcast_messages
from insgnss.gpstime import datetime_to_ns
from insgnss.log.rinex.navigation import read_navigation
from insgnss.tables import Event, StateVectorTable
from tests.log.test_rinex_navigation import message

HEAD = """\
{version:>9}           N: GNSS NAV DATA    M: MIXED            RINEX VERSION / TYPE
                                                            END OF HEADER
"""
GLONASS = """\
{sv} 2023 06 29 11 15 00 8.902698755260E-05 1.818989403550E-12 3.858900000000E+05
     1.054115722660E+04 3.211450576780E-01 2.793967723850E-09 {health}
     3.631743164060E+02 3.167271614070E+00-1.862645149230E-09{channel:>19}
     2.323411083980E+04-1.910123825070E-01-9.313225746150E-10 0.000000000000E+00
"""
FIFTH = "     1.790000000000E+02{delay:>19} 2.000000000000E+00 {flags}\n"
SBAS = """\
S23 2023 06 29 11 15 12 1.862645149230E-09 4.000000000000E-12 3.860000000000E+05
     4.200000000000E+04 1.000000000000E-03 2.000000000000E-08 {health}
    -1.000000000000E+03-2.000000000000E-03 3.000000000000E-08 4.000000000000E+00
     2.000000000000E+01 3.000000000000E-03-4.000000000000E-08 1.200000000000E+01
"""
NUMBER = "0.000000000000E+00"
T_NS = datetime_to_ns(dt.datetime(2023, 6, 29, 11, 15, 18))  # 18 leap seconds ahead of UTC


def glonass(sv: str = "R18", channel: str = "-3.000000000000E+00", health: str = NUMBER) -> str:
    return GLONASS.format(sv=sv, channel=channel, health=health)


def fifth(delay: str = "-2.793967723850E-09", flags: str = NUMBER) -> str:
    return FIFTH.format(delay=delay, flags=flags)


def read(folder: Path, text: str, version: str = "3.04") -> tuple[StateVectorTable, list[Event]]:
    path = folder / "nav.rnx"
    path.write_text(HEAD.format(version=version) + text)
    navigation, events = read_navigation([path])
    assert navigation.state_vectors is not None
    return navigation.state_vectors, events


def check_r18(table: StateVectorTable, row: int = 0) -> None:
    assert table.sv_names[row] == "R18" and table.t_ns[row] == T_NS
    assert table.r_e[row].tolist() == pytest.approx([10541157.2266, 363174.316406, 23234110.8398], abs=1e-6)
    assert table.v_e[row].tolist() == pytest.approx([321.145057678, 3167.27161407, -191.012382507], abs=1e-9)
    expected = [2.79396772385e-6, -1.86264514923e-6, -9.31322574615e-7]
    assert table.a_e[row].tolist() == pytest.approx(expected, rel=1e-12)
    assert (table.clock_s[row], table.clock_rate[row]) == (8.90269875526e-05, 1.81898940355e-12)
    assert (table.health[row], table.channel[row]) == (0.0, -3)


@pytest.mark.parametrize(
    ("version", "text"),
    [
        ("3.04", glonass()),
        ("3.05", glonass() + fifth()),
        ("3.05", glonass()),  # calls itself 3.05 and lacks the line that came with it
        ("4.00", "> EPH R18 FDMA\n" + glonass() + fifth()),
    ],
)
def test_message_of_every_version_gives_the_same_state(tmp_path: Path, version: str, text: str) -> None:
    table, events = read(tmp_path, text, version)
    check_r18(table)
    assert events == []


def test_rinex_2_epoch_is_utc_of_its_own_date(tmp_path: Path) -> None:
    """2003: 13 leap seconds."""
    lines = glonass().replace("E", "D").splitlines()
    old = [" 1 03  2 10  0 15  0.0" + lines[0][23:], *(line[1:] for line in lines[1:])]
    path = tmp_path / "brdc0410.03g"
    path.write_text(
        "     2.01           GLONASS NAV DATA                        RINEX VERSION / TYPE\n"
        + "END OF HEADER".rjust(73)
        + "\n"
        + "\n".join(old)
        + "\n"
    )
    table = read_navigation([path])[0].state_vectors
    assert table is not None and table.sv_names == ("R01",)
    assert table.t_ns[0] == datetime_to_ns(dt.datetime(2003, 2, 10, 0, 15, 13))
    assert table.channel[0] == -3


@pytest.mark.parametrize(
    ("utc", "gps"),
    [
        ("2016 12 31 23 45 00", dt.datetime(2016, 12, 31, 23, 45, 17)),
        ("2017 01 01 00 15 00", dt.datetime(2017, 1, 1, 0, 15, 18)),
        ("2023 07 01 23 45 00", dt.datetime(2023, 7, 1, 23, 45, 18)),  # the last of a GPS week
        ("2023 07 02 00 15 00", dt.datetime(2023, 7, 2, 0, 15, 18)),
    ],
)
def test_reference_time_is_right_at_the_turn_of_day_week_and_leap_second(
    tmp_path: Path, utc: str, gps: dt.datetime
) -> None:
    table, _ = read(tmp_path, glonass().replace("2023 06 29 11 15 00", utc))
    assert table.t_ns[0] == datetime_to_ns(gps)


@pytest.mark.parametrize("health", ["1.000000000000E+00", "4.000000000000E+00"])
def test_unhealthy_message_is_kept_and_marked(tmp_path: Path, health: str) -> None:
    table, _ = read(tmp_path, glonass(health=health))
    assert table.health.tolist() == [float(health)]


@pytest.mark.parametrize(("flags", "healthy"), [("0", True), ("3", True), ("2", False), ("4", False)])
def test_health_of_the_string_and_of_the_almanac_count(tmp_path: Path, flags: str, healthy: bool) -> None:
    """RINEX 3.05, table A10: bit 1 says that the almanac's health (bit 0, 1 is good) is given, bit 2 is l_n."""
    table, _ = read(tmp_path, glonass() + fifth(flags=f"{flags}.000000000000E+00"), "3.05")
    assert (table.health[0] == 0.0) == healthy


def test_group_delay_is_read_where_given(tmp_path: Path) -> None:
    given, _ = read(tmp_path, glonass() + fifth(), "3.05")
    assert given.group_delay_s.tolist() == [-2.79396772385e-9]
    unknown, _ = read(tmp_path, glonass() + fifth(delay="9.999999999990E+08"), "3.05")
    assert np.isnan(unknown.group_delay_s).all()
    before, _ = read(tmp_path, glonass())
    assert np.isnan(before.group_delay_s).all()


@pytest.mark.parametrize("channel", ["", "-1.280000000000E+02", "9.900000000000E+01"])
def test_message_without_a_sensible_channel_is_kept_and_told(tmp_path: Path, channel: str) -> None:
    table, events = read(tmp_path, glonass(channel=channel) + glonass("R03"))
    assert table.sv_names == ("R03", "R18") and table.channel.tolist() == [-3, -128]
    assert [event.kind for event in events] == ["glonass_channel_missing"] and "R18" in events[0].detail


def test_damaged_message_is_told_and_the_others_stay(tmp_path: Path) -> None:
    broken = glonass("R07").replace("3.631743164060E+02", "no number at all  ")
    cut = glonass("R08")[:150].rstrip() + "\n"
    table, events = read(tmp_path, message() + glonass() + broken + cut + glonass("R09") + message("G07"))
    assert table.sv_names == ("R09", "R18")
    assert [event.kind for event in events] == ["navigation_damaged"] * 2
    assert [sv in event.detail for sv, event in zip(("R07", "R08"), events, strict=True)] == [True, True]


def test_states_alone_are_navigation_data_and_nothing_at_all_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "nav.rnx"
    path.write_text(HEAD.format(version="3.04") + glonass())
    navigation, _ = read_navigation([path])
    assert len(navigation.ephemerides.sv_names) == 0 and navigation.ephemerides.group_delay_s.shape == (0, 2)
    path.write_text(HEAD.format(version="3.04"))
    with pytest.raises(NavigationDataError, match="navigation file of the flight"):
        read_navigation([path])


def test_repeated_states_of_several_files_stand_once_in_time_order(tmp_path: Path) -> None:
    later = glonass().replace("11 15 00", "11 45 00")
    paths = [tmp_path / "a.rnx", tmp_path / "b.rnx"]
    for path, text in zip(paths, (later + glonass("R03"), glonass() + later), strict=True):
        path.write_text(HEAD.format(version="3.04") + text)
    navigation, events = read_navigation(paths)
    assert navigation.state_vectors is not None
    assert navigation.state_vectors.sv_names == ("R03", "R18", "R18")
    assert np.diff(navigation.state_vectors.t_ns[1:]).tolist() == [1800 * 10**9]
    assert [event.kind for event in events] == ["navigation_repeated"]


@pytest.mark.parametrize(("version", "tag"), [("3.04", ""), ("4.00", "> EPH S23 SBAS\n")])
def test_sbas_message_is_read_with_its_time_in_gps_time(tmp_path: Path, version: str, tag: str) -> None:
    table, events = read(tmp_path, tag + SBAS.format(health="6.300000000000E+01"), version)
    assert table.sv_names == ("S23",) and events == []
    assert table.t_ns[0] == datetime_to_ns(dt.datetime(2023, 6, 29, 11, 15, 12))
    assert table.r_e.tolist() == [[4.2e7, -1e6, 2e4]]
    assert table.v_e[0].tolist() == pytest.approx([1.0, -2.0, 3.0])
    assert table.a_e[0].tolist() == pytest.approx([2e-5, 3e-5, -4e-5])
    assert (table.clock_s[0], table.clock_rate[0], table.health[0]) == (1.86264514923e-9, 4e-12, 63.0)


@pytest.mark.parametrize("year", ["9999", "1000", "1970"])
@pytest.mark.parametrize("text", [glonass(), SBAS.format(health=NUMBER), message("G07")])
def test_message_of_an_impossible_date_is_told(tmp_path: Path, text: str, year: str) -> None:
    table, events = read(tmp_path, text.replace("2023 06", f"{year} 06") + glonass("R03") + message())
    assert table.sv_names == ("R03",)
    assert [event.kind for event in events] == ["navigation_damaged"] and text[:3] in events[0].detail


def test_damaged_sbas_message_is_told(tmp_path: Path) -> None:
    broken = SBAS.format(health=NUMBER).replace("-1.000000000000E+03", "-1.00000x000000E+03")
    table, events = read(tmp_path, glonass() + broken)
    assert table.sv_names == ("R18",)
    assert [event.kind for event in events] == ["navigation_damaged"] and "S23" in events[0].detail


@pytest.mark.parametrize("sv", ["C63", "C60", "J10", "I14", "G63", "E40"])
def test_satellite_of_a_high_number_breaks_nothing(tmp_path: Path, sv: str) -> None:
    path = tmp_path / "nav.rnx"
    path.write_text(HEAD.format(version="3.04") + message(sv) + message() + glonass("R27"))
    navigation, events = read_navigation([path])
    assert "G05" in navigation.ephemerides.sv_names
    assert navigation.state_vectors is not None and navigation.state_vectors.sv_names == ("R27",)
    assert sv in navigation.ephemerides.sv_names or any(sv in event.detail for event in events)


CNAV = """\
> EPH {sv} CNAV
{sv} 2023 06 29 12 00 00-5.000000000000E-04-8.000000000000E-12 0.000000000000E+00
     4.000000000000E-09-8.410000000000E+01 4.000000000000E-09 1.500000000000E+00
    -4.000000000000E-06 1.000000000000E-02 9.000000000000E-06 5.153700000000E+03
     3.888000000000E+05 1.000000000000E-07 1.200000000000E+00-5.000000000000E-08
     9.600000000000E-01 2.200000000000E+02-2.300000000000E+00-7.500000000000E-09
     5.000000000000E-10 0.000000000000E+00 0.000000000000E+00 1.000000000000E+00
     0.000000000000E+00 0.000000000000E+00-1.100000000000E-08 0.000000000000E+00
     1.100000000000E-09 2.200000000000E-09 3.300000000000E-09 {l5q}
     3.800000000000E+05 2.268000000000E+03
"""


def test_cnav_gives_the_inter_signal_corrections_of_its_satellite(tmp_path: Path) -> None:
    path = tmp_path / "nav.rnx"
    text = "> EPH G05 LNAV\n" + message() + CNAV.format(sv="G05", l5q="4.400000000000E-09")
    path.write_text(HEAD.format(version="4.00") + text)
    navigation, events = read_navigation([path])
    assert navigation.ephemerides.message == ("LNAV",)
    given = navigation.inter_signal_s["G05"]
    assert given[:4].tolist() == [1.1e-9, 2.2e-9, 3.3e-9, 4.4e-9] and np.isnan(given[4:]).all()
    assert [event.kind for event in events] == ["navigation_not_used"] and "orbit" in events[0].detail


WHOLE = (
    HEAD.format(version="3.04")
    + message()
    + glonass()
    + SBAS.format(health=NUMBER)
    + glonass("R03", channel="")
)


@settings(max_examples=300, deadline=None)
@given(
    place=st.floats(0.0, 1.0),
    length=st.integers(0, 40),
    put=st.sampled_from(
        ["", "\n", "9", "-", "E", "nan", "1e999", "R", "> EPH R01 FDMA\n", "99999999", " " * 25]
    ),
    cut=st.booleans(),
)
def test_file_damaged_anywhere_gives_sound_states_or_an_error_of_ours(
    tmp_path_factory: pytest.TempPathFactory, place: float, length: int, put: str, cut: bool
) -> None:
    start = round(place * len(WHOLE))
    path = tmp_path_factory.getbasetemp() / "damaged.rnx"
    path.write_text(WHOLE[:start] + put + ("" if cut else WHOLE[start + length :]))
    try:
        navigation, _ = read_navigation([path])
    except InsGnssError:
        return
    messages = broadcast_messages(navigation)
    states = navigation.state_vectors
    n = 0 if states is None else len(states.sv_names)
    assert len(messages.index.toe_ns) == len(navigation.ephemerides.sv_names) + n
    assert all(name[0] == "R" for name in messages.channels)
