"""A flight file without a GPS week has the one that the times of its logs tell."""

from __future__ import annotations

from pathlib import Path

import pytest

from insgnss.errors import ConfigError
from insgnss.log.flight import Flight

GNSS = '[gnss]\nfiles = ["gnss.csv"]\nnavigation = ["nav.rnx"]\n'
IMU = '[imu]\nfiles = ["imu.csv"]\ngyro_unit = "rad/s"\naccel_unit = "m/s^2"\ngrade = "tactical"\n'
CALENDAR = 'origin = "calendar"\nscale = "utc"\n'
ISO = ["2025-09-24T09:34:44.000Z", "2025-09-24T09:34:45.000Z"]


def load(folder: Path, text: str, gnss: list[str], imu: list[str]) -> Flight:
    rows = [f"{time},G05,C1C,22000000.0,100.0" for time in gnss]
    names = "time_s,sv,signal,pseudorange_m,doppler_hz"
    header = f"week,{names}" if gnss[0].count(",") else names
    (folder / "gnss.csv").write_text("\n".join([header, *rows]) + "\n")
    header = "time_s,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z"
    (folder / "imu.csv").write_text("\n".join([header, *(f"{time},0,0,0,0,0,-9.8" for time in imu)]) + "\n")
    (folder / "flight.toml").write_text(text)
    return Flight.load(folder / "flight.toml")


@pytest.mark.parametrize(
    "text, gnss, imu",
    [
        (f"{GNSS}[gnss.time]\n{CALENDAR}", ISO, ["293702.0", "293702.1"]),
        (
            GNSS + '[gnss.columns]\nweek = "week"\n',
            ["2385,293702.0", "2385,293703.0"],
            ["293702.0", "293702.1"],
        ),
        (f"{GNSS}{IMU}[imu.time]\n{CALENDAR}", ["293702.0", "293703.0"], ISO),
    ],
    ids=["dates", "column of weeks", "dates of the inertial log"],
)
def test_week_left_out_is_that_of_the_logs(
    tmp_path: Path, text: str, gnss: list[str], imu: list[str]
) -> None:
    assert load(tmp_path, text, gnss, imu).config.gps_week == 2385


def test_week_that_no_time_tells_is_asked_for(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"'gps_week': missing key(.|\n)*give gps_week"):
        load(tmp_path, GNSS + IMU, ["293702.0", "293703.0"], ["293702.0", "293702.1"])


def test_dates_that_no_key_declares_are_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"are dates or Unix time, declare\s+time\.origin"):
        load(tmp_path, GNSS + IMU, ISO, ISO)
