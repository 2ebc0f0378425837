"""Reference trajectories: a CSV file becomes a ``ReferenceTable``."""

from __future__ import annotations

import numpy as np

from insgnss.config.flight import Reference
from insgnss.log.csv_columns import Wanted
from insgnss.log.csv_table import CsvTable, read_csv_table
from insgnss.log.time_tags import gps_times, wanted_with_time
from insgnss.tables import Event, Float64, ReferenceTable


def read_reference(config: Reference, week: int) -> tuple[ReferenceTable, list[Event]]:
    """Read a reference trajectory; rows are sorted by time, of rows with one time the first stays.

    Velocity, attitude and sigmas are NaN where the file has none; quality is 1 where the file does not say.

    Raises
    ------
    InputError and its kin : the file or a position column is missing
    """
    names = config.columns
    sigmas = (*names.sigma_position, *names.sigma_velocity, *names.sigma_attitude)
    optional = (*names.velocity, *names.attitude, names.quality, *sigmas)
    wanted = Wanted(numeric=names.position, optional=optional, chosen=names.chosen_names())
    table = read_csv_table(config.file, wanted_with_time(config, wanted))
    t_ns, rows, events = gps_times(table, config, week)
    table = table if rows is None else table.take(rows)
    t_ns, order = np.unique(t_ns, return_index=True)
    if len(order) != table.n or (np.diff(order) < 0).any():
        detail = (
            f"{config.file}: rows sorted by time, {table.n - len(order)} row(s) with a repeated time refused"
        )
        events.append(Event(None, "reference_time_order", detail))
    position = [table.columns[name][order] for name in names.position]
    quality = _optional(table, names.quality)[order]
    reference = ReferenceTable(
        t_ns,
        position[0],
        position[1],
        position[2],
        np.column_stack([_optional(table, name)[order] for name in names.velocity]),
        np.column_stack([_optional(table, name)[order] for name in names.attitude]),
        np.where(np.isnan(quality), 1.0, quality),
        np.column_stack([_optional(table, name)[order] for name in sigmas])
        if any(name in table.columns for name in sigmas)
        else None,
    )
    return reference, table.events + events


def _optional(table: CsvTable, name: str) -> Float64:
    return table.columns[name] if name in table.columns else np.full(table.n, np.nan)
