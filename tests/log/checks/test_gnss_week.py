"""Whose week is wrong: the flight file's week is that of both logs, tags of the GNSS log alone have an offset."""

from __future__ import annotations

import pytest

from insgnss.constants import NS_PER_WEEK
from insgnss.log.checks.gnss_time import _finding, _Shift
from insgnss.log.flight import Flight
from insgnss.log.gnss_log import read_receiver
from insgnss.log.imu.csv_log import inertial, read_imu
from tests.conftest import REPOSITORY


@pytest.mark.parametrize(
    ("imu_weeks", "proposed"),
    [(0, {"gnss.time.offset_s": -604_800.0}), (1, {"gps_week": 2384})],
)
def test_week_is_the_flight_files_only_where_both_logs_are_off(
    imu_weeks: int, proposed: dict[str, float]
) -> None:
    flight = Flight.load(REPOSITORY / "data" / "sample_flight" / "flight.toml")
    gnss = read_receiver(flight.config.gnss, flight.config.gps_week).gnss.later(NS_PER_WEEK)
    imu = read_imu(inertial(flight.config), flight.config.gps_week + imu_weeks, flight.imu_grade)[0]

    finding = _finding(flight, _Shift(-1, 0, 0), gnss, "sure", imu)

    assert {proposal.key: proposal.value for proposal in finding.proposals} == proposed
