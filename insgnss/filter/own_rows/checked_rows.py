"""A user's measurement rows, checked, in the form of the update."""

from __future__ import annotations

import difflib
import functools
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.errors import MeasurementError
from insgnss.filter.layout_names import StateLayout, StatePlace
from insgnss.filter.output.writing import LARGEST_VARIANCE, LEAST_VARIANCE
from insgnss.filter.own_rows.rows import Kind
from insgnss.filter.own_rows.state_estimate import StateEstimate
from insgnss.tables import Float64, Int64

_LARGEST_VALUE: Final = 1e18  # in any unit; its square is a number that every table holds


class SecondOrder(NamedTuple):
    """A term a^T M b of a prediction, a and b the errors of two blocks."""

    a: Int64  # (n,) place of the block in the error state
    b: Int64  # (m,)
    M: Float64  # (n, m)

    def moments(self, P: Float64) -> tuple[float, float]:
        """Return mean and variance of the term for errors of covariance P.

        Equation: E = tr(M^T P_ab), Var = tr(M P_bb M^T P_aa) + tr(M P_ba M P_ba)
        """
        a, b = self.a[:, None], self.b[:, None]
        P_aa, P_bb, P_ab = P[a, self.a], P[b, self.b], P[a, self.b]
        turned = self.M @ P_ab.T
        variance = np.sum((self.M @ P_bb @ self.M.T) * P_aa) + np.sum(turned * turned.T)
        return float(np.sum(self.M * P_ab)), float(variance)


class CheckedRow(NamedTuple):
    """A row as the update takes it."""

    innovation: float
    h: Float64  # (k,)
    columns: Int64  # (k,) places of its entries in the error state
    variance: float
    single_variance: float  # for the gate
    second: tuple[SecondOrder, ...] = ()


def checked_rows(kind: Kind, state: StateEstimate, layout: StateLayout) -> list[CheckedRow]:
    """Return the rows that a user's measurement gives for a state.

    Raises
    ------
    MeasurementError : its code raised an exception, or a row is not one
    """
    if kind.late_ns:
        state = replace(state, t_ns=state.t_ns + kind.late_ns)
    try:
        given = kind.source.rows(state, layout)
        rows = [given] if _is_row(given) else list(given)
    except Exception as error:
        message = f"{type(error).__name__}: {error}"
        advice = "return (innovation, {name: partials}, variance) or a sequence of them, () for none"
        raise MeasurementError(
            _at(kind, state.t_ns, f"rows() failed with {message}"), advice=advice
        ) from error
    checked = [_checked_row(kind, state.t_ns, row, layout) for row in rows]
    return [_widened(row, kind.widened2) for row in checked] if kind.widened2 != 1.0 else checked


def _widened(row: CheckedRow, factor2: float) -> CheckedRow:
    return row._replace(variance=factor2 * row.variance, single_variance=factor2 * row.single_variance)


def _is_row(given: object) -> bool:
    return isinstance(given, tuple) and len(given) in (3, 4, 5) and isinstance(given[1], Mapping)


def _at(kind: Kind, t_ns: int, message: str) -> str:
    seconds = (t_ns % NS_PER_WEEK) / NS_PER_S
    return f"measurement '{kind.name}' at {seconds:.3f} s of the week ({t_ns} ns): {message}"


def _checked_row(kind: Kind, t_ns: int, row: Any, layout: StateLayout) -> CheckedRow:
    if not _is_row(row):
        message = _at(kind, t_ns, f"a row is {str(row)[:60]}")
        raise MeasurementError(message, advice="a row is (innovation, {name: partials}, variance)")
    innovation = _number(kind, t_ns, "innovation", row[0])
    if not abs(innovation) < _LARGEST_VALUE:
        return CheckedRow(math.nan, np.zeros(0), np.zeros(0, np.int64), math.nan, math.nan)
    variance = _variance(kind, t_ns, row[2])
    single = variance if len(row) < 4 or row[3] is None else _variance(kind, t_ns, row[3])
    second = () if len(row) < 5 or row[4] is None else _second(kind, t_ns, row[4], layout)
    parts = [_partials(kind, t_ns, name, given, layout) for name, given in row[1].items()]
    if kind.steps and (kind.steps not in row[1] or np.size(row[1][kind.steps]) != 1):
        message = _at(kind, t_ns, f"a row has no single partial by '{kind.steps}', the state that may step")
        raise MeasurementError(message, advice="give it, or leave out 'steps'")
    if not parts:
        message = _at(kind, t_ns, "a row has no partials")
        raise MeasurementError(message, advice=f"name at least one of: {layout}")
    h = np.concatenate([values for values, _, _ in parts])
    if not np.isfinite(h).all():
        raise _not_finite(kind, t_ns, dict(zip(row[1], parts, strict=True)), layout)
    columns = _columns(tuple((first, last) for _, first, last in parts))
    return CheckedRow(innovation, h, columns, variance, single, second)


@functools.lru_cache(maxsize=1024)
def _columns(places: tuple[tuple[int, int], ...]) -> Int64:
    """Return the columns of several blocks, each from its first to before its last."""
    columns = np.concatenate([np.arange(first, last, dtype=np.int64) for first, last in places])
    columns.flags.writeable = False
    return columns


def _second(
    kind: Kind, t_ns: int, given: Mapping[tuple[str, str], npt.ArrayLike], layout: StateLayout
) -> tuple[SecondOrder, ...]:
    terms = []
    for names, values in given.items():
        M = np.asarray(values, np.float64)
        blocks = [_block(kind, t_ns, name, layout).columns for name in names]
        places = [_columns(((block.start, block.stop),)) for block in blocks]
        if M.shape != tuple(map(len, places)) or not np.isfinite(M).all():
            message = f"the second-order term of '{names[0]}' and '{names[1]}' has shape {M.shape}"
            raise MeasurementError(
                _at(kind, t_ns, message), advice="give a matrix of finite numbers, a row for each state"
            )
        terms.append(SecondOrder(places[0], places[1], M))
    return tuple(terms)


def _variance(kind: Kind, t_ns: int, given: Any) -> float:
    variance = _number(kind, t_ns, "variance", given)
    if not LEAST_VARIANCE < variance < LARGEST_VARIANCE:
        message = _at(kind, t_ns, f"the variance is {variance:g}")
        raise MeasurementError(
            message, advice="give a positive number, the square of the measurement's sigma"
        )
    return variance


def _number(kind: Kind, t_ns: int, what: str, given: Any) -> float:
    if type(given) is float:
        return given
    try:
        return float(np.asarray(given).astype(np.float64, casting="same_kind").reshape(()))
    except (TypeError, ValueError) as error:
        message = _at(kind, t_ns, f"the {what} is {str(given)[:60]}")
        raise MeasurementError(message, advice="give one number") from error


def _partials(kind: Kind, t_ns: int, name: str, given: Any, layout: StateLayout) -> tuple[Float64, int, int]:
    """Return the partials by a block, and where the block begins and ends in the error state."""
    block = _block(kind, t_ns, name, layout)
    try:
        values = np.array([given] if isinstance(given, float) else given, np.float64, ndmin=1)
    except (TypeError, ValueError) as error:
        message = _at(kind, t_ns, f"the partials of '{name}' are {str(given)[:60]}")
        raise MeasurementError(message, advice=_wanted_partials(name, block)) from error
    if values.shape != (block.size,):
        message = _at(kind, t_ns, f"the partials of '{name}' are of shape {values.shape}")
        raise MeasurementError(message, advice=_wanted_partials(name, block))
    return values, block.columns.start, block.columns.stop


def _not_finite(
    kind: Kind, t_ns: int, parts: Mapping[str, tuple[Float64, int, int]], layout: StateLayout
) -> MeasurementError:
    name = next(name for name, (values, _, _) in parts.items() if not np.isfinite(values).all())
    message = _at(kind, t_ns, f"the partials of '{name}' are {parts[name][0].tolist()}")
    return MeasurementError(message, advice=_wanted_partials(name, layout[name]))


def _wanted_partials(name: str, block: StatePlace) -> str:
    return f"give {block} partials of the prediction by '{name}'".replace("] ", "], ")


def _block(kind: Kind, t_ns: int, name: str, layout: StateLayout) -> StatePlace:
    """Return the block of a name."""
    if name not in layout:
        near = difflib.get_close_matches(str(name), list(layout), n=2, cutoff=0.4)
        advice = f"nearest: {', '.join(near)}; " if near else ""
        message = _at(kind, t_ns, f"this filter has no state '{name}'")
        raise MeasurementError(message, advice=f"{advice}the blocks are: {layout}")
    return layout[name]
