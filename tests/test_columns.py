"""The page of column names says what the tables hold: no column without a meaning, none that does not exist."""

from __future__ import annotations

import ast
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel
from typer.testing import CliRunner

import insgnss
from insgnss.aiding import table as aiding_table
from insgnss.cli.main import app
from insgnss.config.flight import GnssColumns, ImuColumns, MountedAntenna, ReferenceColumns
from insgnss.config.log_table import NO_COLUMN
from insgnss.config.vehicle_kind import VEHICLE_KINDS, VehicleRows
from insgnss.filter.output.writing import NAV_COLUMNS
from insgnss.inertial.sensor_model import UNIT_OF_ERROR
from insgnss.log.flight import Flight
from insgnss.results import nav_columns
from insgnss.runs.columns.page import SHEETS, columns_page
from insgnss.runs.columns.sheet import Sheet, unit_of
from insgnss.runs.columns.statuses import STATUS_MEANINGS
from insgnss.runs.point import TABLES as POINT_TABLES
from insgnss.runs.result import TABLES, Run
from insgnss.sensors.vehicle_rows import vehicle_states
from insgnss.status import NAMES
from tests.conftest import REPOSITORY
from tests.described_columns import absent, undescribed
from tests.runs.scenes import flight, turns

SAMPLE = REPOSITORY / "data" / "sample_flight" / "flight.toml"
# of a reference that states sigmas
OF_REFERENCE = {c.name for c in SHEETS["errors"].columns() if c.name.startswith("sd_reference_")}
# columns that only some runs have: of optional states, and of a log of the receiver's own
OF_LEVER = ("lever_arm_x_m", "lever_arm_y_m", "lever_arm_z_m")
OF_VEHICLES = ("mounting_pitch_deg", "mounting_yaw_deg", "leeway_deg")
FURTHER = (
    "offset_*_m",
    "glonass_bias_m_per_channel",
    "zenith_delay_m",
    "ionosphere_m",
    *OF_LEVER,
    "imu_time_offset_s",
    "range_rate_lag_s",
    *OF_VEHICLES,
)
OF_SENSORS = {
    *("*_scale_percent", "*_offset_m", "*_strength_ut", "*_declination_deg", "*_offset_deg"),
    *(f"*_iron_{axis}_ut" for axis in "xyz"),
}
OF_INERTIAL_SENSORS = {
    column.name
    for column in SHEETS["nav"].columns()
    if any(f"{kind}_*" in column.name for kind in UNIT_OF_ERROR)
}
SOMETIMES = {*FURTHER, *(f"sd_{name}" for name in FURTHER), "antenna", *OF_SENSORS, *OF_INERTIAL_SENSORS}


# where these names are those of a log's own columns, not of a result's
OF_LOGS = ("config/", "simulation/", "runs/margin/link.py")


def lists_written_out() -> list[str]:
    """Return where the package writes out a list of names that ``results.nav_columns`` has."""
    package = Path(insgnss.__file__).parent
    shared = {value for value in vars(nav_columns).values() if isinstance(value, tuple)}
    return [
        f"{place}:{node.lineno}"
        for path in sorted(package.rglob("*.py"))
        if (place := path.relative_to(package).as_posix()) != "results/nav_columns.py"
        if not place.startswith(OF_LOGS)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Tuple | ast.List)
        if tuple(part.value for part in node.elts if isinstance(part, ast.Constant)) in shared
    ]


def test_names_that_several_tables_share_are_written_once() -> None:
    assert lists_written_out() == []


def with_everything(folder: Path) -> Flight:
    """Return the sample flight with an antenna and a log of the receiver's own events."""
    events = folder / "tracking.csv"
    events.write_text("time_s,sv,event\n293800,G01,lock\n293856,G01,loss\n")
    flight = Flight.load(SAMPLE)
    gnss = flight.config.gnss.model_copy(
        update={"antenna": (MountedAntenna(pattern="patch_l1"),), "receiver_events": events}
    )
    return replace(flight, config=flight.config.model_copy(update={"gnss": gnss}))


@cache
def whole_run(folder: Path) -> Run:
    return insgnss.replay(
        with_everything(folder),
        supervise=True,
        aiding=0.1,
        point="antenna",
        quaternion=True,
        covariance=True,
        integrity=True,
    )


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return whole_run(tmp_path_factory.mktemp("columns"))


def defaults(model: type[BaseModel]) -> list[str]:
    """Return the names of the columns that are read where the flight file maps none."""
    values: list[Any] = [field.default for field in model.model_fields.values()]
    names = [name for value in values for name in ((value,) if isinstance(value, str) else value)]
    return [name for name in names if name != NO_COLUMN]


@pytest.mark.parametrize("name", TABLES)
def test_table_of_a_run_has_the_columns_of_the_page(run: Run, name: str) -> None:
    made = insgnss.replay(flight(turns(40.0)), smooth=True) if name == "filtered" else run
    table = getattr(made, name)

    assert undescribed(SHEETS[name], table.columns) == []
    assert set(absent(SHEETS[name], table.columns)) - SOMETIMES - OF_REFERENCE == set()


@pytest.mark.parametrize("name", POINT_TABLES)
def test_table_of_a_point_solution_has_the_columns_of_the_page(name: str) -> None:
    table = getattr(point_run(), name)
    filters = {
        c for c in absent(SHEETS["errors"], table.columns) if c.endswith("_deg") or "_slow_" in c
    } | OF_REFERENCE

    assert undescribed(SHEETS[name], table.columns) == []
    assert set(absent(SHEETS[name], table.columns)) - (filters if name == "errors" else set()) == set()


@cache
def point_run() -> insgnss.PointRun:
    return insgnss.point(Flight.load(SAMPLE))


@pytest.mark.parametrize(
    ("name", "model"),
    [("imu.csv", ImuColumns), ("gnss.csv", GnssColumns), ("reference.csv", ReferenceColumns)],
)
def test_log_has_the_columns_of_the_page(name: str, model: type[BaseModel]) -> None:
    assert undescribed(SHEETS[name], defaults(model)) == []
    assert absent(SHEETS[name], defaults(model)) == []


def test_schemas_of_navigation_and_aiding_are_described() -> None:
    assert (
        undescribed(SHEETS["nav"], ("time_s", *NAV_COLUMNS, "offset_E_m", "zenith_delay_m", "ionosphere_m"))
        == []
    )
    made = [
        column
        for kind in VEHICLE_KINDS
        for block in vehicle_states(VehicleRows.model_validate({"kind": kind}))
        for column in block.columns
    ]
    assert set(made) == set(OF_VEHICLES)
    assert undescribed(SHEETS["nav"], [*made, *(f"sd_{name}" for name in made)]) == []
    assert undescribed(SHEETS["aiding"], aiding_table.COLUMNS) == []


def test_every_column_has_one_meaning() -> None:
    for sheet in SHEETS.values():
        names = [column.name for column in sheet.columns()]

        assert len(names) == len(set(names)), sheet.name
        assert all(column.meaning.strip() for column in sheet.columns()), sheet.name


def test_column_without_a_meaning_is_found() -> None:
    sheet = Sheet("made", "row", "a_m: a length\nb_m:\nc_*_m: a family\n  of lengths")

    assert undescribed(sheet, ["a_m", "b_m", "c_x_m", "d_m"]) == ["b_m", "d_m"]
    assert absent(sheet, ["a_m", "b_m"]) == ["c_*_m"]
    assert sheet.columns()[-1].meaning == "a family of lengths"


def test_unit_is_the_longest_ending_of_the_name() -> None:
    names = ("doppler_rate_hz_per_s", "vn_mps", "range_jerk_mps3", "sd_gain_db", "cn0_dbhz", "sv")

    assert [unit_of(name) for name in names] == ["Hz/s", "m/s", "m/s³", "dB", "dB-Hz", ""]
    assert unit_of("gyro_x_degps_per_sqrt_hz") == "°/s/√Hz" and unit_of("gyro_x_max_degps") == "°/s"


def test_unit_of_a_ratio_is_a_ratio() -> None:
    names = [c.name for sheet in SHEETS.values() for c in sheet.columns()]
    assert [name for name in names if "_per_" in name and "/" not in unit_of(name)] == []


def test_every_status_has_a_meaning() -> None:
    assert set(STATUS_MEANINGS) == set(NAMES.values())


def test_page_is_up_to_date() -> None:
    # insgnss columns > COLUMNS.md
    assert (REPOSITORY / "COLUMNS.md").read_text(encoding="utf-8") == columns_page()


def test_command_prints_the_page_or_one_table() -> None:
    assert CliRunner().invoke(app, ["columns"]).stdout == columns_page()
    assert "`sd_yaw_deg`" in CliRunner().invoke(app, ["columns", "nav"]).stdout
    refused = CliRunner().invoke(app, ["columns", "navy"])
    assert refused.exit_code == 2
    assert "one of: imu.csv" in refused.stderr
