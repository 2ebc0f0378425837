"""Reference trajectories: sorted, one row a time, and missing columns as NaN."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insgnss.config.flight import FlightConfig, Reference
from insgnss.config.strict import load_toml
from insgnss.constants import NS_PER_S
from insgnss.errors import ColumnError, ConfigError, InputError
from insgnss.log.reference import read_reference
from tests.log.writing import WEEK, write_lines


def config(folder: Path, lines: list[str]) -> Reference:
    return Reference(file=write_lines(folder / "reference.csv", lines))


def test_full_reference_is_read(tmp_path: Path) -> None:
    header = "time_s,lat_deg,lon_deg,h_m,vn,ve,vd,roll_deg,pitch_deg,yaw_deg,quality"
    rows = ["1.5,48.0,9.0,300.0,1,2,3,10,20,30,2", "1.0,48.1,9.1,301.0,,,,,,,"]
    table, events = read_reference(config(tmp_path, [header, *rows]), WEEK)
    assert np.diff(table.t_ns).tolist() == [500_000_000]
    assert table.lat_deg.tolist() == [48.1, 48.0] and table.h_m.tolist() == [301.0, 300.0]
    assert table.v_n[1].tolist() == [1.0, 2.0, 3.0] and np.isnan(table.v_n[0]).all()
    assert table.rpy_deg[1].tolist() == [10.0, 20.0, 30.0] and np.isnan(table.rpy_deg[0]).all()
    assert table.quality.tolist() == [1.0, 2.0]
    assert [event.kind for event in events] == ["reference_time_order"]


def test_sigmas_of_a_reference_are_read_where_it_has_them(tmp_path: Path) -> None:
    header = "time_s,lat_deg,lon_deg,h_m,sd_n_m,sd_e_m,sd_d_m,sd_yaw_deg"
    table, _ = read_reference(config(tmp_path, [header, "1,48,9,300,1,2,3,0.5", "2,48,9,300,,,,"]), WEEK)
    assert table.sigma is not None and np.isnan(table.sigma[1]).all()
    assert table.sigma[0, :3].tolist() == [1.0, 2.0, 3.0] and table.sigma[0, 8] == 0.5
    assert np.isnan(table.sigma[0, 3:8]).all()


def test_position_alone_is_enough(tmp_path: Path) -> None:
    table, events = read_reference(
        config(tmp_path, ["time_s,lat_deg,lon_deg,h_m", "1,48,9,300", "2,48,9,300"]), WEEK
    )
    assert (
        table.sigma is None
        and np.isnan(table.v_n).all()
        and np.isnan(table.rpy_deg).all()
        and (table.quality == 1.0).all()
    )
    assert events == []


def test_repeated_time_keeps_the_first_row(tmp_path: Path) -> None:
    table, events = read_reference(
        config(tmp_path, ["time_s,lat_deg,lon_deg,h_m", "1,48,9,300", "1,49,9,300"]), WEEK
    )
    assert table.lat_deg.tolist() == [48.0] and len(events) == 1


QUALITIES = [
    "time_s,lat_deg,lon_deg,h_m,quality",
    "1,48,9,300,1",
    "2,48,9,300,2",
    "3,48,9,300,5",
    "4,48,9,300,",
]


def test_rows_beyond_the_quality_limit_are_left_out_with_an_event(tmp_path: Path) -> None:
    limited = config(tmp_path, QUALITIES).model_copy(update={"quality_max": 1.0})
    table, events = read_reference(limited, WEEK)

    assert np.diff(table.t_ns).tolist() == [3 * NS_PER_S] and table.quality.tolist() == [1.0, 1.0]
    assert [event.kind for event in events] == ["reference_rows_left_out"]
    assert "2 of 4 rows" in events[0].detail


def test_limit_that_leaves_no_row_and_limit_without_a_column_are_errors(tmp_path: Path) -> None:
    limited = config(tmp_path, QUALITIES).model_copy(update={"quality_max": 0.5})
    with pytest.raises(InputError, match="the smallest is 1"):
        read_reference(limited, WEEK)
    bare = config(tmp_path, ["time_s,lat_deg,lon_deg,h_m", "1,48,9,300"])
    with pytest.raises(ColumnError, match="'quality'"):
        read_reference(bare.model_copy(update={"quality_max": 1.0}), WEEK)


def test_missing_position_column_is_named(tmp_path: Path) -> None:
    with pytest.raises(ColumnError, match="'h_m'"):
        read_reference(config(tmp_path, ["time_s,lat_deg,lon_deg,height", "1,48,9,300"]), WEEK)


def test_latitude_that_cannot_be_is_an_error_where_the_columns_are_swapped(tmp_path: Path) -> None:
    rows = ["time_s,lat_deg,lon_deg,h_m", "1,152.5,-27.5,300", "2,152.5,-27.5,300"]
    with pytest.raises(ColumnError, match=r"152.5 is not a latitude in degrees; 2 of 2 rows") as refused:
        read_reference(config(tmp_path, rows), WEEK)
    assert (refused.value.line, refused.value.column) == (2, "lat_deg")
    assert "reference.columns.position" in refused.value.advice


def test_single_row_off_the_earth_is_left_out_and_told(tmp_path: Path) -> None:
    rows = ["time_s,lat_deg,lon_deg,h_m", "1,48,9,300", "2,48,900,300", "3,48,9,300"]
    table, events = read_reference(config(tmp_path, rows), WEEK)
    assert len(table.t_ns) == 2 and [event.kind for event in events] == ["bad_row"]
    assert "reference.csv:3, column 'lon_deg': 900 is not a longitude in degrees; 1 such" in events[0].detail


@pytest.mark.parametrize("key", ["lat_deg", "lon_deg"])
def test_declared_start_off_the_earth_is_an_error_with_its_line(tmp_path: Path, key: str) -> None:
    start = {"lat_deg": "48", "lon_deg": "9", "h_m": "300", "v_ned_mps": "[0, 0, 0]", "rpy_deg": "[0, 0, 0]"}
    lines = ["[start]", *(f"{name} = {value}" for name, value in (start | {key: "460"}).items())]
    flight = [
        "gps_week = 2385",
        "[imu]",
        'files = ["a"]',
        'grade = "mems"',
        "[gnss]",
        'files = ["b"]',
        *lines,
    ]
    with pytest.raises(ConfigError, match="less than or equal to") as refused:
        load_toml(write_lines(tmp_path / "flight.toml", flight), FlightConfig)
    assert refused.value.key == f"start.{key}" and refused.value.line is not None
