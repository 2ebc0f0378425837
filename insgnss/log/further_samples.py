"""Samples of further sensors in the log of a phone, an autopilot or a robot: its barometer and its magnetometer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from insgnss.config.sensors import BarometerColumns, MagnetometerColumns
from insgnss.tables import Bool, Event, Float64, Int64

BAROMETER: Final = "barometer"
MAGNETOMETER: Final = "magnetometer"
FurtherKind = Literal["barometer", "magnetometer"]
_COLUMNS: Final[dict[FurtherKind, tuple[str, ...]]] = {
    BAROMETER: (BarometerColumns().value,),
    MAGNETOMETER: MagnetometerColumns().field,
}


@dataclass(frozen=True)
class FurtherSamples:
    """The samples of one further sensor, strictly increasing in time, in the axes of the log's inertial sensor."""

    kind: FurtherKind
    source: str  # what the log calls them
    t_ns: Int64  # (n,) GPS time
    values: Float64  # (n, 1) pressure [hPa] or (n, 3) field [uT]

    @property
    def file(self) -> str:
        """The name of the CSV file that they are written to."""
        return f"{self.kind}.csv"

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of the values' columns, as a flight file expects them."""
        return _COLUMNS[self.kind]


def further_samples(
    kind: FurtherKind, source: str, t_ns: Int64, values: Float64, dated: Bool | None = None
) -> tuple[list[FurtherSamples], list[Event]]:
    """Return the samples with a time and finite numbers, in the order of time; an event tells what was left out.

    Parameters
    ----------
    t_ns : (n,) GPS time
    values : (n, 1) or (n, 3), in the unit of the kind
    dated : (n,) which times are known; all when left out

    Returns
    -------
    A list of one table, or none where no sample is left.
    """
    usable = np.isfinite(values).all(axis=1)
    if dated is not None:
        usable &= dated
    rows = np.flatnonzero(usable)
    _, first = np.unique(t_ns[rows], return_index=True)
    rows = rows[first]
    events = []
    if len(rows) < len(t_ns):
        detail = (
            f"{source}: {int((~usable).sum())} sample(s) without a time or a number,"
            f" {int(usable.sum()) - len(rows)} with the time of another left out"
        )
        events.append(Event(None, "sensor_samples_left_out", detail))
    return ([FurtherSamples(kind, source, t_ns[rows], values[rows])] if len(rows) else []), events


def most_samples(found: Sequence[FurtherSamples]) -> tuple[tuple[FurtherSamples, ...], list[Event]]:
    """Return of each kind the table with most samples; an event names the others."""
    kept: dict[FurtherKind, FurtherSamples] = {}
    others = []
    for one in sorted(found, key=lambda one: -len(one.t_ns)):
        if one.kind in kept:
            others.append(f"{len(one.t_ns)} {one.source} ({kept[one.kind].source} has more)")
        else:
            kept[one.kind] = one
    events = [Event(None, "sensor_samples_not_used", f"not read: {', '.join(others)}")] if others else []
    return tuple(kept.values()), events
