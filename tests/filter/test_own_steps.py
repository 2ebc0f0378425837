"""A sensor's own error that steps: readings refused one after the other open its state, a single outlier does not."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from insgnss.constants import NS_PER_S
from insgnss.errors import MeasurementError
from insgnss.filter.layout_names import StatePlace
from insgnss.filter.own_rows.checked_rows import CheckedRow, checked_rows
from insgnss.filter.own_rows.declared import own_measurements
from insgnss.filter.own_rows.ledger import OwnEntry
from insgnss.filter.own_rows.rows import Kind
from insgnss.filter.own_rows.steps import open_steps
from insgnss.filter.state import DR, Bank, joined_banks
from insgnss.status import BAD_VALUE, CONTRADICTS, GATED, USED
from tests.filter.scene import new_filter, place

PARTIAL = 2.0
LAYOUT: Any = {"drum_offset": StatePlace(slice(DR + 2, DR + 3), "m", "")}


def stepping(**more: Any) -> Kind:
    source = SimpleNamespace(
        name="drum", times_ns=np.arange(5), rows=lambda state, layout: (), steps="drum_offset", **more
    )
    own = own_measurements([source])
    assert own is not None
    return own.kinds[0]


def fed(bank: Bank, kind: Kind, readings: list[tuple[float, int]]) -> list[float]:
    """Feed readings, each a time [s] and a status, 8 m off; return the times at which the error was found to step."""
    row = CheckedRow(8.0, np.array([1.0, PARTIAL]), np.array([0, DR + 2]), 1.0, 1.0)
    found = []
    for seconds, status in readings:
        t_ns = round(seconds * NS_PER_S)
        rows = {i: [(kind, row._replace(innovation=8.0 + i))] for i in range(len(bank.state))}
        steps = open_steps(bank, [OwnEntry(t_ns, "drum", 8.0, 0.25, status)], rows, LAYOUT, t_ns)
        assert all(step.place == DR + 2 and "16 sigma" in step.event.detail for step in steps)
        found += [seconds] * len(steps)
    return found


@pytest.mark.parametrize(
    ("readings", "found"),
    [
        ([(1.0, GATED), (2.0, GATED), (3.0, GATED)], [3.0]),
        ([(1.0, GATED), (1.1, GATED), (1.2, GATED), (1.9, GATED), (2.0, GATED)], [2.0]),
        ([(1.0, GATED), (2.0, GATED), (3.0, USED), (4.0, GATED), (5.0, GATED)], []),
        ([(1.0, GATED), (2.0, GATED), (3.0, BAD_VALUE), (4.0, CONTRADICTS), (5.0, GATED)], [5.0]),
        ([(float(k), GATED) for k in range(1, 8)], [3.0, 6.0]),
    ],
    ids=["three", "a second at least", "agreement between", "without a number", "twice"],
)
def test_refused_readings_in_a_row_are_a_step(readings: list[tuple[float, int]], found: list[float]) -> None:
    assert fed(new_filter(place()), stepping(), readings) == found


def test_step_gives_every_hypothesis_the_variance_of_its_own_innovation() -> None:
    bank = joined_banks(new_filter(place()), new_filter(place()))
    before = bank.P.copy()
    fed(bank, stepping(), [(1.0, GATED), (2.0, GATED), (3.0, GATED)])
    grown = bank.P - before
    np.testing.assert_allclose(grown[:, DR + 2, DR + 2], [(8.0 / PARTIAL) ** 2, (9.0 / PARTIAL) ** 2])
    grown[:, DR + 2, DR + 2] = 0.0
    assert not grown.any()


def test_kinds_that_name_no_state_are_refused_for_as_long_as_they_are_off() -> None:
    bank, kind = new_filter(place()), stepping()
    before = bank.P.copy()
    silent = Kind(kind.source, "drum", kind.times_ns, None, "m")
    assert fed(bank, silent, [(float(k), GATED) for k in range(1, 20)]) == []
    np.testing.assert_array_equal(bank.P, before)


def test_row_without_the_partial_of_the_state_that_may_step_is_an_error() -> None:
    kind = stepping()
    source: Any = SimpleNamespace(rows=lambda state, layout: (1.0, {"position": np.ones(3)}, 1.0))
    names: Any = {"position": StatePlace(slice(0, 3), "m", "ECEF"), **LAYOUT}
    state: Any = SimpleNamespace(t_ns=0)
    given = Kind(source, kind.name, kind.times_ns, None, "m", steps=kind.steps, stepping=0)
    with pytest.raises(MeasurementError, match="no single partial by 'drum_offset'"):
        checked_rows(given, state, names)
