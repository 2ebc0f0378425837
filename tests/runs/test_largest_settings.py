"""Settings without a limit of their own, each at the largest size that is accepted: no result that is not a number."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel

import insgnss
from insgnss.config.filter import FilterConfig
from insgnss.config.library import filter_config
from insgnss.config.strict import largest_size
from insgnss.errors import InsGnssError
from insgnss.runs.result import Run
from insgnss.runs.simulate import simulate

TABLES = ("nav", "satellites", "aiding", "aiding_budget", "supervision", "transitions", "search_times")
DURATION_S = 20.0


def numbers(
    model: BaseModel, path: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], type[BaseModel], Any]]:
    """Yield the path of each number of the settings, the table's schema and its value."""
    for name in type(model).model_fields:
        value = getattr(model, name)
        if isinstance(value, BaseModel):
            yield from numbers(value, (*path, name))
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield (*path, name), type(model), value


def wild(run: Run) -> set[tuple[str, str]]:
    """Return the columns that hold something else than numbers."""
    found = set()
    for name in TABLES:
        table = getattr(run, name)
        for column in table.select_dtypes("number"):
            if not np.isfinite(table[column].to_numpy(np.float64)).all():
                found.add((name, column))
    return found


@pytest.mark.slow
def test_largest_settings_leave_every_column_a_number(tmp_path: Path) -> None:
    simulate("turning_flight", duration_s=DURATION_S).save(tmp_path)
    flight = insgnss.Flight.load(tmp_path / "flight.toml")
    usual = filter_config("tight17")
    tried, spoilt, refused = 0, {}, []
    for path, schema, value in numbers(usual):
        largest = largest_size(schema, path[-1])
        if largest is None:  # it has a limit of its own
            continue
        table = settings = usual.model_dump()
        for key in path[:-1]:
            table = table[key]
        table[path[-1]] = type(value)(largest)
        try:
            run = insgnss.replay(flight, FilterConfig.model_validate(settings), aiding=1.0, supervise=True)
        except InsGnssError:  # a start that waits for years, a mask above every signal
            refused.append(path)
            continue
        tried, spoilt[path] = tried + 1, wild(run)

    assert tried > 80 and len(refused) < 10
    assert {path: columns for path, columns in spoilt.items() if columns} == {}
