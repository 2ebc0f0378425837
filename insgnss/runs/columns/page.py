"""The page of column names, ``COLUMNS.md``, and the same in the terminal.

Written here are the columns of the CSV logs that come in; any of their names can be mapped in the flight file.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from insgnss.runs.columns.run_tables import POINT_SHEETS, RUN_SHEETS
from insgnss.runs.columns.sheet import Sheet
from insgnss.runs.columns.statuses import STATUS_MEANINGS

_IMU = """
time_s: time of the sample; `[imu.time]` states unit, origin and scale. `columns.date` names a column of dates
  beside one of times of day, `columns.week` one of GPS weeks
gyro_x gyro_y gyro_z: angular rate or angle increment along the sensor's axes, in the unit declared by
  `gyro_unit`
accel_x accel_y accel_z: specific force or velocity increment along the sensor's axes, in the unit declared
  by `accel_unit`; at rest it points up
"""
_GNSS = """
time_s: receiver time tag of the epoch; `[gnss.time]` states unit, origin and scale; dates and weeks as in
  `imu.csv`
sv: satellite: constellation's letter or name and number, as G05 or GPS 5. Bare numbers need the column
  that `columns.system` names (letters, names as GPS, or codes that `system_codes` explains), or `gnss.system`
signal: RINEX code, as C1C, or a name that `gnss.signal_codes` explains; where the column is missing each
  constellation's usual first signal is assumed, with an event
pseudorange_m: code pseudorange
doppler_hz: RINEX sign: positive when the distance shrinks
range_rate_mps: in place of the Doppler: positive when the distance grows
carrier_phase_cycles: RINEX sign; optional
lli: RINEX loss-of-lock indicator: bit 0 slip, bit 1 half cycle unresolved; optional
cn0_dbhz: carrier to noise density ratio; optional
sigma_pseudorange_m sigma_range_rate_mps: the receiver's own sigmas; optional
sat_x_m sat_y_m sat_z_m: satellite position at the time of transmission, ECEF; optional, replaces navigation
  files
sat_vx_mps sat_vy_mps sat_vz_mps: its velocity
sat_clock_m sat_clock_drift_mps: its clock against system time, and its rate
"""
_REFERENCE = """
time_s: seconds; `[reference.time]` states unit, origin and scale; dates and weeks as in `imu.csv`
lat_deg lon_deg h_m: position, WGS-84, height above the ellipsoid
vn ve vd: velocity north, east, down, m/s; optional
roll_deg pitch_deg yaw_deg: attitude; optional
quality: quality number of the reference; optional
sd_n_m sd_e_m sd_d_m sd_vn_mps sd_ve_mps sd_vd_mps sd_roll_deg sd_pitch_deg sd_yaw_deg: its one sigma of each; optional
"""
_RECEIVER_EVENTS = """
time_s: seconds, in the time of the GNSS log
sv: satellite
event: lock, loss, search or detection
"""
_SENSOR = """
time_s: seconds; `time` of the entry states unit, origin and scale; dates and weeks as in `imu.csv`
speed: odometer: speed of the wheel, m/s unless `unit` says otherwise; with `metres_per_count` a count of pulses
sd_speed: its one sigma, in the same unit; optional, as every sigma here
pressure_hpa: barometer: static pressure, or with `unit` m or ft the pressure altitude
sd_altitude_m: one sigma of the altitude
mag_x mag_y mag_z: magnetometer: field along the sensor's axes, uT unless `unit` says otherwise
heading_deg sd_heading_deg: heading: clockwise from north, and its one sigma
roll_deg pitch_deg yaw_deg: attitude of the device
sd_roll_deg sd_pitch_deg sd_yaw_deg: one sigma of each
lat_deg lon_deg h_m: position: WGS-84; x, y, z [m] with `frame` ecef
sd_n_m sd_e_m sd_d_m: one sigma north, east, down
vn_mps ve_mps vd_mps: velocity: north, east, down; with `axes` enu name the columns of east, north, up in this order
sd_vn_mps sd_ve_mps sd_vd_mps: one sigma of each
"""
INPUT_SHEETS: Final = (
    Sheet(
        "imu.csv",
        "sample",
        _IMU,
        "`[imu.columns]` maps other names; a number is a column of a file without a header, counted from 1.",
    ),
    Sheet(
        "gnss.csv",
        "satellite, signal and epoch",
        _GNSS,
        "`[gnss.columns]` maps other names. An empty cell is a missing value.",
    ),
    Sheet("reference.csv", "time", _REFERENCE, "`[reference.columns]` maps other names."),
    Sheet(
        "sensor.csv",
        "reading of a further sensor",
        _SENSOR,
        "The files of a `[[sensor]]`, each with the columns of its kind. `columns` maps other names; `none` stands for"
        " a column that the log lacks.",
    ),
    Sheet("receiver_events.csv", "event", _RECEIVER_EVENTS, "The file that `gnss.receiver_events` names."),
)


SHEETS: Final = {sheet.name: sheet for sheet in (*INPUT_SHEETS, *RUN_SHEETS, *POINT_SHEETS)}
_HEAD: Final = """# Column names

Every table that goes in or comes out, column by column. `insgnss columns > COLUMNS.md` makes this page; a test compares
it with the tables that a replay gives. Names end in their unit; a name with a `*` is a family.

`run.nav`, `run.measurements`, ... are pandas tables; `run.save(folder)` and `insgnss replay --output folder` write each
as `<table>.parquet` or, with `--format csv`, `<table>.csv`. `insgnss columns nav` prints one table's part. Conventions
of frames and signs are in [conventions](docs/conventions.md).
"""


def columns_page() -> str:
    """Return the whole page as Markdown."""
    groups = (
        ("What goes in", INPUT_SHEETS),
        ("A run", RUN_SHEETS),
        ("A point solution", POINT_SHEETS),
    )
    parts = [_HEAD]
    for title, sheets in groups:
        parts.append(f"## {title}\n")
        parts += [sheet_text(sheet) for sheet in sheets]
    parts.append("## Status of a measurement\n\nThe column `status`, and `state` of `satellites`.\n")
    parts.append(
        _rows(("status", "meaning"), [(f"`{word}`", meaning) for word, meaning in STATUS_MEANINGS.items()])
    )
    return "\n".join(parts)


def sheet_text(sheet: Sheet) -> str:
    """Return one table's columns as Markdown."""
    rows = [
        (", ".join(f"`{column.name}`" for column in columns), _units([c.unit for c in columns]), meaning)
        for columns, meaning in sheet.lines()
    ]
    intro = f" {sheet.intro}" if sheet.intro else ""
    return f"### {sheet.name}\n\nOne row for each {sheet.row}.{intro}\n\n" + _rows(
        ("column", "unit", "meaning"), rows
    )


def _units(units: list[str]) -> str:
    """Return the unit of several columns: once where they share it."""
    words = [unit or "-" for unit in units]
    return words[0] if len(set(words)) == 1 else ", ".join(words)


def _rows(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(lines) + "\n"
