"""A user's own measurement kind: what it is asked for, and what its answers are checked for.

The signs are those of the package. The error is estimate minus truth, ``C_eb_hat = (I + [psi x]) C_eb``. A row's value
is measured minus predicted, and its partials are those of the **prediction** by the state, with their plain sign: how
much the prediction grows when the position, the velocity, a bias grows, or when C_eb becomes (I + [psi x]) C_eb.

| row | value | partials |
|---|---|---|
| height h | h - state.h_m | {"position": state.up_e} |
| yaw | remainder(yaw - state.yaw_rad, 2 pi) | {"attitude": state.rpy_by_attitude[2]} |
| velocity v along u | v - u @ state.v_e | {"velocity": u} |
| range to a beacon at b | range - abs(b - state.r_e) | {"position": -(b - state.r_e) / abs(b - state.r_e)} |
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.errors import MeasurementError
from insgnss.filter.layout_names import StateLayout
from insgnss.filter.own_rows.live_times import LiveTimes
from insgnss.filter.own_rows.state_estimate import StateEstimate
from insgnss.tables import Float64, Int64

_LARGEST_VALUE: Final = 1e18  # in any unit; its square is a number that every table holds
_LEAST_VARIANCE, _LARGEST_VARIANCE = 1e-36, 1e36
# the ledger's other kinds
BUILT_IN: Final = ("pseudorange", "range_rate", "carrier_difference", "attitude_difference")


class Row(NamedTuple):
    """One scalar measurement; a plain tuple of the first three is as good."""

    innovation: float  # measured minus predicted; NaN or beyond 1e18: the row is refused as 'bad_value'
    partials: Mapping[str, npt.ArrayLike]  # of the prediction, by the names of the layout
    variance: float  # of the measurement's error, as it counts in the update
    # of this one error, where ``variance`` is larger because the errors of successive rows go together: gate and ledger
    # take this one; None: they are the same
    single_variance: float | None = None
    # second-order terms of the prediction where its partials turn with the state: the matrix M of a^T M b for two
    # blocks by their names. The update takes their mean out of the innovation and adds their variance
    second: Mapping[tuple[str, str], npt.ArrayLike] | None = None


RowsGiven: TypeAlias = Row | tuple[float, Mapping[str, npt.ArrayLike], float] | Iterable[Any]


class Measurement(Protocol):
    """A measurement kind of a user's own, for ``measurements=[...]`` of ``replay`` and ``Engine``.

    Beside what stands here an object may have

    - ``gate_sigma``: above so many sigmas of its predicted innovation a row is refused; None: no gate. Without it the
      gate is that of the pseudoranges.
    - ``unit``: of its innovations, for the report.
    - ``together``: True where one row beyond the gate refuses all of the same time.
    - ``hint``: what to look at where its rows are refused for long, for the event that tells it.
    """

    @property
    def name(self) -> str:
        """The kind in the ledger: a valid identifier, not that of a built-in kind or of another measurement."""

    @property
    def times_ns(self) -> Int64:
        """GPS times [ns] of its rows (k,), increasing integers; ``flight.gps_ns`` makes them of seconds of the week."""

    def rows(self, state: StateEstimate, layout: StateLayout) -> RowsGiven:
        """Return one row or a sequence of rows at ``state.t_ns``; an empty sequence where nothing was measured.

        It is called for each open heading, and again where the filter looks back or runs beside itself: the answer must
        depend on ``state`` alone. Every heading must be given as many rows as the others.
        """


class SecondOrder(NamedTuple):
    """A term a^T M b of a prediction, a and b the errors of two blocks."""

    a: Int64  # (n,) where the block stands in the error state
    b: Int64  # (m,)
    M: Float64  # (n, m)

    def moments(self, P: Float64) -> tuple[float, float]:
        """Return mean and variance of the term for errors of covariance P.

        Equation: E = tr(M^T P_ab), Var = tr(M P_bb M^T P_aa) + tr(M P_ba M P_ba)
        """
        P_aa, P_bb, P_ab = (
            P[np.ix_(*each)] for each in ((self.a, self.a), (self.b, self.b), (self.a, self.b))
        )
        turned = self.M @ P_ab.T
        variance = np.sum((self.M @ P_bb @ self.M.T) * P_aa) + np.sum(turned * turned.T)
        return float(np.sum(self.M * P_ab)), float(variance)


class CheckedRow(NamedTuple):
    """A row as the update takes it."""

    innovation: float
    h: Float64  # (k,)
    columns: Int64  # (k,) where its entries stand in the error state
    variance: float
    single_variance: float  # for the gate
    second: tuple[SecondOrder, ...] = ()


@dataclass(frozen=True)
class Kind:
    """A measurement whose name, times and gate are in order."""

    source: Measurement
    name: str
    times_ns: Int64  # (k,)
    gate2: float | None  # squared; None: that of the pseudoranges; infinite: no gate
    unit: str
    together: bool = False  # one row beyond the gate refuses all of its time
    hint: str = ""  # what to look at where its rows are refused


@dataclass(frozen=True)
class OwnMeasurements:
    """All measurements that a user adds to a filter, on one time line."""

    kinds: tuple[Kind, ...]
    times_ns: Int64  # (m,) at which there are rows, each once, increasing; without the live ones
    arrived: LiveTimes = field(default_factory=LiveTimes)

    @property
    def named(self) -> str:
        """The names of all kinds, in a sentence."""
        return ", ".join(kind.name for kind in self.kinds)

    def due(self, after_ns: int, until_ns: int) -> list[int]:
        """Return the times after ``after_ns``, up to ``until_ns``."""
        first, last = np.searchsorted(self.times_ns, [after_ns, until_ns], side="right")
        known = [int(t) for t in self.times_ns[first:last]]
        live = self.arrived.due(after_ns, until_ns)
        return sorted({*known, *live}) if live else known

    def at(self, t_ns: int) -> list[Kind]:
        """Return the kinds that have rows at a time, in the order in which they were given."""
        live = self.arrived.names_at(t_ns)
        return [kind for kind in self.kinds if kind.name in live or _has(kind.times_ns, t_ns)]

    def epochs_before_next(self, epoch_ns: Int64, epoch: int, last: int) -> int:
        """Return the epoch after those that come before the next rows: after ``epoch``, ``last`` at most."""
        k = int(np.searchsorted(self.times_ns, epoch_ns[epoch], side="right"))
        times = [int(t) for t in self.times_ns[k : k + 1]] + self.arrived.next_after(int(epoch_ns[epoch]))
        return min([last, *(int(np.searchsorted(epoch_ns, t_ns)) for t_ns in times)])


def _has(times_ns: Int64, t_ns: int) -> bool:
    k = int(np.searchsorted(times_ns, t_ns))
    return k < len(times_ns) and int(times_ns[k]) == t_ns


def own_measurements(measurements: Sequence[Measurement]) -> OwnMeasurements | None:
    """Return a user's measurements checked, None where there is none.

    Raises
    ------
    MeasurementError : a name is taken, repeated or not an identifier; times are not increasing integers; a gate is not
        positive; ``name``, ``times_ns`` or ``rows`` is missing
    """
    kinds = tuple(_checked_kind(each, place) for place, each in enumerate(measurements))
    if not kinds:
        return None
    names = [kind.name for kind in kinds]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise MeasurementError(f"two measurements are called '{twice[0]}'", advice="give each its own name")
    times_ns = np.unique(np.concatenate([kind.times_ns for kind in kinds]))
    return OwnMeasurements(kinds, times_ns)


def _checked_kind(source: Measurement, place: int) -> Kind:
    missing = [name for name in ("name", "times_ns", "rows") if not hasattr(source, name)]
    if missing or not callable(source.rows):
        message = ", ".join(missing) or "a method 'rows'"
        raise MeasurementError(
            f"measurement {place + 1} of the list, a {type(source).__name__}, lacks {message}",
            advice="a measurement has name, times_ns and rows(state, layout): insgnss.Measurement",
        )
    name: Any = source.name
    if not (isinstance(name, str) and name.isidentifier()):
        raise MeasurementError(
            f"{name!r} is not a name for a measurement",
            advice="letters, digits and underscores, as 'map_height'",
        )
    if name in BUILT_IN:
        raise MeasurementError(f"'{name}' is a built-in kind", advice="call the measurement otherwise")
    times_ns, gate2 = _checked_times(name, source.times_ns), _gate2(name, source)
    words = [str(getattr(source, key, "")) for key in ("unit", "hint")]
    return Kind(source, name, times_ns, gate2, words[0], bool(getattr(source, "together", False)), words[1])


def _checked_times(name: str, times_ns: object) -> Int64:
    given: npt.NDArray[Any] = np.asarray(times_ns)
    advice = (
        "give increasing integers, GPS time in ns; flight.gps_ns(time_s) makes them from seconds of the week"
    )
    if given.ndim != 1 or not (len(given) == 0 or np.issubdtype(given.dtype, np.integer)):
        message = f"times_ns of measurement '{name}' has shape {given.shape} and type {given.dtype}"
        raise MeasurementError(message, advice=advice)
    times = given.astype(np.int64)
    late = np.flatnonzero(np.diff(times) <= 0)
    if len(late):
        at = int(late[0]) + 1
        raise MeasurementError(
            f"times_ns of measurement '{name}' does not increase: entry {at} is {times[at]} after {times[at - 1]}",
            advice=advice,
        )
    return times


def _gate2(name: str, source: Measurement) -> float | None:
    if not hasattr(source, "gate_sigma"):
        return None
    gate = source.gate_sigma
    if gate is None:
        return math.inf
    if (
        isinstance(gate, bool)
        or not isinstance(gate, int | float | np.number)
        or not 0.0 < float(gate) < math.inf
    ):
        raise MeasurementError(
            f"gate_sigma of measurement '{name}' is {gate!r}",
            advice="give a positive number, or None for no gate",
        )
    return float(gate) ** 2


def checked_rows(kind: Kind, state: StateEstimate, layout: StateLayout) -> list[CheckedRow]:
    """Return the rows that a user's measurement gives for a state.

    Raises
    ------
    MeasurementError : its code raised an exception, or a row is not one
    """
    try:
        given = kind.source.rows(state, layout)
        rows = [given] if _is_row(given) else list(given)
    except Exception as error:
        message = f"{type(error).__name__}: {error}"
        advice = "return (innovation, {name: partials}, variance) or a sequence of them, () for none"
        raise MeasurementError(
            _at(kind, state.t_ns, f"rows() failed with {message}"), advice=advice
        ) from error
    return [_checked_row(kind, state.t_ns, row, layout) for row in rows]


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
    if not parts:
        message = _at(kind, t_ns, "a row has no partials")
        raise MeasurementError(message, advice=f"name at least one of: {layout}")
    h, columns = (np.concatenate(each) for each in zip(*parts, strict=True))
    h, columns = np.ascontiguousarray(h), np.ascontiguousarray(columns)
    return CheckedRow(innovation, h, columns, variance, single, second)


def _second(
    kind: Kind, t_ns: int, given: Mapping[tuple[str, str], npt.ArrayLike], layout: StateLayout
) -> tuple[SecondOrder, ...]:
    terms = []
    for (name_a, name_b), values in given.items():
        M = np.asarray(values, np.float64)
        places = [_columns(kind, t_ns, name, layout) for name in (name_a, name_b)]
        if M.shape != tuple(map(len, places)) or not np.isfinite(M).all():
            message = _at(
                kind, t_ns, f"the second-order term of '{name_a}' and '{name_b}' has shape {M.shape}"
            )
            raise MeasurementError(message, advice="give a matrix of finite numbers, a row for each state")
        terms.append(SecondOrder(places[0], places[1], M))
    return tuple(terms)


def _variance(kind: Kind, t_ns: int, given: Any) -> float:
    variance = _number(kind, t_ns, "variance", given)
    if not _LEAST_VARIANCE < variance < _LARGEST_VARIANCE:
        message = _at(kind, t_ns, f"the variance is {variance:g}")
        raise MeasurementError(
            message, advice="give a positive number, the square of the measurement's sigma"
        )
    return variance


def _number(kind: Kind, t_ns: int, what: str, given: Any) -> float:
    try:
        return float(np.asarray(given).astype(np.float64, casting="same_kind").reshape(()))
    except (TypeError, ValueError) as error:
        message = _at(kind, t_ns, f"the {what} is {str(given)[:60]}")
        raise MeasurementError(message, advice="give one number") from error


def _partials(
    kind: Kind, t_ns: int, name: str, given: npt.ArrayLike, layout: StateLayout
) -> tuple[Float64, Int64]:
    columns, block = _columns(kind, t_ns, name, layout), layout[name]
    advice = f"give {block} partials of the prediction by '{name}'".replace("] ", "], ")
    try:
        values = np.atleast_1d(np.array(given, np.float64))
    except (TypeError, ValueError) as error:
        message = _at(kind, t_ns, f"the partials of '{name}' are {str(given)[:60]}")
        raise MeasurementError(message, advice=advice) from error
    if values.shape != (block.size,) or not np.isfinite(values).all():
        message = f"of shape {values.shape}" if values.shape != (block.size,) else f"{values.tolist()}"
        raise MeasurementError(_at(kind, t_ns, f"the partials of '{name}' are {message}"), advice=advice)
    return values, columns


def _columns(kind: Kind, t_ns: int, name: str, layout: StateLayout) -> Int64:
    """Return where a block of the name stands in the error state."""
    if name not in layout:
        near = difflib.get_close_matches(str(name), list(layout), n=2, cutoff=0.4)
        advice = f"nearest: {', '.join(near)}; " if near else ""
        message = _at(kind, t_ns, f"this filter has no state '{name}'")
        raise MeasurementError(message, advice=f"{advice}the blocks are: {layout}")
    block = layout[name]
    return np.arange(block.columns.start, block.columns.stop, dtype=np.int64)
