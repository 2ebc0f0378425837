"""The checks of a user's own measurement kinds, before a filter uses them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_WEEK
from insgnss.errors import MeasurementError
from insgnss.filter.own_rows.live_times import LiveTimes
from insgnss.filter.own_rows.rows import (
    NOT_CARRYING,
    NOT_STEPPING,
    NOT_WATCHED,
    Kind,
    Measurement,
    OwnMeasurements,
    on_one_line,
)
from insgnss.filter.state import MAX_WATCHED
from insgnss.tables import Int64

_SHORTEST_PERIOD_NS: Final = 1_000_000
# the ledger's other kinds
BUILT_IN: Final = ("pseudorange", "range_rate", "carrier_difference", "attitude_difference")


def own_measurements(
    measurements: Sequence[Measurement], beside: Sequence[Measurement] = ()
) -> OwnMeasurements | None:
    """Return a user's measurements checked, behind those that a filter has already; None without any.

    Raises
    ------
    MeasurementError : a name is taken, repeated or not an identifier; times are not increasing integers; a gate is not
        positive; a setting is not of its type; ``name``, ``times_ns`` or ``rows`` is missing; ``times_ns`` stands
        beside ``period_ns``; more than 16 kinds are watched or tell the heading, carry, or step; not a
        list
    """
    given: Any = measurements
    if not isinstance(given, Sequence):
        advice = "give a list: measurements=[...]"
        raise MeasurementError(f"measurements is a {type(given).__name__}, not a list", advice=advice)
    kinds = tuple(
        _checked_kind(each, place) for of in (beside, measurements) for place, each in enumerate(of)
    )
    if not kinds:
        return None
    names = [kind.name for kind in kinds]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise MeasurementError(f"two measurements are called '{twice[0]}'", advice="give each its own name")
    wishes = ("watched", "tells_heading"), ("carrying",), ("steps",)
    watched, carrying, stepping = (_places(kinds, *each) for each in wishes)
    # the remaining places go to the other kinds: these are left out only where a look back finds them wrong
    others = [kind.name for kind in kinds if kind.name not in watched]
    leaving = {name: place for place, name in enumerate([*watched, *others][:MAX_WATCHED])}
    kinds = tuple(
        replace(
            kind,
            watch=leaving.get(kind.name, NOT_WATCHED),
            carrying=carrying.get(kind.name, NOT_CARRYING),
            stepping=stepping.get(kind.name, NOT_STEPPING),
        )
        for kind in kinds
    )
    return on_one_line(kinds, LiveTimes())


def _places(kinds: Iterable[Kind], *wishes: str) -> dict[str, int]:
    """Return the places of the kinds whose measurement has one of some attributes, True or not empty."""
    names = [kind.name for kind in kinds if any(getattr(kind.source, wish, False) for wish in wishes)]
    if len(names) > MAX_WATCHED:
        named = " or ".join(f"'{wish}'" for wish in wishes)
        raise MeasurementError(
            f"{len(names)} measurements have {named} set: {', '.join(names)}",
            advice=f"at most {MAX_WATCHED} can have it; leave it out for the others",
        )
    return {name: place for place, name in enumerate(names)}


def _checked_kind(source: Measurement, place: int) -> Kind:
    wanted = ("name", "rows") if hasattr(source, "period_ns") else ("name", "times_ns", "rows")
    missing = [name for name in wanted if not hasattr(source, name)]
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
        raise MeasurementError(f"'{name}' is a built-in kind", advice="give the measurement another name")
    _check_settings(name, source)
    unit, hint, steps = (getattr(source, key, "") for key in ("unit", "hint", "steps"))
    watched, together, tells_heading = (
        bool(getattr(source, key, False)) for key in ("watched", "together", "tells_heading")
    )
    period_ns = _checked_period(name, source)
    times_ns = np.zeros(0, np.int64) if period_ns else _checked_times(name, source.times_ns)
    unlikely = getattr(source, "unlikely", None)
    gate2 = _gate2(name, source)
    at_gps_time = getattr(source, "clock", "imu") == "gps"
    return Kind(
        source,
        name,
        times_ns,
        gate2,
        unit,
        period_ns,
        watched=watched,
        tells_heading=tells_heading,
        steps=steps,
        unlikely=unlikely,
        together=together,
        hint=hint,
        at_gps_time=at_gps_time,
    )


def _check_settings(name: str, source: Measurement) -> None:
    """Refuse a setting of a measurement that is not of its type."""
    wanted: dict[str, tuple[Callable[[Any], bool], str]] = {
        **dict.fromkeys(
            ("watched", "carrying", "together", "tells_heading"), (_is_truth_value, "True or False")
        ),
        **dict.fromkeys(("unit", "hint", "steps"), (_is_text, "a text")),
        "repeats": (callable, "a function of the time [ns]"),
        "unlikely": (_is_function_or_none, "a function of the state, or None"),
        "clock": (lambda value: value in ("gps", "imu"), '"gps" or "imu"'),
    }
    for key, (fits, what) in wanted.items():
        if hasattr(source, key) and not fits(getattr(source, key)):
            raise MeasurementError(
                f"{key} of measurement '{name}' is {getattr(source, key)!r}", advice=f"give {what}"
            )


def _is_truth_value(value: Any) -> bool:
    return isinstance(value, bool | np.bool_)


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_function_or_none(value: Any) -> bool:
    return value is None or callable(value)


def _checked_period(name: str, source: Measurement) -> int:
    """Return the period of a measurement, 0 where it lists its times."""
    period: object = getattr(source, "period_ns", 0)
    if not hasattr(source, "period_ns"):
        return 0
    whole = isinstance(period, int | np.integer) and not isinstance(period, bool)
    if not whole or not _SHORTEST_PERIOD_NS <= int(period) <= NS_PER_WEEK:  # type: ignore[call-overload]
        raise MeasurementError(
            f"period_ns of measurement '{name}' is {period!r}",
            advice="give a whole number of nanoseconds, 1e6 (1 kHz) or more",
        )
    if np.size(getattr(source, "times_ns", ())) > 0:
        advice = "give one of them; for both, add a second measurement under another name"
        raise MeasurementError(f"measurement '{name}' has both period_ns and times_ns", advice=advice)
    return int(period)  # type: ignore[call-overload,no-any-return]


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
