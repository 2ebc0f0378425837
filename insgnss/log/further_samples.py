"""Samples of further sensors in a log: a phone's barometer and magnetometer, the heading of a receiver's antennas."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from insgnss.config.sensors import BarometerColumns, HeadingColumns, MagnetometerColumns
from insgnss.tables import Bool, Event, Float64, Int64

BAROMETER: Final = "barometer"
MAGNETOMETER: Final = "magnetometer"
HEADING: Final = "heading"
FurtherKind = Literal["barometer", "magnetometer", "heading"]
_COLUMNS: Final[dict[FurtherKind, tuple[str, ...]]] = {
    BAROMETER: (BarometerColumns().value,),
    MAGNETOMETER: MagnetometerColumns().field,
    HEADING: (HeadingColumns().heading, HeadingColumns().sigma),
}
_MEASURED: Final[dict[FurtherKind, int]] = {
    BAROMETER: 1,
    MAGNETOMETER: 3,
    HEADING: 1,
}  # the others are sigmas


@dataclass(frozen=True)
class FurtherSamples:
    """The samples of one further sensor, strictly increasing in time; a field is in the inertial sensor's axes."""

    kind: FurtherKind
    source: str  # what the log calls them
    t_ns: Int64  # (n,) GPS time
    values: Float64  # (n, 1) pressure [hPa], (n, 3) field [uT], (n, 2) heading and its sigma or NaN [deg]

    @property
    def file(self) -> str:
        """The name of the CSV file that they are written to."""
        return f"{self.kind}.csv"

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of the values' columns, as a flight file expects them."""
        return _COLUMNS[self.kind]

    @property
    def has_sigmas(self) -> bool:
        """Whether any sample states its sigma."""
        return bool(np.isfinite(self.values[:, _MEASURED[self.kind] :]).any())


def further_samples(
    kind: FurtherKind, source: str, t_ns: Int64, values: Float64, dated: Bool | None = None
) -> tuple[list[FurtherSamples], list[Event]]:
    """Return the samples with a time and finite numbers, in the order of time; an event reports what was left out.

    Parameters
    ----------
    t_ns : (n,) GPS time
    values : (n, 1), (n, 2) or (n, 3), as in ``FurtherSamples``; a sigma may be NaN
    dated : (n,) which times are known; all when left out

    Returns
    -------
    A list of one table, or none where no sample is left.
    """
    usable = np.isfinite(values[:, : _MEASURED[kind]]).all(axis=1)
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


def most_samples(tables: Sequence[FurtherSamples]) -> tuple[tuple[FurtherSamples, ...], list[Event]]:
    """Return of each kind the table with most samples; an event names the others."""
    by_kind: dict[FurtherKind, FurtherSamples] = {}
    others = []
    for one in sorted(tables, key=lambda one: -len(one.t_ns)):
        if one.kind in by_kind:
            others.append(f"{len(one.t_ns)} {one.source} ({by_kind[one.kind].source} has more)")
        else:
            by_kind[one.kind] = one
    events = [Event(None, "sensor_samples_not_used", f"not read: {', '.join(others)}")] if others else []
    return tuple(by_kind.values()), events
