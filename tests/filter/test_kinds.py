"""The list of kinds and the chain that the compiler reads, held against each other and against the files."""

from __future__ import annotations

import ast
import inspect
from pathlib import Path

import numpy as np

from insgnss.filter import measurements
from insgnss.filter.rows.lines import WIDTH
from insgnss.filter.state import MAX_OPTIONAL, N_CLONE, OFFSETS
from insgnss.filter.update import predictions
from insgnss.gnss.observation_rows import N_KINDS


def chain() -> list[str]:
    """Return the names of the kernels that ``predict`` calls, in its order."""
    tree = ast.parse(inspect.getsource(predictions.predict))
    calls = [node.value for node in ast.walk(tree) if isinstance(node, ast.Return)]
    return [call.func.id for call in calls if isinstance(call, ast.Call) and isinstance(call.func, ast.Name)]


def test_chain_calls_every_kind_of_the_list_in_its_order() -> None:
    listed = [kernel.__name__ for _, kernel in sorted(predictions.KINDS.items())]

    assert sorted(predictions.KINDS) == list(range(N_KINDS))
    assert sorted(chain()) == sorted(listed)
    assert [name for name in chain() if name in listed[:-1]] == listed[:-1]


def test_every_file_of_a_kind_is_in_the_list() -> None:
    files = {path.stem for path in Path(measurements.__file__).parent.glob("[a-z]*.py")}

    assert {kernel.__name__ for kernel in predictions.KINDS.values()} == files


def test_columns_of_a_kind_are_states_and_leave_room_for_the_further_ones() -> None:
    for columns in predictions.columns_of(OFFSETS + 2):
        assert len(np.unique(columns)) == len(columns) <= WIDTH - 2
        assert columns.min() >= 0 and columns.max() < OFFSETS + MAX_OPTIONAL + N_CLONE
