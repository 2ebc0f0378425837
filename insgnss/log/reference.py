"""Reference trajectories: a CSV file becomes a ``ReferenceTable``."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from insgnss.config.flight import Reference
from insgnss.errors import ColumnError, InputError
from insgnss.log.csv.columns import NOTHING_SHARED, ColumnSelection, FileColumns
from insgnss.log.csv.exact import most_bad_rows
from insgnss.log.csv.table import CsvTable
from insgnss.log.csv.time_tags import each_time_once, read_timed_table
from insgnss.log.detect import naming_format
from insgnss.log.events import counted
from insgnss.log.own_solution import on_earth, own_reference
from insgnss.tables import Event, Int64, ReferenceTable


def read_reference(
    config: Reference, week: int, shared: FileColumns = NOTHING_SHARED
) -> tuple[ReferenceTable, list[Event]]:
    """Read a reference trajectory; rows are sorted by time, of rows with one time the first stays.

    Velocity, attitude and sigmas are NaN where the file has none; quality is 1 where the file does not say. Rows of a
    quality beyond ``quality_max`` are left out, with an event.

    Raises
    ------
    InputError or a subclass : the file or a position column is missing, no row is good enough
    """
    names = config.columns
    sigmas = (*names.sigma_position, *names.sigma_velocity, *names.sigma_attitude)
    optional = (*names.velocity, *names.attitude, names.quality, *sigmas)
    # a limit on what is not there would leave nothing out
    needed = () if config.quality_max is None else (names.quality,)
    wanted = ColumnSelection(
        numeric=names.position,
        optional=optional,
        chosen=(*names.chosen_names(), *needed),
        elsewhere=shared.get(config.file, ()),
    )
    with naming_format(config.file):
        t_ns, table = read_timed_table(config.file, config, wanted, week)
    possible, events = _possible_rows(table, config)
    if events:
        t_ns, table = t_ns[possible], table.take(possible)
    t_ns, order, reordered = each_time_once(t_ns, config.file, "reference_time_order")
    place, velocity, attitude, sigma = (
        np.column_stack([table.column_or_nan(name)[order] for name in group])
        for group in (names.position, names.velocity, names.attitude, sigmas)
    )
    stated = sigma if any(name in table.columns for name in sigmas) else None
    quality = table.column_or_nan(names.quality)[order]
    quality = np.where(np.isnan(quality), 1.0, quality)
    reference = own_reference(t_ns, place, stated, velocity=velocity, attitude=attitude, quality=quality)
    reference, left_out = _good_rows(reference, config)
    return reference, table.events + events + reordered + left_out


def _possible_rows(table: CsvTable, config: Reference) -> tuple[Int64, list[Event]]:
    """Return the rows whose position can be, and an event where others are left out."""
    names = config.columns.position
    place = np.column_stack([table.columns[name] for name in names])
    possible = on_earth(place)
    bad = np.flatnonzero(~possible)
    if not len(bad):
        return np.flatnonzero(possible), []
    k = next(
        k for k in range(len(names)) if not on_earth(np.where(np.arange(3) == k, place[bad[:1]], 0.0))[0]
    )
    what = ("a latitude in degrees", "a longitude in degrees", "a height in metres")[k]
    line, reason = int(table.line[bad[0]]), f"{place[bad[0], k]:g} is not {what}"
    if len(bad) > min(most_bad_rows(table.n), table.n - 1):
        raise ColumnError(
            f"{reason}; {len(bad)} of {table.n} rows have such values",
            file=config.file,
            line=line,
            column=names[k],
            advice="declare the names of the columns: reference.columns.position = [latitude, longitude, height]",
        )
    detail = f"{config.file}:{line}, column '{names[k]}': {reason}; {len(bad)} such row(s) left out"
    return np.flatnonzero(possible), [Event(None, "bad_row", detail)]


def _good_rows(reference: ReferenceTable, config: Reference) -> tuple[ReferenceTable, list[Event]]:
    """Return the rows whose quality is within the limit, and an event where others are left out."""
    limit, quality = config.quality_max, reference.quality
    if limit is None or not (quality > limit).any():
        return reference, []
    good = quality <= limit
    if not good.any():
        raise InputError(
            f"no row of the reference has a quality of at most {limit:g}: the smallest is {quality.min():g}",
            file=config.file,
            key="reference.quality_max",
            advice="give a larger limit",
        )
    what = f"of {len(good)} rows have a quality beyond {limit:g}: left out"
    columns = {field.name: getattr(reference, field.name) for field in fields(reference)}
    rows: dict[str, Any] = {
        name: None if column is None else column[good] for name, column in columns.items()
    }
    return ReferenceTable(**rows), counted("reference_rows_left_out", ~good, what, config.file)
