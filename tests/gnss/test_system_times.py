"""System times: leap seconds, GLONASS's Moscow time, and messages at the turn of the week of every system."""

from __future__ import annotations

import datetime as dt
from pathlib import Path

import numpy as np
import pytest
import sidereon

from insgnss.constants import C_MPS, NS_PER_S, NS_PER_WEEK
from insgnss.gnss.orbits.satellite_state import satellite_states
from insgnss.gpstime import (
    BDT_MINUS_GPST_S,
    BDT_WEEK_OFFSET,
    GPS_EPOCH,
    GST_WEEK_OFFSET,
    LEAP_SECONDS,
    datetime_to_ns,
    glonass_to_ns,
    leap_seconds,
    nearest,
    utc_to_ns,
)
from insgnss.log.rinex.navigation import read_navigation
from insgnss.status import USED
from tests.gnss.broadcast_sample import observations
from tests.log.test_rinex_navigation import HEADER, message


def test_leap_seconds_equal_an_independent_table_on_every_first_of_a_month() -> None:
    """GPS - UTC is TAI - UTC less 19 s."""
    for year in range(1980, 2027):
        for month in range(1, 13):
            date = dt.datetime(year, month, 1 if (year, month) != (1980, 1) else 6)
            assert leap_seconds(date) == sidereon.leap_seconds(date.year, date.month, date.day) - 19


def test_leap_seconds_come_into_force_with_their_day() -> None:
    for date, seconds in LEAP_SECONDS[1:]:
        start = dt.datetime.fromisoformat(date)
        assert leap_seconds(start) == seconds
        assert leap_seconds(start - dt.timedelta(microseconds=1)) == seconds - 1


def test_utc_runs_on_by_a_second_more_where_one_was_put_in() -> None:
    before, after = utc_to_ns(dt.datetime(2016, 12, 31, 23, 59, 59)), utc_to_ns(dt.datetime(2017, 1, 1))
    assert after - before == 2 * NS_PER_S
    assert utc_to_ns(dt.datetime(1980, 1, 6)) == 0


@pytest.mark.parametrize(
    ("four_years", "day", "seconds", "gps"),
    [
        (1, 1, 10_800, dt.datetime(1996, 1, 1, 0, 0, 11)),  # 03:00 in Moscow is 00:00 UTC
        (1, 1, 0, dt.datetime(1995, 12, 31, 21, 0, 10)),  # and before it the leap second was not yet
        (6, 367, 10_800, dt.datetime(2017, 1, 1, 0, 0, 18)),
        (6, 367, 9_900, dt.datetime(2016, 12, 31, 23, 45, 17)),
        (7, 1275, 51_300, dt.datetime(2023, 6, 28, 11, 15, 18)),
        (8, 1, 0, dt.datetime(2023, 12, 31, 21, 0, 18)),
    ],
)
def test_glonass_date_is_moscow_time(four_years: int, day: int, seconds: float, gps: dt.datetime) -> None:
    assert glonass_to_ns(four_years, day, seconds) == datetime_to_ns(gps)


def test_weeks_of_the_systems_begin_when_their_documents_say() -> None:
    """BDT on 2006-01-01 (BDS-SIS-ICD B1I 3.0, 3.3), GST 13 s before 1999-08-22 (OS SIS ICD 2.1, 5.1.2), in UTC."""
    bdt_start = BDT_WEEK_OFFSET * NS_PER_WEEK - BDT_MINUS_GPST_S * NS_PER_S
    assert bdt_start == utc_to_ns(dt.datetime(2006, 1, 1))
    assert GST_WEEK_OFFSET * NS_PER_WEEK == utc_to_ns(dt.datetime(1999, 8, 22)) - 13 * NS_PER_S
    assert GPS_EPOCH == dt.datetime(1980, 1, 6)


# GPS week 2269 began on Sunday 2023-07-02; toe before, at and after the turn of the system's own week
SUNDAY_NS = datetime_to_ns(dt.datetime(2023, 7, 2))


@pytest.mark.parametrize("week", ["own", "ten bits", "zero"])
@pytest.mark.parametrize(
    ("toc", "toe", "after_s"),
    [
        ("2023 07 01 23 59 44", 604_784.0, -16),
        ("2023 07 01 23 59 44", 0.0, 0),  # toe in the week after the clock's epoch
        ("2023 07 02 00 00 00", 0.0, 0),
        ("2023 07 02 00 00 00", 604_784.0, -16),  # and in the week before
        ("2023 07 02 01 00 00", 3600.0, 3600),
    ],
)
@pytest.mark.parametrize("sv", ["G05", "E11", "C21", "J02", "I02"])
def test_reference_time_at_the_turn_of_the_week(
    tmp_path: Path, sv: str, toc: str, toe: float, after_s: int, week: str
) -> None:
    own = 2269 - BDT_WEEK_OFFSET if sv[0] == "C" else 2269
    number = {"own": own, "ten bits": own % 1024, "zero": 0}[week]
    path = tmp_path / "nav.rnx"
    path.write_text(HEADER + message(sv, toc, toe, float(number)))
    table = read_navigation([path])[0].ephemerides
    behind_s = 14 if sv[0] == "C" else 0
    assert table.toe_ns[0] == SUNDAY_NS + (after_s + behind_s) * NS_PER_S
    assert table.toe_sow_s[0] == toe


@pytest.mark.parametrize(
    ("sv", "code"), [("G05", "C1C"), ("E11", "C1C"), ("C21", "C2I"), ("J02", "C1C"), ("I02", "C5A")]
)
def test_orbit_runs_on_over_the_turn_of_the_week(tmp_path: Path, sv: str, code: str) -> None:
    """A message of Saturday night serves Sunday: the position goes on with its velocity, to a millimetre in 0.1 s."""
    path = tmp_path / "nav.rnx"
    sent = message(sv, "2023 07 01 23 30 00", 603_000.0)
    if sv[0] in "EC":  # where GPS has its IODC, Galileo and BeiDou have a second group delay
        sent = sent.replace(
            "-1.100000000000E-08 8.100000000000E+01", "-1.100000000000E-08 2.000000000000E-09"
        )
    path.write_text(HEADER + sent)
    nav, _ = read_navigation([path])
    # with the system's own clock the week turns 14 s later for BeiDou
    turn = SUNDAY_NS + (14 * NS_PER_S if sv[0] == "C" else 0)
    t = turn + np.array([-50, 50]) * (NS_PER_S // 1000)
    log = observations((sv,), t, [0.0, 0.0] + 0.07 * C_MPS * np.ones(2), sv=[0, 0], code=code)
    states = satellite_states(log, nav)
    assert list(states.status) == [USED, USED]
    moved = states.position[0] + 0.1 * states.velocity[0] + 0.005 * states.acceleration[0]
    np.testing.assert_allclose(states.position[1], moved, rtol=0, atol=1e-3)
    assert states.age_s[1] - states.age_s[0] == pytest.approx(0.1, abs=1e-9)


def test_glonass_orbit_runs_on_over_the_leap_second(tmp_path: Path) -> None:
    """A message of 23:45 UTC before the leap second of 2016 serves the quarter of an hour after it, in GPS time."""
    text = (
        HEADER
        + "R03 2016 12 31 23 45 00-1.236097887158E-04 0.000000000000E+00 1.077000000000E+04\n"
        + "    -2.380982128906E+04 2.289457321167E-01-3.725290298462E-09 0.000000000000E+00\n"
        + "    -8.908935546875E+03 2.536134719849E-01 9.313225746155E-10 5.000000000000E+00\n"
        + "     2.209434082031E+03 3.556049346924E+00-1.862645149231E-09 0.000000000000E+00\n"
    )
    path = tmp_path / "nav.rnx"
    path.write_text(text)
    nav, _ = read_navigation([path])
    leap_ns = datetime_to_ns(dt.datetime(2017, 1, 1, 0, 0, 17))  # 23:59:60 UTC
    t = leap_ns + np.array([-1, 0, 1]) * NS_PER_S
    states = satellite_states(observations(("R03",), t, [2.1e7] * 3, sv=[0] * 3), nav)
    assert list(states.status) == [USED] * 3
    np.testing.assert_allclose(np.diff(states.age_s), 1.0, rtol=0, atol=1e-9)
    assert states.age_s[1] == pytest.approx(900.0 - 2.1e7 / C_MPS, abs=2e-4)


def test_nearest_time_is_the_earlier_of_two_that_are_as_near_and_the_last_one_beyond_the_end() -> None:
    times = np.array([10, 20, 20, 40])
    wanted = np.array([0, 10, 15, 16, 29, 30, 31, 99])
    assert nearest(times, wanted).tolist() == [0, 0, 0, 1, 2, 2, 3, 3]
    assert nearest(times[:1] / 2.0, wanted / 2.0).tolist() == [0] * 8
