"""The study: decisions for every time and satellite, and their cost in geometry.

| table      | one row per        | columns |
|------------|--------------------|---------|
| satellites | satellite and time | time_s sv az_deg el_deg body_az_deg body_el_deg gain_dbic sd_gain_db cn0_dbhz decision reason antenna |
| dop        | time               | time_s n_all gdop_all pdop_all hdop_all vdop_all tdop_all n_seen gdop_seen ... : above the elevation mask, and of those what the antennas see |
| events     | event              | time_s kind detail |
"""  # noqa: E501 - the table is the documentation

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import pandas as pd

from insgnss.antenna.equipment import limits_of
from insgnss.antenna.installation import Installation
from insgnss.antenna.visibility import DECISIONS, IS_UNCERTAIN, IS_VISIBLE, look_at_all, new_looks
from insgnss.config.filter import Visibility
from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.geodesy.directions import angle_columns
from insgnss.gnss.dilution import DOPS
from insgnss.gpstime import ns_to_week_seconds
from insgnss.results.shown import ResultDisplay
from insgnss.results.table_files import save_study, table_files, words
from insgnss.runs.datum import annotate
from insgnss.runs.result_tables import event_table, status_words
from insgnss.runs.visibility.attitude_history import AttitudeHistory
from insgnss.runs.visibility.sky import SatelliteDirections
from insgnss.status import MASKED_ELEVATION, NAMES, USED
from insgnss.tables import Bool, Event, Float64, Int8, Int64, stretches_of

TABLES: Final = ("satellites", "dop", "events")
FILES: Final = table_files(f"visibility_{name}" for name in TABLES)
STUDY_NAME: Final = "visibility study"  # in the record of a folder
_SINGULAR_GDOP: Final = 1e6  # beyond it the geometry has no solution, only rounding
_FEWEST: Final = 4  # satellites of one clock that fix a position


@dataclass(frozen=True, repr=False)
class VisibilityStudy(ResultDisplay):
    """The result of ``visibility``. Tables are DataFrames."""

    satellites: pd.DataFrame
    dop: pd.DataFrame
    events: pd.DataFrame
    antennas: Installation
    settings: Visibility = field(default_factory=Visibility)

    def save(self, folder: str | Path, format: Literal["parquet", "csv"] = "parquet") -> Path:
        """Write the tables as ``visibility_*`` into ``folder`` (made if needed); return the folder.

        Raises
        ------
        ResultError : the folder cannot be written, or another program's file has one of the names
        """
        tables = {f"visibility_{name}": getattr(self, name) for name in TABLES}
        return save_study(folder, tables, format, STUDY_NAME)


def visibility(
    attitude: AttitudeHistory,
    sky: SatelliteDirections,
    antennas: Installation,
    settings: Visibility | None = None,
    *,
    elevation_mask_deg: float = 5.0,
    week: int | None = None,
    events: Sequence[Event] = (),
) -> VisibilityStudy:
    """Return which satellites the antennas see along an attitude history, and the dilution with and without the stage.

    Parameters
    ----------
    attitude : position and attitude of the vehicle
    sky : directions of the satellites at the same times
    antennas : ``insgnss.antenna.equipment.installation`` of the flight's antennas
    settings : thresholds, hysteresis, margin and link budget
    elevation_mask_deg : above the local horizon; lower satellites count as not there in both cases
    week : GPS week from which ``time_s`` counts; that of the first time when None
    events : found before, such as by the readers
    """
    settings = Visibility() if settings is None else settings
    if week is None:
        week = int(attitude.t_ns[0] // NS_PER_WEEK)
    u_n = sky.directions()
    looks = new_looks(*u_n.shape[:2])
    decision, reason, antenna, gain = looks
    arrays = (np.ascontiguousarray(attitude.C_nb), np.ascontiguousarray(attitude.P_b), u_n)
    look_at_all(*arrays, antennas, limits_of(settings), looks)
    above = sky.elevation >= np.radians(elevation_mask_deg)  # false for NaN
    seen = above & ((decision & IS_VISIBLE) == 1) if settings.on else above
    reason[~above] = MASKED_ELEVATION
    table = _satellite_table(week, sky, attitude, u_n, decision, reason, antenna, gain, settings)
    all_events = [*events, *_waiting(attitude, settings), *_blind_spells(attitude.t_ns, above, seen)]
    if settings.on:
        all_events += _uncertain(attitude, above, above & ((decision & IS_UNCERTAIN) != 0), settings)
    return VisibilityStudy(
        table,
        dop_table(attitude.t_ns, week, u_n, sky.sv_names, above, seen),
        event_table(all_events, week),
        antennas,
        settings,
    )


def _satellite_table(
    week: int,
    sky: SatelliteDirections,
    attitude: AttitudeHistory,
    u_n: Float64,
    decision: Int8,
    reason: Int8,
    antenna: Int8,
    gain: Float64,
    settings: Visibility,
) -> pd.DataFrame:
    """Return one row for each satellite and time at which its place is known."""
    u_b = np.einsum("nji,nsj->nsi", attitude.C_nb, u_n)
    known = np.isfinite(sky.elevation)
    at, sv = np.nonzero(known)
    columns: dict[str, Any] = {
        "time_s": ns_to_week_seconds(attitude.t_ns[at], week),
        "sv": words(sv, sky.sv_names),
        "az_deg": np.degrees(sky.azimuth[known]) % 360.0,
        "el_deg": np.degrees(sky.elevation[known]),
        **angle_columns(u_b[known], "body_"),
        "gain_dbic": gain[known, 0],
        "sd_gain_db": gain[known, 1],
        "cn0_dbhz": settings.nominal_cn0_dbhz + gain[known, 0],
        "decision": words(decision[known], DECISIONS),
        "reason": status_words(reason[known], {**NAMES, USED: "none"}),
        "antenna": antenna[known].astype(np.int64),
    }
    table = pd.DataFrame(columns)
    annotate(table, week)
    return table


def dop_table(
    t_ns: Int64, week: int, u_n: Float64, sv_names: Sequence[str], above: Bool, seen: Bool
) -> pd.DataFrame:
    """Return number and dilution of all satellites above the mask (``_all``) and of those seen (``_seen``)."""
    columns: dict[str, Any] = {"time_s": ns_to_week_seconds(t_ns, week)}
    for label, use in (("all", above), ("seen", seen)):
        columns[f"n_{label}"] = use.sum(axis=1)
        values = dilutions(u_n, sv_names, use)
        columns |= {f"{name}_{label}": values[:, k] for k, name in enumerate(DOPS)}
    return pd.DataFrame(columns)


def dilutions(u_n: Float64, sv_names: Sequence[str], use: Bool) -> Float64:
    """Return GDOP, PDOP, HDOP, VDOP, TDOP (n, 5) of the satellites in ``use`` (n, s); NaN where they fix no position.

    Equation: Q = (H^T H)^-1, rows h = (-u, 1 at the clock of the satellite's constellation); GDOP and TDOP hold the
    clock of the first constellation in use    [Misra and Enge 2011, section 6.1.2]
    """
    letters = sorted({name[0] for name in sv_names}, key="GERCJIS".find)
    clock = np.array([[name[0] == letter for letter in letters] for name in sv_names], np.float64)
    H = np.concatenate([-np.nan_to_num(u_n), np.broadcast_to(clock, (len(u_n), *clock.shape))], axis=2)
    N = np.einsum("nsi,ns,nsj->nij", H, use.astype(np.float64), H)
    clocks = 3 + np.arange(len(letters))
    idle = N[:, clocks, clocks] == 0.0  # no satellite of that constellation: its clock is not an unknown
    N[:, clocks, clocks] += idle
    enough = use.sum(axis=1) >= _FEWEST - 1 + (~idle).sum(axis=1)
    values = np.full((len(u_n), len(DOPS)), np.nan)
    solvable = enough.copy()
    solvable[enough] = np.linalg.cond(N[enough]) < _SINGULAR_GDOP**2
    if solvable.any():
        Q = np.diagonal(np.linalg.inv(N[solvable]), axis1=1, axis2=2)
        first = 3 + np.argmin(idle[solvable], axis=1)
        time = np.take_along_axis(Q, first[:, None], axis=1)[:, 0]
        level = Q[:, 0] + Q[:, 1]
        values[solvable] = np.sqrt(
            np.column_stack([level + Q[:, 2] + time, level + Q[:, 2], level, Q[:, 2], time])
        )
    return values


def _waits(attitude: AttitudeHistory, settings: Visibility) -> Bool:
    """Return where masking waits for the heading, (n,)."""
    down = attitude.C_nb[:, 2, :]
    variance = np.einsum("ni,nij,nj->n", down, attitude.P_b, down)
    return np.asarray(variance > np.radians(settings.heading_sigma_limit_deg) ** 2)


def _uncertain(
    attitude: AttitudeHistory, above: Bool, is_uncertain: Bool, settings: Visibility
) -> list[Event]:
    """Report once how many decisions were uncertain, without those that wait for the heading."""
    counted = is_uncertain & ~_waits(attitude, settings)[:, None]
    if not counted.any():
        return []
    t_ns = int(attitude.t_ns[counted.any(axis=1).argmax()])
    words = {"keep": "kept where seen before", "hide": "hidden", "deweight": "kept where seen before"}
    detail = (
        f"{counted.sum()} of {above.sum()} decisions too close to the limit of what the antennas see:"
        f" {words[settings.uncertain]}"
    )
    return [Event(t_ns, "masking_uncertain", detail)]


def _waiting(attitude: AttitudeHistory, settings: Visibility) -> list[Event]:
    """Report where masking waits for the heading."""
    waits = _waits(attitude, settings)
    return [
        Event(
            begin,
            "masking_waits",
            f"heading uncertain for {(end - begin) / NS_PER_S:.1f} s: nothing is masked",
        )
        for begin, end in _spells(attitude.t_ns, waits)
    ]


def _blind_spells(t_ns: Int64, above: Bool, seen: Bool) -> list[Event]:
    """Report where fewer than four satellites are seen though more are above the elevation mask."""
    few = (seen.sum(axis=1) < _FEWEST) & (above.sum(axis=1) >= _FEWEST)
    return [
        Event(
            begin,
            "few_satellites_seen",
            f"fewer than four satellites visible for {(end - begin) / NS_PER_S:.1f} s",
        )
        for begin, end in _spells(t_ns, few)
    ]


def _spells(t_ns: Int64, is_so: Bool) -> list[tuple[int, int]]:
    """Return first and last time of each run of True."""
    return [(int(t_ns[a]), int(t_ns[b - 1])) for a, b in stretches_of(is_so)]
